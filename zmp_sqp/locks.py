"""Locks for what a process has only once: its standard error stream, its filters of warnings."""

from __future__ import annotations

import os
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from weakref import WeakSet

__all__ = ["ForkSafeLock", "without_warnings"]

_every: WeakSet[ForkSafeLock] = WeakSet()


class ForkSafeLock:
    """Lock that is free in a forked process, which lacks the thread that may have held it."""

    def __init__(self) -> None:
        """Free, and reentrant."""
        self._lock = threading.RLock()
        _every.add(self)

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *raised: object) -> None:
        self._lock.release()

    def free(self) -> None:
        """Make it free, whoever holds it."""
        self._lock = threading.RLock()


def _after_fork() -> None:
    for lock in _every:
        lock.free()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)

_filters = ForkSafeLock()


@contextmanager
def without_warnings() -> Iterator[None]:
    """Context manager without warnings, for one thread at a time.

    `warnings.catch_warnings` puts the filters of the whole process aside. Two threads that put them
    back in the wrong order would leave none but its own.
    """
    with _filters, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
