"""State of an SQP run between two steps: point, multipliers, penalty, curvature, relaxation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.nlp import Evaluation, Linearization
from zmp_sqp.sqp.result import SQPStatus

__all__ = ["CurvatureModel", "Iterate", "Penalty", "Relaxation"]

Mask = npt.NDArray[np.bool_]

DECAY = 0.7  # largest decrease of a penalty weight per step, as a factor
LEAST_WEIGHT = 0.1  # of any penalty term; multipliers are of order one
SAFETY = 1.2  # penalty weight per dual norm of the multipliers; with more than 1 it is exact


@dataclass(frozen=True, slots=True)
class Penalty:
    r"""Exact penalty function: largest nonlinear violation, and sums of all other violations.

    .. math:: m = f + \varphi + \nu \max_{i \in nonlinear} c_i^+
              + \mu \sum_{i \in linear} c_i^+ + \eta \|c_E\|_1

    A step of the quadratic program lowers m while the weights are above the dual norms of the
    multipliers (Nocedal & Wright 2006, theorem 18.2).

    Attributes:
        nonlinear, linear, equality: Weights nu, mu, eta.
    """

    nonlinear: float = 1.0
    linear: float = 1.0
    equality: float = 1.0

    def of(self, inequalities: Array, equalities: Array, count: int) -> float:
        """Penalty terms of m; the first `count` inequalities are the nonlinear ones."""
        curved = max(0.0, float(inequalities[:count].max(initial=0.0)))
        linear = float(np.maximum(inequalities[count:], 0.0).sum())
        off = float(np.abs(equalities).sum())
        return self.nonlinear * curved + self.linear * linear + self.equality * off

    def merit(self, at: Evaluation, count: int) -> float:
        """Merit function m; infinite where the program is undefined."""
        if not at.is_finite():
            return np.inf
        return at.objective + at.tie_breaker + self.of(at.inequalities, at.equalities, count)

    def raised(self, y: Array, z: Array, count: int) -> Penalty:
        """Penalty with weights above the dual norms of given multipliers.

        Larger weights decay, so that one outlier of the multipliers does not shorten all later
        steps.
        """
        norms = (
            float(z[:count].sum()),
            float(z[count:].max(initial=0.0)),
            float(np.abs(y).max(initial=0.0)),
        )
        weights = (self.nonlinear, self.linear, self.equality)
        return Penalty(
            *(
                max(DECAY * weight, SAFETY * norm, LEAST_WEIGHT)
                for weight, norm in zip(weights, norms, strict=True)
            )
        )


@dataclass(frozen=True, slots=True)
class CurvatureModel:
    """Modification of the exact Hessian for the next quadratic program.

    Attributes:
        clipped: Share of the negative curvature that is removed, 0 to 1.
        kept_steps: Number of steps for which the share is not lowered.
        damping: Curvature added to all variables but the objective's (Levenberg, Marquardt).
    """

    clipped: float = 0.5
    kept_steps: int = 0
    damping: float = 0.0

    def damped(self) -> CurvatureModel:
        """This model with ten times the damping."""
        return replace(self, damping=max(LEAST_DAMPING, 10.0 * self.damping))

    def after_step(self, length: float) -> CurvatureModel:
        """Model after a step of given length: more damping if it is short, less if it is full."""
        if length <= SHORT_STEP:
            return self.damped()
        if length < 1.0:
            return self
        faded = self.damping / 3.0
        return replace(self, damping=faded if faded >= FADED_DAMPING else 0.0)


SHORT_STEP = 0.3  # step length up to which the damping is increased
LEAST_DAMPING = 1e-3  # smallest damping after an increase; variables are of order one
FADED_DAMPING = 1e-7  # smaller damping is set to zero


@dataclass(frozen=True, slots=True)
class Relaxation:
    """State of the relaxation of infeasible quadratic programs.

    Attributes:
        active: Whether the last step was relaxed and left a slack, so that the next QP is relaxed
            at once.
        price: Price of the slack.
        violations: Violation over objective after each step of an unbroken series of relaxed steps.
    """

    active: bool = False
    price: float = 10.0
    violations: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Iterate:
    """Point of a nonlinear program with all data that the next step depends on.

    Attributes:
        point: Point, of the program's own type.
        lin: First-order expansion there; its inequalities contain `excess`.
        y, z: Multipliers of equalities and inequalities, shape (p,) and (m,).
        excess: Amounts added to the nonlinear inequalities for their violation between the points
            where they are imposed, shape (nonlinear,); None as long as nothing is added.
        penalty: Penalty function of the line search.
        model: Modification of the next Hessian.
        relaxation: State of the relaxation.
        number: Number of iterations so far.
        step: Absolute change of the inequalities predicted for the last step, shape (m,); None at
            first.
        change: Relative change of the objective's square root by the last step; None if that was
            not a full step.
        corrected: Whether the last step was corrected to second order.
        finishing: Whether the next step only closes the remaining violation.
        verdict: Status with which the run ends here; None if it goes on.
    """

    point: Any
    lin: Linearization
    y: Array
    z: Array
    excess: Array | None = None
    penalty: Penalty = Penalty()
    model: CurvatureModel = CurvatureModel()
    relaxation: Relaxation = Relaxation()
    number: int = 0
    step: Array | None = None
    change: float | None = None
    corrected: bool = False
    finishing: bool = False
    verdict: SQPStatus | None = None

    @property
    def violation(self) -> float:
        """Largest violation of any constraint."""
        return self.lin.at.violation

    def is_feasible(self, tolerance: Array, equality: float) -> bool:
        """Whether inequalities hold to a tolerance (m,), and equalities to one tolerance."""
        return is_feasible(self.lin.at, tolerance, equality)


def is_feasible(at: Evaluation, tolerance: Array, equality: float) -> bool:
    """Whether inequalities hold to a tolerance (m,), and equalities to one tolerance."""
    kept = bool((at.inequalities <= tolerance).all())
    return kept and float(np.abs(at.equalities).max(initial=0.0)) <= equality
