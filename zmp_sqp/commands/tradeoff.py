"""`zmp-sqp tradeoff`: duration against the margin that is asked for."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.commands.console import (
    add_command,
    make_console,
    prepare_folder,
    print_lines,
    to_json,
    without_matplotlib,
    write_json,
)
from zmp_sqp.commands.exit_codes import DONE, INTERRUPTED, UNSAFE, Meanings
from zmp_sqp.commands.live import live_line
from zmp_sqp.commands.study_options import (
    Case,
    add_result_options,
    add_study_options,
    positive,
    run_study,
    write_csv,
)
from zmp_sqp.errors import ProblemError
from zmp_sqp.planning import Problem
from zmp_sqp.plots import save, tradeoff
from zmp_sqp.scenario import load_scenario
from zmp_sqp.show.study_tables import tradeoff_table

__all__ = ["TRADEOFF_FILES", "add_tradeoff", "run_tradeoff"]

TRADEOFF_FILES = ("tradeoff.csv", "tradeoff.png")
COUNT = 13  # margins by default
HALVINGS = 30  # of the search for the largest margin at rest
DESCRIPTION = """\
Plan a scenario for margins from none to the largest that start and goal allow, and show what the
distance of the ZMP from the edges of the support polygon costs in time.
"""
EXAMPLES = """\
examples:
  zmp-sqp tradeoff paper_1 --out out/tradeoff
  zmp-sqp tradeoff my_scenario.toml --largest 0.5 --count 11
"""
RESULT_KEYS = """\
tradeoff.csv and --json have one row per margin: plan.margin [m] that is asked for; success, status,
duration [s], lower_bound [s], margin [m] (guaranteed), message
"""


def add_tradeoff(commands: Any, shipped: str) -> None:
    """Add the command `tradeoff`.

    Args:
        commands: Subcommands of an argparse parser.
        shipped: Help text that lists the shipped scenarios.
    """
    command = add_command(
        commands,
        "tradeoff",
        run_tradeoff,
        summary="show duration against margin",
        description=DESCRIPTION,
        codes=Meanings("at least one margin has a safe motion", "none has"),
        notes=(EXAMPLES, RESULT_KEYS, shipped),
    )
    command.add_argument(
        "scenario", metavar="SCENARIO", help="a scenario file (TOML), or the name of a shipped one"
    )
    command.add_argument(
        "--largest",
        type=float,
        metavar="M",
        help="[m] largest margin (default: the largest that start and goal allow at rest)",
    )
    command.add_argument(
        "--count",
        type=positive,
        default=COUNT,
        metavar="N",
        help=f"number of margins (default: {COUNT})",
    )
    add_study_options(command)
    add_result_options(command, TRADEOFF_FILES)


def run_tradeoff(arguments: argparse.Namespace) -> int:
    """Plan, print and write; returns the exit code."""
    scenario = load_scenario(arguments.scenario)
    problem = replace(scenario.problem, margin=0.0)
    with live_line("largest margin at rest"):
        largest = _largest(problem) if arguments.largest is None else arguments.largest
    if not (np.isfinite(largest) and largest >= 0.0):
        raise ProblemError(f"the largest margin must be at least 0 m, not {largest:g} m")
    prepare_folder(arguments.out, TRADEOFF_FILES)
    margins = np.linspace(0.0, largest, arguments.count)
    cases = [_case(problem, float(margin)) for margin in margins]
    study = run_study(cases, arguments, "tradeoff")
    rows = _not_slower_than_larger_margins(study.rows)
    console = make_console(arguments.json)
    console.print(f"{scenario.name}: {scenario.title}", style="bold", soft_wrap=True)
    console.print(tradeoff_table(rows))
    if study.interrupted:
        console.print(study.ending, soft_wrap=True)
    if arguments.out is not None:
        print_lines(console, _write(arguments.out, rows, figures=arguments.figures))
    write_json(to_json({"rows": rows}), arguments.json, console)
    if study.interrupted:
        return INTERRUPTED
    return DONE if any(row["success"] for row in rows) else UNSAFE


def _not_slower_than_larger_margins(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows in which a faster motion with a larger guaranteed margin takes the place of a slower.

    A motion that keeps a margin keeps every smaller one.
    """
    best: Mapping[str, Any] | None = None
    kept: list[dict[str, Any]] = []
    for row in reversed(rows):
        if best is not None and (not row["success"] or row["duration"] > best["duration"]):
            asked = best["plan.margin"]
            message = f"{best['message']} The motion is that for a margin of {asked:.4g} m."
            kept.append({**best, "plan.margin": row["plan.margin"], "message": message})
        else:
            kept.append(dict(row))
        if row["success"] and (best is None or row["duration"] < best["duration"]):
            best = row
    return kept[::-1]


def _case(problem: Problem, margin: float) -> Case:
    values = {"plan.margin": margin}
    try:
        return Case(values, replace(problem, margin=margin))
    except ProblemError as fault:
        return Case(values, None, str(fault))


def _largest(problem: Problem) -> float:
    """Largest margin for which start and goal are accepted [m]."""
    support = problem.machine.support
    vertices: Array = np.zeros((1, 2)) if support is None else support.vertices
    low, high = 0.0, float(np.linalg.norm(np.ptp(vertices, axis=0)))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _case(problem, middle).problem is None:
            high = middle
        else:
            low = middle
    return low


def _write(folder: Path, rows: Sequence[Mapping[str, Any]], *, figures: bool) -> Iterator[str]:
    """Write the files of `--out`; yields a line about each."""
    write_csv(folder / "tradeoff.csv", rows)
    yield f"wrote {folder / 'tradeoff.csv'}"
    if figures:
        yield from without_matplotlib(_draw(folder / "tradeoff.png", rows))


def _draw(path: Path, rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    save(tradeoff(rows), path)
    yield f"wrote {path}"
