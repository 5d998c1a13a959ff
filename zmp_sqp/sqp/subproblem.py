"""The QP of one iteration: condensed and screened, or sparse and whole; relaxed where it has no solution."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.sqp.backends import QPBackend
from zmp_sqp.sqp.nlp import Linearization
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["Step", "Subproblem"]

Mask = npt.NDArray[np.bool_]
Multipliers = tuple[Array, Array]

PRIMAL_TOLERANCE = 1e-7  # of a QP solution that is believed, scaled units
DUAL_TOLERANCE = 1e-5  # likewise
SCREEN = 0.05  # rows closer to their bound than this are in the first working set
ADDED = 1e-9  # rows that a screened solution violates by more join the working set
DEPENDENT = 1e-13  # of the Gram matrix's diagonal, relative, added to it against dependent rows
MAX_ROUNDS = 12  # of adding violated rows
MOST_ROWS = 900  # for the first backend: ProxQP slows down, and at some thousands of rows aborts the process


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """Solution of one subproblem in the program's own variables.

    Attributes:
        dx: Step, shape (n,).
        y: Multipliers of the equalities that are not eliminated.
        z: Multipliers of the inequalities, shape (m,), not negative.
        relaxation: Slack t that the nonlinear rows were given; 0 for an ordinary QP.
        solved: Whether residuals computed here confirm the solution.
        backend: Who solved it.
        inner_iterations: Sum over all rounds and backends.
        rows: Rows in the last working set.
    """

    dx: Array
    y: Array
    z: Array
    relaxation: float
    solved: bool
    backend: str
    inner_iterations: int
    rows: int


class Subproblem:
    r"""QP about one iterate.

    .. math:: \min_{dx} \tfrac12 dx^T H dx + g^T dx \; [+ \rho t] \quad \text{s.t.} \quad c_E + A\,dx = 0, \;
              c_I + C\,dx \le 0 \; [+ t \text{ on nonlinear rows}], \; [t \ge 0]

    Condensed: dx = d + Z dy with the linearisation's basis, and only rows near their bounds take part; rows that the
    solution violates join until there are none, so that the answer is that of the full QP.
    """

    def __init__(self, lin: Linearization, nonlinear: Mask, backend: QPBackend, fallback: QPBackend | None) -> None:
        """Condense the linearisation if the backend wants that and there is a basis."""
        self.lin, self.nonlinear = lin, nonlinear
        self._backends = [backend] if fallback is None else [backend, fallback]
        self._sparse = backend.wants_sparse and lin.basis is not None
        basis = lin.basis
        if basis is None or self._sparse:
            self._Z, self._d, skip = None, np.zeros(lin.A.shape[1]), 0
        else:
            self._Z, self._d, skip = basis.Z, basis.d, basis.eliminated
        self._kept_equalities = 0 if basis is None else basis.eliminated
        self._A = lin.A[skip:] if skip else lin.A
        self._b = -(lin.at.equalities + lin.A @ self._d)[skip:]
        self._u = -(lin.at.inequalities + lin.C @ self._d)
        if not self._sparse:
            self._A = self._reduce(self._A)
        self._slots = np.full(len(self._u), -1)  # where a row's condensed form stands in the stack
        self._stack = np.zeros((0, self._A.shape[1]))

    @property
    def is_sparse(self) -> bool:
        """Whether the whole sparse QP is solved."""
        return self._sparse

    def condensed_hessian(self, H: Any) -> Array:
        """Z' H Z for a sparse H, touching only its non-empty rows."""
        if self._Z is None:
            return np.asarray(H.toarray())
        basis = self.lin.basis
        filled = np.flatnonzero(np.diff(H.indptr))
        if basis is not None and np.isin(filled, basis.free).all():  # Z is the identity there
            return np.asarray(H[basis.free][:, basis.free].toarray())
        part = self._Z[filled]
        return np.asarray(part.T @ (H[filled][:, filled] @ part))

    def active_rows(self, z: Array) -> Array:
        """Condensed Jacobian of the equalities and of the inequalities with a multiplier."""
        return np.vstack([self._A, self._rows(np.flatnonzero(z > 0.0))])

    def solve(self, H: Any, gradient: Array, *, previous: Multipliers, relaxation_weight: float | None = None) -> Step:
        """Step with its multipliers.

        Args:
            H: Positive semi-definite Hessian: condensed and dense, or sparse if `is_sparse`.
            gradient: g, shape (n,).
            previous: Multipliers (y, z) of the last QP: the rows that they hold start in the working set.
            relaxation_weight: rho; None solves the QP as it is.
        """
        d = self._d
        g = gradient + H @ d if self._sparse else gradient if self._Z is None else self._Z.T @ gradient
        elastic = relaxation_weight is not None
        working = (self._u < SCREEN) | (previous[1] > 0.0) | self._bounds_objective()
        if self._sparse:
            working[:] = True
        inner, warm = 0, None
        if not (elastic or self._sparse) and previous[1].any():
            warm = QPSolution(np.zeros(len(g)), previous[0], previous[1][working], True, 0, "")
        for _ in range(MAX_ROUNDS):
            index = np.flatnonzero(working)
            C = self.lin.C if self._sparse else self._rows(index)
            qp = _relaxed(
                QP(H, g, self._A, self._b, C, np.full(len(index), -np.inf), self._u[index]),
                self.nonlinear[index],
                relaxation_weight,
            )
            solution, solved, count = self._attempt(qp, warm)
            inner += count
            t = float(solution.x[-1]) if elastic else 0.0
            move = solution.x[: len(g)]
            dx = d + (move if self._Z is None else self._Z @ move)
            if not solved:
                break
            added = ~working & (self.lin.C @ dx + self.lin.at.inequalities - t * self.nonlinear > ADDED)
            if not added.any():
                break
            working |= added
            warm = _extended(solution, index, np.flatnonzero(working))
        z = np.zeros(len(self._u))
        z[index] = np.maximum(solution.z[: len(index)], 0.0)
        z[z < 1e-10 * max(1.0, float(z.max(initial=0.0)))] = 0.0  # an interior point leaves dust on inactive rows
        y = solution.y[self._kept_equalities :] if self._sparse else solution.y
        return Step(dx, y, z, max(t, 0.0), solved, solution.backend, inner, len(index))

    def shortest_step(self, active: Mask) -> Array | None:
        """Least step, in free variables, onto the linearised equalities and these inequalities; None if sparse.

        Dependent rows are met in the least-squares sense.
        """
        if self._sparse:
            return None
        index = np.flatnonzero(active)
        rows = np.vstack([self._A, self._rows(index)])
        gram = rows @ rows.T
        gram[np.diag_indices_from(gram)] += DEPENDENT * gram.diagonal().max()
        try:
            move = rows.T @ np.linalg.solve(gram, np.concatenate([self._b, self._u[index]]))
        except np.linalg.LinAlgError:
            return None
        return self._d + (move if self._Z is None else self._Z @ move)

    def _bounds_objective(self) -> Mask:
        """Rows that bound one variable which the objective depends on: without them a screened QP may have no end."""
        C = self.lin.C
        bounds = np.diff(C.indptr) == 1
        bounds[bounds] = self.lin.gradient[C.indices[C.indptr[:-1][bounds]]] != 0.0
        return np.asarray(bounds)

    def _attempt(self, qp: QP, warm: QPSolution | None) -> tuple[QPSolution, bool, int]:
        count = 0
        crowded = len(qp.u) > MOST_ROWS and not qp.is_sparse
        for backend in self._backends[1:] if crowded and len(self._backends) > 1 else self._backends:
            solution = backend.solve(qp, warm=warm)
            count += solution.iterations
            primal, dual = solution.residuals(qp)
            scale = max(1.0, float(np.abs(qp.g).max(initial=0.0)))
            if primal <= PRIMAL_TOLERANCE and dual <= DUAL_TOLERANCE * scale:
                return solution, True, count
        return solution, False, count

    def _reduce(self, rows: Any) -> Array:
        return np.asarray(rows.toarray() if self._Z is None else rows @ self._Z)

    def _rows(self, index: Indices) -> Array:
        """Condensed rows of the inequalities, each computed once."""
        missing = index[self._slots[index] < 0]
        if len(missing):
            self._slots[missing] = len(self._stack) + np.arange(len(missing))
            self._stack = np.vstack([self._stack, self._reduce(self.lin.C[missing])])
        return self._stack[self._slots[index]]


def _extended(solution: QPSolution, rows: Indices, more: Indices) -> QPSolution:
    """The solution as a guess for the QP with more rows, whose multipliers start at zero."""
    z = np.zeros(len(more) + len(solution.z) - len(rows))  # the relaxation's own row, if any, is the last
    z[np.searchsorted(more, rows)] = solution.z[: len(rows)]
    z[len(more) :] = solution.z[len(rows) :]
    return replace(solution, z=z)


def _relaxed(qp: QP, nonlinear: Mask, weight: float | None) -> QP:
    """The QP with one more variable t >= 0 that relaxes the nonlinear rows at the price of `weight` each."""
    if weight is None:
        return qp
    n, p = qp.size, len(qp.b)
    column = -nonlinear.astype(float)[:, None]
    last = np.zeros((1, n + 1))
    last[0, -1] = -1.0
    if qp.is_sparse:
        H = sp.block_diag([qp.H, sp.csr_matrix([[1e-8]])], format="csc")
        A = sp.hstack([qp.A, sp.csr_matrix((p, 1))], format="csc")
        C = sp.vstack([sp.hstack([qp.C, sp.csr_matrix(column)]), sp.csr_matrix(last)], format="csc")
    else:
        H = np.zeros((n + 1, n + 1))
        H[:n, :n], H[n, n] = qp.H, 1e-8
        A, C = np.hstack([qp.A, np.zeros((p, 1))]), np.vstack([np.hstack([qp.C, column]), last])
    return QP(H, np.append(qp.g, weight), A, qp.b, C, np.append(qp.l, -np.inf), np.append(qp.u, 0.0))
