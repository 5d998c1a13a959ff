"""How far a base may be from where its path is computed to be, and what that makes of the wrench."""

from __future__ import annotations

from math import comb, factorial

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.bounds.root_bounds import turning_on_surface
from zmp_sqp.motion.base_path import POINTS
from zmp_sqp.motion.root_motion import STRAY, root_motion_bounds, surface_bounds
from zmp_sqp.motion.unicycle_motion import UnicycleMotion

__all__ = ["misplaced_root_bounds", "path_error", "place_error"]

LEBESGUE = 10.0  # above the Lebesgue constant of the 20 Gauss points, 7.9
# Cheney 1966, section 4.6, third derivative
JACKSON = (np.pi / 2.0) ** 3 / (POINTS * (POINTS - 1.0) * (POINTS - 2.0))


def place_error(base: UnicycleMotion, bounds: Array, surface: Array) -> Array:
    r"""Largest distance from the unicycle's true place in each interval, shape (N,) [m].

    Collocation misses the rate of the place f(t) by at most (1 + Lebesgue constant) times the error
    of the best polynomial (Jackson); that, and what the nodes are off the ends of the intervals
    before them, grows by Gronwall:

    .. math:: e(t) \le e^{\int s K dt} \sum_i (|gap_i| + h_i \delta_i), \quad
              \delta = (1 + \Lambda) \Big(\frac{\pi}{2}\Big)^3 \Big(\frac{h}{2}\Big)^3
              \frac{\max |p^{(4)}|}{20 \cdot 19 \cdot 18}

    with the length h of the pieces that are one polynomial each.

    Args:
        base: The motion.
        bounds: Of the root in each interval, see `root_bounds`, shape (2, 4, N).
        surface: Of the ground there, shape (5, N).
    """
    h = np.diff(base.times)
    defect = (1.0 + LEBESGUE) * JACKSON * (0.5 * h / base.pieces) ** 3 * bounds[0, 3]
    growth = np.cumsum(h * bounds[0, 0] * _per_metre(surface)[0])
    return np.asarray(np.cumsum(_gaps(base) + h * defect) * np.exp(growth))


def path_error(base: UnicycleMotion) -> Array:
    r"""Largest distance from the unicycle's true place in each interval, shape (N,) [m]; in a plane all but rounding.

    There the rate of the place f = s (cos yaw, sin yaw) does not depend on it, and interpolation at
    n Gauss points is off by at most (Davis 1975, section 4.3; the product of the distances from
    them peaks at the ends)

    .. math:: \max |f^{(n)}| \, h^n \frac{n!}{(2 n)!}, \quad
        |f^{(n)}| \le \sum_{i=0}^2 \binom{n}{i} |s^{(i)}| |u^{(n-i)}|, \quad
        |u^{(k+1)}| \le \sum_{i=0}^2 \binom{k}{i} |w_{yaw}^{(i)}| |u^{(k-i)}|

    for the unit vector u; over terrain see `place_error`.
    """
    k, h = np.arange(len(base.jerks)), np.diff(base.times)
    if not base.ground.uniform:
        bounds = root_motion_bounds(base, k, 0.0 * h, h, height=0.0)
        return place_error(base, bounds, surface_bounds(base, k, 0.0 * h, h))
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
    r"""Bounds on the motion of the root at a place that is not quite known, gravity's change included, (2, 4, N).

    With the turn K1 per metre and its change K2, K3 per square and cubic metre in any direction,

    .. math:: |\delta g| \le K_1 e g, \quad |\delta \omega| \le s K_2 e, \quad
              |\delta \dot\omega| \le (|a| K_2 + s^2 K_3 + 2 s |w_{yaw}| K_2) e

    K2 and K3 follow from the turns along one path by the product rule, with factors to spare: other
        than along a
    path, n' x n' does not vanish, and root axes turn too. Infinite where the place is known to less
    than `STRAY`.

    Args:
        base: The motion.
        bounds: Of the root at the computed place in each interval, see `root_bounds`, shape (2, 4,
            N).
        gravity: Norm of gravity [m/s^2].
        height: Of the ground in the root frame [m].
    """
    intervals = np.arange(len(base.jerks)), np.zeros(len(base.jerks)), np.diff(base.times)
    (speed, push, _), (yaw_rate, _, _) = base.peaks(*intervals)
    surface = surface_bounds(base, *intervals)
    error = place_error(base, bounds, surface)
    error = np.where(error <= STRAY, error, np.inf)
    one, two, three = _per_metre(surface)[:3]
    second = two + 2.0 * one**2
    third = three + 10.0 * one * two + 20.0 * one**3
    spin = speed * second * error
    twist = (push * second + speed**2 * third + 2.0 * speed * yaw_rate * second) * error
    moved = bounds.copy()
    moved[1, 0] += spin
    moved[1, 1] += twist
    moved[0, 1] += one * error * gravity + abs(height) * (
        twist + (2.0 * bounds[1, 0] + spin) * spin
    )
    return moved


def _gaps(base: UnicycleMotion) -> Array:
    """How far each node is from where the interval before it ends, shape (N,) [m]."""
    k, h = np.arange(len(base.jerks)), np.diff(base.times)
    return np.asarray(np.linalg.norm(base.poses[1:, :2] - base.state_in(k, h)[0][:, :2], axis=1))


def _per_metre(surface: Array) -> list[Array]:
    """Turn of the root per metre along its heading and its derivatives by the way, shape (N,) each."""
    zero = np.zeros(surface.shape[1])
    return turning_on_surface([zero + 1.0, zero, zero, zero], [zero] * 4, surface)
