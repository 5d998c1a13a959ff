"""Plan seeded random problems in which base and arm move on a slope: solved, iterations, seconds.

    python -m benchmarks.driving_problems [--count 100] [--first 0] [--qp-solver NAME] [--json FILE]

The problems are those of benchmarks/problems/driving.py. A problem counts as solved if its plan is
certified and the independent check in benchmarks/problems/driving_checks.py agrees. A problem that
is not solved counts as diagnosed if the plan does not claim success and its message gives a reason.
Times are processor times. The exit code is 1 where a problem is neither.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

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
from benchmarks.problems.driving import random_driving_problem
from benchmarks.problems.driving_checks import TOLERANCES, driving_violation

AT_BOUND = 2e-3  # relative: what the grid costs; a plan closer to its lower bound is optimal
NO_REASON = len("Not solved")  # a longer message gives a reason
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


def run(seed: int, qp_solver: str) -> Row:
    """Plan one problem and check the plan."""
    drawn = random_driving_problem(seed)
    plan, row = timed_plan(drawn.problem, qp_solver)
    violation = driving_violation(drawn, plan.trajectory) if plan.success else {}
    within = (violation[name] <= tolerance for name, tolerance in TOLERANCES.items() if violation)
    return {
        "seed": seed,
        "kind": drawn.kind,
        "special": "in motion" if drawn.moving else "corridor" if drawn.corridor else "",
        **row,
        "solved": plan.success and all(within),
        "diagnosed": not plan.success and len(plan.message) > NO_REASON,
        "margin": plan.margin,
        "violation": {name: float(f"{value:.3g}") for name, value in violation.items()},
    }


def summarise(rows: Sequence[Row], qp_solver: str, F: float) -> dict[str, Any]:
    """Counts of all problems, and the largest violations of solved ones."""
    solved = [row for row in rows if row["solved"]]
    return {
        "qp_solver": qp_solver,
        "count": len(rows),
        "solved": len(solved),
        "diagnosed": sum(row["diagnosed"] for row in rows),
        "F_seconds": F,
        "within_0.2_percent_of_lower_bound": near_bound(rows, AT_BOUND),
        "unsolved": [
            {key: row[key] for key in ("seed", "status", "message")}
            for row in rows
            if not row["solved"]
        ],
        "largest_violation": {
            name: max((row["violation"][name] for row in solved), default=np.nan)
            for name in TOLERANCES
        },
    }


def headline(summary: Mapping[str, Any]) -> str:
    """The counts in one sentence."""
    wrong = summary["count"] - summary["solved"] - summary["diagnosed"]
    return (
        f"{summary['solved']} of {summary['count']} drive-and-swing problems solved by "
        f"{summary['qp_solver']}, certified and checked; {summary['diagnosed']} not solved and "
        f"diagnosed, {wrong} neither; {summary['within_0.2_percent_of_lower_bound']} within 0.2 % "
        f"of their lower bound; F = {1e3 * summary['F_seconds']:.3f} ms"
    )


def main() -> int:
    options = benchmark_parser(__doc__, count=100, qp_solver=True).parse_args()
    machine = random_driving_problem(options.first).problem.machine
    rows, F = run_all(lambda seed: run(seed, options.qp_solver), seeds(options), machine)
    summary = summarise(rows, options.qp_solver, F)
    console.print(headline(summary))
    distributions = print_distributions(rows, F)
    print_slowest(rows, COLUMNS)
    if options.json is not None:
        save_json(options.json, {**summary, **distributions}, rows=rows, columns=("seed", *COLUMNS))
    return exit_code(success=all(row["solved"] or row["diagnosed"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
