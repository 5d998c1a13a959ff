"""Rigorous bounds on the motion of the root of a base that drives on a plane or a surface."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.bounds.norms import ORDERS, Bounds, leibniz, turning

__all__ = ["root_bounds", "turning_on_surface"]


def root_bounds(peaks: Array, surface: Array | None = None, height: float = 0.0) -> Array:
    r"""Bounds on the linear and angular motion of the root over K intervals of time.

    The contact point o - h n below the root origin o drives with the speed s along the heading e;
    e and the ground normal n are unit vectors fixed in the root. Hence

    .. math:: o' = s e + h n'

    and `norms.turning` bounds the derivatives of e and n from those of the angular velocity.

    Args:
        peaks: Largest |speed|, |acceleration| and |jerk| along the heading, and largest |yaw rate|,
            |yaw acceleration| and |yaw jerk|, shape (2, 3, K); higher derivatives are zero.
        surface: Bounds on the derivatives of the ground's height under the base, see
            `turning_on_surface`, shape (5, K); None is a plane.
        height: Distance |h| of the root origin from the ground along the normal [m].

    Returns:
        Norms of derivatives 1 to 4 of the root's origin and of derivatives 0 to 3 of its angular
        velocity, shape (2, 4, K).
    """
    along, yaw = ([*part, np.zeros_like(part[0])] for part in peaks)
    if surface is None or not surface.any():  # the normal is constant
        heading = turning(yaw)
        return np.stack([[leibniz(along, heading, k) for k in range(ORDERS - 1)], yaw])
    spin = turning_on_surface(along, yaw, surface)
    heading = turning(spin)
    drive = [leibniz(along, heading, k) + height * heading[k + 1] for k in range(ORDERS - 1)]
    return np.stack([drive, spin])


def turning_on_surface(along: Bounds, yaw: Bounds, surface: Array) -> Bounds:
    r"""Bounds on the angular velocity of a root that stays tangent to a surface z = h(x, y).

    With the gradient g = grad h at the base's position p(t) = (x, y) and the normal n, the angular
    velocity is (the fraction is the rotation of the `SurfaceFrame` about n)

    .. math::
        n = (-g, 1) / \sqrt{1 + |g|^2}, \quad
        \omega = n \times n' + \Big(w_{yaw} + \frac{g_x' g_y}{(1 + g_x^2) \sqrt{1 + |g|^2}}\Big) n

    Seen from above, p moves with the speed times the horizontal part of a unit vector that is fixed
    in the root. Bounds on the derivatives follow order by order: p from the lower orders of \omega,
    then g by the chain rule, then n and \omega by the rule of Leibniz.

    Args:
        along: Bounds on the speed along the heading and its derivatives, orders 0 to 3 [m/s, ...].
        yaw: Bounds on the yaw rate and its derivatives, orders 0 to 3 [rad/s, ...].
        surface: Bounds on |grad h| and on the norms of the second to fifth derivative of h wherever
            the base may be, shape (5, K).

    Returns:
        Bounds on the k-th derivative of \omega in inertial axes, k = 0..3, shape (K,) each
        [rad/s^(k + 1)].
    """
    steepest, *curvatures = surface
    gradient: Bounds = [steepest]
    spin: Bounds = []
    heading: Bounds = [np.ones_like(steepest)]
    path: Bounds = []  # |p^(k)|, k = 1..4
    for k in range(ORDERS - 1):
        path.append(leibniz(along, heading, k))
        gradient.append(_chain(curvatures, path))
        spin.append(_spin(gradient, yaw))
        heading.append(leibniz(spin, heading, k))
    return spin


def _chain(curvatures: Bounds, path: Bounds) -> Array:
    """Bound on the derivative of order len(path) of grad h(p(t)), by the rule of Faa di Bruno.

    Args:
        curvatures: Bounds on the second to fifth derivative of h.
        path: Bounds on the derivatives 1, 2, ... of the position p.
    """
    (H2, H3, H4, H5), (v, *later) = curvatures, path
    if len(path) == 1:
        return np.asarray(H2 * v)
    if len(path) == 2:
        return np.asarray(H3 * v**2 + H2 * later[0])
    if len(path) == 3:
        return np.asarray(H4 * v**3 + 3.0 * H3 * v * later[0] + H2 * later[1])
    a, j, s = later
    return np.asarray(H5 * v**4 + 6.0 * H4 * v**2 * a + H3 * (4.0 * v * j + 3.0 * a**2) + H2 * s)


def _spin(gradient: Bounds, yaw: Bounds) -> Array:
    r"""Bound on the derivative of order len(gradient) - 2 of the angular velocity.

    Args:
        gradient: Bounds on g = grad h along the path and on its derivatives.
        yaw: Bounds on the yaw rate and its derivatives.
    """
    order = len(gradient) - 2
    one = np.ones_like(gradient[0])
    # 1 + |g|^2, at least 1; 1 + g_x^2 has these bounds, too
    square = [one, *(leibniz(gradient, gradient, k) for k in range(1, order + 2))]
    inverse_sqrt, inverse = _power(square, 0.5), _power(square, 1.0)
    upright = [np.sqrt(1.0 + gradient[0] ** 2), *gradient[1:]]  # (-g, 1)
    normal = [one, *(leibniz(upright, inverse_sqrt, k) for k in range(1, order + 2))]
    normal[1] = np.minimum(normal[1], gradient[1])  # |n'| <= |g'|
    reciprocal = [leibniz(inverse, inverse_sqrt, k) for k in range(order + 1)]
    factor = [leibniz(gradient, reciprocal, k) for k in range(order + 1)]
    about = [leibniz(gradient[1:], factor, k) + yaw[k] for k in range(order + 1)]  # n . omega
    if order == 0:
        return np.asarray(np.hypot(normal[1], about[0]))
    # derivatives of n x n': n x n'', then n' x n'' + n x n''', then 2 n' x n''' + n x n''''
    tilt = normal[order + 1]
    if order == 2:
        tilt = tilt + normal[1] * normal[2]
    if order == 3:
        tilt = tilt + 2.0 * normal[1] * normal[3]
    return np.asarray(tilt + leibniz(about, normal, order))


def _power(values: Bounds, exponent: float) -> Bounds:
    """Bounds on a^-exponent and its time derivatives for a >= 1, from bounds on those of a.

    By the rule of Faa di Bruno, for at most the fourth derivative.
    """
    first, second, third, fourth = (  # |d^m a^-exponent / da^m| <= exponent (exponent + 1) ...
        float(np.prod(exponent + np.arange(m))) for m in range(1, ORDERS)
    )
    result: Bounds = [np.ones_like(values[0])]
    for k in range(1, len(values)):
        a1, ak = values[1], values[k]
        if k == 1:
            total = first * a1
        elif k == 2:
            total = first * ak + second * a1**2
        elif k == 3:
            total = first * ak + 3.0 * second * a1 * values[2] + third * a1**3
        else:
            a2, a3 = values[2], values[3]
            total = first * ak + second * (4.0 * a1 * a3 + 3.0 * a2**2)
            total = total + 6.0 * third * a1**2 * a2 + fourth * a1**4
        result.append(np.asarray(total))
    return result
