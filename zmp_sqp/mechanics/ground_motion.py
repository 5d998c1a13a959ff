"""How the root of a machine moves when its base drives: twist, acceleration and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass

from zmp_sqp.arrays import Array

__all__ = ["GroundMotion", "GroundRates"]


@dataclass(frozen=True, slots=True, eq=False)
class GroundMotion:
    """Motion of the root at K states of the base, as `ground_reaction` takes it.

    Attributes:
        velocity: Twist of the root, root frame, linear part first, shape (K, 6) [m/s, rad/s].
        acceleration: Spatial acceleration of the root (the rates of the twist's components, no
            speed times yaw rate term) minus S times gravity, root frame, shape (K, 6) [m/s^2,
            rad/s^2].
        velocity_jacobian: Of the twist by (x, y, yaw, w_s, w_yaw, a_s, a_yaw, S), shape (K, 6, 8).
        acceleration_jacobian: Of the acceleration by the same, shape (K, 6, 8).
    """

    velocity: Array
    acceleration: Array
    velocity_jacobian: Array
    acceleration_jacobian: Array

    def at_support_height(self, height: float) -> GroundMotion:
        r"""The motion of a root from which the ground is the plane z = height, in place of z = 0.

        .. math:: v_{root} = v + \omega \times (0, 0, -height), \quad \omega_{root} = \omega

        and likewise for spatial accelerations, since the offset is constant in the root frame.

        Args:
            height: Of the support polygon in the root frame [m].
        """
        parts = (
            self.velocity,
            self.acceleration,
            self.velocity_jacobian,
            self.acceleration_jacobian,
        )
        if height == 0.0:
            return self
        moved = tuple(part.copy() for part in parts)
        for part in moved:
            part[:, 0] -= height * part[:, 4]
            part[:, 1] += height * part[:, 3]
        return GroundMotion(*moved)


@dataclass(frozen=True, slots=True, eq=False)
class GroundRates:
    """Rates of the ground coordinates of a base that drives along its heading, at K states.

    Attributes:
        rates: (dx, dy), shape (K, 2) [m/s].
        jacobian: Of these by (x, y, yaw, w_s, w_yaw), shape (K, 2, 5).
    """

    rates: Array
    jacobian: Array
