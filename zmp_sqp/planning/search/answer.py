"""Result of planning: a `Plan` with a safe motion, or with the reason why there is none."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

from zmp_sqp.errors import NotSolved
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.proof.certificate import Certificate
from zmp_sqp.planning.search.run import SearchRun
from zmp_sqp.sqp.result import IterationRecord

__all__ = ["Plan", "Status"]


class Status(enum.Enum):
    """How planning ended; `str()` gives a sentence, with advice where no safe motion was found."""

    OPTIMAL = "Solved: to first order, no motion near this one is faster."
    FASTEST_POSSIBLE = (
        "Solved: no motion within the joint limits is faster by more than about 0.03 %."
    )
    SAFE = (
        "Solved: the motion is safe, but it may not be the fastest; "
        "give more time, or try another QP solver."
    )
    KEPT = (
        "Kept: the remainder of the last motion, or a motion close to it, which is safe; the time "
        "budget ended before a faster motion to the goal was found."
    )
    STOP = (
        "Stopping: the machine comes to rest as fast as it safely can; it does not reach the goal."
    )
    INFEASIBLE = (
        "Not solved: the search ended at a motion that still tips the machine over or breaks "
        "another constraint; try a lighter payload, a gentler slope, a smaller margin, or a goal "
        "closer to the machine."
    )
    TIME_BUDGET = (
        "Not solved: the time budget ran out before a safe motion was found; "
        "give more time, or fewer intervals."
    )
    ITERATION_LIMIT = (
        "Not solved: the iteration limit was reached before a safe motion was found; "
        "try another number of intervals, or another QP solver."
    )
    FAILED = (
        "Not solved: no QP solver could solve the next QP of the search; "
        "try another qp_solver, or another number of intervals."
    )
    JOINT_LIMITS = (
        "Not solved: the bounds on the lumped mass let a joint exceed its own limits; "
        "tighten distance_limits, or leave them out."
    )
    BASE = (
        "Not solved: the motion that was found breaks a limit of the base or misses the goal of "
        "the base; try another goal, wider bounds, or more intervals."
    )
    TERRAIN = (
        "Not solved: the motion that was found leads over ground that the tracks cannot follow; "
        "keep the base away from it by x_bounds or y_bounds."
    )
    ERROR = "Not solved: planning ended with an error."
    UNSAFE_BETWEEN_NODES = (
        "Not solved: the motion is safe at its nodes but not between them; use more intervals."
    )

    def __str__(self) -> str:
        """Sentence that says how planning ended."""
        return self.value

    @property
    def success(self) -> bool:
        """Whether a safe motion was found."""
        return self in (
            Status.OPTIMAL,
            Status.FASTEST_POSSIBLE,
            Status.SAFE,
            Status.KEPT,
            Status.STOP,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Result of planning: the last motion of the search with its certificate and the records.

    Attributes:
        problem: Problem that was planned.
        status: How planning ended.
        message: The status in a sentence; without success, also which constraint is violated, when
            and by how much.
        duration: Duration of the last motion of the search, safe or not [s].
        lower_bound: Duration that no motion within the limits of joints and base can undercut [s].
        certificate: Guarantees of the last motion, at all times and not only at the nodes.
        iterations: Number of SQP iterations, each with one QP or more.
        solve_time: Wall time of planning, certification included [s].
        history: One record per SQP iteration.
        runs: One record per run of the search: guess, grid, QP solver, how it ended.
        qp_solver: Name of the QP solver that the caller chose.
        attempt: Last motion of the search, safe or not; None if there was none.
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
    runs: tuple[SearchRun, ...] = field(default=(), repr=False)

    @property
    def success(self) -> bool:
        """Whether a motion was found that is proven safe at all times."""
        return self.status.success

    def __str__(self) -> str:
        """Summary in a few lines: message, duration, margin, effort of the search."""
        lines = [self.message]
        tip_over = self.certificate.tip_over
        if self.success:
            above = ""
            if self.lower_bound > 0.0:
                above = f", {100.0 * (self.duration / self.lower_bound - 1.0):.2f} % above"
            lines += [
                f"  duration   {self.duration:.4f} s (lower bound {self.lower_bound:.4f} s{above})",
                f"  margin     {self.margin:.4f} m guaranteed, {self.problem.margin:g} m asked for"
                f" ({tip_over.label}, at {tip_over.time:.2f} s)",
            ]
        effort = f"{1e3 * self.solve_time:.0f} ms, SQP iterations: {self.iterations}"
        return "\n".join([*lines, f"  search     {effort}, QP solver {self.qp_solver}"])

    @property
    def margin(self) -> float:
        """Guaranteed signed distance from the ZMP to the nearest edge at all times [m]."""
        return self.certificate.margin

    @property
    def trajectory(self) -> Trajectory:
        """Safe motion from start to goal.

        Raises:
            NotSolved: No safe motion was found; its message is `message`.
        """
        if not self.success or self.attempt is None:
            raise NotSolved(self.message)
        return self.attempt
