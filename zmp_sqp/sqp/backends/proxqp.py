"""ProxQP (ProxSuite), the default backend, on dense condensed QPs, finished by an active-set method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import proxsuite

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.backends.active_set import ActiveSetMethod
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["ProxQP"]

EPS_ACTIVE = 1e-5  # enough to tell which rows are active
EPS_ABS = 1e-9  # below the SQP's feasibility tolerance, where that is the answer
GAP = 100.0  # sum of complementarity products, per eps
# the default 1e-4 calls feasible QPs of ours infeasible after 2 iterations
EPS_INFEASIBILITY = 1e-12
MAX_ITER = 40  # outer iterations; of 589 QPs in hard problems none was solved after the 30th
MAX_ITER_IN = 60  # inner iterations; uncapped, one QP ran for 290 s
NO_BOUND = 1e20  # what ProxQP takes for infinity
PIVOTS_WARM = 300  # from the active rows of the last QP, before ProxQP is asked
PIVOTS = 2000  # from those that ProxQP has found


class ProxQP:
    """Dense ProxQP, traps disarmed: own tolerances, both iteration caps, no preconditioner: we scale ourselves.

    The last digits of ProxQP's sums depend on where its memory lies. So it is asked which rows are
    active, and an active-set method takes it from there: it is exact, and the same program gets the
    same bits every time. Where the active rows of the last QP are a guess, that method is tried
    first. A Hessian that is not positive definite leaves it to ProxQP alone.
    """

    name = "proxqp"
    wants_sparse = False

    def solve(self, qp: QP, *, warm: QPSolution | None = None) -> QPSolution:
        """Solution by the proximal augmented Lagrangian method of Bambade et al. 2022, finished exactly."""
        if not qp.is_finite():
            return QPSolution.nothing(qp, self.name)
        H, A, C = (_dense(matrix) for matrix in (qp.H, qp.A, qp.C))
        exactly = ActiveSetMethod(replace(qp, H=H, A=A, C=C))
        if warm is not None and warm.z.any():
            near = exactly.solve(warm, most_pivots=PIVOTS_WARM)
            if near is not None:
                return near
            if exactly.is_infeasible:  # ProxQP would run into both its caps
                return QPSolution.nothing(qp, self.name)
        dense = proxsuite.proxqp.dense
        diagonal = np.count_nonzero(H) == np.count_nonzero(H.diagonal())
        kind = dense.HessianType.Diagonal if diagonal else dense.HessianType.Dense
        solver = dense.QP(
            qp.size, len(qp.b), len(qp.u), False, kind, dense.DenseBackend.PrimalDualLDLT
        )
        settings = solver.settings
        eps = EPS_ACTIVE if exactly.is_ready else EPS_ABS
        settings.eps_abs, settings.eps_rel = eps, 0.0
        settings.eps_primal_inf = settings.eps_dual_inf = EPS_INFEASIBILITY
        settings.check_duality_gap = True  # without, z.(Cx - u) = 1e-4 counted as solved
        settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = GAP * eps, 0.0
        settings.max_iter, settings.max_iter_in = MAX_ITER, MAX_ITER_IN
        lower, upper = np.maximum(qp.l, -NO_BOUND), np.minimum(qp.u, NO_BOUND)
        solver.init(H, qp.g, A, qp.b, C, lower, upper, False)
        if warm is None:
            settings.initial_guess = proxsuite.proxqp.InitialGuess.NO_INITIAL_GUESS
            solver.solve()
        else:
            settings.initial_guess = proxsuite.proxqp.InitialGuess.WARM_START
            solver.solve(warm.x, warm.y, warm.z)
        results = solver.results
        x, y, z = (np.array(part) for part in (results.x, results.y, results.z))
        solved = (
            results.info.status == proxsuite.proxqp.QPSolverOutput.PROXQP_SOLVED
            and not exactly.is_ready
        )
        found = QPSolution(x, y, z, solved, int(results.info.iter), self.name)
        exact = exactly.solve(found, most_pivots=PIVOTS)
        if exact is None:
            return found
        return replace(exact, iterations=found.iterations + exact.iterations, backend=self.name)


def _dense(matrix: Array) -> Array:
    return np.ascontiguousarray(matrix if isinstance(matrix, np.ndarray) else matrix.toarray())
