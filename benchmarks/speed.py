"""How long planning takes, in F: 100 calls of `pin.computeRNEADerivatives` on the same model.

    python -m benchmarks.speed [--repeats 15] [--json FILE]

F is the project's unit of speed: seconds depend on the computer, times in F much less. Both are
processor times, which other programs disturb less; on an idle computer wall times are equal. Every
call is cold: it reuses no motion, multipliers or workspace of an earlier call. "In a new process"
is a call before which nothing was imported, so that it has to load Pinocchio and the QP solver; all
other rows are medians of many calls. The exit code is 1 where a scenario takes longer than asked.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping

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
    timed,
)
from benchmarks.problems.arm import random_problem
from benchmarks.problems.paper import paper_1
from zmp_sqp.blas import one_blas_thread
from zmp_sqp.planning.search.blind import certified_blind_motion
from zmp_sqp.planning.search.explore import explore
from zmp_sqp.planning.search.prove import prove
from zmp_sqp.planning.search.refine import refine
from zmp_sqp.planning.search.run import Runs
from zmp_sqp.planning.search.task import task_of
from zmp_sqp.scenario import load_scenario

BACKENDS = ("auto", "piqp", "proxqp", "qpsolvers:piqp", "qpsolvers:daqp", "qpsolvers:clarabel")
SLOWED_BY_TIPPING = (29, 121)  # seeds of ORDINARY whose duration is above the joints' lower bound
# [F] most that a scenario may take with the default QP solver
ASKED = {"paper_1": 35.0, "paper_1_simplified": 20.0, "retreat": 90.0}
PHASES = ("formulate", "blind", "explore", "refine", "prove")  # the planner's steps
COLUMNS = (
    "problem",
    "QP solver",
    "status",
    "iterations",
    "T [s]",
    "median [F]",
    "min [F]",
    "max [F]",
    "wall [ms]",
    "F [ms]",
)
FIRST = """
import json, time
started = time.perf_counter()
import zmp_sqp as zs
imported = time.perf_counter()
from zmp_sqp.scenario import load_scenario
problem = load_scenario("paper_1").problem
loaded = time.perf_counter()
first = zs.plan(problem)
planned = time.perf_counter()
print(json.dumps([imported - started, loaded - imported, planned - loaded]))
"""


def first_call() -> dict[str, float]:
    """Wall time of importing, loading and planning in a new process, which has to load all [s]."""
    answer = subprocess.run(
        [sys.executable, "-c", FIRST], capture_output=True, check=True, text=True
    )
    return dict(
        zip(("import", "load scenario", "first plan"), json.loads(answer.stdout), strict=True)
    )


def calls(problem: zs.Problem, qp_solver: str, repeats: int) -> tuple[np.ndarray, zs.Plan]:
    """Times of every call after the first, and the last plan.

    F is measured right before and right after each call, because it varies with the load of the
    computer.

    Returns:
        Processor time, wall time and F of each call, shape (repeats, 3) [s], and the plan.
    """
    plan, rows = zs.plan(problem, qp_solver=qp_solver), []
    F = measure_F(problem.machine, repeats=9)
    for _ in range(repeats):
        plan, took = timed(lambda: zs.plan(problem, qp_solver=qp_solver))
        before, F = F, measure_F(problem.machine, repeats=9)
        rows.append((*took, 0.5 * (before + F)))
    return np.array(rows), plan


def step_times(problem: zs.Problem) -> dict[str, float]:
    """Processor time of each of the planner's steps [s]; all are taken where the first fails."""
    runs = Runs.start("auto", None, None)
    with one_blas_thread():
        task, formulated = timed(lambda: task_of(problem))
        _, tried = timed(lambda: certified_blind_motion(task))
        found, explored = timed(lambda: explore(task, runs))
        refined, refining = timed(lambda: refine(task, found, runs))
        _, proven = timed(lambda: prove(task, refined, runs))
    steps = (formulated, tried, explored, refining, proven)
    return {name: took.processor for name, took in zip(PHASES, steps, strict=True)}


def phases(problem: zs.Problem, repeats: int) -> dict[str, float]:
    """Processor time of a plan by step, medians [s]."""
    samples = [step_times(problem) for _ in range(repeats)]
    return {name: float(np.median([sample[name] for sample in samples])) for name in PHASES}


def scenarios_in_F(repeats: int) -> dict[str, float]:
    """Time of a plan of each scenario in `ASKED`, medians [F]."""
    found = {}
    for name, asked in ASKED.items():
        times, plan = calls(load_scenario(name).problem, "auto", repeats)
        found[name] = float(np.median(times[:, 0] / times[:, 2]))
        console.print(
            f"{name}: {found[name]:.1f} F, {plan.iterations} iterations, asked for {asked:.0f} F"
        )
    return found


def backend_rows(repeats: int) -> list[Row]:
    """Times of each QP solver on test 1 of the paper, and on random problems that tipping slows."""
    problems = [
        paper_1(),
        paper_1(point_masses=False),
        *(random_problem(seed) for seed in SLOWED_BY_TIPPING),
    ]
    rows = []
    for named in problems:
        for qp_solver in BACKENDS:
            times, plan = calls(named.problem, qp_solver, repeats)
            in_F, (_, wall, F) = times[:, 0] / times[:, 2], 1e3 * np.median(times, axis=0)
            measured = (np.median(in_F), in_F.min(), in_F.max(), wall)
            row = [
                named.name,
                qp_solver,
                plan.status.name,
                plan.iterations,
                round(plan.duration, 6),
            ]
            row += [*(round(float(value), 1) for value in measured), round(float(F), 4)]
            rows.append(dict(zip(COLUMNS, row, strict=True)))
    return rows


def print_phases(split: Mapping[str, float], F: float) -> None:
    """Print the phases of a plan in milliseconds, F and shares."""
    whole = sum(split.values())
    print_table(
        "paper_1, default QP solver, by phase",
        ("phase", "ms", "F", "share"),
        [
            (name, 1e3 * seconds, seconds / F, f"{100.0 * seconds / whole:.0f} %")
            for name, seconds in split.items()
        ],
    )


def main() -> int:
    parser = benchmark_parser(__doc__)
    parser.add_argument("--repeats", type=int, default=15, help="calls per row (default 15)")
    options = parser.parse_args()

    first, found = first_call(), scenarios_in_F(2 * options.repeats)
    rows, split = backend_rows(options.repeats), phases(paper_1().problem, options.repeats)

    print_table("cold calls", COLUMNS, [list(row.values()) for row in rows])
    print_phases(split, measure_F(paper_1().problem.machine))
    print_table(
        "paper_1 in a new process",
        ("step", "ms"),
        [(name, 1e3 * seconds) for name, seconds in first.items()],
    )
    print_table(
        "cold, default QP solver",
        ("scenario", "F", "asked for"),
        [(name, round(found[name], 1), ASKED[name]) for name in ASKED],
    )
    if options.json is not None:
        content = {
            "cold_in_F": found,
            "asked_in_F": ASKED,
            "repeats": options.repeats,
            "new_process_seconds": first,
            "paper_1_phases_seconds": split,
        }
        save_json(options.json, content, rows=rows, columns=COLUMNS)
    return exit_code(success=all(found[name] <= ASKED[name] for name in ASKED))


if __name__ == "__main__":
    sys.exit(main())
