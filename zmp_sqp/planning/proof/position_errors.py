"""Error of the computed positions of a base, and its effect on the motion of the root."""

from __future__ import annotations

from math import comb, factorial

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.bounds.root_bounds import turning_on_surface
from zmp_sqp.motion.base_path import POINTS
from zmp_sqp.motion.root_motion import STRAY, root_motion_bounds, surface_bounds
from zmp_sqp.motion.unicycle_motion import UnicycleMotion

__all__ = ["misplaced_root_bounds", "path_error", "position_error"]

LEBESGUE = 10.0  # upper bound on the Lebesgue constant of the 20 Gauss points, which is 7.9
# constant of Jackson's theorem for the third derivative (Cheney 1966, section 4.6)
JACKSON = (np.pi / 2.0) ** 3 / (POINTS * (POINTS - 1.0) * (POINTS - 2.0))


def position_error(base: UnicycleMotion, bounds: Array, surface: Array) -> Array:
    r"""Largest error of the computed position over uneven ground in each interval, (N,) [m].

    Collocation approximates the rate of the position with an error :math:`\delta` of at most (1 +
    Lebesgue constant) times the error of the best polynomial (Jackson). These errors, and the gaps
    between each node and the end of the interval before it, grow by the inequality of Gronwall:

    .. math:: e(t) \le e^{\int s K dt} \sum_i (|gap_i| + h_i \delta_i), \quad
              \delta = (1 + \Lambda) \Big(\frac{\pi}{2}\Big)^3 \Big(\frac{h}{2}\Big)^3
              \frac{\max |p^{(4)}|}{20 \cdot 19 \cdot 18}

    with the length h of the pieces, each of which is one polynomial.

    Args:
        base: Motion of the base.
        bounds: Bounds on the motion of the root in each interval, see `root_bounds`, shape
            (2, 4, N).
        surface: Bounds on the derivatives of the ground's height there, shape (5, N).
    """
    h = np.diff(base.times)
    defect = (1.0 + LEBESGUE) * JACKSON * (0.5 * h / base.pieces) ** 3 * bounds[0, 3]
    growth = np.cumsum(h * bounds[0, 0] * _per_metre(surface)[0])
    return np.asarray(np.cumsum(_gaps(base) + h * defect) * np.exp(growth))


def path_error(base: UnicycleMotion) -> Array:
    r"""Largest error of the computed position in each interval, shape (N,) [m].

    Over uneven ground see `position_error`. In a plane, the rate of the position
    f = s (cos yaw, sin yaw) does not depend on the position, and interpolation at n Gauss points
    has an error of at most (Davis 1975, section 4.3; the product of the distances from the points
    is largest at the ends)

    .. math:: \max |f^{(n)}| \, h^n \frac{n!}{(2 n)!}, \quad
        |f^{(n)}| \le \sum_{i=0}^2 \binom{n}{i} |s^{(i)}| |u^{(n-i)}|, \quad
        |u^{(k+1)}| \le \sum_{i=0}^2 \binom{k}{i} |w_{yaw}^{(i)}| |u^{(k-i)}|

    with the unit vector u = (cos yaw, sin yaw). This error is of the size of rounding errors.
    """
    k, h = np.arange(len(base.jerks)), np.diff(base.times)
    if not base.ground.uniform:
        bounds = root_motion_bounds(base, k, 0.0 * h, h, height=0.0)
        return position_error(base, bounds, surface_bounds(base, k, 0.0 * h, h))
    along, yaw = base.peaks(k, 0.0 * h, h)
    unit = [np.ones_like(h)]
    for order in range(POINTS):
        unit.append(
            np.sum(
                [comb(order, i) * yaw[i] * unit[order - i] for i in range(min(order, 2) + 1)],
                axis=0,
            )
        )
    steepest = np.sum([comb(POINTS, i) * along[i] * unit[POINTS - i] for i in range(3)], axis=0)
    defect = steepest * h**POINTS * (factorial(POINTS) / factorial(2 * POINTS))
    return np.asarray(np.cumsum(_gaps(base) + h * defect))


def misplaced_root_bounds(
    base: UnicycleMotion, bounds: Array, *, gravity: float, height: float
) -> Array:
    r"""Bounds on the motion of the root if its position has the error e, shape (2, 4, N).

    The change of gravity in the root frame is included as an acceleration. With the rotation K1 of
    the root per metre, and its derivatives K2 and K3 per square and cubic metre in any direction,

    .. math:: |\delta g| \le K_1 e g, \quad |\delta \omega| \le s K_2 e, \quad
              |\delta \dot\omega| \le (|a| K_2 + s^2 K_3 + 2 s |w_{yaw}| K_2) e

    K2 and K3 follow by the product rule from the rotations along one path. The factors of `second`
    and `third` leave room for two effects that do not occur along one path: n' x n' does not
    vanish, and the root axes rotate too. The bounds are infinite if the error exceeds `STRAY`.

    Args:
        base: Motion of the base.
        bounds: Bounds on the motion of the root at the computed position in each interval, see
            `root_bounds`, shape (2, 4, N).
        gravity: Norm of gravity [m/s^2].
        height: z of the support plane in the root frame [m].
    """
    intervals = np.arange(len(base.jerks)), np.zeros(len(base.jerks)), np.diff(base.times)
    (speed, acceleration, _), (yaw_rate, _, _) = base.peaks(*intervals)
    surface = surface_bounds(base, *intervals)
    error = position_error(base, bounds, surface)
    error = np.where(error <= STRAY, error, np.inf)
    one, two, three = _per_metre(surface)[:3]
    second = two + 2.0 * one**2
    third = three + 10.0 * one * two + 20.0 * one**3
    spin = speed * second * error
    turn = (acceleration * second + speed**2 * third + 2.0 * speed * yaw_rate * second) * error
    moved = bounds.copy()
    moved[1, 0] += spin
    moved[1, 1] += turn
    moved[0, 1] += one * error * gravity + abs(height) * (turn + (2.0 * bounds[1, 0] + spin) * spin)
    return moved


def _gaps(base: UnicycleMotion) -> Array:
    """Distance of each node from the end of the interval before it, shape (N,) [m]."""
    k, h = np.arange(len(base.jerks)), np.diff(base.times)
    return np.asarray(np.linalg.norm(base.poses[1:, :2] - base.state_in(k, h)[0][:, :2], axis=1))


def _per_metre(surface: Array) -> list[Array]:
    """Rotation of the root per metre of path and its derivatives by path length, (N,) each."""
    zero = np.zeros(surface.shape[1])
    return turning_on_surface([zero + 1.0, zero, zero, zero], [zero] * 4, surface)
