"""The ground under the machine: the direction of gravity, and how a tracked base moves on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from zmp_sqp.arrays import Array, finite_number
from zmp_sqp.errors import MachineError, ProblemError
from zmp_sqp.mechanics.ground_motion import GroundMotion, GroundRates
from zmp_sqp.mechanics.support import SupportPolygon

__all__ = ["CLEARANCE", "GRAVITY", "Ground", "Slope", "Terrain", "terrain_of"]

GRAVITY = 9.81  # [m/s^2], the constant of Song & Sharf 2020
# [m], our choice: ground that departs less than this from the tracks' plane carries them all the
# same
CLEARANCE = 0.1


@runtime_checkable
class Ground(Protocol):
    """Anything that can say how the machine stands on it."""

    def gravity(self, yaw: float = 0.0) -> Array:
        """Gravity in the root frame of a machine at x = y = 0 with heading `yaw` [rad], shape (3,) [m/s^2]."""
        ...


@runtime_checkable
class Terrain(Ground, Protocol):
    """Ground that a base can drive on.

    The base is a unicycle: its pose is (x, y, yaw) in ground coordinates, its rates (w_s, w_yaw)
        are the speed along
    the heading and the rate of the yaw, its accelerations (a_s, a_yaw) the rates of these. With S =
    T^2 they may be in normalised time (rates times T, accelerations times T^2); with S = 1 they are
    in seconds.
    """

    @property
    def extent(self) -> Array:
        """Where the base may be: lowest and highest (x, y), shape (2, 2) [m]; infinite if anywhere."""
        ...

    def check_on(self, places: Array) -> None:
        """Raise ProblemError where the first of `places` (K, 2) lies off the map."""
        ...

    @property
    def uniform(self) -> bool:
        """Whether it is the same everywhere, so that a base's motion does not depend on its place."""
        ...

    def derivative_bounds(self, low: Array, high: Array) -> Array:
        """Steepest slope and norms of the second to fifth derivative of the height in boxes (K, 2), shape (5, K)."""
        ...

    def base_pose(self, pose: Array) -> tuple[Array, Array]:
        """Root of a base at `pose` (K, 3) in the ground frame: positions (K, 3) [m] and rotations (K, 3, 3)."""
        ...

    def ground_rates(self, pose: Array, rates: Array) -> GroundRates:
        """Rates of x and y at `pose` (K, 3) and `rates` (K, 2)."""
        ...

    def base_motion(
        self, pose: Array, rates: Array, accelerations: Array, S: float = 1.0
    ) -> GroundMotion:
        """Motion of the root at `pose` (K, 3), `rates` (K, 2) and `accelerations` (K, 2)."""
        ...

    def check_followable(
        self, support: SupportPolygon, poses: Array, *, clearance: float = CLEARANCE
    ) -> None:
        """Raise ProblemError where the ground departs from the tracks' plane by more than `clearance` [m]."""
        ...


@dataclass(frozen=True, slots=True)
class Slope:
    """A plane, level unless it is tilted (REP-103: x forward, y left, z up).

    The ground frame lies in the plane: its z axis is the normal, and a base at yaw = 0 has its
        axes.

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

    @property
    def extent(self) -> Array:
        """The plane is endless: lowest and highest (x, y) are infinite, shape (2, 2) [m]."""
        return np.array([[-np.inf, -np.inf], [np.inf, np.inf]])

    def check_on(self, places: Array) -> None:
        """Do nothing: the plane is endless."""

    @property
    def uniform(self) -> bool:
        """A plane is the same everywhere."""
        return True

    def derivative_bounds(self, low: Array, high: Array) -> Array:
        """Zero: in the ground frame, which lies in the plane, it has no height; shape (5, K)."""
        return np.zeros((5, len(low)))

    def gravity(self, yaw: float = 0.0) -> Array:
        r"""Gravity in the root frame of a machine that stands on the plane.

        .. math:: (R_y(pitch) R_x(roll) R_z(yaw))^T (0, 0, -g)

        The heading turns within the plane, so at yaw = 0 the machine leans by just this roll and
        pitch (the angles of Song & Sharf 2020, Section II, in REP-103 axes).

        Args:
            yaw: Heading in the plane [rad].

        Returns:
            Shape (3,) [m/s^2].
        """
        return np.asarray(self.gravity_at_yaws(np.array([yaw]))[0])

    def base_pose(self, pose: Array) -> tuple[Array, Array]:
        r"""Where the root is and how it is turned: :math:`(x, y, 0), \; R_z(yaw)`.

        Args:
            pose: (x, y, yaw) in the ground frame, shape (K, 3) [m, rad].

        Returns:
            Positions (K, 3) [m] and rotations from the root frame (K, 3, 3), both in the ground
            frame.
        """
        cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        rotations = np.zeros((len(pose), 3, 3))
        rotations[:, 0, 0], rotations[:, 0, 1] = cos, -sin
        rotations[:, 1, 0], rotations[:, 1, 1] = sin, cos
        rotations[:, 2, 2] = 1.0
        return pose * [1.0, 1.0, 0.0], rotations

    def ground_rates(self, pose: Array, rates: Array) -> GroundRates:
        r"""Rates of the coordinates in the plane, :math:`w_s (\cos yaw, \sin yaw)`.

        Args:
            pose: (x, y, yaw), shape (K, 3) [m, rad].
            rates: Speed along the heading and yaw rate, shape (K, 2) [m/s, rad/s].
        """
        yaw, speed = pose[:, 2], rates[:, 0]
        heading = np.column_stack([np.cos(yaw), np.sin(yaw)])
        jacobian = np.zeros((len(pose), 2, 5))
        jacobian[:, 0, 2], jacobian[:, 1, 2] = -speed * heading[:, 1], speed * heading[:, 0]
        jacobian[:, :, 3] = heading
        return GroundRates(speed[:, None] * heading, jacobian)

    def base_motion(
        self, pose: Array, rates: Array, accelerations: Array, S: float = 1.0
    ) -> GroundMotion:
        r"""Motion of the root of a unicycle in the plane, with its derivatives.

        .. math:: (w_s, 0, 0, 0, 0, w_{yaw}), \quad (a_s, 0, 0, 0, 0, a_{yaw}) - S (g(yaw), 0)

        Args:
            pose: (x, y, yaw), shape (K, 3) [m, rad].
            rates: Speed along the heading and yaw rate, shape (K, 2) [m/s, rad/s].
            accelerations: Their rates, shape (K, 2) [m/s^2, rad/s^2].
            S: Square of the time scale; 1 in seconds.
        """
        count = len(pose)
        gravity = self.gravity_at_yaws(pose[:, 2])
        velocity, acceleration = np.zeros((2, count, 6))
        velocity[:, 0], velocity[:, 5] = rates[:, 0], rates[:, 1]
        acceleration[:, :3] = -S * gravity
        acceleration[:, 0] += accelerations[:, 0]
        acceleration[:, 5] = accelerations[:, 1]
        velocity_jacobian, acceleration_jacobian = np.zeros((2, count, 6, 8))
        velocity_jacobian[:, 0, 3] = velocity_jacobian[:, 5, 4] = 1.0
        acceleration_jacobian[:, 0, 5] = acceleration_jacobian[:, 5, 6] = 1.0
        acceleration_jacobian[:, 0, 2], acceleration_jacobian[:, 1, 2] = (
            -S * gravity[:, 1],
            S * gravity[:, 0],
        )
        acceleration_jacobian[:, :3, 7] = -gravity
        return GroundMotion(velocity, acceleration, velocity_jacobian, acceleration_jacobian)

    def check_followable(
        self, support: SupportPolygon, poses: Array, *, clearance: float = CLEARANCE
    ) -> None:
        """Do nothing: tracks follow a plane everywhere."""

    def gravity_at_yaws(self, yaw: Array) -> Array:
        """As `gravity`, at headings (K,) in the plane, shape (K, 3) [m/s^2]."""
        lean = np.cos(self.pitch)
        x, y, z = np.sin(self.pitch), -lean * np.sin(self.roll), -lean * np.cos(self.roll)
        cos, sin = np.cos(yaw), np.sin(yaw)
        return np.asarray(
            GRAVITY * np.column_stack([cos * x + sin * y, cos * y - sin * x, np.full_like(yaw, z)])
        )


def terrain_of(ground: Ground) -> Terrain:
    """The ground, for a base to drive on.

    Raises:
        ProblemError: No base can.
    """
    if not isinstance(ground, Terrain):
        raise ProblemError(
            f"a base drives on a Slope or a Heightmap, not on {type(ground).__name__}"
        )
    return ground
