"""`zmp-sqp batch`: plan many scenarios."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from zmp_sqp.commands.console import add_command, make_console
from zmp_sqp.commands.content_hash import content_hash
from zmp_sqp.commands.exit_codes import DONE, INTERRUPTED, UNSAFE, Meanings
from zmp_sqp.commands.live import live_line
from zmp_sqp.commands.study_options import (
    add_study_options,
    planned,
    planning_options,
    refused_row,
    row_of,
)
from zmp_sqp.errors import ZmpSqpError
from zmp_sqp.planning import Problem
from zmp_sqp.scenario import load_scenario
from zmp_sqp.studies.journal import Journal

__all__ = ["add_batch", "run_batch"]

DESCRIPTION = """\
Plan many scenarios on several processes. Every result is a row of the file, written as soon as the
plan is done: JSON lines (.jsonl) or Parquet (.parquet, with the extra `parquet`). A scenario that
cannot be read, or that is refused, gets a row that says why; the others are planned.
"""
EXAMPLES = """\
examples:
  zmp-sqp batch scenarios/*.toml --out plans.jsonl
  zmp-sqp batch scenarios/*.toml --out plans.parquet --resume
"""
ROW_KEYS = """\
one row per scenario; SI units, null where there is no value:
  scenario             the scenario as given
  content              hash of the scenario, of the files that it names (URDF with SRDF and limits,
                       heightmap) and of --qp-solver and --time-budget: where it differs, --resume
                       plans the scenario again
  name, success, status, duration, lower_bound, above_bound, margin, margin_asked, intervals,
  iterations, solve_time, qp_solver, payload, message: columns of `zmp_sqp.table`; status is
  `refused` where there is no problem to plan
"""


@dataclass(frozen=True, slots=True)
class _Entry:
    """Scenario as given on the command line, and the hash of what its result depends on."""

    given: str
    content: str


def add_batch(commands: Any, shipped: str) -> None:
    """Add the command `batch`.

    Args:
        commands: Subcommands of an argparse parser.
        shipped: Help text that lists the shipped scenarios.
    """
    command = add_command(
        commands,
        "batch",
        run_batch,
        summary="plan many scenarios",
        description=DESCRIPTION,
        codes=Meanings("all scenarios have a safe motion", "some have not; their rows say why"),
        notes=(EXAMPLES, ROW_KEYS, shipped),
    )
    command.add_argument(
        "scenarios", nargs="+", metavar="SCENARIO", help="scenario files, or names of shipped ones"
    )
    command.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help=".jsonl or .parquet file"
    )
    command.add_argument(
        "--resume",
        action="store_true",
        help="continue an interrupted run: plan only scenarios without a row in FILE",
    )
    add_study_options(command)


def run_batch(arguments: argparse.Namespace) -> int:
    """Plan, write and count; returns the exit code."""
    given, options = dict.fromkeys(arguments.scenarios), planning_options(arguments)
    entries = [_Entry(one, content_hash(one, options)) for one in given]
    journal = Journal(arguments.out, resume=arguments.resume)
    there = {(row.get("scenario"), row.get("content")) for row in journal.rows}
    todo = [entry for entry in entries if (entry.given, entry.content) not in there]
    console = make_console(None)
    if len(entries) < len(arguments.scenarios):
        console.print("scenarios that are given more than once are planned once")
    if len(todo) < len(entries):
        console.print(f"{len(entries) - len(todo)} of {len(entries)} are there already")
    journal.rows = [row for row in journal.rows if not _is_old(row, todo)]
    interrupted = False
    with journal:
        try:
            for row in _rows(todo, arguments):
                journal.add(row)
        except KeyboardInterrupt:
            interrupted = True
    # an earlier run may have left rows of scenarios that are not asked for now
    rows = {row.get("scenario"): row for row in journal.rows}
    asked = [rows[entry.given] for entry in entries if entry.given in rows]
    safe = sum(bool(row.get("success")) for row in asked)
    missing = len(entries) - len(asked)
    left = f" ({missing} are not planned)" if missing else ""
    console.print(f"{safe} of {len(entries)} scenarios have a safe motion{left}", soft_wrap=True)
    for row in asked:
        if not row.get("success"):
            console.print(_complaint(row), soft_wrap=True)
    console.print(f"wrote {journal.path}", soft_wrap=True)
    if interrupted:
        console.print("interrupted: --resume plans the rest")
        return INTERRUPTED
    return DONE if safe == len(entries) else UNSAFE


def _complaint(row: Mapping[str, Any]) -> str:
    """Why a scenario has no safe motion, with its name."""
    name, message = str(row["scenario"]), str(row.get("message", ""))
    return message if message.startswith(name) else f"{name}: {message}"


def _is_old(row: dict[str, Any], todo: list[_Entry]) -> bool:
    """Whether a row is of a file that has changed since."""
    return any(row.get("scenario") == entry.given for entry in todo)


def _rows(entries: list[_Entry], arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Rows of all scenarios: first those that cannot be planned, then plans as they come."""
    found: list[tuple[_Entry, str, Problem]] = []
    with live_line("reading scenarios", total=len(entries)) as line:
        for entry in entries:
            try:
                scenario = load_scenario(entry.given)
            except ZmpSqpError as fault:
                yield {**_key(entry), **refused_row(Path(entry.given).stem, str(fault))}
            else:
                found.append((entry, scenario.name, scenario.problem))
            line.say("reading scenarios")
    for index, plan in planned([problem for _, _, problem in found], arguments):
        entry, name, _ = found[index]
        yield {**_key(entry), **row_of(name, plan)}


def _key(entry: _Entry) -> dict[str, str]:
    return {"scenario": entry.given, "content": entry.content}
