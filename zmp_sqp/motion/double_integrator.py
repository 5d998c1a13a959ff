"""Minimum time of one joint with rate and acceleration limits: in continuous time and on a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array

__all__ = [
    "BangCoastBang",
    "grid_minimum_time",
    "grid_profile",
    "minimum_time",
    "slowest_minimum_time",
]

ROUNDING = 1e-9  # [rad or m] of a distance
SMALLEST = 1e-150  # keeps quotients finite


@dataclass(frozen=True, slots=True)
class BangCoastBang:
    """Accelerate to a peak rate, coast, decelerate.

    Attributes:
        acceleration: Signed acceleration of the first phase [rad/s^2 or m/s^2]; the last phase has
            its negative.
        peak: Signed rate while coasting [rad/s or m/s].
        phases: Durations of the three phases [s].
    """

    acceleration: float
    peak: float
    phases: tuple[float, float, float]

    @property
    def duration(self) -> float:
        """Sum of the phases [s]."""
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

    From rest to rest: :math:`D/v + v/a` if :math:`D \ge v^2/a`, else :math:`2\sqrt{D/a}`. The start
        and goal rates must
    lie within the rate limit.

    Args:
        distance: Signed displacement [rad or m].
        max_velocity: Rate limit v > 0.
        max_acceleration: Acceleration limit a > 0.
        start_velocity: Rate at the start.
        goal_velocity: Rate at the goal.

    Returns:
        The motion; no other motion within the limits is shorter.
    """
    v0, v1, a = start_velocity, goal_velocity, max_acceleration
    # displacement of going from v0 to v1 at full acceleration
    direct = 0.5 * (v0 + v1) * abs(v1 - v0) / a
    # on the edge between two kinds of motion: the shorter one
    if v0 * v1 > 0.0 and abs(distance - direct) <= ROUNDING:
        return BangCoastBang(float(np.sign(v1 - v0)) * a, v1, (abs(v1 - v0) / a, 0.0, 0.0))
    sign = 1.0 if distance >= direct else -1.0
    distance, v0, v1 = sign * distance, sign * v0, sign * v1
    peak = float(np.sqrt(max(0.5 * (v0**2 + v1**2) + a * distance, 0.0)))
    peak = max(peak, v0, v1)  # equal to the larger one but for rounding
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


def grid_minimum_time(
    distance: Array, *, max_velocity: Array, max_acceleration: Array, intervals: int
) -> float:
    r"""Least duration of a rest-to-rest motion whose accelerations are constant on each of N equal intervals.

    The farthest that a joint gets with steps h has the node rates min(a h m_k, v), m_k = min(k, N -
    k). If K of the m_k on either side are below the cap, :math:`D = a K (K + 1) h^2 + v (N - 1 - 2
    K) h`; without a cap,
    :math:`D = a h^2 \lfloor N^2 / 4 \rfloor`. Both grow with h, so the right root is the one whose
    K fits.

    Args:
        distance: Displacements, shape (n,) [rad or m].
        max_velocity: Rate limits, shape (n,).
        max_acceleration: Acceleration limits, shape (n,).
        intervals: N.

    Returns:
        Duration that suffices for every joint and that the slowest one needs [s].
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
    """Rest-to-rest accelerations on the grid that cover the distances in exactly this duration, bang-coast-bang.

    Each joint accelerates as gently as its rate limit and the duration allow.

    Args:
        distance: Displacements, shape (n,) [rad or m].
        duration: At least `grid_minimum_time` [s].
        max_velocity: Rate limits, shape (n,).
        max_acceleration: Acceleration limits, shape (n,).
        intervals: N.

    Returns:
        Accelerations, shape (N, n) [rad/s^2 or m/s^2].
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
    rates *= np.divide(size, covered, out=np.zeros_like(size), where=covered > 0.0)  # rounding
    return np.asarray(np.diff(rates, axis=0) / h * np.sign(distance))
