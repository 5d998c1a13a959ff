"""A double integrator with a ceiling: a small staged program with equalities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from zmp_sqp.sqp.nlp import Evaluation, Linearization
from zmp_sqp.sqp.rows import Rows

__all__ = ["Chain"]

Array = np.ndarray
RATE_WEIGHT = 0.1
CEILING = 0.6  # for p + BEND p^2 at the nodes; without it the optimum would be above
BEND = 0.3
BULGE = 0.02  # how far the ceiling hangs down between the nodes, where `excess` looks
MOST = 40.0  # control


@dataclass(frozen=True, eq=False)
class Chain:
    """Least effort from rest at 0 to rest at 1/2, with v_0 = 3.

    x = (p_0..p_N, v_0..v_N, u_0..u_{N-1}). The equalities are the first state, the gaps, and the
    goal (the last two).

    Attributes:
        N: Number of intervals.
        goal: p_N.
        bulges: Whether the nonlinear rows exceed their values between the nodes.
    """

    N: int = 12
    goal: float = 0.5
    bulges: bool = False

    @property
    def size(self) -> int:
        return 3 * self.N + 2

    @property
    def nonlinear(self) -> int:
        return self.N + 1

    @property
    def inequalities(self) -> int:
        return 3 * self.N + 2

    @property
    def equalities(self) -> int:
        return 2 * self.N + 4

    @property
    def tolerance(self) -> Array:
        return np.full(self.inequalities, 2e-7)

    def start(self, seed: int) -> Array:
        """A random point whose gaps are open."""
        return np.random.default_rng(seed).uniform(-0.5, 0.5, self.size)

    def evaluate(self, x: Array) -> Evaluation:
        p, v, u = np.split(x, [self.N + 1, 2 * self.N + 2])
        objective = 1.0 + 0.5 * float(u @ u + RATE_WEIGHT * v @ v) / self.N
        inequalities = np.concatenate([p + BEND * p**2 - CEILING, u - MOST, -u - MOST, [-1.0]])
        return Evaluation(objective, 0.0, self._A @ x - self._b, inequalities)

    def linearize(self, x: Array) -> Linearization:
        p, v, u = np.split(x, [self.N + 1, 2 * self.N + 2])
        gradient = np.concatenate([0.0 * p, RATE_WEIGHT * v, u]) / self.N
        ceiling = sp.hstack(
            [sp.diags_array(1.0 + 2.0 * BEND * p), sp.csr_array((self.N + 1, 2 * self.N + 1))]
        )
        bounds = sp.hstack([sp.csr_array((self.N, 2 * self.N + 2)), sp.eye_array(self.N)])
        none = sp.csr_array((1, self.size))  # the objective has no bound
        C = sp.csc_matrix(sp.vstack([ceiling, bounds, -bounds, none]))
        return Linearization(self.evaluate(x), gradient, self._A, Rows(C), memory=None)

    def hessian(
        self, lin: Linearization, y: Array, z: Array, *, clipped: float, damping: float
    ) -> sp.csc_matrix:
        p = 2.0 * BEND * z[: self.N + 1]
        effort = np.r_[[RATE_WEIGHT] * (self.N + 1), [1.0] * self.N] / self.N
        return sp.csc_matrix(sp.diags_array(np.concatenate([p, effort]) + damping))

    def metric(self) -> sp.csc_matrix:
        """All variables but the last count: that one is taken for the objective."""
        return sp.csc_matrix(sp.eye_array(self.size))

    def moved(self, lin: Linearization, x: Array, step: Array) -> Array:
        return x + step

    def decisive(self, x: Array, *, early: bool) -> np.ndarray:
        return np.zeros(self.inequalities, dtype=bool)

    def excess(self, x: Array, at: Evaluation, *, fine: bool) -> Array | None:
        return np.full(self.nonlinear, BULGE) if self.bulges else None

    def optimality_gap(self, x: Array) -> float:
        return np.inf

    @property
    def _A(self) -> sp.csc_matrix:
        N, h = self.N, 1.0 / self.N
        ahead, here = sp.eye_array(N, N + 1, k=1), sp.eye_array(N, N + 1)
        first, last = (sp.csr_array(([1.0], ([0], [k])), shape=(1, N + 1)) for k in (0, N))
        rows = [
            [first, None, None],
            [None, first, None],
            [ahead - here, -h * here, -0.5 * h**2 * sp.eye_array(N)],
        ]
        rows += [[None, ahead - here, -h * sp.eye_array(N)], [last, None, None], [None, last, None]]
        return sp.csc_matrix(sp.block_array(rows))

    @property
    def _b(self) -> Array:
        return np.concatenate([[0.0, 3.0], np.zeros(2 * self.N), [self.goal, 0.0]])
