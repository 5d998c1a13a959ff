"""A backend that starts no QP after a deadline, so that a cascade of QPs ends with it."""

from __future__ import annotations

import time
from typing import Protocol, runtime_checkable

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
        behind qpsolvers that
    know a time limit are given what remains.
    """

    def __init__(self, backend: QPBackend, deadline: float) -> None:
        """Wrap a backend; `deadline` is a `time.perf_counter()` value."""
        self._backend, self._deadline = backend, deadline
        self.name, self.wants_sparse = backend.name, backend.wants_sparse

    def solve(self, qp: QP, *, warm: QPSolution | None = None) -> QPSolution:
        """As the backend's own."""
        remaining = self._deadline - time.perf_counter()
        if remaining <= 0.0:
            return QPSolution.nothing(qp, self.name)
        if isinstance(self._backend, TimeLimited):
            self._backend.time_limit = remaining
        return self._backend.solve(qp, warm=warm)
