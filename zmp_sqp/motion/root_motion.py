"""Motion of the machine's root along a trajectory, and the ZMP that results from it."""

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
    "root_motion",
    "root_motion_bounds",
    "surface_bounds",
    "trajectory_zmp",
    "with_ground",
]

# largest distance [m] and yaw angle [rad] between two poses of a path at which the ground under the
# tracks is checked, and the largest number of such poses, which limits time and memory
TRACK_STEP = 0.25
TURN_STEP = 0.1
MOST_POSES = 20_000
# [m] margin by which boxes around the base's path are enlarged, because its positions are computed
# with an error; the proof computes this error and fails if it is larger
STRAY = 1e-3


def root_motion(
    trajectory: Trajectory, gravity: Array, k: Indices, since: Array, *, height: float = 0.0
) -> tuple[Array | None, Array]:
    """Twist of the root, and its spatial acceleration minus gravity, at K times.

    Args:
        trajectory: Motion with or without a moving base.
        gravity: Gravity in the root frame of a base that stands still, shape (3,) [m/s^2]; not
            used for a base that moves, because its motion includes its ground.
        k: Indices of the intervals, shape (K,).
        since: Times since the starts of these intervals, shape (K,) [s].
        height: z of the support plane in the root frame [m].

    Returns:
        Twist in the root frame, shape (K, 6) [m/s, rad/s], or None if the base stands still;
        acceleration in the root frame, shape (K, 6), or (6,) if the base stands still [m/s^2,
        rad/s^2].
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
    """Bounds on the motion of the root over K subintervals.

    Args:
        base: Motion of the base.
        k: Index of the interval that contains each subinterval, shape (K,).
        since: Start of each subinterval, measured from the start of its interval, shape (K,) [s].
        length: Duration of each subinterval, shape (K,) [s].
        height: z of the support plane in the root frame [m].

    Returns:
        Bounds in the form of `root_bounds`, shape (2, 4, K).
    """
    return root_bounds(
        base.peaks(k, since, length), surface_bounds(base, k, since, length), abs(height)
    )


def check_tracks(base: UnicycleMotion, support: SupportPolygon) -> None:
    """Raise ProblemError if the ground along a path is too uneven for the tracks.

    The ground is checked at poses of the path at most `TRACK_STEP` and `TURN_STEP` apart, unless
    that would be more than `MOST_POSES` poses.

    Args:
        base: Motion of the base.
        support: Support polygon of the tracks, root frame.

    Raises:
        ProblemError: The ground is too uneven, or the tracks leave the map; the message says where.
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
    """Bounds on the derivatives of the ground's height under the base over K subintervals.

    In a subinterval, the base stays within half the path length of the midpoint between the two end
    positions.

    Args:
        base: Motion of the base.
        k: Index of the interval that contains each subinterval, shape (K,).
        since: Start of each subinterval, measured from the start of its interval, shape (K,) [s].
        length: Duration of each subinterval, shape (K,) [s].

    Returns:
        Bounds in the form of `Terrain.derivative_bounds`, shape (5, K).
    """
    if base.ground.uniform:
        return np.zeros((5, len(k)))
    peaks = base.peaks(k, since, length)
    ends = [base.state_in(k, at)[0][:, :2] for at in (since, since + length)]
    radius = 0.5 * (peaks[0, 0] * length)[:, None] + STRAY
    middle = 0.5 * (ends[0] + ends[1])
    return base.ground.derivative_bounds(middle - radius, middle + radius)


def with_ground(trajectory: Trajectory, ground: Ground) -> Trajectory:
    """Trajectory whose base, if it moves, drives on the given ground.

    Raises:
        ProblemError: No base can drive on this ground, or the base leaves the map.
        TrajectoryError: On this ground, the positions of the base do not follow from its
            accelerations.
    """
    if trajectory.base is None:
        return trajectory
    base = trajectory.base.on(terrain_of(ground))
    return trajectory if base is trajectory.base else replace(trajectory, base=base)


def trajectory_zmp(machine: Machine, trajectory: Trajectory, t: Any, ground: Ground) -> Array:
    """Zero moment point along a motion of joints and base.

    Args:
        machine: Machine with the joints of the trajectory.
        trajectory: Motion of the machine.
        t: Times, scalar or shape (K,) [s]; at a node, the acceleration is that of the interval that
            begins there.
        ground: Ground on which the machine stands or drives.

    Returns:
        ZMP in the root frame, shape (2,) for a scalar, (K, 2) for an array [m].

    Raises:
        ProblemError: The trajectory has other joints than the machine, or its base moves and cannot
            drive on this ground.
        TrajectoryError: A time is outside the trajectory, or on this ground the positions of the
            base do not follow from its accelerations.
        ContactLost: The ground would have to pull at the machine.
    """
    if trajectory.joint_names != machine.joint_names:
        raise ProblemError(
            f"the trajectory moves the joints {', '.join(trajectory.joint_names)}; the machine has "
            f"{', '.join(machine.joint_names)}"
        )
    trajectory = with_ground(trajectory, ground)
    height = 0.0 if machine.support is None else machine.support.height
    states = trajectory(np.atleast_1d(t))
    k, since = trajectory.locate(np.atleast_1d(np.asarray(t, dtype=np.float64)))
    # the motion of a moving base includes its ground's gravity
    gravity = ground.gravity() if trajectory.base is None else np.zeros(3)
    twist, root = root_motion(trajectory, gravity, k, since, height=height)
    wrench = ground_reaction(machine, *states, root_acceleration=root, root_velocity=twist)
    points = zmp_of_wrench(wrench, height)
    return points[0] if np.shape(t) == () else points
