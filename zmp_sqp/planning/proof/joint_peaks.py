"""Largest coordinates, rates and accelerations of the joints between two times."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array

__all__ = ["peaks"]


def peaks(ends: tuple[Array, ...], j: Array, delta: Array) -> tuple[Array, Array, Array]:
    """Largest |coordinates|, |rates| and |accelerations| between two times, shape (K, n) each.

    Rates are parabolas, so that their values at both times and the jerk bound their largest value.

    Args:
        ends: Coordinates, rates and accelerations at the starts, then at the ends, (2K, n) each.
        j: |jerks|, shape (K, n).
        delta: Time from start to end, shape (K, 1) [s].
    """
    q, v, a = (np.abs(part).reshape(2, len(j), -1).max(axis=0) for part in ends)
    v = v + 0.125 * delta**2 * j
    return q + 0.5 * delta * v, v, a
