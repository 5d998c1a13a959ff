"""PIQP, an interior-point backend: the fallback on condensed QPs and the choice for long horizons on sparse ones."""

from __future__ import annotations

import numpy as np
import piqp
import scipy.sparse as sp

from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["PIQP"]

EPS = 1e-9  # below the SQP's feasibility tolerance
MAX_ITER = 100  # interior-point iterations; solved QPs of ours need 8-30


class PIQP:
    """Proximal interior point method of Schwan et al. 2023; dense or sparse, as the QP is."""

    name = "piqp"
    wants_sparse = True

    def solve(self, qp: QP, *, warm: QPSolution | None = None) -> QPSolution:
        """Solution, from cold: an interior-point method gains nothing from the last one."""
        if not qp.is_finite():
            return QPSolution.nothing(qp, self.name)
        solver = piqp.SparseSolver() if qp.is_sparse else piqp.DenseSolver()
        settings = solver.settings
        settings.eps_abs = settings.eps_rel = EPS
        settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = EPS
        settings.max_iter = MAX_ITER
        if qp.is_sparse:
            H, A, C = (sp.csc_matrix(matrix) for matrix in (qp.H, qp.A, qp.C))
            H = sp.csc_matrix(sp.triu(H))
        else:
            H, A, C = qp.H, qp.A, qp.C
        solver.setup(H, qp.g, A, qp.b, C, qp.l, qp.u)
        status = solver.solve()
        result = solver.result
        z = np.array(result.z_u) - np.array(result.z_l)
        solved = status == piqp.PIQP_SOLVED
        return QPSolution(
            np.array(result.x), np.array(result.y), z, solved, int(result.info.iter), self.name
        )
