"""First step of planning: a motion at the bound, or else the fastest one, from coarse to fine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.planning.program.grid import ENDS, Grid
from zmp_sqp.planning.program.staged import POINTS, Motion, StagedProgram
from zmp_sqp.planning.search.keep_bound import at_the_bound
from zmp_sqp.planning.search.run import Candidate, Runs
from zmp_sqp.planning.search.task import Task
from zmp_sqp.sqp.result import SQPResult, SQPStatus
from zmp_sqp.sqp.solver import SQPSettings

__all__ = ["RESUMED", "explore", "on_finer_grid", "transferred"]

# Guesses: how much slower than the bound, and whether smooth. The first one serves nearly always:
# a cubic in joint space at this pace ends in better minima than a bang-bang motion, and in fewer
# iterations. The second is tried, too, where the number of intervals is left to the planner and the
# first ends far above the bound; otherwise the others are for failures.
GUESSES = ((1.15, True), (1.5, True), (2.5, False))
FAR_ABOVE = 1.1  # times the lower bound
LEAST_COARSE = 4  # intervals of a coarse grid
# On the coarse grid the search ends early.
COARSE = SQPSettings(converged=1e-3, coarse=1e-2, excess_from=0.0)
RESUMED = SQPSettings(resumed=True)
SLOW = 5.0  # times the bound: a pace at which dynamics hardly move the zero moment point
LESS = 0.95  # of the violation: a slow motion that violates less than this is looked into
ENOUGH = (SQPStatus.BOUND_REACHED, SQPStatus.OPTIMAL, SQPStatus.FEASIBLE)


def explore(task: Task, runs: Runs) -> Candidate:
    """The fastest motion that is found; without a feasible one the least-violating motion."""
    found = at_the_bound(task, runs)
    if found is not None:
        return found
    tried: list[Candidate] = []
    for pace, smooth in GUESSES:
        tried.append(_coarse_to_fine(task, runs, pace, smooth=smooth))
        last = tried[-1].result.status
        far = tried[-1].duration > FAR_ABOVE * task.lower_bound
        if last in ENOUGH and task.problem.refines and far and len(tried) == 1:
            continue
        if last in ENOUGH or last is SQPStatus.INFEASIBLE or runs.is_late:
            break
    best = min(tried, key=_rank)
    return best if best.is_feasible or runs.is_late else _slower(task, runs, best)


def _rank(candidate: Candidate) -> tuple[bool, float]:
    """Feasible ones first, by duration; then the others, by violation per unit of rows' scale."""
    at, feasible = candidate.result.at, candidate.is_feasible
    scaled = at.violation / max(at.objective, 1e-9)
    return not feasible, candidate.duration if feasible else scaled


def _coarse_to_fine(task: Task, runs: Runs, pace: float, *, smooth: bool) -> Candidate:
    """SQP on half of the intervals, then on all of them."""
    intervals, refines = task.problem.first_intervals, task.problem.refines
    grids = [Grid.of(intervals)]
    if intervals >= 2 * LEAST_COARSE:
        grids.insert(0, Grid.of(intervals // 2))
    controls, duration = task.guess(pace * task.least, grids[0].size, smooth=smooth)
    program = task.program(duration, grids[0])
    settings = COARSE if len(grids) > 1 and not refines else SQPSettings()
    shape = "cubic" if smooth else "bang-coast-bang"
    purpose = f"guess: {shape} at {pace:g} times the bound"
    point = program.pack(controls, duration**2)
    found = runs.minimize(program, point, settings, purpose=purpose)
    if len(grids) == 1 or runs.is_late:
        return found
    return on_finer_grid(task, runs, found, grids[1])


def on_finer_grid(task: Task, runs: Runs, found: Candidate, grid: Grid) -> Candidate:
    """SQP on a finer grid, from where it ended on a coarser one."""
    fine = task.program(found.program.reference, grid)
    point, y, z = transferred(found, fine)
    purpose, status = "from the coarser grid", found.result.status
    if status is SQPStatus.INFEASIBLE:  # the finer grid has the last word
        return runs.minimize(fine, point, SQPSettings(), purpose=purpose)
    finer = runs.minimize(fine, point, RESUMED, y=y, z=z, purpose=purpose)
    return replace(finer, coarser=found.duration if status.is_feasible else None)


def transferred(found: Candidate, fine: StagedProgram) -> tuple[Motion, Array, Array]:
    """The motion and the multipliers of a candidate on a finer grid.

    Multipliers of rows of an interval are shared among the intervals that it is cut into, in
    proportion to their lengths. Rates at nodes and positions get none.
    """
    coarse, result = found.program, found.result
    parent = coarse.grid.parents(fine.grid)
    share = fine.grid.steps / coarse.grid.steps[parent]
    controls = coarse.grid.on(fine.grid, found.controls)
    point = fine.pack(controls, found.S)
    z = np.zeros(fine.inequalities)
    count, rows = coarse.nonlinear, coarse.rows.count * POINTS
    of_rows = result.z[:count].reshape(coarse.grid.size, rows)
    z[: fine.nonlinear] = (of_rows[parent] * share[:, None]).ravel()
    sides = 2 * ENDS * coarse.n
    of_controls = result.z[count : count + sides * coarse.grid.size]
    by_side = of_controls.reshape(2, coarse.grid.size, -1)[:, parent] * share[:, None]
    z[fine.nonlinear : fine.nonlinear + sides * fine.grid.size] = by_side.ravel()
    y = result.y.reshape(coarse.grid.size, -1)[parent].ravel() if len(result.y) else result.y
    return point, np.asarray(y), z


def _slower(task: Task, runs: Runs, best: Candidate) -> Candidate:
    """The least-violating of a motion without success and of far slower ones.

    A search that fails ends where its steps no longer help, at a pace that may add to what even a
    motion at rest would violate. The message is to tell of the latter.
    """
    duration, grid = SLOW * task.least, Grid.of(task.problem.first_intervals)
    controls, duration = task.guess(duration, grid.size, smooth=True)
    program = task.program(duration, grid, least=duration)
    point = program.pack(controls, duration**2)
    at = program.evaluate(point)
    nothing = np.zeros(program.equalities), np.zeros(program.inequalities)
    slow = Candidate(program, SQPResult(point, *nothing, None, SQPStatus.INFEASIBLE, at, ()))
    if not _rank(slow) < (True, LESS * _rank(best)[1]):
        return best
    purpose = f"guess: cubic at {SLOW:g} times the bound or slower"
    found = runs.minimize(program, point, SQPSettings(), purpose=purpose)
    return min(best, slow, found, key=_rank)
