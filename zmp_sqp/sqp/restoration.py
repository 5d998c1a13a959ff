"""Feasibility restored by least-distance programming, where nothing is left to optimise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import scipy.linalg
from scipy.optimize import nnls

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.nlp import Linearization, NonlinearProgram

__all__ = ["restored"]

Mask = npt.NDArray[np.bool_]

RESTORATIONS = 4  # steps before a QP is asked again
# of the violation per step: with less it is not the basin of quadratic convergence
CONTRACTION = 0.3
SCREEN = 0.05  # rows closer to their bound than this are in the first working set
ROUNDS = 3  # of adding rows that the step violates
# of the current violation: rows that a step misses by less wait for the next linearisation
MISSED = 0.1
MOST_ROWS = 600  # beyond, pivoting row by row is slower than a QP
DEAR = 1e5  # the price, in the distance, of moving a variable that the objective depends on
# least residual, relative, of constraints that some step meets, and least pivot of the equalities
SINGULAR = 1e-12


def restored(
    nlp: NonlinearProgram,
    x: Array,
    lin: Linearization,
    z: Array,
    *,
    feasibility: float,
    optimality: float,
) -> tuple[Array, Linearization] | None:
    """Feasible point at the bound by the shortest steps that meet the linearised constraints; None if that fails.

    Args:
        nlp: The program; its objective stands at its proven bound.
        x: Point that violates constraints, shape (n,).
        lin: The program's linearisation there.
        z: Multipliers of the last QP: what was active is looked at from the start.
        feasibility: Largest violation of the answer.
        optimality: Largest relative distance of its objective from the bound.
    """
    working = z > 0.0
    for _ in range(RESTORATIONS):
        working = working | (lin.at.inequalities > -SCREEN)
        dx, working = _shortest_step(lin, working, feasibility)
        if dx is None:
            return None
        before, x = lin.at.violation, x + dx
        # unlikely to be the last step
        ahead = nlp.linearize(x) if before**2 > feasibility else None
        at = nlp.evaluate(x) if ahead is None else ahead.at
        if not at.is_finite() or nlp.optimality_gap(x) > optimality:
            return None
        if at.violation <= feasibility:
            return x, replace(lin, at=at)  # the run ends here: nobody needs its derivatives
        if at.violation > CONTRACTION * before:
            return None
        lin = nlp.linearize(x) if ahead is None else ahead
    return None


def _shortest_step(
    lin: Linearization, working: Mask, feasibility: float
) -> tuple[Array | None, Mask]:
    r"""Least step, in free variables, that meets the linearised constraints, if there is one, and the rows looked at.

    .. math:: \min |W dx| \quad \text{s.t.} \quad c_E + A\,dx = 0, \; c_I + C\,dx \le 0

    The equalities are eliminated by QR; the dual of what remains is a nonnegative least-squares
    problem (Lawson and Hanson 1974, chapter 23), solved by pivoting.
    """
    at, basis = lin.at, lin.basis
    skip = 0 if basis is None else basis.eliminated
    d, Z = (
        (np.zeros(len(lin.gradient)), np.eye(len(lin.gradient)))
        if basis is None
        else (basis.d, basis.Z)
    )
    weights = np.where(Z.T @ lin.gradient != 0.0, DEAR, 1.0)
    kept = lin.A[skip:]
    b = -(at.equalities[skip:] + kept @ d)
    Q, R = np.linalg.qr((kept @ Z / weights).T)
    pivots = np.abs(np.diag(R))
    if len(pivots) and pivots.min() <= SINGULAR * pivots.max():
        return None, working
    first = Q @ scipy.linalg.solve_triangular(R, b, trans="T") if len(b) else np.zeros(len(weights))
    values = at.inequalities + lin.C @ d
    missed = max(feasibility, MISSED * at.violation)
    index, rows = np.zeros(0, dtype=int), np.zeros((0, len(weights)))
    for _ in range(ROUNDS):
        added = np.setdiff1d(np.flatnonzero(working), index)
        if len(index) + len(added) > MOST_ROWS:
            break
        index, rows = np.append(index, added), np.vstack([rows, lin.C[added] @ Z / weights])
        room = -values[index] - rows @ first
        dual = np.vstack([((rows @ Q) @ Q.T - rows).T, -room])
        target = np.append(np.zeros(len(weights)), 1.0)
        try:
            # SciPy aborts the process if there are no columns
            z = nnls(dual, target)[0] if len(index) else np.zeros(0)
        # it did not come to an end, or met derivatives that are not numbers
        except (RuntimeError, ValueError):
            break
        residual = dual @ z - target
        if not abs(residual[-1]) > SINGULAR:  # no step meets these rows
            break
        dx = d + Z @ ((first - residual[:-1] / residual[-1]) / weights)
        over = np.where(working, 0.0, at.inequalities + lin.C @ dx)
        if not over.max(initial=0.0) > missed:
            return dx, working
        working = working | (over > feasibility)
    return None, working
