"""Boundary states, limits and bound constraints of the nonlinear program of a problem."""

from __future__ import annotations

import numpy as np

from zmp_sqp.mechanics.ground import terrain_of
from zmp_sqp.mechanics.lumped_mass import LumpedMass
from zmp_sqp.mechanics.uncertainty import Corner
from zmp_sqp.motion.double_integrator import grid_minimum_time
from zmp_sqp.planning.constraints.binding import bound_rows
from zmp_sqp.planning.constraints.distance import boom_limits
from zmp_sqp.planning.constraints.protocol import ConstraintRows, StageModel
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.undercarriage import Driving
from zmp_sqp.planning.program.driving.model import DrivingModel
from zmp_sqp.planning.program.limits import Boundary, PathBounds
from zmp_sqp.planning.program.model import ArmModel
from zmp_sqp.planning.program.rows import BoundConstraints, CornerRows

__all__ = [
    "bound_constraints",
    "boundaries",
    "grid_bound",
    "path_bounds",
]

# by which limits are tightened, so that rounding breaks none: positions in rad or m, rates and
# accelerations relative
LIMIT_GUARD = 1e-8
RATE_SLACK = 1e-10  # relative, by which rate limits exceed boundary rates that are at the limit
UNBOUNDED = 1e4  # [rad or m] replaces a position limit that is infinite


def bound_constraints(problem: Problem) -> BoundConstraints:
    """Path constraints of a problem, bound to its machine at all corners of payload and slope."""
    names = [constraint.name for constraint in problem.path_constraints]
    corners: list[CornerRows] = []
    common: tuple[tuple[str, ConstraintRows], ...] = ()
    # by id of the machine: corners with one payload share rows
    rows_of_machine: dict[int, tuple[ConstraintRows, ...]] = {}
    for corner in problem.corners():
        machine = corner.machine
        if id(machine) not in rows_of_machine:
            rows = bound_rows(problem.path_constraints, machine, problem.coordinates)
            rows_of_machine[id(machine)] = rows
        rows = rows_of_machine[id(machine)]
        joint_efforts = any(part.needs_joint_efforts for part in rows)
        model = _stage_model(problem, corner, joint_efforts=joint_efforts)
        named = tuple(zip(names, rows, strict=True))
        own = tuple(pair for pair in named if pair[1].per_corner)
        corners.append(CornerRows(model, own, corner.spread))
        common = common or tuple(pair for pair in named if not pair[1].per_corner)
    return BoundConstraints(tuple(corners), common)


def _stage_model(problem: Problem, corner: Corner, *, joint_efforts: bool) -> StageModel:
    machine = corner.machine
    if isinstance(problem.undercarriage, Driving):
        return DrivingModel(machine, terrain_of(corner.ground), joint_efforts)
    return ArmModel(machine, corner.ground.gravity(), problem.coordinates, joint_efforts)


def boundaries(problem: Problem) -> tuple[Boundary, Boundary]:
    """Start and goal of a problem, in the coordinates of joints and undercarriage."""
    coordinates, undercarriage = problem.coordinates, problem.undercarriage
    sides = []
    for side in ("start", "goal"):
        q = coordinates.coordinates_of(getattr(problem, side))
        v = coordinates.rates_of(getattr(problem, f"{side}_velocity"))
        base_q, base_v = undercarriage.boundary(side)
        sides.append(Boundary(np.append(q, base_q), np.append(v, base_v)))
    return sides[0], sides[1]


def path_bounds(problem: Problem, start: Boundary, goal: Boundary) -> PathBounds:
    """Limits of a problem's coordinates, tightened by `LIMIT_GUARD`; no bound on the duration.

    Args:
        problem: Problem to plan.
        start, goal: Its `boundaries`, which the limits contain.
    """
    machine = problem.machine
    limits = problem.coordinates.limits(machine.limits).followed_by(problem.undercarriage.limits)
    if problem.distance_limits is not None:
        lumped = LumpedMass.of(machine, problem.coordinates)
        limits = boom_limits(lumped, problem.distance_limits, limits)
    lower = np.maximum(limits.position_lower, -UNBOUNDED) + LIMIT_GUARD
    upper = np.minimum(limits.position_upper, UNBOUNDED) - LIMIT_GUARD
    sides = start, goal
    both, rates = np.vstack([side.q for side in sides]), [side.v for side in sides]
    # with a boundary rate v_0 above the tightened limit v, the row (v_0 - v) sqrt(S) <= 0 would
    # hold for S = 0 only
    fastest = np.abs(rates).max(axis=0) * (1.0 + RATE_SLACK)
    return PathBounds(
        position_lower=np.minimum(lower, both.min(axis=0)),
        position_upper=np.maximum(upper, both.max(axis=0)),
        velocity=np.maximum(limits.velocity * (1.0 - LIMIT_GUARD), fastest),
        acceleration=limits.acceleration * (1.0 - LIMIT_GUARD),
        least_duration=0.0,
    )


def grid_bound(start: Boundary, goal: Boundary, bounds: PathBounds, intervals: int) -> float:
    """Least duration of a motion within the limits, one acceleration per joint and interval [s].

    Zero, which is a valid bound, unless the motion is from rest to rest: only then is there a
    closed form (`grid_minimum_time`).
    """
    if start.v.any() or goal.v.any():
        return 0.0
    return grid_minimum_time(
        goal.q - start.q,
        max_velocity=bounds.velocity,
        max_acceleration=bounds.acceleration,
        intervals=intervals,
    )
