"""Whether a motion can be as fast as the joint limits allow: decided by a few shortest steps."""

from __future__ import annotations

import time

import numpy as np

from zmp_sqp.motion.double_integrator import grid_profile
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.search.run import Candidate, Runs
from zmp_sqp.planning.search.task import Task
from zmp_sqp.sqp.least_distance import Nearest, nearest_feasible
from zmp_sqp.sqp.result import IterationRecord, SQPResult, SQPStatus

__all__ = ["at_the_bound"]

# Duration that is tried, between the continuous lower bound and the one of constant accelerations on
# the grid: accelerations that run linearly within intervals can be faster than the latter, and at
# the former the deciding joint has only one motion
SHARE = 0.8
ABOVE = 1e-4  # relative, least distance from the lower bound


def at_the_bound(task: Task, runs: Runs) -> Candidate | None:
    """A motion as fast as the joint limits allow to within the grid's resolution; None if none."""
    if task.grid_bound == 0.0 or runs.is_late:  # in motion there is no bound of the grid
        return None
    low, on_grid = task.lower_bound, max(task.grid_bound, task.lower_bound)
    duration = max(low * (1.0 + ABOVE), low + SHARE * (on_grid - low))
    intervals = task.problem.intervals
    alpha = duration**2 * grid_profile(
        task.goal.q - task.start.q,
        duration,
        max_velocity=task.bounds.velocity,
        max_acceleration=task.bounds.acceleration,
        intervals=intervals,
    )
    program = task.program(duration, Grid.of(intervals), least=low)
    point = program.pack(np.repeat(alpha[:, None], 2, axis=1), duration**2)
    found = nearest_feasible(program, point, runs.backend)
    record = _record(found, runs)
    runs.note(record)
    if not found.feasible:
        return None
    y, z = np.zeros(program.equalities), np.zeros(program.inequalities)
    status, history = SQPStatus.BOUND_REACHED, (record,)
    result = SQPResult(found.point, y, z, found.excess, status, found.at, history)
    return Candidate(program, result)


def _record(found: Nearest, runs: Runs) -> IterationRecord:
    return IterationRecord(
        iteration=1,
        backend=f"{runs.backend.name}, shortest steps",
        inner_iterations=found.inner,
        rows=found.rows,
        relaxed=False,
        curvature=False,
        corrected=False,
        objective=found.at.objective,
        violation=found.at.violation,
        step=1.0 if found.feasible else 0.0,
        time=time.perf_counter() - runs.started,
    )
