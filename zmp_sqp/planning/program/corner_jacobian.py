"""Jacobian of a staged program with many corners, whose rows are formed when asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.planning.program.rows import StageExpansion
from zmp_sqp.planning.program.stages import Stages
from zmp_sqp.sqp.rows import Rows

__all__ = ["CornerJacobian"]

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class CornerJacobian:
    """Jacobian of the inequalities, of which quadratic programs see but a few rows.

    With 64 corners there are 48 000 nonlinear rows at 50 intervals, of which some hundred matter.
    Changes of all rows by a step follow from those of the efforts; derivatives are formed for
    the rows of a mask. Both are exact.

    Attributes:
        stages: Variables and maps.
        expansion: Rows at starts, ends and middles of the intervals.
        maps: (q, w, alpha, S [, positions]) at starts, ends and middles by a mapped stage's
            variables, (N or 1, s, m) each.
        ends: What a unit of sigma's variable adds to a mapped stage's variables through given rates
            at the start and the goal, (m,) each.
        limits: Jacobian of the limits.
    """

    stages: Stages
    expansion: StageExpansion
    maps: tuple[Array, Array, Array]
    ends: tuple[Array, Array]
    limits: Rows

    @property
    def nonlinear(self) -> int:
        """Number of nonlinear rows, which come first: by interval, point and row."""
        return 3 * self.stages.grid.size * self.expansion.layout.count

    def __matmul__(self, step: Array) -> Array:
        """Change of the rows' values by a step, shape (m,)."""
        columns = self.stages.stage_columns
        local = np.where(columns >= 0, step[columns], 0.0)
        local[0] += step[-1] * self.ends[0]
        local[-1] += step[-1] * self.ends[1]
        states = np.vstack([(part @ local[:, :, None])[:, :, 0] for part in self.maps])
        start, end, middle = self.expansion.change(states).reshape(3, len(columns), -1)
        of_rows = np.stack([start, end, 2.0 * middle - 0.5 * (start + end)], axis=1)
        return np.concatenate([of_rows.ravel(), self.limits @ step])

    def selected(self, mask: Mask) -> sp.csc_matrix:
        """The rows of a mask (m,), CSC."""
        rows = np.flatnonzero(mask[: self.nonlinear])
        interval, entries = self.derivatives(rows)
        entries[:, -1] += self._by_ends(interval, entries)
        columns = self.stages.stage_columns[interval]
        there = columns >= 0
        starts = np.concatenate([[0], np.cumsum(there.sum(axis=1))])
        shape = len(rows), self.stages.size
        nonlinear = sp.csr_matrix((entries[there], columns[there], starts), shape=shape)
        limits = self.limits.selected(mask[self.nonlinear :])
        return sp.csc_matrix(sp.vstack([nonlinear.tocsc(), limits], format="csc"))

    def leading(self, values: Array) -> Mask:
        """Of each row the corner with the largest value, in each interval and at each point.

        Where two or three corners lead, the programs are larger and no iteration is saved.

        Args:
            values: Of all inequalities, shape (m,).
        """
        layout, found = self.expansion.layout, np.ones(len(values), dtype=bool)
        of_rows = values[: self.nonlinear].reshape(-1, layout.count)[:, : layout.of_corners]
        by_corner = of_rows.reshape(len(of_rows), -1, layout.per_corner)
        leads = found[: self.nonlinear].reshape(-1, layout.count)
        largest = by_corner.max(axis=1, keepdims=True)
        leads[:, : layout.of_corners] = (by_corner >= largest).reshape(of_rows.shape)
        return found

    def derivatives(self, rows: Indices) -> tuple[Indices, Array]:
        """Interval of nonlinear rows, (L,), and derivatives by its mapped stage, (L, m).

        Args:
            rows: Of the nonlinear ones, ascending, shape (L,).
        """
        N, count = self.stages.grid.size, self.expansion.layout.count
        interval, rest = np.divmod(rows, 3 * count)
        point, row = np.divmod(rest, count)
        inner = point == 2
        # rows at middle control points see all three points of their interval
        seen = [np.flatnonzero((point == which) | inner) for which in range(3)]
        state = np.concatenate([which * N + interval[some] for which, some in enumerate(seen)])
        by_state = self.expansion.derivatives(state, row[np.concatenate(seen)])
        ends = np.cumsum([len(some) for some in seen])
        start, end, middle = (
            _mapped(by_state[at - len(some) : at], part, interval[some])
            for at, some, part in zip(ends, seen, self.maps, strict=True)
        )
        found = np.zeros((len(rows), self.stages.m))
        factor = np.where(inner, -0.5, 1.0)[:, None]
        found[seen[0]] += factor[seen[0]] * start
        found[seen[1]] += factor[seen[1]] * end
        found[seen[2]] += 2.0 * middle
        return interval, found

    def through_ends(self, weights: Array) -> float:
        """Derivative of weighted nonlinear rows by sigma's variable through rates at the ends.

        Args:
            weights: Shape (nonlinear,).
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
    """Derivatives (L, s) times the map of their interval, (L, m)."""
    if len(part) == 1:
        return np.asarray(by_state @ part[0])
    return np.asarray((by_state[:, None] @ part[interval])[:, 0])
