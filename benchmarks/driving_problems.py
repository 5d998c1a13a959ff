"""Plans seeded random drive-and-swing problems: how many are solved, in how many iterations, in what time.

    python -m benchmarks.driving_problems [--count 100] [--qp-solver NAME] [--json FILE]

What the problems are drawn from stands in benchmarks/problems/driving.py. A problem counts as solved
only if the plan is certified and an independent check agrees (ZMP from finite differences of the
bodies' poses, joint limits in closed form, both ends). One that is not solved is honestly diagnosed
if the plan says so and why. Times are processor times. The exit code is 1 where a success is none,
or a failure has nothing to say.
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
from benchmarks.problems.driving import random_driving_problem
from benchmarks.problems.driving_checks import TOLERANCES, driving_violation

RESULTS = Path(__file__).resolve().parent / "results" / "driving_problems.json"
AT_BOUND = 2e-3  # relative: durations within this of the lower bound are as fast as the grid allows
COLUMNS = (
    "kind",
    "special",
    "status",
    "iterations",
    "seconds",
    "duration",
    "lower_bound",
    "margin",
)


def run(seed: int, qp_solver: str) -> dict[str, Any]:
    """Plan one problem; what comes back is ready for JSON."""
    drawn = random_driving_problem(seed)
    started = time.process_time()
    plan = zs.plan(drawn.problem, qp_solver=qp_solver)
    elapsed = time.process_time() - started
    violation = driving_violation(drawn, plan.trajectory) if plan.success else {}
    agreed = (
        all(violation[name] <= tolerance for name, tolerance in TOLERANCES.items())
        if violation
        else False
    )
    return {
        "seed": seed,
        "kind": drawn.kind,
        "special": "in motion" if drawn.moving else "corridor" if drawn.corridor else "",
        "status": plan.status.name,
        "solved": bool(plan.success and agreed),
        "honest": bool(agreed if plan.success else len(plan.message) > len("Not solved")),
        "iterations": plan.iterations,
        "seconds": round(elapsed, 5),
        "duration": plan.duration,
        "lower_bound": plan.lower_bound,
        "margin": plan.margin,
        "violation": {name: float(f"{value:.3g}") for name, value in violation.items()},
        "message": plan.message,
    }


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--count", type=int, default=100, help="how many problems: seeds 0, 1, ... (default 100)"
    )
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--qp-solver", default="proxqp")
    parser.add_argument(
        "--json", type=Path, help=f"write every problem's result here, e.g. {RESULTS.name}"
    )
    options = parser.parse_args()

    machine = random_driving_problem(options.first).problem.machine
    F = measure_F(machine)
    results = [
        run(seed, options.qp_solver) for seed in range(options.first, options.first + options.count)
    ]
    F = 0.5 * (F + measure_F(machine))

    solved = [result for result in results if result["solved"]]
    honest = sum(result["honest"] for result in results)
    iterations = distribution([result["iterations"] for result in results])
    in_F = distribution([result["seconds"] / F for result in results])
    near = sum(result["duration"] <= (1.0 + AT_BOUND) * result["lower_bound"] for result in solved)
    console.print(
        f"{len(solved)} of {len(results)} drive-and-swing problems solved by {options.qp_solver}, certified and "
        f"checked; {honest - len(solved)} not solved and diagnosed, {len(results) - honest} neither; {near} within "
        f"0.2 % of their lower bound; F = {1e3 * F:.3f} ms"
    )
    print_table(
        "distribution",
        ("", *iterations),
        [("iterations", *iterations.values()), ("time [F]", *in_F.values())],
    )
    slowest = sorted(results, key=lambda result: -result["iterations"])[:5]
    print_table(
        "most iterations",
        ("seed", *COLUMNS),
        [[str(r["seed"]), *(r[key] for key in COLUMNS)] for r in slowest],
    )
    for result in results:
        if not result["solved"]:
            console.print(
                f"[bold]seed {result['seed']}[/bold] ({result['kind']}, {result['status']}): "
                f"{result['message']} {result['violation'] or ''}"
            )
    if options.json is not None:
        summary = {
            "qp_solver": options.qp_solver,
            "count": len(results),
            "solved": len(solved),
            "diagnosed": honest - len(solved),
            "F_seconds": F,
            "iterations": iterations,
            "time_in_F": in_F,
            "within_0.2_percent_of_lower_bound": near,
            "unsolved": [
                {key: r[key] for key in ("seed", "status", "message")}
                for r in results
                if not r["solved"]
            ],
            "largest_violation": {
                name: max((r["violation"][name] for r in solved), default=np.nan)
                for name in TOLERANCES
            },
        }
        keys = ("seed", *COLUMNS)
        save_json(
            options.json,
            {**summary, "columns": keys},
            rows=[[r[key] for key in keys] for r in results],
        )
    return 0 if honest == len(results) else 1


if __name__ == "__main__":
    sys.exit(main())
