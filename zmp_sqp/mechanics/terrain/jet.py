"""Arithmetic on functions of (x, y) that carry their derivatives up to the second order.

A jet is an array of shape (6, ..., K) that holds (f, f_x, f_y, f_xx, f_xy, f_yy) of functions at K
points; the axes in between are functions side by side, and broadcast. Addition and scaling are
those of arrays.
"""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array

__all__ = ["multiply", "reciprocal_sqrt"]

# which first derivatives pair up in xx, xy, yy
LEFT, RIGHT = np.array([1, 1, 2]), np.array([1, 2, 2])


def multiply(a: Array, b: Array) -> Array:
    r"""Jet of a product.

    .. math:: (ab)_{xy} = a b_{xy} + a_x b_y + a_y b_x + a_{xy} b     (xx and yy likewise)
    """
    product = a[0] * b
    product[1:] += a[1:] * b[0]
    pair = a[1:3] * b[1]  # a_x b_x, a_y b_x
    product[3:5] += pair
    product[3] += pair[0]  # twice in xx
    pair = a[1:3] * b[2]  # a_x b_y, a_y b_y
    product[4:] += pair
    product[5] += pair[1]
    return np.asarray(product)


def reciprocal_sqrt(a: Array) -> Array:
    r"""Jet of 1 / sqrt(a), for a > 0.

    .. math:: f = a^{-1/2}, \quad f' = -f^3/2, \quad f'' = 3 f^5/4
    """
    root = 1.0 / np.sqrt(a[0])
    square = root * root
    first = -0.5 * square * root
    jet = first * a
    jet[3:] -= (1.5 * square * first) * (a[LEFT] * a[RIGHT])
    jet[0] = root
    return np.asarray(jet)
