"""The default: ProxSuite where it is about as fast as PIQP, PIQP elsewhere."""

from __future__ import annotations

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.backends.piqp import PIQP
from zmp_sqp.sqp.backends.proxqp import ProxQP
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["Auto"]

# Variables up to which ProxQP takes at most 1.5 times as long as PIQP, if it knows which rows are
# active; without that knowledge it takes 2.5 times as long or more at every size (docs/notes.md).
CROSSOVER = 110


class Auto:
    """ProxQP for small programs whose active rows are known, PIQP for all others.

    PIQP also takes what ProxQP does not solve, such as programs that are not convex.
    """

    name = "auto"
    needs_convex = False

    def __init__(self) -> None:
        """Make a backend without a program."""
        self._piqp, self._proxqp = PIQP(), ProxQP()
        self._last: PIQP | ProxQP = self._piqp

    def solve(
        self, qp: QP, *, tolerance: float, iterations: int, warm: QPSolution | None = None
    ) -> QPSolution:
        """Solution by the faster method; the solution tells which.

        Args:
            qp, tolerance, iterations, warm: Arguments of `QPBackend.solve`.
        """
        if warm is not None and qp.size <= CROSSOVER and warm.z.any():
            self._last = self._proxqp
            found = self._proxqp.solve(qp, tolerance=tolerance, iterations=iterations, warm=warm)
            if found.solved:
                return found
        self._last = self._piqp
        return self._piqp.solve(qp, tolerance=tolerance, iterations=iterations)

    def solve_again(self, u: Array, b: Array) -> QPSolution:
        """Solution of the last program with other right-hand sides, by whoever solved it."""
        return self._last.solve_again(u, b)
