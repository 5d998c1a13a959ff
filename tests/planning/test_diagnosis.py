"""Diagnosis: what is proven impossible, what was not found, and what would do instead."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.blocked import blocked_problem
from benchmarks.problems.paper import paper_scene
from zmp_sqp.planning.problem.statics import gentler
from zmp_sqp.planning.search.diagnosis import ITERATIONS
from zmp_sqp.planning.search.run import Candidate, Runs

START = np.array([0.0, -np.pi / 6, -2 * np.pi / 3, np.pi / 6, -np.pi / 2])
GOAL = START + np.array([np.pi, 0.0, 0.0, 0.0, 0.0])
SIDEWAYS = START + np.array([np.pi / 2, 0.0, 0.0, 0.0, 0.0])
LEFT = zs.Slope(roll=np.radians(-20.0))


def stiff_machine() -> zs.Machine:
    """An arm that cannot be drawn in: on its way round it must tip the machine over."""
    machine = paper_scene().load()
    limits = machine.limits
    lower, upper = limits.position_lower.copy(), limits.position_upper.copy()
    lower[1:4], upper[1:4] = START[1:4] - 0.005, START[1:4] + 0.005
    return replace(machine, limits=replace(limits, position_lower=lower, position_upper=upper))


def numbers(message: str) -> tuple[float, float]:
    found = re.search(
        r"payload could be at most (\d+) kg, or the slope could be at most ([\d.]+) degrees",
        message,
    )
    assert found is not None, message
    return float(found[1]), np.radians(float(found[2]))


def test_a_goal_that_tips_over_says_what_it_could_stand_and_that_is_the_most() -> None:
    machine = paper_scene().load()
    with pytest.raises(zs.ProblemError, match="tips over at rest at the goal") as caught:
        zs.Problem(machine, START, SIDEWAYS, LEFT)
    payload, slope = numbers(str(caught.value))
    for share, stands in ((payload / 4000.0, True), ((payload + 2.0) / 4000.0, False)):
        lighter = machine.with_payload_scaled(share)
        still = np.zeros(5)
        assert (zs.stability_margin(lighter, SIDEWAYS, still, still, LEFT) >= -1e-9) == stands
    for angle, stands in ((slope, True), (slope + np.radians(0.11), False)):
        margin = zs.stability_margin(
            machine, SIDEWAYS, np.zeros(5), np.zeros(5), zs.Slope(roll=-angle)
        )
        assert (margin >= -1e-9) == stands


def test_a_pose_that_no_payload_would_save_gets_no_such_advice() -> None:
    narrow = (
        paper_scene()
        .load()
        .with_support(zs.SupportPolygon([(-2.5, -1.6), (2.5, -1.6), (2.5, -1.5), (-2.5, -1.5)]))
    )
    with pytest.raises(zs.ProblemError, match=r"of the support polygon$"):
        zs.Problem(narrow, START, GOAL, zs.Slope())


def test_rates_from_which_nothing_can_be_saved_are_refused_and_that_is_proven() -> None:
    """It slews so fast that no acceleration within limits keeps the ZMP from the front edge."""
    machine = paper_scene().load().with_limits(velocity=20.0, acceleration=2.0)
    rates = np.array([2.5, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(
        zs.ProblemError,
        match="at the start whatever its joints do within their acceleration limits",
    ):
        zs.Problem(machine, START, GOAL, LEFT, start_velocity=rates)
    rng, margins = np.random.default_rng(0), []
    for _ in range(300):
        push = 2.0 * rng.choice([-1.0, 1.0, 0.0], 5)
        margins.append(float(zs.stability_margin(machine, START, rates, push, LEFT)))
    assert max(margins) < 0.0
    zs.Problem(machine, START, GOAL, LEFT, start_velocity=0.8 * rates)  # not proven


def test_a_plan_that_was_not_found_says_what_would_do() -> None:
    problem = zs.Problem(stiff_machine(), START, GOAL, LEFT, intervals=6)
    plan = zs.plan(problem)
    assert plan.status is zs.Status.INFEASIBLE
    tried: list[str] = []
    found = zs.diagnose(plan, progress=tried.append)
    assert found.edge == "left"
    assert found.outside > 0.1
    assert f"{found.outside:.3f} m" in plan.message
    assert found.largest_payload is not None
    assert found.steepest_slope is not None
    assert 0.0 < found.largest_payload < 4000.0
    assert 0.0 < found.steepest_slope < np.radians(20.0)
    assert f"payload could be {int(found.largest_payload)} kg" in found.message
    assert 8 <= len(tried) <= 12
    lighter = problem.machine.with_payload_scaled(found.largest_payload / 4000.0)
    assert zs.plan(replace(problem, machine=lighter)).success
    assert zs.plan(replace(problem, ground=zs.Slope(roll=-found.steepest_slope))).success


def test_only_a_plan_without_success_is_diagnosed() -> None:
    plan = zs.plan(zs.Problem(paper_scene().load(), START, GOAL, LEFT, intervals=10))
    with pytest.raises(zs.ProblemError, match="nothing to diagnose"):
        zs.diagnose(plan)
    with pytest.raises(zs.ProblemError, match="takes a Plan"):
        zs.diagnose(None)


@pytest.mark.parametrize("seed", [1, 3, 4])
def test_what_a_diagnosis_recommends_is_planned(seed: int) -> None:
    problem = blocked_problem(seed)
    plan = zs.plan(problem)
    assert not plan.success
    found = zs.diagnose(plan)
    advised = []
    if found.largest_payload is not None:
        share = found.largest_payload / problem.machine.payload_mass
        assert 0.0 < share < 1.0
        advised.append(replace(problem, machine=problem.machine.with_payload_scaled(share)))
    if found.steepest_slope is not None:
        whole = np.arccos(np.cos(problem.ground.roll) * np.cos(problem.ground.pitch))
        assert 0.0 <= found.steepest_slope < whole
        advised.append(
            replace(problem, ground=gentler(problem.ground, found.steepest_slope / whole))
        )
    assert advised
    for changed in advised:
        assert zs.plan(changed).success


def test_a_diagnosis_takes_few_iterations(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[int] = []
    minimize = Runs.minimize

    def counting(runs: Runs, *arguments: Any, **options: Any) -> Candidate:
        found = minimize(runs, *arguments, **options)
        taken.append(len(found.result.history))
        return found

    plan = zs.plan(blocked_problem(0))
    monkeypatch.setattr(Runs, "minimize", counting)
    found = zs.diagnose(plan)
    assert found.largest_payload is not None
    assert found.steepest_slope is not None
    assert 0 < sum(taken) <= 2 * ITERATIONS
