"""Rigorous bounds on how the root of a base moves that drives on a surface, from bounds on its derivatives."""

from __future__ import annotations

from math import comb

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.bounds.norms import ORDERS, Bounds, leibniz, turning

__all__ = ["root_bounds", "turning_on_surface"]


def root_bounds(peaks: Array, surface: Array | None = None, height: float = 0.0) -> Array:
    r"""Bounds on the motion of a root whose foot o - h n moves with a speed times a unit vector fixed in the root.

    .. math:: o' = s e + h n', \quad |n^{(k)}|, |e^{(k)}| \text{ from } \omega \text{
        (`norms.turning`)}

    Args:
        peaks: Largest |speed|, |acceleration| and |jerk| along the heading, and |yaw rate|, |yaw
            acceleration| and |yaw jerk|, shape (2, 3, K); higher derivatives are zero.
        surface: Bounds on the ground's derivatives there, see `turning_on_surface`, shape (5, K);
            None is a plane.
        height: |h| of the root above its foot [m].

    Returns:
        Norms of derivatives 1 to 4 of the root's origin and 0 to 3 of its angular velocity, shape
        (2, 4, K).
    """
    along, yaw = ([*part, np.zeros_like(part[0])] for part in peaks)
    if surface is None or not surface.any():  # the normal stands still
        heading = turning(yaw)
        return np.stack([[leibniz(along, heading, k) for k in range(ORDERS - 1)], yaw])
    spin = turning_on_surface(along, yaw, surface)
    heading = turning(spin)
    drive = [leibniz(along, heading, k) + height * heading[k + 1] for k in range(ORDERS - 1)]
    return np.stack([drive, spin])


def turning_on_surface(along: Bounds, yaw: Bounds, surface: Array) -> Bounds:
    r"""Norms of the angular velocity of the root and of its first three derivatives, in axes that stand still.

    With the slope g = grad h (x(t), y(t)), the normal n and the frame's own turn about it
    (`SurfaceFrame`)

    .. math::
        n = (-g, 1) / \sqrt{1 + |g|^2}, \quad
        \omega = n \times n' + \Big(w_{yaw} + \frac{g_x' g_y}{(1 + g_x^2) \sqrt{1 + |g|^2}}\Big) n

    and the place moves with speed times a unit vector fixed in the root, seen from above. Norms of
    derivatives follow order by order: of the place from those of the turn below, of g by the chain
    rule, of n and of the turn by Leibniz.

    Args:
        along: Bounds on |speed| and its derivatives, 0..3 [m/s, ...].
        yaw: Likewise on the rate of the yaw [rad/s, ...].
        surface: On |grad h| and on the norms of the second to fifth derivative, where the base may
            be, shape (5, K).

    Returns:
        |w^(k)|, k = 0..3, shape (K,) each [rad/s^(k + 1)].
    """
    steep, *bends = surface
    slope: Bounds = [steep]
    spin: Bounds = []
    heading: Bounds = [np.ones_like(steep)]
    path: Bounds = []  # |p^(k)|, k = 1..4
    for k in range(ORDERS - 1):
        path.append(leibniz(along, heading, k))
        slope.append(_chain(bends, path))
        spin.append(_spin(slope, yaw))
        heading.append(leibniz(spin, heading, k))
    return spin


def _chain(bends: Bounds, path: Bounds) -> Array:
    """Bound on the next derivative of grad h along the path, by the rule of Faa di Bruno."""
    (H2, H3, H4, H5), (v, *later) = bends, path
    if len(path) == 1:
        return np.asarray(H2 * v)
    if len(path) == 2:
        return np.asarray(H3 * v**2 + H2 * later[0])
    if len(path) == 3:
        return np.asarray(H4 * v**3 + 3.0 * H3 * v * later[0] + H2 * later[1])
    a, j, s = later
    return np.asarray(H5 * v**4 + 6.0 * H4 * v**2 * a + H3 * (4.0 * v * j + 3.0 * a**2) + H2 * s)


def _spin(slope: Bounds, yaw: Bounds) -> Array:
    """Bound on the derivative of order len(slope) - 2 of the angular velocity."""
    order = len(slope) - 2
    one = np.ones_like(slope[0])
    # 1 + |g|^2, at least 1
    square = [one, *(leibniz(slope, slope, k) for k in range(1, order + 2))]
    root, inverse = _power(square, 0.5), _power(square, 1.0)  # 1 + g_x^2 has the same bounds
    across = [np.sqrt(1.0 + slope[0] ** 2), *slope[1:]]
    normal = [one, *(leibniz(across, root, k) for k in range(1, order + 2))]
    normal[1] = np.minimum(normal[1], slope[1])  # it turns more slowly than the slope changes
    share = [leibniz(inverse, root, k) for k in range(order + 1)]
    lean = [leibniz(slope, share, k) for k in range(order + 1)]
    about = [leibniz(slope[1:], lean, k) + yaw[k] for k in range(order + 1)]
    if order == 0:
        return np.asarray(np.hypot(normal[1], about[0]))
    tilt = normal[order + 1]  # (n x n')' = n x n'', and so on
    if order == 2:
        tilt = tilt + normal[1] * normal[2]
    if order == 3:
        tilt = tilt + 2.0 * normal[1] * normal[3]
    return np.asarray(tilt + leibniz(about, normal, order))


def _power(values: Bounds, exponent: float) -> Bounds:
    """Bounds on the derivatives of a^-exponent for a >= 1, from bounds on those of a."""
    falls = [np.prod(exponent + np.arange(m)) for m in range(ORDERS)]  # of |d^m a^-exponent / da^m|
    result: Bounds = [np.ones_like(values[0])]
    for k in range(1, len(values)):
        total = np.zeros_like(values[0])
        for m in range(1, k + 1):
            total = total + falls[m] * _bell(values, k, m)
        result.append(total)
    return result


def _bell(values: Bounds, k: int, m: int) -> Array:
    """Partial Bell polynomial B(k, m) of the derivatives values[1], values[2], ..."""
    if m == 0:
        return np.full_like(values[0], float(k == 0))
    total = np.zeros_like(values[0])
    for i in range(1, k - m + 2):
        total = total + comb(k - 1, i - 1) * values[i] * _bell(values, k - i, m - 1)
    return total
