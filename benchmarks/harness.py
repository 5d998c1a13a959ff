"""What all benchmarks share: options, timing, the unit F, tables, JSON, exit codes.

Times are processor times, which other programs on the computer disturb less than wall times. F is
the time of 100 calls of `pin.computeRNEADerivatives` on the machine's model; times in F can be
compared between computers.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.table import Table
from rich.text import Text

import zmp_sqp as zs
from zmp_sqp.versions import installed_versions

__all__ = [
    "Timing",
    "benchmark_parser",
    "console",
    "distribution",
    "exit_code",
    "measure_F",
    "near_bound",
    "print_distributions",
    "print_slowest",
    "print_table",
    "provenance",
    "run_all",
    "save_json",
    "seeds",
    "timed",
    "timed_plan",
    "versions",
]

T = TypeVar("T")
Row = dict[str, Any]  # result of one problem, by column

PEERS = (
    "clarabel",
    "casadi",
    "drake",
    "mujoco",
    "toppra",
)  # packages that only benchmarks compare with
EVALUATIONS = 100  # calls in one F: both ends of 50 intervals
QUANTILES = (
    ("min", 0),
    ("25 %", 25),
    ("50 %", 50),
    ("75 %", 75),
    ("90 %", 90),
    ("99 %", 99),
    ("max", 100),
)
SLOWEST = 5  # rows in the table of the problems with the most iterations

console = Console(width=140, highlight=False)

# --- options -------------------------------------------------------------------------------------


def benchmark_parser(
    description: str | None,
    *,
    count: int | None = None,
    qp_solver: bool = False,
    results: bool = True,
) -> argparse.ArgumentParser:
    """Command line of a benchmark, to which it may add options of its own.

    Args:
        description: Docstring of the module.
        count: Default number of problems. Adds --count and --first; without it there are none.
        qp_solver: Adds --qp-solver.
        results: Adds --json.
    """
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    if count is not None:
        parser.add_argument(
            "--count", type=int, default=count, help=f"number of problems (default {count})"
        )
        parser.add_argument("--first", type=int, default=0, help="seed of the first (default 0)")
    if qp_solver:
        parser.add_argument("--qp-solver", default="auto", help="default: auto")
    if results:
        parser.add_argument("--json", type=Path, metavar="FILE", help="write all results here")
    return parser


def seeds(options: argparse.Namespace) -> range:
    """Seeds that --first and --count ask for."""
    return range(options.first, options.first + options.count)


def exit_code(*, success: bool) -> int:
    """Exit code of a benchmark: 0 where every expectation holds, 1 otherwise."""
    return 0 if success else 1


# --- timing --------------------------------------------------------------------------------------


class Timing(NamedTuple):
    """Duration of a call."""

    processor: float  # [s] processor time of this process
    wall: float  # [s]


def timed(call: Callable[[], T]) -> tuple[T, Timing]:
    """Result of a call without arguments, and how long it took."""
    processor, wall = time.process_time(), time.perf_counter()
    result = call()
    return result, Timing(time.process_time() - processor, time.perf_counter() - wall)


def timed_plan(problem: zs.Problem, qp_solver: str = "auto") -> tuple[zs.Plan, Row]:
    """Plan of a problem, and the columns that the tables of all benchmarks share."""
    plan, took = timed(lambda: zs.plan(problem, qp_solver=qp_solver))
    return plan, {
        "status": plan.status.name,
        "iterations": plan.iterations,
        "seconds": round(took.processor, 5),
        "duration": plan.duration,
        "lower_bound": plan.lower_bound,
        "message": plan.message,
    }


def measure_F(machine: zs.Machine, *, repeats: int = 51) -> float:
    """F [s]: processor time of 100 calls of `pin.computeRNEADerivatives`, median of the repeats."""
    model, data, rng = machine.model, machine.model.createData(), np.random.default_rng(0)
    q = machine.configuration(rng.uniform(-1.0, 1.0, (EVALUATIONS, machine.size)))
    v, a = rng.uniform(-1.0, 1.0, (2, EVALUATIONS, model.nv))
    states, evaluate = list(zip(q, v, a, strict=True)), pin.computeRNEADerivatives

    def evaluate_all() -> None:
        for one_q, one_v, one_a in states:
            evaluate(model, data, one_q, one_v, one_a)

    return float(np.median([timed(evaluate_all)[1].processor for _ in range(repeats)]))


def run_all(
    run: Callable[[int], Row], seeds: Iterable[int], machine: zs.Machine
) -> tuple[list[Row], float]:
    """Results of all seeds, and F [s].

    F is the mean of two measurements, before and after, because it varies with the load of the
    computer.

    Args:
        run: Plans the problem of a seed. One that is not `solved` is printed at once.
        seeds: Of the problems.
        machine: F is measured on its model.
    """
    before, rows = measure_F(machine), []
    for seed in seeds:
        row = run(seed)
        if not row["solved"]:
            console.print(f"seed {seed} not solved: {row}", style="bold", markup=False)
        rows.append(row)
    return rows, 0.5 * (before + measure_F(machine))


# --- tables --------------------------------------------------------------------------------------


def near_bound(rows: Iterable[Row], tolerance: float) -> int:
    """Number of solved problems whose duration exceeds its lower bound by at most a share."""
    return sum(
        row["solved"] and row["duration"] <= (1.0 + tolerance) * row["lower_bound"] for row in rows
    )


def distribution(values: Sequence[float]) -> dict[str, float]:
    """Quantiles by name, from the least value to the largest."""
    return {name: float(np.percentile(values, share)) for name, share in QUANTILES}


def print_distributions(rows: Sequence[Row], F: float) -> dict[str, dict[str, float]]:
    """Print quantiles of iterations and of the time in F, and return them for the JSON file."""
    iterations = distribution([row["iterations"] for row in rows])
    in_F = distribution([row["seconds"] / F for row in rows])
    print_table(
        "distribution",
        ("", *iterations),
        [("iterations", *iterations.values()), ("time [F]", *in_F.values())],
    )
    return {"iterations": iterations, "time_in_F": in_F}


def print_slowest(rows: Sequence[Row], columns: Sequence[str]) -> None:
    """Print these columns of the problems with the most iterations."""
    slowest = sorted(rows, key=lambda row: -row["iterations"])[:SLOWEST]
    print_table(
        "most iterations",
        ("seed", *columns),
        [[str(row["seed"]), *(row[key] for key in columns)] for row in slowest],
    )


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Print one table; the first column is left-aligned, the others right-aligned."""
    # Text, because rich would read the unit [s] as a style
    table = Table(title=Text(title), title_justify="left")
    for i, column in enumerate(columns):
        table.add_column(Text(column), justify="left" if i == 0 else "right")
    for row in rows:
        entries = (entry if isinstance(entry, str) else f"{entry:.4g}" for entry in row)
        table.add_row(*map(Text, entries))
    console.print(table)


# --- files ---------------------------------------------------------------------------------------


def versions() -> dict[str, str]:
    """Computer, and versions of Python and of the packages that were measured."""
    return {
        "machine": f"{platform.system()} {platform.machine()}",
        **installed_versions(*PEERS),
    }


def provenance() -> dict[str, Any]:
    """Date, load of the computer and versions, which every file of results starts with.

    A load above the number of processors means that other programs were running.
    """
    load = [round(share, 2) for share in os.getloadavg()]
    return {"date": time.strftime("%Y-%m-%d"), "load": load, "versions": versions()}


def save_json(
    path: Path,
    content: Mapping[str, Any],
    *,
    rows: Sequence[Row] = (),
    columns: Sequence[str] = (),
    digits: int | None = None,
) -> None:
    """Write content and rows with date, load of the computer and versions.

    Args:
        path: File to write.
        content: Summary.
        rows: Each becomes one line, so that two files can be compared by `diff`.
        columns: Keys of a row that are written, in this order.
        digits: Decimals of numbers in rows; None: all.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    named = {"columns": columns} if columns else {}
    head = json.dumps({**provenance(), **content, **named}, indent=1).removesuffix("\n}")

    def entry(value: Any) -> Any:
        return round(value, digits) if digits and isinstance(value, float) else value

    lines = [json.dumps([entry(row[key]) for key in columns]) for row in rows]
    body = ",\n".join(f"  {line}" for line in lines)
    path.write_text(f'{head},\n "rows": [\n{body}\n ]\n}}\n', encoding="utf-8")
    console.print(f"written to {path}")
