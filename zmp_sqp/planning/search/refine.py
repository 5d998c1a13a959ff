"""Second step of planning: accelerations that run linearly within the intervals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from zmp_sqp.planning.program.hold import LINEAR
from zmp_sqp.planning.search.run import Candidate, Runs
from zmp_sqp.planning.search.slopes import free_slopes, linear_controls
from zmp_sqp.planning.search.task import Task
from zmp_sqp.sqp.result import SQPStatus

__all__ = ["REFINEMENTS", "Refined", "refine"]

REFINEMENTS = 30  # iterations with linear accelerations; what is not feasible by then is dropped


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """A point to prove, and the program to solve again if the proof fails.

    Attributes:
        candidate: The point.
        least: Lower bound that its program puts on the duration [s].
        ties: Of the slopes of linear accelerations, or None.
    """

    candidate: Candidate
    least: float
    ties: Any = None


def refine(task: Task, found: Candidate, runs: Runs) -> Refined:
    """The point with linear accelerations where the ZMP costs time and they make it faster."""
    unchanged = Refined(found, task.least)
    if found.result.status not in (SQPStatus.OPTIMAL, SQPStatus.FEASIBLE) or runs.is_late:
        return unchanged
    least = task.lower_bound  # the grid's bound is one of constant accelerations
    reference = found.program.reference
    ties, spread = linear_controls(found.controls)
    if ties is not None:
        untied = task.program(reference, LINEAR, least=least)
        ties = free_slopes(ties, untied, found.program, found.result)
    program = task.program(reference, LINEAR, least=least, ties=ties)
    refined = runs.minimize(program, spread, found.S, REFINEMENTS)
    if refined.is_feasible and refined.S <= found.S:
        return Refined(refined, least, ties)
    return unchanged
