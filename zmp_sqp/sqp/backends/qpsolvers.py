"""Every solver that qpsolvers offers, on condensed QPs."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import qpsolvers
import scipy.sparse as sp

from zmp_sqp.errors import ProblemError
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["QPSolvers"]

SPARSE = frozenset(qpsolvers.sparse_solvers) - frozenset(qpsolvers.dense_solvers)
# Tighter than their defaults, where a solver has such settings; others keep their own.
SETTINGS: dict[str, dict[str, Any]] = {
    "clarabel": {"tol_gap_abs": 1e-10, "tol_gap_rel": 1e-10, "tol_feas": 1e-10},
    "piqp": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 100},
    "osqp": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 100_000},
    "scs": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iters": 100_000},
    # neither its inner cap nor its infeasibility test, which misfires, can be set from here
    "proxqp": {
        "eps_abs": 1e-9,
        "eps_rel": 0.0,
        "max_iter": 40,
        "check_duality_gap": True,
        "eps_duality_gap_abs": 1e-7,
    },
}
# What those that can stop in time call the limit [s].
TIME_LIMITS = {
    "clarabel": "time_limit",
    "highs": "time_limit",
    "osqp": "time_limit",
    "scs": "time_limit_secs",
}


class QPSolvers:
    """Any solver behind qpsolvers; its rows are one-sided (G x <= h)."""

    wants_sparse = False

    def __init__(self, solver: str) -> None:
        """Backend for one solver.

        Raises:
            ProblemError: qpsolvers does not find it; the message lists what it finds.
        """
        if solver not in qpsolvers.available_solvers:
            found = ", ".join(qpsolvers.available_solvers)
            raise ProblemError(f"qpsolvers finds no solver {solver!r}; installed: {found}")
        self.name = f"qpsolvers:{solver}"
        self._solver = solver
        self.time_limit: float | None = None  # [s] for solvers that know one

    def solve(self, qp: QP, *, warm: QPSolution | None = None) -> QPSolution:
        """Solution; a solver's own exception counts as not solved."""
        if not qp.is_finite():
            return QPSolution.nothing(qp, self.name)
        upper, lower = np.isfinite(qp.u), np.isfinite(qp.l)
        C = sp.csr_matrix(qp.C) if qp.is_sparse else qp.C
        stack = sp.vstack if qp.is_sparse else np.vstack
        G, h = stack([C[upper], -C[lower]]), np.concatenate([qp.u[upper], -qp.l[lower]])
        convert = sp.csc_matrix if qp.is_sparse or self._solver in SPARSE else np.asarray
        settings = dict(SETTINGS.get(self._solver, {}))
        if self.time_limit is not None and self._solver in TIME_LIMITS:
            settings[TIME_LIMITS[self._solver]] = self.time_limit
        problem = qpsolvers.Problem(convert(qp.H), qp.g, convert(G), h, convert(qp.A), qp.b)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                answer = qpsolvers.solve_problem(problem, self._solver, **settings)
        except Exception:  # each backend has exceptions of its own; the caller falls back
            return QPSolution.nothing(qp, self.name)
        if answer.x is None or answer.z is None or answer.y is None:
            return QPSolution.nothing(qp, self.name)
        z = np.zeros(len(qp.u))
        z[upper] += answer.z[: int(upper.sum())]
        z[lower] -= answer.z[int(upper.sum()) :]
        iterations = answer.extras.get("iter") or getattr(answer.extras.get("info"), "iter", 0) or 0
        return QPSolution(
            np.array(answer.x),
            np.array(answer.y),
            z,
            bool(answer.found),
            int(iterations),
            self.name,
        )
