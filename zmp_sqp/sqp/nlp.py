"""The nonlinear program that the SQP solves, as a protocol and the values that cross it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array

__all__ = ["Evaluation", "Jacobian", "Linearization", "NonlinearProgram"]

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """Values of a nonlinear program at one point.

    Attributes:
        objective: f, which the program minimises.
        tie_breaker: Small second objective phi that picks one of many minimisers: f + phi is
            minimised.
        equalities: Shape (p,); feasible iff zero.
        inequalities: Shape (m,), the nonlinear ones first; feasible iff not positive.
        memory: What the program keeps for `excess`.
    """

    objective: float
    tie_breaker: float
    equalities: Array
    inequalities: Array
    memory: Any = None

    @property
    def violation(self) -> float:
        """Largest violation of any constraint."""
        equality = float(np.abs(self.equalities).max(initial=0.0))
        return max(equality, float(self.inequalities.max(initial=0.0)))

    def is_finite(self) -> bool:
        """Whether the program could be evaluated here."""
        objective = self.objective + self.tie_breaker
        with np.errstate(invalid="ignore"):
            total = objective + self.equalities.sum() + self.inequalities.sum()
        return bool(np.isfinite(total))


@dataclass(frozen=True, slots=True, eq=False)
class Linearization:
    """First-order expansion of a nonlinear program, by the variables of its quadratic programs.

    Attributes:
        at: The values at the point.
        gradient: Of objective and tie breaker, shape (n,).
        A: Jacobian of the equalities, CSC, shape (p, n); None if there are none.
        C: Jacobian of the inequalities, shape (m, n).
        memory: What the program keeps for its Hessian.
    """

    at: Evaluation
    gradient: Array
    A: Any
    C: Jacobian
    memory: Any


class Jacobian(Protocol):
    """Derivatives of m inequalities by n variables, of which quadratic programs see some rows."""

    def __matmul__(self, step: Array) -> Array:
        """Change of all inequalities by a step (n,) to first order, shape (m,)."""

    def selected(self, mask: Mask) -> Any:
        """The rows of a mask (m,), CSC."""

    def leading(self, values: Array) -> Mask:
        """Rows that join quadratic programs before others that are like them, shape (m,).

        Among many rows alike those with the largest values lead; where no rows are alike, all do.
        The others join when a step makes them the largest ones.

        Args:
            values: Of the inequalities at a point, or predicted, shape (m,).
        """


class NonlinearProgram(Protocol):
    r"""A program :math:`\min f + \varphi` subject to :math:`c_E = 0, \; c_I \le 0`.

    Points are values of the program's own: the SQP moves from one to the next by steps d of n
    variables, and never looks inside. The first `nonlinear` inequalities are the nonlinear ones;
    only those are relaxed where a quadratic program has no solution. The last inequality bounds the
    objective from below.
    """

    @property
    def size(self) -> int:
        """Number n of variables of a step."""

    @property
    def inequalities(self) -> int:
        """Number m of inequalities."""

    @property
    def nonlinear(self) -> int:
        """How many of the inequalities, from the first on, are nonlinear."""

    @property
    def equalities(self) -> int:
        """Number p of equalities."""

    @property
    def tolerance(self) -> Array:
        """Largest violation of each inequality at a solution, shape (m,)."""

    def evaluate(self, point: Any) -> Evaluation:
        """Values at a point."""

    def linearize(self, point: Any) -> Linearization:
        """Values and first derivatives at a point."""

    def hessian(
        self, lin: Linearization, y: Array, z: Array, *, clipped: float, damping: float
    ) -> Any:
        """Hessian of the Lagrangian f + phi + y.c_E + z.c_I, upper triangle, CSC, shape (n, n).

        Args:
            lin: The expansion at the point.
            y, z: Multipliers of equalities and inequalities.
            clipped: Share of negative curvature that is taken away: with 1 the matrix is positive
                semi-definite, with 0 it is exact.
            damping: Added curvature of all variables but the objective's own.
        """

    def moved(self, lin: Linearization, point: Any, step: Array) -> Any:
        """The point after a step d, shape (n,)."""

    def decisive(self, point: Any, *, early: bool) -> Mask:
        """Rows, shape (m,), that take part in quadratic programs far from feasibility.

        Args:
            point: The point.
            early: Whether it is one of the first iterations.
        """

    def excess(self, point: Any, at: Evaluation, *, fine: bool) -> Array | None:
        """What nonlinear rows exceed their values by between the places they are imposed at.

        Shape (nonlinear,), not negative; None if there is no between.

        Args:
            point: The point.
            at: Values there.
            fine: Whether to look closely.
        """

    def optimality_gap(self, point: Any) -> float:
        """Proven bound on how far f is above its optimum, relative; infinite if unknown."""
