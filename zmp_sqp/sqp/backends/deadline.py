"""A backend that starts no QP after a deadline, so that a cascade of QPs ends with it."""

from __future__ import annotations

import time
from typing import Protocol, runtime_checkable

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.backends import QPBackend
from zmp_sqp.sqp.qp import QP, QPSolution

__all__ = ["Punctual", "TimeLimited"]


@runtime_checkable
class TimeLimited(Protocol):
    """A backend whose solver may be able to stop in time."""

    time_limit: float | None  # [s] of the next QP


class Punctual:
    """Another backend until the deadline; from then on it has nothing to offer.

    ProxQP and PIQP cannot be told to stop: a QP that has begun is brought to its end. Solvers
    behind qpsolvers that know a time limit are given what remains.
    """

    def __init__(self, backend: QPBackend, deadline: float) -> None:
        """Wrap a backend.

        Args:
            backend: Solves QPs until the deadline.
            deadline: A `time.perf_counter()` value [s].
        """
        self._backend, self._deadline = backend, deadline
        self.name, self.needs_convex = backend.name, backend.needs_convex
        self._size = 0  # variables of the last QP

    def solve(
        self, qp: QP, *, tolerance: float, iterations: int, warm: QPSolution | None = None
    ) -> QPSolution:
        """Solution by the backend; nothing after the deadline."""
        self._size = qp.size
        if not self._has_time():
            return QPSolution.nothing(qp, self.name)
        return self._backend.solve(qp, tolerance=tolerance, iterations=iterations, warm=warm)

    def solve_again(self, u: Array, b: Array) -> QPSolution:
        """Solution by the backend of the last program with other right-hand sides."""
        if not self._has_time():
            x, y, z = (np.full(count, np.nan) for count in (self._size, len(b), len(u)))
            return QPSolution(x, y, z, False, 0, self.name)
        return self._backend.solve_again(u, b)

    def _has_time(self) -> bool:
        remaining = self._deadline - time.perf_counter()
        if remaining > 0.0 and isinstance(self._backend, TimeLimited):
            self._backend.time_limit = remaining
        return remaining > 0.0
