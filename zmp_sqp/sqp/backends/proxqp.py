"""ProxQP (ProxSuite) on sparse QPs, finished by an active-set method."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import proxsuite
import scipy.sparse as sp

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.sqp.backends.active_set import ActiveSetMethod
from zmp_sqp.sqp.backends.piqp import PIQP
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["ProxQP"]

# variables and inequalities up to which dense matrices are faster; their factorisation takes memory
# for the square of both
SMALL, FEW = 60, 700
# of more rows ProxQP sees those nearest to their bound, so many per variable and so many more
NEAREST, NEAREST_MORE = 3, 500
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
# variables beyond which PIQP solves the program: at 2000 one call of the active-set method may take
# two minutes, in which no time budget can stop it
LARGEST = 1200


class ProxQP:
    """Sparse ProxQP, the proximal augmented Lagrangian method of Bambade et al. 2022.

    Its tolerances, both of its iteration caps and its preconditioner are not the default ones: we
    scale ourselves. ProxQP is asked which rows are active, and DAQP's active-set method takes it
    from there: it is exact, and the same program gets the same bits every time. Where multipliers
    tell which rows are active, that method is tried first. Where it fails, ProxQP goes on alone.
    Programs of more than 1200 variables (120 intervals of five joints) are left to PIQP.
    """

    name = "proxqp"
    needs_convex = True

    def __init__(self) -> None:
        """Make a backend without a program."""
        self._exactly: ActiveSetMethod | None = None
        self._last: QPSolution | None = None
        self._instead: PIQP | None = None

    def solve(
        self, qp: QP, *, tolerance: float, iterations: int, warm: QPSolution | None = None
    ) -> QPSolution:
        """Solution, exact where the active-set method finds it.

        Args:
            qp, tolerance, iterations, warm: Arguments of `QPBackend.solve`.
        """
        self._last = self._instead = None
        if qp.size > LARGEST:
            self._instead = PIQP()
            return self._instead.solve(qp, tolerance=tolerance, iterations=iterations)
        self._exactly = exactly = ActiveSetMethod(qp)
        if not exactly.is_ready:
            return QPSolution.nothing(qp, self.name)
        self._last = self._solve(exactly, tolerance, warm)
        return self._last

    def solve_again(self, u: Array, b: Array) -> QPSolution:
        """Solution of the last program with other right-hand sides, from the last active rows."""
        if self._instead is not None:
            return self._instead.solve_again(u, b)
        exactly, last = self._exactly, self._last
        assert exactly is not None
        qp = replace(exactly.qp, u=u, b=b)
        if last is None or not (qp.is_finite() and last.is_finite()):
            return QPSolution.nothing(qp, self.name)
        exact = exactly.solve_with(u, b, last.x, last.z > 0.0, most_pivots=PIVOTS)
        if exact is None:
            return _proxqp(qp, last, EPS_ALONE, np.arange(len(u)))
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
        found = _proxqp(qp, warm, EPS_ACTIVE, _nearest(qp))
        if not found.is_finite():
            return found
        active = found.z > np.maximum(qp.u - qp.C @ found.x, 0.0)
        pivots = PIVOTS if found.solved else PIVOTS_WARM
        exact = exactly.solve(found.x, active, most_pivots=pivots)
        if exact is not None:
            return replace(exact, iterations=found.iterations + exact.iterations, backend=self.name)
        if exactly.is_infeasible or not found.solved:
            return replace(found, solved=False)
        return _proxqp(qp, found, EPS_ALONE, np.arange(len(qp.u)))


def _nearest(qp: QP) -> Indices:
    """The inequalities that ProxQP is asked about: of many, those nearest to their bounds."""
    most = NEAREST * qp.size + NEAREST_MORE
    return np.sort(np.argsort(qp.u, kind="stable")[:most])


def _proxqp(qp: QP, warm: QPSolution | None, eps: float, rows: Indices) -> QPSolution:
    """ProxQP's solution of a program with some of its inequalities, to a tolerance.

    Args:
        qp: The program.
        warm: A guess, or None.
        eps: Tolerance.
        rows: Inequalities that take part; the others get no multipliers.
    """
    C, u = (qp.C, qp.u) if len(rows) == len(qp.u) else (qp.C[rows], qp.u[rows])
    shape = qp.size, len(qp.b), len(u)
    if qp.size <= SMALL and len(u) <= FEW:
        dense = proxsuite.proxqp.dense
        kind, backend = dense.HessianType.Dense, dense.DenseBackend.PrimalDualLDLT
        solver = dense.QP(*shape, False, kind, backend)
        H, A, C = replace(qp, C=C).dense()
    else:
        solver = proxsuite.proxqp.sparse.QP(*shape)
        solver.settings.sparse_backend = proxsuite.proxqp.SparseBackend.SparseCholesky
        H, A, C = sp.csc_matrix(qp.H + sp.triu(qp.H, 1).T), qp.A, sp.csc_matrix(C)
    _set(solver.settings, eps, warm is not None)
    equalities = (A, qp.b) if len(qp.b) else (None, None)
    solver.init(H, qp.g, *equalities, C, np.full(len(u), -NO_BOUND), np.minimum(u, NO_BOUND), False)
    if warm is None:
        solver.solve()
    else:
        solver.solve(warm.x, warm.y, warm.z[rows])
    results = solver.results
    z = np.zeros(len(qp.u))
    z[rows] = np.maximum(np.array(results.z), 0.0)
    solved = results.info.status == proxsuite.proxqp.QPSolverOutput.PROXQP_SOLVED
    x, y = np.array(results.x), np.array(results.y)
    return QPSolution(x, y, z, solved, int(results.info.iter), ProxQP.name)


def _set(settings: Any, eps: float, is_warm: bool) -> None:
    guess = proxsuite.proxqp.InitialGuess
    settings.initial_guess = guess.WARM_START if is_warm else guess.NO_INITIAL_GUESS
    settings.eps_abs, settings.eps_rel = eps, 0.0
    settings.eps_primal_inf = settings.eps_dual_inf = EPS_INFEASIBILITY
    settings.check_duality_gap = True  # without, z.(Cx - u) = 1e-4 counted as solved
    settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = GAP * eps, 0.0
    settings.max_iter, settings.max_iter_in = MAX_ITER, MAX_ITER_IN
