"""Convexification of the condensed Hessian of the Lagrangian."""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla

from zmp_sqp.arrays import Array

__all__ = ["convexified"]

RANK_TOLERANCE = 1e-10  # of the active rows' QR, relative to its first pivot


def convexified(H: Array, active_rows: Array, *, floor: float) -> Array:
    r"""Positive definite Hessian that agrees with H where the QP can still move.

    .. math:: \hat H = N \lfloor N^T H N \rfloor N^T + R \lfloor R^T H R \rfloor R^T

    N spans the null space of the active rows, R their range, and :math:`\lfloor . \rfloor` lifts
    eigenvalues below `floor` to it. Near a solution that satisfies the second-order condition, N'HN
    is positive definite and is left as it is: steps are those of the exact Hessian in N, while R is
    decided by the active rows alone, so that convergence is two-step superlinear (Nocedal & Wright
    2006, section 18.3). Clipping the Hessian's stage blocks one by one instead keeps curvature that
    cancels through the dynamics, and the SQP creeps.

    Args:
        H: Condensed Hessian, symmetric, shape (r, r).
        active_rows: Jacobian of equalities and active inequalities, shape (k, r).
        floor: Least eigenvalue, > 0.

    Returns:
        Shape (r, r).
    """
    if len(active_rows) == 0:
        return _lifted(H, floor)
    Q, triangle, _ = sla.qr(active_rows.T, mode="full", pivoting=True, check_finite=False)
    pivots = np.abs(np.diag(triangle))
    rank = int((pivots > RANK_TOLERANCE * max(pivots[0], 1e-300)).sum())
    R, N = Q[:, :rank], Q[:, rank:]
    parts = [
        basis @ _lifted(basis.T @ H @ basis, floor) @ basis.T for basis in (N, R) if basis.shape[1]
    ]
    total: Array = np.sum(parts, axis=0)
    return 0.5 * (total + total.T)


def _lifted(H: Array, floor: float) -> Array:
    H = 0.5 * (H + H.T)
    try:  # most of the time it is positive definite already, and a Cholesky factorisation is cheap
        np.linalg.cholesky(H - floor * np.eye(len(H)))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(H)
        H = (vectors * np.maximum(values, floor)) @ vectors.T
        H = 0.5 * (H + H.T)
    return H
