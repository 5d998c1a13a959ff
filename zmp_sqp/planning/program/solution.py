"""From a point of the nonlinear program to a motion in seconds."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.program.hold import Hold
from zmp_sqp.sqp.nlp import NonlinearProgram

__all__ = ["MotionProgram", "trajectory"]

# relative, of the duration: within it, limits that meeting the boundary states to the last digit
# exceeds on coarse grids are kept by going slower
STRETCH = 1e-4
# tried in turn: boundary rates stay, so that in motion the path changes with the duration
STRETCHES = (1.0, 2.0, 4.0)
LEAST_TIME = 1e-9  # [s] by which motions so short that rounding shows may be stretched
ARRIVED = 1e-9  # [m] from the goal: nearer, nothing is gained


class MotionProgram(NonlinearProgram, Protocol):
    """A nonlinear program whose points are motions."""

    @property
    def reference(self) -> float:
        """Duration that scales time [s]."""

    @property
    def hold(self) -> Hold:
        """How accelerations run within an interval."""

    @property
    def aim(self) -> Array | None:
        """Where the base shall end, shape (2,) [m]; None where no base drives."""

    def pack(self, controls: Array, S: float) -> Array:
        """Point with controls (N, c, n) [T^2 a] and squared duration S [s^2], gaps closed."""

    def unpack(self, x: Array) -> tuple[Array, Array, Array, float]:
        """Unscaled (q, w, controls, S), shapes (N+1, n), (N+1, n), (N, c, n), scalar [s^2]."""

    def arrived(self, x: Array, aim: Array | None = None) -> tuple[Array, Array, Array, float]:
        """Result of `unpack` for the nearest point that meets gaps and goal to rounding.

        Args:
            x: Point.
            aim: Where the base shall end instead of its goal, shape (2,) [m].
        """


def trajectory(problem: Problem, program: MotionProgram, x: Array) -> Trajectory:
    """The motion in seconds: it arrives to the last digit, and rounding breaks no limit.

    The true path of a base departs a little from that of the program's Runge-Kutta steps. So the
    program is made to end as far from the goal on the other side.
    """
    goal, before = program.aim, np.inf
    aim = goal
    while True:
        found = _motion(problem, program, x, aim)
        if goal is None or aim is None or found.base is None:
            return found
        miss = goal - found.base.poses[-1, :2]
        far = float(np.abs(miss).max())
        if far <= ARRIVED or far > 0.1 * before:  # what is left lies sideways
            return found
        before, aim = far, aim + miss


def _motion(problem: Problem, program: MotionProgram, x: Array, aim: Array | None) -> Trajectory:
    """Motion whose base, if there is one, ends at `aim` after the program's own steps."""
    coordinates, undercarriage = problem.coordinates, problem.undercarriage
    limits = problem.machine.limits.followed_by(undercarriage.limits)
    size = coordinates.size

    def motion(x: Array) -> tuple[Array, Array, Array, float]:
        y, rates, controls, S = program.arrived(x, aim)
        joints = coordinates.joints(y[:, :size]), coordinates.rates(rates[:, :size])
        accelerations = coordinates.rates(controls[:, :, :size])
        with_base = zip((*joints, accelerations), (y, rates, controls), strict=True)
        q, w, u = (np.concatenate([part, whole[..., size:]], axis=-1) for part, whole in with_base)
        return q, w, u, float(np.sqrt(S))

    q, w, controls, duration = motion(x)
    for factor in STRETCHES:
        rates, accelerations = np.abs(w) / limits.velocity, np.abs(controls) / limits.acceleration
        # the duration at which no limit is exceeded
        needed = max(float(rates.max()), float(np.sqrt(accelerations.max())))
        if not duration < needed <= duration * (1.0 + STRETCH) + LEAST_TIME:
            break
        stretched = duration + factor * (needed - duration)
        q, w, controls, duration = motion(np.append(x[:-1], (stretched / program.reference) ** 2))
    times = np.linspace(0.0, duration, problem.intervals + 1)
    start, end = (program.hold.shapes(s)[0] for s in (0.0, 1.0))
    ends = [np.einsum("c,kcn->kn", shape, controls) / duration**2 for shape in (start, end)]
    jerks = (ends[1] - ends[0]) * (problem.intervals / duration)
    v, n = w / duration, problem.machine.size
    base = undercarriage.motion(times, q[:, -1], v[:, n:], ends[0][:, n:], jerks[:, n:])
    return Trajectory(
        problem.machine.joint_names, times, q[:, :n], v[:, :n], ends[0][:, :n], jerks[:, :n], base
    )
