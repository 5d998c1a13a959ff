"""Plan seeded random problems with uncertain payload and slope: what 64 corners cost.

    python -m benchmarks.robust_problems [--first 5000] [--count 60] [--qp-solver NAME]
                                         [--json FILE]

The problems are those of the recipe ROBUST in benchmarks/problems/arm.py under `UNCERTAIN`; seeds
whose start or goal tips over under it are left out. A problem is active if its motion takes more
than 1 % longer than the joint limits alone ask for. Each is planned without uncertainty, too. Times
are processor times; those without certificate leave out the time of certifying the same motion once
more. The exit code is 1 where a plan is not certified.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import zmp_sqp as zs
from benchmarks.harness import (
    Row,
    benchmark_parser,
    console,
    distribution,
    exit_code,
    print_table,
    run_all,
    save_json,
    seeds,
    timed,
    timed_plan,
)
from benchmarks.problems.arm import ROBUST, random_problem
from zmp_sqp.planning.proof.certificate import certify_for

UNCERTAIN: dict[str, Any] = {
    "tipping_fraction": 0.9,
    "payload_uncertainty": 0.1,
    "payload_com_uncertainty": 0.1,  # [m]
    "slope_uncertainty": 0.02,  # [rad]
}
FIRST = 5000
ACTIVE = 1.01  # times the bound of the joint limits
COLUMNS = (
    "seed",
    "status",
    "iterations",
    "duration",
    "lower_bound",
    "seconds",
    "search_seconds",
    "certain_seconds",
    "certain_duration",
)


def uncertain(seed: int) -> zs.Problem | None:
    """Problem of a seed under all uncertainties; None where its start or goal tips over."""
    certain = random_problem(seed, ROBUST).problem
    try:
        return replace(certain, **UNCERTAIN)
    except zs.ProblemError:
        return None


def run(problem: zs.Problem, qp_solver: str) -> Row:
    """Plan a problem with and without uncertainty."""
    plan, row = timed_plan(problem, qp_solver)
    certain = replace(
        problem,
        tipping_fraction=1.0,
        payload_uncertainty=0.0,
        payload_com_uncertainty=0.0,
        slope_uncertainty=0.0,
    )
    plan_of_certain, certain_row = timed_plan(certain, qp_solver)
    search = [row["seconds"], certain_row["seconds"]]
    for i, (asked, found) in enumerate(((problem, plan), (certain, plan_of_certain))):
        if found.attempt is not None:
            attempt = found.attempt
            search[i] -= timed(lambda: certify_for(asked, attempt))[1].processor  # noqa: B023
    return {
        **row,
        "solved": plan.success,
        "search_seconds": round(search[0], 5),
        "certain_seconds": certain_row["seconds"],
        "certain_duration": certain_row["duration"],
        "ratio": row["seconds"] / certain_row["seconds"],
        "search_ratio": search[0] / search[1],
    }


def main() -> int:
    parser = benchmark_parser(__doc__, count=60, qp_solver=True)
    parser.set_defaults(first=FIRST, qp_solver="auto")
    options = parser.parse_args()
    problems = {seed: uncertain(seed) for seed in seeds(options)}
    asked = {seed: problem for seed, problem in problems.items() if problem is not None}
    machine = next(iter(asked.values())).machine
    corners = len(next(iter(asked.values())).corners())
    rows, F = run_all(
        lambda seed: {"seed": seed, **run(asked[seed], options.qp_solver)}, asked, machine
    )
    active = [row for row in rows if row["duration"] > ACTIVE * row["lower_bound"]]
    solved = sum(row["solved"] for row in rows)
    console.print(
        f"{solved} of {len(rows)} problems with {corners} corners solved, {len(active)} active; "
        f"F = {1e3 * F:.3f} ms"
    )
    tables: dict[str, dict[str, dict[str, float]]] = {}
    for name, chosen in (("all", rows), ("active", active)):
        if not chosen:
            continue
        tables[name] = {
            "plan [F]": distribution([row["seconds"] / F for row in chosen]),
            "without certificate [F]": distribution([row["search_seconds"] / F for row in chosen]),
            "over the certain problem": distribution([row["ratio"] for row in chosen]),
            "the same without certificates": distribution([row["search_ratio"] for row in chosen]),
            "duration over the certain one": distribution(
                [row["duration"] / row["certain_duration"] for row in chosen]
            ),
        }
        print_table(
            f"{name} ({len(chosen)})",
            ("", *next(iter(tables[name].values()))),
            [(label, *found.values()) for label, found in tables[name].items()],
        )
    if options.json is not None:
        summary = {"corners": corners, "solved": solved, "F_seconds": F, **tables}
        save_json(options.json, summary, rows=rows, columns=COLUMNS)
    return exit_code(success=solved == len(rows))


if __name__ == "__main__":
    sys.exit(main())
