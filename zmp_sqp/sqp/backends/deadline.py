"""QP backend with a deadline, after which it solves no further QP."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.backends import QPBackend
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["Punctual", "TimeLimited"]


@runtime_checkable
class TimeLimited(Protocol):
    """Backend whose solver may accept a time limit."""

    time_limit: float | None  # [s] for the next QP; None for none


class Punctual:
    """Wrapper of a backend that reports QPs as not solved after a deadline.

    ProxQP and PIQP cannot be interrupted: a QP that has begun is finished. Solvers behind qpsolvers
    that accept a time limit get the remaining time.
    """

    def __init__(
        self, backend: QPBackend, deadline: float, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        """Wrap a backend.

        Args:
            backend: Solver of QPs until the deadline.
            deadline: Value of the clock after which no QP starts [s].
            clock: Clock of the deadline [s].
        """
        self._backend, self._deadline, self._clock = backend, deadline, clock
        self.name, self.needs_convex = backend.name, backend.needs_convex
        self._size = 0  # number of variables of the last QP

    def solve(
        self, qp: QP, *, tolerance: float, iterations: int, warm: QPSolution | None = None
    ) -> QPSolution:
        """Solution by the backend; not solved after the deadline.

        Args:
            qp, tolerance, iterations, warm: Arguments of `QPBackend.solve`.
        """
        self._size = qp.size
        if not self._has_time():
            return QPSolution.nothing(qp, self.name)
        return self._backend.solve(qp, tolerance=tolerance, iterations=iterations, warm=warm)

    def solve_again(self, u: Array, b: Array) -> QPSolution:
        """Solution of the last QP with other right-hand sides; not solved after the deadline."""
        if not self._has_time():
            x, y, z = (np.full(count, np.nan) for count in (self._size, len(b), len(u)))
            return QPSolution(x, y, z, False, 0, self.name)
        return self._backend.solve_again(u, b)

    def _has_time(self) -> bool:
        remaining = self._deadline - self._clock()
        if remaining > 0.0 and isinstance(self._backend, TimeLimited):
            self._backend.time_limit = remaining
        return remaining > 0.0
