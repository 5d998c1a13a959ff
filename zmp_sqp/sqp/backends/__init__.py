"""QP backends behind one protocol; each solver is imported only when it is asked for."""

from __future__ import annotations

from typing import Protocol

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["QPBackend", "make_backend"]

QPSOLVERS_PREFIX = "qpsolvers:"


class QPBackend(Protocol):
    """Solves one quadratic program at a time, in bounded work: iterations are capped."""

    @property
    def name(self) -> str:
        """How the history calls it."""

    @property
    def needs_convex(self) -> bool:
        """Whether it solves only programs with a positive semi-definite Hessian."""

    def solve(
        self, qp: QP, *, tolerance: float, iterations: int, warm: QPSolution | None = None
    ) -> QPSolution:
        """Solution, converged or not; never raises because of the program's numbers.

        Args:
            qp: The program.
            tolerance: Of the residuals.
            iterations: At most so many, where the method is an interior-point one.
            warm: About the solution, for methods that gain from knowing which multipliers are
                positive.
        """

    def solve_again(self, u: Array, b: Array) -> QPSolution:
        """Solution of the last program with other right-hand sides."""


def make_backend(name: str) -> QPBackend:
    """Backend by name: "auto", "proxqp", "piqp", or "qpsolvers:NAME".

    Raises:
        ProblemError: Unknown name; the message lists what there is.
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
