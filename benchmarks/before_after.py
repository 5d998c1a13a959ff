"""The planner now against the planner of an earlier commit: both in one run, problem by problem.

    python -m benchmarks.before_after --before COMMIT [--sets NAME ...] [--json FILE]
    python -m benchmarks.before_after --docs

Each side runs in a process of its own. They take turns: a problem is planned by one, then by the
other, so that what else the computer does weighs on both alike. Times are processor times in F,
which is measured before and after each plan on its own side; the certificate is included.
Plans of less than 0.5 s are made 3 times, those of less than 0.05 s 15 times; the median counts.

Sets: scenarios; hard (120 problems of `random_problems --hard`; active are those whose motion takes
0.1 % longer than the bound); fine (active hard ones at 200 intervals); drives; terrain; uncertain
(all of payload and slope); infeasible. The earlier planner is asked fewer problems of the slow
sets. --docs makes the table of docs/speed.md from benchmarks/results/before_after.json. The exit
code is 1 where the planner of today misses a target.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import zmp_sqp as zs
from benchmarks.harness import (
    Row,
    benchmark_parser,
    console,
    exit_code,
    measure_F,
    print_table,
    save_json,
    timed,
)
from benchmarks.problems.arm import HARD, ROBUST, random_problem
from benchmarks.problems.blocked import blocked_problem
from benchmarks.problems.driving import random_driving_problem
from benchmarks.problems.terrain import random_drive_problem
from benchmarks.robust_problems import UNCERTAIN
from zmp_sqp.scenario import load_scenario

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results" / "before_after.json"
PAGE = ROOT / "docs" / "speed.md"
BEGIN, END = "<!-- made by python -m benchmarks.before_after --docs -->", "<!-- end of table -->"

HARD_SEEDS = (*range(40), *range(200, 240), *range(1000, 1040))
UNCERTAIN_SEEDS = range(5000, 5060)
SETS: dict[str, Sequence[Any]] = {
    "scenarios": ("paper_1", "paper_1_simplified", "retreat"),
    "hard": HARD_SEEDS,
    "fine": HARD_SEEDS,
    "drives": range(100),
    "terrain": range(100),
    "uncertain": UNCERTAIN_SEEDS,
    "infeasible": range(40),
}
ACTIVE = 1.001  # times the bound: tip-over costs time
ACTIVE_UNCERTAIN = 1.01
REPEATS = ((0.05, 15), (0.5, 3))  # a plan that takes less [s] is made so many times
LONGEST = 150.0  # [s] that the earlier planner may take for a problem
FINE = 12  # active problems at 200 intervals
# how many problems of a set the earlier planner is asked, which may take minutes for one
FEW_BEFORE = {"fine": 3, "drives": 40, "terrain": 25, "uncertain": 10, "infeasible": 8}
COLUMNS = ("set", "name", "side", "status", "duration", "lower_bound", "iterations", "F")


# --- one side ------------------------------------------------------------------------------------


def problem_of(name: str, which: Any) -> zs.Problem | None:
    """A problem; None where there is none of this name."""
    if name == "scenarios":
        return load_scenario(which).problem
    if name in ("hard", "fine"):
        found = random_problem(which, HARD).problem
        return replace(found, intervals=200) if name == "fine" else found
    if name == "drives":
        return random_driving_problem(which).problem
    if name == "terrain":
        return random_drive_problem(which, over_terrain=True)
    if name == "uncertain":
        try:
            return replace(random_problem(which, ROBUST).problem, **UNCERTAIN)
        except zs.ProblemError:
            return None
    return blocked_problem(which)


def answer(name: str, which: Any) -> Row | None:
    """Plan of one problem and its time in F."""
    problem = problem_of(name, which)
    if problem is None:
        return None
    units = [measure_F(problem.machine, repeats=9)]
    plan, took = timed(lambda: zs.plan(problem, time_budget=LONGEST))
    seconds = [took.processor]
    units.append(measure_F(problem.machine, repeats=9))
    while any(len(seconds) < count and min(seconds) < below for below, count in REPEATS):
        seconds.append(timed(lambda: zs.plan(problem))[1].processor)
        units.append(measure_F(problem.machine, repeats=9))
    F = 0.5 * (np.array(units[:-1]) + units[1:])  # of each plan, because it wanders
    return {
        "status": plan.status.name,
        "duration": plan.duration if plan.success else None,
        "lower_bound": plan.lower_bound,
        "iterations": plan.iterations,
        "F": float(np.median(np.array(seconds) / F)),
    }


def work() -> None:
    """Answer questions on standard input, one JSON line each, until it ends."""
    for line in sys.stdin:
        name, which = json.loads(line)
        print(json.dumps(answer(name, which)), flush=True)


class Side:
    """A process that plans with one version of the package."""

    def __init__(self, label: str, package: Path) -> None:
        """Start it.

        Args:
            label: "before" or "now".
            package: Folder that holds `zmp_sqp`.
        """
        self.label = label
        path = os.pathsep.join([str(package), str(ROOT)])
        environment = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.before_after", "--work"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**environment, "OPENBLAS_NUM_THREADS": "1"},
            cwd=package,
        )

    def ask(self, name: str, which: Any) -> Row | None:
        """Answer to one problem."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps([name, which]) + "\n")
        self._process.stdin.flush()
        found = json.loads(self._process.stdout.readline())
        return found and {"set": name, "name": str(which), "side": self.label, **found}

    def close(self) -> None:
        """End it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


# --- both sides ----------------------------------------------------------------------------------


def measured(names: Sequence[str], before: Side, now: Side) -> Iterator[Row]:
    """Rows of both sides, problem by problem."""
    active: list[int] = []
    for name in names:
        asked = SETS[name]
        if name == "fine":
            asked = active[:FINE]
        for i, which in enumerate(asked):
            answers = [now.ask(name, which)]
            if answers[0] is not None and i < FEW_BEFORE.get(name, len(asked)):
                answers.append(before.ask(name, which))
            for row in answers:
                if row is not None:
                    yield row
            if name == "hard" and answers[0] is not None and _is_active(answers[0], ACTIVE):
                active.append(which)
        console.print(f"{name}: {len(asked)} problems done")


def _is_active(row: Row, share: float) -> bool:
    return row["duration"] is not None and row["duration"] > share * row["lower_bound"]


def _quantiles(rows: Sequence[Row]) -> dict[str, float]:
    F = [row["F"] for row in rows]
    if not F:
        return {}
    return {"median": np.median(F), "90 %": np.quantile(F, 0.9), "max": np.max(F)}


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Figures of the table, by line."""
    sides: dict[str, dict[tuple[str, str], Row]] = {"before": {}, "now": {}}
    for row in rows:
        sides[row["side"]][row["set"], row["name"]] = row

    def of(kind: str, wanted: Callable[[str], bool]) -> dict[str, Any]:
        found = {
            side: [row for (name, which), row in by.items() if name == kind and wanted(which)]
            for side, by in sides.items()
        }
        return {side: {"count": len(part), **_quantiles(part)} for side, part in found.items()}

    def active(kind: str, share: float) -> set[str]:
        return {
            which
            for (name, which), row in sides["now"].items()
            if name == kind and _is_active(row, share)
        }

    tipping, slow_drives = active("hard", ACTIVE), active("drives", ACTIVE)
    lines = {
        **{
            name: of("scenarios", lambda which, name=name: which == name)
            for name in SETS["scenarios"]
        },
        "hard, active": of("hard", lambda which: which in tipping),
        "hard, the others": of("hard", lambda which: which not in tipping),
        "the active ones at N = 200": of("fine", lambda which: True),
        "drives, active": of("drives", lambda which: which in slow_drives),
        "drives": of("drives", lambda which: True),
        "terrain": of("terrain", lambda which: True),
        "uncertain, active": of(
            "uncertain", lambda which: which in active("uncertain", ACTIVE_UNCERTAIN)
        ),
        "infeasible": of("infeasible", lambda which: True),
    }
    return {"lines": lines, "durations": _durations(sides), "finer": _finer(sides, tipping)}


def _durations(sides: Mapping[str, Mapping[tuple[str, str], Row]]) -> dict[str, Any]:
    """How durations changed, by set, in per cent."""
    found: dict[str, Any] = {}
    for name in SETS:
        changes, lost = [], 0
        for key, before in sides["before"].items():
            now = sides["now"].get(key)
            if key[0] != name or now is None or before["duration"] is None:
                continue
            if now["duration"] is None:
                lost += 1
            elif before["duration"] > 0.0:
                changes.append(100.0 * (now["duration"] / before["duration"] - 1.0))
        if changes:
            found[name] = {
                "mean": float(np.mean(changes)),
                "worst": float(np.max(changes)),
                "no longer solved": lost,
            }
    return found


def _finer(sides: Mapping[str, Mapping[tuple[str, str], Row]], tipping: set[str]) -> dict[str, Any]:
    """Times at 200 intervals over those at 50, medians."""
    found = {}
    for side, by in sides.items():
        ratios = [
            row["F"] / by["hard", which]["F"]
            for (name, which), row in by.items()
            if name == "fine" and which in tipping
        ]
        if ratios:
            found[side] = float(np.median(ratios))
    return found


# --- tables --------------------------------------------------------------------------------------

# line of the table: what it is called, what is shown of it, and at most how much of each [F]
LINES: dict[str, tuple[str, tuple[str, ...], tuple[float, ...]]] = {
    "paper_1": ("`paper_1`", ("median",), (35,)),
    "paper_1_simplified": ("`paper_1_simplified`", ("median",), (20,)),
    "retreat": ("`retreat`", ("median",), (90,)),
    "hard, active": ("hard, tip-over active", ("median", "90 %", "max"), (250, 450, 1000)),
    "hard, the others": ("hard, the others", ("median",), (55,)),
    "drives, active": ("drives, limits active", ("median", "90 %"), (400, np.inf)),
    "drives": ("100 random drives", ("90 %",), (500,)),
    "terrain": ("100 drives over terrain", ("90 %",), (900,)),
    "uncertain, active": ("payload and slope uncertain, active", ("median",), (1000,)),
    "infeasible": ("infeasible", ("max",), (1500,)),
}


def table(found: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Rows: problems, before [F], now [F], asked for."""
    rows = []
    for name, (called, shown, asked) in LINES.items():
        sides = found["lines"].get(name, {})
        if not sides.get("now", {}).get("count"):
            continue
        texts = [
            " / ".join(f"{sides[side][key]:.0f}" if key in sides[side] else "-" for key in shown)
            for side in ("before", "now")
        ]
        limits = " / ".join("-" if np.isinf(most) else f"{most:.0f}" for most in asked)
        kind = f" ({', '.join(shown)})" if name not in SETS["scenarios"] else ""
        rows.append((f"{called}{kind}", *texts, limits))
    return rows


def page_table(found: Mapping[str, Any]) -> str:
    """Text of the page from the first mark to the last."""
    lines = ["| time of a plan [F] | before | now | asked for |", "| --- | --: | --: | --: |"]
    lines += [f"| {' | '.join(row)} |" for row in table(found)]
    return "\n".join([BEGIN, "", *lines, "", END])


def write_page() -> None:
    """Put the table of the recorded results into docs/speed.md."""
    text, pattern = PAGE.read_text(encoding="utf-8"), re.compile(f"{BEGIN}.*?{END}", re.DOTALL)
    if len(pattern.findall(text)) != 1:
        raise SystemExit(f"{PAGE.relative_to(ROOT)} must hold {BEGIN} ... {END} once")
    found = page_table(json.loads(RESULTS.read_text(encoding="utf-8")))
    PAGE.write_text(pattern.sub(lambda _: found, text), encoding="utf-8")


def missed(found: Mapping[str, Any]) -> list[str]:
    """Targets that the planner of today misses."""
    return [
        f"{name}: {key} {found['lines'][name]['now'][key]:.0f} F, asked for {most:.0f}"
        for name, (_, shown, asked) in LINES.items()
        for key, most in zip(shown, asked, strict=True)
        if found["lines"].get(name, {}).get("now", {}).get(key, 0.0) > most
    ]


def checkout(commit: str, folder: Path) -> Path:
    """Folder with the package of a commit, and nothing else that could be imported."""
    tree, package = folder / "tree", folder / "package"
    packed = subprocess.run(
        ["git", "archive", commit, "zmp_sqp", "urdf"], cwd=ROOT, check=True, stdout=subprocess.PIPE
    )
    tree.mkdir()
    subprocess.run(["tar", "-x", "-C", str(tree)], input=packed.stdout, check=True)
    package.mkdir()
    for name in ("zmp_sqp", "urdf"):
        (package / name).symlink_to(tree / name)
    return package


def parser() -> argparse.ArgumentParser:
    """Command line."""
    found = benchmark_parser(__doc__)
    found.add_argument("--before", metavar="COMMIT", help="the earlier planner")
    found.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS), metavar="NAME")
    found.add_argument("--docs", action="store_true", help="make the table of docs/speed.md")
    found.add_argument("--readme", action="store_true", dest="docs", help=argparse.SUPPRESS)
    found.add_argument("--work", action="store_true", help=argparse.SUPPRESS)
    return found


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; returns the exit code."""
    asked = parser()
    options = asked.parse_args(arguments)
    if options.work:
        work()
        return 0
    if options.docs:
        write_page()
        return 0
    if options.before is None:
        asked.error("--before COMMIT is needed")
    with tempfile.TemporaryDirectory() as folder:
        before = Side("before", checkout(options.before, Path(folder)))
        now = Side("now", ROOT)
        rows = list(measured(options.sets, before, now))
        for side in (before, now):
            side.close()
    found = summary(rows)
    print_table("time of a plan", ("problems", "before [F]", "now [F]", "asked for"), table(found))
    console.print(f"durations, per cent: {found['durations']}")
    console.print(f"time at 200 intervals over that at 50: {found['finer']}")
    for line in missed(found):
        console.print(f"missed: {line}", style="bold")
    if options.json:
        content = {"before": options.before, **found}
        save_json(options.json, content, rows=rows, columns=COLUMNS, digits=6)
    return exit_code(success=not missed(found))


if __name__ == "__main__":
    sys.exit(main())
