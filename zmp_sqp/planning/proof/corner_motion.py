"""Values and bounds of all constraints on stretches of a motion, at one or several corners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Protocol

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.mechanics.bounds.effort_bounds import EffortBound
from zmp_sqp.mechanics.uncertainty import Corner
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.constraints.effort_rows import EffortRows
from zmp_sqp.planning.constraints.protocol import ConstraintRows, MotionSample, Stretch
from zmp_sqp.planning.constraints.tip_over import ContactRows, TipOverRows
from zmp_sqp.planning.proof.joint_peaks import joint_peaks
from zmp_sqp.planning.proof.subdivision import Mask, StretchValues

__all__ = ["CornerMotion", "MotionEfforts", "is_proven", "row_scale"]


class MotionEfforts(Protocol):
    """Efforts along a motion that is cut into P pieces, at C corners."""

    @property
    def interval(self) -> Indices:
        """Interval of the trajectory that each piece belongs to, shape (P,)."""

    @property
    def since(self) -> Array:
        """Start of each piece after the start of its interval, shape (P,) [s]."""

    @property
    def length(self) -> Array:
        """Length of each piece, shape (P,) [s]."""

    @property
    def fineness(self) -> float:
        """Factor on the resolution of the constraints, by which guarantees are tighter."""

    @property
    def first_parts(self) -> Indices:
        """Number of stretches that each piece is cut into at first, shape (P,)."""

    @property
    def is_vague(self) -> Mask:
        """Whether rounding errors of the efforts on each piece have no finite bound, shape (P,)."""

    @property
    def exhausted(self) -> bool:
        """Whether there are as many pieces as allowed, so that errors may be large."""

    def at(self, corner: int, interval: Indices, since: Array) -> Array:
        """Efforts of one corner at K times, by inverse dynamics, shape (K, R)."""

    def stretches(
        self, corner: Indices, piece: Indices, share: Array, length: Array
    ) -> tuple[Array, EffortBound, EffortBound]:
        """Efforts on K stretches: control points, error of interpolation, error of the values.

        Args:
            corner, piece: Corner and piece of each stretch, shape (K,) each.
            share: Start of each stretch, as a share of its piece, shape (K,).
            length: Length of each stretch, as a share of its piece, shape (K,).

        Returns:
            Control points, shape (n + 1, K, R), and both errors, shape (K,), as in `Stretch`.
        """


class CornerMotion:
    """Values of constraints along a motion at C corners of payload and slope.

    Pieces at corners are numbered by `piece * C + corner`.
    """

    def __init__(
        self,
        corners: Sequence[Corner],
        trajectory: Trajectory,
        efforts: MotionEfforts,
        rows: Sequence[Sequence[ConstraintRows]],
    ) -> None:
        """Store the arguments.

        Args:
            corners: The C corners.
            trajectory: The motion.
            efforts: Efforts along the motion at these corners.
            rows: Rows of each constraint at each corner.
        """
        self.corners, self.trajectory, self.efforts, self.rows = corners, trajectory, efforts, rows
        self._shared = [_same_room(per_corner) for per_corner in rows]

    @property
    def first_parts(self) -> Indices:
        """Number of stretches that each piece at each corner is cut into at first, (P C,)."""
        return np.repeat(self.efforts.first_parts, len(self.corners))

    def numbers(self, number: int) -> tuple[int, int]:
        """Piece and corner of a number."""
        return divmod(number, len(self.corners))

    def values(self, number: Indices, share: Array, length: Array) -> list[StretchValues]:
        """Values of each constraint on K stretches.

        Args:
            number: Number of the piece and corner of each stretch, shape (K,).
            share: Start of each stretch, as a share of its piece, shape (K,).
            length: Length of each stretch, as a share of its piece, shape (K,).
        """
        piece, corner = np.divmod(number, len(self.corners))
        control, interpolation, rounding = self.efforts.stretches(corner, piece, share, length)
        start = self.efforts.since[piece] + share * self.efforts.length[piece]
        delta = length * self.efforts.length[piece]
        of_all = _Stretches(
            corner,
            self.efforts.interval[piece],
            np.stack([start, start + delta]),
            delta,
            control,
            interpolation,
            rounding,
        )
        return [
            self._values(per_corner, of_all, shared=shared)
            for per_corner, shared in zip(self.rows, self._shared, strict=True)
        ]

    def sample(self, corner: int, interval: Indices, since: Array) -> MotionSample:
        """States and efforts of one corner at K times, by inverse dynamics."""
        return MotionSample(
            self.corners[corner].machine,
            *self.trajectory.state_in(interval, since),
            self.efforts.at(corner, interval, since),
        )

    def _values(
        self, per_corner: Sequence[ConstraintRows], stretches: _Stretches, *, shared: bool
    ) -> StretchValues:
        """Values of one constraint on K stretches; `shared` rows are those of the first corner."""
        if shared:
            return self._values_of_rows(per_corner[0], stretches, 0)
        count = len(stretches.corner)
        found = StretchValues.without_limit(count)
        corners = np.unique(stretches.corner) if per_corner[0].per_corner else [0]
        for corner in corners:
            chosen = stretches.corner == corner
            if not chosen.any():
                continue  # rows that do not depend on the corner are proven already
            part = self._values_of_rows(per_corner[corner], stretches[chosen], int(corner))
            found.put(chosen, part)
        return found

    def _values_of_rows(
        self, rows: ConstraintRows, stretches: _Stretches, corner: int
    ) -> StretchValues:
        """Values of one constraint whose rows are the same on all stretches."""
        machine, interval = self.corners[corner].machine, stretches.interval
        start, end = stretches.since
        nothing: Array = np.zeros((len(interval), 0))
        states = [(nothing, nothing, nothing)] * 2
        reach = v = a = j = nothing
        if not isinstance(rows, EffortRows):
            states = [self.trajectory.state_in(interval, at) for at in (start, end)]
            reach, v, a, j = joint_peaks(self.trajectory, interval, start, stretches.delta)
        control = stretches.control
        stretch = Stretch(
            start=MotionSample(machine, *states[0], control[0]),
            end=MotionSample(machine, *states[1], control[-1]),
            length=stretches.delta,
            reach=reach,
            v=v,
            a=a,
            j=j,
            interpolation=stretches.interpolation,
            rounding=stretches.rounding,
            control=control,
        )
        times = self.trajectory.times[interval] + stretches.since
        return _stretch_values(rows, stretch, times, proven=is_proven(rows, self.trajectory))


class _Stretches:
    """K stretches of a motion with the results of `MotionEfforts.stretches`."""

    __slots__ = ("control", "corner", "delta", "interpolation", "interval", "rounding", "since")

    def __init__(
        self,
        corner: Indices,
        interval: Indices,
        since: Array,
        delta: Array,
        control: Array,
        interpolation: EffortBound,
        rounding: EffortBound,
    ) -> None:
        """Store the arguments."""
        self.corner, self.interval, self.since, self.delta = corner, interval, since, delta
        self.control, self.interpolation, self.rounding = control, interpolation, rounding

    def __getitem__(self, chosen: Mask) -> _Stretches:
        """Some of the stretches."""
        return _Stretches(
            self.corner[chosen],
            self.interval[chosen],
            self.since[:, chosen],
            self.delta[chosen],
            self.control[:, chosen],
            self.interpolation[chosen],
            self.rounding[chosen],
        )


def is_proven(rows: ConstraintRows, trajectory: Trajectory) -> bool:
    """Whether rows have a bound between samples of this motion.

    Bounds of rows that are not affine in the efforts count on accelerations that are linear within
    the intervals.
    """
    return rows.proven and (isinstance(rows, EffortRows) or trajectory.snaps is None)


def _stretch_values(
    rows: ConstraintRows, stretch: Stretch, times: Array, *, proven: bool
) -> StretchValues:
    """Least value of a constraint's rows on K stretches, in the unit of the first row.

    Args:
        rows: The constraint.
        stretch: The stretches.
        times: Times of starts and ends, shape (2, K) [s].
        proven: Whether rows have a bound between the samples, see `is_proven`.
    """
    if isinstance(rows, EffortRows):
        room = rows.room_of(stretch)
        bound, reachable = rows.least_of(stretch, room)
    else:
        room = np.stack([rows.room(sample) for sample in (stretch.start, stretch.end)])
        bound = reachable = np.minimum(room[0], room[-1])
        if proven:
            bound, reachable = rows.least_between(stretch, bound)
    start, end, scale = room[0], room[-1], row_scale(rows)
    if (scale != 1.0).any():
        start, end, bound, reachable = (part / scale for part in (start, end, bound, reachable))
    at_start, at_end = start.min(axis=1), end.min(axis=1)
    first = at_start <= at_end
    return StretchValues(
        np.where(first, at_start, at_end),
        np.where(first, times[0], times[1]),
        np.where(first[:, None], start, end).argmin(axis=1),
        bound.min(axis=1),
        reachable.min(axis=1),
    )


def row_scale(rows: ConstraintRows) -> Array:
    """Divisor of each row's room that makes it comparable with that of the first row, (R,)."""
    resolution = rows.resolution
    if (resolution == resolution[0]).all():
        return np.ones(len(resolution))
    finite = np.isfinite(resolution)
    return np.where(finite, resolution / np.where(finite, resolution[0], 1.0), 1.0)


def _same_room(rows: Sequence[ConstraintRows]) -> bool:
    """Whether the room of the rows depends on the corner through the efforts alone."""
    first = rows[0]
    if len(rows) == 1 or isinstance(first, TipOverRows | ContactRows):
        return True  # all corners have one support polygon
    if not isinstance(first, EffortRows):
        return False
    return all(
        type(one) is type(first)
        and all(
            np.array_equal(getattr(one, field.name), getattr(first, field.name))
            for field in fields(first)
        )
        for one in rows[1:]
    )
