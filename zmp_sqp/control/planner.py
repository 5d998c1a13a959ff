"""Planner for control code: warm starts from the last motion, time budgets, certified stops."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array
from zmp_sqp.control.measured import within_limits
from zmp_sqp.control.memory import Memory
from zmp_sqp.control.replan import Remains, ready_motion, replanned
from zmp_sqp.control.stop import INTERVALS as STOP_INTERVALS
from zmp_sqp.control.stop import StopProblem, stop_plan
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.ground import Ground, Slope
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase
from zmp_sqp.planning.search.answer import Plan, Status
from zmp_sqp.planning.search.planner import answer
from zmp_sqp.planning.search.run import Candidate, Runs
from zmp_sqp.planning.search.single_thread import one_blas_thread
from zmp_sqp.planning.search.task import task_of
from zmp_sqp.sqp.result import IterationRecord

__all__ = ["Planner"]

LEVEL = Slope()
USEFUL = 0.3  # distance of the state from the last motion (`Memory.nearest`) up to which it helps
USEFUL_GOAL = 0.5  # change of the goal per range of the last motion up to which it helps
LEFT = 0.01  # share of the last motion that must be left for it to help
RESERVE = 1.3  # time kept for the certificate, per time that it took last


@dataclass(slots=True, eq=False)
class Planner:
    """Plans again and again from measured states, for a machine in motion.

    It keeps the last certified motion with its multipliers. A new plan starts from the rest of that
    motion, falls back to a search from nothing, and is certified anew. Attributes may be changed
    between calls.

    Attributes:
        machine: The machine, with its payload.
        ground: Ground under the machine.
        margin, intervals, model, constraints, tipping_fraction, payload_uncertainty,
        slope_uncertainty, payload_com_uncertainty: As for `Problem`.
        qp_solver: As for `plan`.
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
    _memory: Memory | None = field(default=None, init=False, repr=False)
    # last motion to the goal of a search that has not succeeded yet
    _guess: Memory | None = field(default=None, init=False, repr=False)
    _in_use: Any = field(default_factory=threading.Lock, init=False, repr=False)
    _step_time: float = field(default=0.0, init=False, repr=False)  # [s] of the last search
    _proof_time: float = field(default=0.0, init=False, repr=False)  # [s] of the last certificate

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
        """Fastest certified motion from a measured state to a goal, within a time budget.

        Args:
            start: Joint coordinates now, shape (n,) [rad or m]. A state that is outside the limits
                by measurement noise (0.01 rad or m, 5 % of the rates) is taken to be at them.
            goal: Joint coordinates at the goal, shape (n,) [rad or m].
            start_velocity: Joint rates now, shape (n,) [rad/s or m/s]; None is rest.
            time_budget: Wall time for the answer [s]; None for no limit.
            goal_velocity: Joint rates at the goal, shape (n,) [rad/s or m/s]; None is rest.
            base: Base that drives, from its pose and velocity now; None for one that stands.
            elapsed: Time since the start of the last motion [s]; None finds the time at which that
                motion is nearest to the state.
            progress: Called after every SQP iteration with its record.

        Returns:
            The plan. Where no motion to the goal is certified in time: the rest of the last motion,
            with status KEPT; else the fastest safe motion to rest, with status STOP; else a plan
            without success.

        Raises:
            ProblemError: Wrong arguments, a goal that is refused, or a call while another thread
                uses this planner.
        """
        with self._sole_use():
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
                problem = Problem(**fields, goal=goal, goal_velocity=goal_velocity)
            except ProblemError as fault:
                return self._refused(fault, fields, runs)
            return self._planned(problem, fields, elapsed, runs)

    def _planned(
        self, problem: Problem, fields: Mapping[str, Any], elapsed: float | None, runs: Runs
    ) -> Plan:
        """Plan of a problem, or a stop where none is certified."""
        task = task_of(problem)
        remains = self._remains(problem, elapsed)
        proven, stops = ready_motion(task, remains, runs), None
        if proven is None and runs.deadline is not None:
            stops = self._stop(fields, runs, quick=True)
        if proven is None or proven.status is Status.KEPT:
            if runs.deadline is not None:  # a step that begins is finished
                runs.deadline -= self._step_time
            proven = replanned(task, remains, proven, runs)
        plan = answer(problem, self.qp_solver, task.lower_bound, proven, runs)
        if plan.success:
            self._guess = None
            # the rest of the last motion is found again in that motion, with its multipliers
            if plan.status is not Status.KEPT or proven.candidate is not None:
                self._remember(plan, proven.candidate)
            self._note_times(runs)
            return plan
        if plan.attempt is not None:
            self._guess = Memory(problem, plan.attempt, proven.candidate)
        if stops is None or not stops.success:
            stops = self._stop(fields, runs)
        if not stops.success:
            return plan
        self._remember(stops, None)
        return replace(stops, message=f"{plan.message} {Status.STOP}", solve_time=runs.elapsed)

    @contextmanager
    def _sole_use(self) -> Iterator[None]:
        """Refuse a call while another thread uses this planner."""
        if not self._in_use.acquire(blocking=False):
            raise ProblemError(
                "this planner is in use by another thread: give every thread a Planner of its own"
            )
        try:
            yield
        finally:
            self._in_use.release()

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
        if budget is None:
            return Runs.start(self.qp_solver, None, progress)
        budget = finite_number(budget, name="time_budget", error=ProblemError)
        if budget <= 0.0:
            raise ProblemError(f"time_budget must be positive, not {budget} s")
        reserve = RESERVE * self._proof_time
        return Runs.start(self.qp_solver, max(budget - reserve, 1e-6), progress)

    def _remains(self, problem: Problem, elapsed: float | None) -> Remains | None:
        """What remains of the last motion, where it is near enough to help."""
        for memory in (self._memory, self._guess):
            if memory is None or memory.motion.duration == 0.0:
                continue
            at, off = memory.nearest(problem.start, problem.start_velocity, elapsed)
            travel = np.maximum(np.ptp(memory.motion.positions, axis=0), 0.1)
            moved = float((np.abs(problem.goal - memory.problem.goal) / travel).max())
            left = memory.motion.duration - at
            if off <= USEFUL and moved <= USEFUL_GOAL and left > LEFT * memory.motion.duration:
                return Remains(memory, at, memory.rest(at))
        return None

    def _stop(self, fields: Mapping[str, Any], runs: Runs, *, quick: bool = False) -> Plan:
        """Fastest certified motion to rest from the state now.

        It is searched for even if the budget has run out: a machine in motion needs an answer.

        Args:
            fields: Arguments of `Problem` but the goal.
            runs: Runner of this call, which gets the records.
            quick: Whether to look no further than for a stop at its lower bound.
        """
        own = {**fields, "intervals": STOP_INTERVALS, "model": "full"}
        unlimited = Runs.start(self.qp_solver, None, runs.progress)
        plan = stop_plan(own, unlimited, self.qp_solver, quick=quick)
        runs.history.extend(unlimited.history)
        runs.runs.extend(unlimited.runs)
        return replace(plan, status=Status.STOP) if plan.success else plan

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
            ending = Status.STOP if plan.success else plan.message
            self._remember(plan, None)
            message = f"The measured state is refused: {fault}. {ending}"
            return replace(plan, message=message, solve_time=runs.elapsed)
        raise fault

    def _note_times(self, runs: Runs) -> None:
        """Note what a step of the search and a certificate took, for later time budgets."""
        at = [record.time for record in runs.history]
        steps = [late - early for early, late in pairwise(at) if late > early]
        if steps:
            self._step_time = float(np.median(steps))
        self._proof_time = runs.proof_time or self._proof_time

    def _remember(self, plan: Plan, candidate: Candidate | None) -> None:
        """Keep a successful plan for the next call."""
        if plan.success and plan.attempt is not None:
            self._memory = Memory(plan.problem, plan.attempt, candidate)
