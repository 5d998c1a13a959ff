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

__all__ = ["Model", "Step", "Subproblem"]

Mask = npt.NDArray[np.bool_]
Multipliers = tuple[Array, Array]

PRIMAL_TOLERANCE = 1e-7  # of a QP solution that is believed, scaled units
DUAL_TOLERANCE = 1e-5  # likewise
SCREEN = 0.05  # rows closer to their bound than this are in the first working set
# of the current violation: nonlinear rows that a step misses by less wait for the next
# linearisation
MISSED = 0.1
MISSED_RESTORING = 0.2  # likewise any row, where nothing is left to optimise
ADDED = 1e-9  # rows that a screened solution violates by more join the working set
MAX_ROUNDS = 12  # of adding violated rows
# rows from which on the fallback is faster, docs/notes.md; ProxQP aborts the process at some
# thousands
LARGE = 300
LARGE_SHARE = 1.2  # likewise, per free variable: the larger of both counts


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """Convex quadratic model of the Lagrangian, with its Hessian in the forms that there are.

    Attributes:
        gradient: g, shape (n,).
        condensed_gradient: Z'(g + Hd), shape (r,); without a basis g itself.
        condensed: Z'HZ, dense, positive definite; None where only the sparse QP is to be solved.
        whole: H, CSR, positive semi-definite, shape (n, n); None where convexifying has filled it.
    """

    gradient: Array
    condensed_gradient: Array
    condensed: Array | None
    whole: Any | None


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

    .. math:: \min_{dx} \tfrac12 dx^T H dx + g^T dx \; [+ \rho t] \quad \text{s.t.} \quad c_E +
              A\,dx = 0, \; c_I + C\,dx \le 0 \; [+ t \text{ on nonlinear rows}], \; [t \ge 0]

    Condensed and screened: dx = d + Z dy with the linearisation's basis, and only rows near their
        bounds take part;
    rows that the solution violates join until there are none, but for nonlinear rows that it misses
    by little against the violation now (any rows, where nothing is left to optimise); so that near
    a solution the answer is that of the full QP. A condensed QP that the first backend does not
    finish, or whose working set outgrows it, goes to the fallback: whole and sparse, all rows at
    once, where the Hessian allows that; condensed otherwise.
    """

    def __init__(
        self,
        lin: Linearization,
        nonlinear: Mask,
        backend: QPBackend,
        fallback: QPBackend | None,
        *,
        restoring: bool = False,
    ) -> None:
        """Condense the linearisation if it has a basis; `restoring`: nothing is left to optimise."""
        self.lin, self.nonlinear = lin, nonlinear
        share = (
            np.where(nonlinear, MISSED, 0.0)
            if not restoring
            else np.full(len(nonlinear), MISSED_RESTORING)
        )
        self._missed = np.maximum(share * lin.at.violation, ADDED)
        self._backends = [backend] if fallback is None else [backend, fallback]
        self._for_whole = [b for b in self._backends if b.wants_sparse] if _spans_all(lin) else []
        self._handed_over = False
        basis = lin.basis
        skip = 0 if basis is None else basis.eliminated
        self._kept_equalities = skip
        equalities, inequalities = lin.at.equalities, lin.at.inequalities
        if basis is not None and basis.d.any():
            equalities, inequalities = equalities + lin.A @ basis.d, inequalities + lin.C @ basis.d
        self._b, self._u = -equalities[skip:], -inequalities
        self._A = self._reduce(lin.A[skip:])
        self._working = (self._u < SCREEN) | _bounds_objective(lin)
        self._slots = np.full(len(self._u), -1)  # where a row's condensed form stands in the stack
        self._stack = np.zeros((0, self._A.shape[1]))

    @property
    def prefers_whole(self) -> bool:
        """Whether the first backend is better served with the sparse QP."""
        return bool(self._for_whole) and self._for_whole[0] is self._backends[0]

    @property
    def equality_gradients(self) -> Array:
        """Condensed Jacobian of the equalities that are not eliminated, shape (p, r)."""
        return self._A

    @property
    def size(self) -> int:
        """Number r of variables of the condensed QP."""
        return int(self._A.shape[1])

    def condensed_model(self, H: Any, gradient: Array) -> tuple[Array, Array]:
        """Z'HZ and Z'(g + Hd) for a sparse H, touching only its non-empty rows."""
        basis = self.lin.basis
        if basis is None:
            return np.asarray(H.toarray()), gradient
        if basis.d.any():
            gradient = gradient + H @ basis.d
        filled = np.flatnonzero(np.diff(H.indptr))
        if np.isin(filled, basis.free).all():  # Z is the identity there
            condensed = H[basis.free][:, basis.free].toarray()
        else:
            part = basis.Z[filled]
            condensed = part.T @ (H[filled][:, filled] @ part)
        return np.asarray(condensed), np.asarray(basis.Z.T @ gradient)

    def active_rows(self, z: Array) -> Array:
        """Condensed Jacobian of the equalities and of the inequalities with a multiplier."""
        return np.vstack([self._A, self._rows(np.flatnonzero(z > 0.0))])

    def solve(
        self, model: Model, *, previous: Multipliers, relaxation_weight: float | None = None
    ) -> Step:
        """Step with its multipliers.

        Args:
            model: What to minimise.
            previous: Multipliers (y, z) of the last QP: the rows that they hold start in the
                working set.
            relaxation_weight: rho; None solves the QP as it is.
        """
        hands_over = model.whole is not None and bool(self._for_whole)
        if model.condensed is None or (hands_over and (self._handed_over or self._is_large())):
            return self._solve_whole(model, relaxation_weight)
        step = self._solve_screened(model, previous, relaxation_weight)
        if step.solved or not hands_over:
            return step
        self._handed_over = True
        whole = self._solve_whole(model, relaxation_weight)
        return replace(whole, inner_iterations=step.inner_iterations + whole.inner_iterations)

    def _solve_whole(self, model: Model, relaxation_weight: float | None) -> Step:
        """All rows at once, sparse."""
        at, lin = self.lin.at, self.lin
        free = np.full(len(self._u), -np.inf)
        qp = QP(model.whole, model.gradient, lin.A, -at.equalities, lin.C, free, -at.inequalities)
        solution, solved, inner = _attempt(
            _relaxed(qp, self.nonlinear, relaxation_weight), None, self._for_whole[:1]
        )
        index = np.arange(len(self._u))
        solution = replace(solution, y=solution.y[self._kept_equalities :])
        return _step(solution, solution.x[: qp.size], index, len(self._u), inner, solved=solved)

    def _solve_screened(
        self, model: Model, previous: Multipliers, relaxation_weight: float | None
    ) -> Step:
        """Condensed, in rounds of growing working sets."""
        basis, elastic = self.lin.basis, relaxation_weight is not None
        hands_over = model.whole is not None and bool(self._for_whole)
        working = self._working = self._working | (previous[1] > 0.0)
        g, inner, warm = model.condensed_gradient, 0, None
        if not elastic and previous[1].any():
            warm = QPSolution(np.zeros(len(g)), previous[0], previous[1][working], True, 0, "")
        for _ in range(MAX_ROUNDS):
            index = np.flatnonzero(working)
            free = np.full(len(index), -np.inf)
            qp = QP(model.condensed, g, self._A, self._b, self._rows(index), free, self._u[index])
            qp = _relaxed(qp, self.nonlinear[index], relaxation_weight)
            backends = self._backends[:1] if hands_over else self._backends
            if self._is_large():
                backends = backends[-1:]
            solution, solved, count = _attempt(qp, warm, backends)
            inner += count
            t = float(solution.x[-1]) if elastic else 0.0
            move = solution.x[: len(g)]
            dx = move if basis is None else basis.d + basis.Z @ move
            if not solved:
                break
            over = np.where(
                working, 0.0, self.lin.C @ dx + self.lin.at.inequalities - t * self.nonlinear
            )
            added = over > ADDED
            if not (over > self._missed).any():
                break
            working = self._working = working | added
            if hands_over and self._is_large():
                solved = False
                break
            warm = _extended(solution, index, np.flatnonzero(working))
        else:
            solved = False
        return _step(solution, dx, index, len(self._u), inner, solved=solved)

    def _is_large(self) -> bool:
        return int(self._working.sum()) > max(LARGE, LARGE_SHARE * self.size)

    def _reduce(self, rows: Any) -> Array:
        return np.asarray(rows.toarray() if self.lin.basis is None else rows @ self.lin.basis.Z)

    def _rows(self, index: Indices) -> Array:
        """Condensed rows of the inequalities, each computed once."""
        missing = index[self._slots[index] < 0]
        if len(missing):
            self._slots[missing] = len(self._stack) + np.arange(len(missing))
            self._stack = np.vstack([self._stack, self._reduce(self.lin.C[missing])])
        return np.asarray(self._stack[self._slots[index]])


def _bounds_objective(lin: Linearization) -> Mask:
    """Rows that bound one variable which the objective depends on: without them a screened QP may have no end."""
    bounds = np.diff(lin.C.indptr) == 1
    bounds[bounds] = lin.gradient[lin.C.indices[lin.C.indptr[:-1][bounds]]] != 0.0
    return np.asarray(bounds)


def _spans_all(lin: Linearization) -> bool:
    """Whether the basis has all directions that its equalities leave, so that whole and condensed QP are the same."""
    basis = lin.basis
    return basis is not None and basis.Z.shape[1] + basis.eliminated == basis.Z.shape[0]


def _attempt(
    qp: QP, warm: QPSolution | None, backends: list[QPBackend]
) -> tuple[QPSolution, bool, int]:
    """First solution that its residuals confirm, else the last one; inner iterations of all."""
    count = 0
    for backend in backends:
        solution = backend.solve(qp, warm=warm)
        count += solution.iterations
        primal, dual = solution.residuals(qp)
        scale = max(1.0, float(np.abs(qp.g).max(initial=0.0)))
        if primal <= PRIMAL_TOLERANCE and dual <= DUAL_TOLERANCE * scale:
            return solution, True, count
    return solution, False, count


def _step(
    solution: QPSolution, dx: Array, index: Indices, size: int, inner: int, *, solved: bool
) -> Step:
    z = np.zeros(size)
    z[index] = np.maximum(solution.z[: len(index)], 0.0)
    # an interior point leaves dust on inactive rows
    z[z < 1e-10 * max(1.0, float(z.max(initial=0.0)))] = 0.0
    t = float(solution.x[-1]) if len(solution.z) > len(index) else 0.0
    return Step(dx, solution.y, z, max(t, 0.0), solved, solution.backend, inner, len(index))


def _extended(solution: QPSolution, rows: Indices, more: Indices) -> QPSolution:
    """The solution as a guess for the QP with more rows, whose multipliers start at zero."""
    # the relaxation's own row, if any, is the last
    z = np.zeros(len(more) + len(solution.z) - len(rows))
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
    return QP(
        H, np.append(qp.g, weight), A, qp.b, C, np.append(qp.l, -np.inf), np.append(qp.u, 0.0)
    )
