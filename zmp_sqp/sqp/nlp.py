"""The nonlinear program that the SQP solves, as a protocol and the values that cross it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array, Indices

__all__ = ["Basis", "Evaluation", "Linearization", "NonlinearProgram"]


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """Values of a nonlinear program at one point.

    Attributes:
        objective: f(x).
        tie_breaker: Small second objective phi(x) that picks one of many minimisers; the program
            minimises f + phi.
        equalities: c_E(x), shape (p,); feasible iff zero.
        inequalities: c_I(x), shape (m,); feasible iff not positive.
    """

    objective: float
    tie_breaker: float
    equalities: Array
    inequalities: Array

    @property
    def violation(self) -> float:
        """Largest violation of any constraint."""
        equality = float(np.abs(self.equalities).max(initial=0.0))
        return max(equality, float(self.inequalities.max(initial=0.0)))

    def is_finite(self) -> bool:
        """Whether the program could be evaluated here."""
        parts = (self.equalities, self.inequalities)
        return bool(np.isfinite(self.objective + self.tie_breaker)) and all(
            bool(np.isfinite(part).all()) for part in parts
        )


@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    r"""Null-space basis of the first equalities (the shooting gaps): condensing, Bock and Plitt 1984.

    .. math:: A_{1..e}\, dx = -c_{1..e} \iff dx = d + Z\, dx_{free}

    Attributes:
        Z: Shape (n, r); an array, or what has its products with arrays.
        d: Particular solution that closes the gaps, shape (n,).
        free: Indices of the r free variables (controls and final time), at which Z is the identity
            and d is zero, shape (r,); empty if there are no such variables, because the basis ties
            controls to each other.
        eliminated: How many equalities, from the first on, this basis satisfies.
    """

    Z: Any
    d: Array
    free: Indices
    eliminated: int


@dataclass(frozen=True, slots=True, eq=False)
class Linearization:
    """First-order expansion of a nonlinear program.

    Attributes:
        at: The values at the point.
        gradient: Of the objective, shape (n,).
        tie_gradient: Of the tie breaker, shape (n,).
        A: Jacobian of the equalities, CSR, shape (p, n).
        C: Jacobian of the inequalities, CSR, shape (m, n).
        basis: For condensing; None if there is nothing to condense.
    """

    at: Evaluation
    gradient: Array
    tie_gradient: Array
    A: Any
    C: Any
    basis: Basis | None


class NonlinearProgram(Protocol):
    r"""A program :math:`\min f(x) + \varphi(x)` subject to :math:`c_E(x) = 0, \; c_I(x) \le 0`."""

    @property
    def nonlinear_rows(self) -> npt.NDArray[np.bool_]:
        """Which inequalities are nonlinear, shape (m,): only those are relaxed when a QP has no solution."""

    def evaluate(self, x: Array) -> Evaluation:
        """Values at x."""

    def linearize(self, x: Array) -> Linearization:
        """Values and first derivatives at x."""

    def hessian(self, x: Array, y: Array, z: Array, *, convex: bool) -> Any:
        """Hessian of the Lagrangian f + phi + y.c_E + z.c_I, CSR, shape (n, n).

        `y` belongs to the equalities that no basis eliminates. With `convex` its blocks are clipped
        to positive semi-definite ones one by one; without, it is exact and in general indefinite.
        """

    def optimality_gap(self, x: Array) -> float:
        """Proven bound on how far f(x), without tie breaker, is from the optimum, relative; infinite if unknown."""
