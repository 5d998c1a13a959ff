"""Certify plans of seeded problems: time per certificate in F, and how tight the margins are.

    python -m benchmarks.certificate [--count 40] [--first 0] [--repeats 5] [--json FILE]

Problem sets: the paper's first motion; hard problems of the arm whose plans are slower than their
lower bound; drives on slopes; drives over heightmaps; and ordinary problems with uncertain payload
and slope. Hard problems take their seeds from --first and --count, the others a quarter of that.
Every plan is certified several times, and the least processor time counts. A margin is tight where
it is little below the least of its samples, 1000 per second of motion and corner. The exit code is
1 where a margin is above a sample.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator

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
from benchmarks.problems.arm import HARD, ORDINARY, random_problem
from benchmarks.problems.driving import random_driving_problem
from benchmarks.problems.terrain import random_drive_problem
from zmp_sqp.planning.proof.certificate import certify_for
from zmp_sqp.scenario import load_scenario

SLOWER = 1.001  # times the lower bound: plans of hard problems that count
SAMPLES = 1000.0  # [1/s]
ROUNDING = 1e-9  # [m]
UNCERTAIN = {
    "tipping_fraction": 0.9,
    "payload_uncertainty": 0.1,
    "payload_com_uncertainty": 0.1,
    "slope_uncertainty": 0.02,
}
COLUMNS = ("set", "seed", "corners", "F", "margin", "below_samples")


def problems(count: int, first: int) -> Iterator[tuple[str, int, Callable[[], zs.Problem]]]:
    """Name of the set, seed, and problem."""
    yield "paper_1", 0, lambda: load_scenario("paper_1").problem
    for seed in range(first, first + count):
        yield "hard", seed, lambda seed=seed: random_problem(seed, HARD).problem
    for seed in range(first, first + count // 4):
        yield "drives", seed, lambda seed=seed: random_driving_problem(seed).problem
        yield "terrain", seed, lambda seed=seed: random_drive_problem(seed, over_terrain=True)
    for seed in range(first, first + count // 4):
        yield (
            "uncertain",
            seed,
            lambda seed=seed: random_problem(seed, ORDINARY, **UNCERTAIN).problem,
        )


def least_sampled(problem: zs.Problem, trajectory: zs.Trajectory) -> float:
    """Least margin of any corner at 1000 times per second [m]."""
    t = np.linspace(0.0, trajectory.duration, int(SAMPLES * trajectory.duration) + 2)
    nodes = trajectory.times[1:]  # accelerations may jump there, so that both sides count
    t = np.concatenate([t, nodes, np.nextafter(nodes, 0.0)])
    least = np.inf
    for corner in problem.corners(every=True):
        points = zs.trajectory_zmp(corner.machine, trajectory, t, corner.ground)
        assert corner.machine.support is not None
        least = min(least, float(corner.machine.support.signed_distance(points).min()))
    return least


def run(name: str, seed: int, problem: zs.Problem, F: float, repeats: int) -> Row | None:
    """Plan, certify and sample one problem; None if its plan does not count."""
    plan = zs.plan(problem)
    if not plan.success or (name == "hard" and plan.duration <= SLOWER * plan.lower_bound):
        return None
    results = [timed(lambda: certify_for(problem, plan.trajectory)) for _ in range(repeats)]
    found = results[0][0]
    return {
        "set": name,
        "seed": seed,
        "corners": len(problem.corners(every=True)),
        "F": min(timing.processor for _, timing in results) / F,
        "margin": found.margin,
        "below_samples": least_sampled(problem, plan.trajectory) - found.margin,
    }


def main() -> int:
    parser = benchmark_parser(__doc__, count=40)
    parser.add_argument("--repeats", type=int, default=5, help="certificates per plan (default 5)")
    options = parser.parse_args()
    machine = load_scenario("paper_1").problem.machine
    before, rows = measure_F(machine), []
    for name, seed, make in problems(options.count, options.first):
        try:
            problem = make()
        except zs.ProblemError:  # tips over at rest for one of the uncertain payloads
            continue
        row = run(name, seed, problem, before, options.repeats)
        if row is not None:
            rows.append(row)
    F = 0.5 * (before + measure_F(machine))
    for row in rows:
        row["F"] *= before / F
    sets = {name: [row for row in rows if row["set"] == name] for name, *_ in problems(4, 0)}
    summary = {
        name: {
            "count": len(some),
            "corners": max(row["corners"] for row in some),
            "F_median": float(np.median([row["F"] for row in some])),
            "F_max": max(row["F"] for row in some),
            "below_samples_median": float(np.median([row["below_samples"] for row in some])),
            "below_samples_max": max(row["below_samples"] for row in some),
        }
        for name, some in sets.items()
        if some
    }
    print_table(
        f"certificates; F = {1e3 * F:.3f} ms; below samples in m",
        ("set", "plans", "corners", "F median", "F max", "below median", "below max"),
        [(name, *values.values()) for name, values in summary.items()],
    )
    above = [row for row in rows if row["below_samples"] < -ROUNDING]
    for row in above:
        console.print(f"margin above a sample: {row}", style="bold", markup=False)
    if options.json is not None:
        save_json(options.json, {"F_seconds": F, "sets": summary}, rows=rows, columns=COLUMNS)
    return exit_code(success=not above)


if __name__ == "__main__":
    sys.exit(main())
