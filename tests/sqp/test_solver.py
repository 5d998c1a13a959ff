"""Steps one by one, limits, history, restarts, and rows between the places they are imposed at."""

from __future__ import annotations

import hashlib
import time
from dataclasses import replace

import numpy as np
import pytest

from tests.sqp.chain import BULGE, Chain
from tests.sqp.problems import HOCK_SCHITTKOWSKI, TOLERANCE, Textbook, named
from zmp_sqp.sqp.backends import make_backend
from zmp_sqp.sqp.iterate import Iterate
from zmp_sqp.sqp.result import IterationRecord, SQPResult, SQPStatus
from zmp_sqp.sqp.solver import SQP, SQPSettings
from zmp_sqp.sqp.steps import EXCESS_FACTOR, EXCESS_GUARD

BACKENDS = ("auto", "proxqp", "piqp", "qpsolvers:clarabel", "qpsolvers:daqp")

# HS26 is flat to fourth order: its solution is only known to 1e-2
SHARP = [problem for problem in HOCK_SCHITTKOWSKI if problem.name != "HS26"]


def solve(problem: Textbook, backend: str = "piqp", **settings: float) -> SQPResult:
    sqp = SQP(make_backend(backend), settings=SQPSettings(**settings))
    return sqp.minimize(problem, problem.x0)


def test_the_iteration_limit_is_kept_and_reported() -> None:
    result = solve(named("HS104"), max_iterations=2)
    assert result.status.name == "ITERATION_LIMIT"
    assert len(result.history) == 2
    assert not result.status.is_feasible


def test_a_limit_that_strikes_after_a_feasible_point_yields_that_point() -> None:
    problem = named("HS35")  # whose rows are linear
    result = solve(problem, max_iterations=1)
    assert result.status.name == "FEASIBLE"
    assert result.at.violation <= TOLERANCE
    assert result.at.violation == problem.evaluate(result.point).violation


def test_no_iteration_starts_after_the_deadline() -> None:
    result = solve(named("HS104"), deadline=time.perf_counter() - 1.0)
    assert result.status.name == "TIME_LIMIT"
    assert result.history == ()


def test_qps_that_were_given_up_because_time_is_up_are_no_failure_of_the_solver() -> None:
    problem = named("HS104")
    for deadline, expected in ((None, "QP_FAILED"), (1.0, "TIME_LIMIT"), (3.0, "QP_FAILED")):
        settings = SQPSettings(deadline=deadline, clock=lambda: 2.0)
        sqp = SQP(make_backend("piqp"), settings=settings)
        failed = replace(sqp.init(problem, problem.x0), verdict=SQPStatus.QP_FAILED)
        status = sqp.terminate(failed)
        assert status is not None
        assert status.name == expected


def test_every_iteration_is_reported_as_it_stands_in_the_history() -> None:
    seen: list[IterationRecord] = []
    problem = named("HS71")
    result = SQP(make_backend("piqp"), report=seen.append).minimize(problem, problem.x0)
    assert tuple(seen) == result.history
    assert [record.iteration for record in seen] == list(range(1, len(seen) + 1))


@pytest.mark.parametrize("backend", ["proxqp", "piqp", "qpsolvers:daqp"])
def test_the_history_tells_what_happened(backend: str) -> None:
    result = solve(named("HS71"), backend)
    last = result.history[-1]
    # takes it on from the active rows of the last QP
    finishers = {"daqp"} if backend == "proxqp" else set()
    assert {record.backend for record in result.history} - finishers == {backend}
    assert last.objective == result.at.objective
    assert last.violation == result.at.violation
    assert all(0.0 <= record.step <= 1.0 for record in result.history)
    assert all(1 <= record.rows <= len(result.z) for record in result.history)
    times = [record.time for record in result.history]
    assert times == sorted(times)
    assert times[0] > 0.0
    if backend != "qpsolvers:daqp":  # which does not tell
        assert all(record.inner_iterations > 0 for record in result.history)


def test_curvature_of_constraints_counts_once_they_have_multipliers() -> None:
    result = solve(named("HS43"))
    assert any(record.curvature for record in result.history)


def test_init_step_and_terminate_make_up_a_run() -> None:
    problem = named("HS43")
    sqp = SQP(make_backend("piqp"))
    whole = sqp.minimize(problem, problem.x0)
    iterate, numbers = sqp.init(problem, problem.x0), []
    assert isinstance(iterate, Iterate)
    assert not iterate.y.any()
    assert not iterate.z.any()
    while (status := sqp.terminate(iterate)) is None:
        before = iterate
        iterate = sqp.step(problem, iterate)
        numbers.append(iterate.number)
        assert before.number == iterate.number - 1  # a step leaves its iterate alone
    assert status is whole.status
    assert numbers == [record.iteration for record in whole.history]
    np.testing.assert_array_equal(iterate.point, whole.point)


@pytest.mark.parametrize("backend", ["piqp", "proxqp"])
@pytest.mark.parametrize("problem", SHARP, ids=lambda problem: problem.name)
def test_a_run_resumed_at_its_solution_with_its_multipliers_ends_within_two_steps(
    problem: Textbook, backend: str
) -> None:
    solved = solve(problem, backend, converged=1e-9)
    resumed = SQP(make_backend(backend), settings=SQPSettings(converged=1e-9, resumed=True))
    again = resumed.minimize(problem, solved.point, y=solved.y, z=solved.z)
    assert len(again.history) <= 2
    assert again.status.is_feasible
    assert again.at.objective == pytest.approx(solved.at.objective, rel=1e-6, abs=1e-6)


def test_a_proven_bound_ends_the_run() -> None:
    class Bounded(Textbook):
        def optimality_gap(self, x: np.ndarray) -> float:
            return float(self.objective(x)) / self.optimum - 1.0

    problem = named("HS71")
    bounded = Bounded(**{key: getattr(problem, key) for key in problem.__dataclass_fields__})
    result = solve(bounded)
    assert result.status.name == "BOUND_REACHED"
    assert result.at.objective == pytest.approx(problem.optimum, rel=1e-6)


# --- the chain: equalities, screening, excess -----------------------------------------------------


def run(chain: Chain, backend: str = "piqp", seed: int = 0, **settings: float) -> SQPResult:
    settings = {"converged": 1e-9, **settings}
    sqp = SQP(make_backend(backend), settings=SQPSettings(**settings))
    return sqp.minimize(chain, chain.start(seed))


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_chain_has_one_optimum_however_it_is_found(backend: str) -> None:
    reference, result = run(Chain()), run(Chain(), backend, seed=3)
    assert reference.status.name == result.status.name == "OPTIMAL"
    assert result.at.objective == pytest.approx(reference.at.objective, rel=1e-6)
    assert reference.at.inequalities.max() > -1e-6, "no row is active"
    assert np.abs(result.at.equalities).max() <= SQPSettings().equality
    assert np.abs(result.y - reference.y).max() <= 1e-2 * np.abs(reference.y).max()


@pytest.mark.parametrize("backend", ["piqp", "proxqp"])
def test_a_goal_that_cannot_be_met_is_reported_infeasible_by_relaxation(backend: str) -> None:
    """The goal lies above the ceiling: only the ceiling, a nonlinear row, may give."""
    result = run(Chain(goal=0.8), backend)
    assert result.status.name == "INFEASIBLE"
    assert any(record.relaxed for record in result.history)
    assert np.abs(result.at.equalities).max() <= 1e-6
    assert result.at.violation == pytest.approx(0.8 + 0.3 * 0.8**2 - 0.6, abs=1e-3)


@pytest.mark.parametrize("backend", ["piqp", "proxqp"])
def test_what_rows_exceed_between_their_places_is_added_to_them_late(backend: str) -> None:
    plain = run(Chain(), backend)
    result = run(replace(Chain(), bulges=True), backend, converged=5e-5)
    assert plain.excess is None
    assert result.status.name == "OPTIMAL"
    assert result.excess is not None
    np.testing.assert_allclose(result.excess, EXCESS_FACTOR * BULGE + EXCESS_GUARD)
    # `at` is without it: the rows keep away from their bounds by it
    count = Chain().nonlinear
    assert result.at.inequalities[:count].max() == pytest.approx(-result.excess[0], abs=1e-6)
    assert result.at.objective > plain.at.objective
    never = run(replace(Chain(), bulges=True), backend, excess_from=0.0)
    assert never.excess is None
    assert never.at.objective == pytest.approx(plain.at.objective, rel=1e-6)


CLOSING = SQPSettings(converged=1e-5, loosest=1e-8, chords=3, excess_from=1e-2)


@pytest.mark.parametrize("backend", ["piqp", "proxqp"])
@pytest.mark.parametrize("bulges", [False, True])
def test_chord_steps_close_a_run_at_the_same_solution(backend: str, bulges: bool) -> None:
    chain = replace(Chain(), bulges=bulges)
    plain = run(chain, backend, converged=1e-5, loosest=1e-8, excess_from=1e-2)
    closed = SQP(make_backend(backend), settings=CLOSING).minimize(chain, chain.start(0))
    assert closed.status.name == "OPTIMAL"
    assert len(closed.history) <= len(plain.history)
    assert closed.at.objective == pytest.approx(plain.at.objective, rel=2e-5)
    assert np.abs(closed.at.equalities).max() <= CLOSING.equality
    added = 0.0 if closed.excess is None else closed.excess.max()
    assert (closed.at.inequalities + added <= chain.tolerance).all()
    np.testing.assert_array_equal(closed.at.inequalities, chain.evaluate(closed.point).inequalities)


def test_a_first_step_without_a_worthwhile_gain_ends_the_run_where_it_began() -> None:
    problem = named("HS100")
    solved = solve(problem, converged=1e-9)
    settings = SQPSettings(resumed=True, worthwhile=1e-4)
    sqp = SQP(make_backend("piqp"), settings=settings)
    vain = sqp.minimize(problem, solved.point, y=solved.y, z=solved.z)
    assert vain.status.name == "NO_GAIN"
    assert not vain.status.is_feasible
    np.testing.assert_array_equal(vain.point, solved.point)
    assert len(vain.history) == 1
    far = SQP(make_backend("piqp"), settings=settings).minimize(problem, problem.x0)
    assert far.status.name == "OPTIMAL"


def test_without_relaxation_an_infeasible_QP_ends_the_run() -> None:
    chain = Chain(goal=0.8)
    sqp = SQP(make_backend("piqp"), settings=SQPSettings(relaxes=False))
    result = sqp.minimize(chain, chain.start(0))
    assert result.status.name == "STALLED"
    assert not any(record.relaxed for record in result.history)


def test_a_coarse_run_ends_early() -> None:
    """Near enough to go on with a finer program: not yet feasible, and fewer steps."""
    problem = named("HS100")
    coarse = solve(problem, converged=0.05, coarse=100.0)
    assert coarse.status.name == "COARSE"
    assert not coarse.status.is_feasible
    assert len(coarse.history) < len(solve(problem).history)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_run_repeated_has_the_same_bits(backend: str) -> None:
    found = set()
    for _ in range(3):
        result = run(Chain(), backend)
        bits = b"".join(part.tobytes() for part in (result.point, result.y, result.z))
        found.add(hashlib.sha256(bits).hexdigest())
        np.random.default_rng(0).normal(size=10_000)  # memory in between
    assert len(found) == 1
