"""Bounds on norms of time derivatives: of products, and of directions that turn."""

from __future__ import annotations

from math import comb

import numpy as np

from zmp_sqp.arrays import Array

__all__ = ["ORDERS", "Bounds", "leibniz", "turning"]

Bounds = list[Array]  # of the norms of a quantity and of its time derivatives, shape (K,) each
# derivatives 0..4: a wrench holds the second derivative of places, and is differentiated twice
ORDERS = 5


def turning(spin: Bounds) -> Bounds:
    """Norms of the derivatives, 0 to 4, of a unit vector fixed in a body with |w^(k)| <= spin[k]."""
    unit = [np.ones_like(spin[0])]
    for k in range(ORDERS - 1):
        unit.append(leibniz(spin, unit, k))
    return unit


def leibniz(first: Bounds | Array, second: Bounds | Array, k: int) -> Array:
    """Bound on the k-th derivative of a product of two factors with bounded derivatives."""
    total = first[0] * second[k]
    for i in range(1, k + 1):
        total = total + comb(k, i) * first[i] * second[k - i]
    return np.asarray(total)
