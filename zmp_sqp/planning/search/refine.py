"""Second step of planning: corners of payload and slope that the motion violates."""

from __future__ import annotations

from zmp_sqp.planning.search.run import Candidate, Runs
from zmp_sqp.planning.search.task import Task

__all__ = ["refine"]


def refine(task: Task, found: Candidate, runs: Runs) -> Candidate:
    """The candidate itself."""
    return found
