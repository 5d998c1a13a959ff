"""Progress of many plans, on the terminal or by a function of the caller."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

__all__ = ["progress_bar"]

EVERY = 30.0  # [s] between lines of progress where there is no terminal


class Advance(Protocol):
    """Counts one more problem."""

    def __call__(self, *, success: bool) -> None:
        """Count a problem, with or without a safe motion."""


@contextmanager
def progress_bar(progress: bool | Callable[[int, int], None], total: int) -> Iterator[Advance]:
    """Function to call after every problem.

    Args:
        progress: Whether to show progress on standard error: a bar on a terminal, elsewhere a line
            every 30 s; or a function that is called with the numbers of problems done and in all.
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
    if not progress:
        yield lambda *, success: None
        return
    if not screen.is_terminal:
        yield _Lines(total)
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


class _Lines:
    """Counts problems, and writes a line to standard error every `EVERY` seconds."""

    def __init__(self, total: int, clock: Callable[[], float] = time.monotonic) -> None:
        self.total, self.clock = total, clock
        self.done = self.failed = 0
        self.started = self.written = clock()

    def __call__(self, *, success: bool) -> None:
        """Count a problem, with or without a safe motion."""
        self.done += 1
        self.failed += not success
        now = self.clock()
        if now - self.written < EVERY or self.done == self.total:
            return
        self.written = now
        left = (now - self.started) / self.done * (self.total - self.done)
        failed = f", {self.failed} without a motion" if self.failed else ""
        text = f"planned {self.done} of {self.total}{failed}; about {left:.0f} s to go"
        print(text, file=sys.stderr, flush=True)
