"""Feasibility restored without a QP, where nothing is left to optimise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.nlp import Linearization, NonlinearProgram

__all__ = ["restored"]

RESTORATIONS = 4  # Newton steps onto the active rows before a QP is asked again
CONTRACTION = 0.3  # of the violation per step: with less it is not the basin of quadratic convergence
DEPENDENT = 1e-13  # of the Gram matrix's diagonal, relative, added to it against dependent rows


def restored(
    nlp: NonlinearProgram, x: Array, lin: Linearization, z: Array, *, feasibility: float, optimality: float
) -> tuple[Array, Linearization] | None:
    """Feasible point at the bound by Newton steps onto the active rows, the shortest ones; None if that fails.

    Args:
        nlp: The program; its objective stands at its proven bound.
        x: Point that violates constraints, shape (n,).
        lin: The program's linearisation there.
        z: Multipliers of the last QP: which inequalities were active.
        feasibility: Largest violation of the answer.
        optimality: Largest relative distance of its objective from the bound.
    """
    active = z > 0.0
    for _ in range(RESTORATIONS):
        dx = _shortest_step(lin, active | (lin.at.inequalities > 0.0))
        if dx is None or float((lin.at.inequalities + lin.C @ dx).max(initial=0.0)) > feasibility:
            return None  # these rows are not those that will be active
        before, x = lin.at.violation, x + dx
        at = nlp.evaluate(x)
        if not at.is_finite() or nlp.optimality_gap(x) > optimality:
            return None
        if at.violation <= feasibility:
            return x, replace(lin, at=at)  # the run ends here: nobody needs its derivatives
        if at.violation > CONTRACTION * before:
            return None
        lin = nlp.linearize(x)
    return None


def _shortest_step(lin: Linearization, active: npt.NDArray[np.bool_]) -> Array | None:
    """Least step, in free variables, onto the linearised equalities and these inequalities; None if there is none.

    Dependent rows are met in the least-squares sense.
    """
    basis = lin.basis
    skip = 0 if basis is None else basis.eliminated
    rows = sp.vstack([lin.A[skip:], lin.C[active]], format="csr")
    values = np.concatenate([lin.at.equalities[skip:], lin.at.inequalities[active]])
    if basis is not None:
        values = values + rows @ basis.d
    condensed = rows.toarray() if basis is None else rows @ basis.Z
    gram = condensed @ condensed.T
    gram[np.diag_indices_from(gram)] += DEPENDENT * gram.diagonal().max(initial=0.0)
    try:
        move = condensed.T @ np.linalg.solve(gram, -values)
    except np.linalg.LinAlgError:
        return None
    return np.asarray(move if basis is None else basis.d + basis.Z @ move)
