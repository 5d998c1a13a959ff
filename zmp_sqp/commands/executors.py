"""Executors that plan for the commands of studies: local processes, or the workers of a cluster."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from zmp_sqp.errors import MissingExtra, ProblemError

__all__ = ["executor_at"]

PATIENCE = 10.0  # [s] for the scheduler to answer


@contextmanager
def executor_at(address: str | None) -> Iterator[Executor | None]:
    """Executor of a Dask scheduler; None, which stands for local processes, without an address.

    Args:
        address: Such as "tcp://scheduler:8786".

    Raises:
        MissingExtra: Dask is not installed.
        ProblemError: No scheduler answers there.
    """
    if address is None:
        yield None
        return
    try:
        from dask.distributed import Client
    except ModuleNotFoundError:
        raise MissingExtra(
            "--dask needs Dask, which `pip install zmp-sqp[cluster]` brings"
        ) from None
    connect: Any = Client
    try:
        client = connect(address, timeout=PATIENCE)
    except (OSError, ValueError, TypeError) as cause:
        raise ProblemError(f"no Dask scheduler answers at {address!r}: {cause}") from None
    with client:
        yield client.get_executor()
