"""Seeded random problems; all 200 are in benchmarks/random_problems.py."""

from __future__ import annotations

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import random_scene
from benchmarks.problems.checks import check_feasibility
from tests.planning.conftest import planned_random

SEEDS = range(100, 125)
SOLVED = 1e-6  # [m, rad, per second] largest violation
ITERATIONS = 60
MOST = 10  # iterations in the median


@pytest.mark.parametrize("seed", SEEDS)
def test_random_problems_are_solved(seed: int) -> None:
    named, plan = planned_random(seed)
    assert plan.success, plan.message
    assert check_feasibility(named.scene, named.problem, plan.trajectory).violation < SOLVED
    assert plan.iterations == len(plan.history) <= ITERATIONS
    blind = zs.phase_plane(named.problem.machine, named.problem.start, named.problem.goal)
    assert plan.lower_bound == pytest.approx(blind.duration, rel=1e-12)
    assert plan.lower_bound <= plan.duration


def test_random_problems_take_at_most_ten_iterations_in_the_median() -> None:
    assert np.median([planned_random(seed)[1].iterations for seed in SEEDS]) <= MOST


def test_a_seed_is_the_same_problem_for_ever() -> None:
    """Results under benchmarks/results name seeds."""
    scene, (start, goal) = random_scene(29)
    np.testing.assert_allclose(
        [scene.roll, scene.pitch], [-0.1520990543066924, -0.22840835277257981], rtol=1e-12
    )
    assert scene.tree is not None
    assert scene.tree.mass == pytest.approx(2657.5326568655146, rel=1e-12)
    np.testing.assert_allclose(
        [start[0], goal[0]], [-2.9879536014235817, -0.8388945875324954], rtol=1e-9
    )


@pytest.mark.parametrize("seed", range(300, 340))
def test_the_lower_bound_is_never_above_the_duration(seed: int) -> None:
    """Whatever the limits, the grid and the rates at both ends."""
    rng = np.random.default_rng(seed)
    scene, (start, goal) = random_scene(seed)
    machine = scene.load()
    # shorter than the random ones, and maybe tipping over
    goal = start + rng.uniform(0.1, 1.0) * (goal - start)
    if zs.stability_margin(machine, goal, 0.0 * goal, 0.0 * goal, scene.ground) < 1e-3:
        goal = start + 0.1 * (goal - start)
    machine = machine.with_limits(
        velocity=rng.uniform(0.2, 1.5, 5), acceleration=rng.uniform(0.3, 3.0, 5)
    )
    try:
        problem = zs.Problem(
            machine,
            start,
            goal,
            scene.ground,
            intervals=int(rng.integers(4, 20)),
            start_velocity=None if seed % 2 else rng.uniform(-0.1, 0.1, 5),
            goal_velocity=None if seed % 3 else rng.uniform(-0.1, 0.1, 5),
        )
    except zs.ProblemError:
        pytest.skip("not a problem: tips over, or leaves no room to stop")
    plan = zs.plan(problem)
    if plan.success:
        assert plan.lower_bound <= plan.duration
        assert check_feasibility(scene, problem, plan.trajectory).violation < SOLVED
    assert plan.lower_bound > 0.0
