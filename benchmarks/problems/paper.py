"""Test 1 of Song & Sharf 2020: half a turn of the arm across a slope of 20 degrees."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.problems.scene import FOOTPRINT, NamedProblem, Scene, Tree

__all__ = ["PAPER_GOAL", "PAPER_START", "paper_1", "paper_scene"]

PAPER_START = np.array([0.0, -np.pi / 6, -2.0 * np.pi / 3, np.pi / 6, -np.pi / 2])  # eq. (22)
PAPER_GOAL = np.array([np.pi, -np.pi / 6, -2.0 * np.pi / 3, np.pi / 6, -np.pi / 2])  # eq. (23)


def paper_scene(*, point_masses: bool = True) -> Scene:
    """Feller-buncher with a tree of 4 t, leaning 20 degrees to its left."""
    return Scene(
        "feller_buncher", FOOTPRINT, Tree(4000.0), roll=np.deg2rad(-20.0), point_masses=point_masses
    )


def paper_1(*, point_masses: bool = True, **options: Any) -> NamedProblem:
    r"""Test 1 of Song & Sharf 2020, whose optimum is 4.5 s.

    The slew joint decides. It turns by D = pi with at most v = pi/4 rad/s and a = pi/2 rad/s^2,
    which takes D/v + v/a = 4 + 0.5 = 4.5 s, and the ZMP can be kept inside meanwhile. On a grid of
    N = 50 intervals the switching times fall between the nodes, and the optimum is 4.50402 s.
    """
    scene = paper_scene(point_masses=point_masses)
    name = "paper_1" if point_masses else "paper_1_rigid"
    return NamedProblem(name, scene, scene.problem(PAPER_START, PAPER_GOAL, **options), 4.5)
