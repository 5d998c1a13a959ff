"""Any solver of the package qpsolvers as a QP backend."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import qpsolvers
import scipy.sparse as sp

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError
from zmp_sqp.locks import without_warnings
from zmp_sqp.sqp.qp import NOTHING_YET, QP, QPSolution

__all__ = ["QPSolvers"]

SPARSE = frozenset(qpsolvers.sparse_solvers)
# settings by solver, with tighter tolerances than the defaults; other solvers keep theirs
SETTINGS: dict[str, dict[str, Any]] = {
    "clarabel": {"tol_gap_abs": 1e-10, "tol_gap_rel": 1e-10, "tol_feas": 1e-10},
    "piqp": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 100},
    "osqp": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 100_000},
    "scs": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iters": 100_000},
    # neither the limit of inner iterations nor the tolerance of the infeasibility test, which calls
    # feasible QPs infeasible, can be set through qpsolvers
    "proxqp": {
        "eps_abs": 1e-9,
        "eps_rel": 0.0,
        "max_iter": 40,
        "check_duality_gap": True,
        "eps_duality_gap_abs": 1e-7,
    },
}
# name of the setting for the time limit [s], by solver; other solvers have none
TIME_LIMITS = {
    "clarabel": "time_limit",
    "highs": "time_limit",
    "osqp": "time_limit",
    "scs": "time_limit_secs",
}

LEAST = 1e-8  # tolerance of QPs without variables, at least


class QPSolvers:
    """Solver of the package qpsolvers, without warm start, with tight tolerances."""

    needs_convex = True

    def __init__(self, solver: str) -> None:
        """Backend for one solver.

        Args:
            solver: Name of the solver in qpsolvers.

        Raises:
            ProblemError: The solver is not installed; the message lists those that are.
        """
        if solver not in qpsolvers.available_solvers:
            found = ", ".join(qpsolvers.available_solvers)
            raise ProblemError(f"qpsolvers finds no solver {solver!r}; installed: {found}")
        self.name = f"qpsolvers:{solver}"
        self._solver = solver
        self._qp: QP | None = None
        self.time_limit: float | None = None  # [s] for the next QP, see TIME_LIMITS

    def solve(
        self, qp: QP, *, tolerance: float, iterations: int, warm: QPSolution | None = None
    ) -> QPSolution:
        """Solution of a QP; if the solver raises, the QP counts as not solved.

        Args:
            qp, tolerance, iterations, warm: Arguments of `QPBackend.solve`; only the first is used.
        """
        self._qp = qp
        if not qp.is_finite():
            return QPSolution.nothing(qp, self.name)
        if qp.size == 0:
            return QPSolution.of_no_variables(qp, self.name, max(tolerance, LEAST))
        settings = dict(SETTINGS.get(self._solver, {}))
        if self.time_limit is not None and self._solver in TIME_LIMITS:
            settings[TIME_LIMITS[self._solver]] = self.time_limit
        try:
            with without_warnings():
                answer = qpsolvers.solve_problem(self._problem(qp), self._solver, **settings)
        except Exception:  # solvers raise various exceptions; the caller has a fallback
            return QPSolution.nothing(qp, self.name)
        if answer.x is None or answer.z is None or answer.y is None:
            return QPSolution.nothing(qp, self.name)
        iterations = answer.extras.get("iter") or getattr(answer.extras.get("info"), "iter", 0) or 0
        return QPSolution(
            np.array(answer.x),
            np.array(answer.y),
            np.maximum(np.array(answer.z), 0.0),
            bool(answer.found),
            int(iterations),
            self.name,
        )

    def solve_again(self, u: Array, b: Array) -> QPSolution:
        """Solution of the last QP with other right-hand sides, without warm start."""
        if self._qp is None:
            raise RuntimeError(NOTHING_YET.format(name=self.name))
        return self.solve(replace(self._qp, u=u, b=b), tolerance=0.0, iterations=0)

    def _problem(self, qp: QP) -> qpsolvers.Problem:
        if self._solver in SPARSE:
            H = sp.csc_matrix(qp.H + sp.triu(qp.H, 1).T)
            A, C = qp.A, qp.C
        else:
            H, A, C = qp.dense()
        G, h = (C, qp.u) if len(qp.u) else (None, None)
        return qpsolvers.Problem(H, qp.g, G, h, *((A, qp.b) if len(qp.b) else (None, None)))
