"""Check that a base keeps its limits at all times, and starts and ends where required."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.motion.root_motion import root_motion_bounds
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning.constraints.guarantee import Guarantee
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase
from zmp_sqp.planning.proof.position_errors import path_error
from zmp_sqp.planning.proof.subdivision import LeastValue, StretchValues, Wanted, subdivide

__all__ = ["ARRIVAL", "BOUNDS_TOLERANCE", "base_guarantees", "bounds_guarantee", "position_room"]

ARRIVAL = 1e-5  # [m or rad] largest distance from start or goal that counts as arrived
# [m/s or rad/s, relative above one] largest difference from the rates at start or goal
RATE_ARRIVAL = 1e-6
LIMIT_TOLERANCE = 1e-9  # [m/s, rad/s, per second] excess over a limit that counts as rounding
BOUNDS_TOLERANCE = 1e-6  # [m] excess over x and y bounds that counts as rounding
RESOLUTION = 1e-7  # [m] to which an excess over x and y bounds is found
ROUNDING = 1e-9  # [m] rounding error of positions, with a large factor to spare
NAMES = ("max_speed", "max_yaw_rate", "max_acceleration", "max_yaw_acceleration")
UNITS = ("m/s", "rad/s", "m/s^2", "rad/s^2")


def base_guarantees(base: UnicycleBase, motion: UnicycleMotion) -> tuple[Guarantee, ...]:
    """Room that a motion leaves to a base's limits, x and y bounds, start and goal.

    Tolerances: 1e-5 m and rad for the poses at start and goal, 1e-6 (relative above one) for speed
    and yaw rate there, 1e-6 m for the bounds on x and y, and 1e-9 for the limits of speed, yaw
    rate and accelerations. A guarantee within its tolerance has a value of at least zero.
    """
    found = [_rate_guarantee(base, motion), *_boundary_guarantees(base, motion)]
    within = bounds_guarantee(base, motion)
    return (*found, within) if within is not None else tuple(found)


def bounds_guarantee(base: UnicycleBase, motion: UnicycleMotion) -> Guarantee | None:
    """Least room to the base's bounds on x and y at any time; None if it has none."""
    least = position_room(base, motion)
    if least is None:
        return None
    room = least.guaranteed
    return Guarantee(
        name="base",
        label=f"{'xy'[least.row % 2]}_bounds",
        value=max(room, 0.0) if room >= -BOUNDS_TOLERANCE else room,
        unit="m",
        time=least.time,
        corner="",
        proven=True,
    )


def position_room(base: UnicycleBase, motion: UnicycleMotion) -> LeastValue | None:
    r"""Least distance from the base's path to its x and y bounds; None if there are none.

    Between two times that lie :math:`\delta` apart, a position p is nearer to a bound than at
    both of them by at most

    .. math:: \frac{\delta^2}{8} \max |\ddot p| + e

    with the error e of the computed path (`path_error`). Rows of the result: x and y below their
    upper bounds, then above their lower bounds.
    """
    lower, upper = base.position_bounds
    if not (np.isfinite(lower).any() or np.isfinite(upper).any()):
        return None
    every, steps = np.arange(len(motion.jerks)), np.diff(motion.times)
    with np.errstate(all="ignore"):  # bounds that overflow are infinite
        bend = root_motion_bounds(motion, every, 0.0 * steps, steps, height=0.0)[0, 1]
        error = np.nan_to_num(path_error(motion), nan=np.inf) + ROUNDING

    def evaluate(interval: Indices, share: Array, length: Array) -> list[StretchValues]:
        """Room to the bounds on K stretches."""
        h = steps[interval]
        since = np.stack([share, share + length]) * h
        ends = np.stack([motion.state_in(interval, at)[0][:, :2] for at in since])
        room = np.concatenate([upper - ends, ends - lower], axis=2)  # (2, K, 4)
        room = room - error[interval, None]
        flat = room.min(axis=2).argmin(axis=0)
        nearest = room[flat, np.arange(len(interval))]
        least = room.min(axis=(0, 2))
        with np.errstate(all="ignore"):
            sag = np.nan_to_num(0.125 * (length * h) ** 2 * bend[interval], nan=np.inf)
        when = motion.times[interval] + since[flat, np.arange(len(interval))]
        return [StretchValues(least, when, nearest.argmin(axis=1), least - sag, least)]

    wanted = Wanted(required=0.0, resolution=RESOLUTION, tight_if_kept=False)
    return subdivide(np.ones(len(steps), dtype=int), evaluate, [wanted])[0]


def _rate_guarantee(base: UnicycleBase, motion: UnicycleMotion) -> Guarantee:
    """Least room to the limits of speed, yaw rate and accelerations at any time, in closed form."""
    v, a, j, h = (
        motion.velocities,
        motion.accelerations,
        motion.jerks,
        np.diff(motion.times)[:, None],
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = -a / j
    turn = np.where((turn > 0.0) & (turn < h), turn, 0.0)
    starts = motion.times[:-1, None]
    rates = np.vstack([v, v[:-1] + turn * a + 0.5 * turn**2 * j])
    accelerations = np.vstack([a, a + h * j])
    times = (
        np.vstack([np.broadcast_to(motion.times[:, None], v.shape), starts + turn]),
        np.vstack([np.broadcast_to(starts, a.shape), np.broadcast_to(starts + h, a.shape)]),
    )
    limits = base.limits
    room = np.concatenate(
        [
            (limit - np.abs(part)).min(axis=0)
            for part, limit in (
                (rates, limits.velocity),
                (accelerations, limits.acceleration),
            )
        ]
    )
    when = np.concatenate(
        [
            np.take_along_axis(at, np.abs(part).argmax(axis=0)[None], axis=0)[0]
            for part, at in zip((rates, accelerations), times, strict=True)
        ]
    )
    worst = int(np.argmin(room))
    least = float(room[worst])
    return Guarantee(
        name="base",
        label=NAMES[worst],
        value=max(least, 0.0) if least >= -LIMIT_TOLERANCE else least,
        unit=UNITS[worst],
        time=float(when[worst]),
        corner="",
        proven=True,
    )


def _boundary_guarantees(base: UnicycleBase, motion: UnicycleMotion) -> list[Guarantee]:
    """Room to the tolerances of position, yaw and rates at start and goal."""
    found = []
    for side, k in (("start", 0), ("goal", -1)):
        off = np.abs(motion.poses[k] - getattr(base, side))
        required = getattr(base, f"{side}_velocity")
        off_rates = np.abs(motion.velocities[k] - required)
        position, yaw = float(np.hypot(*off[:2])), float(off[2])
        speed = float((off_rates - RATE_ARRIVAL * np.abs(required)).max())
        rows = (
            # within the tolerance along each axis
            ("position", ARRIVAL - position, "m", bool(off[:2].max() <= ARRIVAL)),
            ("yaw", ARRIVAL - yaw, "rad", yaw <= ARRIVAL),
            ("rates", RATE_ARRIVAL - speed, "m/s or rad/s", speed <= RATE_ARRIVAL),
        )
        time = float(motion.times[k])
        for kind, room, unit, met in rows:
            value = max(room, 0.0) if met else min(room, -np.finfo(float).tiny)
            found.append(Guarantee("base", f"{side} {kind}", value, unit, time, "", proven=True))
    return found
