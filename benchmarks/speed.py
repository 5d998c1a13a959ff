"""How long planning takes, in F: 100 calls of pin.computeRNEADerivatives on the same model in the same process.

    python -m benchmarks.speed [--repeats 15] [--json FILE]

F is the project's measure of speed: times depend on the computer, ratios hold. Both are processor
time, which other programs on the same computer disturb less; wall time stands beside it and is the
same on an idle one. Every call is cold: no motion, multiplier or workspace of an earlier call is
used. "In a new process" is a call that has imported nothing before, so that it loads Pinocchio and
the QP solver on the way; all other rows are medians of many calls.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import zmp_sqp as zs
from benchmarks.harness import console, measure_F, print_table, save_json
from benchmarks.problems.arm import random_problem
from benchmarks.problems.paper import paper_1
from benchmarks.problems.scene import NamedProblem
from zmp_sqp.planning.search import planner
from zmp_sqp.scenario import load_scenario

BACKENDS = ("proxqp", "piqp", "qpsolvers:piqp", "qpsolvers:daqp", "qpsolvers:clarabel")
# F that the project asks for with the default QP solver, by scenario
ASKED = {"paper_1": 100.0, "paper_1_simplified": 60.0, "retreat": 300.0}
FIRST = """
import json, time
started = time.perf_counter()
import zmp_sqp as zs
imported = time.perf_counter()
from zmp_sqp.scenario import load_scenario
problem = load_scenario("paper_1").problem
loaded = time.perf_counter()
first = zs.plan(problem)
planned = time.perf_counter()
print(json.dumps([imported - started, loaded - imported, planned - loaded]))
"""


def first_call() -> dict[str, float]:
    """Seconds of importing, loading and the first plan, in a process of its own."""
    answer = subprocess.run(
        [sys.executable, "-c", FIRST], capture_output=True, check=True, text=True
    )
    return dict(
        zip(("import", "load scenario", "first plan"), json.loads(answer.stdout), strict=True)
    )


def calls(problem: zs.Problem, qp_solver: str, repeats: int) -> tuple[np.ndarray, zs.Plan]:
    """Processor seconds, wall seconds and F of each call after the first, shape (repeats, 3), and the last plan.

    F is measured right before and right after each call, because it changes with what else the
    computer does.
    """
    plan, rows = zs.plan(problem, qp_solver=qp_solver), []
    F = measure_F(problem.machine, repeats=9)
    for _ in range(repeats):
        started = time.process_time(), time.perf_counter()
        plan = zs.plan(problem, qp_solver=qp_solver)
        elapsed = time.process_time() - started[0], time.perf_counter() - started[1]
        before, F = F, measure_F(problem.machine, repeats=9)
        rows.append((*elapsed, 0.5 * (before + F)))
    return np.array(rows), plan


def phases(problem: zs.Problem, repeats: int) -> dict[str, float]:
    """Median processor seconds of a plan by what it does; the names of the planner's own parts, timed from outside."""
    parts = {
        "initial guess": "initial_guess",
        "transcription": "Transcription",
        "certificate": "certify_for",
    }
    samples: dict[str, list[float]] = {name: [] for name in (*parts, "SQP", "rest")}
    originals = {attribute: getattr(planner, attribute) for attribute in parts.values()}
    spent: dict[str, float] = {}

    def timed(name: str, function: Any) -> Any:
        def call(*given: Any, **named: Any) -> Any:
            started = time.process_time()
            found = function(*given, **named)
            spent[name] = spent.get(name, 0.0) + time.process_time() - started
            return found

        return call

    minimize = planner.SQP.minimize
    try:
        for name, attribute in parts.items():
            setattr(planner, attribute, timed(name, originals[attribute]))
        planner.SQP.minimize = timed("SQP", minimize)  # type: ignore[method-assign]
        for _ in range(repeats):
            spent.clear()
            started = time.process_time()
            zs.plan(problem)
            elapsed = time.process_time() - started
            for name in samples:
                samples[name].append(
                    spent.get(name, elapsed - sum(spent.values()) if name == "rest" else 0.0)
                )
    finally:
        for attribute, original in originals.items():
            setattr(planner, attribute, original)
        planner.SQP.minimize = minimize  # type: ignore[method-assign]
    return {name: float(np.median(times)) for name, times in samples.items()}


def problems() -> list[NamedProblem]:
    """The paper's test, and random ones in which the ZMP costs time."""
    return [paper_1(), paper_1(point_masses=False), *(random_problem(seed) for seed in (29, 121))]


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=15, help="calls per row (default 15)")
    parser.add_argument("--json", type=Path, help="write the results here")
    options = parser.parse_args()

    first = first_call()
    rows: list[list[Any]] = []
    found: dict[str, float] = {}
    for name in ASKED:
        times, plan = calls(load_scenario(name).problem, "proxqp", 2 * options.repeats)
        found[name] = float(np.median(times[:, 0] / times[:, 2]))
        console.print(
            f"{name}: {found[name]:.1f} F, {plan.iterations} iterations, asked for {ASKED[name]:.0f} F"
        )
    for named in problems():
        for qp_solver in BACKENDS:
            times, plan = calls(named.problem, qp_solver, options.repeats)
            in_F, (_, wall, F) = times[:, 0] / times[:, 2], 1e3 * np.median(times, axis=0)
            rows.append(
                [
                    named.name,
                    qp_solver,
                    plan.status.name,
                    plan.iterations,
                    round(plan.duration, 6),
                    *(
                        round(float(value), 1)
                        for value in (np.median(in_F), in_F.min(), in_F.max(), wall)
                    ),
                    round(float(F), 4),
                ]
            )
    split = phases(paper_1().problem, options.repeats)
    F = measure_F(paper_1().problem.machine)

    measured = ("median [F]", "min [F]", "max [F]", "wall [ms]", "F [ms]")
    columns = ("problem", "QP solver", "status", "iterations", "T [s]", *measured)
    print_table("cold calls", columns, rows)
    whole = sum(split.values())
    print_table(
        "paper_1, default QP solver, by phase",
        ("phase", "ms", "F", "share"),
        [
            (name, 1e3 * seconds, seconds / F, f"{100.0 * seconds / whole:.0f} %")
            for name, seconds in split.items()
        ],
    )
    print_table(
        "paper_1 in a new process",
        ("step", "ms"),
        [(name, 1e3 * seconds) for name, seconds in first.items()],
    )
    print_table(
        "cold, default QP solver",
        ("scenario", "F", "asked for"),
        [(name, round(found[name], 1), ASKED[name]) for name in ASKED],
    )
    if options.json is not None:
        content = {
            "cold_in_F": found,
            "asked_in_F": ASKED,
            "repeats": options.repeats,
            "new_process_seconds": first,
            "paper_1_phases_seconds": split,
            "columns": columns,
        }
        save_json(options.json, content, rows=rows)
    return 0 if all(found[name] <= ASKED[name] for name in ASKED) else 1


if __name__ == "__main__":
    sys.exit(main())
