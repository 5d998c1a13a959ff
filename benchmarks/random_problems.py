"""Plans seeded random rest-to-rest problems and says how many were solved, in how many iterations, in what time.

    python -m benchmarks.random_problems [--count 200] [--hard] [--qp-solver NAME] [--json FILE]

What the problems are drawn from stands in benchmarks/problems/arm.py (ORDINARY, HARD). A problem counts as
solved only if an independent check (benchmarks/problems/checks.py: its own model, its own ZMP, joint limits in
closed form) finds no violation of 1e-6. Times are processor times, which other programs disturb
less. The exit code is 1 where a problem was not solved.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import zmp_sqp as zs
from benchmarks.harness import console, distribution, measure_F, print_table, save_json
from benchmarks.problems.arm import HARD, ORDINARY, Recipe, random_problem
from benchmarks.problems.checks import check_feasibility

TOLERANCE = 1e-6  # [m, rad, per second ...] largest violation of a solved problem
AT_BOUND = 1e-3  # relative: durations within this of the lower bound are proven optimal to the grid


def run(seed: int, recipe: Recipe, qp_solver: str) -> dict[str, Any]:
    """Plan one problem; what comes back is ready for JSON."""
    named = random_problem(seed, recipe)
    started = time.process_time()
    plan = zs.plan(named.problem, qp_solver=qp_solver)
    elapsed = time.process_time() - started
    violation = np.inf
    if plan.attempt is not None:
        violation = check_feasibility(named.scene, named.problem, plan.attempt).violation
    return {
        "seed": seed,
        "status": plan.status.name,
        "solved": bool(plan.success and violation < TOLERANCE),
        "iterations": plan.iterations,
        "seconds": round(elapsed, 5),
        "duration": plan.duration,
        "lower_bound": plan.lower_bound,
        "violation": float(f"{violation:.3g}"),
        "fallbacks": sum(
            "+" in record.backend or record.backend != qp_solver for record in plan.history
        ),
        "relaxed": sum(record.relaxed for record in plan.history),
        "message": plan.message,
    }


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--count", type=int, default=200, help="how many problems: seeds 0, 1, ... (default 200)"
    )
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument(
        "--hard", action="store_true", help="heavier payloads, steeper slopes, poses near the edge"
    )
    parser.add_argument("--qp-solver", default="proxqp")
    parser.add_argument("--json", type=Path, help="write every problem's result here")
    options = parser.parse_args()
    recipe = HARD if options.hard else ORDINARY

    F = measure_F(random_problem(options.first, recipe).problem.machine)
    results = []
    for seed in range(options.first, options.first + options.count):
        result = run(seed, recipe, options.qp_solver)
        results.append(result)
        if not result["solved"]:
            console.print(f"[bold]seed {seed} not solved[/bold]: {result}")
    F = 0.5 * (F + measure_F(random_problem(options.first, recipe).problem.machine))

    solved = [result for result in results if result["solved"]]
    iterations = distribution([result["iterations"] for result in results])
    in_F = distribution([result["seconds"] / F for result in results])
    over = [result["duration"] / result["lower_bound"] - 1.0 for result in solved]
    proven = sum(excess <= AT_BOUND for excess in over)
    console.print(
        f"{len(solved)} of {len(results)} {recipe.name} problems solved by {options.qp_solver}, largest violation "
        f"of those {max((result['violation'] for result in solved), default=np.nan):.1e}; {proven} within 0.1 % of "
        f"their lower bound, the rest up to {1.0 + max(over, default=np.nan):.3f} times it; F = {1e3 * F:.3f} ms"
    )
    columns = ("", *iterations)
    print_table(
        "distribution",
        columns,
        [("iterations", *iterations.values()), ("time [F]", *in_F.values())],
    )
    slowest = sorted(results, key=lambda result: -result["iterations"])[:5]
    shown = ("status", "iterations", "seconds", "duration", "lower_bound")
    print_table(
        "most iterations",
        ("seed", *shown),
        [[str(r["seed"]), *(r[key] for key in shown)] for r in slowest],
    )
    if options.json is not None:
        summary = {
            "recipe": recipe.name,
            "qp_solver": options.qp_solver,
            "count": len(results),
            "solved": len(solved),
            "F_seconds": F,
            "iterations": iterations,
            "time_in_F": in_F,
            "within_0.1_percent_of_lower_bound": proven,
        }
        keys = ("seed", *shown, "violation", "fallbacks", "relaxed")
        rows = [[result[key] for key in keys] for result in results]
        save_json(options.json, {**summary, "columns": keys}, rows=rows)
    return 0 if len(solved) == len(results) else 1


if __name__ == "__main__":
    sys.exit(main())
