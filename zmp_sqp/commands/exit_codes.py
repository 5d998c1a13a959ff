"""Exit codes of the command line."""

from __future__ import annotations

__all__ = ["BAD_INPUT", "BROKEN_PIPE", "DONE", "EXIT_CODES", "INTERRUPTED", "UNSAFE"]

DONE, UNSAFE, BAD_INPUT = 0, 1, 2
INTERRUPTED, BROKEN_PIPE = 130, 141  # 128 + SIGINT, 128 + SIGPIPE, as shells report them
EXIT_CODES = """\
exit codes:
  0  done, and the motion is safe
  1  no motion was found, or the motion is unsafe; a message says why
  2  bad input, or a start or goal at which the machine tips over, misses the margin or breaks a
     limit at rest; one sentence on standard error says which
130  ended by Ctrl-C; what was done until then is kept
"""
