"""Polynomials of a motion as balls, re-centred at any time of an interval."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import factorial
from typing import Any

from zmp_sqp.motion.trajectory import Trajectory

__all__ = ["MotionSeries", "Stretch"]


@dataclass(frozen=True, slots=True)
class Stretch:
    """Part of one interval, from the share `start` to the share `end` of its duration.

    Shares are multiples of a power of two, so that neighbours meet exactly.
    """

    interval: int
    start: float
    end: float

    def halves(self) -> tuple[Stretch, Stretch]:
        """Both halves."""
        middle = 0.5 * (self.start + self.end)
        return Stretch(self.interval, self.start, middle), Stretch(self.interval, middle, self.end)


class MotionSeries:
    """Exact polynomials of joints and base in every interval.

    Attributes:
        joints: `arb_poly` by interval and joint, in the time since the start of the interval.
        speed, yaw: `arb_poly` by interval of a base that drives; empty if it stands.
        steps: Durations of the intervals, balls [s].
    """

    __slots__ = ("_flint", "joints", "speed", "steps", "times", "yaw")

    def __init__(self, flint: Any, trajectory: Trajectory) -> None:
        """Read the coefficients of all intervals, exactly."""
        self._flint = flint
        arb, poly = flint.arb, flint.arb_poly
        rows = [
            trajectory.positions,
            trajectory.velocities,
            trajectory.accelerations,
            trajectory.jerks,
        ]
        if trajectory.snaps is not None:
            rows += [trajectory.snaps, trajectory.crackles]
        self.times = trajectory.times
        exact_times = [arb(t) for t in trajectory.times.tolist()]
        self.steps = [b - a for a, b in pairwise(exact_times)]
        self.joints = [
            [
                poly([arb(float(row[k, i])) / factorial(m) for m, row in enumerate(rows)])
                for i in range(len(trajectory.joint_names))
            ]
            for k in range(trajectory.intervals)
        ]
        self.speed: list[Any] = []
        self.yaw: list[Any] = []
        base = trajectory.base
        if base is not None:
            for k in range(trajectory.intervals):
                s, w = (arb(float(x)) for x in base.velocities[k])
                a, b = (arb(float(x)) for x in base.accelerations[k])
                j, u = (arb(float(x)) for x in base.jerks[k])
                self.speed.append(poly([s, a, j / 2]))
                self.yaw.append(poly([arb(float(base.poses[k, 2])), w, b / 2, u / 6]))

    def centre(self, stretch: Stretch) -> tuple[Any, Any]:
        """Middle and half the duration of a stretch, since the start of its interval [s]."""
        h = self.steps[stretch.interval]
        return (
            h * (stretch.start + stretch.end) / 2,
            h * (stretch.end - stretch.start) / 2,
        )

    def at(self, polynomial: Any, point: Any, length: int) -> Any:
        """Taylor series of a polynomial about a ball of times."""
        flint = self._flint
        return flint.arb_series(
            polynomial(flint.arb_poly([point, 1])).coeffs() or [flint.arb(0)], length
        )

    def time(self, stretch: Stretch, share: float) -> float:
        """Time at a share of a stretch [s], to a float's digits."""
        k = stretch.interval
        inside = stretch.start + share * (stretch.end - stretch.start)
        return float(self.times[k] + inside * (self.times[k + 1] - self.times[k]))
