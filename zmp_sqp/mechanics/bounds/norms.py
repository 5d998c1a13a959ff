"""Bounds on the norms of time derivatives of products and of rotating unit vectors."""

from __future__ import annotations

from math import comb

import numpy as np

from zmp_sqp.arrays import Array

__all__ = ["ORDERS", "Bounds", "leibniz", "turning"]

# Upper bounds on the norms of a quantity and of its successive time derivatives, over K intervals
# of time: entry k bounds the k-th derivative and has shape (K,).
Bounds = list[Array]
# number of derivatives 0..4 of positions that are bounded: a wrench contains the second derivative
# of positions, and the second derivative of the wrench is needed
ORDERS = 5


def turning(spin: Bounds) -> Bounds:
    r"""Bounds on derivatives 0 to 4 of a unit vector u that is fixed in a rotating body.

    From :math:`u' = \omega \times u` by the rule of Leibniz.

    Args:
        spin: Bounds on the body's angular velocity \omega and its derivatives, orders 0 to 3.
    """
    unit = [np.ones_like(spin[0])]
    for k in range(ORDERS - 1):
        unit.append(leibniz(spin, unit, k))
    return unit


def leibniz(first: Bounds | Array, second: Bounds | Array, k: int) -> Array:
    r"""Bound on the k-th derivative of a product of two factors, by the rule of Leibniz.

    .. math:: |(a b)^{(k)}| \le \sum_i \binom{k}{i} |a^{(i)}| |b^{(k-i)}|

    Args:
        first, second: Bounds on the factors and their derivatives, orders 0 to k at least.
        k: Order of the derivative.
    """
    total = first[0] * second[k]
    for i in range(1, k + 1):
        total = total + comb(k, i) * first[i] * second[k - i]
    return np.asarray(total)
