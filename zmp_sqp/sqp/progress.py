"""How an SQP run gets on: optimality error, creeping, weight of curvature, damping of the next model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.nlp import Linearization
from zmp_sqp.sqp.result import IterationRecord

__all__ = ["LEAST_DAMPING", "creeps", "kkt_error", "next_damping", "nonlinear_weight"]

SHORT_STEP = 0.3  # after a shorter one the next model is damped
LEAST_DAMPING = 1e-3  # variables are of order one
FADED_DAMPING = 1e-7  # counts as none
CREEP_WINDOW = 10  # iterations
CREEP = 1e-6  # relative fall of the objective in so many iterations that is not worth going on for


def next_damping(damping: float, length: float) -> float:
    """Grows after a short step, fades after full ones."""
    if length <= SHORT_STEP:
        return max(10.0 * damping, LEAST_DAMPING)
    damping = damping / 3.0 if length == 1.0 else damping
    return damping if damping >= FADED_DAMPING else 0.0


def nonlinear_weight(y: Array, gradients: Array, previous: Array) -> float:
    """Sum of the multipliers of equalities whose condensed gradients have changed; linear ones have no curvature."""
    return float(np.abs(y[np.abs(gradients - previous).max(axis=1, initial=0.0) > 0.0]).sum())


def creeps(history: Sequence[IterationRecord], feasibility: float) -> bool:
    """Whether the objective has all but stopped falling among points that are feasible for practical purposes."""
    recent = history[-CREEP_WINDOW:]
    values = [record.objective for record in recent]
    slow = max(values) - min(values) <= CREEP * max(1.0, abs(values[-1])) if values else False
    return (
        len(recent) == CREEP_WINDOW
        and slow
        and all(record.violation <= 10.0 * feasibility for record in recent)
    )


def kkt_error(lin: Linearization, y: Array, z: Array) -> float:
    """Lagrangian gradient in the space of free variables (1-norm) and complementarity products (sum)."""
    gradient = lin.gradient + lin.tie_gradient + lin.C.T @ z
    eliminated = 0 if lin.basis is None else lin.basis.eliminated
    gradient = gradient + lin.A[eliminated:].T @ y
    if lin.basis is not None:
        gradient = lin.basis.Z.T @ gradient
    return float(np.abs(gradient).sum() + np.abs(z * lin.at.inequalities).sum())
