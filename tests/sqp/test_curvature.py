"""Convexification leaves alone what the active rows leave free."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as sla
from hypothesis import given, settings
from hypothesis import strategies as st

from zmp_sqp.sqp.curvature import convexified

FLOOR = 1e-3
ROUNDING = 1e-9  # products of matrices of order ten, with entries of order one


@st.composite
def cases(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """A symmetric matrix, in general indefinite, and rows, in general dependent."""
    n = draw(st.integers(1, 8))
    k = draw(st.integers(0, n + 2))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    H = rng.standard_normal((n, n))
    rank = draw(st.integers(0, min(n, k)))
    return H + H.T, rng.standard_normal((k, rank)) @ rng.standard_normal((rank, n))


@given(cases())
@settings(max_examples=200, deadline=None)
def test_the_result_is_symmetric_with_eigenvalues_above_the_floor(
    case: tuple[np.ndarray, np.ndarray],
) -> None:
    H, rows = case
    convex = convexified(H, rows, floor=FLOOR)
    assert np.array_equal(convex, convex.T)
    assert np.linalg.eigvalsh(convex).min() >= FLOOR - ROUNDING


@given(cases())
@settings(max_examples=200, deadline=None)
def test_it_agrees_with_the_hessian_where_rows_leave_freedom_and_it_is_convex_there(
    case: tuple[np.ndarray, np.ndarray],
) -> None:
    H, rows = case
    N = sla.null_space(rows) if len(rows) else np.eye(len(H))
    if N.shape[1] == 0:
        return
    least = np.linalg.eigvalsh(N.T @ H @ N).min()
    # now positive definite on the null space, and only made so there
    H = H + max(0.0, 2.0 * FLOOR - least) * N @ N.T
    reduced = N.T @ convexified(H, rows, floor=FLOOR) @ N
    assert np.abs(reduced - N.T @ H @ N).max() <= ROUNDING * max(1.0, float(np.abs(H).max()))


def test_a_positive_definite_matrix_without_rows_is_left_as_it_is() -> None:
    H = np.array([[2.0, 0.5], [0.5, 1.0]])
    assert np.array_equal(convexified(H, np.zeros((0, 2)), floor=1e-8), H)


def test_negative_curvature_across_the_active_row_is_lifted_and_along_it_kept() -> None:
    H = np.diag([-5.0, 3.0])
    along_y = np.array([[1.0, 0.0]])  # the row holds x
    assert np.diag(convexified(H, along_y, floor=FLOOR)) == pytest.approx([FLOOR, 3.0])


def test_rows_that_are_all_zero_restrict_nothing() -> None:
    H = np.diag([1.0, 2.0])
    assert np.allclose(convexified(H, np.zeros((3, 2)), floor=FLOOR), H)
