"""Seeded random problems of the arm: from rest to rest on a random slope, the base at rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.problems.scene import (
    FOOTPRINT,
    NamedProblem,
    Scene,
    Tree,
    arm_range,
    standing_poses,
)

__all__ = ["HARD", "ORDINARY", "ROBUST", "Recipe", "random_problem", "random_scene"]


@dataclass(frozen=True)
class Recipe:
    """Ranges that a random problem is drawn from."""

    name: str
    payload: tuple[float, float]  # [kg]
    slope: float  # [rad] largest roll and pitch, in either direction
    margin: tuple[float, float]  # [m] least and largest stability margin at rest, start and goal


ORDINARY = Recipe("ordinary", (500.0, 4000.0), np.deg2rad(25.0), (0.05, np.inf))
# heavier payloads, steeper slopes, start and goal close to tipping over
HARD = Recipe("hard", (2000.0, 6500.0), np.deg2rad(28.0), (0.02, 0.30))
# as heavy and steep, with start and goal that stand with an uncertain payload and slope, too
ROBUST = Recipe("robust", (2500.0, 6500.0), np.deg2rad(28.0), (0.25, 0.60))


def random_scene(seed: int, recipe: Recipe = ORDINARY) -> tuple[Scene, np.ndarray]:
    """Scene, and two poses in which the machine stands at rest, shape (2, n).

    Poses are uniform within the joint limits, the slew joint's within one turn. A slope on which
    fewer than two of 2000 poses have the recipe's margin is replaced by another one.
    """
    rng = np.random.default_rng([2020, seed])
    while True:
        roll, pitch = rng.uniform(-recipe.slope, recipe.slope, 2)
        tree = Tree(rng.uniform(*recipe.payload))
        scene = Scene("feller_buncher", FOOTPRINT, tree, roll=roll, pitch=pitch)
        standing = standing_poses(rng, scene, arm_range(scene.load()), recipe.margin)
        if len(standing) >= 2:
            return scene, standing[:2]


def random_problem(seed: int, recipe: Recipe = ORDINARY, **options: Any) -> NamedProblem:
    """Problem from rest to rest between two random poses; options are those of `zs.Problem`."""
    scene, (start, goal) = random_scene(seed, recipe)
    return NamedProblem(f"{recipe.name}_{seed}", scene, scene.problem(start, goal, **options), None)
