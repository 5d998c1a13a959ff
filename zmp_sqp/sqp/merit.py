"""Exact penalty function and its weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.nlp import Evaluation, Linearization
from zmp_sqp.sqp.subproblem import Mask, Step

__all__ = ["Merit"]

SAFETY = 1.2  # penalty weights over the multipliers' dual norm; any factor above 1 makes the penalty exact


@dataclass(slots=True)
class Merit:
    r"""Exact penalty function of the largest nonlinear violation and the sum of all others.

    .. math:: \phi(x) = f + \nu \max_{i \in nonlinear} c_i^+ + \mu (\|c_E\|_1 + \sum_{i \in linear} c_i^+)

    A QP step lowers phi while :math:`\nu \ge \sum z_{nonlinear}` and :math:`\mu \ge \max(|y|, z_{linear})` (the dual
    norms; Nocedal & Wright 2006, theorem 18.2), and so does a step of the relaxed QP with :math:`\rho = \nu`.
    """

    nonlinear: Mask
    nu: float = 1.0
    mu: float = 1.0

    def raise_weights(self, step: Step) -> None:
        """Keep the weights above the multipliers' dual norms."""
        linear = step.z[~self.nonlinear]
        largest = max(float(np.abs(step.y).max(initial=0.0)), float(linear.max(initial=0.0)))
        self.mu = max(self.mu, SAFETY * largest)
        self.nu = max(self.nu, SAFETY * float(step.z[self.nonlinear].sum()))

    def value(self, at: Evaluation) -> float:
        """phi; infinite where the program could not be evaluated."""
        if not at.is_finite():
            return np.inf
        return at.objective + self._penalty(at.equalities, at.inequalities)

    def predicted_decrease(self, lin: Linearization, dx: Array) -> float:
        """phi minus its first-order model after the step."""
        after = self._penalty(lin.at.equalities + lin.A @ dx, lin.at.inequalities + lin.C @ dx)
        return self._penalty(lin.at.equalities, lin.at.inequalities) - after - float(lin.gradient @ dx)

    def _penalty(self, equalities: Array, inequalities: Array) -> float:
        over = np.maximum(inequalities, 0.0)
        linear = float(np.abs(equalities).sum() + over[~self.nonlinear].sum())
        return self.nu * float(over[self.nonlinear].max(initial=0.0)) + self.mu * linear
