"""The phase-plane method: bang-coast-bang per joint, synchronised, blind to stability."""

from __future__ import annotations

from typing import Any

import numpy as np

from zmp_sqp.arrays import frozen_array
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.double_integrator import minimum_time
from zmp_sqp.motion.trajectory import Trajectory

__all__ = ["phase_plane"]


def phase_plane(machine: Machine, start: Any, goal: Any) -> Trajectory:
    r"""Fastest rest-to-rest motion within the joint limits, without any stability constraint: the unsafe baseline.

    The slowest joint moves bang-coast-bang, :math:`T = D/v + v/a` or :math:`2\sqrt{D/a}`; the
    others keep their full acceleration and coast at the lower rate that lets them arrive with it
    (Shin & McKay 1985, reference [7] of Song & Sharf 2020). Its duration is a lower bound for every
    planner.

    Args:
        machine: The machine; its limits are kept, its ZMP is not looked at.
        start: Joint coordinates, shape (n,) [rad or m].
        goal: Joint coordinates, shape (n,) [rad or m].

    Returns:
        The motion; its nodes are the switching times of all joints.

    Raises:
        ProblemError: Wrong shapes, not finite, outside the joint limits, or a limit is missing.
    """
    if not isinstance(machine, Machine):
        raise ProblemError(
            f"machine must be a Machine (see load_machine), not {type(machine).__name__}"
        )
    names, limits = machine.joint_names, machine.limits
    q0 = frozen_array(start, name="start", shape=(machine.size,), error=ProblemError)
    qf = frozen_array(goal, name="goal", shape=(machine.size,), error=ProblemError)
    for key, joints in limits.missing(names).items():
        raise ProblemError(
            f"no {key.replace('_', ' ')} limit for joint {', '.join(map(repr, joints))}"
        )
    for i, joint in enumerate(names):
        lower, upper = limits.position_lower[i], limits.position_upper[i]
        for name, value in (("start", q0[i]), ("goal", qf[i])):
            if not lower <= value <= upper:
                raise ProblemError(
                    f"{name} of joint {joint!r} is {value:.6g}, outside its limits [{lower:.6g}, {upper:.6g}]"
                )
    distance = qf - q0
    durations = [
        minimum_time(float(d), max_velocity=float(v), max_acceleration=float(a)).duration
        for d, v, a in zip(distance, limits.velocity, limits.acceleration, strict=True)
    ]
    duration = max(durations)
    if duration == 0.0:
        return Trajectory(
            names, np.zeros(2), np.vstack([q0, qf]), np.zeros((2, len(q0))), np.zeros((1, len(q0)))
        )
    # coasting rate c of every joint: |D| = c (T - c / a), the smaller root
    half = 0.5 * limits.acceleration * duration
    rate = half - np.sqrt(np.maximum(half**2 - limits.acceleration * np.abs(distance), 0.0))
    ramp = np.minimum(rate / limits.acceleration, 0.5 * duration)
    times = np.unique(np.concatenate([[0.0, duration], ramp, duration - ramp]))
    times = times[np.concatenate([[True], np.diff(times) > 1e-9 * duration])]
    times[-1] = duration
    velocity = (
        np.minimum(np.minimum(times[:, None], duration - times[:, None]), ramp)
        * limits.acceleration
    )
    steps = np.diff(times)[:, None]
    covered = np.sum(steps * 0.5 * (velocity[1:] + velocity[:-1]), axis=0)
    # sign, and rounding
    scale = np.divide(distance, covered, out=np.zeros_like(distance), where=covered > 0.0)
    velocity = velocity * scale
    position = q0 + np.vstack(
        [0.0 * q0, np.cumsum(steps * 0.5 * (velocity[1:] + velocity[:-1]), axis=0)]
    )
    return Trajectory(names, times, position, velocity, np.diff(velocity, axis=0) / steps)
