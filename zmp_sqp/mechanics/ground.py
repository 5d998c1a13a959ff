"""Ground under the machine: the direction of gravity, and how a tracked base moves on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeGuard, runtime_checkable

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array, shortened
from zmp_sqp.errors import MachineError, ProblemError, ZmpSqpError
from zmp_sqp.mechanics.ground_motion import GroundMotion, GroundRates
from zmp_sqp.mechanics.support import SupportPolygon

__all__ = [
    "CLEARANCE",
    "GRAVITY",
    "Ground",
    "Slope",
    "Terrain",
    "check_ground",
    "is_uneven",
    "terrain_of",
]

GRAVITY = 9.81  # [m/s^2] magnitude of gravity, as in Song & Sharf 2020
# [m] largest distance between the ground and the plane of the tracks at which the tracks still
# count as carried over their whole length; our choice
CLEARANCE = 0.1


@runtime_checkable
class Ground(Protocol):
    """Ground on which a machine can stand: it gives gravity in the machine's root frame."""

    def gravity(self, yaw: float = 0.0) -> Array:
        """Gravity in the root frame of a machine at x = y = 0, shape (3,) [m/s^2].

        Args:
            yaw: Heading of the machine [rad].
        """
        ...


@runtime_checkable
class Terrain(Ground, Protocol):
    """Ground on which a base can drive.

    The base moves as a unicycle:

    - its pose is (x, y, yaw) in the ground frame [m, m, rad];
    - its rates (w_s, w_yaw) are the speed along its heading and the yaw rate;
    - its accelerations (a_s, a_yaw) are the time derivatives of these rates.

    With a time scale S = T^2, rates and accelerations are in normalised time: rates in seconds
    times T, accelerations times T^2. With S = 1 they are in seconds.
    """

    @property
    def extent(self) -> Array:
        """Lowest and highest (x, y) that the ground covers, shape (2, 2) [m]; may be infinite."""
        ...

    def check_on(self, positions: Array) -> None:
        """Raise ProblemError if any of `positions`, shape (K, 2) [m], lies off the ground."""
        ...

    @property
    def uniform(self) -> bool:
        """Whether the motion of a base is independent of its position, as on a plane."""
        ...

    def derivative_bounds(self, low: Array, high: Array) -> Array:
        """Bounds on the first five derivatives of the height h(x, y) over K boxes.

        Args:
            low: Lowest (x, y) of each box, shape (K, 2) [m].
            high: Highest (x, y) of each box, shape (K, 2) [m].

        Returns:
            Norms of the k-th derivatives, k = 1..5, shape (5, K) [m^(1 - k)]; the first is the
            steepest gradient.
        """
        ...

    def base_pose(self, pose: Array) -> tuple[Array, Array]:
        """Position (K, 3) [m] and rotation (K, 3, 3) of the root in the ground frame.

        Args:
            pose: (x, y, yaw) of the base, shape (K, 3) [m, m, rad].
        """
        ...

    def ground_rates(self, pose: Array, rates: Array) -> GroundRates:
        """Rates of x and y of a base that drives, with derivatives.

        Args:
            pose: (x, y, yaw) of the base, shape (K, 3) [m, m, rad].
            rates: (w_s, w_yaw), shape (K, 2) [m/s, rad/s].
        """
        ...

    def base_motion(
        self, pose: Array, rates: Array, accelerations: Array, S: float = 1.0
    ) -> GroundMotion:
        """Twist and acceleration of the root of a base that drives, with derivatives.

        Args:
            pose: (x, y, yaw) of the base, shape (K, 3) [m, m, rad].
            rates: (w_s, w_yaw), shape (K, 2) [m/s, rad/s].
            accelerations: (a_s, a_yaw), shape (K, 2) [m/s^2, rad/s^2].
            S: Square T^2 of the time scale; 1 in seconds.
        """
        ...

    def check_followable(
        self, support: SupportPolygon, poses: Array, *, clearance: float = CLEARANCE
    ) -> None:
        """Raise ProblemError where the ground is too uneven for the tracks.

        Args:
            support: Support polygon of the tracks, root frame.
            poses: (x, y, yaw) of the base along its path, shape (P, 3) [m, m, rad].
            clearance: Largest distance allowed between the ground and the plane of the tracks [m].
        """
        ...


@dataclass(frozen=True, slots=True)
class Slope:
    """Inclined plane, level by default (axes of REP-103: x forward, y left, z up).

    The x and y axes of the ground frame lie in the plane and its z axis is the plane's normal. The
    root frame of a base at yaw = 0 is parallel to the ground frame. Roll and pitch are about the
    axes of the machine's root link: if its y axis is what the operator calls forward, a machine
    that looks uphill rolls.

    Attributes:
        roll: Tilt about the x axis of a machine at yaw = 0 [rad]; negative leans the machine to its
            left.
        pitch: Tilt about the y axis of a machine at yaw = 0 [rad]; positive points its nose down.
            Where both are given: pitch first, then roll about the pitched x axis, R_y R_x, as in
            the rpy of a URDF.

    Raises:
        MachineError: An angle that is not finite, or not within +-pi/2.
    """

    roll: float = 0.0
    pitch: float = 0.0

    def __post_init__(self) -> None:
        for name in ("roll", "pitch"):
            angle = finite_number(getattr(self, name), name=f"slope {name}", error=MachineError)
            if abs(angle) >= np.pi / 2:
                meant = np.radians(angle)
                may_be = f"; in degrees, {angle:g} is {meant:.4g} rad"
                hint = may_be if abs(meant) < np.pi / 2 else ""
                raise MachineError(f"slope {name} must lie within +-pi/2 rad, not {angle}{hint}")
            object.__setattr__(self, name, angle)

    @property
    def extent(self) -> Array:
        """Lowest and highest (x, y), infinite because the plane is; shape (2, 2) [m]."""
        return np.array([[-np.inf, -np.inf], [np.inf, np.inf]])

    def check_on(self, positions: Array) -> None:
        """Do nothing: the plane is infinite, so that every position is on it."""

    @property
    def uniform(self) -> bool:
        """True: on a plane, the motion of a base is independent of its position."""
        return True

    def derivative_bounds(self, low: Array, high: Array) -> Array:
        """Zeros of shape (5, K): in the ground frame, the plane is z = 0."""
        return np.zeros((5, len(low)))

    def gravity(self, yaw: float = 0.0) -> Array:
        r"""Gravity in the root frame of a machine that stands on the plane.

        .. math:: (R_y(pitch) R_x(roll) R_z(yaw))^T (0, 0, -g)

        The heading turns the machine within the plane; at yaw = 0 the machine itself has this roll
        and pitch (the angles of Song & Sharf 2020, Section II, in REP-103 axes).

        Args:
            yaw: Heading in the plane [rad].

        Returns:
            Shape (3,) [m/s^2].
        """
        return np.asarray(self.gravity_at_yaws(np.array([yaw]))[0])

    def base_pose(self, pose: Array) -> tuple[Array, Array]:
        r"""Position :math:`(x, y, 0)` and rotation :math:`R_z(yaw)` of the root, ground frame.

        Args:
            pose: (x, y, yaw) in the ground frame, shape (K, 3) [m, m, rad].

        Returns:
            Positions (K, 3) [m] and rotations from the root frame to the ground frame (K, 3, 3).
        """
        cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        rotations = np.zeros((len(pose), 3, 3))
        rotations[:, 0, 0], rotations[:, 0, 1] = cos, -sin
        rotations[:, 1, 0], rotations[:, 1, 1] = sin, cos
        rotations[:, 2, 2] = 1.0
        return pose * [1.0, 1.0, 0.0], rotations

    def ground_rates(self, pose: Array, rates: Array) -> GroundRates:
        r"""Rates of x and y in the plane, :math:`w_s (\cos yaw, \sin yaw)`.

        Args:
            pose: (x, y, yaw), shape (K, 3) [m, m, rad].
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

        The twist and the spatial acceleration minus gravity are, in the root frame,

        .. math:: (w_s, 0, 0, 0, 0, w_{yaw}), \quad (a_s, 0, 0, 0, 0, a_{yaw}) - S (g(yaw), 0)

        Args:
            pose: (x, y, yaw), shape (K, 3) [m, m, rad].
            rates: Speed w_s along the heading and yaw rate w_yaw, shape (K, 2) [m/s, rad/s].
            accelerations: Rates (a_s, a_yaw) of these, shape (K, 2) [m/s^2, rad/s^2].
            S: Square T^2 of the time scale; 1 in seconds.
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
        """Gravity in the root frame at headings `yaw` (K,) [rad], shape (K, 3) [m/s^2]."""
        lean = np.cos(self.pitch)
        x, y, z = np.sin(self.pitch), -lean * np.sin(self.roll), -lean * np.cos(self.roll)
        cos, sin = np.cos(yaw), np.sin(yaw)
        return np.asarray(
            GRAVITY * np.column_stack([cos * x + sin * y, cos * y - sin * x, np.full_like(yaw, z)])
        )


def check_ground(ground: object, error: type[ZmpSqpError] = ProblemError) -> None:
    """Refuse what is no ground, and a ground whose gravity is no vector.

    A terrain is not asked for its gravity: its map need not hold the origin.

    Args:
        ground: What the user gave.
        error: Exception class to raise.

    Raises:
        error: It has no method `gravity(yaw)`, or that does not return three finite numbers in a
            NumPy array.
    """
    if type(ground) is Slope:
        return
    if isinstance(ground, type) or not isinstance(ground, Ground):
        raise error(
            "ground must be a Slope, a Heightmap, or an object with their method gravity(yaw), "
            f"not {shortened(ground)}"
        )
    if isinstance(ground, Terrain) and not isinstance(ground, Slope):
        return
    try:
        gravity: object = ground.gravity()
    except Exception as cause:
        raise error(
            f"ground.gravity() failed: {cause!r}; define it as gravity(self, yaw=0.0)"
        ) from cause
    if not isinstance(gravity, np.ndarray):
        raise error(
            "ground.gravity() must return a NumPy array of shape (3,), in m/s^2, not "
            f"{shortened(gravity)}"
        )
    frozen_array(gravity, name="ground.gravity()", shape=(3,), error=error)


def is_uneven(ground: Ground) -> TypeGuard[Terrain]:
    """Whether a ground is a terrain on which the motion of a base depends on its position."""
    # a Slope first: to compare an object with a protocol takes microseconds
    return not isinstance(ground, Slope) and isinstance(ground, Terrain) and not ground.uniform


def terrain_of(ground: Ground) -> Terrain:
    """Return the ground as a `Terrain`, on which a base can drive.

    Raises:
        ProblemError: The ground only carries a machine that stands still, or is a Slope whose
            `gravity` was overridden: the motion of a base would count on roll and pitch alone.
    """
    if isinstance(ground, Slope) and type(ground).gravity is not Slope.gravity:
        raise ProblemError(
            f"a base drives on a Slope as its roll and pitch say, not on {type(ground).__name__}, "
            "which overrides gravity()"
        )
    if not isinstance(ground, Terrain):
        raise ProblemError(
            f"a base drives on a Slope or a Heightmap, not on {type(ground).__name__}"
        )
    return ground
