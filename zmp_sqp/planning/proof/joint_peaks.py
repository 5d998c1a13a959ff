"""Largest coordinates, rates, accelerations and jerks of the joints between two times."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.motion.trajectory import Trajectory

__all__ = ["joint_peaks", "peaks"]


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


def joint_peaks(
    trajectory: Trajectory, interval: Indices, since: Array, length: Array
) -> tuple[Array, Array, Array, Array]:
    r"""Bounds on |coordinates|, |rates|, |accelerations| and |jerks| on K stretches, (K, n) each.

    Between two times that lie :math:`\delta` apart, a function exceeds the larger of its absolute
    values there by at most :math:`\delta^2 / 8` times a bound on its second derivative.

    Args:
        trajectory: The motion.
        interval: Interval of each stretch, shape (K,).
        since: Start of each stretch after the start of its interval, shape (K,) [s].
        length: Length of each stretch, shape (K,) [s].
    """
    times = since, since + length
    ends = [trajectory.state_in(interval, at) for at in times]
    both = tuple(np.vstack(pair) for pair in zip(*ends, strict=True))
    delta, first = length[:, None], trajectory.higher_in(interval, times[0])
    if len(first) == 1:
        j = np.abs(first[0])
        return (*peaks(both, j, delta), j)
    last, sag = trajectory.higher_in(interval, times[1]), 0.125 * delta**2
    j, s, c = (
        np.maximum(np.abs(one), np.abs(other)) for one, other in zip(first, last, strict=True)
    )
    j = j + sag * c
    reach, v, a = peaks(both, j, delta)
    return reach, v, a + sag * s, j
