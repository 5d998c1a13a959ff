"""Random moves of excavator, forwarder crane and mobile manipulator: what does tip-over cost them?

    python -m benchmarks.machine_moves [--count 100] [--first 0] [--json FILE]

The problems are those of benchmarks/problems/machines.py. Each is planned twice, with the machine's
support polygon and with one that nothing tips over; the durations' ratio is what tip-over costs. A
problem counts as solved if its plan is certified and the ZMP keeps the certified margin at 1000
times. Times are processor times. The exit code is 1 where a problem was not solved.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial

import numpy as np

import zmp_sqp as zs
from benchmarks.harness import (
    Row,
    benchmark_parser,
    console,
    exit_code,
    print_table,
    run_all,
    save_json,
    seeds,
    timed_plan,
)
from benchmarks.problems.machines import KINDS, WIDE, random_move

SAMPLES = 1000
ROUNDING = 1e-9  # [m]
COSTLY = 0.05  # share of time that counts as a cost
COLUMNS = (
    "machine",
    "seed",
    "status",
    "iterations",
    "seconds",
    "duration",
    "without_tip_over",
    "lower_bound",
    "margin",
)


def run(seed: int, *, name: str) -> Row:
    """Plan one problem with and without tip-over, and sample the margin of the plan."""
    problem = random_move(name, seed)
    plan, row = timed_plan(problem)
    free = zs.plan(replace(problem, machine=problem.machine.with_support(WIDE)))
    margin = -np.inf
    if plan.success:
        t = np.linspace(0.0, plan.duration, SAMPLES)
        points = zs.trajectory_zmp(problem.machine, plan.trajectory, t, problem.ground)
        margin = float(problem.machine.support.signed_distance(points).min())
    return {
        "machine": name,
        "seed": seed,
        **row,
        "solved": bool(plan.success and free.success and margin >= plan.margin - ROUNDING),
        "margin": margin,
        "without_tip_over": free.duration,
    }


def main() -> int:
    options = benchmark_parser(__doc__, count=100).parse_args()
    rows: list[Row] = []
    table, summary = [], {}
    for name in KINDS:
        found, F = run_all(partial(run, name=name), seeds(options), random_move(name, 0).machine)
        cost = np.array([row["duration"] / row["without_tip_over"] - 1.0 for row in found])
        torque = np.array([row["without_tip_over"] / row["lower_bound"] - 1.0 for row in found])
        in_F = np.array([row["seconds"] / F for row in found])
        figures = {
            "solved": sum(row["solved"] for row in found),
            "tip-over costs > 5 %": int((cost > COSTLY).sum()),
            "largest cost [%]": round(100.0 * float(cost.max()), 1),
            "torques cost > 5 %": int((torque > COSTLY).sum()),
            "time, median [F]": round(float(np.median(in_F)), 1),
            "time, max [F]": round(float(in_F.max()), 1),
        }
        table.append([name, *figures.values()])
        summary[name] = {"count": len(found), "F_seconds": F, **figures}
        rows += found
    print_table("random moves", ("", *figures), table)
    if options.json is not None:
        save_json(options.json, summary, rows=rows, columns=COLUMNS, digits=6)
    solved = all(row["solved"] for row in rows)
    console.print("all solved" if solved else "some are not solved")
    return exit_code(success=solved)


if __name__ == "__main__":
    sys.exit(main())
