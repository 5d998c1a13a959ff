"""How much faster two local processes plan many problems than one: wall time, and the same bits.

    python -m benchmarks.many [--count N] [--repeats R] [--json FILE]

Both numbers of processes take turns; the least wall time of each counts, because whatever else the
computer does only adds to it. The start of the processes is included. The exit code is 1 if two
processes are less than 1.8 times as fast as one, or if a plan differs.
"""

from __future__ import annotations

import time

import numpy as np

import zmp_sqp as zs
from benchmarks.harness import (
    benchmark_parser,
    console,
    exit_code,
    print_table,
    save_json,
    seeds,
)
from benchmarks.problems.arm import random_problem

WORKERS = (1, 2)
TARGET = 1.8  # times as fast with two processes


def main() -> int:
    parser = benchmark_parser(__doc__, count=500)
    parser.add_argument("--repeats", type=int, default=2, help="runs of each (default 2)")
    options = parser.parse_args()
    problems = [random_problem(seed).problem for seed in seeds(options)]
    times: dict[int, list[float]] = {workers: [] for workers in WORKERS}
    found: dict[int, list[zs.Plan]] = {}
    for _ in range(options.repeats):
        for workers in WORKERS:
            started = time.perf_counter()
            found[workers] = zs.plan_many(problems, workers=workers)
            times[workers].append(time.perf_counter() - started)
    least = {workers: min(taken) for workers, taken in times.items()}
    gain = least[1] / least[2]
    same = all(map(_same, *found.values()))
    rows = [(str(workers), f"{least[workers]:.2f}") for workers in WORKERS]
    print_table(f"{len(problems)} problems", ("processes", "wall time [s]"), rows)
    solved = sum(plan.success for plan in found[2])
    console.print(f"two processes: {gain:.2f} times as fast; {solved} solved; same bits: {same}")
    result = {
        "count": len(problems),
        "solved": solved,
        "wall_times": {str(workers): taken for workers, taken in times.items()},
        "gain": gain,
        "same_bits": same,
    }
    if options.json:
        save_json(options.json, result)
    return exit_code(success=same and gain >= TARGET)


def _same(one: zs.Plan, other: zs.Plan) -> bool:
    """Whether two plans have the same status and the same bits."""
    if one.status is not other.status or (one.attempt is None) is not (other.attempt is None):
        return False
    if one.attempt is None or other.attempt is None:
        return True
    return np.array_equal(one.attempt.positions, other.attempt.positions)


if __name__ == "__main__":
    raise SystemExit(main())
