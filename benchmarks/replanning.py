"""Times of re-plans and of certified stops in F, against cold plans of the same problems.

    python -m benchmarks.replanning [--count 120] [--replans 1000] [--json FILE]

A re-plan begins in a state of the last plan, with `Planner` and without a time budget: along the
last plan, with a goal that moves by 0.1 rad, or with a payload that changes by 10 %. Its time is
compared with that of `zs.plan` from the same state. A stream re-plans every 50 ms until the goal,
first while tip-over shapes the last motion, if it does, then at the bound. The problems are
paper_1, retreat (base and arm) and the hard random problems of benchmarks/problems/arm.py;
"active" are those whose tip-over limit costs more than 0.1 % of the lower bound. Stops begin where
the joints are fastest. Times are processor times, divided by F as measured before and after each
group; certificates are included.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

import zmp_sqp as zs
from benchmarks.harness import (
    Row,
    benchmark_parser,
    console,
    distribution,
    exit_code,
    measure_F,
    print_table,
    save_json,
    timed,
)
from benchmarks.problems.arm import HARD, random_problem
from zmp_sqp.scenario import load_scenario

SEEDS = (*range(40), *range(200, 240), *range(1000, 1040))
STEP = 0.05  # [s] between the re-plans of a control loop
SHARES = (0.1, 0.3, 0.5)  # of the last plan's duration, at which re-plans begin
CLOSE = 1e-4  # relative: durations that count as the same
ACTIVE = 1e-3  # relative excess over the lower bound from which on tip-over costs time
# what is asked for, by row of the table
ASKED = {
    "along the last plan, paper_1 [F]": 20.0,
    "along the last plan, retreat [F]": 40.0,
    "50 ms along the last plan, active [of cold]": 0.25,
    "10 to 50 % along the last plan, active [of cold]": 0.25,
    "goal moved by 0.1 rad, active [of cold]": 0.5,
    "payload changed by 10 %, active [of cold]": 0.5,
    "stop from full speed [F]": 15.0,
    "worst of the re-plans [median]": 5.0,
    "worst of the re-plans at the bound [their median]": 5.0,
    "worst of the re-plans that tip-over shapes [their median]": 5.0,
}
STREAMS = ("stream, at the bound", "stream, shaped by tip-over")


def planner_of(problem: zs.Problem) -> zs.Planner:
    return zs.Planner(
        problem.machine,
        ground=problem.ground,
        margin=problem.margin,
        intervals=problem.intervals,
        constraints=problem.constraints,
    )


def state_at(plan: zs.Plan, t: float) -> dict[str, Any]:
    """Fields of a `Problem` that begins in the state of a plan at a time [s]."""
    q, v, _ = plan.trajectory(t)
    state = {"start": q, "start_velocity": v}
    base = plan.trajectory.base
    if base is not None and plan.problem.base is not None:
        pose, velocity, _ = base(t)
        state["base"] = replace(plan.problem.base, start=pose, start_velocity=velocity)
    return state


def one(problem: zs.Problem, share: float, changes: dict[str, Any], case: str, seed: Any) -> Row:
    """Re-plan from a share of the last plan's duration, and the cold plan of that problem."""
    planner = planner_of(problem)
    first = planner.plan(problem.start, problem.goal, base=problem.base)
    t = share * first.duration
    changed = replace(problem, **state_at(first, t), **changes)
    planner.machine = changed.machine
    asked = {"goal": changed.goal, "base": changed.base, "elapsed": t}
    before = measure_F(problem.machine, repeats=11)
    warm, took = timed(
        lambda: planner.plan(changed.start, start_velocity=changed.start_velocity, **asked)
    )
    cold, took_cold = timed(lambda: zs.plan(changed))
    F = 0.5 * (before + measure_F(problem.machine, repeats=11))
    return {
        "case": case,
        "seed": seed,
        "share": share,
        "warm": took.processor / F,
        "cold": took_cold.processor / F,
        "ratio": took.processor / took_cold.processor,
        "longer": warm.duration / cold.duration - 1.0,
        "status": warm.status.name,
        "iterations": warm.iterations,
        "success": warm.success and warm.certificate.safe,
    }


def scenario_rows() -> list[Row]:
    rows = []
    for name in ("paper_1", "retreat"):
        problem = load_scenario(name).problem
        shares = np.linspace(0.05, 0.8, 8)
        rows += [one(problem, share, {}, f"along the last plan, {name}", name) for share in shares]
    return rows


def active_problems(count: int) -> list[tuple[int, zs.Problem, zs.Plan]]:
    found = []
    for seed in SEEDS[:count]:
        problem = random_problem(seed, HARD).problem
        plan = zs.plan(problem)
        if plan.success and plan.duration > (1.0 + ACTIVE) * plan.lower_bound:
            found.append((seed, problem, plan))
    return found


def active_rows(found: Iterable[tuple[int, zs.Problem, zs.Plan]]) -> list[Row]:
    rows = []
    for seed, problem, plan in found:
        rng = np.random.default_rng([141, seed])
        soon = STEP / plan.duration
        rows.append(one(problem, soon, {}, "50 ms along the last plan, active", seed))
        case = "10 to 50 % along the last plan, active"
        rows += [one(problem, share, {}, case, seed) for share in SHARES]
        moved = goal_near(problem, rng)
        if moved is not None:
            case = "goal moved by 0.1 rad, active"
            rows.append(one(problem, 0.2, {"goal": moved}, case, seed))
        for factor in (0.9, 1.1):
            machine = problem.machine.with_payload_scaled(factor)
            case = "payload changed by 10 %, active"
            try:
                rows.append(one(problem, 0.2, {"machine": machine}, case, seed))
            except zs.ProblemError:  # with the heavier payload it tips over at the goal
                continue
    return rows


def goal_near(problem: zs.Problem, rng: np.random.Generator) -> np.ndarray | None:
    """Goal of which one joint has moved by 0.1 rad; None if the machine stands at none."""
    for _ in range(20):
        goal = problem.goal.copy()
        goal[rng.integers(len(goal))] += rng.choice([-0.1, 0.1])
        try:
            return replace(problem, goal=goal).goal
        except zs.ProblemError:
            continue
    return None


def stop_rows(count: int) -> list[Row]:
    """Certified stops from the moment at which the joints of a hard plan are fastest."""
    rows = []
    for seed in SEEDS[:count]:
        problem = random_problem(seed, HARD).problem
        plan = zs.plan(problem)
        if not plan.success:
            continue
        times = np.linspace(0.0, plan.duration, 200)
        q, v, _ = plan.trajectory(times)
        k = int((np.abs(v) / problem.machine.limits.velocity).sum(axis=1).argmax())
        F = measure_F(problem.machine, repeats=11)
        stop, took = timed(
            lambda q=q[k], v=v[k], of=problem: zs.plan_stop(
                of.machine, q, v, of.ground, margin=of.margin
            )
        )
        rows.append(
            {
                "case": "stop from full speed",
                "seed": seed,
                "share": float(times[k] / plan.duration),
                "warm": took.processor / F,
                "status": stop.status.name,
                "iterations": stop.iterations,
                "success": stop.success and stop.certificate.safe,
            }
        )
    return rows


def stream_rows(count: int) -> list[Row]:
    """Re-plans every 50 ms along the plans of hard problems, from the state of the last one."""
    rows: list[Row] = []
    for seed in SEEDS:
        problem = random_problem(seed, HARD).problem
        planner, F = planner_of(problem), measure_F(problem.machine, repeats=11)
        plan = planner.plan(problem.start, problem.goal)
        while plan.success and plan.duration > 4.0 * STEP and len(rows) < count:
            q, v, _ = plan.trajectory(STEP)
            call = partial(planner.plan, q, problem.goal, v, elapsed=STEP)
            before, shaped = plan.duration, plan.status is not zs.Status.FASTEST_POSSIBLE
            plan, took = timed(call)
            rows.append(
                {
                    "case": STREAMS[shaped],
                    "seed": seed,
                    "share": STEP / before,
                    "warm": took.processor / F,
                    "status": plan.status.name,
                    "iterations": plan.iterations,
                    "longer": plan.duration / (before - STEP) - 1.0,
                    "success": plan.success and plan.certificate.safe,
                }
            )
        if len(rows) >= count:
            break
    return rows


def summarise(rows: list[Row]) -> dict[str, Any]:
    """Medians and quantiles by case, and the table of what is asked for."""
    cases: dict[str, Any] = {}
    for case in dict.fromkeys(row["case"] for row in rows):
        mine = [row for row in rows if row["case"] == case]
        cases[case] = {
            "count": len(mine),
            "failed": sum(not row["success"] for row in mine),
            "time_in_F": distribution([row["warm"] for row in mine]),
        }
        if "ratio" in mine[0]:
            cases[case]["share_of_cold"] = distribution([row["ratio"] for row in mine])
            cases[case]["cold_in_F"] = distribution([row["cold"] for row in mine])
        if "longer" in mine[0]:
            cases[case]["longer"] = distribution([row["longer"] for row in mine])
    table = {}
    for name in ASKED:
        case, _, unit = name.removesuffix("]").partition(" [")
        if case.startswith("worst of the re-plans"):
            chosen = STREAMS[:1] if case.endswith("bound") else STREAMS[1:]
            chosen = STREAMS if unit == "median" else chosen
            times = [row["warm"] for row in rows if row["case"] in chosen]
            table[name] = max(times) / float(np.median(times))
        else:
            key = "time_in_F" if unit == "F" else "share_of_cold"
            table[name] = cases[case][key]["50 %"]
    return {"asked_for": ASKED, "measured": table, "cases": cases}


def main() -> int:
    parser = benchmark_parser(__doc__)
    parser.add_argument("--count", type=int, default=len(SEEDS), help="hard problems, default 120")
    parser.add_argument("--replans", type=int, default=1000, help="of the stream, default 1000")
    options = parser.parse_args()
    rows = [*scenario_rows(), *active_rows(active_problems(options.count))]
    rows += [*stop_rows(options.count), *stream_rows(options.replans)]
    summary = summarise(rows)
    print_table(
        "re-plans and stops, medians",
        ("", "asked for", "measured"),
        [(name, ASKED[name], summary["measured"][name]) for name in ASKED],
    )
    print_table(
        "times [F]",
        ("", "number", "failed", *summary["cases"][STREAMS[0]]["time_in_F"]),
        [
            (name, case["count"], case["failed"], *case["time_in_F"].values())
            for name, case in summary["cases"].items()
        ],
    )
    slow = {
        key: sum(row.get("longer", 0.0) > CLOSE for row in rows if row["case"] == key)
        for key in summary["cases"]
    }
    console.print(f"motions longer by more than {CLOSE:g} than the cold or the last one: {slow}")
    columns = ("case", "seed", "share", "warm", "cold", "longer", "status", "iterations", "success")
    for row in rows:
        row.setdefault("cold", None)
        row.setdefault("longer", None)
    if options.json is not None:
        save_json(options.json, summary, rows=rows, columns=columns, digits=6)
    return exit_code(success=all(row["success"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
