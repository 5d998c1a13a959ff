"""The quadratic program of an iterate: screened, and relaxed where it has no solution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.backends import QPBackend
from zmp_sqp.sqp.nlp import Linearization
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["Direction", "Subproblem"]

Mask = npt.NDArray[np.bool_]

ROUNDS = 4  # of adding rows that a solution violates
ADDED = 0.05  # rows that a screened solution brings nearer to their bound than this join
MISSED = 0.2  # of the current violation: rows that a step misses by less wait for the next one
SOLVED = 1e-6  # residual of rows in the program of a solution that is believed
DUST = 1e-7  # of the largest: smaller multipliers are what an interior point leaves
# a relaxed program's objective is the price times the violation: at a larger tolerance steps near
# the least violation lower nothing, and are refused
RELAXED_ITERATIONS, RELAXED_TOLERANCE = 100, 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class Direction:
    """Step of one quadratic program.

    Attributes:
        step: d, shape (n,).
        y, z: Multipliers, shape (p,) and (m,).
        predicted: Inequalities after the step to first order, shape (m,).
        inner: Inner iterations of the backend in the last round.
        rows: How many inequalities took part.
        slack: Violation that a relaxed program left; zero for others.
        backend: Who solved it.
    """

    step: Array
    y: Array
    z: Array
    predicted: Array
    inner: int
    rows: int
    slack: float
    backend: str


class Subproblem:
    r"""Quadratic program about one iterate.

    .. math:: \min_d \tfrac12 d^T H d + g^T d \quad \text{s.t.} \quad c_E + A d = 0, \;
              c_I + C d \le 0

    Only inequalities near their bounds take part, and of rows alike those that lead (`Jacobian`).
    Those that the solution violates join, until it violates none by more than a fifth of what is
    violated now, or after four programs.
    """

    def __init__(
        self,
        lin: Linearization,
        H: Any,
        keep: Mask,
        backends: tuple[QPBackend, ...],
        tolerance: float,
    ) -> None:
        """Hold the expansion.

        Args:
            lin: First-order expansion.
            H: Hessian, upper triangle, CSC.
            keep: Inequalities that take part at first, shape (m,).
            backends: Asked one after the other until one solves the program.
            tolerance: Of solutions.
        """
        self.lin, self.H, self.keep = lin, H, keep
        self._backends, self._tolerance = backends, tolerance
        self._backend = backends[0]
        self.inner = 0  # inner iterations of all programs so far

    def solve(self, *, iterations: int, y: Array, z: Array) -> Direction | None:
        """Step; None if no backend finds one.

        Args:
            iterations: Inner iterations at most.
            y, z: Multipliers of the last step's program, shape (p,) and (m,).
        """
        lin, keep = self.lin, self.keep
        x, z = np.zeros(len(lin.gradient)), z.copy()
        for rounds in range(1, ROUNDS + 1):
            guess = QPSolution(x, y, z[keep], False, 0, "")
            solution = self._ask(self._qp(keep), self._tolerance, iterations, guess)
            if solution is None:
                return None
            x, y, z[keep] = solution.x, solution.y, solution.z
            predicted = lin.C @ solution.x + lin.at.inequalities
            joined = self._joined(keep, predicted) if rounds < ROUNDS else None
            if joined is None:
                self.keep = keep
                return self._direction(solution, predicted, 0.0)
            keep = joined
        return None

    def _joined(self, keep: Mask, predicted: Array) -> Mask | None:
        """Rows with those that a step brings near; None if it violates no other one by much."""
        missed = max(DUST, MISSED * self.lin.at.violation)
        over = (predicted > missed) & ~keep
        if not over.any():
            return None
        leading = self.lin.C.leading(predicted)
        return keep | ((predicted > -ADDED) & leading) if (over & leading).any() else None

    def solve_relaxed(self, nonlinear: int, price: float) -> Direction | None:
        """Step of the program whose nonlinear rows may be violated at a price; None if that fails.

        Args:
            nonlinear: How many of the inequalities are nonlinear.
            price: Per unit of the largest violation.
        """
        mask = np.arange(len(self.keep)) < nonlinear
        qp = self._qp(self.keep).relaxed(mask[self.keep], price)
        tolerance = min(self._tolerance, RELAXED_TOLERANCE)
        solution = self._ask(qp, tolerance, RELAXED_ITERATIONS, None)
        if solution is None:
            return None
        slack = max(float(solution.x[-1]), 0.0)
        x, z = solution.x[:-1], solution.z[:-1]
        shortened = QPSolution(x, solution.y, z, True, solution.iterations, solution.backend)
        return self._direction(shortened, self.lin.C @ x + self.lin.at.inequalities, slack)

    def corrected(self, step: Array, inequalities: Array, equalities: Array) -> Array | None:
        """Step of the program whose constraints have the values found at the end of another step.

        Args:
            step: That other step, shape (n,).
            inequalities, equalities: Values at its end.
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

    def _ask(
        self, qp: QP, tolerance: float, iterations: int, warm: QPSolution | None
    ) -> QPSolution | None:
        """First solution that a backend calls solved and that its rows confirm."""
        for backend in self._backends:
            solution = backend.solve(qp, tolerance=tolerance, iterations=iterations, warm=warm)
            self.inner += solution.iterations
            if solution.solved and solution.is_finite():
                above = float((qp.C @ solution.x - qp.u).max(initial=0.0))
                largest = max(1.0, float(np.abs(qp.u).max(initial=0.0)))
                if above <= max(SOLVED, 10.0 * tolerance * largest):
                    self._backend = backend
                    return solution
        return None

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
