"""A quadratic program, its solution, and the residuals that prove the solution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from zmp_sqp.arrays import Array

__all__ = ["QP", "QPSolution"]


@dataclass(frozen=True, slots=True, eq=False)
class QP:
    r"""Convex quadratic program in ProxQP's letters.

    .. math:: \min_x \tfrac12 x^T H x + g^T x \quad \text{s.t.} \quad A x = b, \; l \le C x \le u

    Attributes:
        H: Symmetric positive semi-definite, shape (n, n), dense or CSC.
        g: Shape (n,).
        A: Shape (p, n), dense or CSC.
        b: Shape (p,).
        C: Shape (m, n), dense or CSC.
        l: Lower sides, shape (m,); -inf where a row has none.
        u: Upper sides, shape (m,); +inf where a row has none.
    """

    H: Any
    g: Array
    A: Any
    b: Array
    C: Any
    l: Array  # noqa: E741 - ProxQP's letter
    u: Array

    @property
    def size(self) -> int:
        """Number n of variables."""
        return len(self.g)

    @property
    def is_sparse(self) -> bool:
        """Whether the matrices are SciPy sparse matrices."""
        return bool(sp.issparse(self.C))

    def is_finite(self) -> bool:
        """Whether no NaN, no infinity where none belongs and no lower side above its upper one stands in the data.

        Backends ask before they solve: ProxQP and PIQP do not check, and run to their caps or
            worse.
        """
        matrices = [self.H, self.A, self.C]
        entries = [matrix.data if sp.issparse(matrix) else matrix for matrix in matrices]
        sides_ordered = bool(np.all(self.l <= self.u))  # False with NaN
        # a sum is finite only if all entries are, and five times as fast to look at
        return sides_ordered and all(
            bool(np.isfinite(np.sum(array))) for array in (*entries, self.g, self.b)
        )


@dataclass(frozen=True, slots=True, eq=False)
class QPSolution:
    """What a backend answers; whether it can be believed is what `residuals` tell.

    Attributes:
        x: Minimiser, shape (n,).
        y: Multipliers of A x = b, shape (p,).
        z: Multipliers of l <= C x <= u, positive at the upper side, shape (m,).
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
    def nothing(cls, qp: QP, backend: str) -> QPSolution:
        """What a backend answers when it has nothing to offer: not finite, so that its residuals are infinite."""
        return cls(
            np.full(qp.size, np.nan),
            np.full(len(qp.b), np.nan),
            np.full(len(qp.u), np.nan),
            False,
            0,
            backend,
        )

    def residuals(self, qp: QP) -> tuple[float, float]:
        r"""Primal and dual residuals, independent of what the backend reports.

        .. math::
            r_p = \max(\|A x - b\|_\infty, \|(C x - u)^+\|_\infty, \|(l - C x)^+\|_\infty), \quad
            r_d = \max(\|H x + g + A^T y + C^T z\|_\infty, \text{largest complementarity product})

        Returns:
            (primal, dual); infinite where the solution is not finite.
        """
        if not (
            np.isfinite(self.x).all() and np.isfinite(self.y).all() and np.isfinite(self.z).all()
        ):
            return np.inf, np.inf
        rows = qp.C @ self.x
        above, below = rows - qp.u, qp.l - rows
        primal = max(_largest(np.abs(qp.A @ self.x - qp.b)), _largest(above), _largest(below))
        stationarity = np.abs(qp.H @ self.x + qp.g + qp.A.T @ self.y + qp.C.T @ self.z)
        slack = np.where(self.z > 0.0, -above, np.where(self.z < 0.0, -below, 0.0))
        return primal, max(
            _largest(stationarity), _largest(np.abs(np.minimum(np.abs(slack), np.abs(self.z))))
        )


def _largest(values: Array) -> float:
    if np.isnan(values).any():  # a comparison would lose it
        return np.inf
    return float(values.max(initial=0.0))
