"""Kinematics of a unicycle that stays tangent to a surface, with analytic derivatives."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.ground import GRAVITY
from zmp_sqp.mechanics.ground_motion import GroundMotion, GroundRates
from zmp_sqp.mechanics.terrain.surface_frame import SurfaceFrame

__all__ = ["drive_on_surface", "ground_rates_on_surface"]

X, Y, YAW, W_S, W_YAW, A_S, A_YAW, SCALE = range(8)  # columns of the Jacobians; SCALE is S = T^2


def ground_rates_on_surface(frame: SurfaceFrame, yaw: Array, rates: Array) -> GroundRates:
    r"""Rates of the map coordinates (x, y) of a base whose speed is measured along the surface.

    .. math:: (x', y') = w_s B(x, y) (\cos yaw, \sin yaw), \quad B = E_{1..2, 1..2}

    with the rotation E of `SurfaceFrame`.

    Args:
        frame: Frame of the surface at K positions of the base.
        yaw: Yaw of the base, shape (K,) [rad].
        rates: Speed w_s along the heading and yaw rate w_yaw, shape (K, 2) [m/s, rad/s].
    """
    heading, turned = _headings(frame, yaw)
    speed = rates[:, 0]
    jacobian = np.zeros((2, 5, len(yaw)))
    jacobian[:, X], jacobian[:, Y], jacobian[:, YAW] = (
        speed * heading[1],
        speed * heading[2],
        speed * turned,
    )
    jacobian[:, W_S] = heading[0]
    return GroundRates(_state_first(speed * heading[0]), _state_first(jacobian))


def drive_on_surface(
    frame: SurfaceFrame, yaw: Array, rates: Array, accelerations: Array, S: float
) -> GroundMotion:
    r"""Motion of the root, whose rotation is R = E R_z(yaw), with its derivatives.

    Let :math:`k = R_z^T \mathrm{vee}(E^T dE)` be the rotation of the root per metre of path, e the
    heading as seen on the map, and :math:`D = k_x e_x + k_y e_y` the derivative of k along the
    path. In the root frame, and with gravity g subtracted from the acceleration,

    .. math::
        v = (w_s, 0, 0), \quad \omega = w_s k + w_{yaw} \hat z, \quad
        \dot v = (a_s, 0, 0) - S R^T g, \quad
        \dot \omega = a_s k + w_s^2 D + w_s w_{yaw} k_{yaw} + a_{yaw} \hat z

    (in D, e_x and e_y are the components of e, and k_x, k_y, k_yaw partial derivatives of k).

    Args:
        frame: Frame of the surface at K positions of the base.
        yaw: Yaw of the base, shape (K,) [rad].
        rates: Speed w_s along the heading and yaw rate w_yaw, shape (K, 2) [m/s, rad/s].
        accelerations: Rates (a_s, a_yaw) of these, shape (K, 2) [m/s^2, rad/s^2].
        S: Square T^2 of the time scale; 1 in seconds.
    """
    velocity, acceleration = np.zeros((2, 6, len(yaw)))
    by_velocity, by_acceleration = np.zeros((2, 6, 8, len(yaw)))
    velocity[0], acceleration[0] = rates[:, 0], accelerations[:, 0]
    by_velocity[0, W_S] = by_velocity[5, W_YAW] = by_acceleration[0, A_S] = by_acceleration[
        5, A_YAW
    ] = 1.0
    _turn(
        frame,
        yaw,
        rates,
        accelerations,
        velocity[3:],
        acceleration[3:],
        by_velocity[3:],
        by_acceleration[3:],
    )
    up, up_yaw = _vertical(frame, yaw)
    pull = S * GRAVITY
    acceleration[:3] += pull * up[0]
    by_acceleration[:3, X], by_acceleration[:3, Y] = pull * up[1], pull * up[2]
    by_acceleration[:3, YAW], by_acceleration[:3, SCALE] = pull * up_yaw, GRAVITY * up[0]
    return GroundMotion(
        *(_state_first(part) for part in (velocity, acceleration, by_velocity, by_acceleration))
    )


def _turn(
    frame: SurfaceFrame,
    yaw: Array,
    rates: Array,
    accelerations: Array,
    velocity: Array,
    acceleration: Array,
    by_velocity: Array,
    by_acceleration: Array,
) -> None:
    """Write the angular rows of `drive_on_surface` into the last four arguments.

    Args:
        frame, yaw, rates, accelerations: Arguments of `drive_on_surface`.
        velocity, acceleration: Written: angular velocity and acceleration, shape (3, K) each.
        by_velocity, by_acceleration: Written: their Jacobians, shape (3, 8, K) each.
    """
    (w_s, w_yaw), (a_s, a_yaw) = rates.T, accelerations.T
    turn, turn_yaw, turn_yaw_yaw = _turns_per_metre(frame, yaw)
    heading, (e_yaw, f_yaw) = _headings(frame, yaw)
    (e, e_x, e_y), (f, f_x, f_y) = heading.transpose(1, 0, 2)
    change = turn[1] * e + turn[2] * f  # D
    change_x = turn[3] * e + turn[4] * f + turn[1] * e_x + turn[2] * f_x
    change_y = turn[4] * e + turn[5] * f + turn[1] * e_y + turn[2] * f_y
    change_yaw = turn_yaw[1] * e + turn_yaw[2] * f + turn[1] * e_yaw + turn[2] * f_yaw
    square, product = w_s * w_s, w_s * w_yaw
    velocity[:] = w_s * turn[0]
    velocity[2] += w_yaw
    by_velocity[:, X], by_velocity[:, Y], by_velocity[:, YAW] = (
        w_s * turn[1],
        w_s * turn[2],
        w_s * turn_yaw[0],
    )
    by_velocity[:, W_S] = turn[0]
    acceleration[:] = a_s * turn[0] + square * change + product * turn_yaw[0]
    acceleration[2] += a_yaw
    by_acceleration[:, X] = a_s * turn[1] + square * change_x + product * turn_yaw[1]
    by_acceleration[:, Y] = a_s * turn[2] + square * change_y + product * turn_yaw[2]
    by_acceleration[:, YAW] = a_s * turn_yaw[0] + square * change_yaw + product * turn_yaw_yaw
    by_acceleration[:, W_S] = 2.0 * w_s * change + w_yaw * turn_yaw[0]
    by_acceleration[:, W_YAW] = w_s * turn_yaw[0]
    by_acceleration[:, A_S] = turn[0]


def _turns_per_metre(frame: SurfaceFrame, yaw: Array) -> tuple[Array, Array, Array]:
    r"""Rotation k of the root per metre of path, with its derivatives by x, y and yaw.

    .. math::
        k = (e_2^T II e_1, \; -e_1^T II e_1, \; \tan(roll) \, II_{1 \cdot} e_1), \quad
        e_1 = (\cos yaw, \sin yaw), \quad e_2 = (-\sin yaw, \cos yaw)

    with the second fundamental form II of the surface. As functions of the double angle 2 yaw, the
    first two entries run along a circle (Mohr's circle) about (0, -mean curvature).

    Returns:
        k as a jet, shape (6, 3, K); its first derivative by yaw as a jet, shape (6, 3, K); and its
        second derivative by yaw, shape (3, K) [rad/m].
    """
    one, mixed, two, lean_one, lean_mixed = frame.curvature().transpose(1, 0, 2)  # (6, K) each
    cos, sin, cos2, sin2 = np.cos(yaw), np.sin(yaw), np.cos(2.0 * yaw), np.sin(2.0 * yaw)
    mean, half = 0.5 * (one + two), 0.5 * (one - two)
    along, across = mixed * cos2 - half * sin2, half * cos2 + mixed * sin2
    lean, lean_yaw = lean_one * cos + lean_mixed * sin, lean_mixed * cos - lean_one * sin
    turn = np.stack([along, -(mean + across), lean], axis=1)
    turn_yaw = np.stack([-2.0 * across, -2.0 * along, lean_yaw], axis=1)
    return turn, turn_yaw, np.stack([-4.0 * along[0], 4.0 * across[0], -lean[0]])


def _headings(frame: SurfaceFrame, yaw: Array) -> tuple[Array, Array]:
    """Heading as seen on the map, with first derivatives.

    Returns:
        Heading and its derivatives by x and by y, shape (3, 2, K); its derivative by yaw, shape
        (2, K).
    """
    cos, sin = np.cos(yaw), np.sin(yaw)
    first, skew, second = frame.flat[:3].transpose(1, 0, 2)  # (3, K) each
    heading = np.stack([first * cos + skew * sin, second * sin], axis=1)
    return heading, np.stack([skew[0] * cos - first[0] * sin, second[0] * cos])


def _vertical(frame: SurfaceFrame, yaw: Array) -> tuple[Array, Array]:
    """Vertical unit vector in the root frame, with first derivatives.

    Returns:
        Vertical and its derivatives by x and by y, shape (3, 3, K); its derivative by yaw, shape
        (3, K).
    """
    cos, sin = np.cos(yaw), np.sin(yaw)
    ahead, left, up = frame.vertical[:3].transpose(1, 0, 2)  # (3, K) each
    vertical = np.stack([cos * ahead + sin * left, cos * left - sin * ahead, up], axis=1)
    return vertical, np.stack([vertical[0, 1], -vertical[0, 0], np.zeros_like(yaw)])


def _state_first(rows: Array) -> Array:
    """Move the last axis, which counts the states, to the front."""
    return np.ascontiguousarray(np.moveaxis(rows, -1, 0))
