"""Inequality Jacobian of a staged program with many corners, with rows formed on demand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.cached import cached_property
from zmp_sqp.planning.program.rows import StageExpansion
from zmp_sqp.planning.program.stages import Stages
from zmp_sqp.sqp.rows import Rows

if TYPE_CHECKING:
    import scipy.sparse as sp

__all__ = ["CornerJacobian"]

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class CornerJacobian:
    """Inequality Jacobian of which only the rows in the quadratic program are formed.

    With 64 corners and 50 intervals there are 48 000 nonlinear rows, of which a few hundred take
    part. The first-order change of all rows is computed from that of the efforts; derivatives are
    formed for selected rows. Both are exact.

    Attributes:
        stages: Variables and maps.
        expansion: Expansion of the rows at starts, ends and middles of the intervals.
        maps: Jacobians of (q, w, alpha, S [, positions]) at starts, ends and middles by mapped
            stage variables, shape (N or 1, s, m) each.
        ends: Derivatives by sigma of the first and of the last stage's mapped variables, through
            the boundary rates v sqrt(S), shape (m,) each.
        limits: Jacobian of the limits.
    """

    stages: Stages
    expansion: StageExpansion
    maps: tuple[Array, Array, Array]
    ends: tuple[Array, Array]
    limits: Rows

    @property
    def nonlinear(self) -> int:
        """Number of nonlinear rows, which come first, ordered by interval, point and row."""
        return 3 * self.stages.grid.size * self.expansion.layout.count

    def __matmul__(self, step: Array) -> Array:
        """First-order change of all inequalities by a step of the variables, shape (m,)."""
        columns = self.stages.stage_columns
        local = np.where(columns >= 0, step[columns], 0.0)
        local[0] += step[-1] * self.ends[0]
        local[-1] += step[-1] * self.ends[1]
        states = np.vstack([(part @ local[:, :, None])[:, :, 0] for part in self.maps])
        start, end, middle = self.expansion.change(states).reshape(3, len(columns), -1)
        of_rows = np.stack([start, end, 2.0 * middle - 0.5 * (start + end)], axis=1)
        return np.concatenate([of_rows.ravel(), self.limits @ step])

    def selected(self, mask: Mask) -> sp.csc_matrix:
        """Rows selected by a mask (m,), CSC."""
        import scipy.sparse as sp  # slow to import, and not needed by every plan

        rows = np.flatnonzero(mask[: self.nonlinear])
        interval, entries = self.derivatives(rows)
        entries[:, -1] += self._by_ends(interval, entries)
        columns = self.stages.stage_columns[interval]
        is_variable = columns >= 0
        starts = np.concatenate([[0], np.cumsum(is_variable.sum(axis=1))])
        shape = len(rows), self.stages.size
        nonlinear = sp.csr_matrix((entries[is_variable], columns[is_variable], starts), shape=shape)
        limits = self._limits_by_row[mask[self.nonlinear :]]
        return sp.vstack([nonlinear, limits], format="csr").tocsc()

    @cached_property
    def _limits_by_row(self) -> sp.csr_matrix:
        """Jacobian of the limits, stored by row."""
        return self.limits.matrix.tocsr()

    def leading(self, values: Array) -> Mask:
        """Mask of the rows that are largest among all corners, and of all other inequalities.

        Each row of each interval and point is kept for its worst corner alone: keeping the two or
        three worst corners makes the quadratic programs larger and saves no iteration.

        Args:
            values: Values of all inequalities, shape (m,).
        """
        layout, found = self.expansion.layout, np.ones(len(values), dtype=bool)
        of_rows = values[: self.nonlinear].reshape(-1, layout.count)[:, : layout.of_corners]
        by_corner = of_rows.reshape(len(of_rows), -1, layout.per_corner)
        is_largest = found[: self.nonlinear].reshape(-1, layout.count)
        largest = by_corner.max(axis=1, keepdims=True)
        is_largest[:, : layout.of_corners] = (by_corner >= largest).reshape(of_rows.shape)
        return found

    def derivatives(self, rows: Indices) -> tuple[Indices, Array]:
        """Interval (L,) of nonlinear rows, and derivatives by its mapped stage variables, (L, m).

        Args:
            rows: Indices of nonlinear rows, ascending, shape (L,).
        """
        N, count = self.stages.grid.size, self.expansion.layout.count
        interval, rest = np.divmod(rows, 3 * count)
        point, row = np.divmod(rest, count)
        is_middle = point == 2
        # rows at middle control points depend on all three points of their interval
        rows_at = [np.flatnonzero((point == which) | is_middle) for which in range(3)]
        state = np.concatenate([which * N + interval[some] for which, some in enumerate(rows_at)])
        by_state = self.expansion.derivatives(state, row[np.concatenate(rows_at)])
        ends = np.cumsum([len(some) for some in rows_at])
        start, end, middle = (
            _mapped(by_state[at - len(some) : at], part, interval[some])
            for at, some, part in zip(ends, rows_at, self.maps, strict=True)
        )
        found = np.zeros((len(rows), self.stages.m))
        factor = np.where(is_middle, -0.5, 1.0)[:, None]
        found[rows_at[0]] += factor[rows_at[0]] * start
        found[rows_at[1]] += factor[rows_at[1]] * end
        found[rows_at[2]] += 2.0 * middle
        return interval, found

    def through_ends(self, weights: Array) -> float:
        """Derivative of weights . nonlinear rows by sigma through the boundary rates v sqrt(S).

        Args:
            weights: Weight of each nonlinear row, shape (nonlinear,).
        """
        if not (self.ends[0].any() or self.ends[1].any()):
            return 0.0
        rows = np.flatnonzero(weights)
        interval, entries = self.derivatives(rows)
        return float(weights[rows] @ self._by_ends(interval, entries))

    def _by_ends(self, interval: Indices, entries: Array) -> Array:
        first, last = interval == 0, interval == self.stages.grid.size - 1
        return np.where(first, entries @ self.ends[0], 0.0) + np.where(
            last, entries @ self.ends[1], 0.0
        )


def _mapped(by_state: Array, part: Array, interval: Indices) -> Array:
    """Derivatives by states (L, s) times the map of their interval (N or 1, s, m), (L, m)."""
    if len(part) == 1:
        return np.asarray(by_state @ part[0])
    return np.asarray((by_state[:, None] @ part[interval])[:, 0])
