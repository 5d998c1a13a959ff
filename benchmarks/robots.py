"""Load and plan machines of others: every URDF of the package example-robot-data.

    python -m benchmarks.robots [--count 20] [--only TEXT] [--workers 1] [--json FILE]
                                [--markdown FILE]

benchmarks/problems/robots.py says what is planned of each robot, and benchmarks/results/robots.md
has the results. First one arm of each robot, N = 50; then all joints that carry no foot, where
these are more than twelve, N = 24. A robot has an arm on a base if it stands at rest in at least
half of random poses; most arms that are bolted to the ground in reality do not. A problem counts as
solved if its plan is certified and the ZMP keeps the certified margin, where it is computed by
differences of forward kinematics alone (benchmarks/problems/differences.py). A problem that is not
solved counts as blocked if a joint has to pass a value at which the robot stands in no pose
(`blocked_at`): it starts and ends on the robot's feet, but no slow motion leads from one to the
other. Times are processor times. The exit code is 1 where fewer than 75 robots load, or fewer than
95 % of the problems of those with an arm on a base, or of all that are not blocked, are solved.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

import zmp_sqp as zs
from benchmarks.harness import (
    Row,
    benchmark_parser,
    console,
    exit_code,
    measure_F,
    print_table,
    save_json,
    timed_plan,
)
from benchmarks.problems.differences import SHORTEST, zmp_by_differences
from benchmarks.problems.robots import (
    blocked_at,
    load_robot,
    random_problems,
    robot_files,
    robots_folder,
    standing_share,
)

SAMPLES = 100  # times at which the ZMP is computed again
AGREEMENT = 1e-4  # [m] error of differences, by which the ZMP may miss what is certified
LEAST_LOADED, LEAST_SOLVED = 75, 0.95
ON_A_BASE = 0.5  # share of random poses in which a robot with an arm on a base stands
EXPLAINED = (
    "Blocked problems start and end where the robot stands, but one joint has to pass a value at "
    "which it stands in no pose, so that no slow motion leads from one to the other: most arms "
    "that are bolted to the ground in reality reach farther than their own base. Times were taken "
    "on a computer that other programs were using; alone, they are up to 1.3 times shorter."
)
COLUMNS = (
    "robot",
    "loads",
    "joints",
    "held",
    "planned",
    "support",
    "standing",
    "problems",
    "solved",
    "blocked",
    "zmp_error",
    "seconds",
    "slowest",
    "statuses",
    "sentence",
)


def run(path: Path, folder: Path, count: int, *, whole: bool = False) -> Row:
    """Load one robot, plan its problems, check the plans.

    Args:
        path: URDF.
        folder: Folder of all robots.
        count: Number of problems.
        whole: Whether to plan all joints that carry no foot, see `load_robot`.
    """
    row: Row = dict.fromkeys(COLUMNS) | {"robot": str(path.relative_to(folder)), "loads": False}
    try:
        robot = load_robot(path, folder, whole=whole)
    except zs.ZmpSqpError as refusal:
        return row | {"sentence": str(refusal).removeprefix(f"{path}: ")}
    row |= {"loads": True, "planned": robot.planned, "support": robot.support}
    if robot.machine is None:
        return row | {"sentence": robot.refusal}
    machine = robot.machine
    share = round(standing_share(machine), 3)
    row |= {"joints": machine.size, "held": len(machine.held), "standing": share}
    try:
        found = [_plan(path, problem) for _, problem in random_problems(robot, count)]
    except zs.ZmpSqpError as refusal:
        return row | {"sentence": str(refusal)}
    if not found:
        return row | {"sentence": "tips over at rest in all of the random poses"}
    seconds = [one["seconds"] for one in found]
    errors = [one["error"] for one in found if one["error"] is not None]
    return row | {
        "problems": len(found),
        "solved": sum(one["solved"] for one in found),
        "blocked": sum(one["blocked"] for one in found),
        "zmp_error": float(f"{max(errors):.2g}") if errors else None,
        "seconds": float(np.median(seconds)),
        "slowest": max(seconds),
        "statuses": dict(Counter(one["status"] for one in found)),
    }


def _plan(path: Path, problem: zs.Problem) -> Row:
    """Plan one problem, and compare the plan's ZMP with that of differences."""
    plan, row = timed_plan(problem)
    row["blocked"] = not plan.success and blocked_at(problem) is not None
    if not plan.success:
        return row | {"solved": False, "error": None}
    if plan.duration < SHORTEST:  # the goal is the start: there are no differences to take
        return row | {"solved": plan.certificate.safe, "error": None}
    machine, ground = problem.machine, problem.ground
    t, points = zmp_by_differences(path, machine, plan.trajectory, ground, SAMPLES)
    error = float(np.abs(points - zs.zmp(machine, *plan.trajectory(t), ground)).max())
    least = float(machine.support.signed_distance(points).min())
    kept = least >= plan.certificate.margin - AGREEMENT and plan.certificate.margin >= 0.0
    return row | {"solved": bool(kept and error < AGREEMENT), "error": error}


def table(rows: Sequence[Row], F: float) -> list[list[str]]:
    """Cells of the table of results."""

    def in_F(seconds: float | None) -> str:
        return "" if seconds is None else f"{seconds / F:.0f}"

    return [
        [
            row["robot"].split("/")[-1].removesuffix(".urdf"),
            "yes" if row["loads"] else "no",
            "" if row["joints"] is None else f"{row['joints']} + {row['held']}",
            row["planned"] or "",
            row["support"] or "",
            "" if row["standing"] is None else f"{100 * row['standing']:.0f}",
            "" if row["problems"] is None else f"{row['solved']} / {row['problems']}",
            str(row["blocked"] or ""),
            "" if row["zmp_error"] is None else f"{1e6 * row['zmp_error']:.2g}",
            in_F(row["seconds"]),
            in_F(row["slowest"]),
            row["sentence"] or "",
        ]
        for row in rows
    ]


HEADINGS = (
    "robot",
    "loads",
    "planned + held",
    "chosen",
    "support",
    "stands [%]",
    "solved",
    "blocked",
    "ZMP error [um]",
)
HEADINGS += ("median [F]", "slowest [F]", "why not")


def markdown(rows: Sequence[Row], F: float) -> str:
    """Results as a table in Markdown."""
    lines = [HEADINGS, ["---"] * len(HEADINGS), *table(rows, F)]
    return "".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |\n" for line in lines)


def main() -> int:
    parser = benchmark_parser(__doc__)
    parser.add_argument("--count", type=int, default=20, help="problems per robot (default 20)")
    parser.add_argument("--only", default="", metavar="TEXT", help="robots with this in their path")
    parser.add_argument("--workers", type=int, default=1, help="processes (default 1)")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the table here")
    options = parser.parse_args()
    folder = robots_folder()
    if folder is None:
        console.print("the package example-robot-data is not installed")
        return 1
    F = measure_F(zs.load_machine("feller_buncher"))
    paths = [path for path in robot_files(folder) if options.only in str(path)]
    rows: list[Row] = []
    whole: list[Row] = []
    with ProcessPoolExecutor(options.workers) as pool:
        for kept, all_joints in ((rows, False), (whole, True)):
            one = partial(run, folder=folder, count=options.count, whole=all_joints)
            for row in pool.map(one, paths):
                kept.append(row)
                console.print(" ".join(map(str, table([row], F)[0])))
    whole = [row for row in whole if row["joints"]]
    print_table("Arms", HEADINGS, table(rows, F))
    print_table("More than 12 joints", HEADINGS, table(whole, F))
    loaded = sum(row["loads"] for row in rows)
    of_arms, of_others = (
        [row for row in rows if _on_a_base(row) is based] for based in (True, False)
    )
    groups = {
        "arms on a base": of_arms,
        "arms that stand in fewer than half of random poses": of_others,
        "robots with more than 12 planned joints": whole,
    }
    counts = {name: _counts(group) for name, group in groups.items()}
    result = (
        f"{loaded} of {len(rows)} robots load. Solved: {'; '.join(map(_words, counts.items()))}"
    )
    console.print(result)
    if options.json is not None:
        summary = {"F": F, "loaded": loaded, "counts": counts}
        save_json(options.json, summary, rows=[*rows, *whole], columns=COLUMNS)
    if options.markdown is not None:
        command = f"python -m benchmarks.robots --count {options.count} --markdown"
        text = f"Made by {command}. {result}. {EXPLAINED}\n\n{markdown(rows, F)}\n"
        text += f"More than 12 joints, 24 intervals:\n\n{markdown(whole, F)}"
        options.markdown.write_text(text, encoding="utf-8")
    enough = options.only or loaded >= LEAST_LOADED
    solved = all(
        found["solved"] >= LEAST_SOLVED * (found["problems"] - (0 if based else found["blocked"]))
        for found, based in zip(counts.values(), (True, False, False), strict=True)
    )
    return exit_code(success=bool(enough) and solved)


def _on_a_base(row: Row) -> bool:
    """Whether a robot stands at rest in at least half of random poses."""
    return (row["standing"] or 0.0) >= ON_A_BASE


def _counts(rows: Sequence[Row]) -> dict[str, int]:
    """Numbers of robots with problems, and of their problems."""
    planned = [row for row in rows if row["problems"]]
    sums = {key: sum(row[key] for row in planned) for key in ("problems", "solved", "blocked")}
    return {"robots": len(planned), **sums}


def _words(named: tuple[str, dict[str, int]]) -> str:
    """Numbers of a group of robots in words."""
    name, found = named
    words = f"{found['robots']} {name}: {found['solved']} of {found['problems']} problems"
    return f"{words}, {found['blocked']} others blocked" if found["blocked"] else words


if __name__ == "__main__":
    sys.exit(main())
