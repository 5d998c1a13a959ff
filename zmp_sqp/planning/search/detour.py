"""Last initial guess: a slow motion along poses in which the machine stands at rest."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from zmp_sqp.arrays import Array, length_text
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.search.run import Runs
from zmp_sqp.planning.search.still_poses import Barrier, StillPoses
from zmp_sqp.planning.search.task import Task

__all__ = ["detour"]

MOST = 250_000  # poses that are looked at for a path: at most 1 s
PACE = 1.5  # duration of the guess per least duration along its path


def detour(task: Task, runs: Runs) -> Callable[[int], tuple[Array, float]] | None:
    """Guess from a path of poses that stand, by the number of intervals; None without such a path.

    The other guesses run straight from start to goal. Where the machine tips over on the way, and
    the SQP does not find past it, a feasible motion may still lead around through poses far away.
    If a joint has to pass a value at which no pose stands, there is no such path, and the reason is
    noted for the message. A driving base has none of this: where it stands is part of the pose.
    """
    if task.problem.undercarriage.route is not None or runs.is_late:
        return None
    poses = StillPoses(task)
    runs.say("joint values at which no pose stands")
    barrier = poses.barrier()
    if barrier is not None:
        runs.reason = _words(task, barrier)
        return None
    runs.say("path through poses that stand")
    path = poses.path(MOST, lambda: runs.is_late)
    return None if path is None else partial(_along, task, path)


def _along(task: Task, path: Array, intervals: int) -> tuple[Array, float]:
    """Accelerations T^2 a, shape (N, 2, n), and duration T [s] of a slow motion along a path.

    Positions at the nodes are on the path, a smooth step apart; rates are their differences.
    """
    bounds = task.bounds
    lengths = np.max(np.abs(np.diff(path, axis=0)) / bounds.velocity, axis=1)
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    grid = Grid.of(intervals)
    s = grid.nodes
    share = s**2 * (3.0 - 2.0 * s)
    q = np.stack([np.interp(share * at[-1], at, column) for column in path.T], axis=1)
    q[1:-1] = 0.25 * q[:-2] + 0.5 * q[1:-1] + 0.25 * q[2:]  # rounds the corners
    w = np.gradient(q, s, axis=0)
    w[[0, -1]] = 0.0
    h, dq = grid.steps[:, None], np.diff(q, axis=0)
    first = (6.0 * dq / h - 4.0 * w[:-1] - 2.0 * w[1:]) / h
    last = (-6.0 * dq / h + 2.0 * w[:-1] + 4.0 * w[1:]) / h
    controls = np.stack([first, last], axis=1)
    fastest = np.max(np.abs(w) / bounds.velocity)
    hardest = np.max(np.abs(controls) / bounds.acceleration)
    return controls, PACE * float(max(fastest, np.sqrt(hardest), task.lower_bound))


def _words(task: Task, barrier: Barrier) -> str:
    """Sentence about a barrier."""
    machine, coordinates = task.problem.machine, task.constraints.corners[0].model.coordinates
    if not coordinates.is_identity:
        return ""
    beyond = barrier.outside - task.problem.margin  # [m] the edge itself
    best = f"{length_text(abs(beyond))} {'outside' if beyond > 0.0 else 'inside'}"
    if beyond <= 0.0:
        best += f", less than the margin of {task.problem.margin:.10g} m"
    name, unit = machine.joint_names[barrier.joint], machine.joint_units[barrier.joint]
    return (
        f"On its way to the goal, joint '{name}' has to pass {barrier.value:.3f} {unit}, where no "
        f"pose was found that stands at rest: at best, the ZMP is {best}."
    )
