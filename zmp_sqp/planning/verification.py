"""What holds for a motion, found from the motion alone: joint limits in closed form, ZMP on a finer grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.ground import Ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import ground_reaction
from zmp_sqp.planning.trajectory import Trajectory

__all__ = ["Verification", "limit_excess", "verify"]

SAMPLES = 8  # per interval, both ends included


@dataclass(frozen=True, slots=True, eq=False)
class Verification:
    """Least stability margin of a motion and where it stands.

    Attributes:
        margin: Least sampled signed distance from the ZMP to an edge [m]; -inf where the ground would have to pull.
        time: When [s].
        edge: Which edge of the support polygon.
        limit_excess: Largest excess over a joint limit [rad or m, per second, per second squared]; not positive inside.
    """

    margin: float
    time: float
    edge: int
    limit_excess: float


def verify(machine: Machine, trajectory: Trajectory, ground: Ground) -> Verification:
    """Look at a motion at many times per interval, both ends of every interval with its own acceleration.

    Args:
        machine: With a support polygon.
        trajectory: The motion.
        ground: What the machine stands on.
    """
    times, *states = trajectory.within(np.linspace(0.0, 1.0, SAMPLES))
    root = np.concatenate([-ground.gravity(), np.zeros(3)])
    wrench = ground_reaction(machine, states[0], states[1], states[2], root_acceleration=root)
    excess = limit_excess(machine, trajectory)
    support = machine.support
    if support is None:
        return Verification(-np.inf, 0.0, 0, excess)
    lifted = np.flatnonzero(wrench[:, 2] <= 0.0)
    if len(lifted):
        return Verification(-np.inf, float(times[lifted[0]]), 0, excess)
    out = wrench @ support.wrench_rows().T / wrench[:, 2:3]  # e . p - b, (K, V)
    row, edge = np.unravel_index(np.argmax(out), out.shape)
    return Verification(-float(out[row, edge]), float(times[row]), int(edge), excess)


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
