"""Textbook programs: the published optimum, by every kind of backend."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from tests.sqp.problems import HOCK_SCHITTKOWSKI, Textbook
from zmp_sqp.sqp.backends import make_backend
from zmp_sqp.sqp.solver import SQP, SQPSettings

# Settings stop at a predicted decrease of 2e-7 and a violation of 2e-7; HS76 and HS100 have
# multipliers of order one.
OBJECTIVE_TOLERANCE = 1e-6  # relative, of max(1, |f*|)
# the book's codes need 10 to 60; HS26 is flat to fourth order and converges linearly
MOST_ITERATIONS = 25

BACKENDS = ("proxqp", "piqp", "qpsolvers:clarabel", "qpsolvers:daqp")


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("problem", HOCK_SCHITTKOWSKI, ids=lambda problem: problem.name)
def test_the_published_optimum_is_found(problem: Textbook, backend: str) -> None:
    result = SQP(make_backend(backend)).minimize(problem, problem.x0)
    assert result.status.name == "OPTIMAL"
    assert result.at.violation <= SQPSettings().feasibility
    assert result.at.objective == pytest.approx(
        problem.optimum, rel=OBJECTIVE_TOLERANCE, abs=OBJECTIVE_TOLERANCE
    )
    assert len(result.history) <= MOST_ITERATIONS


@pytest.mark.parametrize("problem", HOCK_SCHITTKOWSKI, ids=lambda problem: problem.name)
def test_the_multipliers_satisfy_the_first_order_conditions(problem: Textbook) -> None:
    result = SQP(make_backend("proxqp")).minimize(problem, problem.x0)
    lin = problem.linearize(result.x)
    lagrangian = lin.gradient + lin.A.T @ result.y + lin.C.T @ result.z
    # Where the run stops for want of predicted decrease, a gradient of the root of that decrease
    # may be left.
    assert np.abs(lagrangian).max() <= 2e-3 * max(1.0, float(np.abs(lin.gradient).max()))
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
        # HS104 crawls for 140 to where its violation is stationary
        settings = SQPSettings(max_iterations=300)
        result = SQP(make_backend("proxqp"), make_backend("piqp"), settings).minimize(
            problem, start
        )
        if result.status.name == "INFEASIBLE":
            assert decrease_of_violation(problem, result.x, radius=0.01) <= 1e-3 * 0.01
        else:
            assert result.status.is_feasible, result.status
            assert result.at.violation <= SQPSettings().feasibility


def decrease_of_violation(problem: Textbook, x: np.ndarray, *, radius: float) -> float:
    """How far a step in the box can lower the largest linearised inequality, by an LP."""
    lin = problem.linearize(x)
    relaxed = -problem.nonlinear_rows.astype(float)[:, None]
    found = linprog(
        np.r_[np.zeros(len(x)), 1.0],
        A_ub=np.hstack([lin.C.toarray(), relaxed]),
        b_ub=-lin.at.inequalities,
        bounds=[(-radius, radius)] * len(x) + [(0.0, None)],
    )
    return lin.at.violation - float(found.fun)
