"""Plan seeded random problems in which base and arm move over a heightmap: how many are solved.

    python -m benchmarks.terrain_drives [--count 100] [--first 0] [--slope] [--qp-solver NAME]
                                        [--json FILE]

The problems are those of benchmarks/problems/terrain.py. A problem counts as solved if its plan is
certified and the ZMP keeps the certified margin at 1000 times. Times are processor times. The exit
code is 1 where a problem was not solved.
"""

from __future__ import annotations

import sys

import numpy as np

import zmp_sqp as zs
from benchmarks.harness import (
    Row,
    benchmark_parser,
    console,
    exit_code,
    near_bound,
    print_distributions,
    run_all,
    save_json,
    seeds,
    timed_plan,
)
from benchmarks.problems.terrain import random_drive_problem

SAMPLES = 1000
ROUNDING = 1e-9  # [m]
AT_BOUND = 1e-3  # relative: what a grid of 50 intervals costs; closer to the bound is optimal
COLUMNS = (
    "seed",
    "status",
    "iterations",
    "seconds",
    "duration",
    "lower_bound",
    "margin",
    "message",
)


def run(seed: int, *, over_terrain: bool, qp_solver: str) -> Row:
    """Plan one problem and sample the margin of the plan."""
    problem = random_drive_problem(seed, over_terrain=over_terrain)
    plan, row = timed_plan(problem, qp_solver)
    margin = -np.inf
    if plan.success:
        t = np.linspace(0.0, plan.duration, SAMPLES)
        points = zs.trajectory_zmp(problem.machine, plan.trajectory, t, problem.ground)
        margin = float(problem.machine.support.signed_distance(points).min())
    solved = bool(plan.success and margin >= plan.margin - ROUNDING)
    return {"seed": seed, **row, "solved": solved, "margin": margin}


def main() -> int:
    parser = benchmark_parser(__doc__, count=100, qp_solver=True)
    parser.add_argument(
        "--slope", action="store_true", help="for comparison: on the plane below the waves"
    )
    options = parser.parse_args()
    ground, qp_solver = "slope" if options.slope else "terrain", options.qp_solver

    rows, F = run_all(
        lambda seed: run(seed, over_terrain=not options.slope, qp_solver=qp_solver),
        seeds(options),
        random_drive_problem(0, over_terrain=False).machine,
    )
    solved, at_bound = sum(row["solved"] for row in rows), near_bound(rows, AT_BOUND)
    console.print(
        f"{solved} of {len(rows)} drives on {ground} solved by {qp_solver}, {at_bound} within "
        f"0.1 % of their lower bound; F = {1e3 * F:.3f} ms"
    )
    distributions = print_distributions(rows, F)
    if options.json is not None:
        summary = {
            "ground": ground,
            "qp_solver": qp_solver,
            "count": len(rows),
            "solved": solved,
            "F_seconds": F,
            **distributions,
            "within_0.1_percent_of_lower_bound": at_bound,
        }
        save_json(options.json, summary, rows=rows, columns=COLUMNS)
    return exit_code(success=solved == len(rows))


if __name__ == "__main__":
    sys.exit(main())
