"""Result of an SQP run: status, last point with multipliers, record of each iteration."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from math import nan
from typing import Any

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.nlp import Evaluation

__all__ = ["IterationRecord", "SQPResult", "SQPStatus"]


class SQPStatus(enum.Enum):
    """Why the SQP stopped; values are phrases for messages."""

    OPTIMAL = "feasible, and the objective has stopped falling"
    BOUND_REACHED = "feasible, and the objective stands at its proven lower bound"
    FEASIBLE = "feasible, but progress stopped before optimality was shown"
    COARSE = "near enough to a solution to go on with a finer program"
    INFEASIBLE = "steps that weigh the violation above all no longer lower it"
    NO_GAIN = "the first step promised no gain worth a search"
    STALLED = "steps became too short before the constraints were met"
    QP_FAILED = "no backend solved a QP, not even the relaxed one"
    ITERATION_LIMIT = "the iteration limit was reached before the constraints were met"
    TIME_LIMIT = "the time budget ran out before the constraints were met"
    NOT_FINITE = "the program could not be evaluated at the initial guess"

    @property
    def is_feasible(self) -> bool:
        """Whether the last point satisfies the constraints."""
        return self in (SQPStatus.OPTIMAL, SQPStatus.BOUND_REACHED, SQPStatus.FEASIBLE)


@dataclass(frozen=True, slots=True)
class IterationRecord:
    """Record of one SQP iteration.

    Attributes:
        iteration: Number of the iteration, from 1.
        backend: Name of the backend that solved the QP.
        inner_iterations: Iterations of the backend in all QPs of the iteration.
        rows: Number of inequalities in the last QP.
        relaxed: Whether the nonlinear rows of the QP were relaxed.
        curvature: Whether the curvature of the constraints was in the Hessian.
        corrected: Whether the accepted step is a second-order correction.
        objective: f after the step.
        violation: Largest constraint violation after the step.
        step: Accepted step length, 0 to 1; 0 if no step was taken.
        time: Wall time since the start of the run [s].
        decrease: First-order decrease of the merit function that a full step was predicted to give;
            zero at a Karush-Kuhn-Tucker point, NaN where there was no step to predict it from.
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
    decrease: float = nan


@dataclass(frozen=True, slots=True, eq=False)
class SQPResult:
    """Last point of an SQP run with its multipliers.

    Attributes:
        point: Point, of the program's own type.
        y: Multipliers of the equalities, shape (p,).
        z: Multipliers of the inequalities, shape (m,).
        excess: Amounts added to the nonlinear inequalities, shape (nonlinear,), see
            `NonlinearProgram.excess`; None if nothing was added.
        status: Why the run stopped.
        at: Values at the point, without `excess`; None for a feasible point that was found with a
            coarser program, whose own program has not been evaluated there.
        history: One record per iteration.
    """

    point: Any
    y: Array
    z: Array
    excess: Array | None
    status: SQPStatus
    at: Evaluation | None
    history: tuple[IterationRecord, ...]
