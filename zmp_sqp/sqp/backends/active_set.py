"""Exact solution of a QP from a guess of its active rows, by DAQP's dual active-set method."""

from __future__ import annotations

from dataclasses import replace

import daqp
import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array
from zmp_sqp.blas import scipy_linalg
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["ActiveSetMethod"]

Mask = npt.NDArray[np.bool_]

TOLERANCE = 1e-9  # primal tolerance of DAQP, for rows divided by their norm in the metric of H
DUAL_TOLERANCE_OF_DAQP = 1e-12
CENTRES = 4  # proximal iterations at most: each solution is the centre of the next proximal term
DIGITS = 6  # decimals to which the centre is rounded, so that noise of the guess has no effect
# variables whose gradient is above this share of the largest, and whose curvature is below PROXIMAL
# times the gradient, get that curvature as a proximal term
STEEP = 0.1
PROXIMAL = 1e-4
# curvature added to all variables where H is only semi-definite, relative to the largest diagonal
# entry of H, which counts as at least the second value
SHIFT, LEAST_CURVATURE = 1e-10, 1e-8
LARGEST_WORK = 4e9  # matrix entries that all pivots may touch: some seconds
# residuals up to which an answer counts as a solution; the dual one per unit of the gradient
PRIMAL_TOLERANCE, DUAL_TOLERANCE = 1e-7, 1e-5
NO_BOUND = 1e30  # infinity of DAQP
INFEASIBLE = -1  # exit flag of DAQP: the dual is unbounded
EQUALITY, ACTIVE = 5, 1  # values of DAQP's `sense` of a row


class ActiveSetMethod:
    r"""Active-set method for a QP whose active rows are nearly known.

    With H = LL' and w = L'x + L^{-1}g the QP becomes a least-distance problem: find the point of a
    polyhedron nearest to the origin. DAQP solves it by exchanging active rows (Arnstroem, Bemporad
    and Axehill 2022). The result depends on the initial active rows, but not on the last digits of
    the guess, and is therefore reproducible bit by bit.

    Three terms are added to H, which has to be well conditioned:

    * A proximal term about the rounded guess in variables with a large gradient and almost no
      curvature, such as the duration: without it w would lose half of its digits.
    * The Hessian of |A x - b|^2 / 2, which changes neither solution nor multipliers. It gives
      curvature to variables that only equalities determine, such as a driving base's positions.
    * A small proximal term in all variables if H is only semi-definite.

    Whether the result solves the QP is decided by the residuals of the original QP.

    Attributes:
        is_ready: Whether H is positive semi-definite and all data are finite; otherwise the QP
            cannot be solved.
        is_infeasible: Whether DAQP found the QP of the last attempt infeasible.
    """

    def __init__(self, qp: QP) -> None:
        """Factorise the Hessian and transform the rows of a QP, as dense matrices.

        Args:
            qp: Quadratic program.
        """
        H, A, C = qp.dense()
        self.qp, self._A = qp, A
        self.is_ready = self.is_infeasible = False
        if not qp.is_finite():
            return
        steepness, diagonal = np.abs(qp.g), H.diagonal()
        has_rows = len(A) + len(C) > 0
        steep = (steepness >= STEEP * steepness.max(initial=0.0)) & (
            diagonal < PROXIMAL * steepness
        )
        self._proximal = np.where(steep & has_rows, PROXIMAL * steepness, 0.0)
        curvature, cholesky = H + A.T @ A, scipy_linalg().cholesky
        largest = max(float(np.abs(diagonal).max(initial=0.0)), LEAST_CURVATURE)
        for shift in (0.0, SHIFT * largest):
            proximal = self._proximal + shift
            try:
                factor = cholesky(curvature + np.diag(proximal), lower=True, check_finite=False)
            except np.linalg.LinAlgError:
                continue
            self.is_ready, self._proximal, self._cholesky = True, proximal, factor
            self._rows = np.ascontiguousarray(self._from_left(np.vstack([C, A]).T).T)
            return

    def solve(self, x: Array, active: Mask, *, most_pivots: int) -> QPSolution | None:
        """Solution of the QP; None where the method fails.

        Args:
            x: Guess of the solution, shape (n,).
            active: Mask of the inequalities that are active initially, shape (m,).
            most_pivots: Largest number of exchanges of active rows; fewer for large QPs.
        """
        return self.solve_with(self.qp.u, self.qp.b, x, active, most_pivots=most_pivots)

    def solve_with(
        self, u: Array, b: Array, x: Array, active: Mask, *, most_pivots: int
    ) -> QPSolution | None:
        """Solution with other right-hand sides; None where the method fails.

        Args:
            u, b: Right-hand sides of inequalities and equalities, shape (m,) and (p,).
            x, active, most_pivots: Arguments of `solve`.
        """
        if not (self.is_ready and np.isfinite(x.sum())):
            return None
        qp = QP(self.qp.H, self.qp.g, self.qp.A, b, self.qp.C, u)
        steepest, pivots = max(1.0, float(np.abs(qp.g).max(initial=0.0))), 0
        for _ in range(CENTRES):
            found = self._solve_about(qp, np.round(x, DIGITS), active, most_pivots)
            if found is None:
                return None
            pivots += found.iterations
            primal, dual = found.residuals(qp)
            if primal > PRIMAL_TOLERANCE:
                return None
            if dual <= DUAL_TOLERANCE * steepest:
                return replace(found, iterations=pivots)
            x, active = found.x, found.z > 0.0  # the proximal term acted: move its centre
        return None

    def _solve_about(
        self, qp: QP, centre: Array, active: Mask, most_pivots: int
    ) -> QPSolution | None:
        """Solution of the QP with the proximal term about a centre; None where DAQP fails."""
        u, b = qp.u, qp.b
        nearest = self._from_left(qp.g - self._A.T @ b - self._proximal * centre)
        if len(self._rows) == 0:
            return QPSolution(-self._from_right(nearest), b, u, True, 0, "daqp")
        upper = np.minimum(np.concatenate([u, b]) + self._rows @ nearest, NO_BOUND)
        lower = np.concatenate([np.full(len(u), -NO_BOUND), upper[len(u) :]])
        sense = np.full(len(upper), EQUALITY, dtype=np.int32)
        sense[: len(u)] = np.where(active, ACTIVE, 0)
        # DAQP's reduction of equalities is off: it would lose their multipliers
        w, _, flag, info = daqp.solve(
            None,
            None,
            self._rows,
            upper,
            lower,
            sense,
            primal_tol=TOLERANCE,
            dual_tol=DUAL_TOLERANCE_OF_DAQP,
            iter_limit=int(min(most_pivots, LARGEST_WORK / self._rows.size)),
            eps_prox=0.0,
            eq_reduction=-1,
        )
        self.is_infeasible = flag == INFEASIBLE
        if flag < 1:
            return None
        multipliers = np.array(info["lam"])
        y, z = multipliers[len(u) :], np.maximum(multipliers[: len(u)], 0.0)
        found = self._from_right(np.asarray(w) - nearest)
        return QPSolution(found, y, z, True, int(info["iterations"]), "daqp")

    def _from_left(self, right: Array) -> Array:
        """L^{-1} times a vector or a matrix."""
        solve = scipy_linalg().solve_triangular
        return np.asarray(solve(self._cholesky, right, lower=True, check_finite=False))

    def _from_right(self, w: Array) -> Array:
        """L^{-T} w."""
        solve = scipy_linalg().solve_triangular
        return np.asarray(solve(self._cholesky, w, lower=True, trans="T", check_finite=False))
