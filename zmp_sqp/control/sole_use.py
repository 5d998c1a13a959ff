"""Lock that refuses a second user instead of letting it wait."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from zmp_sqp.errors import ProblemError

__all__ = ["SoleUse"]


class SoleUse:
    """Use of a planner by one call at a time."""

    def __init__(self) -> None:
        """Not in use."""
        self._lock = threading.Lock()
        self._user: tuple[int, int] | None = None  # process and thread

    @contextmanager
    def held(self) -> Iterator[None]:
        """Context manager of one call.

        Raises:
            ProblemError: Another call is under way.
        """
        user = os.getpid(), threading.get_ident()
        if self._user is not None and self._user[0] != user[0]:
            self._lock = threading.Lock()  # forked while a thread that is not here held it
        if not self._lock.acquire(blocking=False):
            if self._user is not None and self._user[1] == user[1]:
                raise ProblemError(
                    "this planner is planning already: its progress function, or a signal handler, "
                    "cannot plan with it; give them a Planner of their own"
                )
            raise ProblemError(
                "this planner is in use by another thread: give every thread a Planner of its own"
            )
        self._user = user
        try:
            yield
        finally:
            self._user = None
            self._lock.release()
