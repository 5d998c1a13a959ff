"""Fastest motion within the joint limits alone, which ignores stability, and its certificate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.motion.double_integrator import minimum_time, timed_motion
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.constraints.tip_over import GUARD
from zmp_sqp.planning.problem.undercarriage import Standing
from zmp_sqp.planning.proof.boundary_states import meets_boundary_states
from zmp_sqp.planning.proof.certificate import Certificate, certify_for
from zmp_sqp.planning.search.task import Task

__all__ = ["BlindMotion", "blind_motion", "certified_blind_motion"]

SAMPLES = 24  # times at which the ZMP is checked before the motion is certified, which is costly
SAME = 1e-9  # share of the duration: switching times that are closer together are merged


@dataclass(frozen=True, slots=True, eq=False)
class BlindMotion:
    """Synchronised bang-coast-bang motion that ignores stability.

    Every coordinate accelerates to a constant rate, coasts, and changes to its rate at the goal.

    Attributes:
        duration: Duration of the motion [s].
        phases: Durations of the three phases of each coordinate, shape (n, 3) [s].
        accelerations: Accelerations in the three phases, shape (n, 3) [rad/s^2 or m/s^2].
        deciding: Index of the coordinate that needs the longest time.
    """

    duration: float
    phases: Array
    accelerations: Array
    deciding: int

    @property
    def switches(self) -> Array:
        """Switching times of each coordinate's acceleration, ends excluded, shape (n, 2) [s]."""
        return np.cumsum(self.phases, axis=1)[:, :2]

    def nodes(self, intervals: int) -> Array:
        """Times of nodes at all switching times, with the longest intervals halved [s].

        Args:
            intervals: Least number of intervals.
        """
        times = np.unique(np.concatenate([[0.0, self.duration], self.switches.ravel()]))
        apart = np.diff(times, prepend=-np.inf) > SAME * self.duration
        times = times[apart]
        times[0], times[-1] = 0.0, self.duration
        while len(times) <= intervals:  # halve the longest interval
            k = int(np.argmax(np.diff(times)))
            times = np.insert(times, k + 1, 0.5 * (times[k] + times[k + 1]))
        return times

    def acceleration_at(self, times: Array) -> Array:
        """Accelerations at times (K,) between the switching times, shape (K, n)."""
        first, second = self.switches.T
        phase = (times[:, None] > first).astype(int) + (times[:, None] > second)
        return np.take_along_axis(self.accelerations.T, phase, axis=0)

    def gained(self, times: Array) -> tuple[Array, Array]:
        """Changes of the rates that accelerations have made by times (K,), and their integrals.

        Shape (K, n) each [rad/s, rad].
        """
        since = times[:, None, None] - np.cumsum(self.phases, axis=1) + self.phases  # (K, n, 3)
        inside = np.clip(since, 0.0, self.phases)  # time that each phase has lasted
        rate = inside * self.accelerations
        after = np.maximum(since - self.phases, 0.0)
        return rate.sum(axis=2), (rate * (0.5 * inside + after)).sum(axis=2)

    def mean_accelerations(self, times: Array) -> Array:
        """Mean accelerations between times (K + 1,), shape (K, n); 0 where two times are equal."""
        lengths, gained = np.diff(times)[:, None], np.diff(self.gained(times)[0], axis=0)
        return np.divide(gained, lengths, out=np.zeros_like(gained), where=lengths > 0.0)


def blind_motion(task: Task, stretch: float = 0.0) -> BlindMotion | None:
    """Fastest motion within the joint limits, with all coordinates synchronised to the slowest.

    Args:
        task: The planning task.
        stretch: Relative increase of the duration over the minimum.

    Returns:
        The motion, or None where a coordinate cannot take exactly this time at its largest
        acceleration, as may happen with boundary states in motion.
    """
    bounds, start, goal = task.bounds, task.start, task.goal
    rows = list(
        zip(goal.q - start.q, bounds.velocity, bounds.acceleration, start.v, goal.v, strict=True)
    )
    least = [
        minimum_time(
            float(d),
            max_velocity=float(v),
            max_acceleration=float(a),
            start_velocity=float(v0),
            goal_velocity=float(v1),
        ).duration
        for d, v, a, v0, v1 in rows
    ]
    duration = max(max(least), task.lower_bound) * (1.0 + stretch)
    found = [
        timed_motion(
            float(d),
            duration,
            max_velocity=float(v),
            max_acceleration=float(a),
            start_velocity=float(v0),
            goal_velocity=float(v1),
        )
        for d, v, a, v0, v1 in rows
    ]
    if any(one is None for one in found):
        return None
    phases, accelerations = (np.stack([one[i] for one in found if one]) for i in (0, 1))
    return BlindMotion(duration, phases, accelerations, int(np.argmax(least)))


def certified_blind_motion(task: Task) -> tuple[Trajectory, Certificate] | None:
    """Fastest motion within the joint limits with its certificate, if it is safe, else None.

    No motion is faster. Only for a base that stands, and not with `distance_limits`.
    """
    problem = task.problem
    if not isinstance(problem.undercarriage, Standing) or problem.distance_limits is not None:
        return None
    motion = blind_motion(task)
    if motion is None or not _seems_safe(task, motion):
        return None
    times = motion.nodes(problem.first_intervals)
    h = np.diff(times)[:, None]
    a = motion.acceleration_at(0.5 * (times[1:] + times[:-1]))
    v = task.start.v + np.vstack([0.0 * a[:1], np.cumsum(h * a, axis=0)])
    moved = h * v[:-1] + 0.5 * h**2 * a
    q = task.start.q + np.vstack([0.0 * a[:1], np.cumsum(moved, axis=0)])
    to = problem.coordinates
    names = problem.machine.joint_names
    found = Trajectory(names, times, to.joints(q), to.rates(v), to.rates(a))
    checked = certify_for(problem, found)
    if not (checked.safe and meets_boundary_states(problem, found)):
        return None
    return found, checked


def _seems_safe(task: Task, motion: BlindMotion) -> bool:
    """Whether the ZMP keeps its margin at samples, on both sides of every switching time."""
    edges = np.unique(np.concatenate([[0.0, motion.duration], motion.switches.ravel()]))
    near = SAME * motion.duration
    inner = np.linspace(0.0, motion.duration, SAMPLES)[1:-1]
    times = np.sort(np.concatenate([edges[1:] - near, edges[:-1] + near, inner]))
    times = np.clip(times, near, motion.duration - near)
    rate, moved = motion.gained(times)
    v = task.start.v + rate
    q = task.start.q + times[:, None] * task.start.v + moved
    return task.constraints.outside(q, v, motion.acceleration_at(times), 1.0) <= GUARD
