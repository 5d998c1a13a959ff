"""Limits of joints and base, which are polynomials of time, and continuity at the nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.rigorous.balls import above, below, bernstein
from zmp_sqp.rigorous.decide import Asked, Bound
from zmp_sqp.rigorous.motion_series import MotionSeries, Stretch
from zmp_sqp.rigorous.root_series import PlaneRoot
from zmp_sqp.rigorous.terrain_root import TerrainRoot

__all__ = [
    "CONTINUITY",
    "TOLERANCE",
    "LimitRow",
    "PolynomialLimits",
    "joint_limits",
    "largest_jumps",
    "with_allowance",
]

# excess over a limit that counts as rounding, as a share of the limit if that is below one; that of
# the certificate
TOLERANCE = 1e-9
# [rad or m, and per second] largest jump at a node, as `Trajectory` accepts it
CONTINUITY = 1e-6


@dataclass(frozen=True, slots=True)
class LimitRow:
    """One limit: room is bound - sign * x for the derivative `order` of a polynomial.

    Attributes:
        source: Index of the polynomial.
        order: 0 is the polynomial itself.
        sign: 1 for an upper limit, -1 for a lower one, whose bound is its negative.
        bound: The limit.
        tolerance: Excess that counts as rounding.
        label: Joint and quantity in words.
        unit: Unit.
    """

    source: int
    order: int
    sign: int
    bound: float
    tolerance: float
    label: str
    unit: str


class PolynomialLimits:
    """Bounds on the room to limits of polynomials; one guarantee per row."""

    def __init__(
        self,
        flint: Any,
        motion: MotionSeries,
        sources: Sequence[Sequence[Any]],
        rows: Sequence[LimitRow],
    ) -> None:
        """Limits of polynomials.

        Args:
            flint: Module.
            motion: Gives the durations.
            sources: `arb_poly` by interval and index.
            rows: The limits.
        """
        self._flint, self._motion, self.rows = flint, motion, rows
        self._sources = [list(one) for one in sources]

    @property
    def asked(self) -> list[Asked]:
        """Required room of every row: the tolerance is allowed."""
        return [Asked(-row.tolerance) for row in self.rows]

    def __call__(self, stretch: Stretch) -> list[Bound]:
        """Bounds of all rows on a stretch."""
        flint, found = self._flint, []
        middle, radius = self._motion.centre(stretch)
        shift = flint.arb_poly([middle, radius])
        cache: dict[tuple[int, int], Any] = {}
        times = [self._motion.time(stretch, share) for share in (0.0, 0.5, 1.0)]
        for row in self.rows:
            key = row.source, row.order
            if key not in cache:
                polynomial = self._sources[stretch.interval][row.source]
                for _ in range(row.order):
                    polynomial = polynomial.derivative()
                cache[key] = _control(flint, polynomial(shift))
            points, centre = cache[key]
            room = [flint.arb(row.bound) - row.sign * x for x in (*points, centre)]
            samples = [above(room[0]), above(room[-1]), above(room[-2])]
            at = int(np.argmin(samples))
            lower = min(below(x) for x in room[:-1])
            found.append(Bound(lower, samples[1], samples[at], times[at], 0))
        return found


def _control(flint: Any, polynomial: Any) -> tuple[list[Any], Any]:
    """Control points on [-1, 1] and value at 0 of an `arb_poly`."""
    coefficients = polynomial.coeffs() or [flint.arb(0)]
    column = flint.arb_mat([[x] for x in coefficients])
    control = bernstein(len(coefficients)) * column
    return [control[m, 0] for m in range(len(coefficients))], coefficients[0]


def joint_limits(machine: Machine) -> list[LimitRow]:
    """Rows of the joint limits; limits that are not given or infinite have none."""
    limits, rows = machine.limits, []
    kinds = (
        (0, 1, limits.position_upper, "upper position", ""),
        (0, -1, -limits.position_lower, "lower position", ""),
        (1, 1, limits.velocity, "velocity", "/s"),
        (1, -1, limits.velocity, "velocity", "/s"),
        (2, 1, limits.acceleration, "acceleration", "/s^2"),
        (2, -1, limits.acceleration, "acceleration", "/s^2"),
    )
    units = machine.joint_units
    for order, sign, bounds, kind, per in kinds:
        for i, bound in enumerate(bounds.tolist()):
            if np.isfinite(bound):
                share = TOLERANCE * (min(bound, 1.0) if order else 1.0)
                label = f"{machine.joint_names[i]} {kind}"
                rows.append(LimitRow(i, order, sign, bound, share, label, units[i] + per))
    return rows


def with_allowance(rows: Sequence[LimitRow], allowance: Array | None) -> list[LimitRow]:
    """Rows whose tolerance is at least the allowance of recorded motions, shape (4, n)."""
    if allowance is None:
        return list(rows)
    kinds = {(0, 1): 0, (0, -1): 1, (1, 1): 2, (1, -1): 2, (2, 1): 3, (2, -1): 3}
    found = []
    for row in rows:
        allowed = float(allowance[kinds[row.order, row.sign], row.source])
        tolerance = max(row.tolerance, allowed)
        found.append(
            LimitRow(row.source, row.order, row.sign, row.bound, tolerance, row.label, row.unit)
        )
    return found


def largest_jumps(
    flint: Any, trajectory: Trajectory, motion: MotionSeries, root: PlaneRoot | TerrainRoot
) -> tuple[Bound, list[str]]:
    """Room of the largest jump of positions and rates at a node to `CONTINUITY`, and its labels."""
    labels = [f"{name} {what}" for name in trajectory.joint_names for what in ("position", "rate")]
    labels += ["base x", "base y", "base yaw", "base speed", "base yaw rate"]
    lower, worst, time, row = inf, -inf, 0.0, 0
    for k in range(trajectory.intervals):
        h = motion.steps[k]
        after: list[tuple[Any, float]] = []
        for i, polynomial in enumerate(motion.joints[k]):
            after.append((polynomial(h), float(trajectory.positions[k + 1, i])))
            after.append((polynomial.derivative()(h), float(trajectory.velocities[k + 1, i])))
        if trajectory.base is not None:
            poses, rates = trajectory.base.poses, trajectory.base.velocities
            yaw, speed = motion.yaw[k], motion.speed[k]
            found = (*root.position(k, 1.0), yaw(h), speed(h), yaw.derivative()(h))
            given = [*poses[k + 1].tolist(), *rates[k + 1].tolist()]
            after += list(zip(found, given, strict=True))
        for i, (value, node) in enumerate(after):
            jump = abs(value - flint.arb(node))
            lower = min(lower, below(flint.arb(CONTINUITY) - jump))
            if below(jump) > worst:
                worst, time, row = below(jump), float(trajectory.times[k + 1]), i
    upper = float(np.nextafter(CONTINUITY - worst, inf))
    return Bound(lower, upper, upper, time, row), labels
