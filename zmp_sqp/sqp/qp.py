"""Quadratic program, its solution, and the KKT residuals that verify the solution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array

__all__ = ["NOTHING_YET", "QP", "QPSolution"]

Mask = npt.NDArray[np.bool_]

NOTHING_YET = "{name}: solve_again() before any solve(): there is no QP to solve again"


@dataclass(frozen=True, slots=True, eq=False)
class QP:
    r"""Convex quadratic program with sparse matrices.

    .. math:: \min_x \tfrac12 x^T H x + g^T x \quad \text{s.t.} \quad A x = b, \; C x \le u

    Attributes:
        H: Upper triangle of the Hessian, CSC, shape (n, n).
        g: Gradient at x = 0, shape (n,).
        A: Matrix of the equalities, CSC, shape (p, n); None without equalities.
        b: Right-hand side of the equalities, shape (p,).
        C: Matrix of the inequalities, CSC, shape (m, n).
        u: Upper bounds of the inequalities, shape (m,).
    """

    H: Any
    g: Array
    A: Any
    b: Array
    C: Any
    u: Array

    @property
    def size(self) -> int:
        """Number n of variables."""
        return len(self.g)

    def is_finite(self) -> bool:
        """Whether all data are finite.

        To be checked before a solver is called: some do not check, and run to their iteration
        limits or crash.
        """
        parts = [self.H.data, self.C.data, self.g, self.b, self.u]
        if self.A is not None:
            parts.append(self.A.data)
        # a sum is finite only if all terms are, and testing it is faster than testing each
        with np.errstate(invalid="ignore"):
            return all(bool(np.isfinite(part.sum())) for part in parts)

    def dense(self) -> tuple[Array, Array, Array]:
        """Full symmetric H, A and C as dense arrays."""
        upper = self.H.toarray()
        H = upper + upper.T - np.diag(np.diag(upper))
        A = np.zeros((0, self.size)) if self.A is None else self.A.toarray()
        return H, np.ascontiguousarray(A), np.ascontiguousarray(self.C.toarray())

    def relaxed(self, nonlinear: Mask, price: float) -> QP:
        r"""Elastic form: nonlinear rows become C x - t <= u with a slack t >= 0 that costs a price.

        Args:
            nonlinear: Mask of the rows that are relaxed, shape (m,).
            price: Cost per unit of t, added to the objective.

        Returns:
            QP in (x, t), whose last inequality is -t <= 0.
        """
        import scipy.sparse as sp  # slow to import, and not needed by every plan

        H = sp.block_diag([self.H, sp.csc_matrix([[SLACK_CURVATURE]])], format="csc")
        A = self.A
        if A is not None:
            A = sp.hstack([A, sp.csc_matrix((A.shape[0], 1))], format="csc")
        column = sp.csc_matrix(-nonlinear.astype(float)[:, None])
        last = sp.csc_matrix(([-1.0], ([0], [self.size])), shape=(1, self.size + 1))
        C = sp.vstack([sp.hstack([self.C, column]), last], format="csc")
        return QP(H, np.append(self.g, price), A, self.b, C, np.append(self.u, 0.0))


SLACK_CURVATURE = 1e-8  # of the slack t: keeps the relaxed Hessian positive definite


@dataclass(frozen=True, slots=True, eq=False)
class QPSolution:
    """Answer of a backend to a QP; `residuals` verify it.

    Attributes:
        x: Minimiser, shape (n,).
        y: Multipliers of A x = b, shape (p,).
        z: Multipliers of C x <= u, not negative, shape (m,).
        solved: Whether the backend reports convergence.
        iterations: Iterations of the backend.
        backend: Name of the backend.
    """

    x: Array
    y: Array
    z: Array
    solved: bool
    iterations: int
    backend: str

    @classmethod
    def nothing(cls, qp: QP, backend: str, iterations: int = 0) -> QPSolution:
        """Answer of a backend without a solution: all values NaN, not solved."""
        x, y, z = (np.full(count, np.nan) for count in (qp.size, len(qp.b), len(qp.u)))
        return cls(x, y, z, False, iterations, backend)

    @classmethod
    def of_no_variables(cls, qp: QP, backend: str, tolerance: float) -> QPSolution:
        """Solution of a QP without variables, which some solvers crash on."""
        missed = max(float(np.abs(qp.b).max(initial=0.0)), float((-qp.u).max(initial=0.0)))
        nothing, y, z = np.zeros(0), np.zeros(len(qp.b)), np.zeros(len(qp.u))
        return cls(nothing, y, z, missed <= tolerance, 0, backend)

    def is_finite(self) -> bool:
        """Whether x, y and z are finite."""
        with np.errstate(invalid="ignore"):
            return bool(np.isfinite(self.x.sum() + self.y.sum() + self.z.sum()))

    def residuals(self, qp: QP) -> tuple[float, float]:
        r"""Primal and dual residuals of the KKT conditions, computed from the QP's own data.

        .. math::
            r_p = \max(\|A x - b\|_\infty, \|(C x - u)^+\|_\infty), \quad
            r_d = \max(\|H x + g + A^T y + C^T z\|_\infty,
                       \text{largest } \min(|z_i|, |u_i - (C x)_i|))

        Returns:
            (primal, dual); infinite where the solution is not finite.
        """
        if not self.is_finite():
            return np.inf, np.inf
        above = qp.C @ self.x - qp.u
        H_x = qp.H @ self.x + qp.H.T @ self.x - qp.H.diagonal() * self.x
        stationarity = H_x + qp.g + qp.C.T @ self.z
        primal = max(float(above.max(initial=0.0)), 0.0)
        if qp.A is not None:
            stationarity = stationarity + qp.A.T @ self.y
            primal = max(primal, float(np.abs(qp.A @ self.x - qp.b).max(initial=0.0)))
        slack = np.minimum(np.abs(above), np.abs(self.z))
        dual = max(float(np.abs(stationarity).max(initial=0.0)), float(slack.max(initial=0.0)))
        return primal, max(dual, float((-self.z).max(initial=0.0)))
