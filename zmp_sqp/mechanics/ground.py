"""The ground under the machine, as the direction of gravity in the machine's root frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from zmp_sqp.arrays import Array, finite_number
from zmp_sqp.errors import MachineError

__all__ = ["GRAVITY", "Ground", "Slope"]

GRAVITY = 9.81  # [m/s^2], the constant of Song & Sharf 2020


@runtime_checkable
class Ground(Protocol):
    """Anything that can say how the machine stands on it."""

    def gravity(self, yaw: float = 0.0) -> Array:
        """Gravity in the root frame of a machine at heading `yaw` [rad], shape (3,) [m/s^2]."""
        ...


@dataclass(frozen=True, slots=True)
class Slope:
    """A plane, level unless it is tilted (REP-103: x forward, y left, z up).

    Attributes:
        roll: Tilt about the machine's x axis [rad]; negative leans it to its left.
        pitch: Tilt about its y axis [rad]; positive points its nose down.

    Raises:
        MachineError: Not finite, or a quarter turn or more.
    """

    roll: float = 0.0
    pitch: float = 0.0

    def __post_init__(self) -> None:
        for name in ("roll", "pitch"):
            angle = finite_number(getattr(self, name), name=f"slope {name}", error=MachineError)
            if abs(angle) >= np.pi / 2:
                raise MachineError(f"slope {name} must lie within +-pi/2 rad, not {angle}")
            object.__setattr__(self, name, angle)

    def gravity(self, yaw: float = 0.0) -> Array:
        r"""Gravity in the root frame of a machine that stands on the plane.

        .. math:: (R_y(pitch) R_x(roll) R_z(yaw))^T (0, 0, -g)

        The heading turns within the plane, so at yaw = 0 the machine leans by just this roll and pitch
        (the angles of Song & Sharf 2020, Section II, in REP-103 axes).

        Args:
            yaw: Heading in the plane [rad].

        Returns:
            Shape (3,) [m/s^2].
        """
        lean = np.cos(self.pitch)
        x, y, z = np.sin(self.pitch), -lean * np.sin(self.roll), -lean * np.cos(self.roll)
        cos, sin = np.cos(yaw), np.sin(yaw)
        return GRAVITY * np.array([cos * x + sin * y, cos * y - sin * x, z])
