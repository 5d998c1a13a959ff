"""A solution proves itself by its residuals, whoever made it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from zmp_sqp.sqp.qp import QP, QPSolution

ROUNDING = 1e-14

# min (x - 3)^2 / 2 + (y - 1)^2 / 2, x + y = 2, x <= 1.5, -1 <= y: the minimiser is (1.5, 0.5).
# Stationarity: x - 3 + mu + z0 = 0 and y - 1 + mu = 0, so mu = 1/2 and z0 = 1.
PROGRAM = QP(
    H=np.eye(2),
    g=np.array([-3.0, -1.0]),
    A=np.ones((1, 2)),
    b=np.array([2.0]),
    C=np.eye(2),
    l=np.array([-np.inf, -1.0]),
    u=np.array([1.5, np.inf]),
)
SOLUTION = QPSolution(
    np.array([1.5, 0.5]), np.array([0.5]), np.array([1.0, 0.0]), True, 1, "by hand"
)


def test_the_solution_by_hand_has_no_residual() -> None:
    assert max(SOLUTION.residuals(PROGRAM)) <= ROUNDING


def test_sparse_and_dense_programs_have_the_same_residuals() -> None:
    off = replace(SOLUTION, x=np.array([1.7, 0.5]), z=np.array([1.0, -0.1]))
    sparse = replace(
        PROGRAM, H=sp.csc_matrix(PROGRAM.H), A=sp.csc_matrix(PROGRAM.A), C=sp.csc_matrix(PROGRAM.C)
    )
    assert sparse.is_sparse
    assert not PROGRAM.is_sparse
    assert off.residuals(sparse) == pytest.approx(off.residuals(PROGRAM), abs=ROUNDING)


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


def test_a_multiplier_of_the_wrong_sign_pushes_from_a_side_that_is_not_there() -> None:
    pulling = replace(SOLUTION, y=np.array([2.5]), z=np.array([-1.0, 0.0]))
    assert pulling.residuals(PROGRAM)[1] >= 1.0


@pytest.mark.parametrize("part", ["x", "y", "z"])
def test_a_solution_that_is_not_finite_proves_nothing(part: str) -> None:
    broken = replace(SOLUTION, **{part: getattr(SOLUTION, part) * np.nan})
    assert broken.residuals(PROGRAM) == (np.inf, np.inf)


@pytest.mark.parametrize("part", ["H", "g", "A", "b", "C", "l", "u"])
def test_data_that_are_not_finite_leave_nothing_to_prove(part: str) -> None:
    entries = getattr(PROGRAM, part).copy()
    entries.flat[0] = np.nan
    broken = replace(PROGRAM, **{part: entries})
    assert not broken.is_finite()
    assert np.inf in SOLUTION.residuals(broken)


def test_infinite_sides_are_finite_data_and_crossed_sides_are_not() -> None:
    assert PROGRAM.is_finite()
    assert not replace(PROGRAM, l=np.array([2.0, -1.0])).is_finite()
    assert not replace(PROGRAM, g=np.array([np.inf, 0.0])).is_finite()


def test_nothing_has_the_shapes_of_a_solution_and_infinite_residuals() -> None:
    nothing = QPSolution.nothing(PROGRAM, "none")
    assert not nothing.solved
    assert nothing.residuals(PROGRAM) == (np.inf, np.inf)


def test_a_program_without_rows_has_residuals() -> None:
    free = QP(
        np.eye(2),
        -np.ones(2),
        np.zeros((0, 2)),
        np.zeros(0),
        np.zeros((0, 2)),
        np.zeros(0),
        np.zeros(0),
    )
    assert QPSolution(np.ones(2), np.zeros(0), np.zeros(0), True, 1, "by hand").residuals(free) == (
        0.0,
        0.0,
    )
