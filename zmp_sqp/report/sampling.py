"""Samples of a motion: states, root, ZMP, and the room that every constraint leaves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.mechanics import Ground, Heightmap, Machine
from zmp_sqp.mechanics.ground import terrain_of
from zmp_sqp.mechanics.uncertainty import Corner
from zmp_sqp.mechanics.zero_moment_point import zmp_of_wrench
from zmp_sqp.motion.root_motion import with_ground
from zmp_sqp.planning import Problem, Trajectory
from zmp_sqp.planning.constraints.binding import bound_rows
from zmp_sqp.planning.constraints.protocol import MotionSample, PathConstraint
from zmp_sqp.planning.constraints.tip_over import Contact, TipOver
from zmp_sqp.planning.proof.corner_efforts import CornerEfforts, grouped

__all__ = ["ConstraintRoom", "MotionSamples", "root_at_rest", "root_on", "root_poses"]


@dataclass(frozen=True, slots=True, eq=False)
class ConstraintRoom:
    """Room that a motion leaves to one constraint, the least of all rows and corners.

    Attributes:
        name: Name of the constraint.
        units: Unit of each row.
        room: Room at K times, shape (K,); -inf where it has no value.
        row: Index in `labels` of the row with the least room, shape (K,).
        labels: Rows in words.
        every: Room of every row at the worst corner, shape (K, R).
    """

    name: str
    units: tuple[str, ...]
    room: Array
    row: Indices
    labels: tuple[str, ...]
    every: Array


@dataclass(frozen=True, slots=True, eq=False)
class MotionSamples:
    """K samples of a motion, the ends of every interval included.

    At a node there are two samples, because accelerations may jump there.

    Attributes:
        times: Shape (K,) [s].
        states: Joint coordinates, rates and accelerations, shape (3, K, n).
        base: Pose (K, 3), rates (K, 2) and accelerations (K, 2) of a base that drives; or None.
        root_positions, root_rotations: Root in the ground frame, shape (K, 3) [m] and (K, 3, 3);
            one entry if the base stands.
        zmp: Zero moment point with payload and slope as given, root frame, shape (K, 2) [m]; NaN
            where the ground would have to pull.
        rooms: Room left to tip-over, contact and the problem's own constraints.
    """

    times: Array
    states: Array
    base: tuple[Array, Array, Array] | None
    root_positions: Array
    root_rotations: Array
    zmp: Array
    rooms: tuple[ConstraintRoom, ...]

    @classmethod
    def of(cls, problem: Problem, trajectory: Trajectory, count: int) -> MotionSamples:
        """Sample a motion.

        Args:
            problem: Gives machine, ground, constraints and what is uncertain.
            trajectory: The motion.
            count: Number of samples, about; every interval has two at least.
        """
        driven = with_ground(trajectory, problem.ground)
        interval, since = _instants(driven, count)
        states = np.stack(driven.state_in(interval, since))
        base = None if driven.base is None else driven.base.state_in(interval, since)
        nominal = Corner(problem.machine, problem.ground)
        wrench = CornerEfforts((nominal,), driven, joints=False).at(interval, since)[:, 0]
        poses = np.zeros((1, 3)) if base is None else base[0]
        positions, rotations = root_poses(problem, poses)
        with np.errstate(all="ignore"):  # efforts of a motion that failed may overflow
            rooms = _rooms(problem, driven, interval, since)
        return cls(
            driven.times[interval] + since,
            states,
            base,
            positions,
            rotations,
            _zmp(wrench, _height(problem.machine)),
            rooms,
        )


def _instants(trajectory: Trajectory, count: int) -> tuple[Indices, Array]:
    """Interval of each sample, and its time after the start of that interval [s]."""
    steps = np.diff(trajectory.times)
    per_second = count / trajectory.duration if trajectory.duration > 0.0 else 0.0
    numbers = 2 + (per_second * steps).astype(int)
    since = [np.linspace(0.0, step, number) for step, number in zip(steps, numbers, strict=True)]
    return np.repeat(np.arange(len(steps)), numbers), np.concatenate(since)


def _height(machine: Machine) -> float:
    support = machine.support
    return 0.0 if support is None else support.height


def root_poses(problem: Problem, poses: Array) -> tuple[Array, Array]:
    """Root in the ground frame, whose plane is that of the support polygon where it is flat."""
    if isinstance(problem.ground, Heightmap) or problem.base is not None:
        return root_on(problem.machine, problem.ground, poses)
    position, rotation = root_on(problem.machine, problem.ground, None)
    return np.tile(position, (len(poses), 1)), np.tile(rotation, (len(poses), 1, 1))


def root_at_rest(problem: Problem) -> tuple[Array, Array]:
    """Position (3,) [m] and rotation (3, 3) in the ground frame of a root that stands still."""
    positions, rotations = root_poses(problem, np.zeros((1, 3)))
    return positions[0], rotations[0]


def root_on(machine: Machine, ground: Ground, poses: Array | None) -> tuple[Array, Array]:
    """Root in the ground frame, for a machine without a problem.

    Args:
        machine: Gives the height of its support polygon.
        ground: The ground.
        poses: (x, y, yaw) of a base that drives or stands on terrain, shape (K, 3) [m, m, rad];
            None for one that stands at the origin of a plane, K = 1.

    Returns:
        Positions (K, 3) [m] and rotations (K, 3, 3).
    """
    if poses is None:
        positions, rotations = np.zeros((1, 3)), np.eye(3)[None]
    else:
        positions, rotations = terrain_of(ground).base_pose(poses)
    return positions - _height(machine) * rotations[:, :, 2], rotations


def _zmp(wrench: Array, height: float) -> Array:
    """ZMP of each wrench (K, 6), shape (K, 2) [m]; NaN where the ground would have to pull."""
    pressed = (wrench[:, 2] > 0.0) & np.isfinite(wrench).all(axis=1)
    found = np.full((len(wrench), 2), np.nan)
    if pressed.any():
        found[pressed] = zmp_of_wrench(wrench[pressed], height)
    return found


def _rooms(
    problem: Problem, driven: Trajectory, interval: Indices, since: Array
) -> tuple[ConstraintRoom, ...]:
    """Room left to each constraint, at the worst corner."""
    constraints: tuple[PathConstraint, ...] = (TipOver(), Contact(), *problem.own_constraints)
    states = driven.state_in(interval, since)
    found: list[Any] = [None] * len(constraints)
    for group in grouped(problem.corners(every=True), driven):
        rows = [bound_rows(constraints, corner.machine, problem.coordinates) for corner in group]
        joints = any(part.needs_joint_efforts for part in rows[0])
        motion = with_ground(driven, group[0].ground)
        every = CornerEfforts(group, motion, joints).at(interval, since)
        for number, corner in enumerate(group):
            efforts = every[:, number]
            sample = MotionSample(corner.machine, *states, efforts)
            for i, part in enumerate(rows[number]):
                room = part.room(sample)
                found[i] = room if found[i] is None else np.minimum(found[i], room)
    names = [constraint.name for constraint in constraints]
    return tuple(_worst(name, rows[0][i], found[i]) for i, name in enumerate(names))


def _worst(name: str, rows: Any, room: Array) -> ConstraintRoom:
    """Room of the row that has the least, (K,), relative to what the rows resolve."""
    scale = np.where(np.isfinite(rows.resolution), rows.resolution, 1.0)
    row = np.argmin(room / scale, axis=1)
    least = room[np.arange(len(row)), row]
    return ConstraintRoom(name, tuple(rows.units), least, row, tuple(rows.labels), room)
