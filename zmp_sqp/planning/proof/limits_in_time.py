"""Joint limits of a motion at all times, in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.double_integrator import slowest_minimum_time
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.constraints.guarantee import Guarantee

__all__ = ["LIMIT_TOLERANCE", "joints_least_duration", "limit_excess", "limit_guarantee"]

# excess over a limit that counts as rounding, as a share of the limit if that is below one
LIMIT_TOLERANCE = 1e-9
KINDS = ("upper position", "lower position", "velocity", "acceleration")


@dataclass(frozen=True, slots=True, eq=False)
class _Extremes:
    """Joint coordinates and their derivatives at all times where one can be extreme, (M, n) each.

    Within an interval, positions are cubics and rates are parabolas. Besides the nodes, only the
    times at which the rate or the acceleration vanishes can be extreme.
    """

    times: Array
    positions: Array
    rates: Array
    accelerations: Array

    @classmethod
    def of(cls, trajectory: Trajectory) -> _Extremes:
        """Extremes of a trajectory."""
        starts = trajectory.times[:-1, None]
        v, a, j = trajectory.velocities[:-1], trajectory.accelerations, trajectory.jerks
        h = np.broadcast_to(np.diff(trajectory.times)[:, None], a.shape)
        with np.errstate(all="ignore"):
            no_acceleration = -a / j
            # the two times where the rate vanishes, each in its stable form
            sqrt = np.sqrt(a**2 - 2.0 * j * v)
            pivot = -(a + np.where(a >= 0.0, sqrt, -sqrt))
            since = np.stack([no_acceleration, 2.0 * v / pivot, pivot / j, h])  # (4, N, n)
            since = np.where((since > 0.0) & (since <= h), since, 0.0)  # False for NaN
            shape, inside = (-1, a.shape[1]), _at(trajectory, since)
        nodes = np.broadcast_to(trajectory.times[:, None], trajectory.positions.shape)
        return cls(
            np.vstack([nodes, (starts + since).reshape(shape)]),
            np.vstack([trajectory.positions, inside[0].reshape(shape)]),
            np.vstack([trajectory.velocities, inside[1].reshape(shape)]),
            np.vstack([a, a[-1:], inside[2].reshape(shape)]),
        )


def limit_excess(machine: Machine, trajectory: Trajectory) -> tuple[float, float]:
    """Largest excess over any joint limit at any time, in closed form.

    Limits that are not given (NaN) cannot be exceeded; without any limit the excess is -inf.

    Returns:
        The largest excess, and the largest relative one, for which the excess over a rate or
        acceleration limit below one is divided by the limit.
    """
    with np.errstate(all="ignore"):
        excess, relative, _ = _excesses(machine, trajectory)
    return float(excess.max()), float(relative.max())


def limit_guarantee(machine: Machine, trajectory: Trajectory) -> tuple[Guarantee, float]:
    """Least room that a motion leaves to a joint limit, in closed form, and the largest excess.

    An excess that counts as rounding (`LIMIT_TOLERANCE`) makes a guarantee of zero.
    """
    with np.errstate(all="ignore"):
        excess, relative, times = _excesses(machine, trajectory)
    kind, joint = np.unravel_index(int(np.argmax(relative)), relative.shape)
    room, kept = -float(excess[kind, joint]), bool(relative[kind, joint] <= LIMIT_TOLERANCE)
    unit = _joint_units(machine)[joint] + ("", "", "/s", "/s^2")[kind]
    guarantee = Guarantee(
        name="joint_limits",
        label=f"{machine.joint_names[joint]} {KINDS[kind]}",
        value=max(room, 0.0) if kept else room,
        unit=unit,
        time=float(times[kind, joint]),
        corner="",
        proven=True,
    )
    return guarantee, float(excess.max())


def joints_least_duration(machine: Machine, trajectory: Trajectory) -> float:
    """Least duration of any motion between the trajectory's ends within the joint limits [s].

    It is zero if a limit is missing, or if a rate at the start or the end exceeds its limit.
    """
    limits, q, v = machine.limits, trajectory.positions, trajectory.velocities
    if not (np.isfinite(limits.velocity).all() and np.isfinite(limits.acceleration).all()):
        return 0.0
    if (np.abs(v[[0, -1]]) > limits.velocity * (1.0 + LIMIT_TOLERANCE)).any():
        return 0.0
    return slowest_minimum_time(
        q[-1] - q[0],
        max_velocity=limits.velocity,
        max_acceleration=limits.acceleration,
        start_velocity=v[0],
        goal_velocity=v[-1],
    )


@lru_cache(maxsize=32)
def _joint_units(machine: Machine) -> tuple[str, ...]:
    """Units of a machine's joints; cached, because the model is slow to ask for them."""
    return machine.joint_units


def _excesses(machine: Machine, trajectory: Trajectory) -> tuple[Array, Array, Array]:
    """Largest excess over each limit, relative excess, and time, shape (4, n), ordered by KINDS."""
    limits, extremes = machine.limits, _Extremes.of(trajectory)
    values = (
        extremes.positions,
        -extremes.positions,
        np.abs(extremes.rates),
        np.abs(extremes.accelerations),
    )
    bounds = np.stack(
        [limits.position_upper, -limits.position_lower, limits.velocity, limits.acceleration]
    )
    every = np.stack(values)  # (4, M, n)
    every[np.isnan(every)] = np.inf
    at = every.argmax(axis=1)
    peaks = np.take_along_axis(every, at[:, None], axis=1)[:, 0]
    times = np.take_along_axis(extremes.times, at, axis=0)
    excess = peaks - bounds
    excess[np.isnan(excess)] = np.inf
    unlimited = np.isnan(bounds) | (bounds == np.inf)
    excess = np.where(unlimited, -np.inf, excess)
    unit = np.ones_like(bounds)
    unit[2:] = np.where(bounds[2:] < 1.0, bounds[2:], 1.0)
    return excess, np.where(unlimited, -np.inf, excess / unit), times


def _at(trajectory: Trajectory, t: Array) -> tuple[Array, Array, Array]:
    """Positions, rates, accelerations at times t (M, N, n) after the starts of the intervals."""
    q, v = trajectory.positions[:-1], trajectory.velocities[:-1]
    a, j = trajectory.accelerations, trajectory.jerks
    position = q + t * v + 0.5 * t**2 * a + t**3 * j / 6.0
    return position, v + t * a + 0.5 * t**2 * j, a + t * j
