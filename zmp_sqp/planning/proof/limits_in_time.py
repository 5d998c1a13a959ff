"""Joint limits of a motion at all times, in closed form."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.double_integrator import minimum_time
from zmp_sqp.motion.trajectory import Trajectory

__all__ = ["LIMIT_TOLERANCE", "joints_least_duration", "limit_excess"]

# largest excess over a limit of a motion that keeps them, as a share of it if it is below 1
LIMIT_TOLERANCE = 1e-9


def limit_excess(machine: Machine, trajectory: Trajectory) -> tuple[float, float]:
    """Largest excess over any joint limit at any time, in closed form: rates are parabolas, positions cubics.

    Limits that nobody has given (NaN) cannot be exceeded; without any it is -inf. The second value
    is the same with excesses over rate and acceleration limits below 1 taken as shares of the
    limit.
    """
    limits = machine.limits
    v, a, j = trajectory.velocities[:-1], trajectory.accelerations, trajectory.jerks
    h = np.broadcast_to(np.diff(trajectory.times)[:, None], a.shape)
    with np.errstate(all="ignore"):
        turn = -a / j  # where the rate is extreme
        # where the rate vanishes and the position is extreme, stably
        root = np.sqrt(a**2 - 2.0 * j * v)
        pivot = -(a + np.where(a >= 0.0, root, -root))
        inner = [_at(trajectory, since, h) for since in (turn, 2.0 * v / pivot, pivot / j, h)]
        places = np.vstack([trajectory.positions, *(place for place, _ in inner)])
        rates = np.vstack([trajectory.velocities, *(rate for _, rate in inner)])
        pushes = np.vstack([a, trajectory.end_accelerations])
        over_places = max(
            _excess(places.max(axis=0), limits.position_upper),
            _excess(-places.min(axis=0), -limits.position_lower),
        )
        peaks = np.concatenate([np.abs(rates).max(axis=0), np.abs(pushes).max(axis=0)])
        bounds = np.concatenate([limits.velocity, limits.acceleration])
        absolute = max(over_places, _excess(peaks, bounds))
        relative = max(over_places, _excess(peaks, bounds, np.where(bounds < 1.0, bounds, 1.0)))
    return absolute, relative


def joints_least_duration(machine: Machine, trajectory: Trajectory) -> float:
    """Least duration of any motion between the trajectory's ends within the joint limits [s]; 0 if one is missing."""
    limits, q, v = machine.limits, trajectory.positions, trajectory.velocities
    if not (np.isfinite(limits.velocity).all() and np.isfinite(limits.acceleration).all()):
        return 0.0
    if (np.abs(v[[0, -1]]) > limits.velocity * (1.0 + LIMIT_TOLERANCE)).any():
        return 0.0
    rows = zip(q[-1] - q[0], limits.velocity, limits.acceleration, v[0], v[-1], strict=True)
    return max(
        minimum_time(
            float(d),
            max_velocity=float(top),
            max_acceleration=float(push),
            start_velocity=float(first),
            goal_velocity=float(last),
        ).duration
        for d, top, push, first, last in rows
    )


def _excess(values: Array, bound: Array, unit: Array | float = 1.0) -> float:
    """Largest of (values - bound) / unit, shape (n,); an overflow exceeds every limit that there is."""
    over = np.nan_to_num((values - bound) / unit, nan=np.inf, posinf=np.inf, neginf=-np.inf)
    return float(np.where(np.isnan(bound) | (bound == np.inf), -np.inf, over).max())


def _at(trajectory: Trajectory, since: Array, h: Array) -> tuple[Array, Array]:
    """Positions and rates at a time of its own per joint and interval, (N, n); at the node if that is outside."""
    t = np.where((since > 0.0) & (since <= h), since, 0.0)  # False for NaN
    q, v, a, j = (
        trajectory.positions[:-1],
        trajectory.velocities[:-1],
        trajectory.accelerations,
        trajectory.jerks,
    )
    return q + t * v + 0.5 * t**2 * a + t**3 * j / 6.0, v + t * a + 0.5 * t**2 * j
