"""Jets: values of functions f(x, y) together with their first and second derivatives.

A jet is an array of shape (6, ..., K) that holds (f, f_x, f_y, f_xx, f_xy, f_yy) at K points. The
axes in between count several functions and broadcast as usual. Jets are added and scaled as arrays;
this module has the operations that need the product rule or the chain rule.
"""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array

__all__ = ["multiply", "reciprocal_sqrt"]

# entries of the two first derivatives whose product belongs to f_xx, f_xy and f_yy
LEFT, RIGHT = np.array([1, 1, 2]), np.array([1, 2, 2])


def multiply(a: Array, b: Array) -> Array:
    r"""Jet of the product of two functions.

    .. math:: (ab)_x = a b_x + a_x b, \quad (ab)_{xy} = a b_{xy} + a_x b_y + a_y b_x + a_{xy} b
    """
    product = a[0] * b
    product[1:] += a[1:] * b[0]
    pair = a[1:3] * b[1]  # a_x b_x, a_y b_x
    product[3:5] += pair
    product[3] += pair[0]  # a_x b_x counts twice in (ab)_xx
    pair = a[1:3] * b[2]  # a_x b_y, a_y b_y
    product[4:] += pair
    product[5] += pair[1]
    return np.asarray(product)


def reciprocal_sqrt(a: Array) -> Array:
    r"""Jet of f = 1 / sqrt(a), for a > 0.

    .. math:: f = a^{-1/2}, \quad df/da = -f^3/2, \quad d^2f/da^2 = 3 f^5/4
    """
    inverse_sqrt = 1.0 / np.sqrt(a[0])
    square = inverse_sqrt * inverse_sqrt
    first = -0.5 * square * inverse_sqrt
    jet = first * a
    jet[3:] -= (1.5 * square * first) * (a[LEFT] * a[RIGHT])
    jet[0] = inverse_sqrt
    return np.asarray(jet)
