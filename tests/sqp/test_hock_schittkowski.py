"""Textbook programs: the published optimum, by every kind of backend."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from tests.sqp.problems import HOCK_SCHITTKOWSKI, TOLERANCE, Textbook
from zmp_sqp.sqp.backends import make_backend
from zmp_sqp.sqp.solver import SQP, SQPSettings

# These programs' objectives are no squared durations: run to the end, not to a practical stop.
TO_THE_END = SQPSettings(converged=1e-9)
OBJECTIVE_TOLERANCE = 1e-6  # relative, of max(1, |f*|): the predicted decrease that ends a run
# the book's codes need 10 to 60; HS26 is flat to fourth order and converges linearly
MOST_ITERATIONS = 25

BACKENDS = ("auto", "proxqp", "piqp", "qpsolvers:clarabel", "qpsolvers:daqp")


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("problem", HOCK_SCHITTKOWSKI, ids=lambda problem: problem.name)
def test_the_published_optimum_is_found(problem: Textbook, backend: str) -> None:
    result = SQP(make_backend(backend), settings=TO_THE_END).minimize(problem, problem.x0)
    assert result.status.name == "OPTIMAL"
    assert result.at.violation <= TOLERANCE
    assert result.at.objective == pytest.approx(
        problem.optimum, rel=OBJECTIVE_TOLERANCE, abs=OBJECTIVE_TOLERANCE
    )
    assert len(result.history) <= MOST_ITERATIONS


@pytest.mark.parametrize("problem", HOCK_SCHITTKOWSKI, ids=lambda problem: problem.name)
def test_the_practical_stop_costs_a_ten_thousandth_at_most(problem: Textbook) -> None:
    result = SQP(make_backend("piqp")).minimize(problem, problem.x0)
    assert result.status.name == "OPTIMAL"
    assert result.at.objective == pytest.approx(problem.optimum, rel=2e-4, abs=2e-4)


@pytest.mark.parametrize("backend", ["proxqp", "piqp"])
@pytest.mark.parametrize("problem", HOCK_SCHITTKOWSKI, ids=lambda problem: problem.name)
def test_the_multipliers_satisfy_the_first_order_conditions(
    problem: Textbook, backend: str
) -> None:
    result = SQP(make_backend(backend), settings=TO_THE_END).minimize(problem, problem.x0)
    lin = problem.linearize(result.point)
    lagrangian = lin.gradient + lin.C.matrix.T @ result.z
    if lin.A is not None:
        lagrangian = lagrangian + lin.A.T @ result.y
    # Where the run stops for want of predicted decrease, a gradient of the root of that decrease
    # may be left.
    assert np.abs(lagrangian).max() <= 5e-3 * max(1.0, float(np.abs(lin.gradient).max()))
    assert result.z.min(initial=0.0) >= 0.0
    assert np.abs(result.z * lin.at.inequalities).max(initial=0.0) <= 1e-4


@pytest.mark.parametrize("problem", HOCK_SCHITTKOWSKI, ids=lambda problem: problem.name)
def test_a_far_start_ends_at_a_feasible_point_or_where_the_violation_is_stationary(
    problem: Textbook,
) -> None:
    rng = np.random.default_rng(6)
    for _ in range(3):
        start = np.clip(
            problem.x0 + rng.uniform(-2.0, 2.0, len(problem.x0)), problem.lower, problem.upper
        )
        settings = SQPSettings(max_iterations=300)
        result = SQP(make_backend("piqp"), settings=settings).minimize(problem, start)
        if result.status.name == "INFEASIBLE":
            assert decrease_of_violation(problem, result.point, radius=0.01) <= 1e-3 * 0.01
        else:
            assert result.status.is_feasible, result.status
            assert result.at.violation <= TOLERANCE


def decrease_of_violation(problem: Textbook, x: np.ndarray, *, radius: float) -> float:
    """How far a step in the box can lower the largest linearised inequality, by an LP."""
    lin = problem.linearize(x)
    relaxed = -(np.arange(problem.inequalities) < problem.nonlinear).astype(float)[:, None]
    found = linprog(
        np.r_[np.zeros(len(x)), 1.0],
        A_ub=np.hstack([lin.C.matrix.toarray(), relaxed]),
        b_ub=-lin.at.inequalities,
        bounds=[(-radius, radius)] * len(x) + [(0.0, None)],
    )
    return lin.at.violation - float(found.fun)
