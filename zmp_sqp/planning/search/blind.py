"""The stability-blind motion of a problem: as fast as the joints' limits allow."""

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

SAMPLES = 24  # states at which the zero moment point is looked at before anything is proven
SAME = 1e-9  # share of the duration: switching times that are nearer count as one


@dataclass(frozen=True, slots=True, eq=False)
class BlindMotion:
    """Every coordinate goes to a coasting rate, coasts, and goes to its rate at the goal.

    Attributes:
        duration: [s].
        phases: Durations of the three phases, shape (n, 3) [s].
        accelerations: In the three phases, shape (n, 3).
        deciding: Coordinate that takes longest.
    """

    duration: float
    phases: Array
    accelerations: Array
    deciding: int

    @property
    def switches(self) -> Array:
        """Times at which each coordinate's acceleration jumps on the way, shape (n, 2) [s]."""
        return np.cumsum(self.phases, axis=1)[:, :2]

    def nodes(self, intervals: int) -> Array:
        """Nodes at all switching times, and more of them up to a number of intervals [s]."""
        times = np.unique(np.concatenate([[0.0, self.duration], self.switches.ravel()]))
        apart = np.diff(times, prepend=-np.inf) > SAME * self.duration
        times = times[apart]
        times[0], times[-1] = 0.0, self.duration
        while len(times) <= intervals:  # cut the longest interval in two
            k = int(np.argmax(np.diff(times)))
            times = np.insert(times, k + 1, 0.5 * (times[k] + times[k + 1]))
        return times

    def acceleration_at(self, times: Array) -> Array:
        """Accelerations at times that are no switching times, shape (K, n)."""
        first, second = self.switches.T
        phase = (times[:, None] > first).astype(int) + (times[:, None] > second)
        return np.take_along_axis(self.accelerations.T, phase, axis=0)

    def mean_accelerations(self, times: Array) -> Array:
        """Mean accelerations between times (K + 1,), shape (K, n); 0 where two times are one."""
        ends = np.cumsum(self.phases, axis=1)
        gained = np.zeros((len(times), len(ends)))  # of rate, since the start
        for i in range(3):
            since = ends[:, i] - self.phases[:, i]
            inside = np.clip(times[:, None] - since, 0.0, self.phases[:, i])
            gained += inside * self.accelerations[:, i]
        lengths = np.diff(times)[:, None]
        nothing = np.zeros((len(lengths), len(ends)))
        return np.divide(np.diff(gained, axis=0), lengths, out=nothing, where=lengths > 0.0)


def blind_motion(task: Task, stretch: float = 0.0) -> BlindMotion | None:
    """The motion of the coordinates that takes as long as the slowest of them needs.

    None where another coordinate cannot take just this time with its largest acceleration, as may
    happen from or to motion.

    Args:
        task: The problem.
        stretch: How much longer than necessary, relative.
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
    """The stability-blind motion with its certificate, if it is safe; no motion is faster."""
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
    """Whether the zero moment point is inside at a few samples, on both sides of every switch."""
    edges = np.unique(np.concatenate([[0.0, motion.duration], motion.switches.ravel()]))
    near = SAME * motion.duration
    inner = np.linspace(0.0, motion.duration, SAMPLES)[1:-1]
    times = np.sort(np.concatenate([edges[1:] - near, edges[:-1] + near, inner]))
    times = np.clip(times, near, motion.duration - near)
    a = motion.acceleration_at(times)
    grid = np.concatenate([[0.0], times])
    means = motion.mean_accelerations(grid)
    h = np.diff(grid)[:, None]
    v = task.start.v + np.cumsum(h * means, axis=0)
    before = np.vstack([task.start.v, v[:-1]])
    q = task.start.q + np.cumsum(0.5 * h * (before + v), axis=0)
    return task.constraints.outside(q, v, a, 1.0) <= GUARD
