"""`zmp-sqp report`: one offline page about plans, to look at the motion and what is proven."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from zmp_sqp.commands.console import add_command, make_console
from zmp_sqp.commands.exit_codes import DONE, Meanings
from zmp_sqp.errors import ScenarioError

__all__ = ["add_html_option", "add_report", "check_html", "run_report", "write_report"]

DESCRIPTION = """\
Write one page about a plan, or several side by side: the machine in 3-D playing its motion, margins
and joints over time, the verdict and what it rests on. It opens in any browser, without a network.
"""
EXAMPLES = """\
examples:
  zmp-sqp report out/paper_1/plan.json --html report.html
  zmp-sqp report a/plan.json b/plan.json --html both.html    two plans side by side
  zmp-sqp plan paper_1 --html report.html                    plan, and report at once
"""
MOST_PLANS = 8  # on one page
LARGEST = 64 << 20  # [bytes] of a plan.json


def add_report(commands: Any) -> None:
    """Add the command `report`.

    Args:
        commands: Subcommands of an argparse parser.
    """
    command = add_command(
        commands,
        "report",
        run_report,
        summary="write a page to look at plans in any browser",
        description=DESCRIPTION,
        codes=Meanings(),
        notes=(EXAMPLES,),
    )
    command.add_argument(
        "plans",
        metavar="PLAN",
        nargs="+",
        type=Path,
        help="a plan.json of `zmp-sqp plan --out DIR`, or a file of its `--json FILE`",
    )
    add_html_option(command, required=True)


def add_html_option(command: argparse.ArgumentParser, *, required: bool = False) -> None:
    """Add `--html FILE`."""
    command.add_argument(
        "--html",
        type=Path,
        metavar="FILE",
        required=required,
        help="file for a report: one page that opens in any browser, without a network",
    )


def run_report(arguments: argparse.Namespace) -> int:
    """Read the plans and write the page; returns the exit code."""
    from zmp_sqp.report.page import read_plan

    if len(arguments.plans) > MOST_PLANS:
        raise ScenarioError(
            f"a report shows {MOST_PLANS} plans at most, not {len(arguments.plans)}"
        )
    results = [read_plan(_text(path), str(path)) for path in arguments.plans]
    check_html(arguments.html)
    line = write_report(arguments.html, results)
    make_console(None).print(line, soft_wrap=True)
    return DONE


def check_html(path: Path | None) -> None:
    """Make the folder of a report, and remove one of an earlier run.

    Raises:
        OSError: The folder cannot be made, or the file cannot be removed.
    """
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)


def write_report(path: Path, results: Sequence[Mapping[str, Any]]) -> str:
    """Write the page; returns a line about it.

    Args:
        path: File to write.
        results: Contents of plan.json files.
    """
    from zmp_sqp.report.page import make_page

    text = make_page(results)
    path.write_text(text, encoding="utf-8")
    return f"wrote {path} ({1e-6 * len(text.encode()):.1f} MB)"


def _text(path: Path) -> str:
    """Content of a plan.json."""
    if path.stat().st_size > LARGEST:
        raise ScenarioError(f"{path}: larger than 64 MB, so it is no plan.json")
    try:
        return path.read_text(encoding="utf-8")
    except ValueError as cause:  # not UTF-8
        raise ScenarioError(f"{path}: not a JSON file: {cause}") from None
