"""BLAS on one thread, because matrices of planning are too small for more, and `scipy.linalg`."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

from zmp_sqp.locks import ForkSafeLock

__all__ = ["one_blas_thread", "scipy_linalg"]

_lock = ForkSafeLock()
_inside = 0  # calls that are inside `one_blas_thread`
_limiters: list[Any] = []  # while any call is inside: each sets a limit, and lifts it at its exit


@lru_cache(maxsize=1)
def _controller() -> Any:
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()  # cached: it searches all loaded libraries, which is slow


def _limit() -> None:
    """Limit all libraries of BLAS that are loaded now."""
    with _in_control():
        _limiters.append(_controller().limit(limits=1, user_api="blas"))


@contextmanager
def _in_control() -> Iterator[None]:
    """Context manager within which this thread may set the number of OpenBLAS's threads.

    From version 3.8 on, threadpoolctl lets only one Python thread set it, the first one that does
    so, and ignores all others without a word. The number counts for the whole process.
    """
    from threadpoolctl import OpenBLASController

    clear = getattr(OpenBLASController, "clear_controlling_thread", None)
    if clear is not None:
        clear(force=True)
    try:
        yield
    finally:
        if clear is not None:
            clear(force=True)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context manager and decorator within which BLAS uses one thread.

    Several Python threads may be inside at the same time: the first to enter sets the limit, the
    last to leave lifts it. On two cores a plan with two BLAS threads takes 1.5 times as long as
    with one, and its last digits would depend on the number of threads.
    """
    global _inside
    with _lock:
        if not _inside:
            _limit()
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside = max(_inside - 1, 0)  # after a fork inside, the count begins anew
            if _limiters and not _inside:
                with _in_control():
                    while _limiters:
                        _limiters.pop().restore_original_limits()


@lru_cache(maxsize=1)
def scipy_linalg() -> Any:
    """`scipy.linalg`, imported by the first call: it takes as long as numpy, and few plans need it.

    It brings a BLAS of its own, which gets the limit of calls that are inside `one_blas_thread`.
    """
    import scipy.linalg

    with _lock:
        _controller.cache_clear()  # which has not seen this library
        if _inside:
            _limit()
    return scipy.linalg


def _after_fork() -> None:
    """Forget the calls of other threads in a forked process, which has none of them."""
    global _inside
    _inside = 0


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
