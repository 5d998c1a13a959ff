"""Quick search for a safe motion whose duration is the lower bound set by the joint limits."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.staged import StagedProgram
from zmp_sqp.planning.search.blind import BlindMotion, blind_motion
from zmp_sqp.planning.search.guess import cubic_accelerations
from zmp_sqp.planning.search.run import Candidate, Runs, SearchRun
from zmp_sqp.planning.search.task import Task
from zmp_sqp.sqp.iterate import is_feasible
from zmp_sqp.sqp.least_distance import EQUALITY, Nearest, nearest_feasible
from zmp_sqp.sqp.result import IterationRecord, SQPResult, SQPStatus

__all__ = ["ABOVE", "REFUSED", "SHORTEST_STEPS", "at_the_bound"]

# relative excess of the duration over the lower bound: at the bound itself the deciding joint has
# only one motion
ABOVE = 3e-4
# probes at the bound: relative excess of the duration, and whether they begin at a cubic; from rest
# to rest only the first one, which finds more there than the others
PROBES = ((ABOVE, False), (ABOVE, True), (0.0, True))
LEAST_PER_PHASE = 2  # fewest intervals in each phase of the deciding coordinate
PURPOSE = "probe at the bound"
REFUSED = "refused"  # status of a probe that finds nothing
SHORTEST_STEPS = ", shortest steps"  # what the record of its iteration adds to the QP solver
SIZES = (16, 25)  # intervals of the grids of a probe at most, in turn
CLOSE = 0.1  # violation at the end of the first one up to which the second one is tried


def at_the_bound(
    task: Task, runs: Runs, guess: Callable[[Grid], Array] | None = None
) -> Candidate | None:
    """Feasible motion at most 0.03 % slower than the lower bound; None if none is found quickly.

    First the bang-coast-bang motion itself is tried, then a few least-distance steps from it
    (`_probe`). If start or goal is in motion, further steps begin at a cubic, and at last exactly
    at the bound: the deciding coordinate may have just one motion, such as braking all the way, and
    the uniform grid of the search proper misses durations just above that.

    Args:
        task: The planning task.
        runs: Runner of QPs, which keeps the records.
        guess: Accelerations T^2 a at both ends of a grid's intervals, shape (N, 2, n), of a motion
            from which the first steps begin; None for the bang-coast-bang motion.
    """
    if guess is None and (bang_bang := _bang_bang_at_bound(task)) is not None:
        runs.record("bang-bang on the grid", bang_bang)
        return bang_bang
    from_rest = not (task.start.v.any() or task.goal.v.any())
    for number, (stretch, smooth) in enumerate(PROBES[:1] if from_rest else PROBES):
        if runs.is_late:
            break
        first = guess if number == 0 else None
        found = _probe(task, runs, stretch, smooth=smooth, guess=first)
        if found is not None:
            return found
    return None


def _probe(
    task: Task,
    runs: Runs,
    stretch: float,
    *,
    smooth: bool,
    guess: Callable[[Grid], Array] | None = None,
) -> Candidate | None:
    """Feasible motion that is slower than the bound by a relative `stretch`, by a few short steps.

    The steps (`nearest_feasible`) are taken on a grid with nodes at the switching times of the
    deciding coordinate, which is coarser than the trajectory's (`Candidate.fine`): 16 intervals, or
    25 where those end near a feasible motion.

    Args:
        task: The planning task.
        runs: Runs of the search, which the probe is recorded in.
        stretch: Relative increase of the duration over the lower bound.
        smooth: Whether to begin at the cubic through both boundary states, not at the
            bang-coast-bang motion.
        guess: Accelerations of a motion to begin at instead, see `at_the_bound`.
    """
    motion = blind_motion(task, stretch)
    if motion is None:
        return None
    T, intervals = motion.duration, task.problem.first_intervals
    attempts: list[_Attempt] = []
    for size in sorted({min(size, intervals) for size in SIZES}):
        grid = aligned_grid(motion, size)
        if attempts:
            controls = attempts[-1].on(grid)
        elif guess is not None:
            controls = guess(grid)
        else:
            controls = _controls(task, motion, grid, smooth=smooth)
        program = task.program(T, grid)
        found = nearest_feasible(program, program.pack(controls, T**2), runs.backend)
        attempts.append(_Attempt(program, found))
        runs.note(_record(found, runs, len(attempts)))
        if found.feasible or not found.at.violation <= CLOSE:
            break
    program, found = attempts[-1]
    records = tuple(runs.history[-len(attempts) :])
    size, reference = program.grid.size, program.reference
    if not found.feasible:
        count, backend = len(records), found.backend
        runs.runs.append(SearchRun(PURPOSE, size, backend, count, REFUSED, T, reference))
        return None
    fine = program.grid.refined(intervals) if size < intervals else None
    y, z = np.zeros(program.equalities), np.zeros(program.inequalities)
    excess = found.excess if fine is None else None  # that of shorter intervals is smaller
    status = SQPStatus.BOUND_REACHED
    result = SQPResult(found.point, y, z, excess, status, found.at, records)
    reached = Candidate(program, result, fine=fine)
    runs.record(PURPOSE, reached)
    return reached


class _Attempt(NamedTuple):
    """Search for a feasible motion on one grid."""

    program: StagedProgram
    found: Nearest

    def on(self, grid: Grid) -> Array:
        """Accelerations T^2 a of its last motion on another grid, shape (N, 2, n)."""
        return self.program.grid.on(grid, self.program.unpack(self.found.point)[2])


def _controls(task: Task, motion: BlindMotion, grid: Grid, *, smooth: bool) -> Array:
    """Accelerations T^2 a of the bang-coast-bang motion or a cubic on a grid, shape (N, 2, n)."""
    T = motion.duration
    alpha = (
        cubic_accelerations(task.start, task.goal, T, grid)
        if smooth
        else T**2 * motion.mean_accelerations(grid.nodes * T)
    )
    return np.repeat(alpha[:, None], 2, axis=1)


def _bang_bang_at_bound(task: Task) -> Candidate | None:
    """Bang-coast-bang motion on the uniform grid, if it reaches the bound and is feasible.

    It reaches the bound where the switching times are nodes, as for a motion without coasting that
    switches at half time, on an even number of intervals.
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
    """Grid with nodes at the deciding coordinate's switching times, uniform within each phase."""
    lengths = motion.phases[motion.deciding] / motion.duration
    lengths = lengths[lengths > 1e-6]
    lengths = lengths / lengths.sum()
    least = min(LEAST_PER_PHASE, intervals // len(lengths))
    if least == 0:
        return Grid.of(intervals)
    counts = np.maximum(np.round(intervals * lengths), least).astype(int)
    while counts.sum() != intervals:  # take from the shortest intervals, add to the longest
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


def _record(found: Nearest, runs: Runs, number: int) -> IterationRecord:
    return IterationRecord(
        iteration=number,
        backend=f"{found.backend or runs.backend.name}{SHORTEST_STEPS}",
        inner_iterations=found.inner,
        rows=found.rows,
        relaxed=False,
        curvature=False,
        corrected=False,
        objective=found.at.objective,
        violation=found.at.violation,
        step=1.0 if found.feasible else 0.0,
        time=runs.clock() - runs.started,
    )
