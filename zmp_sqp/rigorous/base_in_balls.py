"""Limits, bounds, start and goal of a base that drives, in balls."""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np

from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase
from zmp_sqp.rigorous.balls import above, below, least_of
from zmp_sqp.rigorous.decide import Bound
from zmp_sqp.rigorous.limits_in_balls import TOLERANCE, LimitRow
from zmp_sqp.rigorous.motion_series import MotionSeries, Stretch
from zmp_sqp.rigorous.root_series import PlaneRoot
from zmp_sqp.rigorous.terrain_root import TerrainRoot

__all__ = ["BOUNDS_TOLERANCE", "PathBounds", "base_ends", "base_limits"]

# tolerances of the certificate (`base_guarantees`)
BOUNDS_TOLERANCE = 1e-6  # [m] excess over x and y bounds that counts as rounding
ARRIVAL = 1e-5  # [m or rad] distance from start or goal that counts as arrived
RATE_ARRIVAL = 1e-6  # [m/s or rad/s, relative above one] of the rates there


def base_limits(base: UnicycleBase) -> list[LimitRow]:
    """Rows of the limits of a base: sources are its speed (0) and yaw (1)."""
    rows = []
    for source, order, bound, label, unit in (
        (0, 0, base.max_speed, "max_speed", "m/s"),
        (1, 1, base.max_yaw_rate, "max_yaw_rate", "rad/s"),
        (0, 1, base.max_acceleration, "max_acceleration", "m/s^2"),
        (1, 2, base.max_yaw_acceleration, "max_yaw_acceleration", "rad/s^2"),
    ):
        rows += [LimitRow(source, order, s, bound, TOLERANCE, label, unit) for s in (1, -1)]
    return rows


class PathBounds:
    """Bounds on the room of a base's path to its bounds on x and y, as one guarantee."""

    def __init__(
        self, flint: Any, base: UnicycleBase, root: PlaneRoot | TerrainRoot, motion: MotionSeries
    ) -> None:
        """Bounds of a base; it may have none (`rows` is empty then)."""
        self._flint, self._root, self._motion = flint, root, motion
        lower, upper = base.position_bounds
        self.rows = [
            (axis, sign, float(bound))
            for sign, bounds in ((1, upper), (-1, lower))
            for axis, bound in enumerate(bounds)
            if np.isfinite(bound)
        ]
        self.labels = [f"{'xy'[axis]}_bounds" for axis, _, _ in self.rows]

    def __call__(self, stretch: Stretch) -> list[Bound]:
        """Bound of the guarantee on a stretch."""
        flint, motion = self._flint, self._motion
        middle, radius = motion.centre(stretch)
        path = self._root.path_on(stretch, middle, middle + radius * flint.arb(0, 1), radius)
        time = motion.time(stretch, 0.5)
        if path is None:
            return [Bound(-inf, inf, inf, time, 0)]
        rows, rests, values = [], [], []
        for axis, sign, bound in self.rows:
            room = [-sign * x for x in path.rows[axis]]
            room[0] = sign * flint.arb(bound) + room[0]
            rows.append(room)
            rests.append(below(-sign * path.rests[axis] * radius ** len(room)))
            values.append(above(room[0]))
        least = least_of(flint, rows, radius) + np.minimum(rests, 0.0)
        lower = float(np.nextafter(least.min(), -inf))
        at = int(np.argmin(values))
        return [Bound(lower, values[at], values[at], time, at)]


def base_ends(flint: Any, base: UnicycleBase, path: UnicycleMotion) -> list[tuple[str, str, Bound]]:
    """Room to the tolerances of the pose and the rates at start and goal: label, unit and bound."""
    arb, found = flint.arb, []
    for side, k in (("start", 0), ("goal", -1)):
        wanted, rates = getattr(base, side), getattr(base, f"{side}_velocity")
        off = [
            abs(arb(float(x)) - arb(float(y))) for x, y in zip(path.poses[k], wanted, strict=True)
        ]
        off_rates = [
            abs(arb(float(x)) - arb(float(y))) - RATE_ARRIVAL * abs(arb(float(y)))
            for x, y in zip(path.velocities[k], rates, strict=True)
        ]
        for kind, unit, allowed, parts in (
            ("position", "m", ARRIVAL, off[:2]),
            ("yaw", "rad", ARRIVAL, off[2:]),
            ("rates", "m/s or rad/s", RATE_ARRIVAL, off_rates),
        ):
            room = [arb(allowed) - part for part in parts]
            lower, upper = min(map(below, room)), min(map(above, room))
            bound = Bound(lower, upper, upper, float(path.times[k]), 0)
            found.append((f"{side} {kind}", unit, bound))
    return found
