"""Plans for several tests, made once per process, and poses of the simplified model."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

import zmp_sqp as zs
from benchmarks.problems.arm import random_problem
from benchmarks.problems.paper import paper_1, paper_scene
from benchmarks.problems.scene import NamedProblem
from zmp_sqp.planning import LumpedMass, simplified_coordinates

# [rad] attitude c of the head in eq. (7), and at the start (22), of Song & Sharf 2020
UPRIGHT, LEANING = -np.pi / 2, -2.0 * np.pi / 3
TEST_2 = replace(paper_scene(), roll=np.deg2rad(-15.0), pitch=np.deg2rad(15.0))


@cache
def planned_paper_1(point_masses: bool) -> tuple[NamedProblem, zs.Plan]:
    named = paper_1(point_masses=point_masses)
    return named, zs.plan(named.problem)


@cache
def planned_random(seed: int) -> tuple[NamedProblem, zs.Plan]:
    named = random_problem(seed)
    return named, zs.plan(named.problem)


def pose(
    slew: float, boom: float, *, attitude: float = LEANING, head: float = -np.pi / 2
) -> np.ndarray:
    """Arm pose of the form of eq. (7), shape (5,) [rad]."""
    return np.array([slew, boom, -np.pi - 2.0 * boom, attitude + np.pi + boom, head])


def lumped(attitude: float) -> LumpedMass:
    machine = paper_scene().load()
    return LumpedMass.of(
        machine, simplified_coordinates(machine, pose(0.0, -0.5, attitude=attitude))
    )
