"""Sparse matrices with a fixed pattern, and Jacobians from which rows are selected."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.cached import cached_property

if TYPE_CHECKING:
    import scipy.sparse as sp

__all__ = ["Pattern", "Rows"]

Mask = npt.NDArray[np.bool_]


class Pattern:
    """Sparsity pattern of a matrix that is assembled many times from lists of entries.

    Entries with equal row and column are summed. Entries with a negative row or column are dropped;
    columns of quantities that are no variables are left out this way.
    """

    def __init__(
        self, rows: Indices, columns: Indices, shape: tuple[int, int], *, upper: bool = False
    ) -> None:
        """Compute the CSC structure.

        Args:
            rows, columns: Row and column of each entry, in the order of the entries that `data`
                will be given, shape (E,) each.
            shape: Shape of the matrix.
            upper: Whether only the upper triangle is kept.
        """
        kept = (rows >= 0) & (columns >= 0)
        if upper:
            kept &= rows <= columns
        self.shape = shape
        index = np.flatnonzero(kept)
        keys, slot = np.unique(
            columns[index].astype(np.int64) * shape[0] + rows[index], return_inverse=True
        )
        self.indices = (keys % shape[0]).astype(np.int32)
        starts = np.searchsorted(keys // shape[0], np.arange(shape[1] + 1))
        self.indptr = starts.astype(np.int32)
        self._slot = None if len(keys) == len(index) else slot
        # without repeated entries, assembly is a permutation
        self._index = index[np.argsort(slot)] if self._slot is None else index

    def data(self, entries: Array) -> Array:
        """CSC data of the matrix: entries sorted by column, repeated ones summed.

        Args:
            entries: Entries in the order of the constructor's rows and columns, shape (E,).
        """
        kept = entries[self._index]
        if self._slot is None:
            return kept
        return np.bincount(self._slot, kept, len(self.indices)).astype(float, copy=False)

    def matrix(self, data: Array) -> sp.csc_matrix:
        """CSC matrix with data from `data`."""
        found = copy(self._template)  # a constructor would check indices again, which is slow
        found.data = data
        return found

    @cached_property
    def _template(self) -> sp.csc_matrix:
        import scipy.sparse as sp  # slow to import, and not needed by every plan

        nothing = np.zeros(len(self.indices))
        return sp.csc_matrix((nothing, self.indices, self.indptr), shape=self.shape)


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Jacobian of inequalities as a sparse matrix, without groups of parallel rows.

    Attributes:
        matrix: The Jacobian, CSC, shape (m, n).
    """

    matrix: Any

    def __matmul__(self, step: Array) -> Array:
        """First-order change of all inequalities by a step (n,), shape (m,)."""
        return np.asarray(self.matrix @ step)

    def leading(self, values: Array) -> Mask:
        """Mask of all rows, because there are no groups; see `Jacobian.leading`."""
        return np.ones(len(values), dtype=bool)

    def selected(self, mask: Mask) -> sp.csc_matrix:
        """Rows selected by a mask (m,), CSC."""
        if mask.all():
            return self.matrix
        import scipy.sparse as sp  # slow to import, and not needed by every plan

        matrix = self.matrix
        kept = np.flatnonzero(mask[matrix.indices])
        number = np.cumsum(mask, dtype=np.int32) - np.int32(1)
        rows = number[matrix.indices[kept]]
        starts = np.searchsorted(kept, matrix.indptr).astype(np.int32)
        shape = int(number[-1]) + 1, matrix.shape[1]
        return sp.csc_matrix((matrix.data[kept], rows, starts), shape=shape)
