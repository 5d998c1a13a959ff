"""A solution proves itself by its residuals, whoever made it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from zmp_sqp.sqp.qp import QP, QPSolution

ROUNDING = 1e-14

# min (x - 3)^2 / 2 + (y - 1)^2 / 2, x + y = 2, x <= 1.5, -y <= 1: the minimiser is (1.5, 0.5).
# Stationarity: x - 3 + mu + z0 = 0 and y - 1 + mu = 0, so mu = 1/2 and z0 = 1.
PROGRAM = QP(
    H=sp.csc_matrix(np.eye(2)),
    g=np.array([-3.0, -1.0]),
    A=sp.csc_matrix(np.ones((1, 2))),
    b=np.array([2.0]),
    C=sp.csc_matrix(np.diag([1.0, -1.0])),
    u=np.array([1.5, 1.0]),
)
SOLUTION = QPSolution(
    np.array([1.5, 0.5]), np.array([0.5]), np.array([1.0, 0.0]), True, 1, "by hand"
)


def test_the_solution_by_hand_has_no_residual() -> None:
    assert max(SOLUTION.residuals(PROGRAM)) <= ROUNDING


def test_only_the_upper_triangle_of_the_hessian_is_given() -> None:
    full = np.array([[2.0, 0.5], [0.5, 1.0]])
    qp = replace(PROGRAM, H=sp.csc_matrix(np.triu(full)))
    H, A, C = qp.dense()
    np.testing.assert_array_equal(H, full)
    np.testing.assert_array_equal(A, PROGRAM.A.toarray())
    np.testing.assert_array_equal(C, PROGRAM.C.toarray())
    # at (1.5, 0.5) the gradient is (0.25, 0.25): mu = -0.25
    solution = replace(SOLUTION, y=np.array([-0.25]), z=np.zeros(2))
    assert max(solution.residuals(qp)) <= ROUNDING


def test_without_equalities_there_is_an_empty_matrix_of_them() -> None:
    assert replace(PROGRAM, A=None, b=np.zeros(0)).dense()[1].shape == (0, 2)


@pytest.mark.parametrize(
    ("x", "violation"),
    [((1.6, 0.5), 0.1), ((1.6, 0.4), 0.1), ((3.2, -1.2), 1.7), ((1.5, 0.75), 0.25)],
)
def test_the_primal_residual_is_the_largest_violation(
    x: tuple[float, float], violation: float
) -> None:
    primal, _ = replace(SOLUTION, x=np.array(x)).residuals(PROGRAM)
    assert primal == pytest.approx(violation)


def test_a_wrong_multiplier_shows_in_the_dual_residual() -> None:
    for y, z in ((0.4, (1.0, 0.0)), (0.5, (0.9, 0.0)), (0.5, (1.0, 0.1))):
        primal, dual = replace(SOLUTION, y=np.array([y]), z=np.array(z)).residuals(PROGRAM)
        assert primal <= ROUNDING
        assert dual == pytest.approx(0.1)


def test_a_multiplier_on_a_row_that_is_not_active_shows_as_complementarity() -> None:
    """x = 1.25 is stationary and feasible, but the row with a multiplier is 0.25 away."""
    inside = QPSolution(
        np.array([1.25, 0.75]), np.array([0.25]), np.array([1.5, 0.0]), True, 1, "by hand"
    )
    primal, dual = inside.residuals(PROGRAM)
    assert primal <= ROUNDING
    assert dual == pytest.approx(0.25)


def test_a_multiplier_of_the_wrong_sign_shows() -> None:
    pulling = replace(SOLUTION, y=np.array([2.5]), z=np.array([-1.0, 0.0]))
    assert pulling.residuals(PROGRAM)[1] >= 1.0


@pytest.mark.parametrize("part", ["x", "y", "z"])
def test_a_solution_that_is_not_finite_proves_nothing(part: str) -> None:
    broken = replace(SOLUTION, **{part: getattr(SOLUTION, part) * np.nan})
    assert not broken.is_finite()
    assert broken.residuals(PROGRAM) == (np.inf, np.inf)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("part", ["H", "g", "A", "b", "C", "u"])
def test_data_that_are_not_finite_are_seen(part: str, bad: float) -> None:
    assert PROGRAM.is_finite()
    assert not replace(PROGRAM, **{part: getattr(PROGRAM, part) * bad}).is_finite()


def test_nothing_has_the_shapes_of_a_solution_and_infinite_residuals() -> None:
    nothing = QPSolution.nothing(PROGRAM, "none")
    assert not nothing.solved
    assert (nothing.x.shape, nothing.y.shape, nothing.z.shape) == ((2,), (1,), (2,))
    assert nothing.residuals(PROGRAM) == (np.inf, np.inf)


def test_a_relaxed_program_violates_the_chosen_rows_by_its_last_variable() -> None:
    """x <= 1.5 may give: at price 0.25 it gives by t = 3/8, where its multiplier is the price."""
    relaxed = PROGRAM.relaxed(np.array([True, False]), price=0.25)
    # x - 3 + mu + 1/4 = 0, 2 - x - 1 + mu = 0: x = 15/8, mu = 7/8, t = 3/8
    solution = QPSolution(
        np.array([1.875, 0.125, 0.375]), np.array([0.875]), np.array([0.25, 0.0, 0.0]), True, 1, ""
    )
    primal, dual = solution.residuals(relaxed)
    assert primal <= ROUNDING
    assert dual <= 1e-8  # the slack's own small curvature
    too_much = replace(solution, x=np.array([1.875, 0.125, 0.3]))
    assert too_much.residuals(relaxed)[0] == pytest.approx(0.075)
    negative = replace(solution, x=np.array([1.5, 0.5, -0.1]))
    assert negative.residuals(relaxed)[0] == pytest.approx(0.1)
