"""Joint motion with piecewise linear accelerations, evaluated exactly at any time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, Indices, frozen_array
from zmp_sqp.errors import TrajectoryError
from zmp_sqp.mechanics.ground import Terrain
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.trajectory_csv import read_csv, write_csv
from zmp_sqp.motion.trajectory_json import read_json, write_json
from zmp_sqp.motion.unicycle_motion import PLANE, UnicycleMotion

__all__ = ["Trajectory"]

# [rad or m, and per second] largest difference between given positions or velocities and those that
# follow from the accelerations; allows for files with rounded numbers
CONSISTENCY = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Motion of n joints, and of the base if it drives, over nodes t_0 = 0 < ... < t_N.

    In interval k, from node k to node k + 1, the acceleration is a_k + j_k (t - t_k). Positions and
    velocities are continuous; accelerations may jump at the nodes.

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

    Raises:
        TrajectoryError: Shapes differ, entries are not finite, times do not increase from 0, or
            positions and velocities do not follow from the accelerations.
    """

    joint_names: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array
    accelerations: Array
    jerks: Any = None
    base: UnicycleMotion | None = None

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
        self._check_consistency(steps[:, None])

    def _check_consistency(self, h: Array) -> None:
        """Raise TrajectoryError if a node does not follow from the one before; h is (N, 1) [s]."""
        positions, velocities, _ = self._after(np.arange(self.intervals), h)
        for name, gap in (
            ("velocities", self.velocities[1:] - velocities),
            ("positions", self.positions[1:] - positions),
        ):
            worst = np.unravel_index(np.argmax(np.abs(gap)), gap.shape)
            if abs(gap[worst]) > CONSISTENCY:
                raise TrajectoryError(
                    f"{name} do not follow from the accelerations: node {int(worst[0]) + 1}, joint "
                    f"{self.joint_names[worst[1]]!r} is off by {gap[worst]:.3g} "
                    "(accelerations run linearly from node to node)"
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
        return q, v, a + since * j

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
        return np.asarray(self.accelerations + np.diff(self.times)[:, None] * self.jerks)

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

    def to_csv(self, path: str | Path) -> None:
        """Write the motion as CSV, one row per node, SI units, 17 significant digits.

        The columns are the time, then position, velocity, acceleration and jerk of every joint,
        then the motion of the base, if there is one. Acceleration and jerk are those of the
        interval that begins at the node; the last row has the final acceleration and the last jerk.

        Args:
            path: File to write.
        """
        write_csv(path, self.joint_names, self.times, self._node_rows(), self.base)

    def to_json(self, path: str | Path) -> None:
        """Write the motion as JSON, with the fields of ROS's trajectory_msgs/JointTrajectory.

        These fields are `joint_names` and `points`. Each point has three more fields: `jerks`,
        `time` in full precision and, if the base moves, `base` with its columns of `to_csv`.

        Args:
            path: File to write.
        """
        write_json(path, self.joint_names, self.times, self._node_rows(), self.base)

    def _node_rows(self) -> tuple[Array, Array, Array, Array]:
        """Positions, velocities, accelerations and jerks at the nodes, shape (N+1, n) each."""
        accelerations = np.vstack([self.accelerations, self.end_accelerations[-1:]])
        return (
            self.positions,
            self.velocities,
            accelerations,
            np.vstack([self.jerks, self.jerks[-1:]]),
        )

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
        return cls._from_rows(machine, *read_json(path, machine.joint_names, ground))

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
        return cls._from_rows(machine, *read_csv(path, machine.joint_names, ground))

    @classmethod
    def _from_rows(
        cls, machine: Machine, times: Array, rows: list[Array], base: UnicycleMotion | None
    ) -> Trajectory:
        """Trajectory from the inverse of `_node_rows`."""
        position, velocity, acceleration, jerk = rows
        return cls(
            machine.joint_names, times, position, velocity, acceleration[:-1], jerk[:-1], base
        )
