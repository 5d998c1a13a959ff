"""Path of a base that drives in a plane: the integral of its speed along its heading, in balls."""

from __future__ import annotations

from math import ceil
from typing import Any

from zmp_sqp.rigorous.balls import above
from zmp_sqp.rigorous.motion_series import MotionSeries

__all__ = ["PATH_ORDER", "displacement", "velocity_series"]

PATH_ORDER = 16  # number of Taylor coefficients of a base's velocity; even
LARGEST_TURN = 0.5  # [rad] of one part of an interval
MOST_PARTS = 1000  # of an interval


def velocity_series(motion: MotionSeries, k: int, point: Any, length: int) -> tuple[Any, Any]:
    """Series of the rates of x and y about a ball of times in interval k [m/s]."""
    sin, cos = motion.at(motion.yaw[k], point, length).sin_cos()
    speed = motion.at(motion.speed[k], point, length)
    return speed * cos, speed * sin


def displacement(flint: Any, motion: MotionSeries, k: int, share: float) -> tuple[Any, Any]:
    """Displacement of a base from the start of interval k to a share of its duration, balls [m].

    The time is divided into parts in which the base turns by less than about `LARGEST_TURN`.
    """
    end = motion.steps[k] * share
    ball = end / 2 + end / 2 * flint.arb(0, 1)
    turn = above(abs(motion.yaw[k].derivative()(ball)) * end)
    parts = ceil(min(max(turn / LARGEST_TURN, 1.0), MOST_PARTS))
    radius, totals = end / (2 * parts), [flint.arb(0), flint.arb(0)]
    for part in range(parts):
        middle = end * (2 * part + 1) / (2 * parts)
        inside = middle + radius * flint.arb(0, 1)
        thin = velocity_series(motion, k, middle, PATH_ORDER)
        thick = velocity_series(motion, k, inside, PATH_ORDER + 1)
        for axis in (0, 1):
            for m in range(0, PATH_ORDER, 2):  # odd powers integrate to zero
                totals[axis] += thin[axis][m] * radius ** (m + 1) * 2 / (m + 1)
            rest = thick[axis][PATH_ORDER] * radius ** (PATH_ORDER + 1) * 2
            totals[axis] += rest / (PATH_ORDER + 1)
    return totals[0], totals[1]
