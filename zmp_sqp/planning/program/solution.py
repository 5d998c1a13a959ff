"""From a point of the staged program to a motion in seconds."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.program.staged import Motion, StagedProgram

__all__ = ["trajectory"]

# relative, of the duration: within it, limits that meeting the boundary states to the last digit
# exceeds on coarse grids are kept by going slower
STRETCH = 1e-3
# tried in turn: boundary rates stay, so that in motion the path changes with the duration
STRETCHES = (1.0, 2.0, 4.0)
LEAST_TIME = 1e-9  # [s] by which motions so short that rounding shows may be stretched
ARRIVED = 1e-9  # [m] from the goal: nearer, nothing is gained


def trajectory(problem: Problem, program: StagedProgram, point: Motion) -> Trajectory:
    """The motion in seconds: it arrives to the last digit, and rounding breaks no limit.

    The true path of a base departs a little from that of the program's Runge-Kutta steps. So the
    program is made to end as far from the goal on the other side.
    """
    if program.drive is None:
        return _motion(problem, program, point, None)
    aim, before = program.drive.goal, np.inf
    while True:
        found = _motion(problem, program, point, aim)
        miss = np.zeros(2) if found.base is None else program.drive.goal - found.base.poses[-1, :2]
        far = float(np.abs(miss).max())
        if far <= ARRIVED or far > 0.1 * before:  # what is left lies sideways
            return found
        before, aim = far, aim + miss


def _motion(
    problem: Problem, program: StagedProgram, point: Motion, aim: Array | None
) -> Trajectory:
    """Motion whose base, if there is one, ends at `aim` after the program's own steps."""
    coordinates, undercarriage = problem.coordinates, problem.undercarriage
    limits = problem.machine.limits.followed_by(undercarriage.limits)
    size, grid = coordinates.size, program.grid

    def motion(sigma: float) -> tuple[Array, Array, Array, float]:
        same = sigma == point.sigma
        reached = point if same else program.motion(point.controls, sigma)
        y, rates, controls, S = program.unpack(reached)
        if aim is not None and program.drive is not None:
            controls = program.drive.arrived(grid, y[0], rates[0], controls, aim)
            y, rates = grid.rolled(y[0], rates[0], controls)
        joints = coordinates.joints(y[:, :size]), coordinates.rates(rates[:, :size])
        accelerations = coordinates.rates(controls[:, :, :size])
        with_base = zip((*joints, accelerations), (y, rates, controls), strict=True)
        q, w, u = (np.concatenate([part, whole[..., size:]], axis=-1) for part, whole in with_base)
        return q, w, u, float(np.sqrt(S))

    q, w, controls, duration = motion(point.sigma)
    for factor in STRETCHES:
        rates, accelerations = np.abs(w) / limits.velocity, np.abs(controls) / limits.acceleration
        # the duration at which no limit is exceeded
        needed = max(float(rates.max()), float(np.sqrt(accelerations.max())))
        if not duration < needed <= duration * (1.0 + STRETCH) + LEAST_TIME:
            break
        stretched = duration + factor * (needed - duration)
        q, w, controls, duration = motion((stretched / program.reference) ** 2)
    start, end = (controls[:, i] / duration**2 for i in (0, 1))
    jerks = (end - start) / (grid.steps[:, None] * duration)
    times, v, n = grid.nodes * duration, w / duration, problem.machine.size
    base = undercarriage.motion(times, q[:, -1], v[:, n:], start[:, n:], jerks[:, n:])
    return Trajectory(
        problem.machine.joint_names, times, q[:, :n], v[:, :n], start[:, :n], jerks[:, :n], base
    )
