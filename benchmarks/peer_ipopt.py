"""Our planner beside CasADi and IPOPT on the same seeded problems: who solves what, how fast the motions are.

    python -m benchmarks.peer_ipopt [--count 20] [--first 0] [--log FILE.jsonl] [--json FILE]

Needs casadi. Both get the same question (benchmarks/peer_problems.py): N = 50, constant
accelerations per interval, rows of the wrench at the same points; IPOPT keeps no guard from any
edge. Its transcription and its dynamics are its own (peer_transcription.py, peer_dynamics.py). It
starts from the planner's own initial guess, then, where that fails, from the same motion at half
the pace, then from one by way of the folded arm.

A motion counts as solved if an independent check (benchmarks/problems/checks.py) of it, integrated anew, finds no
violation of 1e-6 at those points; ours must be certified for all t besides. The planner lets
accelerations run linearly within the intervals where the ZMP costs time; `constant` is what it had
before.

With --log every problem is a line of that file; problems already there are not solved again. The
exit code is 1 where IPOPT has solved a problem and the planner has not, or is slower by more than
0.1 %.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import zmp_sqp as zs
from benchmarks.harness import console, distribution, print_table, save_json
from benchmarks.peer_problems import peer_problem
from benchmarks.peer_transcription import Peer, PeerMotion, by_way_of
from benchmarks.problems.checks import check_feasibility
from benchmarks.problems.scene import NamedProblem
from zmp_sqp.planning.search import planner

__all__ = ["ours", "peered", "planned"]

TOLERANCE = 1e-6  # [m, rad, per second ...] largest violation of a solved problem
SLOWER = 1e-3  # relative: what the planner's motions may be slower by
FOLDED = {"boom": 0.0, "stick": -2.8, "tilt": 1.2}  # [rad] the arm drawn in
CONVERGED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
SHOWN = (
    "status",
    "duration",
    "constant",
    "iterations",
    "seconds",
    "ipopt_status",
    "ipopt_duration",
    "ipopt_iterations",
    "ipopt_seconds",
    "guess",
)
PEER_KEYS = ("guess", "ipopt_")


def ours(named: NamedProblem) -> tuple[zs.Plan, PeerMotion, list[tuple[str, int, float]], float]:
    """Plan, initial guess, (status, iterations, duration) of every SQP run behind it, processor seconds."""
    minimize, runs, guesses = planner.SQP.minimize, [], []

    def recorded(sqp: Any, nlp: Any, x: np.ndarray) -> Any:
        q, w, controls, S = nlp.unpack(x)
        guesses.append(PeerMotion(q, w / np.sqrt(S), controls[:, 0] / S, float(np.sqrt(S))))
        result = minimize(sqp, nlp, x)
        runs.append(
            (result.status.name, len(result.history), float(np.sqrt(nlp.unpack(result.x)[3])))
        )
        return result

    with mock.patch.object(planner.SQP, "minimize", recorded):
        started = time.process_time()
        plan = zs.plan(named.problem)
        elapsed = time.process_time() - started
    return plan, guesses[0], runs, elapsed


def guesses(named: NamedProblem, first: PeerMotion) -> list[tuple[str, PeerMotion]]:
    """Where IPOPT may start, one after the other."""
    slower = PeerMotion(first.q, 0.5 * first.v, 0.25 * first.a, 2.0 * first.duration)
    folded = 0.5 * (named.problem.start + named.problem.goal)
    for joint, angle in FOLDED.items():
        folded[named.problem.machine.joint_names.index(joint)] = angle
    return [
        ("same", first),
        ("slower", slower),
        ("folded", by_way_of(named.problem, first, folded, slower=2.0)),
    ]


def planned(named: NamedProblem) -> tuple[dict[str, Any], PeerMotion]:
    """The planner's share of a row, ready for JSON, and its initial guess."""
    plan, first, runs, elapsed = ours(named)
    violation = np.inf
    if plan.attempt is not None:
        violation = check_feasibility(named.scene, named.problem, plan.attempt).violation
    row = {
        "solved": bool(plan.success and violation < TOLERANCE),
        "status": plan.status.name,
        "duration": plan.duration,
        "lower_bound": plan.lower_bound,
        "constant": runs[0][2],
        "runs": runs,
        "iterations": plan.iterations,
        "seconds": round(elapsed, 4),
        "violation": float(f"{violation:.3g}"),
    }
    return row, first


def peered(named: NamedProblem, peer: Peer, first: PeerMotion) -> dict[str, Any]:
    """IPOPT's share of a row, ready for JSON: of the guess that led it to a solution, or of the last one."""
    row: dict[str, Any] = {"ipopt_seconds": 0.0, "ipopt_iterations": 0}
    for name, guess in guesses(named, first):
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


def report(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Print the tables; the numbers in them."""
    both = [row for row in rows if row["solved"] and row["ipopt_solved"]]
    counts = {
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
        "planner above the bound of the joints' grid": sum(
            row["runs"][0][0] != "BOUND_REACHED" for row in both
        ),
    }
    print_table("problems", ("", "count"), [(name, str(count)) for name, count in counts.items()])
    spread = {
        "duration over IPOPT's": [row["duration"] / row["ipopt_duration"] for row in both],
        "likewise, accelerations constant": [
            row["constant"] / row["ipopt_duration"] for row in both
        ],
        "iterations": [row["iterations"] for row in rows],
        "IPOPT's iterations": [row["ipopt_iterations"] for row in rows],
        "time in s": [row["seconds"] for row in rows],
        "IPOPT's time in s": [row["ipopt_seconds"] for row in rows],
    }
    table = {name: distribution(values) for name, values in spread.items() if values}
    if table:
        columns = ("", *next(iter(table.values())))
        shown = [
            (
                name,
                *(f"{v:.5f}" if "over" in name or "likewise" in name else v for v in of.values()),
            )
            for name, of in table.items()
        ]
        print_table("distribution", columns, shown)
    bad = failures(rows)
    print_table(
        "to look into",
        ("seed", *SHOWN),
        [[str(row["seed"]), *(row[key] for key in SHOWN)] for row in bad],
    )
    return {"counts": counts, "distributions": table, "to look into": [row["seed"] for row in bad]}


def failures(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Problems that IPOPT has solved and the planner has not, or not as fast."""
    return [
        row
        for row in rows
        if row["ipopt_solved"]
        and not (row["solved"] and row["duration"] <= (1 + SLOWER) * row["ipopt_duration"])
    ]


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--count", type=int, default=20, help="how many problems: seeds 0, 1, ... (default 20)"
    )
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="processor time of each of IPOPT's runs"
    )
    parser.add_argument(
        "--log", type=Path, help="one JSON line per problem; those already there are kept"
    )
    parser.add_argument(
        "--replan",
        type=Path,
        help="plan the log's problems anew into this file; IPOPT's answers stay",
    )
    parser.add_argument(
        "--json", type=Path, help="write the summary and every problem's numbers here"
    )
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.count)
    done: dict[int, dict[str, Any]] = {}
    if options.log is not None and options.log.exists():
        done = {
            row["seed"]: row
            for row in map(json.loads, options.log.read_text(encoding="utf-8").splitlines())
        }
    if options.replan is not None:
        done = {
            seed: {"seed": seed} | {key: row[key] for key in row if key.startswith(PEER_KEYS)}
            for seed, row in done.items()
        }
        options.log = options.replan
        if options.log.exists():
            again = map(json.loads, options.log.read_text(encoding="utf-8").splitlines())
            done |= {row["seed"]: row for row in again}
        seeds = sorted(set(seeds) & set(done))
    peer = None
    for seed in seeds:
        row = done.setdefault(seed, {"seed": seed})
        if "status" in row:
            continue
        named = peer_problem(seed)
        of_ours, first = planned(named)
        if "ipopt_status" not in row:
            peer = peer or Peer(named.scene, seconds=options.seconds)
            row |= peered(named, peer, first)
        row |= of_ours
        if failures([row]):
            console.print(f"[bold]seed {seed}[/bold]: {row}")
        if options.log is not None:
            with options.log.open("a", encoding="utf-8") as log:
                log.write(json.dumps(row) + "\n")
    rows = [done[seed] for seed in seeds]
    summary = report(rows)
    if options.json is not None:
        keys = ("seed", *SHOWN)
        table = [
            [round(row[key], 7) if isinstance(row[key], float) else row[key] for key in keys]
            for row in rows
        ]
        save_json(options.json, {**summary, "columns": keys}, rows=table)
    return 1 if failures(rows) else 0


if __name__ == "__main__":
    sys.exit(main())
