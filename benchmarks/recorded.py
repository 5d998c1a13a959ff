"""Record the results of seeded problems, and compare later ones: does a change of the code matter?

    python -m benchmarks.recorded --record FILE [--qp-solver NAME]
    python -m benchmarks.recorded --compare FILE [--tolerance 1e-9] [--qp-solver NAME]

The problems are all shipped scenarios, and of benchmarks/problems 40 ordinary and 40 hard ones of
the arm, 20 of base and arm on a slope, and 10 over a heightmap. A record holds status, duration,
certified margin, iterations and processor time of each. On the same computer, with the same
versions of all packages, the same code gives exactly equal results.

The exit code is 1 where a status has changed, where a duration differs by more than the tolerance,
or where a recorded problem no longer exists.
"""

from __future__ import annotations

import json
import math
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import zmp_sqp as zs
from benchmarks.harness import (
    Row,
    benchmark_parser,
    console,
    exit_code,
    measure_F,
    print_table,
    provenance,
    save_json,
    timed_plan,
)
from benchmarks.problems.arm import HARD, ORDINARY, Recipe, random_problem
from benchmarks.problems.driving import random_driving_problem
from benchmarks.problems.paper import paper_1
from benchmarks.problems.terrain import random_drive_problem
from zmp_sqp.scenario import load_scenario, shipped_scenarios

__all__ = ["Difference", "compare", "failed", "plan_all", "problems"]

COLUMNS = ("name", "status", "duration", "margin", "iterations", "seconds")
EXACT = ("status", "duration", "margin", "iterations")  # columns compared digit by digit
CLOSE = 1e-9  # relative: durations that differ by no more count as close
EQUAL, WITHIN, MORE = "exactly equal", f"within {CLOSE:g}", "more"
Rows = Mapping[str, Row]  # results by name of the problem


def problems() -> Iterator[tuple[str, Callable[[], zs.Problem]]]:
    """Names of all problems, with functions that make them."""
    for name in shipped_scenarios():
        yield f"scenario {name}", partial(_scenario, name)
    for recipe in (ORDINARY, HARD):
        for seed in range(40):
            yield f"{recipe.name} {seed}", partial(_arm, seed, recipe)
    for seed in range(20):
        yield f"driving {seed}", partial(_driving, seed)
    for seed in range(10):
        yield f"terrain {seed}", partial(random_drive_problem, seed, over_terrain=True)


def _scenario(name: str) -> zs.Problem:
    return load_scenario(name).problem


def _arm(seed: int, recipe: Recipe) -> zs.Problem:
    return random_problem(seed, recipe).problem


def _driving(seed: int) -> zs.Problem:
    return random_driving_problem(seed).problem


def result(name: str, make: Callable[[], zs.Problem], qp_solver: str) -> Row:
    """Plan one problem. If it is refused, its status is the name of the error."""
    try:
        plan, row = timed_plan(make(), qp_solver)
    except zs.ZmpSqpError as error:
        return {
            "name": name,
            "status": type(error).__name__,
            "duration": math.nan,
            "margin": math.nan,
            "iterations": 0,
            "seconds": 0.0,
        }
    return {"name": name, **row, "margin": plan.margin}


def plan_all(qp_solver: str) -> tuple[Rows, float]:
    """Results of all problems, and F [s] before and after, in the mean."""
    machine = paper_1().problem.machine
    before, rows = measure_F(machine), {}
    for name, make in problems():
        rows[name] = row = result(name, make, qp_solver)
        console.print(f"{name}: {row['status']}, {row['duration']:.4f} s", style="dim")
    return rows, 0.5 * (before + measure_F(machine))


@dataclass(frozen=True)
class Difference:
    """Result of a problem beside the recorded one."""

    name: str
    recorded: Row
    now: Row

    @property
    def relative(self) -> float:
        """Relative difference of the durations; zero if neither has one, infinite if one has."""
        before, after = self.recorded["duration"], self.now["duration"]
        if before == after or (math.isnan(before) and math.isnan(after)):
            return 0.0
        difference = abs(after - before) / abs(before) if before else math.inf
        return math.inf if math.isnan(difference) else difference

    @property
    def verdict(self) -> str:
        """EQUAL where no digit of any column has changed; otherwise WITHIN or MORE."""
        if all(repr(self.recorded[key]) == repr(self.now[key]) for key in EXACT):
            return EQUAL
        same_status = self.recorded["status"] == self.now["status"]
        return WITHIN if same_status and self.relative <= CLOSE else MORE


def compare(recorded: Rows, now: Rows) -> list[Difference]:
    """Both results of every problem that both have, in the order of the record."""
    return [Difference(name, row, now[name]) for name, row in recorded.items() if name in now]


def failed(recorded: Rows, now: Rows, tolerance: float) -> list[str]:
    """Names of problems that are missing, or whose status or duration has changed."""
    changed = [
        pair.name
        for pair in compare(recorded, now)
        if pair.recorded["status"] != pair.now["status"] or pair.relative > tolerance
    ]
    return [name for name in recorded if name not in now] + changed


def print_differences(pairs: Sequence[Difference]) -> None:
    """Print recorded and present columns of the problems whose results differ."""
    print_table(
        "results that differ: recorded, now",
        ("problem", "verdict", "relative", *EXACT),
        [
            [
                pair.name,
                pair.verdict,
                f"{pair.relative:.1e}",
                *(f"{pair.recorded[key]}\n{pair.now[key]}" for key in EXACT),
            ]
            for pair in pairs
            if pair.verdict != EQUAL
        ],
    )


def report(recorded: Rows, now: Rows, F: tuple[float, float]) -> None:
    """Print what differs, the sums of durations, and how the time for planning has changed.

    Args:
        recorded: Results of the record.
        now: Present results.
        F: Of the record and now [s].
    """
    pairs = compare(recorded, now)
    print_differences(pairs)
    for title, one, other in (("missing", recorded, now), ("not recorded", now, recorded)):
        names = ", ".join(name for name in one if name not in other)
        if names:
            console.print(f"{title}: {names}")
    counts = Counter(pair.verdict for pair in pairs)
    shares = ", ".join(f"{counts[verdict]} {verdict}" for verdict in (EQUAL, WITHIN, MORE))
    console.print(f"{len(pairs)} results compared: {shares}")

    finite = [pair for pair in pairs if math.isfinite(pair.relative)]
    durations = [
        math.fsum(row["duration"] for row in rows if not math.isnan(row["duration"]))
        for rows in ([pair.recorded for pair in finite], [pair.now for pair in finite])
    ]
    console.print(
        f"sum of durations: recorded {durations[0]:.9f} s, now {durations[1]:.9f} s, "
        f"difference {durations[1] - durations[0]:+.3g} s"
    )
    seconds = [
        math.fsum(row["seconds"] for row in rows)
        for rows in ([pair.recorded for pair in pairs], [pair.now for pair in pairs])
    ]
    if min(*seconds, *F) > 0.0:
        ratio = seconds[1] / seconds[0]
        console.print(
            f"total time: recorded {seconds[0]:.2f} s, now {seconds[1]:.2f} s, ratio {ratio:.3f}; "
            f"in F, ratio {ratio * F[0] / F[1]:.3f}"
        )


def read(path: Path) -> tuple[Rows, dict[str, Any]]:
    """Results of a record by name, and its other entries."""
    content = json.loads(path.read_text(encoding="utf-8"))
    rows = (dict(zip(content["columns"], row, strict=True)) for row in content.pop("rows"))
    return {row["name"]: row for row in rows}, content


def warn_of_versions(recorded: Mapping[str, str]) -> None:
    """Print which package versions are not those of the record: they may explain differences."""
    for package, version in provenance()["versions"].items():
        was = recorded.get(package)
        if was != version:
            console.print(f"{package}: recorded {was}, now {version}", style="bold", markup=False)


def main() -> int:
    parser = benchmark_parser(__doc__, qp_solver=True, results=False)
    task = parser.add_mutually_exclusive_group(required=True)
    task.add_argument("--record", type=Path, metavar="FILE", help="plan, and write all results")
    task.add_argument("--compare", type=Path, metavar="FILE", help="plan, and compare with these")
    parser.add_argument(
        "--tolerance",
        type=float,
        default=CLOSE,
        help=f"largest relative difference of a duration that is no failure (default {CLOSE:g})",
    )
    options = parser.parse_args()
    if options.record is not None:
        rows, F = plan_all(options.qp_solver)
        content = {"qp_solver": options.qp_solver, "F_seconds": F}
        save_json(options.record, content, rows=list(rows.values()), columns=COLUMNS)
        return exit_code(success=True)

    recorded, content = read(options.compare)
    warn_of_versions(content["versions"])
    if content["qp_solver"] != options.qp_solver:
        parser.error(f"recorded with --qp-solver {content['qp_solver']}")
    now, F = plan_all(options.qp_solver)
    report(recorded, now, (content["F_seconds"], F))
    names = failed(recorded, now, options.tolerance)
    if names:
        console.print(f"changed: {', '.join(names)}", style="bold")
    return exit_code(success=not names)


if __name__ == "__main__":
    sys.exit(main())
