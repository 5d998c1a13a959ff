"""What an SQP run leaves behind: status, history, solution."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Any

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.nlp import Evaluation

__all__ = ["IterationRecord", "SQPResult", "SQPStatus"]


class SQPStatus(enum.Enum):
    """Why the SQP stopped."""

    OPTIMAL = "feasible, and the objective has stopped falling"
    BOUND_REACHED = "feasible, and the objective stands at its proven lower bound"
    FEASIBLE = "feasible, but progress stopped before optimality was shown"
    COARSE = "near enough to a solution to go on with a finer program"
    INFEASIBLE = "steps that weigh the violation above all no longer lower it"
    STALLED = "steps became too short before the constraints were met"
    QP_FAILED = "no backend solved a QP, not even the relaxed one"
    ITERATION_LIMIT = "the iteration limit was reached before the constraints were met"
    TIME_LIMIT = "the time budget ran out before the constraints were met"
    NOT_FINITE = "the program could not be evaluated at the initial guess"

    @property
    def is_feasible(self) -> bool:
        """Whether the point satisfies the constraints."""
        return self in (SQPStatus.OPTIMAL, SQPStatus.BOUND_REACHED, SQPStatus.FEASIBLE)


@dataclass(frozen=True, slots=True)
class IterationRecord:
    """One iteration.

    Attributes:
        iteration: Counted from 1.
        backend: Which one solved the QP.
        inner_iterations: Of all QPs of the iteration.
        rows: Inequalities that took part in the last QP.
        relaxed: Whether the QP had to be relaxed.
        curvature: Whether the curvature of the constraints was in the Hessian.
        corrected: Whether the accepted step is a second-order correction.
        objective: f after the step.
        violation: Largest constraint violation after the step.
        step: Accepted step length, 0 to 1; 0 if no step was taken.
        time: Since the start of the run [s].
    """

    iteration: int
    backend: str
    inner_iterations: int
    rows: int
    relaxed: bool
    curvature: bool
    corrected: bool
    objective: float
    violation: float
    step: float
    time: float


@dataclass(frozen=True, slots=True, eq=False)
class SQPResult:
    """Last iterate with its multipliers.

    Attributes:
        point: The program's own value.
        y: Multipliers of the equalities.
        z: Multipliers of the inequalities.
        excess: What was added to the nonlinear inequalities, or None.
        status: Why the run stopped.
        at: Values at the point, without `excess`.
        history: One record per iteration.
    """

    point: Any
    y: Array
    z: Array
    excess: Array | None
    status: SQPStatus
    at: Evaluation
    history: tuple[IterationRecord, ...]
