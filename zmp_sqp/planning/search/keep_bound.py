"""Whether a motion can be as fast as the joint limits allow: decided by a few shortest steps."""

from __future__ import annotations

import time

import numpy as np

from zmp_sqp.motion.double_integrator import grid_profile
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.staged import Motion, StagedProgram
from zmp_sqp.planning.search.run import Candidate, Runs
from zmp_sqp.planning.search.task import Task
from zmp_sqp.sqp.least_distance import Nearest, nearest_feasible
from zmp_sqp.sqp.result import IterationRecord, SQPResult, SQPStatus

__all__ = ["at_the_bound"]

# Duration that is tried, between the continuous lower bound and the one of constant accelerations on
# the grid: accelerations that run linearly within intervals can be faster than the latter, and at
# the former the deciding joint has only one motion
SHARE = 0.8
ENOUGH = 3e-3  # violation on the coarse grid with which the fine one goes on
LEAST_COARSE = 4  # intervals of a coarse grid
ABOVE = 1e-4  # relative, least distance from the lower bound


def at_the_bound(task: Task, runs: Runs) -> Candidate | None:
    """A motion as fast as the joint limits allow to within the grid's resolution; None if none.

    First on half of the intervals, where it is cheap to find that there is none.
    """
    intervals = task.problem.intervals
    if task.bound_on(intervals) == 0.0 or runs.is_late:  # in motion there is no bound of the grid
        return None
    fine, point = _program(task, intervals), None
    if intervals >= 2 * LEAST_COARSE:
        coarse = _program(task, intervals // 2)
        found = nearest_feasible(coarse, _blind(task, coarse), runs.backend, enough=ENOUGH)
        runs.note(_record(found, runs))
        if not found.feasible:
            return None
        controls = coarse.grid.on(fine.grid, coarse.unpack(found.point)[2])
        point = fine.pack(controls, fine.reference**2)
    point = _blind(task, fine) if point is None else point
    found = nearest_feasible(fine, point, runs.backend)
    record = _record(found, runs)
    runs.note(record)
    if not found.feasible:
        return None
    y, z = np.zeros(fine.equalities), np.zeros(fine.inequalities)
    status, history = SQPStatus.BOUND_REACHED, (record,)
    result = SQPResult(found.point, y, z, found.excess, status, found.at, history)
    return Candidate(fine, result)


def _program(task: Task, intervals: int) -> StagedProgram:
    """Program whose reference is the duration that is tried on its grid."""
    low = task.lower_bound
    on_grid = max(task.bound_on(intervals), low)
    duration = max(low * (1.0 + ABOVE), low + SHARE * (on_grid - low))
    return task.program(duration, Grid.of(intervals), least=low)


def _blind(task: Task, program: StagedProgram) -> Motion:
    """The synchronised bang-coast-bang motion, which knows nothing of stability."""
    duration = program.reference
    alpha = duration**2 * grid_profile(
        task.goal.q - task.start.q,
        duration,
        max_velocity=task.bounds.velocity,
        max_acceleration=task.bounds.acceleration,
        intervals=program.grid.size,
    )
    return program.pack(np.repeat(alpha[:, None], 2, axis=1), duration**2)


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
