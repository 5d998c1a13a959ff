"""Planner for control code: warm starts from the last motion, time budgets, certified stops."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array, shortened
from zmp_sqp.blas import one_blas_thread
from zmp_sqp.control.measured import widened_limits, within_limits
from zmp_sqp.control.memory import Memory
from zmp_sqp.control.question import Question, Standing
from zmp_sqp.control.replan import (
    Earlier,
    Effort,
    Remains,
    coarser,
    ready_motion,
    replanned,
)
from zmp_sqp.control.sole_use import SoleUse
from zmp_sqp.control.stop import INTERVALS as STOP_INTERVALS
from zmp_sqp.control.stop import StopProblem, backend_of, stop_plan
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.ground import Ground, Slope, check_ground, is_uneven
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.uncertainty import com_box
from zmp_sqp.planning.constraints.binding import checked_constraints
from zmp_sqp.planning.problem.checks import (
    UNCERTAINTIES,
    checked_in_range,
    checked_intervals,
    checked_margin,
)
from zmp_sqp.planning.problem.problem import Problem, check_model
from zmp_sqp.planning.problem.undercarriage import Driving
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase
from zmp_sqp.planning.program.solution import trajectory
from zmp_sqp.planning.search.answer import Plan, Status
from zmp_sqp.planning.search.keep_bound import REFUSED, SHORTEST_STEPS
from zmp_sqp.planning.search.planner import answer, checked_budget
from zmp_sqp.planning.search.prove import Proven
from zmp_sqp.planning.search.run import Candidate, Runs
from zmp_sqp.planning.search.task import Task, lower_bound_of, task_of
from zmp_sqp.sqp.backends import make_backend
from zmp_sqp.sqp.result import IterationRecord

__all__ = ["Planner"]

LEVEL = Slope()
USEFUL = 0.3  # distance of the state from the last motion (`Memory.nearest`) up to which it helps
USEFUL_GOAL = 0.5  # change of the goal per range of the last motion up to which it helps
ROUNDING = 1e-6  # [s] by which an `elapsed` may be negative
LEFT = 0.01  # share of the last motion that must be left for it to help
RESERVE = 1.3  # time kept for the certificate, per time that it took last
FADING = 0.9  # of times that are expected, at every call that they leave no time for a step
COARSEST = 12  # intervals down to which grids are halved where a step does not fit otherwise
LEAST_STEP = 0.7  # share of the time of a step that must be left for it to begin
GIVEN_UP = 6  # calls that go on with an unfinished search; then it starts from the last motion
# share of the budget that is kept for it before the first one, on planes and over terrain
FIRST_RESERVE, FIRST_RESERVE_OVER_TERRAIN = 0.2, 0.7


@dataclass(slots=True, eq=False)
class Planner:
    """Plans again and again for a machine in motion.

    It keeps the last certified motion with its multipliers. A new plan starts from the remainder of
    that motion, falls back to a search from nothing, and is certified anew. Attributes may be
    changed between calls; constraints of your own must not change in place: give new ones. Copies,
    pickled ones too, go on from the same motion.

    Attributes:
        machine: The machine, with its payload.
        ground: Ground under the machine.
        margin, intervals, model, constraints, tipping_fraction, payload_uncertainty,
        slope_uncertainty, payload_com_uncertainty: As for `Problem`.
        qp_solver: As for `plan`.
        clock: Clock of time budgets [s]: `time.perf_counter` is wall time, `time.process_time` that
            of this process alone, for simulations on a computer that does other work too.
    """

    machine: Machine
    ground: Ground = LEVEL
    margin: float = 0.0
    intervals: int | str = 50
    qp_solver: str = "auto"
    model: str = "full"
    constraints: Any = ()
    tipping_fraction: float = 1.0
    payload_uncertainty: float = 0.0
    slope_uncertainty: float = 0.0
    payload_com_uncertainty: Any = 0.0
    clock: Callable[[], float] = time.perf_counter
    _memory: Memory | None = field(default=None, init=False, repr=False)
    # [s] time in the motion in memory at which the motion that was returned last begins
    _begins: float = field(default=0.0, init=False, repr=False)
    # last motion to the goal of a search that has not succeeded yet
    _guess: Memory | None = field(default=None, init=False, repr=False)
    # plan to stay where the machine stood at the last stop
    _standing: Standing | None = field(default=None, init=False, repr=False)
    # what the last call asked for
    _question: Question | None = field(default=None, init=False, repr=False)
    _in_use: SoleUse = field(default_factory=SoleUse, init=False, repr=False)
    # whether the last search probed at the bound in vain
    _refused_probe: bool = field(default=False, init=False, repr=False)
    # whether the last time budget had no room for a step of the search beside two certificates
    _starved: bool = field(default=False, init=False, repr=False)
    _step_time: float = field(default=0.0, init=False, repr=False)  # [s] per interval
    _proof_time: float = field(default=0.0, init=False, repr=False)  # [s] of the last certificate
    # both as measured last: those above are hopes where they leave no time for a step
    _measured: tuple[float, float] = field(default=(0.0, 0.0), init=False, repr=False)

    def __post_init__(self) -> None:
        self._check()
        make_backend(self.qp_solver)  # refuses a name that it does not know
        check_ground(self.ground)
        self.intervals = checked_intervals(self.intervals, self.machine.size)
        check_model(self.model)
        if self.machine.support is not None:
            self.margin = checked_margin(self.margin, self.machine)
        for allowed in UNCERTAINTIES:
            setattr(self, allowed.name, checked_in_range(allowed, getattr(self, allowed.name)))
        com_box(self.payload_com_uncertainty, name="payload_com_uncertainty")
        given = checked_constraints(self.constraints)
        if not isinstance(self.constraints, list | tuple):
            self.constraints = given  # an iterator has its constraints only once

    def __getstate__(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in self.__slots__ if name != "_in_use"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            setattr(self, name, value)
        self._in_use = SoleUse()

    @one_blas_thread()
    def plan(
        self,
        start: Any,
        goal: Any,
        start_velocity: Any = None,
        time_budget: float | None = None,
        *,
        goal_velocity: Any = None,
        base: UnicycleBase | None = None,
        elapsed: float | None = None,
        progress: Callable[[IterationRecord], None] | None = None,
    ) -> Plan:
        """Fastest certified motion that is found from a state to a goal, within a time budget.

        Args:
            start: Joint coordinates where the new motion begins, shape (n,) [rad or m]: those of
                the reference at that time as a rule, not the measured ones (docs/control.md). A
                state beyond the limits by 0.01 rad or m, or 5 % of a rate limit, is treated as
                being at them. Within 1e-6 rad or m of the goal, at rest, the machine is there.
            goal: Joint coordinates at the goal, shape (n,) [rad or m].
            start_velocity: Joint rates there, shape (n,) [rad/s or m/s]; None is rest.
            time_budget: Time for the answer by `clock` [s]; None for no limit.
            goal_velocity: Joint rates at the goal, shape (n,) [rad/s or m/s]; None is rest.
            base: Base that drives, from its pose and velocity now; None for one that stands.
            elapsed: Time since the start of the motion that the last call returned [s]; None finds
                the time at which that motion is nearest to the state.
            progress: Called after every SQP iteration with its record.

        Returns:
            The plan. Where no motion to the goal is certified in time: the remainder of the last
            motion, with status KEPT, even if it leads to another goal (that of `plan.problem`);
            else a safe motion to rest, with status STOP; else a plan without success.

        Raises:
            ProblemError: Wrong arguments, a goal that is refused, or a call while another thread
                uses this planner.
        """
        with self._in_use.held():
            self._check()
            elapsed = _checked_elapsed(elapsed)
            if not isinstance(self.constraints, list | tuple):
                self.constraints = checked_constraints(self.constraints)
            n, joints = self.machine.size, self.machine.joint_names
            q, v = (
                frozen_array(given, name=name, shape=(n,), error=ProblemError, labels=joints)
                for name, given in (
                    ("start", start),
                    ("start_velocity", np.zeros(n) if start_velocity is None else start_velocity),
                )
            )
            q, v = within_limits(self.machine, q, v)
            fields = self._fields(q, v, base)
            runs = self._runs(time_budget, progress)
            try:
                task = self._task({**fields, "goal": goal, "goal_velocity": goal_velocity})
            except ProblemError as fault:
                return self._refused(fault, fields, runs)
            return self._planned(task, fields, elapsed, runs, time_budget)

    def _check(self) -> None:
        """Refuse what is no machine, and what is no clock.

        Raises:
            ProblemError: The machine is no Machine, or the clock cannot be called.
        """
        if not isinstance(self.machine, Machine):
            raise ProblemError(f"machine must be a Machine, not {shortened(self.machine)}")
        if not callable(self.clock):
            raise ProblemError(
                "clock must be a function that returns seconds, such as time.perf_counter, not "
                f"{shortened(self.clock)}"
            )

    def _task(self, arguments: Mapping[str, Any]) -> Task:
        """Planning task of a `Problem`; what has not changed since the last one is kept.

        Raises:
            ProblemError: Wrong arguments, or a start or goal that is refused.
        """
        last = self._question
        known = None if last is None else last.from_start(arguments)
        if known is not None and last is not None:
            return task_of(known, last.constraints)
        task = task_of(Problem(**arguments))
        self._question = Question.of(arguments, task.problem, task.constraints)
        return task

    def _planned(
        self,
        task: Task,
        fields: Mapping[str, Any],
        elapsed: float | None,
        runs: Runs,
        budget: float | None,
    ) -> Plan:
        """Plan of a task, or a stop where none is certified."""
        problem = task.problem
        earlier = self._earlier(problem, elapsed)
        half = self._step_time * coarser(problem.first_intervals)
        joins = runs.deadline is None or runs.deadline - runs.clock() > half
        first, probes = self._searches_first(earlier.last, runs), not self._refused_probe
        ready = ready_motion(task, earlier, runs, joins=joins, probes=probes, keeps=not first)
        proven, unfinished, spare, advice = ready.proven, None, None, ""
        if proven is None or proven.status is Status.KEPT:
            # a machine at rest may stay there, which needs no proof within the budget
            spared = runs.deadline is not None and (first or not task.start.v.any())
            if proven is None and runs.deadline is not None and not spared:
                spare = self._spare(earlier.last, fields, runs)
                spared = spare is not None
            optional = proven is not None or spared
            if optional and budget is not None:
                runs.ends = runs.started + budget
            effort = self._effort(
                problem, earlier.guess, runs, optional=optional, coarse=first or proven is None
            )
            effort = effort._replace(probes=effort.probes and not ready.probed)
            self._starved = not effort.fits
            advice = "" if budget is None else self._advice(budget, effort, earlier.guess)
            proven, unfinished = replanned(task, earlier, ready, runs, effort, spared=spared)
            # every other call has all of its time for the search proper
            vain = effort.probes and unfinished is None and not proven.status.success
            self._refused_probe = vain or any(run.status == REFUSED for run in runs.runs)
        self._note_times(runs)
        plan = answer(problem, self.qp_solver, task.lower_bound, proven, runs)
        if advice and (plan.status is Status.KEPT or not plan.success):
            plan = replace(plan, message=f"{plan.message}{advice}")
        self._guess = _unfinished(problem, earlier.guess, proven, unfinished)
        if not plan.success:
            spare = self._spare(earlier.last, fields, runs) if first else spare
            return self._instead(plan, spare, earlier.last, fields, runs, advice)
        if earlier.last is not None and proven.attempt is earlier.last.motion:
            self._begins = earlier.last.at  # it is found again in memory, with its multipliers
        else:
            self._remember(plan, proven.candidate)
        return plan

    def _searches_first(self, last: Remains | None, runs: Runs) -> bool:
        """Whether the remainder of the last motion is certified only if the search fails.

        So it is after a call whose time budget had no room for a step beside its certificate.
        """
        fits = last is not None and last.continued is not None
        return self._starved and runs.deadline is not None and fits

    def _effort(
        self,
        problem: Problem,
        remains: Remains | None,
        runs: Runs,
        *,
        optional: bool,
        coarse: bool = False,
    ) -> Effort:
        """What there is time for; also draws in the deadline, because steps are finished.

        Args:
            problem: The new problem.
            remains: Motion from which the search starts.
            runs: Runner of the searches, with their deadline.
            optional: Whether there is a certified motion already.
            coarse: Whether grids may be as coarse as `COARSEST` for a step to fit.
        """
        intervals = problem.first_intervals
        if runs.deadline is None:
            return Effort(intervals)
        left = runs.deadline - runs.clock()
        unfinished = remains is not None and remains.memory.unfinished > 0
        if unfinished or left < self._step_time * intervals:
            intervals = coarser(intervals)
        while coarse and intervals > COARSEST and left < LEAST_STEP * self._step_time * intervals:
            intervals = coarser(intervals)
        step = self._step_time * intervals
        fits = not optional or left >= LEAST_STEP * step
        runs.deadline -= min(step, 0.5 * max(left, 0.0)) if fits else max(left, 0.0)
        return Effort(intervals, probes=not self._refused_probe, fits=fits)

    def _advice(self, budget: float, effort: Effort, guess: Remains | None) -> str:
        """Sentence about a budget that is too short for the search, to be appended; or empty."""
        step, proof = self._measured[0] * effort.intervals, self._measured[1]
        if effort.fits:
            given_up = guess is not None and guess.memory.unfinished >= GIVEN_UP
            return (
                f" The search has not ended within {GIVEN_UP + 1} calls of {1e3 * budget:.3g} ms, "
                "and begins anew: give more time, or fewer intervals."
                if given_up
                else ""
            )
        if step == 0.0:
            return ""  # not known yet
        of_proof = (
            ""
            if proof == 0.0
            else f", and a certificate, of which there may be two, {1e3 * proof:.3g}"
        )
        return (
            f" No step of the search fits into the {1e3 * budget:.3g} ms: a step takes about "
            f"{1e3 * step:.3g} ms{of_proof}. Give more time."
        )

    def _spare(self, last: Remains | None, fields: Mapping[str, Any], runs: Runs) -> Plan | None:
        """Certified motion for the case that none to the goal is found in time.

        It is the remainder of the last motion, to its goal; else a stop that is found quickly.
        """
        if last is not None and last.proven is not None and last.continued is not None:
            problem = last.continued
            return answer(problem, self.qp_solver, lower_bound_of(problem), last.proven, runs)
        stop = self._stop(fields, runs, quick=True)
        return stop if stop.success else None

    def _instead(
        self,
        plan: Plan,
        spare: Plan | None,
        last: Remains | None,
        fields: Mapping[str, Any],
        runs: Runs,
        advice: str,
    ) -> Plan:
        """Certified motion instead of a plan that failed; that plan if there is none."""
        if spare is not None and spare.status is Status.KEPT and last is not None:
            self._begins = last.at
            message = str(Status.KEPT)
            if last.continued is not last.problem:
                message = f"{message} It leads to the goal of the last call."
            message += advice
            return replace(
                spare,
                message=message,
                solve_time=runs.elapsed,
                iterations=len(runs.history),
                history=tuple(runs.history),
                runs=tuple(runs.runs),
            )
        stops = spare or self._stop(fields, runs)
        if not stops.success:
            return plan
        self._remember(stops, None)
        message = f"{plan.message} {self._stopping(stops)}"
        return replace(stops, message=message, solve_time=runs.elapsed)

    def _stopping(self, plan: Plan) -> str:
        """What a stop says of itself."""
        return f"{Status.STOP} {widened_limits(self.machine, plan.problem.machine)}".rstrip()

    def _fields(self, q: Array, v: Array, base: UnicycleBase | None) -> dict[str, Any]:
        """Arguments of a `Problem` from the state now, but for the goal."""
        own = (
            "machine",
            "ground",
            "margin",
            "intervals",
            "model",
            "constraints",
            "tipping_fraction",
            "payload_uncertainty",
            "slope_uncertainty",
            "payload_com_uncertainty",
        )
        state = {"start": q, "start_velocity": v, "base": base}
        return {**{name: getattr(self, name) for name in own}, **state}

    def _runs(
        self, budget: float | None, progress: Callable[[IterationRecord], None] | None
    ) -> Runs:
        """Runner of the searches, which end early enough for a certificate within the budget."""
        budget = checked_budget(budget)
        if budget is None:
            return Runs.start(self.qp_solver, None, progress, clock=self.clock)
        first = FIRST_RESERVE_OVER_TERRAIN if is_uneven(self.ground) else FIRST_RESERVE
        reserve = RESERVE * self._proof_time if self._proof_time > 0.0 else first * budget
        limit = max(budget - reserve, 1e-6)
        return Runs.start(self.qp_solver, limit, progress, clock=self.clock)

    def _earlier(self, problem: Problem, elapsed: float | None) -> Earlier:
        """Rests of the last motion and of an unfinished search, where they are near the state.

        As guess only where the goal, too, is near; motions to the new goal come first.
        """
        near: list[Remains] = []
        for memory in (self._guess, self._memory):
            if memory is None or memory.motion.duration == 0.0 or not memory.fits(problem):
                continue
            around = None
            if elapsed is not None and memory is self._memory:
                around = self._begins + elapsed
            at, off = memory.nearest(problem.start, problem.start_velocity, around)
            left = memory.motion.duration - at
            if off <= USEFUL and left > LEFT * memory.motion.duration:
                near.append(Remains(problem, memory, at))
        last = next((one for one in near if one.memory is self._memory), None)
        near.sort(key=lambda one: not np.array_equal(one.memory.problem.goal, problem.goal))
        helpful = (one for one in near if _goal_distance(one) <= USEFUL_GOAL)
        return Earlier(last, next(helpful, None))

    def _stop(self, fields: Mapping[str, Any], runs: Runs, *, quick: bool = False) -> Plan:
        """Fastest certified motion to rest from the state now.

        It is searched for even if the budget has run out: a machine in motion needs an answer. One
        that still stands where it stood gets that of the last call.

        Args:
            fields: Arguments of `Problem` but the goal.
            runs: Runner of this call, which gets the records.
            quick: As for `stop_plan`.
        """
        own = {**fields, "intervals": STOP_INTERVALS, "model": "full"}
        if self._standing is not None and self._standing.answers(own):
            return self._standing.plan
        backend = backend_of(self.qp_solver)
        unlimited = Runs.start(backend, None, runs.progress, clock=self.clock)
        plan = stop_plan(own, unlimited, self.qp_solver, quick=quick)
        runs.history.extend(unlimited.history)
        runs.runs.extend(unlimited.runs)
        plan = replace(plan, status=Status.STOP) if plan.success else plan
        self._standing = Standing.of(own, plan)
        return plan

    def _refused(self, fault: ProblemError, fields: Mapping[str, Any], runs: Runs) -> Plan:
        """Stop from a state that no plan can start from; raises the fault if that is elsewhere.

        Raises:
            ProblemError: The start is not to blame.
        """
        unchecked = StopProblem(**fields, goal=fields["start"])
        try:
            Problem._check_boundary(unchecked, "start")
        except ProblemError:
            plan = self._stop(fields, runs)
            ending = self._stopping(plan) if plan.success else plan.message
            self._remember(plan, None)
            message = f"The measured state is refused: {fault}. {ending}"
            return replace(plan, message=message, solve_time=runs.elapsed)
        raise fault

    def _note_times(self, runs: Runs) -> None:
        """Note what a step of the search and a certificate took, for later time budgets."""
        steps: list[float] = []
        first = 0
        for run in runs.runs:
            records = runs.history[first : first + run.iterations]
            first += run.iterations
            if not any(SHORTEST_STEPS in one.backend for one in records):
                times = [0.0, *(one.time for one in records)]
                steps += [(late - early) / run.intervals for early, late in pairwise(times)]
        if steps:
            self._step_time = float(np.median(steps))
        self._proof_time = runs.proof_time or self._proof_time
        self._measured = (
            self._step_time if steps else self._measured[0],
            runs.proof_time or self._measured[1],
        )
        if self._starved:  # what took long once is not to leave no time for ever
            self._step_time *= FADING
            self._proof_time *= FADING

    def _remember(self, plan: Plan, candidate: Candidate | None) -> None:
        """Keep a successful plan for the next call."""
        if plan.success and plan.attempt is not None:
            kept = Memory(plan.problem, plan.attempt, candidate, plan.status)
            self._memory, self._begins = kept, 0.0


def _checked_elapsed(given: Any) -> float | None:
    """Time since the start of the last motion [s]; None if it is not known.

    Raises:
        ProblemError: No number, or a negative one.
    """
    if given is None:
        return None
    elapsed = finite_number(given, name="elapsed", error=ProblemError)
    if elapsed < -ROUNDING:
        raise ProblemError(f"elapsed must be at least 0 s, not {elapsed:g} s")
    return max(elapsed, 0.0)


def _unfinished(
    problem: Problem, guess: Remains | None, proven: Proven, found: Candidate | None
) -> Memory | None:
    """Motion from which the next call goes on; None if the search is done, or over terrain."""
    before = 0 if guess is None else guess.memory.unfinished
    base = problem.undercarriage
    rolls = isinstance(base, Driving) and not base.terrain.uniform
    if found is None or before >= GIVEN_UP or rolls:
        return None
    motion = proven.attempt if proven.candidate is found else None
    if motion is None:
        motion = trajectory(problem, found.program, found.motion, found.fine)
    return Memory(problem, motion, found, unfinished=before + 1)


def _goal_distance(remains: Remains) -> float:
    """Largest change of the goal, per range of the earlier motion (at least 0.1 rad or m)."""
    travel = np.maximum(np.ptp(remains.memory.motion.positions, axis=0), 0.1)
    return float((np.abs(remains.problem.goal - remains.memory.problem.goal) / travel).max())
