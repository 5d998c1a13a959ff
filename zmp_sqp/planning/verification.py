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
    q, v, a = trajectory.positions[:-1], trajectory.velocities[:-1], trajectory.accelerations
    h = np.diff(trajectory.times)
    since = h[:, None] * np.linspace(0.0, 1.0, SAMPLES)  # (N, samples)
    t = since[:, :, None]
    position = q[:, None] + t * v[:, None] + 0.5 * t**2 * a[:, None]
    velocity = v[:, None] + t * a[:, None]
    acceleration = np.broadcast_to(a[:, None], velocity.shape)
    flat = [part.reshape(-1, machine.size) for part in (position, velocity, acceleration)]
    root = np.concatenate([-ground.gravity(), np.zeros(3)])
    wrench = ground_reaction(machine, flat[0], flat[1], flat[2], root_acceleration=root)
    times = (trajectory.times[:-1, None] + since).ravel()
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
    """Largest excess over any joint limit at any time, in closed form: rates are linear, positions parabolas between nodes."""
    limits = machine.limits
    q, v, a = trajectory.positions, trajectory.velocities, trajectory.accelerations
    h = np.diff(trajectory.times)[:, None]
    turn = np.divide(-v[:-1], a, out=np.zeros_like(a), where=a != 0.0)  # since the node, where the rate vanishes
    turn = np.where((turn > 0.0) & (turn < h), turn, 0.0)
    extreme = q[:-1] + turn * v[:-1] + 0.5 * turn**2 * a
    places: Array = np.vstack([q, extreme])
    excesses = (
        np.abs(v) - limits.velocity, np.abs(a) - limits.acceleration,
        places - limits.position_upper, limits.position_lower - places,
    )  # fmt: skip
    return float(max(np.nanmax(excess) for excess in excesses))
