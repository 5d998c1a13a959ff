"""Joint limits of a motion at all times: in closed form, or by control points for quintics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.double_integrator import slowest_minimum_time
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.constraints.guarantee import Guarantee
from zmp_sqp.planning.proof.polynomial_extremes import joint_extremes
from zmp_sqp.planning.proof.subdivision import Mask

__all__ = [
    "LIMIT_TOLERANCE",
    "LimitPeak",
    "joints_least_duration",
    "limit_excess",
    "limit_guarantee",
    "limit_peaks",
]

# excess over a limit that counts as rounding, as a share of the limit if that is below one
LIMIT_TOLERANCE = 1e-9
KINDS = ("upper position", "lower position", "velocity", "acceleration")
UNITS = ("", "", "/s", "/s^2")  # what follows the unit of the joint


@dataclass(frozen=True, slots=True)
class LimitPeak:
    """Largest value of one quantity of one joint, beside its limit.

    Attributes:
        joint: Name of the joint.
        limit: "upper position", "lower position", "velocity" or "acceleration".
        unit: Unit of the numbers, such as "rad/s".
        allowed: The limit; NaN if none is given, infinite if there is none.
        value: Largest coordinate, for the lower position the least; or largest |rate| or
            |acceleration|, at any time.
        time: When it has this value [s].
        excess: Value beyond the limit; negative or zero where the limit is kept, -inf without a
            limit.
        allowance: Excess that counts as rounding.
        kept: Whether the limit is kept but for rounding.
    """

    joint: str
    limit: str
    unit: str
    allowed: float
    value: float
    time: float
    excess: float
    allowance: float
    kept: bool


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


def limit_guarantee(
    machine: Machine, trajectory: Trajectory, allowance: Array | None = None
) -> tuple[Guarantee, float]:
    """Least room that a motion leaves to a joint limit, at all times, and the largest excess.

    An excess that counts as rounding (`LIMIT_TOLERANCE`, or the allowance) makes a guarantee of
    zero.

    Args:
        machine: Gives the limits.
        trajectory: The motion.
        allowance: Excess over upper and lower position, rate and acceleration that counts as
            rounding of given samples, shape (4, n); None counts none.
    """
    with np.errstate(all="ignore"):
        excess, relative, times = _excesses(machine, trajectory)
    within = _within(excess, relative, allowance)
    worst = np.argmax(relative if within.all() else np.where(within, -np.inf, relative))
    kind, joint = np.unravel_index(int(worst), relative.shape)
    room, kept = -float(excess[kind, joint]), bool(within[kind, joint])
    unit = machine.joint_units[joint] + UNITS[kind]
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


def limit_peaks(
    machine: Machine, trajectory: Trajectory, allowance: Array | None = None
) -> tuple[LimitPeak, ...]:
    """Largest values of a motion beside every joint limit, joint by joint in the order of `KINDS`.

    Args:
        machine, trajectory, allowance: Arguments of `limit_guarantee`.
    """
    limits = machine.limits
    bounds = np.stack(
        [limits.position_upper, limits.position_lower, limits.velocity, limits.acceleration]
    )
    with np.errstate(all="ignore"):
        values, times = _peaks(trajectory)
        excess, relative, _ = _excesses(machine, trajectory)
    values = values * np.array([1.0, -1.0, 1.0, 1.0])[:, None]
    allowed, units = _allowed(machine, allowance), machine.joint_units
    within = _within(excess, relative, allowance)
    return tuple(
        LimitPeak(
            name,
            kind,
            units[i] + UNITS[row],
            allowed=float(bounds[row, i]),
            value=float(values[row, i]),
            time=float(times[row, i]),
            excess=float(excess[row, i]),
            allowance=float(allowed[row, i]),
            kept=bool(within[row, i]),
        )
        for i, name in enumerate(machine.joint_names)
        for row, kind in enumerate(KINDS)
    )


def _within(excess: Array, relative: Array, allowance: Array | None) -> Mask:
    """Which limits are kept but for rounding, shape (4, n)."""
    within = relative <= LIMIT_TOLERANCE
    return within if allowance is None else within | (excess <= allowance)


def _allowed(machine: Machine, allowance: Array | None) -> Array:
    """Excess over each limit that counts as rounding, shape (4, n)."""
    limits = machine.limits
    own = np.full((4, machine.size), LIMIT_TOLERANCE)
    for row, bound in ((2, limits.velocity), (3, limits.acceleration)):
        own[row] *= np.where(bound < 1.0, bound, 1.0)
    return own if allowance is None else np.maximum(own, allowance)


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


def _excesses(machine: Machine, trajectory: Trajectory) -> tuple[Array, Array, Array]:
    """Largest excess over each limit, relative excess, and time, shape (4, n), ordered by KINDS."""
    limits = machine.limits
    bounds = np.stack(
        [limits.position_upper, -limits.position_lower, limits.velocity, limits.acceleration]
    )
    peaks, times = _peaks(trajectory)
    excess = peaks - bounds
    excess[np.isnan(excess)] = np.inf
    unlimited = np.isnan(bounds) | (bounds == np.inf)
    excess = np.where(unlimited, -np.inf, excess)
    unit = np.ones_like(bounds)
    unit[2:] = np.where(bounds[2:] < 1.0, bounds[2:], 1.0)
    return excess, np.where(unlimited, -np.inf, excess / unit), times


def _peaks(trajectory: Trajectory) -> tuple[Array, Array]:
    """Largest q, -q, |v| and |a| of every joint and their times, shape (4, n), as in KINDS."""
    if trajectory.snaps is not None:
        return joint_extremes(trajectory)
    extremes = _Extremes.of(trajectory)
    values = (
        extremes.positions,
        -extremes.positions,
        np.abs(extremes.rates),
        np.abs(extremes.accelerations),
    )
    every = np.stack(values)  # (4, M, n)
    every[np.isnan(every)] = np.inf
    at = every.argmax(axis=1)
    peaks = np.take_along_axis(every, at[:, None], axis=1)[:, 0]
    return peaks, np.take_along_axis(extremes.times, at, axis=0)


def _at(trajectory: Trajectory, t: Array) -> tuple[Array, Array, Array]:
    """Positions, rates, accelerations at times t (M, N, n) after the starts of the intervals."""
    q, v = trajectory.positions[:-1], trajectory.velocities[:-1]
    a, j = trajectory.accelerations, trajectory.jerks
    position = q + t * v + 0.5 * t**2 * a + t**3 * j / 6.0
    return position, v + t * a + 0.5 * t**2 * j, a + t * j
