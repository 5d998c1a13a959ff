"""The problems on which the peer and the planner meet: seeded, rest to rest, harder than those of tests/problems.py."""

from __future__ import annotations

from typing import Any

import numpy as np

import zmp_sqp as zs
from tests.problems import FOOTPRINT, TRIES, NamedProblem, Scene, Tree

__all__ = ["peer_problem"]

SLOPE = np.deg2rad(30.0)  # largest roll and pitch, each way
LOADS = (1000.0, 2000.0), 6000.0  # [kg] least of even and of odd seeds, largest
# [m] static stability margin of start and goal: least, largest of even and of odd seeds
ROOM = 0.02, (np.inf, 0.30)


def peer_problem(seed: int, **options: Any) -> NamedProblem:
    """Two poses that stand by themselves, uniform within the joint limits, the slew over its two full turns.

    Even seeds take any two; odd ones take two near the edge, where the ZMP nearly always costs
    time.
    """
    rng, kind = np.random.default_rng([2021, seed]), seed % 2
    while True:
        roll, pitch = rng.uniform(-SLOPE, SLOPE, 2)
        tree = Tree(rng.uniform(LOADS[0][kind], LOADS[1]))
        scene = Scene("feller_buncher", FOOTPRINT, tree, roll=roll, pitch=pitch)
        machine = scene.load()
        poses = rng.uniform(
            machine.limits.position_lower, machine.limits.position_upper, (TRIES, machine.size)
        )
        still = np.zeros_like(poses)
        margins = zs.stability_margin(machine, poses, still, still, scene.ground)
        standing = poses[(margins >= ROOM[0]) & (margins <= ROOM[1][kind])]
        if len(standing) >= 2:
            return NamedProblem(
                f"peer_{seed}", scene, scene.problem(*standing[:2], **options), None
            )
