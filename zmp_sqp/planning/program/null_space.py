"""Null-space basis of the shooting gaps: a dense matrix, or where that would fill the memory, its products alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from zmp_sqp.arrays import Array
from zmp_sqp.planning.program.layout import Layout

__all__ = ["NullSpace", "null_space", "with_last_column"]

MOST_ENTRIES = 10_000_000  # of a dense basis: 80 MB, at five joints some 350 intervals


@dataclass(frozen=True, slots=True, eq=False)
class NullSpace:
    r"""The matrix Z of `Layout.basis` as an operator: sums over the controls, joint by joint.

    .. math:: Z = \begin{pmatrix} Q \otimes D_q & z_q \\ W \otimes D_w & z_w \\ I \otimes I & 0 \\ 0 & 1 \end{pmatrix}
              \begin{pmatrix} \text{ties} & 0 \\ 0 & 1 \end{pmatrix}

    Q and W (`Layout.sums`) are what unit controls add to the nodes, the D the scales. It stands where a dense Z does:
    Z @ x, rows @ Z for dense or sparse rows, Z.T @ y, Z.shape, and Z[rows], which is dense.

    Attributes:
        layout: Where variables stand.
        scales: D_q and D_w, shape (n,) each.
        last: Last column, shape (size,).
        ties: Shape (N c n, r), or None.
    """

    layout: Layout
    scales: tuple[Array, Array]
    last: Array
    ties: sp.csr_array | None = None
    __array_ufunc__ = None  # so that NumPy's arrays leave products with it to it

    @property
    def shape(self) -> tuple[int, int]:
        """Of the matrix."""
        columns = (
            self.layout.N * self.layout.hold.controls * self.layout.n
            if self.ties is None
            else self.ties.shape[1]
        )
        return self.layout.size, columns + 1

    @property
    def T(self) -> _Transposed:
        """The transposed matrix, for products with vectors and matrices."""
        return _Transposed(self)

    def __matmul__(self, x: Array) -> Array:
        """Z @ x for x of shape (r,) or (r, k)."""
        layout, free = self.layout, x[:-1] if self.ties is None else self.ties @ x[:-1]
        controls = free.reshape(-1, layout.n, *x.shape[1:])  # (N c, n, ...)
        parts = []
        for sums, scale in zip(layout.sums, self.scales, strict=True):
            added = np.tensordot(sums, controls, axes=1)  # (N + 1, n, ...)
            parts.append((added * scale.reshape(-1, *[1] * (x.ndim - 1))).reshape(-1, *x.shape[1:]))
        rest = np.zeros((1, *x.shape[1:]))
        return np.asarray(
            np.concatenate([*parts, free, rest]) + np.multiply.outer(self.last, x[-1])
        )

    def __rmatmul__(self, rows: Any) -> Array:
        """rows @ Z for rows of shape (size,) or (m, size), dense or sparse: dense."""
        if not sp.issparse(rows) and rows.ndim == 1:
            return np.asarray((rows[None] @ self)[0])
        layout, n = self.layout, self.layout.n
        rows = sp.csc_array(rows) if sp.issparse(rows) else rows
        found = rows[:, layout.controls]
        found = np.array(found.toarray() if sp.issparse(found) else found)
        for part, sums, scale in zip(
            (layout.positions, layout.rates), layout.sums, self.scales, strict=True
        ):
            block = rows[:, part]
            for joint in range(n):
                found[:, joint::n] += (block[:, joint::n] @ sums) * scale[joint]
        if self.ties is not None:
            found = found @ self.ties
        return np.column_stack([found, rows @ self.last])

    def __getitem__(self, index: Any) -> Array:
        """Rows of the matrix, dense."""
        return np.asarray(sp.eye_array(self.layout.size, format="csr")[index] @ self)


@dataclass(frozen=True, slots=True, eq=False)
class _Transposed:
    """Z'."""

    of: NullSpace
    __array_ufunc__ = None

    def __matmul__(self, y: Array) -> Array:
        return np.asarray((y.T @ self.of).T)


def null_space(
    layout: Layout, rate_scale: Array, control_scale: Array, ties: sp.csr_array | None
) -> Array | NullSpace:
    """Basis Z of the gaps for a start at rest, shape (size, r).

    Args:
        layout: Where variables stand.
        rate_scale, control_scale: Scales of rates and controls, shape (n,) each.
        ties: Map from fewer free variables to the controls, shape (N c n, r - 1); None leaves every
            control free.
    """
    columns = layout.N * layout.hold.controls * layout.n + 1 if ties is None else ties.shape[1] + 1
    if layout.size * columns > MOST_ENTRIES:
        last = np.zeros(layout.size)
        last[-1] = 1.0
        return NullSpace(layout, (control_scale, control_scale / rate_scale), last, ties)
    Z = layout.basis(rate_scale, control_scale)
    return Z if ties is None else np.hstack([Z[:, :-1] @ ties, Z[:, -1:]])


def with_last_column(Z: Array | NullSpace, q: Array, w: Array, layout: Layout) -> Array | NullSpace:
    """The same basis for a start in motion: its last column has rows q (N + 1, n) for positions and w for rates."""
    last = np.zeros(layout.size)
    last[layout.positions], last[layout.rates], last[-1] = q.ravel(), w.ravel(), 1.0
    if isinstance(Z, NullSpace):
        return replace(Z, last=last)
    return np.column_stack([Z[:, :-1], last])
