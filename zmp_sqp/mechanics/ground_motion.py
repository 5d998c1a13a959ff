"""Motion of the machine's root when its base drives: twist, acceleration and their Jacobians."""

from __future__ import annotations

from dataclasses import dataclass

from zmp_sqp.arrays import Array

__all__ = ["GroundMotion", "GroundRates"]


@dataclass(frozen=True, slots=True, eq=False)
class GroundMotion:
    """Motion of the root at K states of the base, in the form that `ground_reaction` takes.

    The Jacobians are with respect to the state (x, y, yaw, w_s, w_yaw, a_s, a_yaw, S) of the base;
    see `Terrain` for its entries.

    Attributes:
        velocity: Twist of the root, root frame, linear part first, shape (K, 6) [m/s, rad/s].
        acceleration: Spatial acceleration of the root minus S times gravity, root frame, shape
            (K, 6) [m/s^2, rad/s^2]. A spatial acceleration holds the time derivatives of the
            twist's components; the centripetal term (speed times yaw rate) is not part of it.
        velocity_jacobian: Derivatives of the twist by the state, shape (K, 6, 8).
        acceleration_jacobian: Derivatives of the acceleration by the state, shape (K, 6, 8).
    """

    velocity: Array
    acceleration: Array
    velocity_jacobian: Array
    acceleration_jacobian: Array

    def at_support_height(self, height: float) -> GroundMotion:
        r"""Motion of a root whose ground plane is z = height, given the motion for z = 0.

        .. math:: v_{root} = v + \omega \times (0, 0, -height), \quad \omega_{root} = \omega

        Spatial accelerations transform by the same formula, since the offset is constant in the
        root frame.

        Args:
            height: z of the support polygon in the root frame [m].
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
    """Rates of x and y of a base that drives along its heading, at K states.

    Attributes:
        rates: (dx/dt, dy/dt) in the ground frame, shape (K, 2) [m/s].
        jacobian: Derivatives of the rates by (x, y, yaw, w_s, w_yaw), shape (K, 2, 5).
    """

    rates: Array
    jacobian: Array
