"""Accepted steps of the SQP, and steps that close what the last one of a run leaves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.direction import Direction, Subproblem
from zmp_sqp.sqp.iterate import Iterate, is_feasible
from zmp_sqp.sqp.nlp import Evaluation, Linearization, NonlinearProgram

__all__ = [
    "Accepted",
    "Closing",
    "added",
    "padded",
    "relative_change",
    "remaining_change",
    "with_excess",
    "without",
]

LARGEST_RATIO = 0.9  # of successive changes, in the extrapolation of the remaining change
LEAST_OBJECTIVE = 1e-8  # smallest divisor of relative changes
# the excess added to rows is that of the previous iterate, times this factor and plus this guard
EXCESS_FACTOR, EXCESS_GUARD = 1.05, 2e-6
CONTRACTION = 0.5  # of the violation by a closing step: with less, a new QP is the better way


@dataclass(frozen=True, slots=True, eq=False)
class Accepted:
    """Accepted point of a step.

    Attributes:
        point: Point, of the program's own type.
        lin: First-order expansion there; where `final`, only its values are those of the point.
        length: Step length.
        corrections: Number of corrections, or of closing steps.
        final: Whether the point solves the program, so that the run ends.
        excess: Excess in the values of a final point.
    """

    point: Any
    lin: Linearization
    length: float
    corrections: int
    final: bool = False
    excess: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Closing:
    r"""Chord steps, which close what the last step of a run leaves of the violation.

    The last QP is solved again with the constraint values at the end of its step (simplified Newton
    method), which takes neither derivatives nor a Hessian.

    Attributes:
        program: Nonlinear program.
        steps: Largest number of chord steps.
        converged: Relative change of the objective's square root that ends the run.
        closable: Largest violation for which a chord step is tried.
        equality: Largest violation of an equality at a solution.
    """

    program: NonlinearProgram
    steps: int
    converged: float
    closable: float
    equality: float

    def of(
        self,
        iterate: Iterate,
        direction: Direction,
        subproblem: Subproblem,
        is_enough: Callable[[Evaluation, float], bool],
    ) -> Accepted | None:
        """Feasible point near the end of a step, if that is the last of the run, else None.

        Args:
            iterate: Iterate at which the step begins.
            direction: The step.
            subproblem: QP that it solves.
            is_enough: Whether values at a point and a step length meet Armijo's condition.
        """
        program, lin, step = self.program, iterate.lin, direction.step
        promised = 0.5 * abs(float(lin.gradient @ step)) / max(lin.at.objective, LEAST_OBJECTIVE)
        if remaining_change(promised, iterate.change) >= self.converged:
            return None
        point = program.moved(lin, iterate.point, step)
        at, excess = program.evaluate(point), iterate.excess
        end = added(at, excess)
        change = relative_change(lin.at.objective, at.objective)
        if not is_enough(end, 1.0) or remaining_change(change, iterate.change) >= self.converged:
            return None
        for count in range(self.steps + 1):
            before = end.violation
            excess = self._excess(point, at, excess)
            end = added(at, excess)
            if is_feasible(end, program.tolerance, self.equality):
                return Accepted(point, replace(lin, at=end), 1.0, count, final=True, excess=excess)
            slow = count > 0 and end.violation > CONTRACTION * before
            if count == self.steps or slow or not end.violation <= self.closable:
                break
            corrected = subproblem.corrected(step, end.inequalities, end.equalities)
            if corrected is None:
                break
            step = corrected
            point = program.moved(lin, iterate.point, step)
            at = program.evaluate(point)
            end = added(at, excess)
        return None

    def _excess(self, point: Any, at: Evaluation, old: Array | None) -> Array | None:
        """Excess of the rows at a point; the old one where that is at least as large."""
        raw = self.program.excess(point, at, fine=True)
        if raw is None or (old is not None and bool((raw <= old).all())):
            return old
        return padded(raw)


def padded(raw: Array) -> Array:
    """Excess that is added to the rows, from that at a point nearby."""
    return EXCESS_FACTOR * raw + EXCESS_GUARD


def remaining_change(change: float, before: float | None) -> float:
    """Last change, or the geometric series of all following changes if that is larger."""
    if before is None or before <= 0.0:
        return change
    ratio = min(change / before, LARGEST_RATIO)
    return change * max(1.0, ratio / (1.0 - ratio))


def relative_change(before: float, after: float) -> float:
    """First-order relative change of the objective's square root, which is the duration."""
    return 0.5 * abs(after - before) / max(abs(before), LEAST_OBJECTIVE)


def added(at: Evaluation, excess: Array | None, sign: float = 1.0) -> Evaluation:
    """Values with the excess added to the nonlinear inequalities."""
    if excess is None:
        return at
    inequalities = at.inequalities.copy()
    inequalities[: len(excess)] += sign * excess
    return replace(at, inequalities=inequalities)


def without(at: Evaluation, excess: Array | None) -> Evaluation:
    """Values with the excess taken off again."""
    return added(at, excess, -1.0)


def with_excess(lin: Linearization, excess: Array | None) -> Linearization:
    """Expansion with the excess added to its values."""
    return lin if excess is None else replace(lin, at=added(lin.at, excess))
