"""Fastest motion to rest that does not tip the machine over."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, set_frozen_state
from zmp_sqp.blas import one_blas_thread
from zmp_sqp.control.measured import widened_limits, with_room_to_stop
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.ground import Ground, Slope
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.constraints.tip_over import GUARD
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.statics import stands_at_rest
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.limits import Boundary
from zmp_sqp.planning.program.staged import Motion, StagedProgram
from zmp_sqp.planning.proof.certificate import Certificate, certify_for
from zmp_sqp.planning.search.answer import Plan, Status
from zmp_sqp.planning.search.keep_bound import ABOVE
from zmp_sqp.planning.search.planner import answer, checked_budget
from zmp_sqp.planning.search.prove import Proven, prove
from zmp_sqp.planning.search.run import Candidate, Runs
from zmp_sqp.planning.search.task import Task, task_of
from zmp_sqp.sqp.iterate import is_feasible
from zmp_sqp.sqp.least_distance import EQUALITY, nearest_feasible
from zmp_sqp.sqp.result import SQPResult, SQPStatus
from zmp_sqp.sqp.solver import SQPSettings

__all__ = ["INTERVALS", "StopProblem", "backend_of", "plan_stop", "stop_plan"]

INTERVALS = 10  # of a stop: it is short
# durations of the initial guesses per lower bound, in geometric progression; the search starts from
# the first one whose violation is small, and otherwise from the one with the least
FIRST_PACE, SLOWER, TRIALS = 1.2, 1.4, 20
HELD = (1.8, 4.0)  # times that pace, at which the duration is held until a motion is feasible
# a stop is short: 0.1 % of it is a millisecond, and steps that creep cost more than they gain
SETTINGS = SQPSettings(converged=1e-3, max_iterations=25)
SMALL = 0.1  # violation of a guess, as scaled in the program, from which few steps are needed
SAME = 1e-9  # [s] times that are closer together are one node
SHARES = np.array([0.0, 0.5, 1.0])  # of an interval, at which the ZMP is sampled before a proof
FARTHEST = 1e5  # [rad or m, and per second] beyond which a measured state is a fault
LEVEL = Slope()


@one_blas_thread()
def plan_stop(
    machine: Machine,
    q: Any,
    v: Any,
    ground: Ground = LEVEL,
    *,
    base: UnicycleBase | None = None,
    margin: float = 0.0,
    intervals: int = INTERVALS,
    qp_solver: str = "auto",
    time_budget: float | None = None,
    clock: Callable[[], float] = time.perf_counter,
    **options: Any,
) -> Plan:
    r"""Fastest motion from a moving state to rest, anywhere, that does not tip the machine over.

    .. math:: \min T \quad \text{s.t. } q(0) = q, \; \dot q(0) = v, \; \dot q(T) = 0, \text{ ZMP in
              the polygon, limits}

    If it is safe that every joint brakes with its largest acceleration, that is the answer.
    Otherwise the SQP searches for the fastest motion whose end is free. The result is certified for
    all t like that of `plan`, and the machine stands safely where it ends. Limits that the state is
    outside of, or within which the joints cannot stop, are widened as far as needed.

    Args:
        machine: The machine, with its payload.
        q: Joint coordinates, shape (n,) [rad or m].
        v: Joint rates, shape (n,) [rad/s or m/s].
        ground: Ground under the machine.
        base: Base that drives, with its pose and velocity as `start` and `start_velocity`; its
            goal is not used. None for a base that stands.
        margin: Distance that the ZMP keeps from every edge of the support polygon [m].
        intervals: Number of intervals of the time grid.
        qp_solver: As for `plan`.
        time_budget: Time by `clock` after which no new QP starts [s]; then braking of all joints at
            constant deceleration over the same time is tried. None for no limit.
        clock: As for `Planner`.
        options: Further arguments of `Problem`, such as `constraints` or `payload_uncertainty`.

    Returns:
        The plan; `plan.problem.goal` is where the motion ends. Without success, `attempt` is the
        least-violating motion that was found, and `message` says what it violates.

    Raises:
        ProblemError: Wrong arguments.
        TypeError: An option that `Problem` does not have.
    """
    for name in options:
        if name == "goal" or name not in Problem.__match_args__:
            raise TypeError(f"plan_stop() got an unexpected keyword argument {name!r}")
    fields = {"machine": machine, "start": q, "start_velocity": v, "ground": ground, "base": base}
    fields |= {"margin": margin, "intervals": intervals, **options}
    runs = Runs.start(backend_of(qp_solver), checked_budget(time_budget), None, clock=clock)
    return stop_plan(fields, runs, qp_solver)


def backend_of(qp_solver: str) -> str:
    """QP solver of stops: PIQP for "auto".

    ProxQP, which "auto" takes for QPs as small as these, is here slower by up to 75 F.
    """
    return "piqp" if qp_solver == "auto" else qp_solver


def stop_plan(
    fields: Mapping[str, Any], runs: Runs, qp_solver: str, *, quick: bool = False
) -> Plan:
    """Plan of the fastest motion to rest.

    Args:
        fields: Arguments of `Problem` but the goal.
        runs: Runner of the searches.
        qp_solver: Name of the QP solver, for the plan.
        quick: Whether to search for no more than a stop at its lower bound, and even braking.

    Raises:
        ProblemError: Wrong arguments.
    """
    problem: Problem = StopProblem(**fields, goal=fields["start"])
    given = problem.machine
    for name, state in (("position", problem.start), ("rate", problem.start_velocity)):
        j = int(np.abs(state).argmax())
        if abs(state[j]) > FARTHEST:
            raise ProblemError(
                f"the {name} of joint {given.joint_names[j]!r} is {state[j]:g}: no machine is there"
            )
    machine = with_room_to_stop(given, problem.start, problem.start_velocity)
    if machine is not given:
        problem = replace(problem, machine=machine)
    task = _stopping(problem)
    proven, problem = _stop(task, runs, quick=quick)
    plan = answer(problem, qp_solver, task.lower_bound, proven, runs)
    if plan.success and (widened := widened_limits(given, machine)):
        return replace(plan, message=f"{Status.STOP} {widened}")
    return plan


@dataclass(frozen=True, slots=True, eq=False)
class StopProblem(Problem):
    """Problem whose start and goal are not checked: a machine in motion must stop in any case."""

    __setstate__ = set_frozen_state  # a dataclass with slots does not inherit it

    def _check_boundary(self, name: str) -> None:
        pass


def _stopping(problem: Problem) -> Task:
    """Task of coming to rest from the start of a problem, at any place."""
    task = task_of(problem)
    needed = np.abs(task.start.v) / task.bounds.acceleration
    goal = Boundary(task.goal.q, 0.0 * task.goal.v, free=True)
    return replace(task, goal=goal, lower_bound=float(needed.max(initial=0.0)))


def _stop(task: Task, runs: Runs, *, quick: bool) -> tuple[Proven, Problem]:
    """Fastest certified motion to rest, and the problem with its end as goal.

    Without success the least-violating motion that was found.
    """
    failed: list[Proven] = []
    for proven in _attempts(task, runs, quick=quick):
        if proven.status.success:
            problem = _with_end(task.problem, proven.attempt)
            if problem is not None:
                return proven, problem
            proven = replace(proven, status=Status.INFEASIBLE)  # it could not stand at the end
        failed.append(proven)
    if not failed:
        return _nothing(task), task.problem
    return max(failed, key=lambda one: one.certificate.margin), task.problem


def _nothing(task: Task) -> Proven:
    """No motion."""
    nothing = Certificate.of_nothing(task.problem.margin)
    return Proven(Status.TIME_BUDGET, nothing, None, task.lower_bound)


def _attempts(task: Task, runs: Runs, *, quick: bool) -> Iterator[Proven]:
    """Motions to rest with their certificates, the fastest first."""
    motion = _blind_motion(task)
    if task.lower_bound == 0.0:  # at rest already: there is nothing to search for
        checked = certify_for(task.problem, motion, anywhere=True)
        status = Status.FASTEST_POSSIBLE if checked.safe else Status.INFEASIBLE
        yield Proven(status, checked, motion, 0.0)
        return
    blind = _blind_stop(task, motion)
    if blind is not None:
        yield blind
    found = _at_the_bound(task, runs)
    if found is not None:
        yield prove(task, found, runs)
    if not quick and not runs.is_late:
        yield prove(task, _searched(task, runs, _easiest_pace(task), held=False), runs)
    if quick or runs.is_late:
        evenly = _even_braking(task, runs)
        if evenly is not None:
            yield prove(task, evenly, runs)
        return
    easiest = _easiest_pace(task)
    for slower in HELD:
        found = _searched(task, runs, slower * easiest, held=True)
        if found.is_feasible and not runs.is_late:
            yield prove(task, _released(task, runs, found), runs)
        proven = prove(task, found, runs)
        held_up = proven.status.success  # a faster motion may exist
        yield replace(proven, status=Status.SAFE) if held_up else proven


def _with_end(problem: Problem, motion: Trajectory | None) -> Problem | None:
    """Problem whose goal is the end of a motion; None where the machine cannot stand there."""
    if motion is None:
        return None
    changes = {field: getattr(problem, field) for field in Problem.__match_args__}
    changes["goal"], pose = motion.positions[-1], None
    if problem.base is not None and motion.base is not None:
        pose = motion.base.poses[-1]
        changes["base"] = replace(problem.base, goal=pose, goal_velocity=None)
    if not stands_at_rest(problem.corners(), changes["goal"], pose=pose, margin=problem.margin):
        return None  # quickly: to say what would be possible instead takes longer than the stop
    try:
        return Problem(**changes)
    except ProblemError:
        return None


def _blind_motion(task: Task) -> Trajectory:
    """Braking of every coordinate with its largest acceleration."""
    problem, start = task.problem, task.start
    ends = np.abs(start.v) / task.bounds.acceleration
    times = np.unique(np.append(0.0, ends))
    times = times[np.diff(times, prepend=-1.0) > SAME]
    times[-1] = ends.max(initial=0.0)
    if len(times) == 1:
        times = np.zeros(2)  # at rest: a motion of zero duration
    direction = np.sign(start.v) * task.bounds.acceleration
    left = np.clip(ends - times[:, None], 0.0, None)
    a = np.where(left[:-1] > SAME, -direction, 0.0)
    states = start.q + 0.5 * direction * (ends**2 - left**2), direction * left, a
    return _trajectory(problem, times, states)


def _blind_stop(task: Task, motion: Trajectory) -> Proven | None:
    """Braking of every coordinate with its largest acceleration, if that is safe."""
    if not _seems_safe(task, motion):
        return None
    checked = certify_for(task.problem, motion, anywhere=True)
    if not checked.safe:
        return None
    return Proven(Status.FASTEST_POSSIBLE, checked, motion, motion.duration)


def _trajectory(problem: Problem, times: Array, states: tuple[Array, Array, Array]) -> Trajectory:
    """Motion from coordinates of joints and undercarriage at the nodes."""
    q, v, a = states
    to, size = problem.coordinates, problem.coordinates.size
    of_base = v[:, size:], a[:, size:], 0.0 * a[:, size:]
    base = problem.undercarriage.motion(times, q[:, -1], *of_base)
    joints = to.joints(q[:, :size]), to.rates(v[:, :size]), to.rates(a[:, :size])
    return Trajectory(problem.machine.joint_names, times, *joints, base=base)


def _seems_safe(task: Task, motion: Trajectory) -> bool:
    """Whether the ZMP keeps its margin at both ends and in the middle of every interval."""
    _, q, v, a = motion.within(SHARES)
    positions = None
    if motion.base is not None:
        k = np.repeat(np.arange(motion.intervals), len(SHARES))
        since = np.outer(np.diff(motion.times), SHARES).ravel()
        pose, velocity, acceleration = motion.base.state_in(k, since)
        positions = pose[:, :2]
        length = np.zeros((len(q), 1))  # efforts do not depend on the path length
        q = np.hstack([q, length, pose[:, 2:]])
        v, a = np.hstack([v, velocity]), np.hstack([a, acceleration])
    return task.constraints.outside(q, v, a, 1.0, positions) <= GUARD


def _at_the_bound(task: Task, runs: Runs) -> Candidate | None:
    """Feasible motion at most 0.03 % slower than the lower bound; None if none is found quickly."""
    program, point = _braking(task, task.lower_bound * (1.0 + ABOVE))
    found = nearest_feasible(program, point, runs.backend, likely=True)
    if not found.feasible:
        return None
    y, z = np.zeros(program.equalities), np.zeros(program.inequalities)
    status = SQPStatus.BOUND_REACHED
    result = SQPResult(found.point, y, z, found.excess, status, found.at, ())
    reached = Candidate(program, result)
    runs.record("stop at the bound", reached)
    return reached


def _braking(task: Task, duration: float, *, held: bool = False) -> tuple[StagedProgram, Motion]:
    """Program, and the motion in which every coordinate brakes evenly over the whole duration.

    Args:
        task: Task of coming to rest.
        duration: Duration of the motion [s].
        held: Whether the program keeps motions from being faster than that.
    """
    intervals = task.problem.first_intervals
    least = duration if held else None
    program = task.program(duration, Grid.of(intervals), least=least)
    brakes = np.broadcast_to(-task.start.v * duration, (intervals, 2, len(task.start.v)))
    return program, program.pack(brakes, duration**2)


def _even_braking(task: Task, runs: Runs) -> Candidate | None:
    """Fastest even braking that is feasible at the paces that are tried; None if none is."""
    for pace in FIRST_PACE * SLOWER ** np.arange(TRIALS):
        program, point = _braking(task, pace * task.lower_bound)
        at = program.evaluate(point)
        if not is_feasible(at, program.tolerance, EQUALITY):
            continue
        y, z = np.zeros(program.equalities), np.zeros(program.inequalities)
        result = SQPResult(point, y, z, None, SQPStatus.FEASIBLE, at, ())
        braking = Candidate(program, result)
        runs.record(f"even braking, {pace:g} x bound", braking)
        return braking
    return None


def _easiest_pace(task: Task) -> float:
    """First pace at which even braking violates little, else that which violates least."""
    tried: list[tuple[float, float]] = []
    for pace in FIRST_PACE * SLOWER ** np.arange(TRIALS):
        program, point = _braking(task, pace * task.lower_bound)
        violation = program.evaluate(point).violation
        if violation <= SMALL:
            return float(pace)
        tried.append((violation if np.isfinite(violation) else np.inf, float(pace)))
    return min(tried)[1]


def _searched(task: Task, runs: Runs, pace: float, *, held: bool) -> Candidate:
    """Motion found by SQP from even braking at a pace, which is held or may be exceeded."""
    program, point = _braking(task, pace * task.lower_bound, held=held)
    purpose = f"even braking, {pace:g} x bound{', held' if held else ''}"
    return runs.minimize(program, point, SETTINGS, purpose=purpose)


def _released(task: Task, runs: Runs, held: Candidate) -> Candidate:
    """Motion found by SQP from one whose duration was held."""
    program = task.program(held.duration, held.program.grid)
    point, result = program.pack(held.controls, held.S), held.result
    return runs.minimize(
        program, point, SQPSettings(), y=result.y, z=result.z, purpose="duration released"
    )
