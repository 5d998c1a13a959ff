"""Exact solution of a QP from a good guess of its active rows, by DAQP's dual active-set method."""

from __future__ import annotations

import daqp
import numpy as np
import scipy.linalg as sla

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["ActiveSetMethod"]

TOLERANCE = 1e-9  # of rows, each divided by its norm in the metric of H
DIGITS = 6  # decimals of the proximal centre: the noise of a guess is far below
# of the largest gradient: variables whose curvature may be too small for the method's digits
STEEP = 0.1
PROXIMAL = 1e-4  # the curvature that they get, per unit gradient
LARGEST_WORK = 1e9  # entries looked at by all pivots: a second or so
# the latter per unit gradient; beyond, it is no solution
PRIMAL_TOLERANCE, DUAL_TOLERANCE = 1e-7, 1e-5
NO_BOUND = 1e30  # what DAQP takes for infinity
INFEASIBLE = -1  # DAQP's exit flag: the dual has a ray
EQUALITY, ACTIVE, LOWER = 5, 1, 2  # DAQP's `sense`


class ActiveSetMethod:
    r"""Solves a QP whose active rows are nearly known; the answer's bits follow from those rows, not from digits.

    In w = L'x + L^{-1}g, with H = LL', the QP asks for the point of a polyhedron that is nearest to
    the origin, which DAQP finds by exchanging active rows (Arnstroem, Bemporad and Axehill 2022).
    Curvature of variables that the objective presses against their rows, such as the duration, is
    all but zero, and w would lose half of its digits: they get a proximal term about the guess,
    rounded.

    Attributes:
        is_ready: Whether H is positive definite; otherwise there is no solving.
        is_infeasible: Whether the last attempt ended because no point satisfies the rows.
    """

    def __init__(self, qp: QP) -> None:
        """Transform the rows of a dense QP."""
        self._qp = qp
        self.is_infeasible = False
        steepness, diagonal = np.abs(qp.g), qp.H.diagonal()
        rows = np.vstack([qp.C, qp.A])
        steep = (steepness >= STEEP * steepness.max(initial=0.0)) & (
            diagonal < PROXIMAL * steepness
        )
        self._proximal = np.where(steep & (len(rows) > 0), PROXIMAL * steepness, 0.0)
        self.is_ready = True
        if np.count_nonzero(qp.H) == np.count_nonzero(diagonal):
            diagonal = diagonal + self._proximal
            self.is_ready = bool(diagonal.min(initial=np.inf) > 0.0)
            self._root = np.sqrt(diagonal) if self.is_ready else diagonal
            self._rows = rows / self._root if self.is_ready else rows
            return
        try:
            self._root = sla.cholesky(
                qp.H + np.diag(self._proximal), lower=True, check_finite=False
            )
        except np.linalg.LinAlgError:
            self.is_ready = False
            return
        self._rows = np.ascontiguousarray(self._from_left(rows.T).T)

    def solve(self, guess: QPSolution, *, most_pivots: int) -> QPSolution | None:
        """Solution, or None where the method gives up.

        Args:
            guess: Rows whose multiplier exceeds their distance from the bound are active at first.
            most_pivots: Exchanges of active rows at most; large programs get fewer.
        """
        qp = self._qp
        if not (self.is_ready and np.isfinite(guess.x).all() and np.isfinite(guess.z).all()):
            return None
        nearest = self._from_left(qp.g - self._proximal * np.round(guess.x, DIGITS))
        if len(self._rows) == 0:
            return QPSolution(-self._from_right(nearest), qp.b, qp.u, True, 0, "daqp")
        offset = self._rows @ nearest
        upper = np.minimum(np.concatenate([qp.u, qp.b]) + offset, NO_BOUND)
        lower = np.maximum(np.concatenate([qp.l, qp.b]) + offset, -NO_BOUND)
        values = qp.C @ guess.x
        low, high = -guess.z > values - qp.l, guess.z > qp.u - values
        sense = np.full(len(upper), EQUALITY, dtype=np.int32)
        sense[: len(qp.u)] = np.where(high, ACTIVE, np.where(low, ACTIVE + LOWER, 0))
        pivots = int(min(most_pivots, LARGEST_WORK / self._rows.size))
        # reducing equalities, which it does where they are many, loses their multipliers
        w, _, flag, info = daqp.solve(
            None,
            None,
            self._rows,
            upper,
            lower,
            sense,
            primal_tol=TOLERANCE,
            dual_tol=1e-12,
            iter_limit=pivots,
            eps_prox=0.0,
            eq_reduction=-1,
        )
        if flag < 1:
            self.is_infeasible = flag == INFEASIBLE
            return None
        multipliers = np.array(info["lam"])
        y, z = multipliers[len(qp.u) :], multipliers[: len(qp.u)]
        x = self._from_right(np.asarray(w) - nearest)
        solution = QPSolution(x, y, z, True, int(info["iterations"]), "daqp")
        primal, dual = solution.residuals(qp)
        good = primal <= PRIMAL_TOLERANCE and dual <= DUAL_TOLERANCE * max(
            1.0, float(np.abs(qp.g).max(initial=0.0))
        )
        return solution if good else None

    def _from_left(self, right: Array) -> Array:
        """L^{-1} times a vector or matrix."""
        if self._root.ndim == 1:
            return np.asarray(right / self._root)
        return np.asarray(sla.solve_triangular(self._root, right, lower=True, check_finite=False))

    def _from_right(self, w: Array) -> Array:
        """L^{-T} w."""
        if self._root.ndim == 1:
            return np.asarray(w / self._root)
        return np.asarray(
            sla.solve_triangular(self._root, w, lower=True, trans="T", check_finite=False)
        )
