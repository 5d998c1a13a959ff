"""Conversion of a point of the staged program into a trajectory in seconds."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.staged import Motion, StagedProgram

__all__ = ["trajectory"]

# largest stretch of the duration, relative, that makes good for limits exceeded by rounding: on
# coarse grids, meeting the boundary states to the last digit changes accelerations a little
STRETCH = 1e-3
# multiples of the needed stretch, tried in turn: boundary rates do not scale with the duration, so
# that the path of a motion that does not start or end at rest changes with it
STRETCHES = (1.0, 2.0, 4.0)
LEAST_TIME = 1e-9  # [s] stretch allowed at any duration: very short motions show rounding
ARRIVED = 1e-9  # [m] largest distance of a driving base from its goal that is not corrected


def trajectory(
    problem: Problem, program: StagedProgram, point: Motion, fine: Grid | None = None
) -> Trajectory:
    """Trajectory in seconds that meets the goal, stretched slightly where rounding breaks a limit.

    The exact path of a driving base differs a little from the program's Runge-Kutta steps. The
    accelerations are therefore corrected until the exact path ends at the goal: the target of the
    Runge-Kutta path is moved by what the exact path misses the goal by.

    Args:
        problem: The problem.
        program: Its program.
        point: Point of the program.
        fine: Grid of the trajectory, with all nodes of the program's; None for the program's own.
    """
    if program.drive is None or program.goal.free:
        return _motion(problem, program, point, None, fine)
    aim, previous = program.drive.goal, np.inf
    while True:
        found = _motion(problem, program, point, aim, fine)
        miss = np.zeros(2) if found.base is None else program.drive.goal - found.base.poses[-1, :2]
        distance = float(np.abs(miss).max())
        if distance <= ARRIVED or distance > 0.1 * previous:  # what is left is sideways
            return found
        previous, aim = distance, aim + miss


def _motion(
    problem: Problem,
    program: StagedProgram,
    point: Motion,
    aim: Array | None,
    fine: Grid | None,
) -> Trajectory:
    """Trajectory of a point; the Runge-Kutta path of a driving base is made to end at `aim`."""
    coordinates, undercarriage = problem.coordinates, problem.undercarriage
    limits = problem.machine.limits.followed_by(undercarriage.limits)
    size, coarse = coordinates.size, program.grid
    grid = fine or coarse

    def motion(sigma: float) -> tuple[Array, Array, Array, float]:
        same = sigma == point.sigma
        reached = point if same else program.motion(point.controls, sigma, near=point)
        y, rates, controls, S = program.unpack(reached)
        if aim is not None and program.drive is not None:
            near = reached.states[:, program.stages.places]
            controls = program.drive.arrived(coarse, y[0], rates[0], controls, aim, near)
            y, rates = coarse.rolled(y[0], rates[0], controls)
        if fine is not None:
            controls = coarse.on(fine, controls)
            y, rates = grid.rolled(y[0], rates[0], controls)
        joints = coordinates.joints(y[:, :size]), coordinates.rates(rates[:, :size])
        accelerations = coordinates.rates(controls[:, :, :size])
        with_base = zip((*joints, accelerations), (y, rates, controls), strict=True)
        q, w, u = (np.concatenate([part, whole[..., size:]], axis=-1) for part, whole in with_base)
        return q, w, u, float(np.sqrt(S))

    q, w, controls, duration = motion(point.sigma)
    for factor in STRETCHES:
        rates, accelerations = np.abs(w) / limits.velocity, np.abs(controls) / limits.acceleration
        # shortest duration at which a motion with the same path keeps all limits
        needed = max(float(rates.max()), float(np.sqrt(accelerations.max())))
        if not duration < needed <= duration * (1.0 + STRETCH) + LEAST_TIME:
            break
        stretched = duration + factor * (needed - duration)
        q, w, controls, duration = motion((stretched / program.reference) ** 2)
    start, end = (controls[:, i] / duration**2 for i in (0, 1))
    jerks = (end - start) / (grid.steps[:, None] * duration)
    times, v, n = grid.nodes * duration, w / duration, problem.machine.size
    near = None
    if program.drive is not None:
        places = point.states[:, program.stages.places]
        near = np.column_stack([np.interp(grid.nodes, coarse.nodes, part) for part in places.T])
    base = undercarriage.motion(times, q[:, -1], v[:, n:], start[:, n:], jerks[:, n:], near)
    return Trajectory(
        problem.machine.joint_names, times, q[:, :n], v[:, :n], start[:, :n], jerks[:, :n], base
    )
