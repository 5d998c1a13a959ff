"""Minimum-time motion of one joint with rate and acceleration limits, continuous or on a grid."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array

__all__ = [
    "BangCoastBang",
    "grid_minimum_time",
    "grid_profile",
    "minimum_time",
    "slowest_minimum_time",
    "timed_motion",
]

ROUNDING = 1e-9  # [rad or m] difference of two distances that counts as rounding
SMALLEST = 1e-150  # added to, or least value of, denominators that may be zero


@dataclass(frozen=True, slots=True)
class BangCoastBang:
    """Motion in three phases: accelerate to a peak rate, coast, decelerate.

    Attributes:
        acceleration: Signed acceleration of the first phase; that of the last phase is its negative
            [rad/s^2 or m/s^2].
        peak: Signed rate while coasting [rad/s or m/s].
        phases: Durations of the three phases [s].
    """

    acceleration: float
    peak: float
    phases: tuple[float, float, float]

    @property
    def duration(self) -> float:
        """Duration of the whole motion [s]."""
        return sum(self.phases)


def minimum_time(
    distance: float,
    *,
    max_velocity: float,
    max_acceleration: float,
    start_velocity: float = 0.0,
    goal_velocity: float = 0.0,
) -> BangCoastBang:
    r"""Time-optimal motion of one double integrator.

    From rest to rest over a distance D it takes :math:`D/v + v/a` if :math:`D \ge v^2/a`, else
    :math:`2\sqrt{D/a}`.

    Args:
        distance: Signed displacement [rad or m].
        max_velocity: Rate limit v > 0 [rad/s or m/s].
        max_acceleration: Acceleration limit a > 0 [rad/s^2 or m/s^2].
        start_velocity: Rate at the start, within the rate limit [rad/s or m/s].
        goal_velocity: Rate at the goal, within the rate limit [rad/s or m/s].

    Returns:
        The fastest motion within the limits.
    """
    v0, v1, a = start_velocity, goal_velocity, max_acceleration
    # displacement while the rate changes from v0 to v1 at full acceleration
    direct = 0.5 * (v0 + v1) * abs(v1 - v0) / a
    # within rounding of this displacement, a single phase of acceleration is the fastest motion
    if v0 * v1 > 0.0 and abs(distance - direct) <= ROUNDING:
        return BangCoastBang(float(np.sign(v1 - v0)) * a, v1, (abs(v1 - v0) / a, 0.0, 0.0))
    sign = 1.0 if distance >= direct else -1.0
    distance, v0, v1 = sign * distance, sign * v0, sign * v1
    peak = float(np.sqrt(max(0.5 * (v0**2 + v1**2) + a * distance, 0.0)))
    peak = max(peak, v0, v1)  # it may fall below the larger of them by rounding
    coast = 0.0
    if peak > max_velocity:
        peak = max_velocity
        ramps = (2.0 * peak**2 - v0**2 - v1**2) / (2.0 * a)
        coast = max(distance - ramps, 0.0) / peak
    return BangCoastBang(sign * a, sign * peak, ((peak - v0) / a, coast, (peak - v1) / a))


def slowest_minimum_time(
    distance: Array,
    *,
    max_velocity: Array,
    max_acceleration: Array,
    start_velocity: Array,
    goal_velocity: Array,
) -> float:
    """Largest of the joints' own minimum times [s]: no motion of all of them is shorter.

    Args:
        distance: Signed displacements, shape (n,) [rad or m].
        max_velocity: Rate limits, shape (n,).
        max_acceleration: Acceleration limits, shape (n,).
        start_velocity, goal_velocity: Rates at both ends, shape (n,) each.
    """
    rows = zip(distance, max_velocity, max_acceleration, start_velocity, goal_velocity, strict=True)
    return max(
        minimum_time(
            float(d),
            max_velocity=float(v),
            max_acceleration=float(a),
            start_velocity=float(v0),
            goal_velocity=float(v1),
        ).duration
        for d, v, a, v0, v1 in rows
    )


def timed_motion(
    distance: float,
    duration: float,
    *,
    max_velocity: float,
    max_acceleration: float,
    start_velocity: float = 0.0,
    goal_velocity: float = 0.0,
) -> tuple[Array, Array] | None:
    r"""Motion of one double integrator that takes a given time, with its largest acceleration.

    It goes from the start rate to a coasting rate p, coasts, and goes to the goal rate. It covers

    .. math:: D(p) = \frac{v_0 + p}{2} t_1 + p\, t_2 + \frac{p + v_1}{2} t_3, \quad
              t_1 = |p - v_0| / a, \; t_3 = |v_1 - p| / a, \; t_2 = T - t_1 - t_3

    grows with p as long as there is time to coast, dD/dp = t_2, and is linear in p between v_0 and
    v_1 and quadratic beyond, so that p is found in closed form.

    Args:
        distance: Signed displacement [rad or m].
        duration: T [s].
        max_velocity, max_acceleration: Limits v and a.
        start_velocity, goal_velocity: Rates at both ends, within the rate limit.

    Returns:
        Durations of the three phases [s] and their accelerations, shape (3,) each; None if no such
        motion takes just this time.
    """
    v0, v1, a = start_velocity, goal_velocity, max_acceleration
    spare = duration - abs(v1 - v0) / a
    if spare < 0.0:
        return None
    lowest = max(min(v0, v1) - 0.5 * a * spare, -max_velocity)
    highest = min(max(v0, v1) + 0.5 * a * spare, max_velocity)

    def covered(peak: float) -> float:
        first, last = abs(peak - v0) / a, abs(v1 - peak) / a
        coast = duration - first - last
        return 0.5 * (v0 + peak) * first + peak * coast + 0.5 * (peak + v1) * last

    short, long = covered(lowest), covered(highest)
    slack = ROUNDING * max(1.0, abs(distance))
    if not short - slack <= distance <= long + slack:
        return None
    slow, fast = min(v0, v1), max(v0, v1)
    # beyond the rates at the ends by x, D differs by x spare - x^2 / a
    if (more := distance - covered(fast)) > 0.0:
        root = math.sqrt(max(spare**2 - 4.0 * more / a, 0.0))
        peak = fast + 2.0 * more / max(spare + root, SMALLEST)
    elif (less := covered(slow) - distance) > 0.0:
        root = math.sqrt(max(spare**2 - 4.0 * less / a, 0.0))
        peak = slow - 2.0 * less / max(spare + root, SMALLEST)
    else:
        peak = slow - less / max(spare, SMALLEST)
    peak = min(max(peak, lowest), highest)
    first, last = abs(peak - v0) / a, abs(v1 - peak) / a
    phases = np.array([first, max(duration - first - last, 0.0), last])
    return phases, np.array([np.sign(peak - v0) * a, 0.0, np.sign(v1 - peak) * a])


def grid_minimum_time(
    distance: Array, *, max_velocity: Array, max_acceleration: Array, intervals: int
) -> float:
    r"""Minimum time from rest to rest with constant acceleration on each of N equal intervals.

    With interval length h, a joint covers the largest distance D if its rate at node k is
    :math:`\min(a h m_k, v)`, :math:`m_k = \min(k, N - k)`. If K of these rates on either side are
    below the rate limit v,

    .. math:: D = a K (K + 1) h^2 + v (N - 1 - 2 K) h

    and if all of them are, :math:`D = a h^2 \lfloor N^2 / 4 \rfloor`. D increases with h, so the
    solution h is the one that agrees with the K for which it was computed.

    Args:
        distance: Displacements, shape (n,) [rad or m].
        max_velocity: Rate limits v, shape (n,) [rad/s or m/s].
        max_acceleration: Acceleration limits a, shape (n,) [rad/s^2 or m/s^2].
        intervals: Number N of intervals.

    Returns:
        Least duration that suffices for every joint [s].
    """
    size, v, a = np.abs(distance), max_velocity, max_acceleration
    K = np.arange((intervals - 1) // 2 + 1)[:, None]  # (K, n) below
    square, linear = a * K * (K + 1), v * (intervals - 1 - 2 * K)
    capped = 2.0 * size / (linear + np.sqrt(linear**2 + 4.0 * square * size) + SMALLEST)
    fits = np.floor(v / (a * np.maximum(capped, SMALLEST)) * (1.0 + 1e-12)) == K
    free = np.sqrt(size / (a * (intervals**2 // 4)))
    uncapped = a * free * (intervals // 2) <= v * (1.0 + 1e-12)
    step = np.where(uncapped, free, np.where(fits, capped, 0.0).max(axis=0))
    return float(intervals * step.max())


def grid_profile(
    distance: Array,
    duration: float,
    *,
    max_velocity: Array,
    max_acceleration: Array,
    intervals: int,
) -> Array:
    """Rest-to-rest motion of a given duration, with constant acceleration on each of N intervals.

    Each joint accelerates, coasts and decelerates, with the least acceleration that its rate limit
    and the duration allow.

    Args:
        distance: Displacements, shape (n,) [rad or m].
        duration: Duration of the motion, at least `grid_minimum_time` [s].
        max_velocity: Rate limits, shape (n,) [rad/s or m/s].
        max_acceleration: Acceleration limits, shape (n,) [rad/s^2 or m/s^2].
        intervals: Number N of intervals.

    Returns:
        Accelerations on the intervals, shape (N, n) [rad/s^2 or m/s^2].
    """
    size, v, h = np.abs(distance), max_velocity, duration / intervals
    K = np.arange(1, (intervals - 1) // 2 + 1)[:, None]
    free = size / (h**2 * (intervals**2 // 4))
    gentle = free
    if len(K):
        capped = np.maximum(
            (size - v * h * (intervals - 1 - 2 * K)) / (K * (K + 1) * h**2), SMALLEST
        )
        fits = np.floor(v / (capped * h) * (1.0 + 1e-12)) == K
        least = np.where(fits, capped, np.inf).min(axis=0)
        gentle = np.where(free * h * (intervals // 2) <= v * (1.0 + 1e-12), free, least)
    gentle = np.minimum(gentle, max_acceleration)
    count = np.minimum(np.arange(intervals + 1), np.arange(intervals + 1)[::-1])[:, None]
    rates = np.minimum(gentle * h * count, v)
    covered = h * rates.sum(axis=0)
    # removes the rounding error of the distance
    rates *= np.divide(size, covered, out=np.zeros_like(size), where=covered > 0.0)
    return np.asarray(np.diff(rates, axis=0) / h * np.sign(distance))
