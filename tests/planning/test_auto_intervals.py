"""`intervals="auto"`: the grid that the planner chooses, against grids four times as fine."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import HARD, random_problem
from tests.problems import stack_of_slides
from zmp_sqp.scenario import load_scenario

SUPPORT = zs.SupportPolygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
PROMISED = 1e-3  # of the duration on a grid four times as fine


@pytest.mark.parametrize("seed", [0, 14, 30])
def test_the_duration_is_near_that_of_a_grid_four_times_as_fine(seed: int) -> None:
    problem = random_problem(seed, HARD).problem
    chosen = zs.plan(replace(problem, intervals="auto"))
    assert chosen.success, chosen.message
    intervals = chosen.trajectory.intervals
    assert intervals in (50, 100, 200, 400)
    finer = zs.plan(replace(problem, intervals=4 * intervals))
    assert chosen.duration <= finer.duration * (1.0 + PROMISED)


def test_a_finer_grid_is_taken_where_it_pays() -> None:
    problem = random_problem(30, HARD).problem
    chosen = zs.plan(replace(problem, intervals="auto"))
    assert chosen.trajectory.intervals > 50
    assert chosen.duration < zs.plan(problem).duration * (1.0 - 5e-4)
    grids = [run.intervals for run in chosen.runs]
    assert grids[-1] == chosen.trajectory.intervals
    assert grids[-2] == grids[-1] // 2


def test_a_motion_at_its_bound_needs_no_finer_grid() -> None:
    problem = load_scenario("paper_1").problem
    chosen, given = zs.plan(replace(problem, intervals="auto")), zs.plan(problem)
    assert chosen.status is zs.Status.FASTEST_POSSIBLE
    assert chosen.duration == given.duration
    assert chosen.trajectory.intervals == 50


def test_a_time_budget_ends_refinement_with_what_there_is() -> None:
    problem = replace(random_problem(30, HARD).problem, intervals="auto")
    whole = zs.plan(problem)
    short = zs.plan(problem, time_budget=0.5 * whole.solve_time)
    assert short.success or short.status is zs.Status.TIME_BUDGET
    if short.success:
        assert short.trajectory.intervals <= whole.trajectory.intervals


@pytest.mark.parametrize("wrong", ["Auto", "fine", "", None, 1.0])
def test_other_words_are_refused(wrong: object) -> None:
    problem = load_scenario("paper_1").problem
    with pytest.raises(zs.ProblemError, match='at least 2 or "auto"'):
        replace(problem, intervals=wrong)


def test_every_run_of_the_search_is_told_of() -> None:
    plan = zs.plan(random_problem(4, HARD).problem)
    probe, coarse, fine = plan.runs
    assert (probe.intervals, coarse.intervals, fine.intervals) == (16, 25, 50)
    assert probe.status == "refused"
    assert coarse.purpose == "cubic, 1.15 x bound"
    assert fine.backend
    assert fine.status == "optimal"
    assert fine.duration == pytest.approx(plan.duration, rel=1e-6)
    assert sum(run.iterations for run in plan.runs) == plan.iterations


@pytest.mark.parametrize(("joints", "first"), [(5, 50), (12, 50), (13, 24)])
def test_more_than_twelve_joints_start_on_fewer_intervals(
    joints: int, first: int, tmp_path: Path
) -> None:
    machine = zs.load_machine(stack_of_slides(tmp_path, joints), support=SUPPORT)
    machine = machine.with_limits(velocity=1.0, acceleration=1.0)
    q = np.full(joints, 0.02)
    problem = zs.Problem(machine, -q, q, intervals="auto")
    assert problem.first_intervals == first
    assert zs.plan(problem).success
    # numbers are obeyed, and the default is the same for all
    assert zs.Problem(machine, -q, q, intervals=7).first_intervals == 7
    assert zs.Problem(machine, -q, q).first_intervals == 50
