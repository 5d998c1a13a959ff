"""ProxQP (ProxSuite) as a QP backend, with an active-set method that makes it exact."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import proxsuite
import scipy.sparse as sp

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.sqp.backends.active_set import ActiveSetMethod
from zmp_sqp.sqp.backends.piqp import PIQP
from zmp_sqp.sqp.qp import NOTHING_YET, QP, QPSolution

__all__ = ["ProxQP"]

# numbers of variables and of inequalities up to which dense ProxQP is faster; its memory grows with
# the square of their sum
SMALL, FEW = 60, 700
# ProxQP gets at most this many inequalities per variable plus this many more: those nearest to
# their bounds
NEAREST, NEAREST_MORE = 3, 500
EPS_ACTIVE = 1e-4  # tolerance that is enough to identify the active rows
EPS_ALONE = 1e-8  # tolerance where the active-set method fails
GAP_PER_EPS = 100.0  # tolerance of the duality gap per tolerance of the residuals
# with the default 1e-4, feasible QPs of the planner are called infeasible after 2 iterations
EPS_INFEASIBILITY = 1e-12
MAX_ITER = 40  # outer iterations
MAX_ITER_IN = 60  # inner iterations; without a limit, one QP ran for 290 s
NO_BOUND = 1e20  # infinity of ProxQP
PIVOTS_WARM = 300  # of the active-set method, from the active rows of a warm start
PIVOTS = 2000  # of the active-set method, from the active rows that ProxQP has found
# most variables: of 2000, one call of the active-set method may take two minutes, in which no time
# budget can stop it; PIQP solves larger QPs
LARGEST = 1200


class ProxQP:
    """ProxQP, the proximal augmented Lagrangian method of Bambade et al. 2022, made exact.

    ProxQP identifies the active rows at a low accuracy; from them DAQP's active-set method computes
    an exact solution that is reproducible bit by bit (`ActiveSetMethod`). With a warm start, whose
    multipliers tell the active rows, the active-set method is tried first. Where it fails, ProxQP
    solves the QP to a higher accuracy.

    Tolerances and limits of iterations differ from ProxQP's defaults. Its preconditioner is off,
    because QPs are scaled already.

    QPs of more than 1200 variables (120 intervals of five joints) are left to PIQP.
    """

    name = "proxqp"
    needs_convex = True

    def __init__(self) -> None:
        """Create the backend, with no QP yet."""
        self._active_set: ActiveSetMethod | None = None
        self._last: QPSolution | None = None
        self._instead: PIQP | None = None

    def solve(
        self, qp: QP, *, tolerance: float, iterations: int, warm: QPSolution | None = None
    ) -> QPSolution:
        """Solution of a QP, exact where the active-set method succeeds.

        Args:
            qp, tolerance, iterations, warm: Arguments of `QPBackend.solve`.
        """
        self._last = self._instead = None
        if qp.size == 0 or qp.size > LARGEST:
            self._instead = PIQP()
            return self._instead.solve(qp, tolerance=tolerance, iterations=iterations)
        self._active_set = active_set = ActiveSetMethod(qp)
        if not active_set.is_ready:
            return QPSolution.nothing(qp, self.name)
        self._last = self._solve(active_set, tolerance, warm)
        return self._last

    def solve_again(self, u: Array, b: Array) -> QPSolution:
        """Solution of the last QP with other right-hand sides, from its active rows."""
        if self._instead is not None:
            return self._instead.solve_again(u, b)
        active_set, last = self._active_set, self._last
        if active_set is None:
            raise RuntimeError(NOTHING_YET.format(name=self.name))
        qp = replace(active_set.qp, u=u, b=b)
        if last is None or not (qp.is_finite() and last.is_finite()):
            return QPSolution.nothing(qp, self.name)
        exact = active_set.solve_with(u, b, last.x, last.z > 0.0, most_pivots=PIVOTS)
        if exact is None:
            return _proxqp(qp, last, EPS_ALONE, np.arange(len(u)))
        return replace(exact, backend=self.name)

    def _solve(
        self, active_set: ActiveSetMethod, tolerance: float, warm: QPSolution | None
    ) -> QPSolution:
        qp = active_set.qp
        if warm is not None and warm.z.any():
            near = active_set.solve(warm.x, warm.z > 0.0, most_pivots=PIVOTS_WARM)
            if near is not None:
                return near
            if active_set.is_infeasible:  # ProxQP would reach both limits of iterations
                return QPSolution.nothing(qp, self.name)
        found = _proxqp(qp, warm, EPS_ACTIVE, _nearest(qp))
        if not found.is_finite():
            return found
        active = found.z > np.maximum(qp.u - qp.C @ found.x, 0.0)
        pivots = PIVOTS if found.solved else PIVOTS_WARM
        exact = active_set.solve(found.x, active, most_pivots=pivots)
        if exact is not None:
            return replace(exact, iterations=found.iterations + exact.iterations, backend=self.name)
        if active_set.is_infeasible or not found.solved:
            return replace(found, solved=False)
        return _proxqp(qp, found, EPS_ALONE, np.arange(len(qp.u)))


def _nearest(qp: QP) -> Indices:
    """Indices of the inequalities that ProxQP gets: those nearest to their bounds at x = 0."""
    most = NEAREST * qp.size + NEAREST_MORE
    return np.sort(np.argsort(qp.u, kind="stable")[:most])


def _proxqp(qp: QP, warm: QPSolution | None, eps: float, rows: Indices) -> QPSolution:
    """Solution of a QP with some of its inequalities by ProxQP.

    Args:
        qp: Quadratic program.
        warm: Warm start, or None.
        eps: Tolerance of the residuals.
        rows: Indices of the inequalities in the QP; the multipliers of others are zero.
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
    settings.check_duality_gap = True  # without it, z.(Cx - u) = 1e-4 counted as solved
    settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = GAP_PER_EPS * eps, 0.0
    settings.max_iter, settings.max_iter_in = MAX_ITER, MAX_ITER_IN
