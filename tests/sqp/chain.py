"""A double integrator with a ceiling: a small staged program, with and without a basis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from zmp_sqp.sqp.nlp import Basis, Evaluation, Linearization

__all__ = ["Chain"]

Array = np.ndarray
RATE_WEIGHT = 0.1
CEILING = 0.6  # for p + BEND p^2 at the nodes; without it the optimum would be above
BEND = 0.3


@dataclass(frozen=True, eq=False)
class Chain:
    """Least effort from rest at 0 to rest at 1/2, with v_0 = 3.

    x = (p_0..p_N, v_0..v_N, u_0..u_{N-1}).

    The equalities are the first state, the gaps, and the goal (the last two). With `condenses` the
    linearisation has a null-space basis.
    """

    N: int = 12
    condenses: bool = True
    goal: float = 0.5

    @property
    def size(self) -> int:
        return 3 * self.N + 2

    @property
    def nonlinear_rows(self) -> np.ndarray:
        return np.arange(3 * self.N + 1) < self.N + 1

    def start(self, seed: int) -> Array:
        """A random point whose gaps are open."""
        return np.random.default_rng(seed).uniform(-0.5, 0.5, self.size)

    def evaluate(self, x: Array) -> Evaluation:
        p, v, u = np.split(x, [self.N + 1, 2 * self.N + 2])
        objective = 0.5 * float(u @ u + RATE_WEIGHT * v @ v) / self.N
        inequalities = np.concatenate([p + BEND * p**2 - CEILING, u - 40.0, -u - 40.0])
        return Evaluation(objective, 0.0, self._A @ x - self._b, inequalities)

    def linearize(self, x: Array) -> Linearization:
        p, v, u = np.split(x, [self.N + 1, 2 * self.N + 2])
        gradient = np.concatenate([0.0 * p, RATE_WEIGHT * v, u]) / self.N
        ceiling = sp.hstack(
            [sp.diags_array(1.0 + 2.0 * BEND * p), sp.csr_array((self.N + 1, 2 * self.N + 1))]
        )
        bounds = sp.hstack([sp.csr_array((self.N, 2 * self.N + 2)), sp.eye_array(self.N)])
        C = sp.csr_array(sp.vstack([ceiling, bounds, -bounds]))
        at = self.evaluate(x)
        return Linearization(
            at,
            gradient,
            np.zeros(self.size),
            self._A,
            C,
            self._basis(at) if self.condenses else None,
        )

    def hessian(self, x: Array, y: Array, z: Array, *, convex: bool) -> sp.csr_array:
        p = 2.0 * BEND * z[: self.N + 1]
        return sp.csr_array(
            sp.diags_array(
                np.concatenate([p, np.r_[[RATE_WEIGHT] * (self.N + 1), [1.0] * self.N] / self.N])
            )
        )

    def optimality_gap(self, x: Array) -> float:
        return np.inf

    @property
    def _A(self) -> sp.csr_array:
        N, h = self.N, 1.0 / self.N
        ahead, here = sp.eye_array(N, N + 1, k=1), sp.eye_array(N, N + 1)
        first, last = (sp.csr_array(([1.0], ([0], [k])), shape=(1, N + 1)) for k in (0, N))
        rows = [
            [first, None, None],
            [None, first, None],
            [ahead - here, -h * here, -0.5 * h**2 * sp.eye_array(N)],
        ]
        rows += [[None, ahead - here, -h * sp.eye_array(N)], [last, None, None], [None, last, None]]
        return sp.csr_array(sp.block_array(rows))

    @property
    def _b(self) -> Array:
        return np.concatenate([[0.0, 3.0], np.zeros(2 * self.N), [self.goal, 0.0]])

    def _basis(self, at: Evaluation) -> Basis:
        states, kept = 2 * self.N + 2, 2 * self.N + 2
        A = self._A.toarray()[:kept]
        Z = np.vstack([-np.linalg.solve(A[:, :states], A[:, states:]), np.eye(self.N)])
        d = np.concatenate(
            [-np.linalg.solve(A[:, :states], at.equalities[:kept]), np.zeros(self.N)]
        )
        return Basis(Z, d, np.arange(states, self.size), kept)
