"""Plans with a base that drives, for several tests; each is made once per process."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

import zmp_sqp as zs
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_scene
from benchmarks.problems.scene import Scene
from benchmarks.problems.terrain import rolling_map, unicycle_base

CHORD = 6.0  # [m] between start and goal of the retreat, on an arc of 1 rad


@cache
def terrain() -> tuple[Scene, zs.Plan]:
    """The retreat over a heightmap: waves on a side slope of 20 degrees."""
    scene = paper_scene(point_masses=False)
    return scene, zs.plan(replace(retreat_problem(scene), ground=rolling_map()))


@cache
def paper_2_joint() -> tuple[Scene, zs.Plan]:
    """Test 2 of Song & Sharf 2020 with base and arm planned together; the base backs up by 2 m."""
    scene = replace(paper_scene(), roll=np.deg2rad(-15.0), pitch=np.deg2rad(15.0))
    return scene, zs.plan(
        scene.problem(PAPER_START, PAPER_GOAL, base=unicycle_base(goal=(-2.0, 0.0, 0.0)))
    )


def retreat_problem(scene: Scene) -> zs.Problem:
    """The base backs up by 6 m on an arc of 1 rad while the arm swings by 180 degrees."""
    goal = (-CHORD * np.cos(0.5), -CHORD * np.sin(0.5), 1.0)
    return scene.problem(PAPER_START, PAPER_GOAL, base=unicycle_base(goal=goal))


@cache
def retreat() -> tuple[Scene, zs.Plan]:
    """The retreat on a plane side slope of 20 degrees, with rigid bodies."""
    scene = paper_scene(point_masses=False)
    return scene, zs.plan(retreat_problem(scene))
