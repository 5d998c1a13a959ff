"""Plans seeded random drive-and-swing problems over rolling heightmaps, and says how many were solved.

    python -m benchmarks.terrain_drives [--count 100] [--slope] [--qp-solver NAME] [--json FILE]

What they are drawn from stands in benchmarks/problems/terrain.py. A problem counts as solved only if its
motion is certified, and if the ZMP at 1000 times keeps the guaranteed margin. Times are processor
times. The exit code is 1 where a problem was not solved; its diagnosis is printed.
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
from benchmarks.problems.terrain import random_drive_problem

SAMPLES = 1000
AT_BOUND = 1e-3  # relative: durations within this of the lower bound are proven optimal to the grid
KEYS = ("seed", "status", "iterations", "seconds", "duration", "lower_bound", "margin", "message")


def run(seed: int, *, over_terrain: bool, qp_solver: str) -> dict[str, Any]:
    """Plan one problem; what comes back is ready for JSON."""
    problem = random_drive_problem(seed, over_terrain=over_terrain)
    started = time.process_time()
    plan = zs.plan(problem, qp_solver=qp_solver)
    elapsed, least = time.process_time() - started, -np.inf
    if plan.success:
        t = np.linspace(0.0, plan.duration, SAMPLES)
        points = zs.trajectory_zmp(problem.machine, plan.trajectory, t, problem.ground)
        least = float(problem.machine.support.signed_distance(points).min())
    return {
        "seed": seed,
        "status": plan.status.name,
        "solved": plan.success and least >= plan.margin - 1e-9,
        "iterations": plan.iterations,
        "seconds": round(elapsed, 5),
        "duration": plan.duration,
        "lower_bound": plan.lower_bound,
        "margin": least,
        "message": plan.message,
    }


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--count", type=int, default=100, help="how many problems: seeds 0, 1, ... (default 100)"
    )
    parser.add_argument(
        "--slope", action="store_true", help="on the plane that the waves lie on, for comparison"
    )
    parser.add_argument("--qp-solver", default="proxqp")
    parser.add_argument("--json", type=Path, help="write every problem's result here")
    options = parser.parse_args()

    F = measure_F(random_drive_problem(0, over_terrain=False).machine)
    results = []
    for seed in range(options.count):
        result = run(seed, over_terrain=not options.slope, qp_solver=options.qp_solver)
        results.append(result)
        if not result["solved"]:
            console.print(f"[bold]seed {seed} not solved[/bold]: {result}")
    solved = [result for result in results if result["solved"]]
    at_bound = sum(
        result["duration"] <= (1.0 + AT_BOUND) * result["lower_bound"] for result in solved
    )
    ground = "slope" if options.slope else "terrain"
    console.print(
        f"{len(solved)} of {len(results)} drives on {ground} solved by {options.qp_solver}, {at_bound} within 0.1 % of "
        f"their lower bound; F = {1e3 * F:.3f} ms"
    )
    iterations = distribution([result["iterations"] for result in results])
    in_F = distribution([result["seconds"] / F for result in results])
    print_table(
        "distribution",
        ("", *iterations),
        [("iterations", *iterations.values()), ("time [F]", *in_F.values())],
    )
    if options.json is not None:
        summary = {
            "ground": ground,
            "qp_solver": options.qp_solver,
            "count": len(results),
            "solved": len(solved),
            "F_seconds": F,
            "iterations": iterations,
            "time_in_F": in_F,
            "within_0.1_percent_of_lower_bound": at_bound,
        }
        rows = [[result[key] for key in KEYS] for result in results]
        save_json(options.json, {**summary, "columns": KEYS}, rows=rows)
    return 0 if len(solved) == len(results) else 1


if __name__ == "__main__":
    sys.exit(main())
