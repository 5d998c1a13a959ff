"""What must not change a plan, and what may change it one way only."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import HARD, random_scene
from tests.planning.conftest import planned_random
from tests.problems import slew, slider

SAME = 1e-4  # relative: each run ends where the changes to come are below half of it
SLACK = 1e-5  # relative: what an inequality between two optima may miss
SEEDS = [
    29,
    56,
    63,
    121,
]  # of benchmarks.problems.arm.ORDINARY; the ZMP costs time in three of them
MIRROR = np.array([-1.0, 1.0, 1.0, 1.0, -1.0])  # left and right: slew and head turn the other way


@pytest.mark.parametrize("seed", SEEDS)
def test_the_mirrored_problem_takes_as_long(seed: int) -> None:
    named, plan = planned_random(seed)
    scene, problem = replace(named.scene, roll=-named.scene.roll), named.problem
    mirrored = zs.plan(scene.problem(MIRROR * problem.start, MIRROR * problem.goal))
    assert mirrored.success
    assert mirrored.duration == pytest.approx(plan.duration, rel=SAME)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_problem_seen_from_behind_takes_as_long(seed: int) -> None:
    """The footprint is symmetric: half a turn of the ground is half a turn of the slew."""
    named, plan = planned_random(seed)
    scene, problem = (
        replace(named.scene, roll=-named.scene.roll, pitch=-named.scene.pitch),
        named.problem,
    )
    turn = np.array([np.pi, 0.0, 0.0, 0.0, 0.0])
    sign = -1.0 if max(problem.start[0], problem.goal[0]) > np.pi else 1.0
    turned = zs.plan(scene.problem(problem.start + sign * turn, problem.goal + sign * turn))
    assert turned.success
    assert turned.duration == pytest.approx(plan.duration, rel=SAME)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_way_back_takes_as_long(seed: int) -> None:
    named, plan = planned_random(seed)
    back = zs.plan(named.scene.problem(named.problem.goal, named.problem.start))
    assert back.success
    assert back.duration == pytest.approx(plan.duration, rel=SAME)


def test_the_slope_is_the_same_in_whatever_frame_it_is_given() -> None:
    """A pitch seen by a machine that stands across: slew by a quarter turn, roll for pitch."""
    square = ((-1.3, -1.3), (1.3, -1.3), (1.3, 1.3), (-1.3, 1.3))
    scene = replace(slew(radius=1.3, intervals=30).scene, vertices=square)
    along, across = replace(scene, pitch=0.05), replace(scene, roll=0.05)
    one = zs.plan(along.problem([0.0], [1.0], intervals=30))
    other = zs.plan(across.problem([-np.pi / 2], [1.0 - np.pi / 2], intervals=30))
    assert one.success
    assert one.duration == pytest.approx(other.duration, rel=SAME)


@pytest.mark.parametrize("seed", SEEDS)
def test_shrinking_the_polygon_never_shortens_the_motion(seed: int) -> None:
    named, plan = planned_random(seed)
    problem = named.problem
    durations = [plan.duration]
    for margin in (0.02, 0.04):
        tighter = zs.plan(named.scene.problem(problem.start, problem.goal, margin=margin))
        assert tighter.success, tighter.message
        assert tighter.margin >= margin
        durations.append(tighter.duration)
    assert all(b >= a * (1.0 - SLACK) for a, b in pairwise(durations)), durations


def test_shrinking_the_sliders_polygon_lengthens_the_motion() -> None:
    named = slider(intervals=50)
    problem = named.problem
    durations = [
        zs.plan(named.scene.problem(problem.start, problem.goal, margin=m)).duration
        for m in (0.0, 0.05, 0.1)
    ]
    assert durations[0] < durations[1] < durations[2]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_higher_limits_are_never_slower(seed: int, quantity: str) -> None:
    named, plan = planned_random(seed)
    problem = named.problem
    higher = problem.machine.with_limits(
        **{quantity: 1.3 * getattr(problem.machine.limits, quantity)}
    )
    faster = zs.plan(zs.Problem(higher, problem.start, problem.goal, problem.ground))
    assert faster.success, faster.message
    # each duration is that of its own grid: switching times that fall between nodes cost up to 0.1
    # %
    assert faster.duration <= plan.duration * (1.0 + 1e-3)


def test_a_static_pose_near_the_edge_can_be_left_and_reached() -> None:
    """The hard recipe: poses 2 to 30 cm from tipping."""
    scene, (start, goal) = random_scene(3, HARD)
    plan = zs.plan(scene.problem(start, goal))
    assert plan.success, plan.message
