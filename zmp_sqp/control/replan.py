"""Search for the next motion, from the remainder of the last one."""

from __future__ import annotations

import operator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.cached import cached_property
from zmp_sqp.control.memory import Memory, Remainder
from zmp_sqp.errors import ProblemError
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.undercarriage import Driving
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.solution import trajectory
from zmp_sqp.planning.proof.boundary_states import meets_boundary_states
from zmp_sqp.planning.proof.certificate import Certificate, certify_for
from zmp_sqp.planning.search.answer import Status
from zmp_sqp.planning.search.explore import explore_bound, explore_guesses
from zmp_sqp.planning.search.keep_bound import at_the_bound
from zmp_sqp.planning.search.planner import arrived, without_search
from zmp_sqp.planning.search.prove import AT_BOUND, Proven, prove
from zmp_sqp.planning.search.refine import refine
from zmp_sqp.planning.search.run import Candidate, Runs
from zmp_sqp.planning.search.task import Task
from zmp_sqp.sqp.least_distance import nearest_feasible
from zmp_sqp.sqp.result import SQPResult, SQPStatus
from zmp_sqp.sqp.solver import SQPSettings

__all__ = ["Earlier", "Effort", "Remains", "coarser", "ready_motion", "replanned"]

# the guess is near the solution: few steps, with the excess between the rows' points from the first
WARM = SQPSettings(
    resumed=True,
    converged=1e-4,
    excess_from=1e-2,
    max_iterations=20,
    all_decisive=True,
    chords=3,
    loosest=1e-5,
    relaxes=False,
)
# relative gain that the first step must promise where the remainder of an optimal motion is at hand
WORTHWHILE = 5e-5
# relative increases of the remainder's duration, at which a motion near it is looked for
SLOWER = (0.005, 0.05)
# share of an optimal motion up to which its remainder is as good as a new solution; only within
# time budgets
SOON = 0.03
SAME_OBJECTS = ("machine", "ground")  # fields of a problem that must be the same for that
SAME_VALUES = (
    "margin",
    "intervals",
    "model",
    "tipping_fraction",
    "payload_uncertainty",
    "slope_uncertainty",
)
# calls in which the search ran out of time, from which on it no longer looks for a motion to join
JOINED = 2


@dataclass(frozen=True, eq=False)
class Remains:
    """What remains of an earlier motion at the time of a new plan.

    Attributes:
        problem: The new problem.
        memory: The earlier motion.
        at: Time at which it is left [s].
    """

    problem: Problem
    memory: Memory
    at: float

    @cached_property
    def remainder(self) -> Remainder:
        """Remainder of the motion, in the coordinates of the planner."""
        return self.memory.remainder(self.at)

    @cached_property
    def motion(self) -> Trajectory:
        """The remainder, as a motion that starts at time 0."""
        return self.memory.motion.after(self.at)

    @cached_property
    def continued(self) -> Problem | None:
        """The new problem with the goal of the remainder; None if the remainder does not fit."""
        if meets_boundary_states(self.problem, self.motion):
            return self.problem
        old, base = self.memory.problem, self.problem.base
        changes: dict[str, Any] = {"goal": old.goal, "goal_velocity": old.goal_velocity}
        if base is not None and old.base is not None:
            goal = {"goal": old.base.goal, "goal_velocity": old.base.goal_velocity}
            changes["base"] = replace(base, **goal)
        try:
            problem = replace(self.problem, **changes)
        except ProblemError:
            return None  # the machine cannot stand there any more
        return problem if meets_boundary_states(problem, self.motion) else None

    @cached_property
    def proven(self) -> Proven | None:
        """The remainder itself, to the new goal or the old one; None unless it is certified."""
        if self.continued is None:
            return None
        checked = certify_for(self.continued, self.motion)
        if not checked.safe:
            return None
        return Proven(Status.KEPT, checked, self.motion, self.motion.duration)

    @property
    def kept(self) -> Proven | None:
        """The remainder itself, if it leads to the new goal and is certified."""
        return self.proven if self.continued is self.problem else None

    @property
    def may_be_at_bound(self) -> bool:
        """Whether a motion at the bound may be near: tip-over did not shape the earlier one."""
        return not self.remainder.is_active and not self.memory.unfinished

    @property
    def is_same_question(self) -> bool:
        """Whether machine, ground and settings are those with which the motion was optimal."""
        old, new = self.memory.problem, self.problem
        same = all(getattr(old, name) is getattr(new, name) for name in SAME_OBJECTS)
        same = same and all(getattr(old, name) == getattr(new, name) for name in SAME_VALUES)
        same = same and np.array_equal(old.payload_com_uncertainty, new.payload_com_uncertainty)
        same = same and len(old.constraints) == len(new.constraints) and old.base is new.base
        same = same and all(map(operator.is_, old.constraints, new.constraints))
        return same and self.memory.status in (Status.OPTIMAL, Status.FASTEST_POSSIBLE)

    @property
    def is_optimal(self) -> bool:
        """Whether the remainder is the solution of the new problem, but for what its grid costs.

        By Bellman's principle the remainder of an optimal motion is optimal. A new search has its
        nodes at other times, and closer together. After up to `SOON` that shortened six remainders
        by less than 2e-5, and one by 2.5e-4.
        """
        return self.is_same_question and self.at <= SOON * self.memory.motion.duration


class Effort(NamedTuple):
    """What there is time for in a search.

    Attributes:
        intervals: Number of intervals of the grid.
        probes: Whether to probe at the bound where tip-over does not shape the remainder.
        fits: Whether a step of the search fits into the time.
    """

    intervals: int
    probes: bool = True
    fits: bool = True


class Ready(NamedTuple):
    """What was found without a long search.

    Attributes:
        proven: Certified motion; None if there is none.
        near: Last point of the attempt to join the remainder, which violates constraints; None if
            there was no attempt.
        probed: Whether it has been probed at the bound.
    """

    proven: Proven | None
    near: Candidate | None = None
    probed: bool = False


class Earlier(NamedTuple):
    """Earlier motions that a new plan may use.

    Attributes:
        last: Remainder of the last certified motion; None if it is far from the state.
        guess: Motion from which the search starts; None if none is near state and goal.
    """

    last: Remains | None
    guess: Remains | None

    @property
    def least_gain(self) -> float:
        """Relative gain that makes a search worth while, where the remainder is optimal; else 0."""
        last, guess = self
        if last is None or last is not guess or not last.is_same_question:
            return 0.0
        return WORTHWHILE if last.continued is last.problem else 0.0

    @property
    def kept(self) -> Proven | None:
        """Remainder of the last motion, if it leads to the new goal and is certified."""
        return None if self.last is None else self.last.kept


def coarser(intervals: int) -> int:
    """Half of the intervals, at least the two that a motion with a fixed duration needs."""
    return max(intervals // 2, 2)


class Answer(NamedTuple):
    """How a search ended.

    Attributes:
        proven: Certified motion, or the last motion of the search if there is none.
        unfinished: Last point of a search that ran out of time; None if it did not.
    """

    proven: Proven
    unfinished: Candidate | None = None


def ready_motion(
    task: Task,
    earlier: Earlier,
    runs: Runs,
    *,
    joins: bool = True,
    probes: bool = True,
    keeps: bool = True,
) -> Ready:
    """Certified motion that needs no long search.

    With status KEPT it is the remainder of the last motion, or a motion near it, looked for only
    where time is limited: a search may find a faster one. With any other status it is the answer.

    Args:
        task: Task from the state now.
        earlier: Earlier motions.
        runs: Runner of the searches, with their deadline.
        joins: Whether there is time to look for a motion near an earlier one.
        probes: Whether to probe at the bound where the earlier motion was there.
        keeps: Whether there is time to certify the remainder of the last motion before a search.
    """
    known = arrived(task.problem) or without_search(task)
    if known is not None or not keeps:
        return Ready(known)
    at_bound, last, guess = task.lower_bound * (1.0 + AT_BOUND), earlier.last, earlier.guess
    solved = runs.deadline is not None and last is not None and last.is_optimal
    if runs.deadline is None and (last is None or last.remainder.duration > at_bound):
        return Ready(None)
    kept = earlier.kept
    if kept is not None and solved and last is not None:
        return Ready(replace(kept, status=last.memory.status or Status.KEPT))
    if kept is not None and kept.duration <= at_bound:
        return Ready(replace(kept, status=Status.FASTEST_POSSIBLE))
    if kept is not None or runs.deadline is None or guess is None:
        return Ready(kept)
    probed = probes and guess.memory.status is Status.FASTEST_POSSIBLE and guess.may_be_at_bound
    if probed and (found := _probed(task, guess, runs)) is not None:
        proven = prove(task, found, runs)
        if proven.status.success:  # and nothing to join is needed
            return Ready(proven, probed=True)
    if guess.memory.unfinished >= JOINED or not joins:
        return Ready(None, probed=probed)
    return _joined(task, guess.remainder, runs)._replace(probed=probed)


def replanned(
    task: Task, earlier: Earlier, ready: Ready, runs: Runs, effort: Effort, *, spared: bool = False
) -> Answer:
    """Fastest certified motion of a search; without one, the last motion of the search.

    Args:
        task: Task from the state now.
        earlier: Earlier motions.
        ready: What `ready_motion` found, with status KEPT if anything.
        runs: Runner of the searches, with their deadline.
        effort: What there is time for.
        spared: Whether there is another certified motion, so that what violates the constraints
            when time is up needs no certificate.
    """
    kept, guess = ready.proven, earlier.guess
    if guess is None and kept is None:
        return _from_nothing(task, runs, spared=spared, probes=effort.probes)
    if kept is not None and (runs.is_late or guess is None):
        return Answer(kept)
    if runs.is_late and spared and ready.near is not None:
        return Answer(_without_proof(task, ready.near), ready.near)
    if guess is None:
        raise RuntimeError("replanned: there is neither a guess nor a certified motion")
    found = _from_rest(task, guess, runs, effort, least_gain=earlier.least_gain)
    if found.result.status is SQPStatus.NO_GAIN:
        kept = kept or earlier.kept
        if kept is not None:
            return Answer(replace(kept, status=Status.OPTIMAL))
        found = _from_rest(task, guess, runs, effort)
    if kept is not None and not found.is_feasible:
        return Answer(kept, found)
    if spared and runs.is_late and not found.is_feasible:
        return Answer(_without_proof(task, found), found)
    proven = prove(task, found, runs)
    kept = kept or (earlier.kept if proven.duration > guess.remainder.duration else None)
    if proven.status.success:
        if kept is None or proven.duration <= kept.duration:
            return Answer(proven)
        return Answer(replace(kept, status=proven.status))  # the search found nothing faster
    if spared and kept is None and runs.is_late:
        return Answer(proven, found)  # there is another certified motion, and no time to join it
    kept = kept or earlier.kept
    if kept is not None and earlier.last is not None and earlier.last.is_same_question:
        return Answer(replace(kept, status=Status.SAFE))  # a search from nothing found no more
    if kept is None and not runs.is_late:
        answer = _from_nothing(task, runs, spared=spared)
        if answer.proven.status.success:
            return answer
        proven = answer.proven
    return Answer(kept or _joined(task, guess.remainder, runs).proven or proven, found)


def _from_nothing(task: Task, runs: Runs, *, spared: bool, probes: bool = True) -> Answer:
    """Motion of a search like that of `plan`; without certificate if time is up and not needed."""
    found = explore_bound(task, runs) if probes or runs.deadline is None else None
    if found is None and spared and runs.is_late:  # to make a guess over terrain takes 10 ms
        nothing = Certificate.of_nothing(task.problem.margin)
        return Answer(Proven(Status.TIME_BUDGET, nothing, None, task.lower_bound))
    found = found or explore_guesses(task, runs)
    if spared and runs.is_late and not found.is_feasible:
        return Answer(_without_proof(task, found), found)
    proven = prove(task, refine(task, found, runs), runs)
    is_done = proven.status.success and not runs.is_late
    return Answer(proven, None if is_done else found)


def _without_proof(task: Task, found: Candidate) -> Proven:
    """Last motion of a search that ran out of time, without certificate.

    Over terrain there is no attempt: to build that motion takes longer than a step of the search.
    """
    nothing, problem = Certificate.of_nothing(task.problem.margin), task.problem
    base = problem.undercarriage
    if isinstance(base, Driving) and not base.terrain.uniform:
        return Proven(Status.TIME_BUDGET, nothing, None, found.duration)
    motion = trajectory(problem, found.program, found.motion, found.fine)
    return Proven(Status.TIME_BUDGET, nothing, motion, motion.duration, candidate=found)


def _from_rest(
    task: Task, guess: Remains, runs: Runs, effort: Effort, *, least_gain: float = 0.0
) -> Candidate:
    """Motion that the search finds from the remainder of the last one."""
    remainder = guess.remainder
    if effort.probes and guess.may_be_at_bound:
        found = _probed(task, guess, runs)
        if found is not None:
            return found
    grid = Grid.of(effort.intervals)
    program, point = remainder.on(task, grid, max(remainder.duration, task.lower_bound))
    y, z, excess = (
        np.zeros(program.equalities),
        remainder.multipliers(program),
        remainder.excess_of(program),
    )
    purpose = "from the remainder of the last motion"
    settings = replace(WARM, worthwhile=least_gain)
    return runs.minimize(program, point, settings, y=y, z=z, excess=excess, purpose=purpose)


def _probed(task: Task, guess: Remains, runs: Runs) -> Candidate | None:
    """Feasible motion at the bound, from probes that begin at the remainder of a motion."""
    remainder = guess.remainder

    def on(grid: Grid) -> Array:
        return remainder.grid.on(grid, remainder.controls)

    return at_the_bound(task, runs, on)


def _joined(task: Task, remainder: Remainder, runs: Runs) -> Ready:
    """Certified motion near the remainder, and a little slower."""
    near: Candidate | None = None
    for slower in SLOWER:
        duration = max(remainder.duration * (1.0 + slower), task.lower_bound)
        program, point = remainder.on(
            task, Grid.of(coarser(task.problem.first_intervals)), duration
        )
        found = nearest_feasible(program, point, runs.backend)
        y, z = np.zeros(program.equalities), remainder.multipliers(program)
        status = SQPStatus.FEASIBLE if found.feasible else SQPStatus.TIME_LIMIT
        result = SQPResult(found.point, y, z, found.excess, status, found.at, ())
        near = Candidate(program, result)
        if found.feasible:
            runs.record(f"join the remainder, {100.0 * slower:g} % slower", near)
            proven = prove(task, near, runs)
            if proven.status.success:
                return Ready(replace(proven, status=Status.KEPT))
        if runs.is_late:
            break
    return Ready(None, near)
