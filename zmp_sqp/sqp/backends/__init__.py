"""QP solvers behind one protocol; each is imported only when it is asked for."""

from __future__ import annotations

from typing import Protocol

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["QPBackend", "make_backend"]

QPSOLVERS_PREFIX = "qpsolvers:"


class QPBackend(Protocol):
    """Solver of one quadratic program at a time, with a limited number of iterations."""

    @property
    def name(self) -> str:
        """Name in the records of iterations."""

    @property
    def needs_convex(self) -> bool:
        """Whether it solves only programs with a positive semi-definite Hessian."""

    def solve(
        self, qp: QP, *, tolerance: float, iterations: int, warm: QPSolution | None = None
    ) -> QPSolution:
        """Solution of a QP; `solved` is False where it did not converge. Raises for no data.

        Args:
            qp: Quadratic program.
            tolerance: Tolerance of the KKT residuals.
            iterations: Largest number of iterations of an interior-point method.
            warm: Guess of the solution, for methods that profit from knowing which multipliers
                are positive; None for none.
        """

    def solve_again(self, u: Array, b: Array) -> QPSolution:
        """Solution of the last QP with other right-hand sides.

        Args:
            u: Upper bounds of the inequalities, shape (m,).
            b: Right-hand side of the equalities, shape (p,).
        """


def make_backend(name: str) -> QPBackend:
    """Backend by name: "auto", "proxqp", "piqp", or "qpsolvers:NAME".

    Raises:
        ProblemError: Unknown name; the message lists the known ones.
    """
    if name == "proxqp":
        from zmp_sqp.sqp.backends.proxqp import ProxQP

        return ProxQP()
    if name == "auto":
        from zmp_sqp.sqp.backends.auto import Auto

        return Auto()
    if name == "piqp":
        from zmp_sqp.sqp.backends.piqp import PIQP

        return PIQP()
    if isinstance(name, str) and name.startswith(QPSOLVERS_PREFIX):
        from zmp_sqp.sqp.backends.qpsolvers import QPSolvers

        return QPSolvers(name.removeprefix(QPSOLVERS_PREFIX))
    raise ProblemError(
        f'unknown QP solver {name!r}: use "auto", "proxqp", "piqp" or "qpsolvers:NAME"'
    )
