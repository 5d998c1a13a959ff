"""How the root of the machine moves along a trajectory, and the ZMP that follows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.bounds.root_bounds import root_bounds
from zmp_sqp.mechanics.ground import Ground, terrain_of
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.mechanics.wrench import ground_reaction
from zmp_sqp.mechanics.zero_moment_point import zmp_of_wrench
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.motion.unicycle_motion import UnicycleMotion

__all__ = [
    "check_tracks",
    "with_ground",
    "root_motion",
    "root_motion_bounds",
    "surface_bounds",
    "trajectory_zmp",
]

TRACK_STEP = 0.25  # [m] between poses at which the ground under the tracks is looked at
TURN_STEP = 0.1  # [rad] likewise
MOST_POSES = 20_000  # likewise
# [m] by which the boxes are wider, for places that are not known exactly; see `place_error`
STRAY = 1e-3


def root_motion(
    trajectory: Trajectory, gravity: Array, k: Indices, since: Array, *, height: float = 0.0
) -> tuple[Array | None, Array]:
    """Twist of the root and its spatial acceleration less gravity at times `since` in the intervals k, root axes.

    Args:
        trajectory: With or without a base motion.
        gravity: In the root frame of a machine that stands still, shape (3,) [m/s^2]; a base has
            its own ground.
        k: Intervals, shape (K,).
        since: Times after their starts, shape (K,) [s].
        height: Of the ground in the root frame [m].

    Returns:
        Twist, shape (K, 6), or None for a standing base; acceleration, shape (6,) or (K, 6).
    """
    if trajectory.base is None:
        return None, np.concatenate([-gravity, np.zeros(3)])
    motion = trajectory.base.ground.base_motion(
        *trajectory.base.state_in(k, since)
    ).at_support_height(height)
    return motion.velocity, motion.acceleration


def root_motion_bounds(
    base: UnicycleMotion, k: Indices, since: Array, length: Array, *, height: float
) -> Array:
    """Bounds on the motion of the root over stretches of the intervals k, see `root_bounds`, shape (2, 4, K).

    Args:
        base: The motion.
        k: Intervals, shape (K,).
        since: When the stretches begin, after the starts of the intervals, shape (K,) [s].
        length: How long they last, shape (K,) [s].
        height: Of the ground in the root frame [m].
    """
    return root_bounds(
        base.peaks(k, since, length), surface_bounds(base, k, since, length), abs(height)
    )


def check_tracks(base: UnicycleMotion, support: SupportPolygon) -> None:
    """Refuse a path whose ground the tracks cannot follow, looked at every `TRACK_STEP` and `TURN_STEP`.

    Raises:
        ProblemError: The ground is too rough, or not on the map under the tracks; the message says
            where.
    """
    if base.ground.uniform:
        return
    k, h = np.arange(len(base.jerks)), np.diff(base.times)
    peaks = base.peaks(k, 0.0 * h, h)[:, 0]
    parts = np.ceil(np.maximum(h * peaks[0] / TRACK_STEP, h * peaks[1] / TURN_STEP)).clip(
        1, MOST_POSES // len(h) + 1
    )
    t = [
        start + step * np.arange(count) / count
        for start, step, count in zip(base.times, h, parts, strict=False)
    ]
    base.ground.check_followable(support, base(np.append(np.concatenate(t), base.times[-1]))[0])


def surface_bounds(base: UnicycleMotion, k: Indices, since: Array, length: Array) -> Array:
    """Bounds on the derivatives of the ground's height under the base over stretches, shape (5, K).

    The path's length bounds how far the base strays from the middle between the two ends of a
    stretch.

    Args:
        base, k, since, length: As in `root_motion_bounds`.
    """
    if base.ground.uniform:
        return np.zeros((5, len(k)))
    peaks = base.peaks(k, since, length)
    ends = [base.state_in(k, at)[0][:, :2] for at in (since, since + length)]
    stray = 0.5 * (peaks[0, 0] * length)[:, None] + STRAY
    middle = 0.5 * (ends[0] + ends[1])
    return base.ground.derivative_bounds(middle - stray, middle + stray)


def with_ground(trajectory: Trajectory, ground: Ground) -> Trajectory:
    """The trajectory with its base, if it has one, on this ground.

    Raises:
        ProblemError: No base can drive on it, or it leaves the map.
        TrajectoryError: The base's places do not follow from its accelerations there.
    """
    if trajectory.base is None:
        return trajectory
    base = trajectory.base.on(terrain_of(ground))
    return trajectory if base is trajectory.base else replace(trajectory, base=base)


def trajectory_zmp(machine: Machine, trajectory: Trajectory, t: Any, ground: Ground) -> Array:
    """ZMP along a motion, in the root frame, from the complete wrench: of the base's motion too, if there is one.

    Args:
        machine: The machine; its joints must be the trajectory's.
        trajectory: The motion.
        t: Times, scalar or shape (K,) [s]; at a node the interval that begins there counts.
        ground: What the machine stands on.

    Returns:
        Shape (2,) for a scalar, (K, 2) for an array [m].

    Raises:
        ProblemError: The trajectory has other joints, or its base moves on other ground than a
            plane.
        TrajectoryError: A time outside the trajectory.
        ContactLost: The ground would have to pull.
    """
    if trajectory.joint_names != machine.joint_names:
        raise ProblemError(
            f"the trajectory moves {trajectory.joint_names}, the machine has {machine.joint_names}"
        )
    trajectory, height = (
        with_ground(trajectory, ground),
        0.0 if machine.support is None else machine.support.height,
    )
    states = trajectory(np.atleast_1d(t))
    k, since = trajectory.locate(np.atleast_1d(np.asarray(t, dtype=np.float64)))
    # a base has its own ground
    gravity = ground.gravity() if trajectory.base is None else np.zeros(3)
    twist, root = root_motion(trajectory, gravity, k, since, height=height)
    wrench = ground_reaction(machine, *states, root_acceleration=root, root_velocity=twist)
    points = zmp_of_wrench(wrench, height)
    return points[0] if np.shape(t) == () else points
