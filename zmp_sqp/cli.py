"""Command line `zmp-sqp`: its parser, and exit codes for errors."""

from __future__ import annotations

import argparse
import io
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TextIO

from zmp_sqp import __version__
from zmp_sqp.commands.batch import add_batch
from zmp_sqp.commands.chart import add_chart
from zmp_sqp.commands.check import add_check
from zmp_sqp.commands.envelope import add_envelope
from zmp_sqp.commands.exit_codes import ANY, BAD_INPUT, BROKEN_PIPE, INTERRUPTED
from zmp_sqp.commands.init import add_init
from zmp_sqp.commands.inspect import add_inspect
from zmp_sqp.commands.paper import add_paper
from zmp_sqp.commands.plan import add_plan
from zmp_sqp.commands.replay import add_replay
from zmp_sqp.commands.report import add_report
from zmp_sqp.commands.tradeoff import add_tradeoff
from zmp_sqp.commands.view import add_view
from zmp_sqp.errors import MachineWarning, ProblemWarning, ZmpSqpError, in_keys
from zmp_sqp.scenario import shipped_scenarios

__all__ = ["main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: Arguments without the program's name; None takes those of the process.

    Returns:
        The exit code: 0 done and safe, 1 unsafe or not solved, 2 bad input.
    """
    arguments = _parser().parse_args(argv)
    if isinstance(sys.stdout, io.TextIOWrapper):
        # titles may hold letters that the terminal's encoding lacks
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        with _warnings_in_a_line():
            code: int = arguments.run(arguments)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return INTERRUPTED
    except (BrokenPipeError, SystemExit):
        # The reader of the pipe, such as `head`, has ended; rich turns BrokenPipeError into
        # SystemExit. The interpreter flushes standard output at exit; that must not fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except ZmpSqpError as error:
        complaint = in_keys(str(error))
    except OSError as error:
        complaint = f"{error.filename}: {error.strerror}" if error.filename else str(error)
    print(f"zmp-sqp: error: {complaint}", file=sys.stderr)
    return BAD_INPUT


@contextmanager
def _warnings_in_a_line() -> Iterator[None]:
    """Print warnings of this library as lines on standard error, each text once."""
    said: set[str] = set()
    show = warnings.showwarning

    def show_line(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if not issubclass(category, MachineWarning | ProblemWarning):
            show(message, category, filename, lineno, file, line)
        elif str(message) not in said:
            said.add(str(message))
            print(f"zmp-sqp: warning: {in_keys(str(message))}", file=sys.stderr)

    with warnings.catch_warnings():
        for category in (MachineWarning, ProblemWarning):
            warnings.simplefilter("always", category)
        warnings.showwarning = show_line
        yield


def _parser() -> argparse.ArgumentParser:
    shipped = "shipped scenarios:\n" + "".join(f"  {name}\n" for name in shipped_scenarios())
    parser = argparse.ArgumentParser(
        prog="zmp-sqp",
        description="Minimum-time motions of heavy mobile manipulators that do not tip over.",
        epilog=(
            "examples:\n  zmp-sqp plan paper_1 --out out/paper_1\n  zmp-sqp plan --help\n"
            f"  zmp-sqp paper --out out/paper\n  zmp-sqp check --help\n\n{shipped}\n{ANY}"
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"zmp-sqp {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    add_plan(commands, shipped)
    add_paper(commands)
    add_check(commands)
    add_chart(commands, shipped)
    add_replay(commands, shipped)
    add_report(commands)
    add_view(commands, shipped)
    add_inspect(commands)
    add_init(commands)
    add_batch(commands, shipped)
    add_envelope(commands, shipped)
    add_tradeoff(commands, shipped)
    return parser


if __name__ == "__main__":
    sys.exit(main())
