"""The planner beside its peers on the same problems: CasADi with IPOPT and fatrop, Drake, TOPP-RA.

    python -m benchmarks.peers [--count 10] [--first 0] [--drives 0 2 4] [--without METHOD ...]
                               [--json FILE]

The problems are `paper_1_rigid`, the first hard problems of benchmarks/problems/arm.py from a seed
on where tip-over costs the planner more than 1 % of the lower bound, and drives of
benchmarks/problems/driving.py. All are on grids of 50 intervals, all start from one guess.

====================  ==============================================================================
`zmp_sqp`             `zs.plan`, certificate included
`ipopt`               peer_transcription.py, expanded and evaluated by CasADi; peer_drive.py
`ipopt_compiled`      the same program as C code, compiled by gcc -O1
`fatrop`              peer_fatrop.py, expanded and evaluated by CasADi
`fatrop_compiled`     the same program as C code, compiled by gcc -O1
`drake`               peer_drake.py: KinematicTrajectoryOptimization with SNOPT, 30 polynomials
`toppra`              peer_toppra.py: the fastest motion along the path of `zmp_sqp`
====================  ==============================================================================

casadi is needed; without gcc, drake or toppra the methods concerned are listed as not available.
Drives go to `ipopt` only: the other peers have no unicycle in their programs.

Every motion is checked by 2000 samples per second with a model of its own (peer_checks.py): `zmp`
is the largest distance beyond an edge, `limits` the largest violation of anything else. Times are
processor times in F, measured beside each solve; `set-up` in seconds, that of gcc included, comes
once for all problems but for drake and drives, which are set up for each. A method that has not
succeeded from the first guess starts again as in peer_ipopt.py; its times are summed.

The exit code is 1 where the planner's motion is not certified or violates anything by 1e-6, where
it is slower than the motion of a peer that violates nothing by 1e-5 by more than 0.1 %, or than
TOPP-RA's along its own path by more than 0.05 %. TOPP-RA's grids have ten and twenty times as many
cells, of which `toppra_discretisation` is the largest relative change of a duration. What it gains
beyond is what accelerations that are linear on 50 intervals cost. Its time is mostly that of
inverse dynamics called from Python.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

import zmp_sqp as zs
from benchmarks.harness import (
    Row,
    benchmark_parser,
    console,
    distribution,
    exit_code,
    print_table,
    save_json,
)
from benchmarks.peer_rows import TOLERANCE, drive_rows, peers, problem_rows, unavailable
from benchmarks.problems.arm import HARD, random_problem
from benchmarks.problems.paper import paper_1
from benchmarks.problems.scene import NamedProblem

__all__ = ["METHODS", "active_problems", "failures", "feasible", "summary"]

METHODS = (
    "zmp_sqp",
    "ipopt",
    "ipopt_compiled",
    "fatrop",
    "fatrop_compiled",
    "drake",
    "toppra",
)
KEPT = 1e-5  # [m, rad, ...] a motion that violates nothing by more counts as feasible
ACTIVE = 1.01  # duration over lower bound from which on tip-over costs time
SLOWER = 1e-3  # relative: a planner's motion slower than a feasible one by more is a failure
ALONG = 5e-4  # relative: so is one slower than TOPP-RA's along its own path
COLUMNS = (
    "problem",
    "method",
    "status",
    "duration",
    "ratio",
    "zmp",
    "limits",
    "iterations",
    "seconds",
    "in_F",
    "set_up",
)


def active_problems(first: int, count: int) -> Iterator[NamedProblem]:
    """The first hard problems from a seed on where tip-over costs time."""
    seed = first
    while count > 0:
        named = random_problem(seed, HARD)
        plan = zs.plan(named.problem)
        if not plan.success or plan.duration > ACTIVE * plan.lower_bound:
            count -= 1
            yield named
        seed += 1


def feasible(row: Row) -> bool:
    """True where the motion of a row violates nothing by more than KEPT."""
    return bool(max(row["zmp"], row["limits"]) <= KEPT)


def summary(rows: Sequence[Row]) -> list[Row]:
    """What each method does with all problems of the arm."""
    found = []
    for name in METHODS:
        of = [row for row in rows if row["method"] == name]
        if not of:
            continue
        solved = [row for row in of if np.isfinite(row["duration"])]
        in_F = distribution([row["in_F"] for row in of])
        found.append(
            {
                "method": name,
                "problems": len(of),
                "solved": len(solved),
                "feasible": sum(feasible(row) for row in solved),
                "ratio": float(np.median([row["ratio"] for row in solved])) if solved else np.nan,
                "zmp": max((row["zmp"] for row in solved), default=np.nan),
                "limits": max((row["limits"] for row in solved), default=np.nan),
                "median_F": in_F["50 %"],
                "max_F": in_F["max"],
                "set_up": max(row["set_up"] for row in of),
            }
        )
    return found


def failures(rows: Sequence[Row]) -> list[str]:
    """Sentences about what the planner gets wrong, or gives away."""
    found, ours = [], {row["problem"]: row for row in rows if row["method"] == "zmp_sqp"}
    for name, row in ours.items():
        zmp, limits = row["zmp"], row["limits"]
        if row["status"] != "certified" or not max(zmp, limits) <= TOLERANCE:
            found.append(f"{name}: {row['status']}, zmp {zmp:.1e}, limits {limits:.1e}")
    for row in rows:
        ratio, along = row["ratio"], row["method"] == "toppra"
        if (along or feasible(row)) and ratio < 1.0 - (ALONG if along else SLOWER):
            found.append(f"{row['problem']}: {row['method']} takes {ratio:.5f} times as long")
    return found


def print_rows(rows: Sequence[Row], totals: Sequence[Row], missing: dict[str, str]) -> None:
    """Print all rows, the summary, and what was not measured."""
    print_table(
        "all: durations [s], violations between nodes [mm, rad...], set-up [s]",
        ("problem", "method", "status", "duration", "ratio", "zmp [mm]", "limits", "F", "set-up"),
        [
            [
                row["problem"],
                row["method"],
                row["status"],
                f"{row['duration']:.4f}",
                f"{row['ratio']:.5f}",
                f"{1e3 * row['zmp']:.3f}",
                f"{row['limits']:.1e}",
                f"{row['in_F']:.0f}",
                f"{row['set_up']:.2f}",
            ]
            for row in rows
        ],
    )
    print_table(
        "arm: median ratio of durations, largest violations, median and largest time [F]",
        ("method", "problems", "solved", "feasible", "ratio", "zmp [mm]", "limits", "F", "max F"),
        [
            [
                row["method"],
                str(row["problems"]),
                str(row["solved"]),
                str(row["feasible"]),
                f"{row['ratio']:.5f}",
                f"{1e3 * row['zmp']:.3f}",
                f"{row['limits']:.1e}",
                f"{row['median_F']:.0f}",
                f"{row['max_F']:.0f}",
            ]
            for row in totals
        ],
    )
    for name, reason in missing.items():
        console.print(f"{name}: not available, {reason}")


def _number(value: Any) -> Any:
    """A value for JSON, which has no NaN."""
    return None if isinstance(value, float) and np.isnan(value) else value


def main() -> int:
    parser = benchmark_parser(__doc__, count=10)
    parser.add_argument(
        "--drives", type=int, nargs="*", default=[0, 2, 4], metavar="SEED", help="default: 0 2 4"
    )
    parser.add_argument("--without", nargs="*", default=[], choices=METHODS[1:], metavar="METHOD")
    options = parser.parse_args()
    wanted = [name for name in METHODS[1:] if name not in options.without]
    missing = {name: reason for name in wanted if (reason := unavailable(name))}
    first = paper_1(point_masses=False)
    methods = list(peers(first.scene, [name for name in wanted if name not in missing]))
    zs.plan(first.problem)  # imports QP solvers at first use, which is not to be measured
    rows: list[Row] = []
    for named in (first, *active_problems(options.first, options.count)):
        rows += problem_rows(named, methods)
    totals = summary(rows)  # of the arm
    for seed in options.drives:
        rows += drive_rows(seed)
    print_rows(rows, totals, missing)
    wrong = failures(rows)
    for sentence in wrong:
        console.print(sentence, style="bold", markup=False)
    if options.json is not None:
        content = {
            "not available": missing,
            "summary": [{key: _number(value) for key, value in row.items()} for row in totals],
            "to look into": wrong,
            "toppra_discretisation": max(
                (abs(row.get("discretisation", 0.0)) for row in rows), default=0.0
            ),
        }
        written = [{key: _number(value) for key, value in row.items()} for row in rows]
        save_json(options.json, content, rows=written, columns=COLUMNS, digits=9)
    return exit_code(success=not wrong)


if __name__ == "__main__":
    sys.exit(main())
