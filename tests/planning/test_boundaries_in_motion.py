"""Starts and goals in motion, and planning again from the middle of a plan."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import HARD, random_problem
from benchmarks.problems.checks import check_feasibility
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_scene
from benchmarks.problems.scene import NamedProblem
from tests.planning.conftest import planned_paper_1, planned_random
from tests.problems import double_integrator, slider
from zmp_sqp.scenario import load_scenario

SAFE = 1e-6
EXACT = 1e-9
GRID = 5e-3  # relative: what a replan may lose to its own grid
RATES = {
    "start": ([0.5, 0.1, -0.2, 0.3, -0.4], None),
    "goal": (None, [0.4, -0.1, 0.1, 0.2, -0.3]),
    "both": ([0.6, -0.1, 0.1, 0.0, 0.2], [0.3, 0.1, -0.1, 0.1, 0.0]),
    "start, away from the goal": ([-0.6, 0.0, 0.0, 0.0, 0.0], None),
    "at the rate limit": ([np.pi / 4, 0.0, 0.0, 0.0, 0.0], [np.pi / 4, 0.0, 0.0, 0.0, 0.0]),
}


@pytest.mark.parametrize("which", RATES)
def test_boundary_rates_are_met_and_the_zmp_stays_inside(which: str) -> None:
    start_velocity, goal_velocity = RATES[which]
    scene = paper_scene(point_masses=False)
    problem = scene.problem(
        PAPER_START,
        PAPER_GOAL,
        start_velocity=start_velocity,
        goal_velocity=goal_velocity,
        intervals=40,
    )
    plan = zs.plan(problem)
    assert plan.success, plan.message
    found = check_feasibility(scene, problem, plan.trajectory)
    assert found.boundary <= EXACT
    assert found.violation <= SAFE
    assert plan.lower_bound <= plan.duration


def rest_of_the_way(
    named: NamedProblem, plan: zs.Plan, share: float
) -> tuple[zs.Plan, float, float]:
    """Plan again from a node of the plan, on the remaining intervals.

    Returns:
        The plan, its duration, and what was left of the first one's duration [s].
    """
    node = round(share * plan.trajectory.intervals)
    q, v = plan.trajectory.positions[node], plan.trajectory.velocities[node]
    problem = zs.Problem(
        named.problem.machine,
        q,
        named.problem.goal,
        named.problem.ground,
        start_velocity=v,
        intervals=plan.trajectory.intervals - node,
    )
    again = zs.plan(problem)
    assert again.success, again.message
    found = check_feasibility(named.scene, problem, again.trajectory)
    assert found.violation <= SAFE
    assert found.boundary <= EXACT
    return again, again.duration, plan.duration - float(plan.trajectory.times[node])


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.8])
def test_replanning_paper_1_on_the_way_arrives_no_later(share: float) -> None:
    _, duration, rest = rest_of_the_way(*planned_paper_1(point_masses=True), share)
    assert duration <= rest * (1.0 + GRID)


@pytest.mark.parametrize("seed", [29, 56, 121])
def test_replanning_on_the_way_arrives_no_later_where_the_zmp_costs_time(seed: int) -> None:
    named, plan = planned_random(seed)
    assert plan.duration > 1.005 * plan.lower_bound  # or it would show little
    _, duration, rest = rest_of_the_way(named, plan, 0.5)
    assert duration <= rest * (1.0 + GRID)


def test_replanning_the_slider_on_the_way_takes_what_the_closed_form_has_left() -> None:
    named = slider(intervals=100)
    plan = zs.plan(named.problem)
    _, duration, rest = rest_of_the_way(named, plan, 0.25)
    assert named.optimum is not None
    assert duration == pytest.approx(rest, rel=GRID)


def test_a_double_integrator_in_motion_takes_its_closed_form() -> None:
    """From 1 m/s over 3 m to rest, with 1 m/s and 2 m/s^2: coast 2.75 s, brake 0.5 s."""
    named = double_integrator(distance=3.0, max_velocity=1.0, max_acceleration=2.0, intervals=65)
    problem = zs.Problem(named.problem.machine, [-1.5], [1.5], start_velocity=[1.0], intervals=65)
    plan = zs.plan(problem)
    assert plan.success, plan.message
    assert plan.lower_bound == pytest.approx(3.25, abs=EXACT)
    assert plan.duration == pytest.approx(3.25, rel=1e-4)


def test_mirrored_in_time_a_start_in_motion_is_a_goal_in_motion() -> None:
    scene, rate = paper_scene(point_masses=False), np.array([0.5, 0.1, 0.0, 0.2, 0.0])
    forth = zs.plan(scene.problem(PAPER_START, PAPER_GOAL, start_velocity=rate))
    back = zs.plan(scene.problem(PAPER_GOAL, PAPER_START, goal_velocity=-rate))
    assert forth.success
    assert back.success
    assert forth.duration == pytest.approx(back.duration, rel=1e-3)


@pytest.mark.parametrize("velocity", [0.0, 0.3])
def test_start_and_goal_the_same_state_in_motion_keep_its_rates(velocity: float) -> None:
    named = double_integrator(distance=1.0, max_velocity=1.0, max_acceleration=2.0, intervals=10)
    problem = zs.Problem(
        named.problem.machine,
        [0.2],
        [0.2],
        start_velocity=[velocity],
        goal_velocity=[velocity],
        intervals=10,
    )
    plan = zs.plan(problem)
    assert plan.success
    assert plan.duration == 0.0
    assert check_feasibility(named.scene, problem, plan.trajectory).boundary <= EXACT


@pytest.mark.parametrize("seed", [9, 11, 20, 40])
def test_the_rest_of_a_plan_is_not_missed_from_within_it(seed: int) -> None:
    """Near the end a joint brakes all the way: durations a little above the bound are rare."""
    problem = random_problem(seed, HARD).problem
    old = zs.plan(problem).trajectory
    at = 0.9 * old.duration
    q, v, _ = old(at)
    again = zs.plan(replace(problem, start=q, start_velocity=v))
    assert again.success, again.message
    assert again.duration <= (1.0 + 4e-4) * (old.duration - at)
    assert again.status is zs.Status.FASTEST_POSSIBLE


@pytest.mark.parametrize("share", [0.5, 0.7, 0.85, 0.95])
def test_an_excavator_that_lowers_its_load_finds_the_rest_of_its_motion(share: float) -> None:
    problem = load_scenario("excavator_lower").problem
    old = planned_scenario("excavator_lower").trajectory
    q, v, _ = old(share * old.duration)
    again = zs.plan(replace(problem, start=q, start_velocity=v))
    assert again.success, again.message
    assert again.duration <= (1.0 + 4e-4) * (1.0 - share) * old.duration


@cache
def planned_scenario(name: str) -> zs.Plan:
    return zs.plan(load_scenario(name).problem)
