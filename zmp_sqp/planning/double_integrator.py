"""Minimum time of one joint with rate and acceleration limits: in continuous time and on a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array

__all__ = ["BangCoastBang", "grid_minimum_time", "grid_profile", "minimum_time"]

BISECTIONS = 60  # halvings until the interval is below rounding


@dataclass(frozen=True, slots=True)
class BangCoastBang:
    """Accelerate to a peak rate, coast, decelerate.

    Attributes:
        acceleration: Signed acceleration of the first phase [rad/s^2 or m/s^2]; the last phase has its negative.
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
    distance: float, *, max_velocity: float, max_acceleration: float, start_velocity: float = 0.0, goal_velocity: float = 0.0
) -> BangCoastBang:
    r"""Time-optimal motion of one double integrator.

    From rest to rest: :math:`D/v + v/a` if :math:`D \ge v^2/a`, else :math:`2\sqrt{D/a}`. The start and goal rates must
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
    direct = 0.5 * (v0 + v1) * abs(v1 - v0) / a  # displacement of going from v0 to v1 at full acceleration
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


def grid_minimum_time(distance: Array, *, max_velocity: Array, max_acceleration: Array, intervals: int) -> float:
    """Least duration of a rest-to-rest motion whose accelerations are constant on each of N equal intervals.

    The farthest that a joint gets in time T on the grid has node rates min(a t, v, a (T - t)) and grows with T, so its
    inverse is found by bisection.

    Args:
        distance: Displacements, shape (n,) [rad or m].
        max_velocity: Rate limits, shape (n,).
        max_acceleration: Acceleration limits, shape (n,).
        intervals: N.

    Returns:
        Duration that suffices for every joint and that the slowest one needs [s].
    """
    low = max(
        minimum_time(d, max_velocity=v, max_acceleration=a).duration
        for d, v, a in zip(np.abs(distance), max_velocity, max_acceleration, strict=True)
    )
    if low == 0.0:
        return 0.0

    def reaches(duration: float) -> bool:
        farthest = _displacement(_rates(duration, max_velocity, max_acceleration, intervals), duration)
        return bool(np.all(farthest >= np.abs(distance)))

    high = low
    while not reaches(high):
        low, high = high, 1.05 * high
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if reaches(middle) else (middle, high)
    return high


def grid_profile(distance: Array, duration: float, *, max_velocity: Array, max_acceleration: Array, intervals: int) -> Array:
    """Rest-to-rest accelerations on the grid that cover the distances in exactly this duration, as gently as bang-coast-bang can.

    Args:
        distance: Displacements, shape (n,) [rad or m].
        duration: At least `grid_minimum_time` [s].
        max_velocity: Rate limits, shape (n,).
        max_acceleration: Acceleration limits, shape (n,).
        intervals: N.

    Returns:
        Accelerations, shape (N, n) [rad/s^2 or m/s^2].
    """
    size = np.abs(distance)
    low, high = np.zeros_like(size), np.ones_like(size)
    for _ in range(BISECTIONS):
        share = 0.5 * (low + high)
        enough = _displacement(_rates(duration, max_velocity, share * max_acceleration, intervals), duration) >= size
        low, high = np.where(enough, low, share), np.where(enough, share, high)
    rates = _rates(duration, max_velocity, high * max_acceleration, intervals)
    covered = _displacement(rates, duration)
    rates *= np.divide(size, covered, out=np.zeros_like(size), where=covered > 0.0)  # rounding of the bisection
    return np.asarray(np.diff(rates, axis=0) * (intervals / duration) * np.sign(distance))


def _rates(duration: float, velocity: Array, acceleration: Array, intervals: int) -> Array:
    elapsed = np.linspace(0.0, duration, intervals + 1)[:, None]
    return np.minimum(np.minimum(acceleration * elapsed, acceleration * elapsed[::-1]), velocity)


def _displacement(rates: Array, duration: float) -> Array:
    step = duration / (len(rates) - 1)
    return np.asarray(step * (rates.sum(axis=0) - 0.5 * (rates[0] + rates[-1])))
