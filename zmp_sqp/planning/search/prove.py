"""Third step of planning: certify the motion, and tighten constraints where that fails."""

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

MAX_TIGHTENINGS = 6  # certificates at most
# largest relative excess over the lower bound with status FASTEST_POSSIBLE: `ABOVE`, and what
# closing the last rounding errors of a motion may add to it; messages give the excess itself
AT_BOUND = 1.15 * ABOVE
LEAST_PROOF = 0.3  # of a certificate, in times that it took to build the motion over terrain
OVERSHOOT = 1.5  # tightening of a constraint per shortfall of its guarantee
# status of the plan by status of the SQP run, if the certificate does not change it
OUTCOMES = {
    SQPStatus.OPTIMAL: Status.OPTIMAL,
    SQPStatus.BOUND_REACHED: Status.FASTEST_POSSIBLE,
    SQPStatus.FEASIBLE: Status.SAFE,
    SQPStatus.INFEASIBLE: Status.INFEASIBLE,
    SQPStatus.TIME_LIMIT: Status.TIME_BUDGET,
    SQPStatus.COARSE: Status.TIME_BUDGET,  # no time was left for the finer grids
    SQPStatus.ITERATION_LIMIT: Status.ITERATION_LIMIT,
}
# statuses that are replaced by BASE if only the base is at fault
MAYBE_BASE = (Status.INFEASIBLE, Status.FAILED, Status.UNSAFE_BETWEEN_NODES)


@dataclass(frozen=True, slots=True, eq=False)
class Proven:
    """Last motion of the search, with its certificate and the status of the plan.

    Attributes:
        status: How planning ended.
        certificate: Certificate of the last motion.
        attempt: Last motion; None where no trajectory could be built from the program's point.
        duration: Duration of the attempt, or of the program's last point [s].
        obstacle: Reason why no trajectory could be built, in words; empty if it could.
        candidate: Point of the program that the attempt was built from; None if there was none.
    """

    status: Status
    certificate: Certificate
    attempt: Trajectory | None
    duration: float
    obstacle: str = ""
    candidate: Candidate | None = None


def prove(task: Task, candidate: Candidate, runs: Runs) -> Proven:
    """Certify the motion; tighten constraints that fail between nodes, and solve again."""
    runs.enter("prove")
    problem, tightening = task.problem, Tightening()
    for _ in range(MAX_TIGHTENINGS):
        started = runs.clock()
        try:
            motion = trajectory(problem, candidate.program, candidate.motion, candidate.fine)
            if _is_due(runs, started):
                nothing, late = Certificate.of_nothing(problem.margin), Status.TIME_BUDGET
                return Proven(late, nothing, motion, motion.duration, candidate=candidate)
            checked = certify_for(problem, motion, anywhere=task.goal.free)
            runs.proof_time = runs.clock() - started
        except (ProblemError, TrajectoryError) as cause:
            # the path leaves the map, or the tracks cannot follow the ground
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
    if status in MAYBE_BASE and base_fails and margin_kept:
        status = Status.BASE
    return Proven(status, checked, motion, motion.duration, candidate=candidate)


def _is_due(runs: Runs, started: float) -> bool:
    """Whether another certified motion is to be the answer instead of one that is just built."""
    if runs.ends is None:
        return False
    now = runs.clock()
    return now + LEAST_PROOF * (now - started) > runs.ends


def _verdict(task: Task, candidate: Candidate, motion: Trajectory, checked: Certificate) -> Status:
    """Status of the plan, from the outcome of the search and the certificate.

    UNSAFE_BETWEEN_NODES means that tighter constraints may give a safe motion.
    """
    status = OUTCOMES.get(candidate.result.status, Status.FAILED)
    if status is Status.FASTEST_POSSIBLE and motion.duration > task.lower_bound * (1.0 + AT_BOUND):
        status = Status.OPTIMAL
    if checked.safe and meets_boundary_states(task.problem, motion, anywhere=task.goal.free):
        return status if status.success else Status.SAFE  # proven safe, however it was found
    if not status.success:
        return status
    if not np.isfinite(checked.margin) or checked.safe:  # tightening would not help
        return Status.FAILED
    joints = next(found for found in checked.guarantees if found.name == "joint_limits")
    if task.problem.distance_limits is not None and not joints.kept:
        return Status.JOINT_LIMITS  # tightening does not help
    return Status.UNSAFE_BETWEEN_NODES


def _tightened(tightening: Tightening, checked: Certificate) -> Tightening:
    """Tightening increased by `OVERSHOOT` times the shortfall of every failed guarantee."""
    off_bounds = [
        found.shortfall
        for found in checked.broken
        if found.name == "base" and found.label.endswith("_bounds")
    ]
    if off_bounds and np.isfinite(off_bounds[0]):
        base_bounds = tightening.base_bounds + OVERSHOOT * off_bounds[0]
        tightening = replace(tightening, base_bounds=base_bounds)
    failed = [
        found for found in checked.broken if found.name not in ("base", "contact", "joint_limits")
    ]
    for found in failed:
        least = GUARD if found.name == "tip_over" else 0.0
        if np.isfinite(found.shortfall):
            tightening = tightening.by(found.name, OVERSHOOT * max(found.shortfall, least))
    if not failed and not (off_bounds and off_bounds[0] > BOUNDS_TOLERANCE):
        tightening = tightening.by("tip_over", OVERSHOOT * GUARD)
    return tightening


def _solve_again(task: Task, candidate: Candidate, tightening: Tightening, runs: Runs) -> Candidate:
    """SQP run on the program with tighter constraints, resumed from the last point."""
    grid, reference = candidate.program.grid, candidate.program.reference
    fine, purpose = candidate.fine, "tightened"
    if fine is not None:  # a motion at the bound, which has no multipliers
        program = task.program(reference, fine, tightening=tightening)
        point = program.pack(grid.on(fine, candidate.controls), candidate.S)
        none = {"y": np.zeros(program.equalities), "z": np.zeros(program.inequalities)}
        return runs.minimize(program, point, RESUMED, **none, purpose=purpose)
    program, result = task.program(reference, grid, tightening=tightening), candidate.result
    known = {"y": result.y, "z": result.z, "excess": result.excess}
    return runs.minimize(program, candidate.motion, RESUMED, **known, purpose=purpose)
