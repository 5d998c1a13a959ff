"""The road of the search: half of the intervals first, screened rows, excess between points."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.peer_problems import peer_problem
from benchmarks.problems.arm import HARD, random_problem
from benchmarks.problems.terrain import random_drive_problem
from tests.checks import symmetric
from zmp_sqp.planning.program.grid import ENDS, Grid
from zmp_sqp.planning.program.solution import trajectory
from zmp_sqp.planning.program.staged import POINTS
from zmp_sqp.planning.search import explore as explore_module
from zmp_sqp.planning.search.explore import explore, transferred
from zmp_sqp.planning.search.keep_bound import at_the_bound
from zmp_sqp.planning.search.run import Candidate, Runs
from zmp_sqp.planning.search.task import Task, task_of
from zmp_sqp.scenario import load_scenario
from zmp_sqp.sqp.backends import make_backend
from zmp_sqp.sqp.direction import DUST, MISSED, Direction, Subproblem
from zmp_sqp.sqp.qp import QP
from zmp_sqp.sqp.result import SQPResult, SQPStatus
from zmp_sqp.sqp.solver import SQP, SQPSettings

ACTIVE = [4, 5, 25, 35, 211, 219, 238, 1000, 1029]  # seeds of hard problems: the ZMP costs time
AT_THE_BOUND = [8, 203, 1012, 1016, 1022]  # of those that can be as fast as the joints allow
SAME = 5e-5  # relative, of durations: the change at which a run ends
LEFT = 2e-4  # relative: what a run that creeps leaves, at most, on these problems
SETTLED = 1e-7  # relative change at which a run ends that is to be compared
# of the Lagrangian's gradient there: changes of the duration are of second order in it
STATIONARY = 1e-3
COMPLEMENTARY = 1e-6
NEGLIGIBLE = 1e-6  # violation of rows in a quadratic program
NEAR = 1e-2  # violation of a point near feasibility


def searched(task: Task) -> tuple[Candidate, Runs]:
    runs = Runs.start("auto", None, None)
    return explore(task, runs), runs


def settled(found: Candidate, runs: Runs) -> SQPResult:
    """The run of a candidate, gone on with until nothing changes."""
    result = found.result
    settings = SQPSettings(resumed=True, converged=SETTLED)
    return SQP(runs.backend, settings).minimize(
        found.program, result.point, y=result.y, z=result.z, excess=result.excess
    )


def duration_of(found: Candidate, result: SQPResult) -> float:
    return float(np.sqrt(result.point.sigma) * found.program.reference)


# --- coarse to fine -----------------------------------------------------------------------------


@pytest.mark.parametrize("seed", ACTIVE)
def test_the_search_from_coarse_to_fine_settles_where_one_on_the_fine_grid_settles(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = task_of(random_problem(seed, HARD).problem)
    found, runs = searched(task)
    assert found.is_feasible
    monkeypatch.setattr(explore_module, "LEAST_COARSE", 10**6)
    alone, runs_alone = searched(task)
    assert alone.is_feasible
    assert found.program.grid.size == alone.program.grid.size == task.problem.intervals
    ends = duration_of(found, settled(found, runs))
    ends_alone = duration_of(alone, settled(alone, runs_alone))
    assert ends <= (1.0 + SAME) * ends_alone
    assert ends <= found.duration * (1.0 + 1e-6) <= (1.0 + LEFT) * ends


@pytest.mark.parametrize(
    ("intervals", "grids"), [(7, [7]), (8, [4, 8]), (99, [49, 99]), (200, [25, 50, 100, 200])]
)
def test_grids_are_halved_while_enough_intervals_are_left(intervals: int, grids: list[int]) -> None:
    task = task_of(replace(random_problem(4, HARD).problem, intervals=intervals))
    found, runs = searched(task)
    assert found.is_feasible
    of_search = [run for run in runs.runs if not run.purpose.startswith("probe")]
    of_first_guess = itertools.takewhile(
        lambda run: not run.purpose.startswith("glance"), of_search
    )
    assert [run.intervals for run in of_first_guess] == grids


@pytest.mark.parametrize(
    ("seed", "intervals", "of_probe"),
    [(1016, 16, 16), (1016, 31, 16), (1016, 50, 16), (1016, 98, 16), (1005, 50, 25)],
)
def test_the_trajectory_of_a_probe_is_the_motion_of_its_program_on_more_intervals(
    seed: int, intervals: int, of_probe: int
) -> None:
    task = task_of(replace(random_problem(seed, HARD).problem, intervals=intervals))
    found = at_the_bound(task, Runs.start("auto", None, None))
    assert found is not None
    assert found.is_feasible
    assert found.program.grid.size == of_probe
    motion = trajectory(task.problem, found.program, found.motion, found.fine)
    assert motion.intervals == intervals
    coarse = trajectory(task.problem, found.program, found.motion)
    assert np.isin(np.round(coarse.times, 12), np.round(motion.times, 12)).all()
    longest = np.diff(motion.times).max()
    assert longest <= 2.0 * motion.duration / intervals
    times = np.linspace(0.0, coarse.duration, 997)
    for one, other in zip(motion(times), coarse(times), strict=True):  # the same motion
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-12)


def test_a_probe_that_ends_near_a_feasible_motion_goes_on_with_more_intervals() -> None:
    problem = random_problem(1005, HARD).problem
    plan = zs.plan(problem)
    assert plan.status is zs.Status.FASTEST_POSSIBLE
    first, second = plan.history
    assert first.step == 0.0  # not feasible on 16 intervals
    assert 1e-3 < first.violation < 0.1
    assert second.step == 1.0
    (run,) = plan.runs
    assert (run.iterations, run.intervals, run.status) == (2, 25, "bound_reached")


def coarse_candidate(task: Task, intervals: int) -> Candidate:
    """Where a search on a coarse grid ends."""
    coarse = task_of(replace(task.problem, intervals=intervals))
    return searched(coarse)[0]


@pytest.mark.parametrize("fine", [50, 75])
def test_the_motion_and_the_sums_of_multipliers_stay_on_a_nested_grid(fine: int) -> None:
    task = task_of(random_problem(5, HARD).problem)
    found = coarse_candidate(task, 25)
    program = task.program(found.program.reference, Grid.of(fine))
    point, y, z = transferred(found, program)
    assert len(y) == 0
    coarse, n = found.program, found.program.n
    q, w, _, S = program.unpack(point)
    coarse_q, coarse_w, _, coarse_S = coarse.unpack(found.motion)
    factor = fine // 25
    np.testing.assert_allclose(q[::factor], coarse_q, atol=1e-10)
    np.testing.assert_allclose(w[::factor], coarse_w, atol=1e-9)
    assert pytest.approx(coarse_S, rel=1e-12) == S
    count, sides = coarse.nonlinear, 2 * ENDS * n
    before = found.result.z[:count].reshape(25, POINTS, -1).sum(axis=0)
    after = z[: program.nonlinear].reshape(fine, POINTS, -1).sum(axis=0)
    np.testing.assert_allclose(after, before, atol=1e-12)
    controls = found.result.z[count : count + sides * 25].reshape(2, 25, -1).sum(axis=1)
    moved = z[program.nonlinear : program.nonlinear + sides * fine]
    np.testing.assert_allclose(moved.reshape(2, fine, -1).sum(axis=1), controls, atol=1e-12)


def test_prices_of_positions_are_those_of_the_coarse_intervals() -> None:
    """Positions at nodes have one price on any grid: nothing is shared."""
    task = task_of(replace(random_drive_problem(0, over_terrain=False), intervals=10))
    found, _ = searched(task)
    y = np.arange(20.0)
    priced = Candidate(found.program, replace(found.result, y=y))
    fine = task.program(found.program.reference, Grid.of(20))
    _, prices, _ = transferred(priced, fine)
    np.testing.assert_array_equal(prices.reshape(20, 2), np.repeat(y.reshape(10, 2), 2, axis=0))


# --- screening ----------------------------------------------------------------------------------


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Subproblem, Direction]]:
    """Quadratic programs that were solved without relaxation, with their steps."""
    recorded: list[tuple[Subproblem, Direction]] = []
    solve = Subproblem.solve

    def recording(subproblem: Subproblem, **options: Any) -> Direction | None:
        direction = solve(subproblem, **options)
        if direction is not None:
            recorded.append((subproblem, direction))
        return direction

    monkeypatch.setattr(Subproblem, "solve", recording)
    return recorded


@pytest.mark.parametrize("seed", ACTIVE)
def test_a_screened_step_misses_no_row_of_the_whole_program(
    seed: int, steps: list[tuple[Subproblem, Direction]]
) -> None:
    """Far from feasibility a step may miss rows by much; the merit function is told so."""
    found, runs = searched(task_of(random_problem(seed, HARD).problem))
    assert found.is_feasible
    settled(found, runs)
    near = []
    for subproblem, direction in steps:
        lin = subproblem.lin
        predicted = lin.C @ direction.step + lin.at.inequalities
        np.testing.assert_allclose(predicted, direction.predicted, atol=1e-12)
        assert (direction.z[~subproblem.keep] == 0.0).all()
        if lin.at.violation < NEAR:
            missed = max(DUST, MISSED * lin.at.violation)
            assert predicted[~subproblem.keep].max(initial=-1.0) <= missed
            near.append(subproblem.keep.mean())
    assert len(near) >= 2
    assert np.mean(near) < 0.5


@pytest.mark.parametrize("seed", ACTIVE[:4])
def test_a_screened_program_has_the_minimum_of_the_whole_one(
    seed: int, steps: list[tuple[Subproblem, Direction]]
) -> None:
    """With the convex Hessian, so that there is one minimum, and near the optimum, where nothing
    may be missed."""
    found, runs = searched(task_of(random_problem(seed, HARD).problem))
    settled(found, runs)
    backend, compared = make_backend("auto"), 0
    for recorded, direction in tuple(steps):
        lin = recorded.lin
        if len(lin.gradient) != found.program.size or MISSED * lin.at.violation > NEGLIGIBLE:
            continue
        H = found.program.hessian(lin, direction.y, direction.z, clipped=1.0, damping=0.0)
        screened = Subproblem(lin, H, recorded.keep, backend, 1e-8).solve(
            iterations=100, y=direction.y, z=direction.z
        )
        assert screened is not None
        program = whole_program(lin, H)
        whole = backend.solve(program, tolerance=1e-8, iterations=100)
        assert max(whole.residuals(program)) < 10.0 * NEGLIGIBLE

        def value(step: np.ndarray, lin: Any = lin, H: Any = H) -> float:
            return float(0.5 * step @ (symmetric(H) @ step) + lin.gradient @ step)

        assert value(screened.step) == pytest.approx(value(whole.x), abs=10.0 * NEGLIGIBLE)
        compared += 1
    assert compared > 0


@pytest.mark.parametrize("seed", AT_THE_BOUND)
def test_a_motion_at_the_bound_keeps_rows_that_took_part_in_no_program(seed: int) -> None:
    """On dense samples between the points at which rows are imposed, too."""
    task = task_of(random_problem(seed, HARD).problem)
    runs = Runs.start("auto", None, None)
    found = at_the_bound(task, runs)
    assert found is not None
    record, program = runs.history[-1], found.program
    assert record.rows < 0.5 * program.inequalities
    q, w, controls, S = program.unpack(found.motion)
    worst = np.full(program.rows.count, -np.inf)
    for s in np.linspace(0.0, 1.0, 21):
        states = program.grid.within(s, q[:-1], w[:-1], controls)
        worst = np.maximum(worst, program.rows.evaluate(*states, S).max(axis=0))
    assert (worst <= program.rows.tolerance).all()
    limits = slice(program.nonlinear, None)
    at = program.evaluate(found.motion)
    assert (at.inequalities[limits] <= program.tolerance[limits]).all()


def whole_program(lin: Any, H: Any) -> QP:
    at = lin.at
    return QP(H, lin.gradient, lin.A, -at.equalities, lin.C.matrix, -at.inequalities)


# --- answers ------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", ACTIVE)
def test_an_answer_satisfies_the_optimality_conditions_of_the_whole_program(seed: int) -> None:
    """Those of Karush, Kuhn and Tucker, with all rows and no quadratic program in between."""
    found, runs = searched(task_of(random_problem(seed, HARD).problem))
    assert found.result.status is SQPStatus.OPTIMAL
    program, result = found.program, settled(found, runs)
    lin = program.linearize(result.point)
    values = lin.at.inequalities.copy()
    if result.excess is not None:
        values[: program.nonlinear] += result.excess
    assert (values <= program.tolerance).all()
    assert (result.z >= 0.0).all()
    assert result.z.sum() > 1.0  # rows hold the duration up
    gradient = lin.gradient + lin.C.matrix.T @ result.z
    np.testing.assert_allclose(gradient, 0.0, atol=STATIONARY)
    np.testing.assert_allclose(result.z * values, 0.0, atol=COMPLEMENTARY)


def test_more_margin_takes_more_time_also_where_the_first_guess_ends_in_a_bad_minimum() -> None:
    # a motion that keeps a margin keeps every smaller one; from the first guess alone, margins of
    # 0.50 to 0.55 m took 5.98 to 6.36 s
    problem = load_scenario("paper_1").problem
    margins = (0.45, 0.5, 0.55, 0.6, 0.65)
    plans = [zs.plan(replace(problem, margin=margin)) for margin in margins]
    assert all(plan.success for plan in plans)
    durations = [plan.duration for plan in plans]
    assert all(b >= a * (1.0 - 1e-4) for a, b in itertools.pairwise(durations))
    assert any("glance" in run.purpose for run in plans[2].runs)


def test_a_glance_at_the_second_guess_leaves_a_minimum_that_is_worse_than_a_peers() -> None:
    # IPOPT takes 9.202 s with constant accelerations; the first guess alone ends at 9.397 s
    plan = zs.plan(peer_problem(61).problem)
    assert plan.success
    assert plan.duration <= 9.202
    first, second = (run for run in plan.runs if run.purpose == "finer grid")
    assert second.duration < first.duration
    assert plan.duration == pytest.approx(second.duration, rel=1e-3)
