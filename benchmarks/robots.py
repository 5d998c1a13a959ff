"""Load and plan machines of others: every URDF of the package example-robot-data.

    python -m benchmarks.robots [--count 20] [--only TEXT] [--workers 1] [--json FILE]
                                [--markdown FILE]

benchmarks/problems/robots.py says what is planned of each robot, and benchmarks/results/robots.md
has the results. A robot has an arm on a base if it stands at rest in at least half of random poses;
most arms that are bolted to the ground in reality do not. A problem counts as solved if its plan is
certified and the ZMP keeps the certified margin, where it is computed by differences of forward
kinematics alone (benchmarks/problems/differences.py). Times are processor times. The exit code is 1
where fewer than 75 robots load, or fewer than 95 % of the problems of those with an arm on a base
are solved.
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
    "zmp_error",
    "seconds",
    "slowest",
    "statuses",
    "sentence",
)


def run(path: Path, folder: Path, count: int) -> Row:
    """Load one robot, plan its problems, check the plans."""
    row: Row = dict.fromkeys(COLUMNS) | {"robot": str(path.relative_to(folder)), "loads": False}
    try:
        robot = load_robot(path, folder)
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
        "zmp_error": float(f"{max(errors, default=np.nan):.2g}"),
        "seconds": float(np.median(seconds)),
        "slowest": max(seconds),
        "statuses": dict(Counter(one["status"] for one in found)),
    }


def _plan(path: Path, problem: zs.Problem) -> Row:
    """Plan one problem, and compare the plan's ZMP with that of differences."""
    plan, row = timed_plan(problem)
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
    rows = []
    with ProcessPoolExecutor(options.workers) as pool:
        for row in pool.map(partial(run, folder=folder, count=options.count), paths):
            rows.append(row)
            console.print(" ".join(table([row], F)[0]))
    print_table("Machines of others", HEADINGS, table(rows, F))
    based = [row for row in rows if (row["standing"] or 0.0) >= ON_A_BASE]
    problems, solved = (sum(row[key] or 0 for row in based) for key in ("problems", "solved"))
    loaded = sum(row["loads"] for row in rows)
    result = (
        f"{loaded} of {len(rows)} robots load; {len(based)} have an arm on a base, and {solved} "
    )
    result += f"of their {problems} problems are solved"
    others = [row for row in rows if row["problems"] and row not in based]
    if others:
        of_others, of_them = (sum(row[key] for row in others) for key in ("solved", "problems"))
        result += (
            f"; of {len(others)} others, which stand in fewer than half of random poses, "
            f"{of_others} of {of_them}"
        )
    console.print(result)
    if options.json is not None:
        summary = {"F": F, "loaded": loaded, "problems": problems, "solved": solved}
        save_json(options.json, summary, rows=rows, columns=COLUMNS)
    if options.markdown is not None:
        command = f"python -m benchmarks.robots --count {options.count} --markdown"
        text = f"Made by {command}. {result}.\n\n{markdown(rows, F)}"
        options.markdown.write_text(text, encoding="utf-8")
    enough = options.only or loaded >= LEAST_LOADED
    return exit_code(success=bool(enough) and solved >= LEAST_SOLVED * problems)


if __name__ == "__main__":
    sys.exit(main())
