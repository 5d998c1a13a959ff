"""Context that limits BLAS to one thread: matrices of planning are too small for more."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

from threadpoolctl import ThreadpoolController

__all__ = ["one_blas_thread"]

_lock = threading.Lock()
# one entry per call that is inside `one_blas_thread`: the limiter, which sets and lifts the limit,
# for the first call, None for all others
_inside: list[Any] = []


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    return ThreadpoolController()  # cached: it searches all loaded libraries, which is slow


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context manager and decorator within which BLAS uses one thread.

    Several Python threads may be inside at the same time: the first to enter sets the limit, the
    last to leave lifts it. On two cores a plan with two BLAS threads takes 1.5 times as long as
    with one, and its last digits would depend on the number of threads.
    """
    with _lock:
        _inside.append(_controller().limit(limits=1, user_api="blas") if not _inside else None)
        if len(_inside) == 1:
            _inside[0].__enter__()
    try:
        yield
    finally:
        with _lock:
            if len(_inside) == 1:
                _inside.pop().__exit__(None, None, None)
            else:
                _inside.pop()
