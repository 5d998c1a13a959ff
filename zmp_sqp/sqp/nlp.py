"""Protocol of the nonlinear programs that the SQP solves, and the values they return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array
from zmp_sqp.cached import cached_property

__all__ = ["Evaluation", "Jacobian", "Linearization", "NonlinearProgram"]

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Values of objective and constraints of a nonlinear program at one point.

    Attributes:
        objective: Objective f.
        tie_breaker: Small second objective phi that picks one of many minimisers of f: f + phi is
            minimised.
        equalities: c_E, shape (p,); zero at a feasible point.
        inequalities: c_I, shape (m,), the nonlinear ones first; not positive at a feasible point.
        memory: Data of the program for its method `excess`.
    """

    objective: float
    tie_breaker: float
    equalities: Array
    inequalities: Array
    memory: Any = None

    @cached_property
    def violation(self) -> float:
        """Largest violation of any constraint, absolute."""
        equality = float(np.abs(self.equalities).max(initial=0.0))
        return max(equality, float(self.inequalities.max(initial=0.0)))

    def is_finite(self) -> bool:
        """Whether all values are finite, so that the program is defined at the point."""
        objective = self.objective + self.tie_breaker
        with np.errstate(invalid="ignore"):
            total = objective + self.equalities.sum() + self.inequalities.sum()
        return bool(np.isfinite(total))


@dataclass(frozen=True, slots=True, eq=False)
class Linearization:
    """First-order expansion of a nonlinear program by the variables of its quadratic programs.

    Attributes:
        at: Values at the point.
        gradient: Gradient of f + phi, shape (n,).
        A: Jacobian of the equalities, CSC, shape (p, n); None if there are none.
        C: Jacobian of the inequalities, shape (m, n).
        memory: Data of the program for its method `hessian`.
    """

    at: Evaluation
    gradient: Array
    A: Any
    C: Jacobian
    memory: Any


class Jacobian(Protocol):
    """Jacobian of m inequalities by n variables, of which quadratic programs use some rows."""

    def __matmul__(self, step: Array) -> Array:
        """First-order change of all inequalities by a step (n,), shape (m,)."""

    def selected(self, mask: Mask) -> Any:
        """Rows selected by a mask (m,), CSC."""

    def leading(self, values: Array) -> Mask:
        """Mask (m,) of the rows that quadratic programs may use at given values.

        Where a program has groups of nearly parallel rows, such as one constraint at many payload
        corners, only the row with the largest value of each group is selected. Others follow when a
        step makes them the largest. Without such groups all rows are selected.

        Args:
            values: Values of the inequalities at a point, or predicted ones, shape (m,).
        """


class NonlinearProgram(Protocol):
    r"""Nonlinear program :math:`\min f + \varphi` subject to :math:`c_E = 0, \; c_I \le 0`.

    Points are of a type that the program chooses; the SQP passes them on without using their
    content, and gets from one to the next by `moved` with a step d of n variables. The first
    `nonlinear` inequalities are the nonlinear ones, which alone are relaxed where a quadratic
    program is infeasible. The last inequality bounds the objective from below.
    """

    @property
    def size(self) -> int:
        """Number n of variables of a step."""

    @property
    def inequalities(self) -> int:
        """Number m of inequalities."""

    @property
    def nonlinear(self) -> int:
        """Number of nonlinear inequalities, which come first."""

    @property
    def equalities(self) -> int:
        """Number p of equalities."""

    @property
    def tolerance(self) -> Array:
        """Largest violation of each inequality at a solution, shape (m,)."""

    def evaluate(self, point: Any) -> Evaluation:
        """Values of objective and constraints at a point."""

    def linearize(self, point: Any) -> Linearization:
        """Values and first derivatives of objective and constraints at a point."""

    def hessian(
        self, lin: Linearization, y: Array, z: Array, *, clipped: float, damping: float
    ) -> Any:
        """Hessian of the Lagrangian f + phi + y.c_E + z.c_I, upper triangle, CSC, shape (n, n).

        Args:
            lin: First-order expansion at the point.
            y, z: Multipliers of equalities and inequalities, shape (p,) and (m,).
            clipped: Share of the negative curvature that is removed: with 1 the matrix is positive
                semi-definite, with 0 it is exact.
            damping: Curvature added to all variables but the objective's (Levenberg, Marquardt).
        """

    def moved(self, lin: Linearization, point: Any, step: Array) -> Any:
        """Point after a step d, shape (n,), from the point of an expansion."""

    def decisive(self, point: Any, *, early: bool) -> Mask:
        """Mask (m,) of rows that quadratic programs must contain far from feasibility.

        Args:
            point: Point of the iterate.
            early: Whether the iterate is one of the first, for which more rows are selected.
        """

    def excess(self, point: Any, at: Evaluation, *, fine: bool) -> Array | None:
        """Excess of nonlinear rows between the points where they are imposed.

        Constraints that hold for all times are imposed at some times only; the excess is the amount
        by which they may be violated in between. Not negative, shape (nonlinear,); None if there is
        nothing in between.

        Args:
            point: Point of the iterate.
            at: Values there.
            fine: Whether to sample densely.
        """

    def optimality_gap(self, point: Any) -> float:
        """Proven bound on the relative distance of f from its minimum; infinite if unknown."""
