"""Limits, history and progress reports."""

from __future__ import annotations

import time

import numpy as np
import pytest

from tests.sqp.problems import HOCK_SCHITTKOWSKI, named
from zmp_sqp.sqp.backends import make_backend
from zmp_sqp.sqp.progress import CREEP_WINDOW, creeps, next_damping
from zmp_sqp.sqp.result import IterationRecord
from zmp_sqp.sqp.solver import SQP, SQPSettings


def test_the_iteration_limit_is_kept_and_reported() -> None:
    problem = named("HS104")
    result = SQP(make_backend("proxqp"), settings=SQPSettings(max_iterations=2)).minimize(
        problem, problem.x0
    )
    assert result.status.name == "ITERATION_LIMIT"
    assert len(result.history) == 2
    assert not result.status.is_feasible


def test_a_limit_that_strikes_at_a_feasible_point_yields_that_point() -> None:
    problem = named("HS43")  # feasible at its start
    result = SQP(make_backend("proxqp"), settings=SQPSettings(max_iterations=1)).minimize(
        problem, problem.x0
    )
    assert result.status.name == "FEASIBLE"
    assert result.at.violation <= SQPSettings().feasibility
    assert result.at.violation == problem.evaluate(result.x).violation


def test_no_iteration_starts_after_the_deadline() -> None:
    problem = named("HS104")
    settings = SQPSettings(deadline=time.perf_counter() - 1.0)
    result = SQP(make_backend("proxqp"), settings=settings).minimize(problem, problem.x0)
    assert result.status.name == "TIME_LIMIT"
    assert result.history == ()


def test_every_iteration_is_reported_as_it_stands_in_the_history() -> None:
    seen: list[IterationRecord] = []
    problem = named("HS71")
    result = SQP(make_backend("proxqp"), report=seen.append).minimize(problem, problem.x0)
    assert tuple(seen) == result.history
    assert [record.iteration for record in seen] == list(range(1, len(seen) + 1))


@pytest.mark.parametrize("backend", ["proxqp", "piqp", "qpsolvers:daqp"])
def test_the_history_tells_what_happened(backend: str) -> None:
    problem = named("HS71")
    result = SQP(make_backend(backend)).minimize(problem, problem.x0)
    last = result.history[-1]
    # takes it on from the active rows of the last QP
    finishers = {"daqp"} if backend == "proxqp" else set()
    assert {record.backend for record in result.history} - finishers == {backend}
    assert last.objective == result.at.objective
    assert last.violation == result.at.violation
    assert all(0.0 < record.step <= 1.0 for record in result.history)
    assert all(1 <= record.rows <= len(result.z) for record in result.history)
    times = [record.time for record in result.history]
    assert times == sorted(times)
    assert times[0] > 0.0
    if backend != "qpsolvers:daqp":  # which does not tell
        assert all(record.inner_iterations > 0 for record in result.history)


def test_curvature_is_left_out_until_multipliers_make_it_count() -> None:
    result = SQP(make_backend("proxqp")).minimize(named("HS43"), named("HS43").x0)
    assert not result.history[0].curvature
    assert all(record.curvature for record in result.history[1:])
    linear = SQP(make_backend("proxqp")).minimize(named("HS76"), named("HS76").x0)
    assert not any(record.curvature for record in linear.history)


def test_a_run_that_starts_at_its_solution_ends_after_one_qp() -> None:
    for problem in HOCK_SCHITTKOWSKI:
        if problem.name == "HS26":  # flat to fourth order: its solution is only known to 1e-2
            continue
        solved = SQP(make_backend("proxqp")).minimize(problem, problem.x0)
        again = SQP(make_backend("proxqp")).minimize(problem, solved.x)
        assert len(again.history) <= 2
        assert again.at.objective == pytest.approx(solved.at.objective, rel=1e-6, abs=1e-6)


def record(iteration: int, objective: float, violation: float = 0.0) -> IterationRecord:
    return IterationRecord(
        iteration, "none", 1, 1, False, False, False, objective, violation, 1.0, 0.0
    )


def test_a_run_creeps_only_if_feasible_and_all_but_still_for_a_whole_window() -> None:
    still = [record(k, 5.0 - 1e-8 * k) for k in range(CREEP_WINDOW)]
    assert creeps(still, 2e-7)
    assert not creeps(still[1:], 2e-7)
    assert not creeps([*still[1:], record(99, 4.0)], 2e-7)
    assert not creeps([*still[1:], record(99, 5.0, violation=1e-3)], 2e-7)
    assert not creeps([], 2e-7)


def test_damping_comes_with_short_steps_and_fades_with_full_ones() -> None:
    damping = 0.0
    for _ in range(3):
        damping = next_damping(damping, 0.1)
    assert damping == pytest.approx(0.1)
    assert next_damping(damping, 0.5) == damping
    for _ in range(20):
        damping = next_damping(damping, 1.0)
    assert damping == 0.0
    assert np.isfinite(next_damping(1.0, 0.01))
