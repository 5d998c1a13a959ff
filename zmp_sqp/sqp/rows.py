"""Sparse matrices whose pattern is fixed while their entries change from iterate to iterate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from zmp_sqp.arrays import Array, Indices

__all__ = ["Pattern", "Rows"]

Mask = npt.NDArray[np.bool_]


class Pattern:
    """Where the entries of a sparse matrix stand: made once, used for every set of entries.

    Entries may repeat a place, where they add up, or have a negative row or column, where they are
    dropped: columns of variables that are given are simply left out this way.
    """

    def __init__(
        self, rows: Indices, columns: Indices, shape: tuple[int, int], *, upper: bool = False
    ) -> None:
        """Sort the entries by column.

        Args:
            rows, columns: Of the entries, in the order they will be given in, shape (E,) each.
            shape: Of the matrix.
            upper: Whether only the upper triangle is kept.
        """
        kept = (rows >= 0) & (columns >= 0)
        if upper:
            kept &= rows <= columns
        self.shape = shape
        index = np.flatnonzero(kept)
        keys, place = np.unique(
            columns[index].astype(np.int64) * shape[0] + rows[index], return_inverse=True
        )
        self.indices = (keys % shape[0]).astype(np.int32)
        starts = np.searchsorted(keys // shape[0], np.arange(shape[1] + 1))
        self.indptr = starts.astype(np.int32)
        self._place = None if len(keys) == len(index) else place
        # where every entry has a place of its own, sorting is a mere permutation
        self._index = index[np.argsort(place)] if self._place is None else index

    def data(self, entries: Array) -> Array:
        """Entries in the order of the columns, repeated ones added up.

        Args:
            entries: In the order of the constructor's rows and columns, shape (E,).
        """
        kept = entries[self._index]
        if self._place is None:
            return kept
        return np.bincount(self._place, kept, len(self.indices)).astype(float, copy=False)

    def matrix(self, data: Array) -> sp.csc_matrix:
        """The CSC matrix with entries as `data` returns them."""
        return sp.csc_matrix((data, self.indices, self.indptr), shape=self.shape)


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Rows of a Jacobian, some of which take part in a quadratic program.

    Attributes:
        matrix: CSC, shape (m, n).
    """

    matrix: Any

    def __matmul__(self, step: Array) -> Array:
        """Change of the rows' values by a step, shape (m,)."""
        return np.asarray(self.matrix @ step)

    def leading(self, values: Array) -> Mask:
        """All rows: none are alike, see `Jacobian`."""
        return np.ones(len(values), dtype=bool)

    def selected(self, mask: Mask) -> sp.csc_matrix:
        """The rows of a mask (m,), CSC."""
        if mask.all():
            return self.matrix
        matrix = self.matrix
        kept = mask[matrix.indices]
        number = np.cumsum(mask) - 1
        starts = np.concatenate([[0], np.cumsum(kept)])[matrix.indptr]
        return sp.csc_matrix(
            (
                matrix.data[kept],
                number[matrix.indices[kept]].astype(np.int32),
                starts.astype(np.int32),
            ),
            shape=(int(mask.sum()), matrix.shape[1]),
        )
