"""From a problem to the numbers of its nonlinear program, and from a solution back to a motion in seconds."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.ground import GRAVITY, terrain_of
from zmp_sqp.mechanics.uncertainty import Corner
from zmp_sqp.motion.double_integrator import grid_minimum_time
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.simplified import LumpedMass
from zmp_sqp.planning.program.driving.model import DrivingModel
from zmp_sqp.planning.program.driving.transcription import DrivingTranscription
from zmp_sqp.planning.program.model import ArmModel, StageModel
from zmp_sqp.planning.program.stacked_model import StackedModel
from zmp_sqp.planning.program.transcription import Boundary, PathBounds, Transcription

__all__ = [
    "GUARD",
    "Program",
    "boundaries",
    "grid_bound",
    "path_bounds",
    "stage_model",
    "trajectory",
]

GUARD = 5e-5  # [m] kept inside the asked margin, so that a proof of the margin is cheap
LIMIT_GUARD = 1e-8  # relative, likewise for the joint limits
LEAST_TIME = 1e-9  # [s] of no account: ways so short that rounding shows may take this much longer
# relative, of the duration, for limits that arriving to the last digit exceeds: on coarse grids
STRETCH = 1e-4
# tried in turn: boundary rates stay, so that in motion the way changes with the duration
STRETCHES = (1.0, 2.0, 4.0)
RATE_SLACK = 1e-10  # relative, above boundary rates that use up the guard
ARRIVED = 1e-9  # [m] from the goal: nearer, nothing is gained
UNBOUNDED = 1e4  # [rad or m] stands for a position limit that is infinite
Program = Transcription | DrivingTranscription


def stage_model(problem: Problem) -> StageModel:
    """What the stages see: all joints, with or without the base, or the simplified model; for every corner."""
    models = tuple(_stage_model(problem, corner) for corner in problem.corners())
    return models[0] if len(models) == 1 else StackedModel(models)


def _stage_model(problem: Problem, corner: Corner) -> StageModel:
    machine = corner.machine
    if problem.base is not None:
        return DrivingModel(machine, terrain_of(corner.ground))
    gravity = corner.ground.gravity()
    if problem.distance_limits is None:
        return ArmModel(machine, gravity, problem.coordinates)
    lumped = LumpedMass.of(problem.machine, problem.coordinates)
    return ArmModel(machine, gravity, problem.coordinates, (lumped, problem.distance_limits))


def boundaries(problem: Problem) -> tuple[Boundary, Boundary]:
    """Start and goal in the coordinates; a base adds its way, which begins at zero, and its yaw."""
    coordinates, base = problem.coordinates, problem.base
    sides = []
    for side in ("start", "goal"):
        q = coordinates.coordinates_of(getattr(problem, side))
        v = coordinates.rates_of(getattr(problem, f"{side}_velocity"))
        if base is not None:
            way = 0.0 if side == "start" else problem.base_way
            q, v = (
                np.append(q, [way, getattr(base, side)[2]]),
                np.append(v, getattr(base, f"{side}_velocity")),
            )
        sides.append(Boundary(q, v))
    return sides[0], sides[1]


def path_bounds(problem: Problem, *, tightened: float) -> PathBounds:
    """The coordinates' limits and the wrench rows, drawn in by the guards."""
    machine, support = problem.machine, problem.machine.support
    if support is None:
        raise ProblemError(f"machine {machine.name!r} has no support polygon")
    limits = problem.coordinates.limits(machine.limits)
    if problem.base is not None:
        limits = limits.followed_by(problem.base.limits)
    if problem.distance_limits is not None:
        limits = LumpedMass.of(machine, problem.coordinates).boom_limits(
            problem.distance_limits, limits
        )
    lower = np.maximum(limits.position_lower, -UNBOUNDED) + LIMIT_GUARD
    upper = np.minimum(limits.position_upper, UNBOUNDED) - LIMIT_GUARD
    sides = boundaries(problem)
    both, rates = np.vstack([side.q for side in sides]), [side.v for side in sides]
    return PathBounds(
        position_lower=np.minimum(lower, both.min(axis=0)),
        position_upper=np.maximum(upper, both.max(axis=0)),
        # a boundary rate that uses up the guard would make a row (v_0 - v) sqrt(S) <= 0 that only S
        # = 0 satisfies
        velocity=np.maximum(
            limits.velocity * (1.0 - LIMIT_GUARD), np.abs(rates).max(axis=0) * (1.0 + RATE_SLACK)
        ),
        acceleration=limits.acceleration * (1.0 - LIMIT_GUARD),
        wrench_rows=support.wrench_rows(problem.margin + GUARD + tightened),
        weight=machine.mass * GRAVITY,
        least_duration=0.0,
    )


def grid_bound(start: Boundary, goal: Boundary, bounds: PathBounds, intervals: int) -> float:
    """Least duration on the grid; only motions from rest to rest have one in closed form."""
    if start.v.any() or goal.v.any():
        return 0.0
    return grid_minimum_time(
        goal.q - start.q,
        max_velocity=bounds.velocity,
        max_acceleration=bounds.acceleration,
        intervals=intervals,
    )


def trajectory(problem: Problem, nlp: Program, x: Array) -> Trajectory:
    """The motion in seconds: it arrives to the last digit, and no limit is missed by rounding.

    The base's true path is not quite that of the program's Runge-Kutta steps, which therefore are
    made to end as far beside the goal on the other side.
    """
    if problem.base is None or not isinstance(nlp, DrivingTranscription):
        return _motion(problem, nlp, x, None)
    aim, before = np.array(problem.base.goal[:2]), np.inf
    while True:
        found = _motion(problem, nlp, x, aim)
        miss = (
            np.zeros(2) if found.base is None else problem.base.goal[:2] - found.base.poses[-1, :2]
        )
        far = float(np.abs(miss).max())
        if far <= ARRIVED or far > 0.1 * before:  # what is left lies sideways
            return found
        before, aim = far, aim + miss


def _motion(problem: Problem, nlp: Program, x: Array, aim: Array | None) -> Trajectory:
    """Motion whose base, if there is one, ends at `aim` after the program's own steps."""
    coordinates, base, limits = problem.coordinates, problem.base, problem.machine.limits
    if base is not None:
        limits = limits.followed_by(base.limits)
    size = coordinates.size

    def motion(x: Array) -> tuple[Array, Array, Array, float]:
        y, rates, controls, S = (
            nlp.arrived(x, aim) if isinstance(nlp, DrivingTranscription) else nlp.arrived(x)
        )
        joints = coordinates.joints(y[:, :size]), coordinates.rates(rates[:, :size])
        pushes = coordinates.rates(controls[:, :, :size])
        with_base = zip((*joints, pushes), (y, rates, controls), strict=True)
        q, w, u = (np.concatenate([part, whole[..., size:]], axis=-1) for part, whole in with_base)
        return q, w, u, float(np.sqrt(S))

    q, w, controls, duration = motion(x)
    for factor in STRETCHES:
        rates, pushes = np.abs(w) / limits.velocity, np.abs(controls) / limits.acceleration
        # the duration at which no limit is exceeded
        needed = max(float(rates.max()), float(np.sqrt(pushes.max())))
        if not duration < needed <= duration * (1.0 + STRETCH) + LEAST_TIME:
            break
        stretched = duration + factor * (needed - duration)
        q, w, controls, duration = motion(np.append(x[:-1], (stretched / nlp.reference) ** 2))
    times = np.linspace(0.0, duration, problem.intervals + 1)
    start, end = (nlp.hold.shapes(s)[0] for s in (0.0, 1.0))
    ends = [np.einsum("c,kcn->kn", shape, controls) / duration**2 for shape in (start, end)]
    jerks = (ends[1] - ends[0]) * (problem.intervals / duration)
    v, n = w / duration, problem.machine.size
    drive = None
    if base is not None:
        of_base = ends[0][:, n:], jerks[:, n:]
        drive = UnicycleMotion.from_start(
            times, base.start, v[:, n:], q[:, -1], of_base, problem.base_ground
        )
    return Trajectory(
        problem.machine.joint_names, times, q[:, :n], v[:, :n], ends[0][:, :n], jerks[:, :n], drive
    )
