"""Exit codes of the command line."""

from __future__ import annotations

from typing import NamedTuple

__all__ = [
    "ANY",
    "BAD_INPUT",
    "BROKEN_PIPE",
    "DONE",
    "INTERRUPTED",
    "PLANNING",
    "UNSAFE",
    "Meanings",
]

DONE, UNSAFE, BAD_INPUT = 0, 1, 2
INTERRUPTED, BROKEN_PIPE = 130, 141  # 128 + SIGINT, 128 + SIGPIPE, as shells report them


class Meanings(NamedTuple):
    """What the exit codes of a command mean.

    Attributes:
        done: What 0 means.
        unsafe: What 1 means; empty if the command never ends with it.
        bad: What 2 means.
    """

    done: str = "done"
    unsafe: str = ""
    bad: str = "bad input; one sentence on standard error says which"

    def __str__(self) -> str:
        """Block of help."""
        lines = ["exit codes:", f"  0  {self.done}"]
        if self.unsafe:
            lines.append(f"  1  {self.unsafe}")
        lines += [f"  2  {self.bad}", "130  ended by Ctrl-C; what was done until then is kept", ""]
        return "\n".join(lines)


ANY = Meanings(
    unsafe="no motion was found, or it is unsafe; --help of each command says what 0 and 1 mean",
)
PLANNING = Meanings(
    "done, and the motion is safe",
    "no motion was found, or the motion is unsafe; a message says why",
    "bad input, or a start or goal at which the machine tips over, misses the margin or breaks a\n"
    "     limit at rest; one sentence on standard error says which",
)
