"""Third step of planning: the certificate, and tighter constraints where it fails."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from zmp_sqp.errors import ProblemError, TrajectoryError
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.constraints.tip_over import GUARD
from zmp_sqp.planning.problem.undercarriage import Driving
from zmp_sqp.planning.program.solution import trajectory
from zmp_sqp.planning.proof.base_check import BOUNDS_TOLERANCE
from zmp_sqp.planning.proof.boundary_states import meets_boundary_states
from zmp_sqp.planning.proof.certificate import Certificate, certify_for
from zmp_sqp.planning.search.answer import Status
from zmp_sqp.planning.search.explore import RESUMED
from zmp_sqp.planning.search.keep_bound import ABOVE
from zmp_sqp.planning.search.run import Candidate, Runs
from zmp_sqp.planning.search.task import Task, Tightening
from zmp_sqp.sqp.result import SQPStatus

__all__ = ["Proven", "prove"]

MAX_TIGHTENINGS = 6
HARDLY = 1.001 * ABOVE  # what is not slower than the bound by more is called fastest possible
OVERSHOOT = 1.5  # by which a constraint is tightened, per shortfall of its guarantee
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


@dataclass(frozen=True, slots=True, eq=False)
class Proven:
    """How planning ended.

    Attributes:
        status: The verdict.
        certificate: Of the last motion.
        attempt: That motion; None where it could not be made.
        duration: Of the attempt, or of the program's last point [s].
        obstacle: What kept a motion from being made, in words.
    """

    status: Status
    certificate: Certificate
    attempt: Trajectory | None
    duration: float
    obstacle: str = ""


def prove(task: Task, candidate: Candidate, runs: Runs) -> Proven:
    """Certify the motion; where it fails between the nodes, tighten what failed and solve again."""
    problem, tightening = task.problem, Tightening()
    for _ in range(MAX_TIGHTENINGS):
        try:
            motion = trajectory(problem, candidate.program, candidate.motion)
            checked = certify_for(problem, motion)
        except (ProblemError, TrajectoryError) as cause:
            # off the map, or where the tracks cannot follow
            base = problem.undercarriage
            if not isinstance(base, Driving) or base.terrain.uniform:
                raise
            nothing = Certificate.of_nothing(problem.margin)
            return Proven(Status.TERRAIN, nothing, None, candidate.duration, str(cause))
        status = _verdict(task, candidate, motion, checked)
        if status is not Status.UNSAFE_BETWEEN_NODES:
            break
        if runs.is_late:
            status = Status.TIME_BUDGET
            break
        tightening = _tightened(tightening, checked)
        candidate = _solve_again(task, candidate, tightening, runs)
    margin_kept = checked.margin >= problem.margin
    base_fails = any(not found.kept for found in checked.guarantees if found.name == "base")
    if status in BLIND and base_fails and margin_kept:
        status = Status.BASE
    return Proven(status, checked, motion, motion.duration)


def _verdict(task: Task, candidate: Candidate, motion: Trajectory, checked: Certificate) -> Status:
    """What the certificate makes of the search's outcome.

    UNSAFE_BETWEEN_NODES where tighter constraints may mend it.
    """
    status = OUTCOMES.get(candidate.result.status, Status.FAILED)
    if status is Status.FASTEST_POSSIBLE and motion.duration > task.lower_bound * (1.0 + HARDLY):
        status = Status.OPTIMAL
    if checked.safe and meets_boundary_states(task.problem, motion):
        return status if status.success else Status.SAFE  # the proof does not ask how it was found
    if not status.success:
        return status
    if not np.isfinite(checked.margin) or checked.safe:  # nothing that tightening would mend
        return Status.FAILED
    joints = next(found for found in checked.guarantees if found.name == "joint_limits")
    if task.problem.distance_limits is not None and not joints.kept:
        return Status.JOINT_LIMITS  # tightening does not mend that
    return Status.UNSAFE_BETWEEN_NODES


def _tightened(tightening: Tightening, checked: Certificate) -> Tightening:
    """Tightened by more than every guarantee falls short."""
    off_bounds = [
        found.shortfall
        for found in checked.broken
        if found.name == "base" and found.label.endswith("_bounds")
    ]
    if off_bounds and np.isfinite(off_bounds[0]):
        base_bounds = tightening.base_bounds + OVERSHOOT * off_bounds[0]
        tightening = replace(tightening, base_bounds=base_bounds)
    own = [
        found for found in checked.broken if found.name not in ("base", "contact", "joint_limits")
    ]
    for found in own:
        least = GUARD if found.name == "tip_over" else 0.0
        if np.isfinite(found.shortfall):
            tightening = tightening.by(found.name, OVERSHOOT * max(found.shortfall, least))
    if not own and not (off_bounds and off_bounds[0] > BOUNDS_TOLERANCE):
        tightening = tightening.by("tip_over", OVERSHOOT * GUARD)
    return tightening


def _solve_again(task: Task, candidate: Candidate, tightening: Tightening, runs: Runs) -> Candidate:
    """The point of the tighter program, from the last one on."""
    program = task.program(
        candidate.program.reference,
        candidate.program.grid,
        tightening=tightening,
    )
    result = candidate.result
    return runs.minimize(
        program,
        candidate.motion,
        RESUMED,
        y=result.y,
        z=result.z,
        excess=result.excess,
        purpose="tightened",
    )
