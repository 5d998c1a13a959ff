"""Rows of the path constraints at states of the nonlinear program, for all corners."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.cached import cached_property
from zmp_sqp.mechanics.bounds.payload_spread import joint_shares
from zmp_sqp.mechanics.wrench import WRENCH
from zmp_sqp.planning.constraints.effort_rows import EffortRows, effort_curvature
from zmp_sqp.planning.constraints.protocol import ConstraintRows, StageModel, StageSample
from zmp_sqp.planning.constraints.tip_over import TipOverRows
from zmp_sqp.planning.program.corners import CornerEfforts, CornerModels

__all__ = ["BoundConstraints", "CornerRows", "StageExpansion", "StageRows"]


Named = tuple[str, ConstraintRows]  # name of a constraint, and its rows


@dataclass(frozen=True, slots=True, eq=False)
class CornerRows:
    """Rows of all constraints at one corner of payload and slope.

    Attributes:
        model: Inverse dynamics of the machine at this corner.
        rows: Rows that depend on payload or slope, with the names of their constraints.
        spread: Spread of the payload's centre of mass, see `Corner` [kg m^2].
    """

    model: StageModel
    rows: tuple[Named, ...]
    spread: float = 0.0

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
        """Rows that depend on the corner but are not affine in the efforts."""
        return tuple(rows for _, rows in self.rows if not isinstance(rows, EffortRows))


@dataclass(frozen=True, eq=False)
class BoundConstraints:
    """Constraints of a problem, bound to its machine at every corner of payload and slope.

    Attributes:
        corners: Rows at each corner, at least one.
        common: Rows that depend on neither payload nor slope, evaluated at the first corner.
    """

    corners: tuple[CornerRows, ...]
    common: tuple[Named, ...]

    def at(self, corners: Sequence[int]) -> BoundConstraints:
        """These constraints at some of the corners only."""
        return BoundConstraints(tuple(self.corners[i] for i in corners), self.common)

    def tightened(self, amounts: Mapping[str, float]) -> BoundConstraints:
        """These constraints with tighter limits.

        Args:
            amounts: Amount of tightening by name of the constraint, in the constraint's unit.
        """
        if not amounts:
            return self

        def tightened_rows(named: tuple[Named, ...]) -> tuple[Named, ...]:
            return tuple(
                (name, rows.tightened(amounts[name]) if name in amounts else rows)
                for name, rows in named
            )

        corners = tuple(
            replace(corner, rows=tightened_rows(corner.rows)) for corner in self.corners
        )
        return BoundConstraints(corners, tightened_rows(self.common))

    def outside(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> float:
        """Largest violation of the ZMP margin over all states and corners [m].

        Negative where the margin is kept; infinite where the ground would have to pull.

        Args:
            q, w, alpha, S, positions: As for `StageModel.efforts`.
        """
        return float(self.outside_by_corner(q, w, alpha, S, positions).max())

    def outside_by_corner(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> Array:
        """Largest violation of the ZMP margin over all states, at each corner, shape (V,) [m].

        Negative where the margin is kept; infinite where the ground would have to pull.

        Args:
            q, w, alpha, S, positions: As for `StageModel.efforts`.
        """
        if self.models is None:
            efforts = self.corners[0].model.efforts(q, w, alpha, S, positions)[None]
        else:
            efforts = self.models.efforts(q, w, alpha, S, positions)
        found = np.full(len(self.corners), np.inf)
        for v in np.flatnonzero(efforts[:, :, 2].min(axis=1) > 0.0):
            found[v] = max(
                float(rows.outside(efforts[v, :, :WRENCH]).max())
                for rows in self.corners[v].tip_over
            )
        return found

    @cached_property
    def models(self) -> CornerModels | None:
        """Inverse dynamics of all corners from that of a few; None for a single corner."""
        if len(self.corners) == 1:
            return None
        return CornerModels.of([corner.model for corner in self.corners])

    @cached_property
    def matrices(self) -> tuple[Array, Array]:
        """Factors of the efforts in all affine rows, (V, rows, R), and constants, (V, rows)."""
        # corners with one payload share rows
        numbers = [tuple(id(rows) for rows in corner.by_effort) for corner in self.corners]
        distinct = dict(zip(numbers, self.corners, strict=True))
        found = {number: _stacked(corner.by_effort) for number, corner in distinct.items()}
        parts = [found[number] for number in numbers]
        return np.stack([matrix for matrix, _ in parts]), np.stack([c for _, c in parts])

    @property
    def half_width(self) -> float:
        """Median distance of the support polygon's edges from the root axis, less margin [m]."""
        return float(np.median([-rows.C[:, 2] for rows in self.corners[0].tip_over]))


@dataclass(frozen=True, slots=True, eq=False)
class StageExpansion:
    """First-order expansion of the rows at K states and many corners.

    Derivatives of rows that are affine in the efforts are formed only when asked for.

    Attributes:
        layout: Number and order of the rows.
        values: Values of the rows, shape (K, E).
        efforts: Efforts at all corners, with their derivatives.
        others: Derivatives by (q, w, alpha, S [, positions]) of the rows of each corner that are
            not affine in the efforts, shape (K, V, O, 3n + 1 [+ 2]).
        common: Derivatives by the same variables of the rows that do not depend on the corner,
            shape (K, F, 3n + 1 [+ 2]).
    """

    layout: StageRows
    values: Array
    efforts: CornerEfforts
    others: Array
    common: Array

    def derivatives(self, state: Indices, row: Indices) -> Array:
        """Derivatives of L rows by (q, w, alpha, S [, positions]), shape (L, 3n + 1 [+ 2]).

        Args:
            state, row: Indices of the state and the row of each derivative, shape (L,) each.
        """
        layout, found = self.layout, np.empty((len(row), self.common.shape[2]))
        corner, position = np.divmod(row, layout.per_corner)
        shared = row >= layout.of_corners
        found[shared] = self.common[state[shared], row[shared] - layout.of_corners]
        other = ~shared & (position >= layout.effort_rows)
        found[other] = self.others[
            state[other], corner[other], position[other] - layout.effort_rows
        ]
        some = np.flatnonzero(~shared & ~other)
        v, e = corner[some], position[some]
        of_efforts = self.efforts.derivatives(v, state[some], layout.matrices[v, e])
        of_efforts[:, 3 * layout.size] += layout.offsets[v, e] / layout.S
        found[some] = of_efforts
        return found

    def change(self, step: Array) -> Array:
        """First-order change of all rows, shape (K, E).

        Args:
            step: Change of (q, w, alpha, S [, positions]), shape (K, 3n + 1 [+ 2]).
        """
        layout = self.layout
        by_S = step[:, 3 * layout.size] / layout.S
        of_efforts = self.efforts.change(step) @ layout.matrices.transpose(0, 2, 1)
        of_efforts += by_S[:, None] * layout.offsets[:, None]
        K, V, count, _ = self.others.shape
        # NumPy takes as long for no rows as for some
        others = np.einsum("kvoj,kj->kvo", self.others, step) if count else np.zeros((K, V, 0))
        return layout.assembled(of_efforts, others, (self.common @ step[:, :, None])[:, :, 0])


class StageRows:
    """The E rows of all path constraints at a state; not positive where the constraints hold.

    Rows are divided by the squared reference duration, which scales them to order one. Order: for
    each corner the rows that are affine in the efforts, then the other rows of that corner; at the
    end the rows that do not depend on the corner. With more than one corner, efforts and their
    derivatives are combined from those of a few corners (`CornerModels`).

    Attributes:
        reference, S: Reference duration that scales time, and its square [s, s^2].
        corners: Model and rows at each of the V corners.
        models: Inverse dynamics of all corners from that of a few; None for a single corner.
        count: Number E of rows.
        effort_rows: Number of a corner's rows that are affine in the efforts.
        per_corner: Number of all rows of a corner.
        matrices: Factors of the efforts times S in the affine rows, shape (V, effort_rows, R).
        offsets: Constants of the affine rows per unit of S / reference^2, (V, effort_rows).
        tolerance: Largest violation of each row at a solution, shape (E,).
    """

    def __init__(self, bound: BoundConstraints, reference: float) -> None:
        """Stack the affine rows of every corner in one matrix.

        Args:
            bound: The constraints; all corners have the same number of rows.
            reference: Duration that scales time [s].
        """
        self.reference, self.S = reference, reference**2
        self.corners, self.models = bound.corners, bound.models
        self.common = tuple(rows for _, rows in bound.common)
        self._others = [corner.others for corner in self.corners]
        factors, self.offsets = bound.matrices
        self.matrices = factors / self.S
        self.effort_rows = self.matrices.shape[1]
        first = (*self.corners[0].by_effort, *self._others[0])
        tolerance = np.concatenate([_tolerance(rows) for rows in first])
        self.per_corner = len(tolerance)
        every = [np.tile(tolerance, len(self.corners)), *map(_tolerance, self.common)]
        self.tolerance = np.concatenate(every)
        self.count = len(self.tolerance)

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return self.corners[0].model.size

    @property
    def of_corners(self) -> int:
        """Number of rows that depend on the corner; they come first."""
        return self.per_corner * len(self.corners)

    def evaluate(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> Array:
        """Values of the rows at K states, shape (K, E).

        Args:
            q, w, alpha, S, positions: As for `StageModel.efforts`.
        """
        samples = self._samples(q, w, alpha, S, positions)
        others = [
            rows.evaluate(sample) / self.S
            for sample, group in zip(samples, self._others, strict=True)
            for rows in group
        ]
        common = [rows.evaluate(samples[0]) / self.S for rows in self.common]
        if self.models is None:
            return np.hstack([self._of_efforts(samples[0].efforts, S), *others, *common])
        efforts = self.models.efforts(q, w, alpha, S, positions)
        return self._values(efforts, S, others, common)

    def linearize(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> tuple[Array, Array]:
        """Values (K, E) and Jacobian (K, E, 3n + 1 [+ 2]) by (q, w, alpha, S [, positions]).

        Args:
            q, w, alpha, S, positions: As for `StageModel.efforts`.
        """
        if self.models is not None:
            found = self.expand(q, w, alpha, S, positions)
            state, row = np.divmod(np.arange(len(q) * self.count), self.count)
            jacobian = found.derivatives(state, row)
            return found.values, jacobian.reshape(len(q), self.count, -1)
        return self.linearized(self.sample(0, q, w, alpha, S, positions))

    def linearized(self, sample: StageSample) -> tuple[Array, Array]:
        """Results of `linearize` for a single corner, from a sample that keeps its derivatives."""
        S = sample.S
        efforts, by_state = sample.effort_derivatives
        jacobian = self.matrices[0] @ by_state
        jacobian[:, :, 3 * self.size] += self.offsets[0] / self.S
        values, jacobians = [self._of_efforts(efforts, S)], [jacobian]
        for rows in (*self._others[0], *self.common):
            value, jacobian = rows.linearize(sample)
            values.append(value / self.S)
            jacobians.append(jacobian / self.S)
        return np.hstack(values), np.concatenate(jacobians, axis=1)

    def expand(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> StageExpansion:
        """First-order expansion for more than one corner, with derivatives formed on demand.

        Args:
            q, w, alpha, S, positions: As for `StageModel.efforts`.
        """
        if self.models is None:
            raise ValueError(
                "StageRows.expand is for more than one corner: use StageRows.linearize"
            )
        efforts = self.models.linearize(q, w, alpha, S, positions)
        samples = self._samples(q, w, alpha, S, positions)
        others = [
            rows.linearize(sample)
            for sample, group in zip(samples, self._others, strict=True)
            for rows in group
        ]
        common = [rows.linearize(samples[0]) for rows in self.common]
        values = self._values(
            efforts.efforts,
            S,
            [value / self.S for value, _ in others],
            [value / self.S for value, _ in common],
        )
        none = np.empty((len(q), 0, efforts.jacobian.shape[3]))
        by_corner, shared = (
            np.concatenate([none, *(jacobian / self.S for _, jacobian in group)], axis=1)
            for group in (others, common)
        )
        by_corner = by_corner.reshape(len(q), len(self.corners), -1, none.shape[2])
        return StageExpansion(self, values, efforts, by_corner, shared)

    @cached_property
    def by_turning(self) -> Array | None:
        """Factor of `moment_of_spread` per unit of spread in each row, (E,); None if all are zero.

        How much the row grows at most when the payload's centre of mass is inside its box, per unit
        of the bound on the turning of the links.
        """
        spread = np.array([corner.spread for corner in self.corners])
        if not spread.any():
            return None
        joints = self.matrices[:, :, WRENCH:]
        shares = joint_shares(self.corners[0].model.machine)[: joints.shape[2]]
        reach = np.linalg.norm(self.matrices[:, :, 3:WRENCH], axis=2)
        reach = reach + (np.abs(joints) * shares).sum(axis=2)
        none = np.zeros((1, len(self.corners), self.per_corner - self.effort_rows))
        shared = np.zeros((1, self.count - self.of_corners))
        found = self.assembled((spread[:, None] * reach)[:, None], none, shared)
        return np.asarray(found[0])

    def assembled(self, of_efforts: Array, others: Array, common: Array) -> Array:
        """Values of all rows in their order, shape (K, E).

        Args:
            of_efforts: Rows that are affine in the efforts, shape (V, K, effort_rows).
            others: Other rows of each corner, shape (K, V, O).
            common: Rows that do not depend on the corner, shape (K, F).
        """
        V, K, _ = of_efforts.shape
        found = np.empty((K, self.count))
        by_corner = found[:, : self.of_corners].reshape(K, V, self.per_corner)
        by_corner[:, :, : self.effort_rows] = of_efforts.transpose(1, 0, 2)
        by_corner[:, :, self.effort_rows :] = others
        found[:, self.of_corners :] = common
        return found

    def _of_efforts(self, efforts: Array, S: float) -> Array:
        """Rows that are affine in the efforts (K, R) of a single corner, shape (K, effort_rows)."""
        return np.asarray(efforts @ self.matrices[0].T + (S / self.S) * self.offsets[0])

    def _values(
        self, efforts: Array, S: float, others: Sequence[Array], common: Sequence[Array]
    ) -> Array:
        """All rows in their order, (K, E), from efforts (V, K, R) and the values of other rows."""
        of_efforts = efforts @ self.matrices.transpose(0, 2, 1)
        of_efforts += (S / self.S) * self.offsets[:, None]
        V, K = efforts.shape[:2]
        empty = np.empty((K, 0))
        by_corner = np.hstack([empty, *others]).reshape(K, V, -1)
        return self.assembled(of_efforts, by_corner, np.hstack([empty, *common]))

    def curvature(
        self,
        q: Array,
        w: Array,
        alpha: Array,
        S: float,
        weights: Array,
        positions: Array | None = None,
        *,
        known: StageSample | None = None,
    ) -> Array:
        """Hessian of `weights . rows` by (q, w, alpha, S), shape (K, 3n + 1, 3n + 1).

        With many corners, affine rows of all corners use the curvature of the efforts at the corner
        with the largest sum of weights: payloads and gravities differ little between corners.

        Args:
            q, w, alpha, S, positions: As for `StageModel.efforts`.
            weights: Weight (multiplier) of each row, shape (K, E). States where all weights of a
                group of rows are zero are skipped.
            known: The same states with derivatives that need not be computed again, of a single
                corner; None if there are none.
        """
        n, corners = self.size, len(self.corners)
        H = np.zeros((len(q), 3 * n + 1, 3 * n + 1))
        by_corner = weights[:, : self.of_corners].reshape(len(q), corners, self.per_corner)

        def sample(corner: int, some: Indices) -> StageSample:
            whole = known or self.sample(corner, q, w, alpha, S, positions)
            return whole.at(some)

        def add(groups: tuple[ConstraintRows, ...], corner: int, parts: Array) -> None:
            at = 0
            for rows in groups:
                part = parts[:, at : at + len(rows.labels)]
                some = np.flatnonzero(part.any(axis=1))
                at += len(rows.labels)
                if len(some):
                    H[some] += rows.curvature(sample(corner, some), part[some] / self.S)

        of_efforts = by_corner[:, :, : self.effort_rows]
        heaviest = of_efforts.sum(axis=2).argmax(axis=1)
        active = np.flatnonzero(of_efforts.any(axis=(1, 2)))
        matrix = self.matrices.reshape(corners * self.effort_rows, -1)
        factors = of_efforts[active].reshape(len(active), corners * self.effort_rows) @ matrix
        H[active] += self._curvature_of_efforts(heaviest[active], factors, active, sample)
        for corner, groups in enumerate(self._others):
            add(groups, corner, by_corner[:, corner, self.effort_rows :])
        add(self.common, 0, weights[:, self.of_corners :])
        return H

    def _curvature_of_efforts(
        self,
        corners: Indices,
        weights: Array,
        states: Indices,
        sample: Callable[[int, Indices], StageSample],
    ) -> Array:
        """Hessians of weights (L, R) times the efforts of L states, each at its own corner (L,)."""
        if len(corners) and self.models is not None and weights.shape[1] == WRENCH:
            at = sample(0, states)
            known = self.models.wrench_hessian(corners, at.q, at.w, at.alpha, at.S, weights)
            if known is not None:
                return known
        found = np.zeros((len(states), 3 * self.size + 1, 3 * self.size + 1))
        for corner in np.unique(corners).tolist():
            chosen = corners == corner
            found[chosen] = effort_curvature(sample(corner, states[chosen]), weights[chosen])
        return found

    def sample(
        self, corner: int, q: Array, w: Array, alpha: Array, S: float, positions: Array | None
    ) -> StageSample:
        """K states with the model of a corner."""
        return StageSample(self.corners[corner].model, q, w, alpha, S, positions)

    def _samples(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None
    ) -> list[StageSample]:
        """K states with the model of each corner."""
        each = range(len(self.corners))
        return [self.sample(corner, q, w, alpha, S, positions) for corner in each]


def _tolerance(rows: ConstraintRows) -> Array:
    return np.full(len(rows.labels), rows.tolerance)


def _stacked(rows: tuple[EffortRows, ...]) -> tuple[Array, Array]:
    """Factors of the efforts in rows, shape (rows, R), and constants, shape (rows,)."""
    columns = max(part.C.shape[1] for part in rows)
    factors = [part.matrix(columns) / part.divisor[:, None] for part in rows]
    return np.vstack(factors), np.concatenate([part.c for part in rows])
