r"""Efforts on stretches of a motion from inverse dynamics at their ends, for one corner.

Over uneven ground the motion of the root is not an analytic function of time, because the spline
surface has continuous derivatives up to the fourth order only. Between two times that lie
:math:`\delta` apart, efforts differ from the straight line between their values at both times by at
most :math:`\delta^2 / 8` times a bound on their second derivatives (`effort_bounds`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.errors import TrajectoryError
from zmp_sqp.mechanics.bounds.effort_bounds import EffortBound, effort_bounds
from zmp_sqp.mechanics.bounds.payload_spread import joint_shares, moment_of_spread
from zmp_sqp.mechanics.ground import GRAVITY
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.uncertainty import Corner
from zmp_sqp.mechanics.wrench import efforts
from zmp_sqp.motion.root_motion import root_motion, root_motion_bounds
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning.proof.joint_peaks import joint_peaks, peaks
from zmp_sqp.planning.proof.position_errors import misplaced_root_bounds
from zmp_sqp.planning.proof.subdivision import Mask

__all__ = ["EffortChords"]

STRETCHES = 6  # least number of stretches per interval at first
LONGEST = 0.05  # [s] longest stretch at first
FIRST = 20_000  # largest number of stretches at first, which limits time and memory
# rounding errors that add up in an effort: at most ten per joint and factor, with room to spare
OPERATIONS = 100.0
EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True, slots=True, eq=False)
class EffortChords:
    """Efforts of one corner while the base drives, see `MotionEfforts`; a piece is an interval.

    Attributes:
        machine: Machine with the payload of the corner.
        trajectory: Motion of the joints and the base.
        joints: Whether the efforts of the joints follow the wrench.
        length: Lengths of the intervals, shape (N,) [s].
        error: Bound on the error of computed efforts in each interval, shape (N,).
        is_vague: Whether this bound is infinite, shape (N,).
        curvature: Bound on the second derivatives of the efforts in each interval, shape (N,).
    """

    machine: Machine
    trajectory: Trajectory
    joints: bool
    length: Array
    error: EffortBound
    is_vague: Mask
    curvature: EffortBound
    # a tenth of the resolution costs 5 % of the time: few stretches are near the least value
    fineness = 0.1
    exhausted = False

    @classmethod
    def of(cls, corner: Corner, trajectory: Trajectory, *, joints: bool) -> EffortChords:
        """Bound the errors and second derivatives of the efforts in every interval."""
        error, curvature = _bounds_of_intervals(corner, trajectory, joints=joints)
        is_vague = ~(np.isfinite(error.force) & np.isfinite(error.moment))
        length = np.diff(trajectory.times)
        return cls(corner.machine, trajectory, joints, length, error, is_vague, curvature)

    @property
    def interval(self) -> Indices:
        """Interval of each piece: its own index."""
        return np.arange(len(self.length))

    @property
    def since(self) -> Array:
        """Start of each piece: that of its interval."""
        return np.zeros(len(self.length))

    @property
    def first_parts(self) -> Indices:
        """Number of stretches that each interval is cut into at first, shape (N,)."""
        parts = np.maximum(STRETCHES, np.ceil(self.length / LONGEST))
        parts = np.maximum(parts * min(1.0, FIRST / parts.sum()), 1.0)
        return np.asarray(parts.astype(int))

    def at(self, corner: int, interval: Indices, since: Array) -> Array:
        """Efforts by inverse dynamics, shape (K, R); `corner` is not used, as there is only one."""
        q, v, a = self.trajectory.state_in(interval, since)
        height = _height(self.machine)
        twist, root = root_motion(self.trajectory, np.zeros(3), interval, since, height=height)
        return efforts(
            self.machine,
            q,
            v,
            a,
            root_acceleration=root,
            root_velocity=twist,
            joints=self.joints,
        )

    def stretches(
        self, corner: Indices, piece: Indices, share: Array, length: Array
    ) -> tuple[Array, EffortBound, EffortBound]:
        """Efforts at both ends of K stretches; see `MotionEfforts.stretches`."""
        count, h = len(piece), self.length[piece]
        # all starts, and the ends that are not the start of the next stretch
        apart = np.abs(np.diff(share) - length[:-1]) > 4.0 * EPSILON
        ends = np.flatnonzero(np.append((np.diff(piece) != 0) | apart, True))
        times = np.concatenate([share, (share + length)[ends]])
        times = times * h[np.concatenate([np.arange(count), ends])]
        found = self.at(0, piece[np.concatenate([np.arange(count), ends])], times)
        follower = np.arange(1, count + 1)
        follower[ends] = count + np.arange(len(ends))
        control = np.stack([found[:count], found[follower]])
        sag = 0.125 * (length * h) ** 2
        curvature = self._curvature(piece, share * h, length * h)
        none = EffortBound(0.0 * sag, 0.0 * sag, 0.0 * curvature.joints)
        return control, none.plus(curvature, sag), self.error[piece]

    def _curvature(self, interval: Indices, since: Array, delta: Array) -> EffortBound:
        """Bound on the second derivatives of the efforts on K stretches."""
        # bounds on a whole interval are tight enough for its stretches if intervals are short
        if self.length.max() <= STRETCHES * LONGEST:
            return self.curvature[interval]
        reach, v, a, j = joint_peaks(self.trajectory, interval, since, delta)
        base, height = _base_of(self.trajectory), abs(_height(self.machine))
        root = root_motion_bounds(base, interval, since, delta, height=height)
        return effort_bounds(
            self.machine, v, a, j, reach=reach, gravity=GRAVITY, base=root, joints=self.joints
        )[1]


def _base_of(trajectory: Trajectory) -> UnicycleMotion:
    if trajectory.base is None:
        raise TrajectoryError("EffortChords is for a trajectory whose base drives: it has no base")
    return trajectory.base


def _bounds_of_intervals(
    corner: Corner, trajectory: Trajectory, *, joints: bool
) -> tuple[EffortBound, EffortBound]:
    """Bounds on the error of computed efforts and on their second derivatives, N intervals each.

    Rounding errors are relative to the sum of the absolute values of all terms. The rounding error
    of an angle rotates all links beyond its joint. The effects of the base's position error and of
    the spread of a payload's centre of mass are added.
    """
    machine, height = corner.machine, _height(corner.machine)
    count, h = trajectory.intervals, np.diff(trajectory.times)
    drive = _base_of(trajectory)
    j, step = np.abs(trajectory.jerks), h[:, None]
    a = np.abs(trajectory.accelerations)
    v = np.abs(trajectory.velocities[:-1]) + step * a + 0.5 * step**2 * j
    a = a + step * j
    q = np.abs(trajectory.positions[:-1]) + step * v
    base = root_motion_bounds(drive, np.arange(count), np.zeros(count), h, height=height)
    turned = np.abs(drive.poses[:-1, 2]) + h * base[1, 0]
    # peaks from the starts alone, for rounding; then from both ends, for second derivatives
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
        gravity=GRAVITY,
        base=np.concatenate([base, base], axis=2),
        joints=joints,
    )
    first = size[:count]
    angles = machine.coupling.largest_positions(q)
    share = OPERATIONS * EPSILON * (1.0 + angles.sum(axis=1) + turned)
    error = EffortBound(share * first.force, share * first.moment, share[:, None] * first.joints)
    if not drive.ground.uniform:
        moved = misplaced_root_bounds(drive, base, gravity=GRAVITY, height=height)
        more, _ = effort_bounds(
            machine, v, a, j, reach=q, gravity=GRAVITY, base=moved, joints=joints
        )
        error = error.plus(more).plus(first, -1.0)
    if corner.spread > 0.0:
        off = moment_of_spread(
            machine, most_v[count:], most_a[count:], spread=corner.spread, base=base
        )
        of_joints = off[:, None] * joint_shares(machine) if joints else error.joints
        error = error.plus(EffortBound(0.0 * off, off, of_joints))
    return error, curvature[count:]


def _height(machine: Machine) -> float:
    """Height of the support plane in the root frame [m]."""
    return 0.0 if machine.support is None else machine.support.height
