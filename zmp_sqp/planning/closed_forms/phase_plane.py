"""Phase-plane method: synchronised bang-coast-bang motions that ignore stability."""

from __future__ import annotations

from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, frozen_array
from zmp_sqp.errors import GIVE_LIMITS, ProblemError
from zmp_sqp.mechanics.limits import position_fault
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.double_integrator import minimum_time
from zmp_sqp.motion.trajectory import Trajectory

__all__ = ["phase_plane"]


def phase_plane(machine: Machine, start: Any, goal: Any) -> Trajectory:
    r"""Fastest motion from rest to rest within the joint limits; the ZMP is ignored.

    This is the unsafe baseline (Shin & McKay 1985, reference [7] of Song & Sharf 2020); no planner
    can be faster. The slowest joint moves bang-coast-bang, which takes

    .. math:: T = D/v + v/a \quad \text{or, without coasting,} \quad T = 2 \sqrt{D/a}

    for the distance D and the limits v, a. The other joints also use their full acceleration, and
    coast at a lower rate such that all joints arrive together.

    Args:
        machine: The machine; its joint limits are kept.
        start: Joint coordinates at the start, shape (n,) [rad or m].
        goal: Joint coordinates at the goal, shape (n,) [rad or m].

    Returns:
        The motion; its nodes are the switching times of all joints.

    Raises:
        ProblemError: Start or goal have a wrong shape, are not finite or outside the joint limits;
            or a limit is missing.
    """
    if not isinstance(machine, Machine):
        raise ProblemError(
            f"machine must be a Machine (see load_machine), not {type(machine).__name__}"
        )
    names, limits = machine.joint_names, machine.limits
    q0 = frozen_array(start, name="start", shape=(machine.size,), error=ProblemError)
    qf = frozen_array(goal, name="goal", shape=(machine.size,), error=ProblemError)
    _check_limits(machine, q0, qf)
    distance = qf - q0
    durations = [
        minimum_time(float(d), max_velocity=float(v), max_acceleration=float(a)).duration
        for d, v, a in zip(distance, limits.velocity, limits.acceleration, strict=True)
    ]
    duration = max(durations)
    if duration == 0.0:
        still = np.zeros((2, len(q0)))
        return Trajectory(names, np.zeros(2), np.vstack([q0, qf]), still, still[:1])
    return _synchronised(names, q0, distance, limits.acceleration, duration)


def _check_limits(machine: Machine, q0: Array, qf: Array) -> None:
    """Refuse missing limits, and a start or goal outside the position limits."""
    names, limits = machine.joint_names, machine.limits
    for key, joints in limits.missing(names).items():
        raise ProblemError(
            f"no {key.replace('_', ' ')} limit for joint {', '.join(map(repr, joints))}: "
            f"{GIVE_LIMITS.arguments}"
        )
    for i, joint in enumerate(names):
        lower, upper = float(limits.position_lower[i]), float(limits.position_upper[i])
        for name, value in (("start", float(q0[i])), ("goal", float(qf[i]))):
            unit = machine.joint_units[i]
            fault = position_fault(joint, value, lower=lower, upper=upper, unit=unit)
            if fault:
                raise ProblemError(f"{name} {fault}")


def _synchronised(
    names: tuple[str, ...], q0: Array, distance: Array, acceleration: Array, duration: float
) -> Trajectory:
    """Bang-coast-bang motion of all joints in a given time, each with its full acceleration.

    Args:
        names: Names of the joints.
        q0: Joint coordinates at the start, shape (n,) [rad or m].
        distance: Signed distances of the joints, shape (n,) [rad or m].
        acceleration: Accelerations of the joints, shape (n,) [rad/s^2 or m/s^2].
        duration: At least the minimum time of every joint [s].
    """
    # coasting rate c of each joint: the smaller solution of |D| = c (T - c / a)
    half = 0.5 * acceleration * duration
    rate = half - np.sqrt(np.maximum(half**2 - acceleration * np.abs(distance), 0.0))
    ramp = np.minimum(rate / acceleration, 0.5 * duration)  # [s] speeding up and braking
    times = np.unique(np.concatenate([[0.0, duration], ramp, duration - ramp]))
    times = times[np.concatenate([[True], np.diff(times) > 1e-9 * duration])]
    times[-1] = duration
    velocity = (
        np.minimum(np.minimum(times[:, None], duration - times[:, None]), ramp) * acceleration
    )  # (K, n)
    steps = np.diff(times)[:, None]
    covered = np.sum(steps * 0.5 * (velocity[1:] + velocity[:-1]), axis=0)
    # gives rates their signs, and removes rounding errors of the distances
    scale = np.divide(distance, covered, out=np.zeros_like(distance), where=covered > 0.0)
    velocity = velocity * scale
    position = q0 + np.vstack(
        [0.0 * q0, np.cumsum(steps * 0.5 * (velocity[1:] + velocity[:-1]), axis=0)]
    )
    return Trajectory(names, times, position, velocity, np.diff(velocity, axis=0) / steps)
