"""One BLAS thread while small matrices are at work: more threads only get in each other's way."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

from threadpoolctl import ThreadpoolController

__all__ = ["one_blas_thread"]

_lock = threading.Lock()
_inside: list[Any] = []  # who is inside; the first one's limiter stands at the front


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    return ThreadpoolController()  # looks through the loaded libraries, once


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread; the first to enter sets the limit, the last to leave lifts it.

    On two cores a plan takes half as long again with two BLAS threads as with one, and its bits
    would depend on how many there are.
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
