"""Options and output that the commands of studies share."""

from __future__ import annotations

import argparse
import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.commands.console import add_json_option, add_out_option
from zmp_sqp.planning import Plan, Problem, table
from zmp_sqp.studies import plan_many

__all__ = [
    "Case",
    "Study",
    "add_result_options",
    "add_study_options",
    "positive",
    "refused_row",
    "row_of",
    "run_study",
    "write_csv",
]

REFUSED = "refused"  # status of a case without a problem
COLUMNS = ("success", "status", "duration", "lower_bound", "margin", "message")


@dataclass(frozen=True, slots=True)
class Case:
    """One case of a study.

    Attributes:
        values: Numbers that tell it from the others, by key.
        problem: Its problem; None where there is none, because start or goal are impossible.
        fault: Why there is none.
    """

    values: Mapping[str, float]
    problem: Problem | None
    fault: str = ""


@dataclass(frozen=True, slots=True)
class Study:
    """Results of a study.

    Attributes:
        rows: Values and results of each case, in order; those of an interrupted run up to then.
        interrupted: Whether Ctrl-C has ended it.
    """

    rows: list[dict[str, Any]]
    interrupted: bool


def run_study(cases: Sequence[Case], arguments: argparse.Namespace) -> Study:
    """Plan all cases.

    Args:
        cases: The cases.
        arguments: Options that `add_study_options` has added.
    """
    rows: list[dict[str, Any] | None] = [
        None
        if case.problem is not None
        else {
            **case.values,
            **dict.fromkeys(COLUMNS),
            "success": False,
            "status": REFUSED,
            "message": case.fault,
        }
        for case in cases
    ]
    asked = [(i, case.problem) for i, case in enumerate(cases) if case.problem is not None]
    plans = plan_many(
        [problem for _, problem in asked],
        as_completed=True,
        workers=arguments.workers,
        qp_solver=arguments.qp_solver,
        time_budget=arguments.time_budget,
    )
    interrupted = False
    try:
        for number, plan in plans:
            i = asked[number][0]
            found = row_of("", plan)
            rows[i] = {**cases[i].values, **{key: found[key] for key in COLUMNS}}
    except KeyboardInterrupt:
        interrupted = True
    return Study([row for row in rows if row is not None], interrupted)


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows of a study, with 17 significant digits."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]) if rows else [])
        writer.writeheader()
        for row in rows:
            writer.writerow({key: _exact(value) for key, value in row.items()})


def _exact(value: Any) -> Any:
    return f"{value:.17g}" if isinstance(value, float) else value


def add_study_options(command: argparse.ArgumentParser) -> None:
    """Add options of planning many problems."""
    command.add_argument(
        "--workers",
        type=positive,
        metavar="N",
        help="number of processes that plan (default: one per processor)",
    )
    command.add_argument(
        "--qp-solver",
        default="auto",
        metavar="NAME",
        help="auto, piqp, proxqp or qpsolvers:NAME (default: auto)",
    )
    command.add_argument(
        "--time-budget",
        type=float,
        metavar="S",
        help="[s] for each plan (default: no limit)",
    )


def add_result_options(command: argparse.ArgumentParser, files: Sequence[str]) -> None:
    """Add options of what a study writes: its files, JSON, and whether there are figures."""
    add_out_option(command, files)
    add_json_option(command)
    command.add_argument(
        "--no-figures", dest="figures", action="store_false", help="write no figure"
    )


def positive(text: str) -> int:
    """Whole number of at least 1."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return value


def row_of(name: str, plan: Plan) -> dict[str, Any]:
    """Row of a plan in the table of a study: plain Python values, None where there is none."""
    columns: Mapping[str, Any] = table({name: plan})
    return {key: _plain(column[0]) for key, column in columns.items()}


def refused_row(name: str, message: str) -> dict[str, Any]:
    """Row like those of `row_of` for what cannot be planned, with the reason as message."""
    values = {"name": name, "success": False, "status": REFUSED, "message": message}
    return {**dict.fromkeys(table({})), **values}


def _plain(value: Any) -> Any:
    plain = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(plain, float) and not np.isfinite(plain) else plain
