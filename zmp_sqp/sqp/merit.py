"""Exact penalty function and its weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.nlp import Evaluation, Linearization
from zmp_sqp.sqp.subproblem import Mask, Step

__all__ = ["Merit"]

# penalty weights over the multipliers' dual norm; any factor above 1 makes the penalty exact
SAFETY = 1.2


@dataclass(slots=True)
class Merit:
    r"""Exact penalty function of the largest nonlinear violation and the sum of all others.

    .. math:: m(x) = f [+ \varphi] + \nu \max_{i \in nonlinear} c_i^+ + \mu (\|c_E\|_1 + \sum_{i \in
        linear} c_i^+)

    A QP step lowers m while :math:`\nu \ge \sum z_{nonlinear}` and :math:`\mu \ge \max(|y|,
    z_{linear})` (the dual norms; Nocedal & Wright 2006, theorem 18.2), and so does a step of the
    relaxed QP with :math:`\rho = \nu`.
    """

    nonlinear: Mask
    nu: float = 1.0
    mu: float = 1.0
    breaks_ties: bool = True

    def raise_weights(self, step: Step) -> None:
        """Keep the weights above the multipliers' dual norms."""
        linear = step.z[~self.nonlinear]
        largest = max(float(np.abs(step.y).max(initial=0.0)), float(linear.max(initial=0.0)))
        self.mu = max(self.mu, SAFETY * largest)
        self.nu = max(self.nu, SAFETY * float(step.z[self.nonlinear].sum()))

    def gradient(self, lin: Linearization) -> Array:
        """Of the objective, with or without its tie breaker."""
        return lin.gradient + lin.tie_gradient if self.breaks_ties else lin.gradient

    def value(self, at: Evaluation) -> float:
        """m; infinite where the program could not be evaluated."""
        if not at.is_finite():
            return np.inf
        objective = at.objective + at.tie_breaker if self.breaks_ties else at.objective
        return objective + self._penalty(at.equalities, at.inequalities)

    def predicted_decrease(self, lin: Linearization, dx: Array) -> float:
        """m minus its first-order model after the step."""
        after = self._penalty(lin.at.equalities + lin.A @ dx, lin.at.inequalities + lin.C @ dx)
        return (
            self._penalty(lin.at.equalities, lin.at.inequalities)
            - after
            - float(self.gradient(lin) @ dx)
        )

    def _penalty(self, equalities: Array, inequalities: Array) -> float:
        over = np.maximum(inequalities, 0.0)
        linear = float(np.abs(equalities).sum() + over[~self.nonlinear].sum())
        return self.nu * float(over[self.nonlinear].max(initial=0.0)) + self.mu * linear
