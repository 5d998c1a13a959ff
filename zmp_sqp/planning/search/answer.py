"""The answer to a problem: a plan, safe or with the reason why there is none."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

from zmp_sqp.errors import NotSolved
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.proof.certificate import Certificate
from zmp_sqp.sqp.result import IterationRecord

__all__ = ["Plan", "Status"]


class Status(enum.Enum):
    """How planning ended; `str()` is a sentence with advice."""

    OPTIMAL = "Solved: no faster motion of this kind was found to first order."
    FASTEST_POSSIBLE = "Solved: no motion within the joint limits can be faster on this grid."
    SAFE = "Solved: safe, but it may not be the fastest; give more time or another QP solver."
    INFEASIBLE = (
        "Not solved: the search ended at a motion that still tips the machine over; "
        "try a lighter payload, a gentler slope, a smaller margin, or a goal closer to the machine."
    )
    TIME_BUDGET = "Not solved: the time budget ran out first; give more time, or fewer intervals."
    ITERATION_LIMIT = "Not solved: the iteration limit was reached first; try other intervals or another QP solver."
    FAILED = "Not solved: the QP solvers gave up; try another qp_solver, or other intervals."
    JOINT_LIMITS = (
        "Not solved: the bounds on the lumped mass let a joint exceed its own limits; tighten distance_limits, "
        "or leave them out."
    )
    BASE = (
        "Not solved: the motion that was found breaks a limit of its base or misses the base's goal; "
        "try another goal, wider bounds, or more intervals."
    )
    TERRAIN = "Not solved: the motion that was found leads where the tracks cannot go; give x_bounds or y_bounds."
    UNSAFE_BETWEEN_NODES = (
        "Not solved: the motion is safe at its nodes but not between them; use more intervals."
    )

    def __str__(self) -> str:
        return self.value

    @property
    def success(self) -> bool:
        """Whether there is a safe trajectory."""
        return self in (Status.OPTIMAL, Status.FASTEST_POSSIBLE, Status.SAFE)


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Answer to a problem.

    Attributes:
        problem: The question.
        status: How planning ended.
        message: The status in a sentence; without success, with the constraint that stayed
            violated, when and by how much.
        duration: Of the trajectory, or of the last attempt [s].
        lower_bound: No motion within the joint limits can be faster [s].
        certificate: What is guaranteed of the last motion for all t, not only at nodes.
        iterations: QPs solved.
        solve_time: Wall time of the whole planning [s].
        history: One record per SQP iteration.
        qp_solver: Which QP solver was asked for.
        attempt: The last motion that was looked at, safe or not; None if there was none.
    """

    problem: Problem = field(repr=False)
    status: Status
    message: str
    duration: float
    lower_bound: float
    certificate: Certificate
    iterations: int
    solve_time: float
    history: tuple[IterationRecord, ...] = field(repr=False)
    qp_solver: str
    attempt: Trajectory | None = field(repr=False)

    @property
    def success(self) -> bool:
        """Whether `trajectory` is safe for all t."""
        return self.status.success

    @property
    def margin(self) -> float:
        """Guaranteed signed distance from the ZMP to the nearest edge at all times [m]."""
        return self.certificate.margin

    @property
    def trajectory(self) -> Trajectory:
        """The safe motion.

        Raises:
            NotSolved: There is none; the message is the diagnosis.
        """
        if not self.success or self.attempt is None:
            raise NotSolved(self.message)
        return self.attempt
