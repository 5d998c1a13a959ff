"""Live line on the terminal: what a search is about while nothing else can be printed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from zmp_sqp.sqp.result import IterationRecord

__all__ = ["LiveLine", "live_line"]


def _nowhere(words: str) -> None:
    """Show nothing: standard error is no terminal."""


@dataclass(slots=True)
class LiveLine:
    """Line that says what runs, since when, and how far a search is from a feasible motion.

    Attributes:
        show: Replaces the line by a text.
        started: Start of the work, a `time.monotonic()` value [s].
        words: What runs.
        iterations: Number of SQP iterations so far.
        least: Least constraint violation of the current run; infinite before its first iteration.
    """

    show: Callable[[str], None] = _nowhere
    started: float = field(default_factory=time.monotonic)
    words: str = ""
    iterations: int = 0
    least: float = float("inf")

    def say(self, words: str) -> None:
        """Begin something, named in words."""
        self.words, self.least = words, float("inf")
        self._update()

    def count(self, record: IterationRecord) -> None:
        """Count one SQP iteration."""
        self.iterations += 1
        self.least = min(self.least, record.violation)
        self._update()

    def _update(self) -> None:
        parts = [self.words]
        if self.iterations:
            parts.append(f"iteration {self.iterations}")
        if self.least < float("inf"):
            parts.append(f"least violation {self.least:.1e}")
        self.show("; ".join([*parts, f"{time.monotonic() - self.started:.0f} s"]))


@contextmanager
def live_line() -> Iterator[LiveLine]:
    """Live line on standard error while the block runs; nothing where that is no terminal."""
    from rich.console import Console

    screen = Console(stderr=True, markup=False, highlight=False)
    if not screen.is_terminal:
        yield LiveLine()
        return
    with screen.status("") as status:
        yield LiveLine(status.update)
