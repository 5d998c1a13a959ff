"""A motion of the machine at one corner of payload and slope, cut into stretches of time."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.mechanics.bounds.effort_bounds import EffortBound, effort_bounds
from zmp_sqp.mechanics.bounds.payload_spread import moment_of_spread
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import efforts
from zmp_sqp.motion.root_motion import root_motion, root_motion_bounds
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.constraints.effort_rows import EffortRows
from zmp_sqp.planning.constraints.protocol import ConstraintRows, MotionSample, Stretch
from zmp_sqp.planning.proof.path_error import misplaced_root_bounds
from zmp_sqp.planning.proof.subdivision import StretchValues

__all__ = ["CornerMotion", "first_parts", "row_scale"]

STRETCHES = 6  # per interval to begin with
LONGEST = 0.05  # [s] of a stretch to begin with
FIRST = 20_000  # stretches to begin with, however long the motion is
# roundings that add up in an effort: at most ten per joint and factor, and to spare
OPERATIONS = 100.0
EPSILON = float(np.finfo(float).eps)


class CornerMotion:
    """Values and bounds of the constraints' rows along a motion, for one machine and gravity."""

    def __init__(
        self,
        machine: Machine,
        trajectory: Trajectory,
        gravity: Array,
        rows: tuple[ConstraintRows, ...],
        *,
        spread: float,
    ) -> None:
        """Bound rounding and curvature of the efforts in every interval.

        Args:
            machine: The machine with this corner's payload.
            trajectory: The motion.
            gravity: In the root frame of a machine that stands, shape (3,) [m/s^2]; a base that
                drives has its own ground, and only the strength counts.
            rows: Rows of the constraints.
            spread: See `moment_of_spread` [kg m^2].
        """
        self.machine, self.trajectory, self.rows = machine, trajectory, rows
        self._gravity, self._strength = gravity, float(np.linalg.norm(gravity))
        self._height = 0.0 if machine.support is None else machine.support.height
        self._joints = any(part.needs_joint_efforts for part in rows)
        self._needs_peaks = not all(isinstance(part, EffortRows) for part in rows)
        steps = np.diff(trajectory.times)
        self.rounding, curvature = self._bounds_of_intervals(spread)
        # where intervals are short, bounds on the whole interval serve all its stretches
        self._whole = curvature if steps.max() <= STRETCHES * LONGEST else None

    def values(self, interval: Indices, share: Array, length: Array) -> list[StretchValues]:
        """Values of each constraint on K stretches.

        Args:
            interval: To which each stretch belongs, shape (K,).
            share: Where it starts, share of the interval, shape (K,).
            length: How long it is, share of the interval, shape (K,).
        """
        count = len(interval)
        h = np.diff(self.trajectory.times)[interval]
        # every start, and those ends that are not the next stretch's start
        apart = np.abs(np.diff(share) - length[:-1]) > 4.0 * EPSILON
        ends = np.flatnonzero(np.append((np.diff(interval) != 0) | apart, True))
        looked_at = np.concatenate([np.arange(count), ends])
        since = np.concatenate([share, (share + length)[ends]]) * h[looked_at]
        sample = self._sample(interval[looked_at], since)
        follower = np.arange(1, count + 1)
        follower[ends] = count + np.arange(len(ends))
        starts = np.arange(count)
        stretch = self._stretch(interval, share * h, length * h, sample[starts], sample[follower])
        at = np.stack([since[starts], since[follower]])  # (2, K)
        found = []
        for rows in self.rows:
            room = rows.room(sample)
            both = np.stack([room[starts], room[follower]])  # (2, K, R)
            found.append(_stretch_values(rows, stretch, both, at, self.trajectory.times[interval]))
        return found

    def sampled(self, interval: Indices, since: Array) -> list[Array]:
        """Room of each constraint's rows at times after the starts of intervals, (K, R) each."""
        sample = self._sample(interval, since)
        return [rows.room(sample) for rows in self.rows]

    def _sample(self, interval: Indices, since: Array) -> MotionSample:
        q, v, a = self.trajectory.state_in(interval, since)
        twist, root = root_motion(
            self.trajectory, self._gravity, interval, since, height=self._height
        )
        found = efforts(
            self.machine,
            q,
            v,
            a,
            root_acceleration=root,
            root_velocity=twist,
            joints=self._joints,
        )
        return MotionSample(self.machine, q, v, a, found)

    def _stretch(
        self,
        interval: Indices,
        since: Array,
        delta: Array,
        start: MotionSample,
        end: MotionSample,
    ) -> Stretch:
        """Bounds on what happens inside stretches that start at `since` and last `delta` [s]."""
        j = np.abs(self.trajectory.jerks[interval])
        reach = v = a = j
        if self._whole is None or self._needs_peaks:
            both = tuple(
                np.vstack(pair)
                for pair in zip((start.q, start.v, start.a), (end.q, end.v, end.a), strict=True)
            )
            reach, v, a = peaks(both, j, delta[:, None])
        if self._whole is None:
            base = None
            if self.trajectory.base is not None:
                base = root_motion_bounds(
                    self.trajectory.base, interval, since, delta, height=self._height
                )
            _, curvature = effort_bounds(
                self.machine,
                v,
                a,
                j,
                reach=reach,
                gravity=self._strength,
                base=base,
                joints=self._joints,
            )
        else:
            curvature = self._whole[interval]
        sag = 0.125 * delta**2
        nothing = EffortBound(0.0 * delta, 0.0 * delta, 0.0 * curvature.joints)
        interpolation = nothing.plus(curvature, sag)
        rounding = self.rounding[interval]
        return Stretch(start, end, delta, reach, v, a, j, interpolation, rounding)

    def _bounds_of_intervals(self, spread: float) -> tuple[EffortBound, EffortBound]:
        """Largest errors of the efforts in each of the N intervals, and their second derivatives.

        Rounding is relative to the sum of the absolute values of all that adds up, within an
        interval from its start; a rounded angle turns everything beyond its joint. The error of a
        base's position over uneven ground and the spread of a payload's centre of mass are added.
        """
        machine, trajectory, strength = self.machine, self.trajectory, self._strength
        count, h = trajectory.intervals, np.diff(trajectory.times)
        j, step = np.abs(trajectory.jerks), h[:, None]
        a = np.abs(trajectory.accelerations)
        v = np.abs(trajectory.velocities[:-1]) + step * a + 0.5 * step**2 * j
        a = a + step * j
        q = np.abs(trajectory.positions[:-1]) + step * v
        base, turned = None, np.zeros(count)
        if trajectory.base is not None:
            everywhere = np.arange(count), np.zeros(count), h
            base = root_motion_bounds(trajectory.base, *everywhere, height=self._height)
            turned = np.abs(trajectory.base.poses[:-1, 2]) + h * base[1, 0]
        twice = None if base is None else np.concatenate([base, base], axis=2)
        # first bounds from the starts alone, for rounding; then from both ends, for curvature
        both = np.tile(np.arange(count), 2), np.concatenate([np.zeros(count), h])
        inside = peaks(trajectory.state_in(*both), j, step)
        reach, most_v, most_a, most_j = (
            np.vstack(pair) for pair in zip((q, v, a, j), (*inside, j), strict=True)
        )
        size, curvature = effort_bounds(
            machine,
            most_v,
            most_a,
            most_j,
            reach=reach,
            gravity=strength,
            base=twice,
            joints=self._joints,
        )
        first = size[:count]
        share = OPERATIONS * EPSILON * (1.0 + q.sum(axis=1) + turned)
        error = EffortBound(
            share * first.force, share * first.moment, share[:, None] * first.joints
        )
        if base is not None and not trajectory.base.ground.uniform:  # type: ignore[union-attr]
            moved = misplaced_root_bounds(
                trajectory.base,  # type: ignore[arg-type]
                base,
                gravity=strength,
                height=self._height,
            )
            more, _ = effort_bounds(
                machine, v, a, j, reach=q, gravity=strength, base=moved, joints=self._joints
            )
            error = error.plus(more).plus(first, -1.0)
        if spread > 0.0:
            off = moment_of_spread(
                machine, most_v[count:], most_a[count:], spread=spread, base=base
            )
            turning = np.array([unit == "rad" for unit in machine.joint_units])
            of_joints = off[:, None] * turning if self._joints else error.joints
            error = error.plus(EffortBound(0.0 * off, off, of_joints))
        return error, curvature[count:]


def first_parts(trajectory: Trajectory) -> Indices:
    """Into how many stretches each interval is cut at first, shape (N,)."""
    parts = np.maximum(STRETCHES, np.ceil(np.diff(trajectory.times) / LONGEST))
    parts = np.maximum(parts * min(1.0, FIRST / parts.sum()), 1.0)
    return np.asarray(parts.astype(int))


def peaks(ends: tuple[Array, ...], j: Array, delta: Array) -> tuple[Array, Array, Array]:
    """Largest |coordinates|, |rates| and |accelerations| between two ends, shape (K, n) each.

    Rates are parabolas, so that their ends and the jerk bound their largest value.

    Args:
        ends: Coordinates, rates and accelerations at the starts, then at the ends, (2K, n) each.
        j: |jerks|, shape (K, n).
        delta: Time between the ends, shape (K, 1) [s].
    """
    q, v, a = (np.abs(part).reshape(2, len(j), -1).max(axis=0) for part in ends)
    v = v + 0.125 * delta**2 * j
    return q + 0.5 * delta * v, v, a


def _stretch_values(
    rows: ConstraintRows, stretch: Stretch, room: Array, since: Array, starts: Array
) -> StretchValues:
    """Least of a constraint's rows on K stretches, in the unit of its first row.

    Args:
        rows: The constraint.
        stretch: The stretches.
        room: At starts and ends, shape (2, K, R).
        since: When, after the starts of the intervals, shape (2, K) [s].
        starts: Of the intervals, shape (K,) [s].
    """
    scale, count = row_scale(rows), room.shape[1]
    scaled = room / scale
    flat = np.argmin(scaled.min(axis=2), axis=0)
    nearest = scaled[flat, np.arange(count)]
    times = starts + since[flat, np.arange(count)]
    least, row = scaled.min(axis=(0, 2)), nearest.argmin(axis=1)
    if not rows.proven:
        return StretchValues(least, times, row, least, least)
    bound, reachable = rows.least_between(stretch, room.min(axis=0))
    return StretchValues(
        least, times, row, (bound / scale).min(axis=1), (reachable / scale).min(axis=1)
    )


def row_scale(rows: ConstraintRows) -> Array:
    """By what the room of each row is divided to be compared with the first row's, shape (R,)."""
    resolution = rows.resolution
    finite = np.isfinite(resolution)
    return np.where(finite, resolution / np.where(finite, resolution[0], 1.0), 1.0)
