"""The state of an SQP run between two steps."""

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

DECAY = 0.7  # of the weights per step
LEAST_WEIGHT = 0.1
SAFETY = 1.2  # penalty weights over the multipliers' dual norm; any factor above 1 is exact


@dataclass(frozen=True, slots=True)
class Penalty:
    r"""Exact penalty on the largest nonlinear violation and on the sum of all others.

    .. math:: m = f + \varphi + \nu \max_{i \in nonlinear} c_i^+
              + \mu \sum_{i \in linear} c_i^+ + \eta \|c_E\|_1

    A step of the quadratic program lowers m while the weights are above the dual norms of the
    multipliers (Nocedal & Wright 2006, theorem 18.2).

    Attributes:
        nonlinear, linear, equality: The weights nu, mu, eta.
    """

    nonlinear: float = 1.0
    linear: float = 1.0
    equality: float = 1.0

    def of(self, inequalities: Array, equalities: Array, count: int) -> float:
        """The penalty terms of m, with `count` nonlinear inequalities."""
        curved = max(0.0, float(inequalities[:count].max(initial=0.0)))
        linear = float(np.maximum(inequalities[count:], 0.0).sum())
        off = float(np.abs(equalities).sum())
        return self.nonlinear * curved + self.linear * linear + self.equality * off

    def merit(self, at: Evaluation, count: int) -> float:
        """m; infinite where the program could not be evaluated."""
        if not at.is_finite():
            return np.inf
        return at.objective + at.tie_breaker + self.of(at.inequalities, at.equalities, count)

    def raised(self, y: Array, z: Array, count: int) -> Penalty:
        """Weights above the dual norms of these multipliers.

        Larger ones decay: a single wild multiplier must not shorten all later steps.
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
    """How the next Hessian departs from the exact one.

    Attributes:
        clipped: Share of negative curvature that is taken away, 0 to 1.
        held: For how many steps the share is not lowered.
        damping: Curvature added to all variables (Levenberg and Marquardt).
    """

    clipped: float = 0.5
    held: int = 0
    damping: float = 0.0

    def damped(self) -> CurvatureModel:
        """With ten times the damping."""
        return replace(self, damping=max(LEAST_DAMPING, 10.0 * self.damping))

    def after_step(self, length: float) -> CurvatureModel:
        """Damping grows after a short step and fades after full ones."""
        if length <= SHORT_STEP:
            return self.damped()
        if length < 1.0:
            return self
        faded = self.damping / 3.0
        return replace(self, damping=faded if faded >= FADED_DAMPING else 0.0)


SHORT_STEP = 0.3  # after a shorter one the next model is damped
LEAST_DAMPING = 1e-3  # variables are of order one
FADED_DAMPING = 1e-7  # counts as none


@dataclass(frozen=True, slots=True)
class Relaxation:
    """Steps of relaxed quadratic programs, where the exact ones have no solution.

    Attributes:
        active: Whether the last step was one that left a violation.
        price: Of the violation.
        violations: After each relaxed step of an unbroken series, per unit of the objective.
    """

    active: bool = False
    price: float = 10.0
    violations: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Iterate:
    """A point of a nonlinear program, with all that the next step depends on.

    Attributes:
        point: The program's own value.
        lin: First-order expansion there; its inequalities contain `excess`.
        y, z: Multipliers of equalities and inequalities.
        excess: What is added to the nonlinear inequalities because they exceed it between the
            places they are imposed at, shape (nonlinear,); None as long as nothing is added.
        penalty: Weights of the merit function.
        model: Of the next Hessian.
        relaxation: Of the quadratic program.
        number: How many steps led here.
        step: Change of the inequalities by the last step, absolute, shape (m,); None at first.
        change: Relative change of the objective's square root by the last full step, or None.
        finishing: Whether the next step only closes what is still violated.
        verdict: Why the run ends here; None if it goes on.
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
    finishing: bool = False
    verdict: SQPStatus | None = None

    @property
    def violation(self) -> float:
        """Largest violation of any constraint."""
        return self.lin.at.violation

    def is_feasible(self, tolerance: Array, equality: float) -> bool:
        """Whether inequalities hold to a tolerance each, equalities to one for all."""
        return is_feasible(self.lin.at, tolerance, equality)


def is_feasible(at: Evaluation, tolerance: Array, equality: float) -> bool:
    """Whether inequalities hold to a tolerance each, equalities to one for all."""
    kept = bool((at.inequalities <= tolerance).all())
    return kept and float(np.abs(at.equalities).max(initial=0.0)) <= equality
