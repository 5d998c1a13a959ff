"""Live line on the terminal: what long work is about while nothing else can be printed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeVar

from zmp_sqp.sqp.result import IterationRecord

__all__ = ["LiveLine", "Steps", "live_line"]

T = TypeVar("T")


def _nowhere(words: str) -> None:
    """Show nothing: standard error is no terminal."""


@dataclass(slots=True)
class LiveLine:
    """Line that says what runs, and how far a search is from a feasible motion.

    Attributes:
        show: Replaces the line by a text.
        words: What runs.
        iterations: Number of SQP iterations so far.
        least: Least constraint violation of the current run; infinite before its first iteration.
    """

    show: Callable[[str], None] = _nowhere
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
        self.show("; ".join(parts))


@contextmanager
def live_line(words: str = "", total: int | None = None) -> Iterator[LiveLine]:
    """Live line on standard error while the block runs; nothing where that is no terminal.

    The time since the block began runs along at its end.

    Args:
        words: What begins.
        total: Number of steps, for a bar with numbers: each `say` begins one, and completes the
            one before; None shows no bar.
    """
    from rich.console import Console

    screen = Console(stderr=True, markup=False, highlight=False)
    if not screen.is_terminal:
        yield LiveLine()
        return
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
    )

    bar: list[ProgressColumn] = [] if total is None else [BarColumn(), MofNCompleteColumn()]
    text = TextColumn("{task.description}", markup=False)
    columns = (SpinnerColumn(), text, *bar, TimeElapsedColumn())
    # what is printed on standard output meanwhile stays there
    with Progress(*columns, console=screen, transient=True, redirect_stdout=False) as progress:
        task = progress.add_task(words, total=total, completed=0 if words or total is None else -1)
        step = 0 if total is None else 1
        line = LiveLine(lambda text: progress.update(task, advance=step, description=text))
        line.words = words
        yield line


@dataclass(slots=True)
class Steps:
    """Steps after the main work of a command: Ctrl-C ends one, and those that follow are left out.

    Attributes:
        missing: What was left out, in words; empty without a Ctrl-C.
    """

    missing: list[str] = field(default_factory=list)

    @property
    def interrupted(self) -> bool:
        """Whether there was a Ctrl-C."""
        return bool(self.missing)

    def run(self, words: str, work: Callable[[LiveLine], T], otherwise: Callable[[], T]) -> T:
        """Result of a step, with a live line while it runs.

        Args:
            words: The step in words.
            work: Does the step.
            otherwise: Gives what stands for its result after a Ctrl-C.
        """
        if not self.missing:
            try:
                with live_line(words) as line:
                    return work(line)
            except KeyboardInterrupt:
                pass
        self.missing.append(words)
        return otherwise()

    def lines(self) -> Iterator[str]:
        """A line about what is missing; none without a Ctrl-C."""
        if self.missing:
            yield f"interrupted, without: {', '.join(self.missing)}"
