"""How the root of the machine moves along a trajectory, and the ZMP that follows."""

from __future__ import annotations

from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.ground import Ground, Slope
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import ground_reaction
from zmp_sqp.mechanics.zero_moment_point import zmp_of_wrench
from zmp_sqp.planning.driving_model import turned_gravity
from zmp_sqp.planning.trajectory import Trajectory

__all__ = ["root_motion", "trajectory_zmp"]


def root_motion(trajectory: Trajectory, gravity: Array, k: Indices, since: Array) -> tuple[Array | None, Array]:
    """Twist of the root and its spatial acceleration less gravity at times `since` in the intervals k, root axes.

    Args:
        trajectory: With or without a base motion.
        gravity: In the root frame at yaw zero, shape (3,) [m/s^2]; a base moves on a plane, which turns it.
        k: Intervals, shape (K,).
        since: Times after their starts, shape (K,) [s].

    Returns:
        Twist, shape (K, 6), or None for a standing base; acceleration, shape (6,) or (K, 6).
    """
    if trajectory.base is None:
        return None, np.concatenate([-gravity, np.zeros(3)])
    pose, velocity, acceleration = trajectory.base.state_in(k, since)
    twist, root = np.zeros((2, len(pose), 6))
    twist[:, [0, 5]], root[:, [0, 5]] = velocity, acceleration
    root[:, :3] -= turned_gravity(gravity, pose[:, 2])[0]
    return twist, root


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
        ProblemError: The trajectory has other joints, or its base moves on other ground than a plane.
        TrajectoryError: A time outside the trajectory.
        ContactLost: The ground would have to pull.
    """
    if trajectory.joint_names != machine.joint_names:
        raise ProblemError(f"the trajectory moves {trajectory.joint_names}, the machine has {machine.joint_names}")
    if trajectory.base is not None and not isinstance(ground, Slope):
        raise ProblemError(f"a base moves on a Slope, not on {type(ground).__name__}")
    states = trajectory(np.atleast_1d(t))
    k, since = trajectory.place_in(np.atleast_1d(np.asarray(t, dtype=np.float64)))
    twist, root = root_motion(trajectory, ground.gravity(), k, since)
    wrench = ground_reaction(machine, *states, root_acceleration=root, root_velocity=twist)
    points = zmp_of_wrench(wrench, 0.0 if machine.support is None else machine.support.height)
    return points[0] if np.shape(t) == () else points
