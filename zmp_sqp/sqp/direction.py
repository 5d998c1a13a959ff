"""Quadratic program of an iterate: screening of inequalities, relaxation, correction."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import Any

import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.backends import QPBackend
from zmp_sqp.sqp.nlp import Linearization
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["Direction", "Subproblem"]

Mask = npt.NDArray[np.bool_]

ROUNDS = 4  # QPs at most, each with the rows added that the solution of the last one violates
ADDED = 0.05  # predicted distance from the bound below which rows are added with the violated ones
# predicted violation of a row, relative to the current violation, that makes another QP necessary
MISSED = 0.2
SOLVED = 1e-6  # largest residual of the rows of a QP whose solution is accepted
DUST = 1e-7  # relative to the largest multiplier: smaller ones are set to zero (interior point)
# the objective of a relaxed QP is about the price times the violation: with a larger tolerance,
# steps near the least violation do not lower the merit function, and are refused
RELAXED_ITERATIONS, RELAXED_TOLERANCE = 100, 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class Direction:
    """Search direction: solution of the quadratic program of an iterate.

    Attributes:
        step: Step d, shape (n,).
        y, z: Multipliers of equalities and inequalities, shape (p,) and (m,).
        predicted: First-order values of the inequalities after the step, shape (m,).
        inner: Iterations of the backend in the last QP.
        rows: Number of inequalities in the last QP.
        slack: Slack of a relaxed QP; zero otherwise.
        backend: Name of the backend that solved it.
        decrease: First-order decrease of the merit function that a full step is predicted to give;
            NaN as long as it is not known.
    """

    step: Array
    y: Array
    z: Array
    predicted: Array
    inner: int
    rows: int
    slack: float
    backend: str
    decrease: float = nan


class Subproblem:
    r"""Quadratic program of one iterate, solved with a working set of inequalities.

    .. math:: \min_d \tfrac12 d^T H d + g^T d \quad \text{s.t.} \quad c_E + A d = 0, \;
              c_I + C d \le 0

    The first QP contains only inequalities near their bounds, and of groups of nearly parallel rows
    the largest (`Jacobian.leading`). Inequalities that its solution violates are added and the QP
    is solved again, until none is violated by more than a fifth of the iterate's violation, at most
    three times.
    """

    def __init__(
        self,
        lin: Linearization,
        H: Any,
        keep: Mask,
        backend: QPBackend,
        tolerance: float,
    ) -> None:
        """Quadratic program of an expansion and a Hessian.

        Args:
            lin: First-order expansion at the iterate.
            H: Hessian of the Lagrangian, upper triangle, CSC.
            keep: Mask of the inequalities in the first QP, shape (m,).
            backend: QP solver.
            tolerance: Tolerance of the QP solvers.
        """
        self.lin, self.H, self.keep = lin, H, keep
        self._backend, self._tolerance = backend, tolerance
        self.inner = 0  # iterations of the backend in all QPs so far

    def solve(self, *, iterations: int, y: Array, z: Array) -> Direction | None:
        """Step of the QP; None if the backend does not solve it.

        Args:
            iterations: Largest number of iterations of the backend.
            y, z: Multipliers of the previous iterate, for a warm start, shape (p,) and (m,).
        """
        lin, keep = self.lin, self.keep
        x, z = np.zeros(len(lin.gradient)), z.copy()
        for rounds in range(1, ROUNDS + 1):
            guess = QPSolution(x, y, z[keep], False, 0, "")
            solution = self._solved(self._qp(keep), self._tolerance, iterations, guess)
            if solution is None:
                return None
            x, y, z[keep] = solution.x, solution.y, solution.z
            predicted = lin.C @ solution.x + lin.at.inequalities
            enlarged = self._with_violated(keep, predicted) if rounds < ROUNDS else None
            if enlarged is None:
                self.keep = keep
                return self._direction(solution, predicted, 0.0)
            keep = enlarged
        return None

    def _with_violated(self, keep: Mask, predicted: Array) -> Mask | None:
        """Mask with the rows that a step violates or nearly violates added; None if it suffices."""
        missed = max(DUST, MISSED * self.lin.at.violation)
        over = (predicted > missed) & ~keep
        if not over.any():
            return None
        leading = self.lin.C.leading(predicted)
        return keep | ((predicted > -ADDED) & leading) if (over & leading).any() else None

    def solve_relaxed(self, nonlinear: int, price: float) -> Direction | None:
        """Step of the QP with a slack on its nonlinear rows; None if the backend does not solve it.

        Args:
            nonlinear: Number of nonlinear inequalities, which come first.
            price: Price per unit of the slack.
        """
        mask = np.arange(len(self.keep)) < nonlinear
        qp = self._qp(self.keep).relaxed(mask[self.keep], price)
        tolerance = min(self._tolerance, RELAXED_TOLERANCE)
        solution = self._solved(qp, tolerance, RELAXED_ITERATIONS, None)
        if solution is None:
            return None
        slack = max(float(solution.x[-1]), 0.0)
        x, z = solution.x[:-1], solution.z[:-1]
        shortened = QPSolution(x, solution.y, z, True, solution.iterations, solution.backend)
        return self._direction(shortened, self.lin.C @ x + self.lin.at.inequalities, slack)

    def corrected(self, step: Array, inequalities: Array, equalities: Array) -> Array | None:
        """Second-order correction (Nocedal & Wright 2006, section 18.3) of a step, shape (n,).

        Solves the last QP again with the constraint values found at the end of the step.

        Args:
            step: Step to correct, shape (n,).
            inequalities, equalities: Values of the constraints at its end.

        Returns:
            The corrected step from the iterate; None if the backend does not solve the QP.
        """
        u = -(inequalities - self.lin.C @ step)[self.keep]
        b = -equalities if self.lin.A is None else self.lin.A @ step - equalities
        solution = self._backend.solve_again(u, b)
        self.inner += solution.iterations
        return solution.x if solution.solved else None

    def _qp(self, keep: Mask) -> QP:
        lin = self.lin
        C, u = lin.C.selected(keep), -lin.at.inequalities[keep]
        return QP(self.H, lin.gradient, lin.A, -lin.at.equalities, C, u)

    def _solved(
        self, qp: QP, tolerance: float, iterations: int, warm: QPSolution | None
    ) -> QPSolution | None:
        """Solution that is reported as solved and whose rows hold; None if they do not."""
        solution = self._backend.solve(qp, tolerance=tolerance, iterations=iterations, warm=warm)
        self.inner += solution.iterations
        if not (solution.solved and solution.is_finite()):
            return None
        above = float((qp.C @ solution.x - qp.u).max(initial=0.0))
        largest = max(1.0, float(np.abs(qp.u).max(initial=0.0)))
        return solution if above <= max(SOLVED, 10.0 * tolerance * largest) else None

    def _direction(self, solution: QPSolution, predicted: Array, slack: float) -> Direction:
        z = np.zeros(len(self.keep))
        z[self.keep] = solution.z
        z[z < DUST * max(1.0, float(z.max(initial=0.0)))] = 0.0
        return Direction(
            solution.x,
            solution.y,
            z,
            predicted,
            solution.iterations,
            int(self.keep.sum()),
            slack,
            solution.backend,
        )
