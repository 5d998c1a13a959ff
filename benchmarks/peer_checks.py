"""Any motion of the arm, sampled: what it violates between its nodes, whoever planned it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import zmp_sqp as zs
from benchmarks.problems.checks import Oracle
from benchmarks.problems.driving import DrivingProblem
from benchmarks.problems.scene import NamedProblem

__all__ = [
    "Motion",
    "Violations",
    "drive_of",
    "drive_violations",
    "motion_of",
    "polynomial_states",
    "violations",
]

Array = np.ndarray
RATE = 2000.0  # [Hz] of the samples
States = tuple[Array, Array, Array]  # positions, rates and accelerations, each (K, n)


@dataclass(frozen=True)
class Motion:
    """A motion as a function of time."""

    duration: float  # [s]
    states: Callable[[Array], States]  # at times within the duration, shape (K,) [s]


@dataclass(frozen=True)
class Violations:
    """Largest violations of a motion, zero where it has none."""

    zmp: float  # [m] distance of the ZMP beyond an edge
    rest: float  # [rad, rad/s, rad/s^2] excess over joint limits, distance from start and goal

    def within(self, tolerance: float) -> bool:
        """True where no violation exceeds the tolerance."""
        return max(self.zmp, self.rest) <= tolerance


def polynomial_states(trajectory: zs.Trajectory, times: Array) -> States:
    """States of a trajectory from nothing but the arrays of its nodes.

    At a node where accelerations jump it is the acceleration after the jump.
    """
    k = np.searchsorted(trajectory.times, times, side="right") - 1
    k = np.clip(k, 0, len(trajectory.times) - 2)
    t = (times - trajectory.times[k])[:, None]
    q, v = trajectory.positions[k], trajectory.velocities[k]
    a, j = trajectory.accelerations[k], trajectory.jerks[k]
    return q + t * (v + t * (a / 2.0 + t * j / 6.0)), v + t * (a + t * j / 2.0), a + t * j


def motion_of(trajectory: zs.Trajectory) -> Motion:
    """Motion of a trajectory, evaluated by `polynomial_states`."""
    return Motion(trajectory.duration, lambda times: polynomial_states(trajectory, times))


def violations(named: NamedProblem, motion: Motion) -> Violations:
    """Violations of a motion at 2000 samples per second, by a model of its own (`checks.Oracle`).

    The problem is from rest to rest.
    """
    problem, limits = named.problem, named.problem.machine.limits
    q, v, a = motion.states(_samples(motion))
    over = (
        np.abs(v) - limits.velocity,
        np.abs(a) - limits.acceleration,
        q - limits.position_upper,
        limits.position_lower - q,
        np.abs(q[[0, -1]] - [problem.start, problem.goal]),
        np.abs(v[[0, -1]]),
    )
    return Violations(
        zmp=max(0.0, Oracle(named.scene).excess(q, v, a) + problem.margin),
        rest=max(0.0, *(float(part.max()) for part in over)),
    )


def drive_of(trajectory: zs.Trajectory) -> Motion:
    """Motion of joints, yaw and path length of a trajectory whose base drives in a plane."""
    base = trajectory.base
    h, order = np.diff(trajectory.times)[:, None], [1, 0]  # yaw before path length
    v, a, j = base.velocities[:, order], base.accelerations[:, order], base.jerks[:, order]
    steps = h * (v[:-1] + h * (a / 2.0 + h * j / 6.0))
    start = np.array([base.poses[0, 2], 0.0])
    q = start + np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    return motion_of(
        zs.Trajectory(
            (*trajectory.joint_names, "yaw", "length"),
            trajectory.times,
            np.hstack([trajectory.positions, q]),
            np.hstack([trajectory.velocities, v]),
            np.hstack([trajectory.accelerations, a]),
            np.hstack([trajectory.jerks, j]),
        )
    )


def drive_violations(drawn: DrivingProblem, motion: Motion) -> Violations:
    """Violations of a motion of joints, yaw and path length at 2000 samples per second.

    The base's position is the integral of its velocity by the trapezoidal rule.
    """
    problem, base, times = drawn.problem, drawn.problem.base, _samples(motion)
    limits, n = problem.machine.limits, problem.machine.size
    q, v, a = motion.states(times)
    velocity = v[:, -1:] * np.column_stack([np.cos(q[:, -2]), np.sin(q[:, -2])])
    steps = 0.5 * np.diff(times)[:, None] * (velocity[1:] + velocity[:-1])
    arrived = np.array([*(base.start[:2] + steps.sum(axis=0)), q[-1, -2]])
    rates = np.concatenate([limits.velocity, [base.max_yaw_rate, base.max_speed]])
    accelerations = np.concatenate(
        [limits.acceleration, [base.max_yaw_acceleration, base.max_acceleration]]
    )
    over = (
        np.abs(v) - rates,
        np.abs(a) - accelerations,
        q[:, :n] - limits.position_upper,
        limits.position_lower - q[:, :n],
        np.abs(q[[0, -1], :n] - [problem.start, problem.goal]),
        np.abs(v[[0, -1]]),
        np.abs(arrived - base.goal),
    )
    return Violations(
        zmp=max(0.0, Oracle(drawn.scene).excess(q, v, a) + problem.margin),
        rest=max(0.0, *(float(part.max()) for part in over)),
    )


def _samples(motion: Motion) -> Array:
    """Times from start to end, 2000 per second or a few more."""
    return np.linspace(0.0, motion.duration, int(np.ceil(RATE * motion.duration)) + 1)
