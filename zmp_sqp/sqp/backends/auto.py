"""Default backend: ProxQP where it is about as fast as PIQP, PIQP elsewhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.backends.piqp import PIQP
from zmp_sqp.sqp.qp import QP, QPSolution

if TYPE_CHECKING:
    from zmp_sqp.sqp.backends.proxqp import ProxQP

__all__ = ["Auto"]

# number of variables up to which ProxQP takes at most 1.5 times as long as PIQP, given the active
# rows; without them it takes at least 2.5 times as long at every size (docs/notes.md)
CROSSOVER = 110


class Auto:
    """ProxQP for small QPs with a guess of the active rows, PIQP for all others.

    PIQP also takes the QPs that ProxQP does not solve, such as non-convex ones.
    """

    name = "auto"
    needs_convex = False

    def __init__(self) -> None:
        """Create the backend, with no QP yet."""
        self._piqp = PIQP()
        self._proxqp: ProxQP | None = None  # loads DAQP and more, which most plans do not need
        self._last: PIQP | ProxQP = self._piqp

    def solve(
        self, qp: QP, *, tolerance: float, iterations: int, warm: QPSolution | None = None
    ) -> QPSolution:
        """Solution by the faster method, named in `backend` of the solution.

        Args:
            qp, tolerance, iterations, warm: Arguments of `QPBackend.solve`.
        """
        if warm is not None and qp.size <= CROSSOVER and warm.z.any():
            self._last = proxqp = self._proxqp or self._load_proxqp()
            found = proxqp.solve(qp, tolerance=tolerance, iterations=iterations, warm=warm)
            if found.solved:
                return found
        self._last = self._piqp
        return self._piqp.solve(qp, tolerance=tolerance, iterations=iterations)

    def solve_again(self, u: Array, b: Array) -> QPSolution:
        """Solution of the last QP with other right-hand sides, by the solver that solved it."""
        return self._last.solve_again(u, b)

    def _load_proxqp(self) -> ProxQP:
        from zmp_sqp.sqp.backends.proxqp import ProxQP

        self._proxqp = ProxQP()
        return self._proxqp
