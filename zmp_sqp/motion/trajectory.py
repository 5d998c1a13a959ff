"""Joint motion with piecewise polynomial accelerations, evaluated exactly at any time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, Indices, finite_number, frozen_array, set_frozen_state
from zmp_sqp.errors import TrajectoryError
from zmp_sqp.mechanics.ground import Terrain
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.unicycle_motion import PLANE, UnicycleMotion

__all__ = ["Trajectory"]

# [rad or m, and per second] largest difference between given positions or velocities and those that
# follow from the accelerations; allows for files with rounded numbers
CONSISTENCY = 1e-6
MOST_SAMPLES = 1e7  # of `sampled`, which limits memory
SHORTEST = 1e-12  # [s, relative above one] times this close to a node are the node
HIGHER = ("snaps", "crackles")  # attributes that are None unless accelerations are curved


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Motion of n joints, and of the base if it drives, over nodes t_0 = 0 < ... < t_N.

    In interval k, from node k to node k + 1, the acceleration is a_k + j_k (t - t_k). Motions that
    were interpolated from samples by polynomials of degree five have the terms s_k (t - t_k)^2 / 2
    and c_k (t - t_k)^3 / 6 too. Positions and velocities are continuous; accelerations may jump at
    the nodes.

    Attributes:
        joint_names: Names of the n joints.
        times: Nodes, shape (N+1,) [s].
        positions: Joint coordinates at the nodes, shape (N+1, n) [rad or m].
        velocities: Joint rates at the nodes, shape (N+1, n) [rad/s or m/s].
        accelerations: Accelerations a_k at the starts of the intervals, shape (N, n) [rad/s^2 or
            m/s^2].
        jerks: Jerks j_k of the intervals, shape (N, n) [rad/s^3 or m/s^3]; None means zero, that
            is, piecewise constant accelerations.
        base: Motion of the base with the nodes of the joints; None if the base stands still.
        snaps: Fourth derivatives s_k of the positions at the starts of the intervals, shape (N, n)
            [rad/s^4 or m/s^4]; None if accelerations are linear in all intervals.
        crackles: Fifth derivatives c_k, shape (N, n) [rad/s^5 or m/s^5]; None together with snaps.

    Raises:
        TrajectoryError: Shapes differ, entries are not finite, times do not increase from 0,
            positions and velocities do not follow from the accelerations, or the base moves while
            there are snaps.
    """

    joint_names: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array
    accelerations: Array
    jerks: Any = None
    base: UnicycleMotion | None = None
    snaps: Any = None
    crackles: Any = None

    __setstate__ = set_frozen_state

    def __post_init__(self) -> None:
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        times = frozen_array(self.times, name="times", shape=(None,), error=TrajectoryError)
        count, n = len(times), len(self.joint_names)
        if count < 2:
            raise TrajectoryError(f"a trajectory needs at least 2 nodes, not {count}")
        if self.jerks is None:
            object.__setattr__(self, "jerks", np.zeros((count - 1, n)))
        shapes = {
            "positions": count,
            "velocities": count,
            "accelerations": count - 1,
            "jerks": count - 1,
        }
        if self.snaps is not None or self.crackles is not None:
            shapes |= dict.fromkeys(HIGHER, count - 1)
        for name in HIGHER:
            if name in shapes and getattr(self, name) is None:
                object.__setattr__(self, name, np.zeros((count - 1, n)))
        for name, rows in shapes.items():
            array = frozen_array(
                getattr(self, name), name=name, shape=(rows, n), error=TrajectoryError
            )
            object.__setattr__(self, name, array)
        object.__setattr__(self, "times", times)
        steps = np.diff(times)
        if times[0] != 0.0 or (steps < 0.0).any() or (times[-1] > 0.0 and (steps <= 0.0).any()):
            raise TrajectoryError("times must start at 0 and grow from node to node")
        if self.base is not None and not np.array_equal(self.base.times, times):
            raise TrajectoryError("the base moves at other times than the joints")
        if self.snaps is not None:
            self._check_higher()
        self._check_consistency(steps[:, None])

    def _check_higher(self) -> None:
        """Drop snaps and crackles that are all zero; refuse others beside a base that moves."""
        if not (self.snaps.any() or self.crackles.any()):
            for name in HIGHER:
                object.__setattr__(self, name, None)
        elif self.base is not None:
            raise TrajectoryError(
                "accelerations must be linear between nodes while the base moves: leave out snaps "
                "and crackles"
            )

    def _check_consistency(self, h: Array) -> None:
        """Raise TrajectoryError if a node does not follow from the one before; h is (N, 1) [s]."""
        with np.errstate(all="ignore"):  # what overflows does not follow
            positions, velocities, _ = self._after(np.arange(self.intervals), h)
        for name, gap in (
            ("velocities", self.velocities[1:] - velocities),
            ("positions", self.positions[1:] - positions),
        ):
            worst = np.unravel_index(np.argmax(np.abs(gap)), gap.shape)
            if not abs(gap[worst]) <= CONSISTENCY:
                raise TrajectoryError(
                    f"{name} do not follow from the accelerations: node {int(worst[0]) + 1}, joint "
                    f"{self.joint_names[worst[1]]!r} is off by {gap[worst]:.3g} "
                    "(between nodes they change by the jerks that are given, and not without)"
                )

    def locate(self, t: Array) -> tuple[Indices, Array]:
        """Find the intervals that contain given times.

        A node belongs to the interval that begins there, the last one to the last interval.

        Args:
            t: Times, shape (K,) [s]; times outside the motion count as its start or end.

        Returns:
            Indices of the intervals, and the times since their starts [s], shape (K,) each.
        """
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, self.intervals - 1)
        return k, np.clip(t, 0.0, self.duration) - self.times[k]

    def state_in(self, k: Indices, since: Array) -> tuple[Array, Array, Array]:
        """Joint states at given times within given intervals.

        Args:
            k: Indices of the intervals, shape (K,).
            since: Times since the starts of these intervals, shape (K,) [s].

        Returns:
            (q, v, a), shape (K, n) each.
        """
        return self._after(k, since[:, None])

    def _after(self, k: Indices, since: Array) -> tuple[Array, Array, Array]:
        """Joint states (q, v, a) at times `since`, shape (K, 1) [s], in the intervals k (K,)."""
        a, j = self.accelerations[k], self.jerks[k]
        v = self.velocities[k] + since * a + 0.5 * since**2 * j
        q = self.positions[k] + since * self.velocities[k] + 0.5 * since**2 * a + since**3 * j / 6.0
        a = a + since * j
        if self.snaps is None:
            return q, v, a
        s, c = self.snaps[k], self.crackles[k]
        return (
            q + since**4 * (s / 24.0 + since * c / 120.0),
            v + since**3 * (s / 6.0 + since * c / 24.0),
            a + since**2 * (0.5 * s + since * c / 6.0),
        )

    def higher_in(self, k: Indices, since: Array) -> tuple[Array, ...]:
        """Third and, if they are not zero, fourth and fifth derivatives of the positions.

        Args:
            k: Indices of the intervals, shape (K,).
            since: Times since the starts of these intervals, shape (K,) [s].

        Returns:
            Jerks, or jerks, snaps and crackles, shape (K, n) each.
        """
        j = self.jerks[k]
        if self.snaps is None:
            return (j,)
        t, s, c = since[:, None], self.snaps[k], self.crackles[k]
        return j + t * (s + 0.5 * t * c), s + t * c, c

    @property
    def duration(self) -> float:
        """Duration of the motion: time of the last node [s]."""
        return float(self.times[-1])

    @property
    def intervals(self) -> int:
        """Number N of intervals."""
        return len(self.accelerations)

    def __call__(self, t: Any) -> tuple[Array, Array, Array]:
        """Joint positions, velocities and accelerations at given times.

        At a node the acceleration is that of the interval that begins there; at the last node, that
        of the last interval.

        Args:
            t: Times within [0, duration], scalar or shape (K,) [s].

        Returns:
            (q, v, a), shape (n,) each for a scalar, (K, n) each for an array.

        Raises:
            TrajectoryError: A time is outside the trajectory or not finite.
        """
        shape = np.shape(t)
        when = frozen_array(np.atleast_1d(t), name="t", shape=(None,), error=TrajectoryError)
        slack = 1e-12 * max(1.0, self.duration)
        for outside in when[(when < -slack) | (when > self.duration + slack)]:
            raise TrajectoryError(
                f"t = {outside:.6g} s is outside the trajectory, which lasts {self.duration:.6g} s"
            )
        k, since = self.locate(when)
        q, v, a = self._after(k, since[:, None])
        return (q[0], v[0], a[0]) if shape == () else (q, v, a)

    @property
    def end_accelerations(self) -> Array:
        """Accelerations at the ends of the intervals, shape (N, n) [rad/s^2 or m/s^2]."""
        return self._after(np.arange(self.intervals), np.diff(self.times)[:, None])[2]

    def within(self, shares: Array) -> tuple[Array, Array, Array, Array]:
        """Joint states at given fractions of every interval.

        At the fractions 0 and 1 the accelerations are those of this interval, not of a neighbour.

        Args:
            shares: Fractions of the interval's length, from 0 to 1, shape (s,).

        Returns:
            Times, shape (N s,), and (q, v, a), shape (N s, n) each, ordered by interval.
        """
        since = np.outer(np.diff(self.times), shares)
        k = np.repeat(np.arange(self.intervals), len(shares))
        return ((self.times[:-1, None] + since).ravel(), *self._after(k, since.reshape(-1, 1)))

    def sampled(self, rate: float) -> tuple[Array, Array, Array, Array]:
        """States at a fixed rate, and at the end.

        Args:
            rate: Samples per second [1/s].

        Returns:
            Times 0, 1 / rate, 2 / rate, ... and the duration, shape (K,) [s]; positions, velocities
            and accelerations, shape (K, n) each. The last step may be shorter than the others.

        Raises:
            TrajectoryError: The rate is not positive, or asks for more than 10 million samples.
        """
        times = self._sample_times(rate)
        return times, *self(times)

    def _sample_times(self, rate: float) -> Array:
        """Multiples of 1 / rate within the motion, and its end."""
        rate = finite_number(rate, name="rate", error=TrajectoryError)
        if not 0.0 < rate * max(self.duration, 1e-9) <= MOST_SAMPLES or rate <= 0.0:
            raise TrajectoryError(
                f"rate must be positive and give at most {MOST_SAMPLES:.0e} samples, not {rate:g} "
                f"1/s of a motion of {self.duration:.6g} s"
            )
        times = np.arange(int(self.duration * rate) + 1) / rate
        # a sample that is at the end but for rounding is the end
        return np.append(times[times < self.duration - 1e-9 / rate], self.duration)

    def after(self, t: float) -> Trajectory:
        """The remainder of the motion from a time on, as a motion that begins at time 0.

        Positions, rates and accelerations are those of this motion, t later; the base's too.

        Args:
            t: Time within [0, duration] [s].

        Raises:
            TrajectoryError: The time is outside the motion or not finite.
        """
        t = finite_number(t, name="t", error=TrajectoryError)
        self(t)  # raises for times outside the motion
        t = min(max(t, 0.0), self.duration)
        k, since = (part[0] for part in self.locate(np.array([t])))
        if k + 1 < self.intervals and self.times[k + 1] - t <= SHORTEST * max(1.0, self.duration):
            k, since = k + 1, 0.0  # a node but for rounding
        at = np.array([k]), np.array([float(since)])
        q, v, a = self.state_in(*at)
        j, *higher = self.higher_in(*at)
        times = np.append(0.0, self.times[k + 1 :] - (self.times[k] + float(since)))

        def rest(first: Array, array: Array) -> Array:
            return np.vstack([first, array[k + 1 :]])

        base = None if self.base is None else self.base.after(int(k), float(since), times)
        snaps, crackles = (
            (None, None)
            if self.snaps is None
            else (rest(higher[0], self.snaps), rest(higher[1], self.crackles))
        )
        return Trajectory(
            self.joint_names,
            times,
            rest(q, self.positions),
            rest(v, self.velocities),
            rest(a, self.accelerations),
            rest(j, self.jerks),
            base,
            snaps,
            crackles,
        )

    def to_csv(self, path: str | Path, rate: float | None = None) -> None:
        """Write the motion as CSV, SI units, 17 significant digits.

        Without a rate there is one row per node, from which `from_csv` restores every bit. The
        columns are the time, then position, velocity, acceleration and jerk of every joint (and
        snap and crackle, if accelerations are curved), then the motion of the base, if there is
        one. Acceleration and jerk are those of the interval that begins at the node; the last row
        has the final acceleration and the last jerk.

        With a rate the rows are those of `sampled`, with positions and velocities, and pose and
        velocity of the base: what is between the rows is up to whoever reads them.

        Args:
            path: File to write.
            rate: Rows per second [1/s]; None writes the nodes.

        Raises:
            TrajectoryError: See `sampled`.
        """
        from zmp_sqp.motion.trajectory_csv import write_csv, write_csv_samples

        if rate is None:
            write_csv(path, self.joint_names, self.times, self.node_rows(), self.base)
            return
        times = self._sample_times(rate)
        q, v, _ = self(times)
        base = None if self.base is None else np.hstack(self.base(times)[:2])
        write_csv_samples(path, self.joint_names, times, (q, v), base)

    def to_json(self, path: str | Path) -> None:
        """Write the motion as JSON, with the fields of ROS's trajectory_msgs/JointTrajectory.

        These fields are `joint_names` and `points`. Each point has three more fields: `jerks`,
        `time` in full precision and, if the base moves, `base` with its columns of `to_csv`. The
        file is for `from_json`; a ROS controller would play quintics through its accelerations,
        which is another motion: `zmp_sqp.export_motion` writes what it plays as planned.

        Args:
            path: File to write.
        """
        from zmp_sqp.motion.trajectory_json import write_json

        write_json(path, self.joint_names, self.times, self.node_rows(), self.base)

    def node_rows(self) -> tuple[Array, ...]:
        """Positions and their derivatives at the nodes, shape (N+1, n) each.

        Derivatives from the second on are those of the interval that begins at the node; those of
        the last node are the final ones of the last interval.
        """
        last = np.array([self.intervals - 1]), np.diff(self.times)[-1:]
        rows = [self.positions, self.velocities]
        rows.append(np.vstack([self.accelerations, self.end_accelerations[-1:]]))
        higher = [self.jerks] if self.snaps is None else [self.jerks, self.snaps, self.crackles]
        final = self.higher_in(*last)
        rows += [np.vstack(pair) for pair in zip(higher, final, strict=True)]
        return tuple(rows)

    @classmethod
    def from_json(cls, path: str | Path, machine: Machine, ground: Terrain = PLANE) -> Trajectory:
        """Read a motion in the format of `to_json`.

        Joints may be in any order. Jerks may be left out and are zero then.

        Args:
            path: File to read.
            machine: Machine whose joints the file must have.
            ground: Ground on which the base drives, if the motion has one; all planes are
                equivalent.

        Raises:
            ProblemError: The base leaves the map.
            TrajectoryError: The file cannot be read, has other joints than the machine, lacks a
                field, or does not contain a consistent motion.
        """
        from zmp_sqp.motion.trajectory_json import read_json

        return cls.from_rows(machine, *read_json(path, machine.joint_names, ground))

    @classmethod
    def from_csv(cls, path: str | Path, machine: Machine, ground: Terrain = PLANE) -> Trajectory:
        """Read a motion in the format of `to_csv`.

        Columns may be in any order. Jerks may be left out and are zero then.

        Args:
            path: File to read.
            machine: Machine whose joints the file must have.
            ground: Ground on which the base drives, if the motion has one; all planes are
                equivalent.

        Raises:
            ProblemError: The base leaves the map.
            TrajectoryError: The file cannot be read, lacks a column, has an unknown one, or does
                not contain a consistent motion.
        """
        from zmp_sqp.motion.trajectory_csv import read_csv

        return cls.from_rows(machine, *read_csv(path, machine.joint_names, ground))

    @classmethod
    def from_rows(
        cls, machine: Machine, times: Array, rows: Sequence[Array], base: UnicycleMotion | None
    ) -> Trajectory:
        """Trajectory from nodes, the inverse of `node_rows`.

        Args:
            machine: Gives the joints.
            times: Nodes, shape (N+1,) [s].
            rows: Positions, velocities, accelerations, and jerks or more, shape (N+1, n) each.
            base: Motion of the base.

        Raises:
            TrajectoryError: No consistent motion.
        """
        position, velocity, acceleration, *higher = rows
        joints = machine.joint_names, times, position, velocity, acceleration[:-1]
        jerk, snap, crackle = (*(part[:-1] for part in higher), None, None, None)[:3]
        return cls(*joints, jerk, base, snap, crackle)
