"""Exact solution of a QP from a good guess of its active rows, by DAQP's dual active-set method."""

from __future__ import annotations

from dataclasses import replace

import daqp
import numpy as np
import numpy.typing as npt
import scipy.linalg as sla

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["ActiveSetMethod"]

Mask = npt.NDArray[np.bool_]

TOLERANCE = 1e-9  # of rows, each divided by its norm in the metric of H
DUAL_TOLERANCE_OF_DAQP = 1e-12
CENTRES = 4  # of the proximal term, the solution about one being the next one
DIGITS = 6  # decimals of the proximal centre: the noise of a guess is far below
# of the largest gradient: variables whose curvature may be too small for the method's digits
STEEP = 0.1
PROXIMAL = 1e-4  # the curvature that they get, per unit gradient
# curvature that a semi-definite Hessian gets in all variables, per largest one
SHIFT, LEAST_CURVATURE = 1e-10, 1e-8
LARGEST_WORK = 4e9  # entries looked at by all pivots: some seconds
# the latter per unit gradient; beyond, it is no solution
PRIMAL_TOLERANCE, DUAL_TOLERANCE = 1e-7, 1e-5
NO_BOUND = 1e30  # what DAQP takes for infinity
INFEASIBLE = -1  # DAQP's exit flag: the dual has a ray
EQUALITY, ACTIVE = 5, 1  # DAQP's `sense`


class ActiveSetMethod:
    r"""Solves a QP whose active rows are nearly known.

    In w = L'x + L^{-1}g, with H = LL', the QP asks for the point of a polyhedron that is nearest to
    the origin, which DAQP finds by exchanging active rows (Arnstroem, Bemporad and Axehill 2022).
    The answer's bits follow from the rows that it starts with, not from the digits of a guess.

    Curvature of variables that the objective presses against their rows, such as the duration, is
    all but zero, and w would lose half of its digits: they get a proximal term about the guess,
    rounded. The square of the equalities, |A x - b|^2 / 2, is added to the objective: it changes
    neither solution nor multipliers, and gives curvature to variables that only equalities
    determine, such as a driving base's positions.

    A Hessian that is only semi-definite gets such a term in all variables. What that leaves is
    measured by the residuals of the program itself, which decide.

    Attributes:
        is_ready: Whether H is positive semi-definite; otherwise there is no solving.
        is_infeasible: Whether the last attempt ended because no point satisfies the rows.
    """

    def __init__(self, qp: QP) -> None:
        """Factorise the Hessian and transform the rows of a QP, as dense matrices."""
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
        curvature = H + A.T @ A
        largest = max(float(np.abs(diagonal).max(initial=0.0)), LEAST_CURVATURE)
        for shift in (0.0, SHIFT * largest):
            proximal = self._proximal + shift
            try:
                root = sla.cholesky(curvature + np.diag(proximal), lower=True, check_finite=False)
            except np.linalg.LinAlgError:
                continue
            self.is_ready, self._proximal, self._root = True, proximal, root
            self._rows = np.ascontiguousarray(self._from_left(np.vstack([C, A]).T).T)
            return

    def solve(self, x: Array, active: Mask, *, most_pivots: int) -> QPSolution | None:
        """Solution, or None where the method gives up.

        Args:
            x: About where the solution is, shape (n,).
            active: Inequalities that hold with equality at first, shape (m,).
            most_pivots: Exchanges of active rows at most; large programs get fewer.
        """
        return self.solve_with(self.qp.u, self.qp.b, x, active, most_pivots=most_pivots)

    def solve_with(
        self, u: Array, b: Array, x: Array, active: Mask, *, most_pivots: int
    ) -> QPSolution | None:
        """Solution with other right-hand sides, or None; other arguments as in `solve`."""
        if not (self.is_ready and np.isfinite(x.sum())):
            return None
        qp = QP(self.qp.H, self.qp.g, self.qp.A, b, self.qp.C, u)
        steepest, pivots = max(1.0, float(np.abs(qp.g).max(initial=0.0))), 0
        for _ in range(CENTRES):
            found = self._about(qp, np.round(x, DIGITS), active, most_pivots)
            if found is None:
                return None
            pivots += found.iterations
            primal, dual = found.residuals(qp)
            if primal > PRIMAL_TOLERANCE:
                return None
            if dual <= DUAL_TOLERANCE * steepest:
                return replace(found, iterations=pivots)
            x, active = found.x, found.z > 0.0  # the proximal term's centre was too far away
        return None

    def _about(self, qp: QP, centre: Array, active: Mask, most_pivots: int) -> QPSolution | None:
        """Solution of the program with the proximal term about a centre, or None."""
        u, b = qp.u, qp.b
        nearest = self._from_left(qp.g - self._A.T @ b - self._proximal * centre)
        if len(self._rows) == 0:
            return QPSolution(-self._from_right(nearest), b, u, True, 0, "daqp")
        upper = np.minimum(np.concatenate([u, b]) + self._rows @ nearest, NO_BOUND)
        lower = np.concatenate([np.full(len(u), -NO_BOUND), upper[len(u) :]])
        sense = np.full(len(upper), EQUALITY, dtype=np.int32)
        sense[: len(u)] = np.where(active, ACTIVE, 0)
        # reducing equalities, which it does where they are many, loses their multipliers
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
        """L^{-1} times a vector or matrix."""
        return np.asarray(sla.solve_triangular(self._root, right, lower=True, check_finite=False))

    def _from_right(self, w: Array) -> Array:
        """L^{-T} w."""
        return np.asarray(
            sla.solve_triangular(self._root, w, lower=True, trans="T", check_finite=False)
        )
