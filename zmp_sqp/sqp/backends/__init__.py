"""QP backends behind one protocol; each solver is imported only when it is asked for."""

from __future__ import annotations

from typing import Protocol

from zmp_sqp.errors import ProblemError
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["QPBackend", "make_backend"]

QPSOLVERS_PREFIX = "qpsolvers:"


class QPBackend(Protocol):
    """Solves one QP at a time, in bounded work: inner and outer iterations are capped."""

    @property
    def name(self) -> str:
        """How the history calls it."""

    @property
    def wants_sparse(self) -> bool:
        """Whether it is better served with the sparse multiple-shooting QP than with the condensed one."""

    def solve(self, qp: QP, *, warm: QPSolution | None = None) -> QPSolution:
        """Solution, converged or not; never raises because of the QP's numbers.

        Args:
            qp: The program.
            warm: Solution of a nearby QP of the same size, for methods that gain from one.
        """


def make_backend(name: str) -> QPBackend:
    """Backend by name: "proxqp", "piqp", or "qpsolvers:NAME" for any solver that qpsolvers finds installed.

    Raises:
        ProblemError: Unknown name; the message lists what there is.
    """
    if name == "proxqp":
        from zmp_sqp.sqp.backends.proxqp import ProxQP

        return ProxQP()
    if name == "piqp":
        from zmp_sqp.sqp.backends.piqp import PIQP

        return PIQP()
    if isinstance(name, str) and name.startswith(QPSOLVERS_PREFIX):
        from zmp_sqp.sqp.backends.qpsolvers import QPSolvers

        return QPSolvers(name.removeprefix(QPSOLVERS_PREFIX))
    raise ProblemError(f'unknown QP solver {name!r}: use "proxqp", "piqp" or "qpsolvers:NAME"')
