"""The path constraints' rows at the stages of the nonlinear program, for all corners."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.mechanics.wrench import WRENCH
from zmp_sqp.planning.constraints.effort_rows import EffortRows, effort_curvature
from zmp_sqp.planning.constraints.protocol import ConstraintRows, StageModel, StageSample
from zmp_sqp.planning.constraints.tip_over import TipOverRows

__all__ = ["BoundConstraints", "CornerRows", "StageRows"]


Named = tuple[str, ConstraintRows]  # the constraint's name, and its rows


@dataclass(frozen=True, slots=True, eq=False)
class CornerRows:
    """Rows of all constraints at one corner of payload and slope.

    Attributes:
        model: The machine at this corner.
        rows: Rows that depend on payload or slope, with the names of their constraints.
    """

    model: StageModel
    rows: tuple[Named, ...]

    @property
    def by_effort(self) -> tuple[EffortRows, ...]:
        """Rows that are affine in the efforts; they are evaluated as one matrix."""
        return tuple(rows for _, rows in self.rows if isinstance(rows, EffortRows))

    @property
    def tip_over(self) -> tuple[TipOverRows, ...]:
        """Rows of the support polygon's edges."""
        return tuple(rows for _, rows in self.rows if isinstance(rows, TipOverRows))

    @property
    def others(self) -> tuple[ConstraintRows, ...]:
        """All other rows."""
        return tuple(rows for _, rows in self.rows if not isinstance(rows, EffortRows))


@dataclass(frozen=True, slots=True, eq=False)
class BoundConstraints:
    """The constraints of a problem, bound to its machine at every corner.

    Attributes:
        corners: At least one.
        common: Rows that depend on neither payload nor slope, evaluated at the first corner.
    """

    corners: tuple[CornerRows, ...]
    common: tuple[Named, ...]

    def at(self, corners: Sequence[int]) -> BoundConstraints:
        """The constraints at some of the corners only."""
        return BoundConstraints(tuple(self.corners[i] for i in corners), self.common)

    def tightened(self, amounts: Mapping[str, float]) -> BoundConstraints:
        """The constraints with limits drawn in, by amounts in their own unit.

        Args:
            amounts: By the names of the constraints.
        """

        def drawn_in(named: tuple[Named, ...]) -> tuple[Named, ...]:
            return tuple(
                (name, rows.tightened(amounts[name]) if name in amounts else rows)
                for name, rows in named
            )

        corners = tuple(CornerRows(corner.model, drawn_in(corner.rows)) for corner in self.corners)
        return BoundConstraints(corners, drawn_in(self.common))

    def outside(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> float:
        """How far the zero moment point is beyond its margin at most, over all corners [m].

        Infinite where the ground would have to pull.

        Args:
            q, w, alpha, S, positions: As for `StageModel.efforts`.
        """
        worst = -np.inf
        for corner in self.corners:
            wrench = corner.model.efforts(q, w, alpha, S, positions)[:, :WRENCH]
            if wrench[:, 2].min() <= 0.0:
                return np.inf
            for rows in corner.tip_over:
                worst = max(worst, float(rows.outside(wrench).max()))
        return worst

    @property
    def half_width(self) -> float:
        """Median distance of the support polygon's edges, less the margin, from the root axis [m]."""
        return float(np.median([-rows.C[:, 2] for rows in self.corners[0].tip_over]))


class StageRows:
    """E rows at K states, scaled to order one by the reference duration, and at most zero.

    Order: corner by corner the rows that are affine in the efforts, then the others of that corner;
    at the end those that do not depend on the corner.
    """

    def __init__(self, bound: BoundConstraints, reference: float) -> None:
        """Stack the rows.

        Args:
            bound: The constraints.
            reference: Duration that scales time [s].
        """
        self.reference, self._S = reference, reference**2
        self.corners = bound.corners
        self.common = tuple(rows for _, rows in bound.common)
        self._by_effort = [corner.by_effort for corner in self.corners]
        self._others = [corner.others for corner in self.corners]
        self._matrices = [_stacked(rows, self._S) for rows in self._by_effort]
        every = (*self._by_effort, *self._others, self.common)
        self.count = sum(len(rows.labels) for group in every for rows in group)
        ordered = [
            *(
                rows
                for pair in zip(self._by_effort, self._others, strict=True)
                for group in pair
                for rows in group
            ),
            *self.common,
        ]
        # largest violation of each row at a solution, shape (E,)
        self.tolerance = np.concatenate(
            [np.full(len(rows.labels), rows.tolerance) for rows in ordered]
        )

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return self.corners[0].model.size

    def evaluate(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> Array:
        """Values of the rows, shape (K, E).

        Args:
            q, w, alpha, S, positions: As for `StageModel.efforts`.
        """
        found = []
        for sample, (matrix, offset), others in self._samples(q, w, alpha, S, positions):
            found.append(sample.efforts @ matrix.T + (S / self._S) * offset)
            found += [rows.evaluate(sample) / self._S for rows in others]
        first = StageSample(self.corners[0].model, q, w, alpha, S, positions)
        found += [rows.evaluate(first) / self._S for rows in self.common]
        return np.hstack(found)

    def linearize(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> tuple[Array, Array]:
        """Values, shape (K, E), and Jacobian by (q, w, alpha, S [, positions]), (K, E, 3n + 1 [+ 2]).

        Args:
            q, w, alpha, S, positions: As for `StageModel.efforts`.
        """
        values, jacobians = [], []
        for sample, (matrix, offset), others in self._samples(q, w, alpha, S, positions):
            efforts, by_state = sample.effort_derivatives
            jacobian = matrix @ by_state
            jacobian[:, :, 3 * self.size] += offset / self._S
            values.append(efforts @ matrix.T + (S / self._S) * offset)
            jacobians.append(jacobian)
            for rows in others:
                value, jacobian = rows.linearize(sample)
                values.append(value / self._S)
                jacobians.append(jacobian / self._S)
        first = StageSample(self.corners[0].model, q, w, alpha, S, positions)
        for rows in self.common:
            value, jacobian = rows.linearize(first)
            values.append(value / self._S)
            jacobians.append(jacobian / self._S)
        return np.hstack(values), np.concatenate(jacobians, axis=1)

    def curvature(
        self,
        q: Array,
        w: Array,
        alpha: Array,
        S: float,
        weights: Array,
        positions: Array | None = None,
    ) -> Array:
        """Hessian of `weights . rows` by (q, w, alpha, S), shape (K, 3n + 1, 3n + 1).

        Args:
            q, w, alpha, S, positions: As for `StageModel.efforts`.
            weights: Shape (K, E); states whose weights for a group of rows vanish cost nothing.
        """
        n = self.size
        H = np.zeros((len(q), 3 * n + 1, 3 * n + 1))
        at = 0

        def share(count: int) -> tuple[Array, Indices]:
            nonlocal at
            part = weights[:, at : at + count]
            at += count
            return part, np.flatnonzero(part.any(axis=1))

        def sample(model: StageModel, some: Indices) -> StageSample:
            where = None if positions is None else positions[some]
            return StageSample(model, q[some], w[some], alpha[some], S, where)

        groups = zip(self.corners, self._matrices, self._others, strict=True)
        for corner, (matrix, _), others in groups:
            part, some = share(len(matrix))
            if len(some):
                H[some] += effort_curvature(sample(corner.model, some), part[some] @ matrix)
            for rows in others:
                part, some = share(len(rows.labels))
                if len(some):
                    H[some] += rows.curvature(sample(corner.model, some), part[some] / self._S)
        for rows in self.common:
            part, some = share(len(rows.labels))
            if len(some):
                first = sample(self.corners[0].model, some)
                H[some] += rows.curvature(first, part[some] / self._S)
        return H

    def _samples(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None
    ) -> Iterator[tuple[StageSample, tuple[Array, Array], tuple[ConstraintRows, ...]]]:
        groups = zip(self.corners, self._matrices, self._others, strict=True)
        for corner, matrix, others in groups:
            yield StageSample(corner.model, q, w, alpha, S, positions), matrix, others


def _stacked(rows: tuple[EffortRows, ...], S: float) -> tuple[Array, Array]:
    """One matrix on efforts times S, scaled by the reference, and one offset per unit of S / S_ref."""
    columns = max(part.C.shape[1] for part in rows)
    C = np.vstack([part.matrix(columns) for part in rows])
    divisor = np.concatenate([part.divisor for part in rows])
    return C / (divisor * S)[:, None], np.concatenate([part.c for part in rows])
