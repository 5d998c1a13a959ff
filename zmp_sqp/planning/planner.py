"""From a problem to a plan: guess, transcribe, solve, certify, tighten where that fails."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number
from zmp_sqp.errors import ProblemError, TrajectoryError
from zmp_sqp.mechanics.ground import GRAVITY
from zmp_sqp.planning.answer import Plan, Status, diagnosis
from zmp_sqp.planning.certificate import Certificate, certify
from zmp_sqp.planning.double_integrator import grid_minimum_time
from zmp_sqp.planning.driving import DrivingTranscription
from zmp_sqp.planning.driving_model import DrivingModel
from zmp_sqp.planning.guess import initial_guess, kinematic_lower_bound
from zmp_sqp.planning.hold import CONSTANT, LINEAR, slope_ties
from zmp_sqp.planning.model import ArmModel
from zmp_sqp.planning.problem import Problem
from zmp_sqp.planning.simplified import LumpedMass
from zmp_sqp.planning.single_thread import one_blas_thread
from zmp_sqp.planning.trajectory import Trajectory
from zmp_sqp.planning.transcription import Boundary, PathBounds, Transcription
from zmp_sqp.planning.unicycle_motion import UnicycleMotion
from zmp_sqp.sqp.backends import make_backend
from zmp_sqp.sqp.result import IterationRecord, SQPResult, SQPStatus
from zmp_sqp.sqp.solver import SQP, SQPSettings

__all__ = ["plan"]

FALLBACK = "piqp"
GUARD = 5e-5  # [m] kept inside the asked margin, so that a proof of the margin is cheap
LIMIT_GUARD = 1e-8  # relative, likewise for the joint limits
LEAST_TIME = 1e-9  # [s] of no account: ways so short that rounding shows may take this much longer
RATE_SLACK = 1e-10  # relative, above boundary rates that use up the guard
UNBOUNDED = 1e4  # [rad or m] stands for a position limit that is infinite
MAX_TIGHTENINGS = 6
REFINEMENTS = 15  # iterations with linear accelerations; what is not feasible by then is dropped
FEW_CONTROLS = 120  # up to so many, each interval's slope is free; beyond, it follows from its neighbours
Program = Transcription | DrivingTranscription
OUTCOMES = {
    SQPStatus.OPTIMAL: Status.OPTIMAL,
    SQPStatus.BOUND_REACHED: Status.FASTEST_POSSIBLE,
    SQPStatus.FEASIBLE: Status.SAFE,
    SQPStatus.INFEASIBLE: Status.INFEASIBLE,
    SQPStatus.TIME_LIMIT: Status.TIME_BUDGET,
    SQPStatus.ITERATION_LIMIT: Status.ITERATION_LIMIT,
}


@one_blas_thread()
def plan(
    problem: Problem,
    qp_solver: str = "proxqp",
    time_budget: float | None = None,
    *,
    progress: Callable[[IterationRecord], None] | None = None,
) -> Plan:
    r"""Fastest safe motion, by SQP on the multiple-shooting transcription in normalised time.

    .. math:: \min T \quad \text{s.t. ZMP in the polygon, joint limits} \qquad \text{(Song \& Sharf 2020, eq. (19))}

    First with an acceleration per interval; where the ZMP then costs time, again with accelerations that run linearly
    within the intervals, so that the ZMP can follow an edge. The result is certified for all t; if it leaves the
    polygon between the nodes, the rows are drawn in by what is missing and it is solved again.

    Args:
        problem: The question.
        qp_solver: "proxqp", "piqp" (sparse; for many intervals), or "qpsolvers:NAME".
        time_budget: No new iteration starts after this long [s]; None for as long as it takes.
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
    backend = make_backend(qp_solver)
    fallback = make_backend(FALLBACK) if qp_solver != FALLBACK else None
    sqp = SQP(backend, fallback, SQPSettings(deadline=deadline), progress)
    finisher = SQP(backend, fallback, SQPSettings(deadline=deadline, max_iterations=REFINEMENTS), progress)

    model = _stage_model(problem)
    start, goal = _boundaries(problem)
    bounds = _bounds(problem, model, tightened=0.0)
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
    least = max(lower_bound, _grid_bound(start, goal, bounds, problem.intervals))
    bounds = replace(bounds, least_duration=least)
    route = None if problem.base is None else np.vstack([problem.base.start[:2], problem.base.goal[:2]])
    alpha, duration = initial_guess(
        model, start, goal, bounds, intervals=problem.intervals, least_duration=least, route=route
    )
    history: list[IterationRecord] = []
    reach = 0.0 if problem.machine.support is None else problem.machine.support.reach

    def solve(bounds: PathBounds, controls: Array, S: float, ties: Any = None) -> tuple[Program, SQPResult]:
        hold = CONSTANT if controls.shape[1] == 1 else LINEAR
        of_coordinates = Transcription(
            model, start, goal, bounds, intervals=problem.intervals, reference=duration, hold=hold, ties=ties
        )
        nlp: Program = of_coordinates
        if problem.base is not None:
            nlp = DrivingTranscription(of_coordinates, problem.base, problem.base_ground, reach=reach)
        result = (sqp if hold is CONSTANT else finisher).minimize(nlp, nlp.pack(controls, S))
        history.extend(result.history)
        return nlp, result

    nlp, result = solve(bounds, alpha[:, None], duration**2)
    ties = None
    if result.status is SQPStatus.OPTIMAL:  # the ZMP costs time: let the accelerations follow it within the intervals
        controls, S = nlp.unpack(result.x)[2:]
        looser = replace(bounds, least_duration=lower_bound)  # the grid's bound is one of constant accelerations
        ties = slope_ties(controls[:, 0]) if controls.size > FEW_CONTROLS else None
        spread = (
            np.repeat(controls, 2, axis=1)
            if ties is None
            else (ties @ controls.ravel()).reshape(-1, 2, controls.shape[2])
        )
        refined = solve(looser, spread, S, ties)
        if refined[1].status.is_feasible and refined[0].unpack(refined[1].x)[3] <= S:
            (nlp, result), bounds = refined, looser
    tightened, obstacle = 0.0, ""
    attempt: Trajectory | None = None
    for _ in range(MAX_TIGHTENINGS):
        try:
            attempt = found = _trajectory(problem, nlp, result.x)
            checked = certify(problem.machine, found, problem.ground, problem.margin, base=problem.base)
        except (ProblemError, TrajectoryError) as cause:  # off the map, or where the tracks cannot follow
            if problem.base is None or problem.base_ground.uniform:
                raise
            attempt, checked = None, Certificate.of_nothing(problem.margin)
            status, obstacle = Status.TERRAIN, str(cause)
            break
        status = OUTCOMES.get(result.status, Status.FAILED)
        proven = checked.safe and problem.is_met_by(found)
        if proven and not status.success:  # the proof does not ask how the motion was found
            status = Status.SAFE
        if not status.success or proven:
            break
        if not np.isfinite(checked.margin) or checked.safe:  # nothing that drawing in the rows would mend
            status = Status.FAILED
            break
        if problem.distance_limits is not None and not checked.limits_ok:
            status = Status.JOINT_LIMITS  # drawing in the ZMP's rows does not mend that
            break
        status = Status.UNSAFE_BETWEEN_NODES  # unless the next round mends it
        tightened += 1.5 * max(problem.margin - checked.margin, GUARD)
        drawn_in = replace(_bounds(problem, model, tightened=tightened), least_duration=bounds.least_duration)
        nlp, result = solve(drawn_in, *nlp.unpack(result.x)[2:], ties if nlp.hold is LINEAR else None)
    return Plan(
        problem=problem,
        status=status,
        message=diagnosis(problem, status, checked, obstacle),
        duration=float(np.sqrt(nlp.unpack(result.x)[3])) if attempt is None else attempt.duration,
        lower_bound=lower_bound,
        certificate=checked,
        iterations=len(history),
        solve_time=time.perf_counter() - started,
        history=tuple(history),
        qp_solver=qp_solver,
        attempt=attempt,
    )


def _stage_model(problem: Problem) -> ArmModel | DrivingModel:
    """What the stages see: all joints, with or without the base, or the simplified model."""
    coordinates, gravity = problem.coordinates, problem.ground.gravity()
    if problem.base is not None:
        return DrivingModel(problem.machine, problem.base_ground)
    if problem.distance_limits is None:
        return ArmModel(problem.machine, gravity, coordinates)
    lumped = LumpedMass.of(problem.machine, coordinates)
    return ArmModel(problem.machine, gravity, coordinates, (lumped, problem.distance_limits))


def _boundaries(problem: Problem) -> tuple[Boundary, Boundary]:
    """Start and goal in the coordinates; a base adds its way, which begins at zero, and its yaw."""
    coordinates, base = problem.coordinates, problem.base
    sides = []
    for side in ("start", "goal"):
        q = coordinates.coordinates_of(getattr(problem, side))
        v = coordinates.rates_of(getattr(problem, f"{side}_velocity"))
        if base is not None:
            way = 0.0 if side == "start" else problem.base_way
            q, v = np.append(q, [way, getattr(base, side)[2]]), np.append(v, getattr(base, f"{side}_velocity"))
        sides.append(Boundary(q, v))
    return sides[0], sides[1]


def _bounds(problem: Problem, model: ArmModel | DrivingModel, *, tightened: float) -> PathBounds:
    """The coordinates' limits and the wrench rows, drawn in by the guards."""
    machine, support = problem.machine, problem.machine.support
    if support is None:
        raise ProblemError(f"machine {machine.name!r} has no support polygon")
    limits = problem.coordinates.limits(machine.limits)
    if problem.base is not None:
        limits = limits.followed_by(problem.base.limits)
    if isinstance(model, ArmModel) and model.distance is not None:
        limits = model.distance[0].boom_limits(model.distance[1], limits)
    lower = np.maximum(limits.position_lower, -UNBOUNDED) + LIMIT_GUARD
    upper = np.minimum(limits.position_upper, UNBOUNDED) - LIMIT_GUARD
    sides = _boundaries(problem)
    both, rates = np.vstack([side.q for side in sides]), [side.v for side in sides]
    return PathBounds(
        position_lower=np.minimum(lower, both.min(axis=0)),
        position_upper=np.maximum(upper, both.max(axis=0)),
        # a boundary rate that uses up the guard would make a row (v_0 - v) sqrt(S) <= 0 that only S = 0 satisfies
        velocity=np.maximum(limits.velocity * (1.0 - LIMIT_GUARD), np.abs(rates).max(axis=0) * (1.0 + RATE_SLACK)),
        acceleration=limits.acceleration * (1.0 - LIMIT_GUARD),
        wrench_rows=support.wrench_rows(problem.margin + GUARD + tightened),
        weight=machine.mass * GRAVITY,
        least_duration=0.0,
    )


def _grid_bound(start: Boundary, goal: Boundary, bounds: PathBounds, intervals: int) -> float:
    """Least duration on the grid; only motions from rest to rest have one in closed form."""
    if start.v.any() or goal.v.any():
        return 0.0
    return grid_minimum_time(
        goal.q - start.q, max_velocity=bounds.velocity, max_acceleration=bounds.acceleration, intervals=intervals
    )


def _trajectory(problem: Problem, nlp: Program, x: Array) -> Trajectory:
    """The motion in seconds: it arrives to the last digit, and no limit is missed by rounding."""
    coordinates, base, limits = problem.coordinates, problem.base, problem.machine.limits
    if base is not None:
        limits = limits.followed_by(base.limits)
    size = coordinates.size

    def motion(x: Array) -> tuple[Array, Array, Array, float]:
        y, rates, controls, S = nlp.arrived(x)
        joints = coordinates.joints(y[:, :size]), coordinates.rates(rates[:, :size])
        pushes = coordinates.rates(controls[:, :, :size])
        with_base = zip((*joints, pushes), (y, rates, controls), strict=True)
        q, w, u = (np.concatenate([part, whole[..., size:]], axis=-1) for part, whole in with_base)
        return q, w, u, float(np.sqrt(S))

    q, w, controls, duration = motion(x)
    rates, pushes = np.abs(w) / limits.velocity, np.abs(controls) / limits.acceleration
    needed = max(float(rates.max()), float(np.sqrt(pushes.max())))  # the duration at which no limit is exceeded
    if duration < needed <= duration * (1.0 + 1e-7) + LEAST_TIME:
        q, w, controls, duration = motion(np.append(x[:-1], (needed / nlp.reference) ** 2))  # boundary rates stay
    times = np.linspace(0.0, duration, problem.intervals + 1)
    start, end = (nlp.hold.shapes(s)[0] for s in (0.0, 1.0))
    ends = [np.einsum("c,kcn->kn", shape, controls) / duration**2 for shape in (start, end)]
    jerks = (ends[1] - ends[0]) * (problem.intervals / duration)
    v, n = w / duration, problem.machine.size
    drive = None
    if base is not None:
        of_base = ends[0][:, n:], jerks[:, n:]
        drive = UnicycleMotion.from_start(times, base.start, v[:, n:], q[:, -1], of_base, problem.base_ground)
    return Trajectory(problem.machine.joint_names, times, q[:, :n], v[:, :n], ends[0][:, :n], jerks[:, :n], drive)


def _already_there(problem: Problem, qp_solver: str, started: float) -> Plan:
    """Start and goal are the same state, at rest or in motion: a motion of no duration."""
    q, v = (np.vstack([part] * 2) for part in (problem.start, problem.start_velocity))
    times, base, drive = np.zeros(2), problem.base, None
    if base is not None:
        still, rates = np.zeros((1, 2)), np.vstack([base.start_velocity] * 2)
        yaw = np.full(2, base.start[2])
        drive = UnicycleMotion.from_start(times, base.start, rates, yaw, (still, still), problem.base_ground)
    attempt = Trajectory(problem.machine.joint_names, times, q, v, 0.0 * v[:1], base=drive)
    checked = certify(problem.machine, attempt, problem.ground, problem.margin, base=problem.base)
    status = Status.FASTEST_POSSIBLE if checked.safe else Status.INFEASIBLE
    return Plan(
        problem=problem, status=status, message=diagnosis(problem, status, checked), duration=0.0,
        lower_bound=0.0, certificate=checked, iterations=0, solve_time=time.perf_counter() - started, history=(),
        qp_solver=qp_solver, attempt=attempt,
    )  # fmt: skip
