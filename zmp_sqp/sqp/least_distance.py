"""Feasible point at a given objective, by least-distance steps onto linearised constraints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array
from zmp_sqp.cached import cached_property
from zmp_sqp.sqp.backends import QPBackend
from zmp_sqp.sqp.iterate import is_feasible
from zmp_sqp.sqp.nlp import Evaluation, Linearization, NonlinearProgram
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["Nearest", "nearest_feasible"]

Mask = npt.NDArray[np.bool_]

STEPS = 6  # QPs after which the search gives up
# iterations of an interior-point method at most: infeasible QPs do not converge. Near feasibility
# the QP has a solution, but hardly an interior where the objective leaves just one point
INNER, INNER_NEAR = 20, 60
ROUNDS = 3  # QPs per step at most, each with the rows added that the last solution violates
NEAR = 0.05  # distance from the bound below which rows are in the QP
REACH = 0.5  # in the first QP that distance is larger by this share of the violation
MISSED = 0.1  # predicted violation of a row, relative to the current one, that needs another QP
# largest ratio of the violations after and before the first step, and any later step: with less
# contraction no feasible point is near
FIRST_CONTRACTION, CONTRACTION = 0.6, 0.35
SMALL = 3e-2  # violation after the first step up to which its contraction does not matter
# violation up to which a step keeps the last QP's matrices (simplified Newton method)
SIMPLIFIED_BELOW = 2e-3
AGAIN = 0.2  # contraction by such a step that makes another one worth while
LIKELY_ABOVE = 0.2  # violation above which another step mostly follows the next one
EXCESS_BELOW = 1e-3  # violation of nonlinear rows below which their excess is added
EXCESS_FACTOR, EXCESS_GUARD = 1.05, 2e-6  # the excess is added times this factor plus this guard
# tolerance of QPs: a share of the violation, within bounds
QP_SHARE, LEAST_TOLERANCE, LARGEST_TOLERANCE = 1e-3, 1e-8, 1e-3
EQUALITY = 2e-7  # largest violation of an equality at a feasible point


class MetricProgram(NonlinearProgram, Protocol):
    """Nonlinear program with a metric for the length of steps."""

    def metric(self) -> Any:
        """Matrix H of the squared length d'Hd of steps, upper triangle, CSC, shape (n, n)."""


@dataclass(frozen=True, slots=True, eq=False)
class Nearest:
    """Result of `nearest_feasible`.

    Attributes:
        point: Last point of the search.
        feasible: Whether it satisfies the constraints.
        at: Values there, `excess` included.
        excess: Amounts added to the nonlinear rows, shape (nonlinear,), or None.
        steps: Number of QPs solved.
        inner: Iterations of the backend in all of them.
        rows: Number of inequalities in the last QP.
        backend: Name of the backend that solved the last QP; empty if there was none.
    """

    point: Any
    feasible: bool
    at: Evaluation
    excess: Array | None
    steps: int
    inner: int
    rows: int
    backend: str = ""


def nearest_feasible(
    program: MetricProgram, point: Any, backend: QPBackend, *, likely: bool = False
) -> Nearest:
    r"""Feasible point with the objective of a given point, by least-distance steps.

    Each step d solves

    .. math:: \min d^T H d \quad \text{s.t.} \quad c_E + A d = 0, \; c_I + C d \le 0, \; d_n = 0

    The last variable is the objective, which is kept. The search gives up as soon as a step does
    not lower the violation enough: it is meant to decide quickly.

    Args:
        program: Nonlinear program with a metric H.
        point: Initial point.
        backend: Solver of the QPs.
        likely: Whether the initial point is likely to be feasible: then no derivatives are computed
            before that is known.

    Returns:
        The last point; `feasible` tells whether the search succeeded.
    """
    search = _Search(program, backend)
    return search.run(point, None if likely else program.linearize(point))


class _Search:
    """State of one call of `nearest_feasible`."""

    def __init__(self, program: MetricProgram, backend: QPBackend) -> None:
        self.program, self.backend = program, backend
        self.keep: Mask | None = None
        self.excess: Array | None = None
        self.steps = self.inner = 0
        self.solved_by = ""
        self.tolerance = 0.0  # of the last QP
        self.last_qp: tuple[Any, Any, Any, Array] | None = None  # lin, point, C, last step

    @cached_property
    def H(self) -> Any:
        """Metric of the steps, without the objective."""
        return _without_last(self.program.metric(), square=True)

    def run(self, point: Any, lin: Linearization | None) -> Nearest:
        """Search from a point; its expansion is given where a step from it is likely."""
        program, violations = self.program, list[float]()
        after_simplified = False
        while True:
            at = self._with_excess(point, program.evaluate(point) if lin is None else lin.at)
            violations.append(at.violation)
            feasible = is_feasible(at, program.tolerance, EQUALITY)
            if feasible or self.steps >= STEPS or not at.is_finite():
                break
            contracts = not after_simplified or violations[-1] <= AGAIN * violations[-2]
            may_help = self.tolerance < at.violation <= SIMPLIFIED_BELOW and contracts
            if self.last_qp is not None and may_help:
                moved = self._simplified_step(at)
                if moved is not None:
                    point, after_simplified, lin = moved, True, None
                    continue
            if not after_simplified and not _contracts(violations):
                break
            moved, after_simplified = self._step(point, lin or program.linearize(point), at), False
            if moved is None:
                break
            point = moved
            lin = program.linearize(point) if at.violation > LIKELY_ABOVE else None
        rows = 0 if self.keep is None else int(self.keep.sum())
        spent = self.steps, self.inner, rows
        return Nearest(point, feasible, at, self.excess, *spent, self.solved_by)

    def _with_excess(self, point: Any, at: Evaluation) -> Evaluation:
        """Values with the excess added, which is computed once, near feasibility."""
        worst = at.inequalities[: self.program.nonlinear].max(initial=0.0)
        if self.excess is None and worst < EXCESS_BELOW:
            raw = self.program.excess(point, at, fine=False)
            if raw is not None:
                self.excess = EXCESS_FACTOR * raw + EXCESS_GUARD
        if self.excess is None:
            return at
        inequalities = at.inequalities.copy()
        inequalities[: len(self.excess)] += self.excess
        return replace(at, inequalities=inequalities)

    def _step(self, point: Any, lin: Linearization, at: Evaluation) -> Any | None:
        """Point after the least-distance step; None if the QP is not solved."""
        program = self.program
        reach = NEAR + (REACH * at.violation if self.keep is None else 0.0)
        keep = (at.inequalities > -reach) & lin.C.leading(at.inequalities)
        if self.keep is not None:
            keep |= self.keep
        keep |= program.decisive(point, early=False)
        keep[-1] = False  # the objective's own bound
        share = np.clip(QP_SHARE * at.violation, LEAST_TOLERANCE, LARGEST_TOLERANCE)
        self.tolerance = float(share)
        missed = max(1e-7, MISSED * at.violation)
        A = None if lin.A is None else _without_last(lin.A)
        for _ in range(ROUNDS):
            C = _without_last(lin.C.selected(keep))
            nothing, u = np.zeros(program.size - 1), -at.inequalities[keep]
            qp = QP(self.H, nothing, A, -at.equalities, C, u)
            inner = INNER if at.violation > SIMPLIFIED_BELOW else INNER_NEAR
            solution = self.backend.solve(qp, tolerance=self.tolerance, iterations=inner)
            self._count(solution)
            if not (solution.solved and solution.is_finite()):
                return None
            step = np.append(solution.x, 0.0)
            predicted = lin.C @ step + at.inequalities
            over = (predicted > missed) & ~keep
            over[-1] = False
            if not over.any() or not (over & (leading := lin.C.leading(predicted))).any():
                break
            keep = keep | ((predicted > -NEAR) & leading)
            keep[-1] = False
        self.keep = keep
        self.last_qp = lin, point, None, step
        return program.moved(lin, point, step)

    def _count(self, solution: QPSolution) -> None:
        self.steps, self.inner = self.steps + 1, self.inner + solution.iterations
        self.solved_by = solution.backend

    def _simplified_step(self, at: Evaluation) -> Any | None:
        """Point after solving the last QP with the constraint values found after its step.

        This is a step of the simplified Newton method; None if the QP is not solved.
        """
        if self.last_qp is None or self.keep is None:
            raise RuntimeError(
                "nearest_feasible: a simplified step needs a QP that was solved before"
            )
        lin, point, _, step = self.last_qp
        u = -(at.inequalities - lin.C @ step)[self.keep]
        b = -at.equalities if lin.A is None else lin.A @ step - at.equalities
        solution = self.backend.solve_again(u, b)
        self._count(solution)
        if not solution.solved:
            return None
        return self.program.moved(lin, point, np.append(solution.x, 0.0))


def _contracts(violations: list[float]) -> bool:
    """Whether the last step lowered the violation enough to continue."""
    if len(violations) < 2:
        return True
    before, now = violations[-2:]
    if len(violations) == 2:
        return now <= FIRST_CONTRACTION * before or now <= SMALL
    return now <= CONTRACTION * before


def _without_last(matrix: Any, *, square: bool = False) -> Any:
    """A CSC matrix without its last column, and without its last row if it is square."""
    end = matrix.indptr[-2]
    shape = (matrix.shape[0] - (1 if square else 0), matrix.shape[1] - 1)
    parts = (matrix.data[:end], matrix.indices[:end], matrix.indptr[:-1])
    return type(matrix)(parts, shape=shape)
