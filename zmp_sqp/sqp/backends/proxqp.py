"""ProxQP (ProxSuite) on sparse QPs, finished by an active-set method."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import proxsuite
import scipy.sparse as sp

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.backends.active_set import ActiveSetMethod
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["ProxQP"]

EPS_ACTIVE = 1e-4  # enough to tell which rows are active
EPS_ALONE = 1e-8  # where the active-set method has no answer
GAP = 100.0  # sum of complementarity products, per eps
# the default 1e-4 calls feasible QPs of ours infeasible after 2 iterations
EPS_INFEASIBILITY = 1e-12
MAX_ITER = 40  # outer iterations
MAX_ITER_IN = 60  # inner iterations; uncapped, one QP ran for 290 s
NO_BOUND = 1e20  # what ProxQP takes for infinity
PIVOTS_WARM = 300  # from the rows of a guess
PIVOTS = 2000  # from those that ProxQP has found


class ProxQP:
    """Sparse ProxQP, the proximal augmented Lagrangian method of Bambade et al. 2022.

    Its tolerances, both of its iteration caps and its preconditioner are not the default ones: we
    scale ourselves. ProxQP is asked which rows are active, and DAQP's active-set method takes it
    from there: it is exact, and the same program gets the same bits every time. Where multipliers
    tell which rows are active, that method is tried first. Where it fails, ProxQP goes on alone.
    """

    name = "proxqp"
    needs_convex = True

    def __init__(self) -> None:
        """Make a backend without a program."""
        self._exactly: ActiveSetMethod | None = None
        self._last: QPSolution | None = None

    def solve(
        self, qp: QP, *, tolerance: float, iterations: int, warm: QPSolution | None = None
    ) -> QPSolution:
        """Solution, exact where the active-set method finds it.

        Args:
            qp, tolerance, iterations, warm: Arguments of `QPBackend.solve`.
        """
        self._exactly, self._last = None, None
        if not qp.is_finite():
            return QPSolution.nothing(qp, self.name)
        self._exactly = ActiveSetMethod(qp)
        self._last = self._solve(self._exactly, tolerance, warm)
        return self._last

    def solve_again(self, u: Array, b: Array) -> QPSolution:
        """Solution of the last program with other right-hand sides, from the last active rows."""
        assert self._exactly is not None
        assert self._last is not None
        qp = replace(self._exactly.qp, u=u, b=b)
        last = self._last
        if not qp.is_finite():
            return QPSolution.nothing(qp, self.name)
        exact = self._exactly.solve_with(u, b, last.x, last.z > 0.0, most_pivots=PIVOTS)
        if exact is None:
            return _Run(qp, last).solve(EPS_ALONE)
        return replace(exact, backend=self.name)

    def _solve(
        self, exactly: ActiveSetMethod, tolerance: float, warm: QPSolution | None
    ) -> QPSolution:
        qp = exactly.qp
        if warm is not None and warm.z.any():
            near = exactly.solve(warm.x, warm.z > 0.0, most_pivots=PIVOTS_WARM)
            if near is not None:
                return near
            if exactly.is_infeasible:  # ProxQP would run into both its caps
                return QPSolution.nothing(qp, self.name)
        run = _Run(qp, warm)
        found = run.solve(EPS_ACTIVE if exactly.is_ready else EPS_ALONE)
        if not found.is_finite():
            return found
        active = found.z > qp.u - qp.C @ found.x
        pivots = PIVOTS if found.solved else PIVOTS_WARM
        exact = exactly.solve(found.x, active, most_pivots=pivots)
        if exact is not None:
            return replace(exact, iterations=found.iterations + exact.iterations, backend=self.name)
        if exactly.is_infeasible:
            return replace(found, solved=False)
        return run.solve(EPS_ALONE) if exactly.is_ready and found.solved else found


class _Run:
    """ProxQP on one program, from a guess or from cold."""

    def __init__(self, qp: QP, warm: QPSolution | None) -> None:
        self.qp, self.iterations = qp, 0
        sparse = proxsuite.proxqp.sparse
        solver = sparse.QP(qp.size, len(qp.b), len(qp.u))
        settings = solver.settings
        settings.sparse_backend = proxsuite.proxqp.SparseBackend.SparseCholesky
        settings.eps_rel = 0.0
        settings.eps_primal_inf = settings.eps_dual_inf = EPS_INFEASIBILITY
        settings.check_duality_gap = True  # without, z.(Cx - u) = 1e-4 counted as solved
        settings.eps_duality_gap_rel = 0.0
        settings.max_iter, settings.max_iter_in = MAX_ITER, MAX_ITER_IN
        H = sp.csc_matrix(qp.H + sp.triu(qp.H, 1).T)
        lower, upper = np.full(len(qp.u), -NO_BOUND), np.minimum(qp.u, NO_BOUND)
        A, b = (None, None) if qp.A is None else (qp.A, qp.b)
        solver.init(H, qp.g, A, b, qp.C, lower, upper, False)
        self._solver: Any = solver
        self._warm = warm

    def solve(self, eps: float) -> QPSolution:
        """Solution to a tolerance; a second call goes on from the result of the first."""
        guess = proxsuite.proxqp.InitialGuess
        settings = self._solver.settings
        settings.eps_abs, settings.eps_duality_gap_abs = eps, GAP * eps
        if self.iterations:
            settings.initial_guess = guess.WARM_START_WITH_PREVIOUS_RESULT
            self._solver.solve()
        elif self._warm is not None:
            settings.initial_guess = guess.WARM_START
            self._solver.solve(self._warm.x, self._warm.y, self._warm.z)
        else:
            settings.initial_guess = guess.NO_INITIAL_GUESS
            self._solver.solve()
        results = self._solver.results
        self.iterations += int(results.info.iter)
        return QPSolution(
            np.array(results.x),
            np.array(results.y),
            np.maximum(np.array(results.z), 0.0),
            results.info.status == proxsuite.proxqp.QPSolverOutput.PROXQP_SOLVED,
            self.iterations,
            ProxQP.name,
        )
