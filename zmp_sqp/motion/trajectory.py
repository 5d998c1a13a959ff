"""A motion with piecewise linear accelerations: exact between its nodes."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, Indices, frozen_array
from zmp_sqp.errors import TrajectoryError
from zmp_sqp.mechanics.ground import Terrain
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.trajectory_json import read_json, write_json
from zmp_sqp.motion.unicycle_motion import BASE_COLUMNS, PLANE, UnicycleMotion

__all__ = ["Trajectory"]

# [rad or m, and per second] how far a file's positions may be from what its accelerations give
CONSISTENCY = 1e-6
QUANTITIES = ("position", "velocity", "acceleration", "jerk")


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Joint motion over nodes t_0 = 0 < ... < t_N.

    From node k until node k + 1 the acceleration is a_k + j_k (t - t_k); it may jump at the nodes.

    Attributes:
        joint_names: The n joints.
        times: Nodes, shape (N+1,) [s].
        positions: At the nodes, shape (N+1, n) [rad or m].
        velocities: At the nodes, shape (N+1, n) [rad/s or m/s].
        accelerations: At the starts of the intervals, shape (N, n) [rad/s^2 or m/s^2].
        jerks: On the intervals, shape (N, n) [rad/s^3 or m/s^3]; None for piecewise constant
            accelerations.
        base: Motion of the base, callable like this one; None stands still.

    Raises:
        TrajectoryError: Shapes differ, entries are not finite, times do not grow from 0, or
            positions and velocities are not those that the accelerations produce.
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
        places, rates, _ = self._after(np.arange(self.intervals), h)
        for name, gap in (
            ("velocities", self.velocities[1:] - rates),
            ("positions", self.positions[1:] - places),
        ):
            worst = np.unravel_index(np.argmax(np.abs(gap)), gap.shape)
            if abs(gap[worst]) > CONSISTENCY:
                raise TrajectoryError(
                    f"{name} do not follow from the accelerations: node {int(worst[0]) + 1}, joint "
                    f"{self.joint_names[worst[1]]!r} is off by {gap[worst]:.3g} "
                    "(accelerations run linearly from node to node)"
                )

    def locate(self, t: Array) -> tuple[Indices, Array]:
        """Intervals of times, shape (K,), and the times since their starts [s]."""
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, self.intervals - 1)
        return k, np.clip(t, 0.0, self.duration) - self.times[k]

    def state_in(self, k: Indices, since: Array) -> tuple[Array, Array, Array]:
        """States (q, v, a) in the intervals k at times `since` after their starts, shape (K,) each [s]."""
        return self._after(k, since[:, None])

    def _after(self, k: Indices, since: Array) -> tuple[Array, Array, Array]:
        a, j = self.accelerations[k], self.jerks[k]
        v = self.velocities[k] + since * a + 0.5 * since**2 * j
        q = self.positions[k] + since * self.velocities[k] + 0.5 * since**2 * a + since**3 * j / 6.0
        return q, v, a + since * j

    @property
    def duration(self) -> float:
        """Time of the last node [s]."""
        return float(self.times[-1])

    @property
    def intervals(self) -> int:
        """Number N of intervals."""
        return len(self.accelerations)

    def __call__(self, t: Any) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations at any time; exact.

        At a node the acceleration is that of the interval which begins there; at the end, of the
        last one.

        Args:
            t: Scalar or shape (K,) [s], within [0, duration].

        Returns:
            (q, v, a), shape (n,) each for a scalar, (K, n) each for an array.

        Raises:
            TrajectoryError: A time outside the trajectory or not finite.
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
        """States inside every interval, each with that interval's own acceleration.

        Args:
            shares: Of each interval gone by, shape (s,), from 0 to 1.

        Returns:
            (t, q, v, a), shapes (N s,) and (N s, n), interval by interval.
        """
        since = np.outer(np.diff(self.times), shares)
        k = np.repeat(np.arange(self.intervals), len(shares))
        return ((self.times[:-1, None] + since).ravel(), *self._after(k, since.reshape(-1, 1)))

    def to_csv(self, path: str | Path) -> None:
        """One row per node: time, then position, velocity, acceleration and jerk of every joint; 17 digits, SI units.

        Acceleration and jerk are those of the interval that begins there; the last row holds the
        final acceleration. A base adds its columns.
        """
        header = [
            "time",
            *(f"{joint}.{quantity}" for quantity in QUANTITIES for joint in self.joint_names),
        ]
        accelerations = np.vstack([self.accelerations, self.end_accelerations[-1:]])
        jerks = np.vstack([self.jerks, self.jerks[-1:]])
        table = np.column_stack([self.times, self.positions, self.velocities, accelerations, jerks])
        if self.base is not None:
            header, table = [*header, *BASE_COLUMNS], np.hstack([table, self.base.table()])
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            writer.writerows([format(entry, ".17g") for entry in row] for row in table)

    def to_json(self, path: str | Path) -> None:
        """The fields of ROS's trajectory_msgs/JointTrajectory: joint_names and points, and beside them what it lacks.

        A point also has `jerks`, `time` to the last digit, and with a base `base`: the columns of
        `to_csv` by name.
        """
        accelerations = np.vstack([self.accelerations, self.end_accelerations[-1:]])
        rows = (
            self.positions,
            self.velocities,
            accelerations,
            np.vstack([self.jerks, self.jerks[-1:]]),
        )
        write_json(path, self.joint_names, self.times, rows, self.base)

    @classmethod
    def from_json(cls, path: str | Path, machine: Machine, ground: Terrain = PLANE) -> Trajectory:
        """Trajectory from a file as `to_json` writes it; joints may come in any order, jerks may be left out (zero).

        Args:
            path: The file.
            machine: Whose joints are looked for.
            ground: What the base, if there is one, drives on; the same for all planes.

        Raises:
            ProblemError: The base leaves the map.
            TrajectoryError: The file cannot be read, has other joints than the machine, lacks a
                field, or holds something that is not a consistent motion.
        """
        times, (position, velocity, acceleration, jerk), base = read_json(
            path, machine.joint_names, ground
        )
        return cls(
            machine.joint_names, times, position, velocity, acceleration[:-1], jerk[:-1], base
        )

    @classmethod
    def from_csv(cls, path: str | Path, machine: Machine, ground: Terrain = PLANE) -> Trajectory:
        """Trajectory from a file as `to_csv` writes it; columns may come in any order, jerks may be left out (zero).

        Args:
            path: The file.
            machine: Whose joints are looked for.
            ground: What the base, if there is one, drives on; the same for all planes.

        Raises:
            ProblemError: The base leaves the map.
            TrajectoryError: The file cannot be read, lacks a column of one of the machine's joints,
                has one that the machine does not know, or holds something that is not a consistent
                motion.
        """
        names = machine.joint_names
        wanted = ["time", *(f"{joint}.{quantity}" for quantity in QUANTITIES for joint in names)]
        try:
            with Path(path).open(newline="", encoding="utf-8-sig") as file:
                rows = [row for row in csv.reader(file) if row]
        except (OSError, UnicodeDecodeError, csv.Error) as cause:
            raise TrajectoryError(f"cannot read {path}: {cause}") from None
        header = [name.strip() for name in rows[0]] if rows else []
        if not any(column.endswith(f".{QUANTITIES[3]}") for column in header):
            wanted = wanted[: 1 + 3 * len(names)]
        joint_columns = len(wanted)
        if BASE_COLUMNS[0] in header:
            wanted += [name for name in BASE_COLUMNS if name in header or not name.endswith("jerk")]
        for column in wanted:
            if header.count(column) != 1:
                raise TrajectoryError(
                    f"{path}: column {column!r} must be there once, but is there {header.count(column)} times"
                )
        for column in header:
            if column not in wanted:
                raise TrajectoryError(
                    f"{path}: unknown column {column!r}; the machine's joints are {', '.join(names)}"
                )
        table = np.empty((len(rows) - 1, len(header)))
        for number, row in enumerate(rows[1:]):
            try:
                if len(row) != len(header):
                    raise ValueError(f"it has {len(row)} entries")
                table[number] = [float(entry) for entry in row]
            except ValueError as cause:
                raise TrajectoryError(
                    f"{path}: row {number + 2} is not {len(header)} numbers: {cause}"
                ) from None
        table = table[:, [header.index(column) for column in wanted]]
        n = len(names)
        motion = table[:, :joint_columns]
        position, velocity, acceleration, jerk = (
            motion[:, 1 + i * n : 1 + (i + 1) * n] for i in range(4)
        )
        base = None
        if table.shape[1] > joint_columns:
            columns = wanted[joint_columns:]
            absent = np.zeros(len(table))
            given = dict(zip(columns, table[:, joint_columns:].T, strict=True))
            parts = [given.get(name, absent) for name in BASE_COLUMNS]
            base = UnicycleMotion.from_table(table[:, 0], np.column_stack(parts), ground)
        return cls(
            names,
            table[:, 0],
            position,
            velocity,
            acceleration[:-1],
            jerk[:-1] if jerk.size else None,
            base,
        )
