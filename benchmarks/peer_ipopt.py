"""The planner beside CasADi and IPOPT on the same problems: who solves what, how fast motions are.

    python -m benchmarks.peer_ipopt [--count 20] [--first 0] [--log FILE.jsonl]
                                    [--replan FILE.jsonl] [--seconds 60] [--json FILE]

Needs casadi. The problems are those of benchmarks/peer_problems.py, on a grid of 50 intervals. For
IPOPT they are transcribed independently (peer_transcription.py, peer_dynamics.py), with constant
accelerations on each interval. IPOPT starts from the guess that the planner's search tries first.
If that fails, it starts from the same motion at half the speed, and then from one that draws the
arm in on the way.

A problem counts as solved if an independent check (benchmarks/problems/checks.py) of the motion
finds no violation of 1e-6: of IPOPT's at the ends of the intervals, of the planner's also between
them. The planner's motion has to be certified for all t besides. Its accelerations are linear in
time within an interval, or jump where they must, so that its motions may be faster than any with
constant accelerations on the grid.

With --log every problem becomes a line of that file, and problems already there are not solved
again. The exit code is 1 where IPOPT has solved a problem and the planner has not, or where the
planner's motion is slower by more than 0.1 %.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
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
    seeds,
    timed_plan,
)
from benchmarks.peer_problems import peer_problem
from benchmarks.peer_transcription import Peer, PeerMotion, by_way_of
from benchmarks.problems.checks import check_feasibility
from benchmarks.problems.scene import NamedProblem
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.search.explore import GUESSES
from zmp_sqp.planning.search.task import task_of

__all__ = ["first_guess", "peered", "planned"]

TOLERANCE = 1e-6  # [m, rad, rad/s, rad/s^2] largest violation of a solved problem
SLOWER = 1e-3  # relative: a planner's motion slower by more is a failure
FOLDED = {"boom": 0.0, "stick": -2.8, "tilt": 1.2}  # [rad] positions of an arm drawn in
CONVERGED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
SHOWN = (
    "status",
    "duration",
    "iterations",
    "seconds",
    "ipopt_status",
    "ipopt_duration",
    "ipopt_iterations",
    "ipopt_seconds",
    "guess",
)
PEER_KEYS = ("guess", "ipopt_")  # first letters of the columns that IPOPT fills


def first_guess(problem: zs.Problem) -> PeerMotion:
    """The guess that the planner's search tries first, with an acceleration per interval."""
    task, (pace, smooth) = task_of(problem), GUESSES[0]
    grid = Grid.of(problem.first_intervals)
    controls, duration = task.guess(pace * task.least, grid.size, smooth=smooth)
    q, w = grid.rolled(problem.start, 0.0 * problem.start, controls)
    return PeerMotion(q, w / duration, controls[:, 0] / duration**2, duration)


def guesses(named: NamedProblem, first: PeerMotion) -> list[tuple[str, PeerMotion]]:
    """Guesses from which IPOPT starts, one after the other until it succeeds."""
    slower = PeerMotion(first.q, 0.5 * first.v, 0.25 * first.a, 2.0 * first.duration)
    folded = 0.5 * (named.problem.start + named.problem.goal)
    for joint, angle in FOLDED.items():
        folded[named.problem.machine.joint_names.index(joint)] = angle
    return [
        ("same", first),
        ("slower", slower),
        ("folded", by_way_of(named.problem, first, folded, slower=2.0)),
    ]


def planned(named: NamedProblem) -> Row:
    """The planner's columns of a row."""
    plan, row = timed_plan(named.problem)
    violation = np.inf
    if plan.attempt is not None:
        violation = check_feasibility(named.scene, named.problem, plan.attempt).violation
    return row | {
        "solved": bool(plan.success and violation < TOLERANCE),
        "violation": float(f"{violation:.3g}"),
    }


def peered(named: NamedProblem, peer: Peer) -> Row:
    """IPOPT's columns of a row: from the guess that led to a solution, otherwise from the last."""
    row: Row = {"ipopt_seconds": 0.0, "ipopt_iterations": 0}
    for name, guess in guesses(named, first_guess(named.problem)):
        answer = peer.solve(named, guess)
        found = check_feasibility(
            named.scene, named.problem, answer.motion.trajectory(named.problem.machine)
        )
        worst = max(found.zmp_at_ends, found.limits, found.boundary, found.dynamics)
        row |= {
            "ipopt_solved": bool(answer.status in CONVERGED and worst < TOLERANCE),
            "ipopt_status": answer.status,
            "ipopt_duration": answer.motion.duration,
            "ipopt_violation": float(f"{worst:.3g}"),
            "ipopt_between": float(f"{found.zmp_between:.3g}"),
            "guess": name,
            "ipopt_seconds": round(row["ipopt_seconds"] + answer.seconds, 3),
            "ipopt_iterations": row["ipopt_iterations"] + answer.iterations,
        }
        if row["ipopt_solved"]:
            break
    return row


def counted(rows: Sequence[Row]) -> dict[str, int]:
    """How many problems each of the two solves, and who is faster."""
    both = [row for row in rows if row["solved"] and row["ipopt_solved"]]
    return {
        "problems": len(rows),
        "solved by both": len(both),
        "by the planner alone": sum(row["solved"] and not row["ipopt_solved"] for row in rows),
        "by IPOPT alone": sum(row["ipopt_solved"] and not row["solved"] for row in rows),
        "by none": sum(not row["ipopt_solved"] and not row["solved"] for row in rows),
        "IPOPT needed another guess": sum(
            row["ipopt_solved"] and row["guess"] != "same" for row in rows
        ),
        "planner slower by more than 0.1 %": sum(
            row["duration"] > (1 + SLOWER) * row["ipopt_duration"] for row in both
        ),
        "planner faster by more than 0.1 %": sum(
            row["duration"] < (1 - SLOWER) * row["ipopt_duration"] for row in both
        ),
        "the ZMP costs time": sum(row["status"] != "FASTEST_POSSIBLE" for row in both),
    }


def spread(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Distributions of durations, iterations and times."""
    both = [row for row in rows if row["solved"] and row["ipopt_solved"]]
    values = {
        "duration over IPOPT's": [row["duration"] / row["ipopt_duration"] for row in both],
        "iterations": [row["iterations"] for row in rows],
        "IPOPT's iterations": [row["ipopt_iterations"] for row in rows],
        "time in s": [row["seconds"] for row in rows],
        "IPOPT's time in s": [row["ipopt_seconds"] for row in rows],
    }
    return {name: distribution(numbers) for name, numbers in values.items() if numbers}


def report(rows: Sequence[Row]) -> dict[str, Any]:
    """Print the tables and return their numbers."""
    counts, table, bad = counted(rows), spread(rows), failures(rows)
    print_table("problems", ("", "count"), [(name, str(count)) for name, count in counts.items()])
    if table:
        shown = [
            (name, *(f"{value:.5f}" if " over " in name else value for value in of.values()))
            for name, of in table.items()
        ]
        print_table("distribution", ("", *next(iter(table.values()))), shown)
    print_table(
        "to look into",
        ("seed", *SHOWN),
        [[str(row["seed"]), *(row[key] for key in SHOWN)] for row in bad],
    )
    return {"counts": counts, "distributions": table, "to look into": [row["seed"] for row in bad]}


def failures(rows: Sequence[Row]) -> list[Row]:
    """Problems that IPOPT has solved, and the planner has not, or with a slower motion."""
    return [
        row
        for row in rows
        if row["ipopt_solved"]
        and not (row["solved"] and row["duration"] <= (1 + SLOWER) * row["ipopt_duration"])
    ]


def read_log(log: Path | None) -> dict[int, Row]:
    """Rows of a log by seed; none if there is no such file."""
    if log is None or not log.exists():
        return {}
    rows = map(json.loads, log.read_text(encoding="utf-8").splitlines())
    return {row["seed"]: row for row in rows}


def to_replan(log: Path | None, again: Path) -> dict[int, Row]:
    """IPOPT's columns of a log, and complete rows of problems that were planned again already."""
    done = {
        seed: {"seed": seed} | {key: row[key] for key in row if key.startswith(PEER_KEYS)}
        for seed, row in read_log(log).items()
    }
    return done | read_log(again)


def complete(done: dict[int, Row], seeds: Iterable[int], log: Path | None, limit: float) -> None:
    """Solve what is missing in the rows `done`, and append completed rows to the log.

    Args:
        done: Rows by seed, to be completed.
        seeds: Of the problems.
        log: File, or None.
        limit: Processor time of each of IPOPT's runs [s].
    """
    peer = None  # built when needed: ten seconds
    for seed in seeds:
        row = done.setdefault(seed, {"seed": seed})
        if "status" in row:
            continue
        named = peer_problem(seed)
        planners = planned(named)
        if "ipopt_status" not in row:
            peer = peer or Peer(named.scene, seconds=limit)
            row |= peered(named, peer)
        row |= planners
        if failures([row]):
            console.print(f"seed {seed}: {row}", style="bold", markup=False)
        if log is not None:
            with log.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")


def main() -> int:
    parser = benchmark_parser(__doc__, count=20)
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="processor time of each of IPOPT's runs"
    )
    parser.add_argument(
        "--log", type=Path, help="one JSON line per problem; those already there are kept"
    )
    parser.add_argument(
        "--replan",
        type=Path,
        help="plan the problems of the log again into this file; IPOPT's answers are kept",
    )
    options = parser.parse_args()
    numbers, log, done = seeds(options), options.log, read_log(options.log)
    if options.replan is not None:
        log, done = options.replan, to_replan(options.log, options.replan)
        numbers = sorted(set(numbers) & set(done))
    complete(done, numbers, log, options.seconds)
    rows = [done[seed] for seed in numbers]
    summary = report(rows)
    if options.json is not None:
        save_json(options.json, summary, rows=rows, columns=("seed", *SHOWN), digits=7)
    return exit_code(success=not failures(rows))


if __name__ == "__main__":
    sys.exit(main())
