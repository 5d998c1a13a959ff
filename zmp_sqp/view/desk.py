"""One piece of work at a time: of the requests that wait, only the newest is done."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["Desk", "Superseded"]


class Superseded(Exception):
    """A newer request has come, or the view ends."""


class Desk:
    """Queue of one place: a request that waits is dropped as soon as a newer one comes.

    Work that has begun goes on, so that a slider in motion gets answers; work without a time limit
    asks between its steps whether it is still wanted.
    """

    def __init__(self) -> None:
        self._count = 0
        self._closed = False
        self._counting = threading.Lock()
        self._working = threading.Lock()

    @contextmanager
    def turn(self) -> Iterator[Callable[[], None]]:
        """Wait for the turn of a new request.

        Yields:
            A function that raises `Superseded` once a newer request has come.

        Raises:
            Superseded: A newer request came while this one waited.
        """
        with self._counting:
            self._count += 1
            ticket = self._count

        def still_wanted() -> None:
            if self._closed or ticket != self._count:
                raise Superseded

        with self._working:
            still_wanted()
            yield still_wanted

    def close(self, patience: float) -> None:
        """Drop all requests, and wait for the one at work [s] at most."""
        self._closed = True
        if self._working.acquire(timeout=patience):
            self._working.release()
