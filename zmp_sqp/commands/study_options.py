"""Options and output that the commands of studies share."""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.commands.console import add_json_option, add_out_option
from zmp_sqp.commands.content_hash import content_hash
from zmp_sqp.commands.executors import executor_at
from zmp_sqp.errors import ProblemError
from zmp_sqp.planning import Plan, Problem, table
from zmp_sqp.studies import plan_many
from zmp_sqp.studies.journal import Journal

__all__ = [
    "Case",
    "Study",
    "add_result_options",
    "add_study_options",
    "planned",
    "planning_options",
    "positive",
    "refused_row",
    "row_of",
    "run_study",
    "write_csv",
]

REFUSED = "refused"  # status of a case without a problem
CONTENT = "content"  # column of the hash of scenario and options, while a study runs
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
        can_resume: Whether its rows are kept, so that `--resume` can go on with it.
    """

    rows: list[dict[str, Any]]
    interrupted: bool
    can_resume: bool

    @property
    def ending(self) -> str:
        """How it was cut short, in words; empty if it was not."""
        if not self.interrupted:
            return ""
        how = "--resume plans what is left" if self.can_resume else "what is left is not planned"
        return f"interrupted: {how}"


def run_study(cases: Sequence[Case], arguments: argparse.Namespace, name: str) -> Study:
    """Plan all cases.

    With a folder for results, rows are written there as their plans are done, to
    `name`.part.jsonl, which `--resume` reads, and which goes when all are done.

    Args:
        cases: The cases.
        arguments: Options that `add_study_options` and `add_result_options` have added.
        name: Name of the study.

    Raises:
        ProblemError: `--resume` without a folder, or with a damaged file.
    """
    content = content_hash(arguments.scenario, planning_options(arguments))
    journal = _journal(arguments, name)
    known = {} if journal is None else _known(journal, content)
    rows = [known.get(_key(case.values)) or _refused(case) for case in cases]
    asked = [(i, case.problem) for i, case in enumerate(cases) if rows[i] is None]
    interrupted = False
    with journal or nullcontext():
        try:
            for number, plan in planned([one for _, one in asked if one is not None], arguments):
                i = asked[number][0]
                found = row_of("", plan)
                row = {**cases[i].values, **{key: found[key] for key in COLUMNS}}
                rows[i] = row
                if journal is not None:
                    journal.add({CONTENT: content, **row})
        except KeyboardInterrupt:
            interrupted = True
    if journal is not None and not interrupted:
        journal.path.unlink()
    done = [row for row in rows if row is not None]
    return Study(done, interrupted, can_resume=journal is not None)


def planned(
    problems: Sequence[Problem], arguments: argparse.Namespace
) -> Iterator[tuple[int, Plan]]:
    """Numbers and plans of problems, as they are done.

    Args:
        problems: The problems.
        arguments: Options that `add_study_options` has added.

    Raises:
        ProblemError: No scheduler answers at the address of `--dask`.
    """
    with executor_at(arguments.dask) as executor:
        yield from plan_many(
            problems,
            executor,
            as_completed=True,
            workers=arguments.workers,
            qp_solver=arguments.qp_solver,
            time_budget=arguments.time_budget,
        )


def planning_options(arguments: argparse.Namespace) -> str:
    """Options on which a plan depends, in words."""
    return f"{arguments.qp_solver} {arguments.time_budget}"


def _journal(arguments: argparse.Namespace, name: str) -> Journal | None:
    """File of rows for a run that may be cut short; None without a folder for results."""
    if arguments.out is None:
        if arguments.resume:
            raise ProblemError("--resume needs --out DIR, the folder of the interrupted run")
        return None
    path = arguments.out / f"{name}.part.jsonl"
    if not arguments.resume:
        path.unlink(missing_ok=True)
    return Journal(path, resume=arguments.resume)


def _known(journal: Journal, content: str) -> dict[tuple[Any, ...], dict[str, Any]]:
    """Rows of an earlier run of the same study, by the values of their cases."""
    journal.rows = [row for row in journal.rows if row.get(CONTENT) == content]
    found = ({k: v for k, v in row.items() if k != CONTENT} for row in journal.rows)
    return {_key({k: v for k, v in row.items() if k not in COLUMNS}): row for row in found}


def _key(values: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(sorted(values.items()))


def _refused(case: Case) -> dict[str, Any] | None:
    """Row of a case without a problem; None for any other."""
    if case.problem is not None:
        return None
    none = dict.fromkeys(COLUMNS)
    why = {"success": False, "status": REFUSED, "message": case.fault}
    return {**case.values, **none, **why}


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
    where = command.add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        type=positive,
        metavar="N",
        help="number of processes that plan (default: one per processor)",
    )
    where.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="plan on the workers of this Dask scheduler, such as tcp://host:8786, instead of "
        "local processes (extra `cluster`)",
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
    command.add_argument(
        "--resume",
        action="store_true",
        help="go on with an interrupted run of the same study: plan only what it left in --out DIR",
    )
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
