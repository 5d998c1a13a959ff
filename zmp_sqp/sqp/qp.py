"""A quadratic program, its solution, and the residuals that prove the solution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from zmp_sqp.arrays import Array

__all__ = ["QP", "QPSolution"]

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class QP:
    r"""Convex quadratic program with sparse matrices.

    .. math:: \min_x \tfrac12 x^T H x + g^T x \quad \text{s.t.} \quad A x = b, \; C x \le u

    Attributes:
        H: Upper triangle of a symmetric matrix, CSC, shape (n, n).
        g: Shape (n,).
        A: CSC, shape (p, n); None without equalities.
        b: Shape (p,).
        C: CSC, shape (m, n).
        u: Shape (m,).
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
        """Whether no NaN and no infinity stands in the data.

        Backends ask before they solve: some do not check, and run to their caps or worse.
        """
        parts = [self.H.data, self.C.data, self.g, self.b, self.u]
        if self.A is not None:
            parts.append(self.A.data)
        # a sum is finite only if all entries are, and faster to look at
        with np.errstate(invalid="ignore"):
            return all(bool(np.isfinite(part.sum())) for part in parts)

    def dense(self) -> tuple[Array, Array, Array]:
        """H in full, A and C as arrays, for solvers of dense quadratic programs."""
        upper = self.H.toarray()
        H = upper + upper.T - np.diag(np.diag(upper))
        A = np.zeros((0, self.size)) if self.A is None else self.A.toarray()
        return H, np.ascontiguousarray(A), np.ascontiguousarray(self.C.toarray())

    def relaxed(self, nonlinear: Mask, price: float) -> QP:
        """With one more variable t >= 0 that relaxes some rows at a price.

        Args:
            nonlinear: Which rows are relaxed, mask of shape (m,).
            price: Of t.
        """
        H = sp.block_diag([self.H, sp.csc_matrix([[SLACK_CURVATURE]])], format="csc")
        A = self.A
        if A is not None:
            A = sp.hstack([A, sp.csc_matrix((A.shape[0], 1))], format="csc")
        column = sp.csc_matrix(-nonlinear.astype(float)[:, None])
        last = sp.csc_matrix(([-1.0], ([0], [self.size])), shape=(1, self.size + 1))
        C = sp.vstack([sp.hstack([self.C, column]), last], format="csc")
        return QP(H, np.append(self.g, price), A, self.b, C, np.append(self.u, 0.0))


SLACK_CURVATURE = 1e-8  # keeps the relaxed program's Hessian positive definite


@dataclass(frozen=True, slots=True, eq=False)
class QPSolution:
    """What a backend answers; whether it can be believed is what `residuals` tell.

    Attributes:
        x: Minimiser, shape (n,).
        y: Multipliers of A x = b, shape (p,).
        z: Multipliers of C x <= u, not negative, shape (m,).
        solved: Whether the backend says that it converged.
        iterations: Inner iterations of the backend.
        backend: Its name.
    """

    x: Array
    y: Array
    z: Array
    solved: bool
    iterations: int
    backend: str

    @classmethod
    def nothing(cls, qp: QP, backend: str, iterations: int = 0) -> QPSolution:
        """What a backend answers when it has nothing to offer: not finite."""
        x, y, z = (np.full(count, np.nan) for count in (qp.size, len(qp.b), len(qp.u)))
        return cls(x, y, z, False, iterations, backend)

    def is_finite(self) -> bool:
        """Whether all of it are numbers."""
        with np.errstate(invalid="ignore"):
            return bool(np.isfinite(self.x.sum() + self.y.sum() + self.z.sum()))

    def residuals(self, qp: QP) -> tuple[float, float]:
        r"""Primal and dual residuals, independent of what the backend reports.

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
