"""First step of planning: a motion at the lower bound, or else the SQP from coarse to fine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.planning.program.grid import ENDS, Grid
from zmp_sqp.planning.program.staged import POINTS, Motion, StagedProgram
from zmp_sqp.planning.search.detour import detour
from zmp_sqp.planning.search.keep_bound import at_the_bound
from zmp_sqp.planning.search.run import Candidate, Runs
from zmp_sqp.planning.search.task import Task
from zmp_sqp.sqp.result import SQPResult, SQPStatus
from zmp_sqp.sqp.solver import SQPSettings

__all__ = [
    "RESUMED",
    "explore",
    "explore_bound",
    "explore_guesses",
    "on_finer_grid",
    "transferred",
]

# initial guesses, tried in turn until one succeeds: duration per lower bound, and whether it is a
# cubic. A cubic at 1.15 ends in better local minima than a bang-coast-bang motion, in as many
# iterations. The second one is tried, too, with `intervals="auto"` where the first one ends far
# above the lower bound.
GUESSES = ((1.15, True), (1.5, True), (2.5, False))
FAR_ABOVE = 1.1  # duration per lower bound, above which the motion may be a bad local minimum
# intervals of the glance at the second guess. It overestimates durations by 0.1-4 %: if it still
# promises a faster motion than the one found, that one is another and better local minimum
GLANCE = 16
FASTER = 0.999  # promised duration per that of the motion at hand, below which it is pursued
GLANCING = SQPSettings(converged=1e-2, coarse=3e-2, excess_from=0.0, max_iterations=12)
LEAST_COARSE = 4  # fewest intervals of a grid that is half as fine as the problem's
COARSEST = 25  # fewest intervals of still coarser ones
# runs on coarse grids only prepare that on the finest one, and end early
COARSE = SQPSettings(converged=1e-3, coarse=1e-2, excess_from=0.0)
RESUMED, RESUMED_COARSE = SQPSettings(resumed=True), replace(COARSE, resumed=True)
SLOW = 5.0  # duration per lower bound at which inertial forces hardly move the ZMP (1/25)
LESS = 0.95  # a slow motion is pursued if its violation is below this share of the best one's
# statuses after which no further guess is tried
ENOUGH = (SQPStatus.BOUND_REACHED, SQPStatus.OPTIMAL, SQPStatus.FEASIBLE)

Guess = Callable[[int], tuple[Array, float]]


def explore(task: Task, runs: Runs) -> Candidate:
    """Fastest feasible motion of all guesses; the least-violating motion if none is feasible."""
    return explore_bound(task, runs) or explore_guesses(task, runs)


def explore_bound(task: Task, runs: Runs) -> Candidate | None:
    """First part of `explore`: feasible motion at the lower bound; None if none is found."""
    runs.enter("explore")
    return at_the_bound(task, runs)


def explore_guesses(task: Task, runs: Runs) -> Candidate:
    """Second part of `explore`: SQP runs from the guesses."""
    tried: list[Candidate] = []
    for pace, smooth in GUESSES:
        guess = partial(task.guess, pace * task.least, smooth=smooth)
        purpose = f"{'cubic' if smooth else 'bang-coast-bang'}, {pace:g} x bound"
        tried.append(_coarse_to_fine(task, runs, guess, purpose))
        last = tried[-1].result.status
        far = tried[-1].duration > FAR_ABOVE * task.lower_bound
        if last in ENOUGH and far and len(tried) == 1 and _may_be_faster(task, runs, tried[0]):
            continue
        if last in ENOUGH or last is SQPStatus.INFEASIBLE or runs.is_late:
            break
    best = min(tried, key=_rank)
    if best.is_feasible or runs.is_late:
        return best
    around = detour(task, runs)
    if around is not None:
        found = _coarse_to_fine(task, runs, around, "along poses that stand")
        if found.is_feasible or runs.is_late:
            return min(best, found, key=_rank)
    return _slower(task, runs, best)


def _may_be_faster(task: Task, runs: Runs, found: Candidate) -> bool:
    """Whether the second guess may lead to a faster motion than one found.

    With `intervals="auto"` it is worth a try. Otherwise a glance on few intervals tells.
    """
    if task.problem.refines:
        return True
    if runs.is_late:
        return False
    pace, smooth = GUESSES[1]
    intervals = min(GLANCE, task.problem.first_intervals)
    controls, duration = task.guess(pace * task.least, intervals, smooth=smooth)
    program = task.program(duration, Grid.of(intervals))
    point = program.pack(controls, duration**2)
    glance = runs.minimize(program, point, GLANCING, purpose=f"glance, {pace:g} x bound")
    enough = glance.result.status in (*ENOUGH, SQPStatus.COARSE)
    return enough and glance.duration < FASTER * found.duration


def _rank(candidate: Candidate) -> tuple[bool, float]:
    """Sort key: feasible candidates by duration, then others by violation over sigma."""
    at, feasible = candidate.result.at, candidate.is_feasible
    if feasible or at is None:
        return not feasible, candidate.duration if feasible else np.inf
    return True, at.violation / max(at.objective, 1e-9)


def _coarse_to_fine(task: Task, runs: Runs, guess: Guess, purpose: str) -> Candidate:
    """SQP run on a coarse grid, continued on grids twice as fine up to the problem's own.

    Args:
        task: Task to plan.
        runs: Runner of the SQP.
        guess: Accelerations T^2 a, shape (N, 2, n), and duration T [s] on N equal intervals.
        purpose: Name of the guess, for the record of the run.
    """
    sizes = _grid_sizes(task.problem.first_intervals)
    controls, duration = guess(sizes[0])
    program = task.program(duration, Grid.of(sizes[0]))
    settings = COARSE if len(sizes) > 1 and not task.problem.refines else SQPSettings()
    point = program.pack(controls, duration**2)
    found = runs.minimize(program, point, settings, purpose=purpose)
    if found.result.status is SQPStatus.INFEASIBLE:  # only the finest grid may change that
        sizes = sizes[-2:]
    for size in sizes[1:]:
        if runs.is_late:
            break
        settings = RESUMED if size == sizes[-1] else RESUMED_COARSE
        found = on_finer_grid(task, runs, found, Grid.of(size), settings)
    return found


def _grid_sizes(intervals: int) -> list[int]:
    """Numbers of intervals from coarse to fine, each about half of the next."""
    sizes = [intervals]
    while sizes[0] >= 2 * (LEAST_COARSE if len(sizes) == 1 else COARSEST):
        sizes.insert(0, sizes[0] // 2)
    return sizes


def on_finer_grid(
    task: Task, runs: Runs, found: Candidate, grid: Grid, settings: SQPSettings = RESUMED
) -> Candidate:
    """SQP run on a finer grid, started from motion and multipliers on a coarser one."""
    fine = task.program(found.program.reference, grid)
    point, y, z = transferred(found, fine)
    purpose, status = "finer grid", found.result.status
    if status is SQPStatus.INFEASIBLE:  # a finer grid may still be feasible
        return runs.minimize(fine, point, SQPSettings(), purpose=purpose)
    finer = runs.minimize(fine, point, settings, y=y, z=z, purpose=purpose)
    return replace(finer, coarser=found.duration if status.is_feasible else None)


def transferred(found: Candidate, fine: StagedProgram) -> tuple[Motion, Array, Array]:
    """Motion and multipliers (y, z) of a candidate, transferred to a finer grid.

    The multipliers of an interval's nonlinear rows and acceleration limits are distributed over the
    intervals that it is divided into, in proportion to their lengths. All other limits start with
    zero multipliers.
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
    """Least-violating motion among an infeasible one, a much slower one, and the SQP from there.

    An infeasible run ends at any duration, where inertial forces may add to a violation that exists
    even at rest. The failure message shall report the violation that remains in a slow motion.
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
    purpose = f"cubic, {SLOW:g} x bound or slower"
    found = runs.minimize(program, point, SQPSettings(), purpose=purpose)
    return min(best, slow, found, key=_rank)
