"""Plan seeded random problems of the arm: how many are solved, in how many iterations and seconds.

    python -m benchmarks.random_problems [--count 200] [--first 0] [--hard] [--qp-solver NAME]
                                         [--json FILE]

The problems are those of benchmarks/problems/arm.py (ORDINARY, or HARD with --hard). A problem
counts as solved if its plan is certified and the independent check in benchmarks/problems/checks.py
finds no violation of 1e-6. Times are processor times. The exit code is 1 where a problem was not
solved.
"""

from __future__ import annotations

import sys

import numpy as np

from benchmarks.harness import (
    Row,
    benchmark_parser,
    console,
    exit_code,
    near_bound,
    print_distributions,
    print_slowest,
    run_all,
    save_json,
    seeds,
    timed_plan,
)
from benchmarks.problems.arm import HARD, ORDINARY, Recipe, random_problem
from benchmarks.problems.checks import check_feasibility

TOLERANCE = 1e-6  # [m, rad, rad/s, rad/s^2] largest violation of a solved problem
AT_BOUND = 1e-3  # relative: what a grid of 50 intervals costs; closer to the bound is optimal
SHOWN = ("status", "iterations", "seconds", "duration", "lower_bound")
COLUMNS = ("seed", *SHOWN, "violation", "relaxed")


def run(seed: int, recipe: Recipe, qp_solver: str) -> Row:
    """Plan one problem and check the plan."""
    named = random_problem(seed, recipe)
    plan, row = timed_plan(named.problem, qp_solver)
    violation = np.inf
    if plan.attempt is not None:
        violation = check_feasibility(named.scene, named.problem, plan.attempt).violation
    return {
        "seed": seed,
        **row,
        "solved": bool(plan.success and violation < TOLERANCE),
        "violation": float(f"{violation:.3g}"),
        "relaxed": sum(record.relaxed for record in plan.history),
    }


def main() -> int:
    parser = benchmark_parser(__doc__, count=200, qp_solver=True)
    parser.add_argument(
        "--hard", action="store_true", help="heavier payloads, steeper slopes, poses near the edge"
    )
    options = parser.parse_args()
    recipe, qp_solver = HARD if options.hard else ORDINARY, options.qp_solver

    machine = random_problem(options.first, recipe).problem.machine
    rows, F = run_all(lambda seed: run(seed, recipe, qp_solver), seeds(options), machine)
    solved = [row for row in rows if row["solved"]]
    at_bound = near_bound(rows, AT_BOUND)
    largest = max((row["violation"] for row in solved), default=np.nan)
    longest = max((row["duration"] / row["lower_bound"] for row in solved), default=np.nan)
    console.print(
        f"{len(solved)} of {len(rows)} {recipe.name} problems solved by {qp_solver}, largest "
        f"violation of those {largest:.1e}; {at_bound} within 0.1 % of their lower bound, the rest "
        f"up to {longest:.3f} times it; F = {1e3 * F:.3f} ms"
    )
    distributions = print_distributions(rows, F)
    print_slowest(rows, SHOWN)
    if options.json is not None:
        summary = {
            "recipe": recipe.name,
            "qp_solver": qp_solver,
            "count": len(rows),
            "solved": len(solved),
            "F_seconds": F,
            **distributions,
            "within_0.1_percent_of_lower_bound": at_bound,
        }
        save_json(options.json, summary, rows=rows, columns=COLUMNS)
    return exit_code(success=len(solved) == len(rows))


if __name__ == "__main__":
    sys.exit(main())
