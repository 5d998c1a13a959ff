"""Joint limits of a motion at all times, in closed form."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.planning.trajectory import Trajectory

__all__ = ["limit_excess"]


def limit_excess(machine: Machine, trajectory: Trajectory) -> float:
    """Largest excess over any joint limit at any time, in closed form: rates are parabolas, positions cubics."""
    limits = machine.limits
    v, a, j = trajectory.velocities[:-1], trajectory.accelerations, trajectory.jerks
    h = np.diff(trajectory.times)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = -a / j  # where the rate is extreme
        root = np.sqrt(a**2 - 2.0 * j * v)  # where the rate vanishes and the position is extreme, stably
        pivot = -(a + np.where(a >= 0.0, root, -root))
        stops = np.stack([2.0 * v / pivot, pivot / j])
    rates = [np.abs(trajectory.velocities), np.abs(_at(trajectory, turn, h)[1])]
    places = [trajectory.positions, *(_at(trajectory, stop, h)[0] for stop in stops)]
    excesses = [
        *(rate - limits.velocity for rate in rates),
        *(np.abs(push) - limits.acceleration for push in (a, trajectory.end_accelerations)),
        *(place - limits.position_upper for place in places),
        *(limits.position_lower - place for place in places),
    ]
    return float(max(np.nanmax(excess) for excess in excesses))


def _at(trajectory: Trajectory, since: Array, h: Array) -> tuple[Array, Array]:
    """Positions and rates at a time of its own per joint and interval, (N, n); at the node if that is outside."""
    t = np.where((since > 0.0) & (since < h), since, 0.0)  # False for NaN
    q, v, a, j = trajectory.positions[:-1], trajectory.velocities[:-1], trajectory.accelerations, trajectory.jerks
    return q + t * v + 0.5 * t**2 * a + t**3 * j / 6.0, v + t * a + 0.5 * t**2 * j
