"""Output that all commands share: the console, the folder of `--out`, the file of `--json`."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zmp_sqp.commands.exit_codes import PLANNING, Meanings
from zmp_sqp.errors import MissingExtra

if TYPE_CHECKING:
    from rich.console import Console

__all__ = [
    "add_command",
    "add_json_option",
    "add_out_option",
    "make_console",
    "prepare_folder",
    "print_lines",
    "to_json",
    "without_matplotlib",
    "write_json",
]

# a list of numbers that is spread over lines; strings in JSON have no line breaks
NUMBERS = re.compile(r"\[\n\s*(?:-?\d[\d.eE+-]*|null)(?:,\n\s*(?:-?\d[\d.eE+-]*|null))*\n\s*\]")
STANDARD_OUTPUT = "-"  # value of --json


def add_command(
    commands: Any,
    name: str,
    run: Callable[[argparse.Namespace], int],
    *,
    summary: str,
    description: str,
    notes: Iterable[str],
    codes: Meanings = PLANNING,
) -> argparse.ArgumentParser:
    """Add a subcommand whose help ends with examples, keys and exit codes.

    Args:
        commands: Subcommands of an argparse parser.
        name: Name of the command.
        run: Function that runs it on the parsed arguments and returns the exit code.
        summary: One line for the list of commands.
        description: Text above the options, printed as it stands.
        notes: Blocks of text below the options; the exit codes follow them.
        codes: What the exit codes mean.
    """
    command: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=description,
        epilog="\n".join([*notes, str(codes)]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=run)
    return command


def add_out_option(command: argparse.ArgumentParser, files: Sequence[str], note: str = "") -> None:
    """Add `--out DIR`, which writes these files; the note ends its help."""
    command.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help=f"folder for {', '.join(files)}; files of these names are replaced{note}",
    )


def add_json_option(command: argparse.ArgumentParser) -> None:
    """Add `--json FILE`."""
    command.add_argument(
        "--json",
        metavar="FILE",
        help="file for the results; - prints them on standard output, and all else on standard "
        "error",
    )


def make_console(json_target: str | None, *, pipe_width: int | None = None) -> Console:
    """Console for people: standard error if the results go to standard output.

    Args:
        json_target: Value of `--json`.
        pipe_width: Columns if the console is no terminal but a file or a pipe; None leaves them to
            rich.
    """
    from rich.console import Console

    # markup would swallow units such as [m]
    options: dict[str, Any] = {
        "stderr": json_target == STANDARD_OUTPUT,
        "highlight": False,
        "markup": False,
    }
    console = Console(**options)
    if pipe_width is None or console.is_terminal:
        return console
    return Console(**options, width=pipe_width)


def prepare_folder(folder: Path | None, files: Sequence[str]) -> None:
    """Make the folder of `--out` and remove these files of an earlier run from it.

    Commands call it before their work: a folder that cannot be made fails early, and a run without
    a motion leaves no motion of an earlier run behind.

    Raises:
        OSError: The folder cannot be made, or a file in it cannot be removed.
    """
    if folder is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    for name in files:
        (folder / name).unlink(missing_ok=True)


def to_json(result: Mapping[str, Any], *, indent: int = 2) -> str:
    """Result as text, lists of numbers on one line; NaN and infinity, not in JSON, are refused."""
    text = json.dumps(result, indent=indent, allow_nan=False)
    return NUMBERS.sub(lambda found: " ".join(found[0].split()), text) + "\n"


def write_json(text: str, json_target: str | None, console: Console) -> None:
    """Write the results where `--json` asks for them.

    Args:
        text: The results, made by `to_json`.
        json_target: Value of `--json`.
        console: Names the file that was written.
    """
    if json_target == STANDARD_OUTPUT:
        print(text, end="")
    elif json_target is not None:
        Path(json_target).write_text(text, encoding="utf-8")
        console.print(f"wrote {json_target}", soft_wrap=True)


def print_lines(console: Console, lines: Iterable[str]) -> None:
    """Print lines, such as those about the files of `--out`, without breaking long paths."""
    for line in lines:
        console.print(line, soft_wrap=True)


def without_matplotlib(lines: Iterator[str]) -> Iterator[str]:
    """Pass on the lines of a generator that draws figures; without matplotlib, one line says so."""
    try:
        yield from lines
    except MissingExtra as missing:
        yield f"no figures: {missing}"
