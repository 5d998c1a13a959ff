"""First step of planning: a motion that satisfies the program, as fast as constant accelerations go."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce

from zmp_sqp.planning.program.hold import CONSTANT
from zmp_sqp.planning.search.run import MAX_ITERATIONS, Candidate, Runs
from zmp_sqp.planning.search.task import Task
from zmp_sqp.sqp.result import SQPStatus

__all__ = ["explore"]

SAME_DURATION = 1e-6  # relative: of two solutions as fast as that, the later one has converged
EPSILON = 1e-9
# Guesses: how much slower than the bound, whether smooth, and iterations spent on them. First whether
# the bound can be kept; then a start from which the ZMP's rows are less curved; a smooth one against
# local minima where the motion found takes more than SLOW times the lower bound, or none is; the last
# only if all that leads nowhere.
GUESSES = (
    (1.0, False, 3),
    (1.1, False, MAX_ITERATIONS),
    (1.5, True, MAX_ITERATIONS),
    (2.5, False, MAX_ITERATIONS),
)
SLOW = 1.1
# times the bound: inertial forces shrink to a sixteenth, so that what is still violated is violated
# (nearly) at rest
PATIENT = 4.0


def explore(task: Task, runs: Runs) -> Candidate:
    """Best point of the program with an acceleration per interval, from several guesses.

    Feasible or not: without a feasible one it is the least-violating point that was found, with the
    verdict of the search for the fastest motion.
    """
    tried: list[Candidate] = []
    for slower, smooth, iterations in GUESSES:
        tried.append(_run(task, runs, slower, smooth=smooth, iterations=iterations))
        best = reduce(_better, tried)
        if tried[-1].result.status in (SQPStatus.BOUND_REACHED, SQPStatus.TIME_LIMIT):
            break
        slow = (SLOW * task.lower_bound) ** 2 < best.S
        if best.is_feasible and slower > 1.0 and (smooth or not slow):
            break
    if best.is_feasible or runs.is_late:
        return best
    # the least-violating motion is a slow one, but searches for the fastest do not slow down
    verdict = best.result.status
    slow_one = _run(task, runs, PATIENT, smooth=True, least=PATIENT * task.least)
    tried.append(slow_one)
    if slow_one.is_feasible:
        program = task.program(slow_one.program.reference, CONSTANT, least=task.least)
        tried.append(runs.minimize(program, slow_one.controls, slow_one.S))
    best = reduce(_better, tried)
    if best.is_feasible:
        return best
    return replace(best, result=replace(best.result, status=verdict))


def _run(
    task: Task,
    runs: Runs,
    slower: float,
    *,
    smooth: bool,
    iterations: int = MAX_ITERATIONS,
    least: float | None = None,
) -> Candidate:
    """SQP run from a guess that takes `slower` times the bound."""
    alpha, duration = task.guess(slower * task.least, smooth=smooth)
    program = task.program(duration, CONSTANT, least=task.least if least is None else least)
    return runs.minimize(program, alpha[:, None], duration**2, iterations)


def _better(best: Candidate, found: Candidate) -> Candidate:
    return found if _is_better(found, best) else best


def _is_better(found: Candidate, best: Candidate) -> bool:
    """Whether `found` is to be preferred.

    Feasible before infeasible. Of feasible points the faster one. Otherwise a search that ended
    before one that was cut off, then the one with the smaller violation.
    """
    if found.is_feasible != best.is_feasible:
        return found.is_feasible
    if found.is_feasible:
        return found.S < best.S * (1.0 + SAME_DURATION)
    cut_off = [one.result.status is SQPStatus.ITERATION_LIMIT for one in (found, best)]
    if cut_off[0] != cut_off[1]:
        return cut_off[1]
    # rows carry S
    outside = [
        one.result.at.violation / max(one.result.at.objective, EPSILON) for one in (found, best)
    ]
    return outside[0] < outside[1]
