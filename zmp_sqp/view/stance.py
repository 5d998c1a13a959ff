"""Where and on what a machine stands at rest: the ground under it and the place of its root."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics import Ground, Heightmap, Machine, Slope
from zmp_sqp.report.sampling import root_on

__all__ = ["Stance"]


@dataclass(frozen=True, slots=True)
class Inclined:
    """Ground under a machine that has a heading.

    Attributes:
        slope: The plane.
        heading: Heading of the machine in it [rad].
    """

    slope: Slope
    heading: float

    def gravity(self, yaw: float = 0.0) -> Array:
        """Gravity in the root frame, shape (3,) [m/s^2], at a yaw [rad] beyond the heading."""
        return self.slope.gravity(self.heading + yaw)


@dataclass(frozen=True, slots=True, eq=False)
class Stance:
    """A machine that stands still on its ground.

    Attributes:
        ground: The ground.
        pose: (x, y, yaw) of a base that drives or stands on terrain, shape (3,) [m, m, rad]; None
            for one that stands at the origin of a plane.
    """

    ground: Ground
    pose: Array | None

    @classmethod
    def of(cls, content: Mapping[str, Any], ground: Ground, *, end: str = "start") -> Stance:
        """Stance of a scenario's machine at the start or the goal of its base.

        Args:
            content: Tables of the scenario.
            ground: Its ground.
            end: start or goal.
        """
        if "base" in content:
            return cls(ground, np.array(content["base"][end], dtype=float))
        return cls(ground, np.zeros(3) if isinstance(ground, Heightmap) else None)

    @property
    def gravity_only(self) -> Ground:
        """Ground that gives gravity in the root frame.

        Raises:
            ProblemError: The machine stands off the heightmap.
        """
        if self.pose is None:
            return self.ground
        x, y, yaw = self.pose.tolist()
        slope = self.ground.slope_at(x, y) if isinstance(self.ground, Heightmap) else self.ground
        return Inclined(slope, yaw) if isinstance(slope, Slope) else slope

    def root(self, machine: Machine) -> tuple[Array, Array]:
        """Position (3,) [m] and rotation (3, 3) of the root in the ground frame."""
        poses = None if self.pose is None else self.pose[None]
        positions, rotations = root_on(machine, self.ground, poses)
        return positions[0], rotations[0]
