"""Whether a motion can be as fast as the joint limits allow: decided by a few shortest steps."""

from __future__ import annotations

import time

import numpy as np

from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.search.blind import BlindMotion, blind_motion
from zmp_sqp.planning.search.run import Candidate, Runs, SearchRun
from zmp_sqp.planning.search.task import Task
from zmp_sqp.sqp.iterate import is_feasible
from zmp_sqp.sqp.least_distance import EQUALITY, Nearest, nearest_feasible
from zmp_sqp.sqp.result import IterationRecord, SQPResult, SQPStatus

__all__ = ["ABOVE", "at_the_bound"]

ABOVE = 3e-4  # relative, above the lower bound: there the deciding joint has only one motion
# The grid has nodes where the deciding coordinate's acceleration jumps, and at least so many
# intervals in each of its phases
LEAST_PER_PHASE = 2
PURPOSE = "shortest steps to a motion at the bound"
LEAST_COARSE = 8  # intervals of a coarse grid, below which there is none


def at_the_bound(task: Task, runs: Runs) -> Candidate | None:
    """A motion that is hardly slower than the joint limits allow; None if none is found quickly.

    It is looked for on half of the intervals: with nodes where the deciding coordinate's
    acceleration jumps, they are enough. The motion is then the same on all intervals.
    """
    if (guessed := _as_guessed(task)) is not None:
        runs.record("bang-bang motion on the grid", guessed)
        return guessed
    motion = blind_motion(task, ABOVE)
    if motion is None or runs.is_late:
        return None
    intervals = task.problem.first_intervals
    halved = intervals % 2 == 0 and intervals >= 2 * LEAST_COARSE
    coarse = aligned_grid(motion, intervals // 2 if halved else intervals)
    program = task.program(motion.duration, coarse)
    alpha = motion.duration**2 * motion.mean_accelerations(coarse.nodes * motion.duration)
    point = program.pack(np.repeat(alpha[:, None], 2, axis=1), motion.duration**2)
    found = nearest_feasible(program, point, runs.backend)
    record = _record(found, runs)
    runs.note(record)
    if not found.feasible:
        runs.runs.append(
            SearchRun(PURPOSE, coarse.size, record.backend, 1, "refused", motion.duration)
        )
        return None
    point, at, excess = found.point, found.at, found.excess
    if halved:
        middles = 0.5 * (coarse.nodes[1:] + coarse.nodes[:-1])
        fine = Grid(np.sort(np.concatenate([coarse.nodes, middles])), uniform=False)
        controls = coarse.on(fine, program.unpack(point)[2])
        program = task.program(motion.duration, fine)
        point = program.pack(controls, motion.duration**2)
        at, excess = program.evaluate(point), None
    y, z = np.zeros(program.equalities), np.zeros(program.inequalities)
    result = SQPResult(point, y, z, excess, SQPStatus.BOUND_REACHED, at, (record,))
    reached = Candidate(program, result)
    runs.record(PURPOSE, reached)
    return reached


def _as_guessed(task: Task) -> Candidate | None:
    """The motion with one acceleration per interval, if the grid allows the bound and it is safe.

    So it is where switching times fall on nodes, as they do halfway in a motion without coasting.
    """
    intervals = task.problem.first_intervals
    least = task.bound_on(intervals)
    if not 0.0 < least <= task.lower_bound * (1.0 + ABOVE):
        return None
    controls, duration = task.guess(task.least, intervals, smooth=False)
    program = task.program(duration, Grid.of(intervals))
    point = program.pack(controls, duration**2)
    at = program.evaluate(point)
    if duration > task.least or not is_feasible(at, program.tolerance, EQUALITY):
        return None
    y, z = np.zeros(program.equalities), np.zeros(program.inequalities)
    return Candidate(program, SQPResult(point, y, z, None, SQPStatus.BOUND_REACHED, at, ()))


def aligned_grid(motion: BlindMotion, intervals: int) -> Grid:
    """Nodes where the deciding coordinate's acceleration jumps, the rest evenly in between."""
    lengths = motion.phases[motion.deciding] / motion.duration
    lengths = lengths[lengths > 1e-6]
    lengths = lengths / lengths.sum()
    least = min(LEAST_PER_PHASE, intervals // len(lengths))
    if least == 0:
        return Grid.of(intervals)
    counts = np.maximum(np.round(intervals * lengths), least).astype(int)
    while counts.sum() != intervals:  # from or to where intervals are shortest or longest
        sizes = lengths / counts
        longer = np.where(counts > 1, sizes, np.inf)
        k = int(np.argmin(longer)) if counts.sum() > intervals else int(np.argmax(sizes))
        counts[k] += 1 if counts.sum() < intervals else -1
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    parts = [
        np.linspace(a, b, count, endpoint=False)
        for a, b, count in zip(ends[:-1], ends[1:], counts, strict=True)
    ]
    return Grid(np.append(np.concatenate(parts), 1.0), uniform=False)


def _record(found: Nearest, runs: Runs) -> IterationRecord:
    return IterationRecord(
        iteration=1,
        backend=f"{found.backend or runs.backend.name}, shortest steps",
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
