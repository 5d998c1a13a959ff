"""Search for the next motion, from the rest of the last one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.control.memory import Memory, Rest
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.proof.boundary_states import meets_boundary_states
from zmp_sqp.planning.proof.certificate import certify_for
from zmp_sqp.planning.search.answer import Status
from zmp_sqp.planning.search.keep_bound import at_the_bound
from zmp_sqp.planning.search.planner import searched, without_search
from zmp_sqp.planning.search.prove import AT_BOUND, Proven, prove
from zmp_sqp.planning.search.run import Candidate, Runs
from zmp_sqp.planning.search.task import Task
from zmp_sqp.sqp.least_distance import nearest_feasible
from zmp_sqp.sqp.result import SQPResult, SQPStatus
from zmp_sqp.sqp.solver import SQPSettings

__all__ = ["Remains", "ready_motion", "replanned"]

# the guess is near the solution: few steps, with the excess between the rows' points from the first
WARM = SQPSettings(resumed=True, converged=1e-4, excess_from=1e-2)
# relative increases of the rest's duration, at which a motion near it is looked for
SLOWER = (0.005, 0.05)


@dataclass(frozen=True, slots=True, eq=False)
class Remains:
    """What remains of the last motion at the time of a new plan.

    Attributes:
        memory: The last motion.
        at: Time at which it is left [s].
        rest: Its rest, in the coordinates of the planner.
    """

    memory: Memory
    at: float
    rest: Rest

    @property
    def motion(self) -> Trajectory:
        """The rest, as a motion that starts at time 0."""
        return self.memory.motion.after(self.at)

    def kept(self, problem: Problem) -> Proven | None:
        """The rest itself, if it starts and ends where a problem does and is certified."""
        motion = self.motion
        if not meets_boundary_states(problem, motion):
            return None
        checked = certify_for(problem, motion)
        if not checked.safe:
            return None
        return Proven(Status.KEPT, checked, motion, motion.duration)


def ready_motion(task: Task, remains: Remains | None, runs: Runs) -> Proven | None:
    """Certified motion that needs no long search; None if there is none.

    With status KEPT it is the rest of the last motion, or a motion near it, looked for only where
    time is limited: a search may find a faster one. With any other status it is the answer.
    """
    known = without_search(task)
    if known is not None or remains is None:
        return known
    at_bound = task.lower_bound * (1.0 + AT_BOUND)
    if remains.rest.duration > at_bound and runs.deadline is None:
        return None
    kept = remains.kept(task.problem)
    if kept is not None and kept.duration <= at_bound:
        return replace(kept, status=Status.FASTEST_POSSIBLE)
    return kept or (None if runs.deadline is None else _joined(task, remains.rest, runs))


def replanned(task: Task, remains: Remains | None, kept: Proven | None, runs: Runs) -> Proven:
    """Fastest certified motion of a search; without one, the last motion of the search.

    Args:
        task: Task from the state now.
        remains: What remains of the last motion; None where it does not help.
        kept: Motion that `ready_motion` found with status KEPT, or None.
        runs: Runner of the searches, with their deadline.
    """
    if remains is None:
        return searched(task, runs)
    if kept is not None and runs.is_late:
        return kept
    found = _from_rest(task, remains.rest, runs)
    if kept is not None and not found.is_feasible:
        return kept
    proven = prove(task, found, runs)
    if proven.status.success:
        if kept is None and proven.duration > remains.rest.duration:
            kept = remains.kept(task.problem)
        if kept is None or proven.duration <= kept.duration:
            return proven
        return replace(kept, status=proven.status)  # the search found nothing faster
    if kept is None and not runs.is_late:
        proven = searched(task, runs)
    if proven.status.success:
        return proven
    return kept or remains.kept(task.problem) or _joined(task, remains.rest, runs) or proven


def _from_rest(task: Task, rest: Rest, runs: Runs) -> Candidate:
    """Motion that the search finds from the rest of the last one."""
    if not rest.is_active:

        def guess(grid: Grid) -> Array:
            return rest.grid.on(grid, rest.controls)

        found = at_the_bound(task, runs, guess)
        if found is not None:
            return found
    grid = Grid.of(task.problem.first_intervals)
    program, point = rest.on(task, grid, max(rest.duration, task.lower_bound))
    y, z, excess = np.zeros(program.equalities), rest.multipliers(program), rest.excess_of(program)
    purpose = "from the rest of the last motion"
    return runs.minimize(program, point, WARM, y=y, z=z, excess=excess, purpose=purpose)


def _joined(task: Task, rest: Rest, runs: Runs) -> Proven | None:
    """Certified motion near the rest, and a little slower; None if there is none."""
    for slower in SLOWER:
        duration = max(rest.duration * (1.0 + slower), task.lower_bound)
        program, point = rest.on(task, Grid.of(task.problem.first_intervals // 2), duration)
        found = nearest_feasible(program, point, runs.backend)
        if not found.feasible:
            continue
        y, z = np.zeros(program.equalities), rest.multipliers(program)
        result = SQPResult(found.point, y, z, found.excess, SQPStatus.FEASIBLE, found.at, ())
        joined = Candidate(program, result)
        runs.record(f"join the rest, {100.0 * slower:g} % slower", joined)
        proven = prove(task, joined, runs)
        if proven.status.success:
            return replace(proven, status=Status.KEPT)
    return None
