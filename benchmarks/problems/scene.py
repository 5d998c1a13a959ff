"""A planning problem as plain numbers, from which two models can be built independently.

The library builds its machine from a `Scene`, and `benchmarks.problems.checks` builds a model of
its own from the same numbers. A mistake in one of the two models then shows up as a disagreement.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import zmp_sqp as zs

__all__ = [
    "FOOTPRINT",
    "GRAVITY",
    "NamedProblem",
    "Scene",
    "Tree",
    "arm_range",
    "standing_poses",
]

URDF = Path(__file__).resolve().parents[2] / "urdf"
GRAVITY = 9.81  # [m/s^2]
FOOTPRINT = ((-2.5, -1.615), (2.5, -1.615), (2.5, 1.615), (-2.5, 1.615))  # 5 m x 3.23 m
TRIES = 2000  # random poses per ground


@dataclass(frozen=True)
class Tree:
    """Payload in the feller-buncher's head: a uniform stem of 8 m.

    It is held as in Table I of Song & Sharf 2020 (urdf/README.md).
    """

    mass: float  # [kg]
    com: tuple[float, float, float] = (0.0, 0.0, 8.0 / 2.0 - 0.677)  # [m] in the head's frame
    length: float = 8.0  # [m]
    radius: float = 0.25  # [m]
    frame: str = "head"

    @property
    def inertia(self) -> np.ndarray:
        """Inertia about the centre of mass: m l^2 / 12 across, m r^2 / 2 along [kg m^2]."""
        across, along = self.mass * self.length**2 / 12.0, self.mass * self.radius**2 / 2.0
        return np.diag([across, across, along])


@dataclass(frozen=True)
class Scene:
    """A machine, its payload and the slope it stands on, as plain numbers."""

    machine: str  # name of the URDF, without .urdf
    vertices: tuple[tuple[float, float], ...]  # of the support polygon, counter-clockwise [m]
    tree: Tree | None = None
    roll: float = 0.0  # [rad]
    pitch: float = 0.0  # [rad]
    point_masses: bool = False  # the bodies have no inertia about their centres of mass
    limits: Mapping[str, Any] = field(default_factory=dict)  # replace the URDF's joint limits

    @property
    def urdf(self) -> Path:
        """File of the machine."""
        return URDF / f"{self.machine}.urdf"

    @property
    def ground(self) -> zs.Slope:
        """The library's ground."""
        return zs.Slope(roll=self.roll, pitch=self.pitch)

    def load(self) -> zs.Machine:
        """The library's machine, with the payload."""
        machine = zs.load_machine(
            self.machine, support=zs.SupportPolygon(self.vertices), limits=self.limits
        )
        if self.tree is not None:
            tree = self.tree
            machine = machine.with_payload(
                zs.Payload(tree.mass, tree.com, tree.frame, tree.inertia)
            )
        return machine.with_point_masses() if self.point_masses else machine

    def problem(self, start: Any, goal: Any, **options: Any) -> zs.Problem:
        """The library's problem from start to goal; options are those of `zs.Problem`."""
        return zs.Problem(self.load(), start=start, goal=goal, ground=self.ground, **options)


@dataclass(frozen=True)
class NamedProblem:
    """A problem with its scene and, where one is known, its optimal duration [s]."""

    name: str
    scene: Scene
    problem: zs.Problem
    optimum: float | None


def arm_range(machine: zs.Machine) -> tuple[np.ndarray, np.ndarray]:
    """Range of joint positions to draw from: the joint limits, and one turn for the slew [rad]."""
    lower = np.array(machine.limits.position_lower)
    upper = np.array(machine.limits.position_upper)
    lower[0], upper[0] = -np.pi, np.pi
    return lower, upper


def standing_poses(
    rng: np.random.Generator,
    scene: Scene,
    bounds: tuple[Any, Any],
    margins: tuple[float, float],
) -> np.ndarray:
    """Random arm poses in which the machine at rest has a stability margin within a range.

    Args:
        rng: Draws 2000 poses, uniformly within the bounds.
        scene: Machine and slope.
        bounds: Least and largest joint positions, shape (n,) each [rad].
        margins: Least and largest stability margin [m].

    Returns:
        The poses that qualify, in the order drawn, shape (K, n); there may be none.
    """
    machine = scene.load()
    poses = rng.uniform(*bounds, (TRIES, machine.size))
    still = np.zeros_like(poses)
    found = zs.stability_margin(machine, poses, still, still, scene.ground)
    return poses[(found >= margins[0]) & (found <= margins[1])]
