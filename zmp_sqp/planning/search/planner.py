"""From a problem to a plan: guess, transcribe, solve, certify, tighten where that fails."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number
from zmp_sqp.errors import ProblemError, TrajectoryError
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.program.driving.transcription import DrivingTranscription
from zmp_sqp.planning.program.formulation import (
    GUARD,
    Program,
    boundaries,
    grid_bound,
    path_bounds,
    stage_model,
    trajectory,
)
from zmp_sqp.planning.program.hold import CONSTANT, LINEAR, Hold
from zmp_sqp.planning.program.transcription import PathBounds, Transcription
from zmp_sqp.planning.proof.base_check import CORRIDOR, BaseCheck, check_base
from zmp_sqp.planning.proof.boundary_states import meets_boundary_states
from zmp_sqp.planning.proof.certificate import Certificate
from zmp_sqp.planning.proof.robust_certificate import certify_for
from zmp_sqp.planning.search.answer import Plan, Status
from zmp_sqp.planning.search.guess import initial_guess, kinematic_lower_bound
from zmp_sqp.planning.search.messages import failure_message
from zmp_sqp.planning.search.single_thread import one_blas_thread
from zmp_sqp.planning.search.slopes import free_slopes, linear_controls
from zmp_sqp.sqp.backends import QPBackend, make_backend
from zmp_sqp.sqp.backends.deadline import Punctual
from zmp_sqp.sqp.result import IterationRecord, SQPResult, SQPStatus
from zmp_sqp.sqp.solver import SQP, SQPSettings

__all__ = ["plan"]

FALLBACK = "piqp"
# accelerations (intervals times coordinates) up to which ProxQP is asked first: QPs grow as cubes
MOST_DENSE = 800
SAME_DURATION = 1e-6  # relative: of two solutions as fast as that, the later one has converged
EPSILON = 1e-9
MAX_TIGHTENINGS = 6
MAX_ITERATIONS = 100
# Guesses: how much slower than the bound, whether smooth, and iterations spent on them. First
# whether the bound can be kept; then a start from which the ZMP's rows are less curved; a smooth
# one against local minima where the motion found takes more than SLOW times the lower bound, or
# none is; the last only if all that leads nowhere.
GUESSES = (
    (1.0, False, 3),
    (1.1, False, MAX_ITERATIONS),
    (1.5, True, MAX_ITERATIONS),
    (2.5, False, MAX_ITERATIONS),
)
SLOW = 1.1
# times slower than the bound: dynamics count a sixteenth; what is violated then is so at rest, too
PATIENT = 4.0
REFINEMENTS = 30  # iterations with linear accelerations; what is not feasible by then is dropped
OUTCOMES = {
    SQPStatus.OPTIMAL: Status.OPTIMAL,
    SQPStatus.BOUND_REACHED: Status.FASTEST_POSSIBLE,
    SQPStatus.FEASIBLE: Status.SAFE,
    SQPStatus.INFEASIBLE: Status.INFEASIBLE,
    SQPStatus.TIME_LIMIT: Status.TIME_BUDGET,
    SQPStatus.ITERATION_LIMIT: Status.ITERATION_LIMIT,
}

# where it may be the base alone that is wrong
BLIND = (Status.INFEASIBLE, Status.FAILED, Status.UNSAFE_BETWEEN_NODES)


@one_blas_thread()
def plan(
    problem: Problem,
    qp_solver: str = "proxqp",
    time_budget: float | None = None,
    *,
    progress: Callable[[IterationRecord], None] | None = None,
) -> Plan:
    r"""Fastest safe motion, by SQP on the multiple-shooting transcription in normalised time.

    .. math:: \min T \quad \text{s.t. ZMP in the polygon, joint limits} \qquad \text{(Song \& Sharf
        2020, eq. (19))}

    First with an acceleration per interval; where the ZMP then costs time, again with accelerations
    that run linearly within the intervals, so that the ZMP can follow an edge. The result is
    certified for all t; if it leaves the polygon between the nodes, the rows are drawn in by what
    is missing and it is solved again.

    Args:
        problem: The question.
        qp_solver: "proxqp", "piqp" (sparse; for many intervals), or "qpsolvers:NAME". Beyond 800
            accelerations (intervals times joints) "proxqp" gives way to "piqp", which takes seconds
            where dense QPs take minutes.
        time_budget: No new QP starts after this long [s]; one that has begun is brought to its end.
            None for as long as it takes.
        progress: Called after every iteration with its record.

    Returns:
        Plan; `success` is False where no safe motion was found, with a diagnosis in `message`.

    Raises:
        ProblemError: Unknown QP solver, or a time budget that is not a positive number.
    """
    started = time.perf_counter()
    if not isinstance(problem, Problem):
        raise ProblemError(f"problem must be a Problem, not {type(problem).__name__}")
    deadline = None
    if time_budget is not None:
        if finite_number(time_budget, name="time_budget", error=ProblemError) <= 0.0:
            raise ProblemError(f"time_budget must be positive, not {time_budget} s")
        deadline = started + float(time_budget)
    backend, fallback = _backends(problem, qp_solver, deadline)
    model = stage_model(problem)
    start, goal = boundaries(problem)
    bounds = path_bounds(problem, tightened=0.0)
    lower_bound = kinematic_lower_bound(
        problem.goal - problem.start,
        start_velocity=problem.start_velocity,
        goal_velocity=problem.goal_velocity,
        limits=problem.machine.limits,
    )
    if problem.base is not None:
        lower_bound = max(lower_bound, problem.base.least_duration)
    if lower_bound == 0.0:
        return _already_there(problem, qp_solver, started)
    least = max(lower_bound, grid_bound(start, goal, bounds, problem.intervals))
    bounds = replace(bounds, least_duration=least)
    history: list[IterationRecord] = []
    duration = least
    route = (
        None if problem.base is None else np.vstack([problem.base.start[:2], problem.base.goal[:2]])
    )
    reach = 0.0 if problem.machine.support is None else problem.machine.support.reach
    corridor = 0.0  # [m] by which x and y bounds are drawn in

    def program(bounds: PathBounds, hold: Hold, ties: Any = None) -> Program:
        of_coordinates = Transcription(
            model,
            start,
            goal,
            bounds,
            intervals=problem.intervals,
            reference=duration,
            hold=hold,
            ties=ties,
        )
        if problem.base is None:
            return of_coordinates
        ground = problem.base_ground
        return DrivingTranscription(
            of_coordinates, problem.base, ground, reach=reach, drawn_in=corridor
        )

    def solve(
        bounds: PathBounds,
        controls: Array,
        S: float,
        ties: Any = None,
        iterations: int = MAX_ITERATIONS,
    ) -> tuple[Program, SQPResult]:
        nlp = program(bounds, CONSTANT if controls.shape[1] == 1 else LINEAR, ties)
        settings = SQPSettings(deadline=deadline, max_iterations=iterations)
        result = SQP(backend, fallback, settings, progress).minimize(nlp, nlp.pack(controls, S))
        history.extend(result.history)
        return nlp, result

    def guess(pace: float, smooth: bool) -> tuple[Array, float]:
        return initial_guess(
            model,
            start,
            goal,
            bounds,
            intervals=problem.intervals,
            least_duration=pace,
            smooth=smooth,
            route=route,
        )

    tried: list[tuple[Program, SQPResult]] = []
    for slower, smooth, iterations in GUESSES:
        alpha, duration = guess(slower * least, smooth)
        tried.append(solve(bounds, alpha[:, None], duration**2, iterations=iterations))
        best = reduce(_better, tried)
        if tried[-1][1].status in (SQPStatus.BOUND_REACHED, SQPStatus.TIME_LIMIT):
            break
        feasible, slow = (
            best[1].status.is_feasible,
            best[0].unpack(best[1].x)[3] > (SLOW * lower_bound) ** 2,
        )
        if feasible and slower > 1.0 and (smooth or not slow):
            break
    if not best[1].status.is_feasible and not _is_past(deadline):
        # the least-violating motion is a slow one, but searches for the fastest do not slow down
        alpha, duration = guess(PATIENT * least, True)
        crawl = replace(bounds, least_duration=PATIENT * least)
        tried.append(solve(crawl, alpha[:, None], duration**2))
        if tried[-1][1].status.is_feasible:
            controls, S = tried[-1][0].unpack(tried[-1][1].x)[2:]
            tried.append(solve(bounds, controls, S))
        verdict, best = best[1].status, reduce(_better, tried)
        if not best[1].status.is_feasible:
            best = best[0], replace(best[1], status=verdict)
    (nlp, result), ties = best, None
    duration = nlp.reference
    if result.status in (SQPStatus.OPTIMAL, SQPStatus.FEASIBLE) and not _is_past(deadline):
        # the ZMP costs time: let the accelerations follow it within the intervals
        controls, S = nlp.unpack(result.x)[2:]
        # the grid's bound is one of constant accelerations
        looser = replace(bounds, least_duration=lower_bound)
        ties, spread = linear_controls(controls)
        if ties is not None:
            ties = free_slopes(ties, program(looser, LINEAR), nlp, result)
        refined = solve(looser, spread, S, ties, REFINEMENTS)
        if refined[1].status.is_feasible and refined[0].unpack(refined[1].x)[3] <= S:
            (nlp, result), bounds = refined, looser
    tightened, obstacle = 0.0, ""
    attempt: Trajectory | None = None
    held: BaseCheck | None = None
    for _ in range(MAX_TIGHTENINGS):
        try:
            attempt = motion = trajectory(problem, nlp, result.x)
            checked = certify_for(problem, motion)
        # off the map, or where the tracks cannot follow
        except (ProblemError, TrajectoryError) as cause:
            if problem.base is None or problem.base_ground.uniform:
                raise
            attempt, checked = None, Certificate.of_nothing(problem.margin)
            status, obstacle = Status.TERRAIN, str(cause)
            break
        status = OUTCOMES.get(result.status, Status.FAILED)
        proven = checked.safe and meets_boundary_states(problem, motion)
        held = (
            None
            if problem.base is None or motion.base is None
            else check_base(problem.base, motion.base)
        )
        if proven and not status.success:  # the proof does not ask how the motion was found
            status = Status.SAFE
        if not status.success or proven:
            break
        # nothing that drawing in the rows would mend
        if not np.isfinite(checked.margin) or checked.safe:
            status = Status.FAILED
            break
        if problem.distance_limits is not None and not checked.limits_ok:
            status = Status.JOINT_LIMITS  # drawing in the ZMP's rows does not mend that
            break
        if _is_past(deadline):
            status = Status.TIME_BUDGET
            break
        status = Status.UNSAFE_BETWEEN_NODES  # unless the next round mends it
        outside = held.outside if held is not None and np.isfinite(held.outside) else 0.0
        if outside > CORRIDOR:
            corridor += 1.5 * outside
        if outside <= CORRIDOR or checked.margin < problem.margin:
            tightened += 1.5 * max(problem.margin - checked.margin, GUARD)
        drawn_in = replace(
            path_bounds(problem, tightened=tightened), least_duration=bounds.least_duration
        )
        linear = nlp.hold is LINEAR
        nlp, result = solve(
            drawn_in,
            *nlp.unpack(result.x)[2:],
            *((ties, REFINEMENTS) if linear else (None, MAX_ITERATIONS)),
        )
    if status in BLIND and held is not None and held.fault and checked.margin >= problem.margin:
        status = Status.BASE
    return Plan(
        problem=problem,
        status=status,
        message=failure_message(problem, status, checked, obstacle),
        duration=float(np.sqrt(nlp.unpack(result.x)[3])) if attempt is None else attempt.duration,
        lower_bound=lower_bound,
        certificate=checked,
        iterations=len(history),
        solve_time=time.perf_counter() - started,
        history=tuple(history),
        qp_solver=qp_solver,
        attempt=attempt,
    )


def _backends(
    problem: Problem, qp_solver: str, deadline: float | None
) -> tuple[QPBackend, QPBackend | None]:
    """The QP solver that was asked for and its fallback; dense ProxQP gives way to sparse PIQP where it is too slow."""
    backend = make_backend(qp_solver)
    size = problem.intervals * (problem.coordinates.size + 2 * (problem.base is not None))
    if qp_solver == "proxqp" and size > MOST_DENSE:
        backend = make_backend(FALLBACK)
    fallback = make_backend(FALLBACK) if backend.name != FALLBACK else None
    if deadline is None:
        return backend, fallback
    return Punctual(backend, deadline), None if fallback is None else Punctual(fallback, deadline)


def _is_past(deadline: float | None) -> bool:
    return deadline is not None and time.perf_counter() > deadline


def _better(
    one: tuple[Program, SQPResult], other: tuple[Program, SQPResult]
) -> tuple[Program, SQPResult]:
    return other if _is_better(other, one) else one


def _is_better(found: tuple[Program, SQPResult], best: tuple[Program, SQPResult]) -> bool:
    """Feasible before not; then faster before slower, or a search that ended before one cut off, or less violated."""
    if found[1].status.is_feasible != best[1].status.is_feasible:
        return found[1].status.is_feasible
    if found[1].status.is_feasible:
        return found[0].unpack(found[1].x)[3] < best[0].unpack(best[1].x)[3] * (1.0 + SAME_DURATION)
    cut_off = [result.status is SQPStatus.ITERATION_LIMIT for _, result in (found, best)]
    if cut_off[0] != cut_off[1]:
        return cut_off[1]
    # rows carry S
    outside = [
        result.at.violation / max(result.at.objective, EPSILON) for _, result in (found, best)
    ]
    return outside[0] < outside[1]


def _already_there(problem: Problem, qp_solver: str, started: float) -> Plan:
    """Start and goal are the same state, at rest or in motion: a motion of no duration."""
    q, v = (np.vstack([part] * 2) for part in (problem.start, problem.start_velocity))
    times, base, drive = np.zeros(2), problem.base, None
    if base is not None:
        still, rates = np.zeros((1, 2)), np.vstack([base.start_velocity] * 2)
        yaw = np.full(2, base.start[2])
        drive = UnicycleMotion.from_start(
            times, base.start, rates, yaw, (still, still), problem.base_ground
        )
    attempt = Trajectory(problem.machine.joint_names, times, q, v, 0.0 * v[:1], base=drive)
    checked = certify_for(problem, attempt)
    status = Status.FASTEST_POSSIBLE if checked.safe else Status.INFEASIBLE
    return Plan(
        problem=problem,
        status=status,
        message=failure_message(problem, status, checked),
        duration=0.0,
        lower_bound=0.0,
        certificate=checked,
        iterations=0,
        solve_time=time.perf_counter() - started,
        history=(),
        qp_solver=qp_solver,
        attempt=attempt,
    )
