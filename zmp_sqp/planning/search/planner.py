"""Planning of a problem in three steps: explore, refine, prove."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from zmp_sqp.arrays import finite_number
from zmp_sqp.blas import one_blas_thread
from zmp_sqp.errors import ProblemError
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.proof.boundary_states import ARRIVAL
from zmp_sqp.planning.proof.certificate import certify_for
from zmp_sqp.planning.search.answer import Plan, Status
from zmp_sqp.planning.search.blind import certified_blind_motion
from zmp_sqp.planning.search.explore import explore
from zmp_sqp.planning.search.jacobian_check import wrong_jacobians
from zmp_sqp.planning.search.messages import failure_message, success_message
from zmp_sqp.planning.search.prove import Proven, prove
from zmp_sqp.planning.search.refine import refine
from zmp_sqp.planning.search.run import Runs
from zmp_sqp.planning.search.task import Task, task_of
from zmp_sqp.sqp.result import IterationRecord

__all__ = ["answer", "arrived", "checked_budget", "plan", "searched", "without_search"]


@one_blas_thread()
def plan(
    problem: Problem,
    qp_solver: str = "auto",
    time_budget: float | None = None,
    *,
    progress: Callable[[IterationRecord], None] | None = None,
    announce: Callable[[str], None] | None = None,
) -> Plan:
    r"""Fastest safe motion that a local search finds: SQP on a program in normalised time.

    .. math:: \min T \quad \text{s.t. ZMP in the polygon, joint limits}
              \qquad \text{(Song \& Sharf 2020, eq. (19))}

    If the fastest motion within the joint limits alone is safe, it is the answer. Otherwise the SQP
    searches for the fastest motion with accelerations that are linear within the intervals: near
    the lower bound of the duration if that is feasible, else on half of the intervals and then on
    all of them (`explore`). With `intervals="auto"` the grid is then refined (`refine`). The result
    is certified for all t; where a constraint fails between the nodes, it is tightened by its
    shortfall and the program is solved again (`prove`).

    Args:
        problem: Problem to plan.
        qp_solver: "auto" (PIQP; ProxQP for small QPs whose active rows are known), "proxqp" (which
            leaves QPs of more than 1200 variables to PIQP), "piqp", or "qpsolvers:NAME".
        time_budget: Wall time after which no new QP starts [s]; a QP that has begun is finished.
            None for no limit.
        progress: Called after every SQP iteration with its record.
        announce: Called with words when a stage of the search (explore, refine, prove) or one of
            its runs begins.

    Returns:
        The plan; `success` is False where no safe motion was found, with a diagnosis in `message`.

    Raises:
        ProblemError: Unknown QP solver, or a time budget that is not a positive number.
    """
    _check(problem, time_budget)
    runs = Runs.start(qp_solver, time_budget, progress, announce)
    task = task_of(problem)
    proven = without_search(task) or searched(task, runs)
    return answer(problem, qp_solver, task.lower_bound, proven, runs)


def _check(problem: Problem, time_budget: float | None) -> None:
    if not isinstance(problem, Problem):
        raise ProblemError(f"problem must be a Problem, not {type(problem).__name__}")
    checked_budget(time_budget)


def checked_budget(time_budget: float | None) -> float | None:
    """A time budget, checked.

    Raises:
        ProblemError: It is not None and no positive number.
    """
    if time_budget is None:
        return None
    budget = finite_number(time_budget, name="time_budget", error=ProblemError)
    if budget <= 0.0:
        raise ProblemError(f"time_budget must be positive, not {budget} s")
    return budget


def without_search(task: Task) -> Proven | None:
    """Fastest motion where it needs no search: nothing to do, or the blind motion is safe."""
    if task.lower_bound == 0.0:
        return _already_there(task.problem)
    blind = certified_blind_motion(task)
    if blind is None:
        return None
    motion, checked = blind
    return Proven(Status.FASTEST_POSSIBLE, checked, motion, motion.duration)


def searched(task: Task, runs: Runs) -> Proven:
    """Fastest motion that the three steps of the search find, or their last motion."""
    runs.load()
    found = explore(task, runs)
    refined = refine(task, found, runs)
    return prove(task, refined, runs)


def arrived(problem: Problem) -> Proven | None:
    """Motion of zero duration for a machine that is at rest at its goal, to `ARRIVAL`.

    None elsewhere, and for a base that drives.
    """
    if problem.base is not None:
        return None
    rates = np.abs([problem.start_velocity, problem.goal_velocity])
    off = np.abs(problem.goal - problem.start)
    there = bool((off <= ARRIVAL).all() and (rates <= ARRIVAL).all())
    return _already_there(problem) if there else None


def _already_there(problem: Problem) -> Proven:
    """Motion of zero duration, for equal start and goal states, at rest or in motion."""
    q, v = (np.vstack([part] * 2) for part in (problem.start, problem.start_velocity))
    base = problem.undercarriage.still()
    joints = problem.machine.joint_names
    attempt = Trajectory(joints, np.zeros(2), q, v, 0.0 * v[:1], base=base)
    checked = certify_for(problem, attempt)
    status = Status.FASTEST_POSSIBLE if checked.safe else Status.INFEASIBLE
    return Proven(status, checked, attempt, 0.0)


def answer(
    problem: Problem, qp_solver: str, lower_bound: float, proven: Proven, runs: Runs
) -> Plan:
    """Plan of a problem from how its search ended."""
    status, checked, duration = proven.status, proven.certificate, proven.duration
    if status.success and duration == 0.0:
        lower_bound = 0.0
    if status.success:
        message = success_message(status, checked, duration=duration, lower_bound=lower_bound)
    else:
        message = failure_message(problem, status, checked, proven.obstacle, duration=duration)
        if status is Status.INFEASIBLE and runs.reason:
            message = f"{message} {runs.reason}"
        message += wrong_jacobians(problem, proven.attempt)
    return Plan(
        problem=problem,
        status=status,
        message=message,
        duration=duration,
        lower_bound=lower_bound,
        certificate=checked,
        iterations=len(runs.history),
        solve_time=runs.elapsed,
        history=tuple(runs.history),
        runs=tuple(runs.runs),
        qp_solver=qp_solver,
        attempt=proven.attempt,
    )
