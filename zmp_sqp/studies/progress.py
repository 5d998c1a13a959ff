"""Progress of many plans, on the terminal or by a function of the caller."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

__all__ = ["progress_bar"]


class Advance(Protocol):
    """Counts one more problem."""

    def __call__(self, *, success: bool) -> None:
        """Count a problem, with or without a safe motion."""


@contextmanager
def progress_bar(progress: bool | Callable[[int, int], None], total: int) -> Iterator[Advance]:
    """Function to call after every problem.

    Args:
        progress: Whether to show a bar if standard error is a terminal; or a function that is
            called with the numbers of problems done and in all.
        total: Number of problems.
    """
    done = failed = 0
    if callable(progress):

        def report(*, success: bool) -> None:
            nonlocal done
            done += 1
            progress(done, total)

        yield report
        return
    from rich.console import Console

    screen = Console(stderr=True)
    if not (progress and screen.is_terminal):
        yield lambda *, success: None
        return
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("planning"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.description}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=screen, transient=True) as bar:
        task = bar.add_task("", total=total)

        def advance(*, success: bool) -> None:
            nonlocal failed
            failed += not success
            bar.update(task, advance=1, description=f"{failed} without a motion" if failed else "")

        yield advance
