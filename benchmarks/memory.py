"""Memory of one process in which many plans are made: it should stay flat once caches are filled.

python -m benchmarks.memory [--plans 10000]
"""

from __future__ import annotations

import resource
from pathlib import Path

import numpy as np

import zmp_sqp as zs
from benchmarks.harness import benchmark_parser, console
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_scene

LINES = 10  # printed on the way
WARM = 0.1  # share of the plans after which caches count as filled


def resident() -> float:
    """Memory that this process uses now [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


def growth(plans: int, *, seed: int = 0) -> float:
    """Growth of the memory per 1000 plans, once caches are filled [MB].

    The problems are variations of test 1 of the paper: random joint limits on a random slope.
    """
    machine = paper_scene(point_masses=False).load()
    rng, history = np.random.default_rng(seed), []
    for number in range(plans):
        limited = machine.with_limits(acceleration=1.0 + rng.random())
        slope = zs.Slope(roll=-0.35 * rng.random())
        zs.plan(zs.Problem(limited, PAPER_START, PAPER_GOAL, slope, intervals=10))
        history.append(resident())
        if (number + 1) % max(plans // LINES, 1) == 0:
            console.print(f"{number + 1:6d} plans: {history[-1]:.1f} MB")
    warm = history[int(WARM * plans) :]
    return 1e3 * (warm[-1] - warm[0]) / len(warm)


def main() -> None:
    parser = benchmark_parser(__doc__, results=False)
    parser.add_argument("--plans", type=int, default=10_000, help="default: 10000")
    console.print(f"growth: {growth(parser.parse_args().plans):.3f} MB per 1000 plans")


if __name__ == "__main__":
    main()
