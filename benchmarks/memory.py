"""Whether many plans in one process leave its memory flat: `python -m benchmarks.memory --plans 10000`."""

from __future__ import annotations

import argparse
import resource
from pathlib import Path

import numpy as np

import zmp_sqp as zs

SAMPLES = 10  # lines printed
WARM = 0.1  # share of the plans after which caches count as filled


def resident() -> float:
    """Memory of this process now [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


def grown(plans: int, *, seed: int = 0) -> float:
    """Growth per thousand plans once caches are filled [MB]."""
    tree = zs.Payload(mass=4000.0, com=(0.0, 0.0, 3.323), frame="head")
    machine = zs.load_machine("feller_buncher").with_payload(tree)
    start = np.array([0.0, -np.pi / 6, -2 * np.pi / 3, np.pi / 6, -np.pi / 2])
    goal = start + np.array([np.pi, 0.0, 0.0, 0.0, 0.0])
    rng, history = np.random.default_rng(seed), []
    for number in range(plans):
        changed = machine.with_limits(acceleration=1.0 + rng.random())
        zs.plan(zs.Problem(changed, start, goal, zs.Slope(roll=-0.35 * rng.random()), intervals=10))
        history.append(resident())
        if (number + 1) % max(plans // SAMPLES, 1) == 0:
            print(f"{number + 1:6d} plans: {history[-1]:.1f} MB", flush=True)
    warm = history[int(WARM * plans) :]
    return 1e3 * (warm[-1] - warm[0]) / len(warm)


def main() -> None:
    """Print the memory along the way and its growth."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", type=int, default=10_000)
    print(f"growth: {grown(parser.parse_args().plans):.3f} MB per 1000 plans")


if __name__ == "__main__":
    main()
