"""PIQP, an interior-point method that exploits the multistage structure of a QP."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import piqp

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.qp import NOTHING_YET, QP, QPSolution

__all__ = ["PIQP"]


class PIQP:
    """Proximal interior point method of Schwan et al. 2023 with its multistage factorisation.

    Its work grows linearly with the number of stages. Preconditioning is off: with it the proximal
    terms would act on scaled variables, and no longer compensate a slightly indefinite Hessian.
    There is no warm start, so that results are reproducible to the last bit.
    """

    name = "piqp"
    needs_convex = False

    def __init__(self) -> None:
        """Create the backend, with no QP yet."""
        self._solver: Any = None
        self._qp: QP | None = None
        self._tolerance = 0.0

    def solve(
        self, qp: QP, *, tolerance: float, iterations: int, warm: QPSolution | None = None
    ) -> QPSolution:
        """Solution without warm start: an interior-point method gains nothing from one.

        Args:
            qp, tolerance, iterations, warm: Arguments of `QPBackend.solve`.
        """
        self._qp = qp
        if not qp.is_finite():
            self._solver = None
            return QPSolution.nothing(qp, self.name)
        self._tolerance = tolerance
        if qp.size == 0:
            return QPSolution.of_no_variables(qp, self.name, tolerance)
        solver = piqp.SparseSolver()
        settings = solver.settings
        settings.kkt_solver = piqp.KKTSolver.sparse_multistage
        settings.eps_abs = settings.eps_rel = tolerance
        settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = tolerance
        settings.max_iter, settings.preconditioner_iter = iterations, 0
        b = qp.b if qp.A is not None else None
        solver.setup(qp.H, qp.g, qp.A, b, qp.C, None, qp.u)
        self._solver = solver
        return self._answer(solver.solve())

    def solve_again(self, u: Array, b: Array) -> QPSolution:
        """Solution of the last QP with other right-hand sides; the solver is reused."""
        if self._qp is None:
            raise RuntimeError(NOTHING_YET.format(name=self.name))
        if self._qp.size == 0:
            qp = replace(self._qp, u=u, b=b)
            return QPSolution.of_no_variables(qp, self.name, self._tolerance)
        if self._solver is None or not np.isfinite(u.sum() + b.sum()):
            return QPSolution.nothing(self._qp, self.name)
        changes = {"h_u": u} if self._qp.A is None else {"h_u": u, "b": b}
        self._solver.update(**changes)
        return self._answer(self._solver.solve())

    def _answer(self, status: Any) -> QPSolution:
        result = self._solver.result
        solved = status == piqp.PIQP_SOLVED
        return QPSolution(
            np.array(result.x),
            np.array(result.y),
            np.maximum(np.array(result.z_u), 0.0),
            solved,
            int(result.info.iter),
            self.name,
        )
