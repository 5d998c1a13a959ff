"""Seeded random problems for the comparison with IPOPT, harder than those of `problems.arm`."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.problems.scene import FOOTPRINT, NamedProblem, Scene, Tree, standing_poses

__all__ = ["peer_problem"]

STEEPEST = np.deg2rad(30.0)  # largest roll and pitch, in either direction
LIGHTEST = (1000.0, 2000.0)  # [kg] least payload of even and of odd seeds
HEAVIEST = 6000.0  # [kg]
LEAST_MARGIN = 0.02  # [m] stability margin at rest, at start and goal
LARGEST_MARGIN = (np.inf, 0.30)  # [m] of even and of odd seeds


def peer_problem(seed: int, **options: Any) -> NamedProblem:
    """Problem from rest to rest between two random poses; options are those of `zs.Problem`.

    Poses are uniform within the joint limits; the slew joint's limits are two turns apart. Start
    and goal of odd seeds are close to tipping over, so that the ZMP nearly always costs time.
    """
    rng, odd = np.random.default_rng([2021, seed]), seed % 2
    while True:
        roll, pitch = rng.uniform(-STEEPEST, STEEPEST, 2)
        tree = Tree(rng.uniform(LIGHTEST[odd], HEAVIEST))
        scene = Scene("feller_buncher", FOOTPRINT, tree, roll=roll, pitch=pitch)
        limits = scene.load().limits
        standing = standing_poses(
            rng,
            scene,
            (limits.position_lower, limits.position_upper),
            (LEAST_MARGIN, LARGEST_MARGIN[odd]),
        )
        if len(standing) >= 2:
            problem = scene.problem(*standing[:2], **options)
            return NamedProblem(f"peer_{seed}", scene, problem, None)
