"""Rows and columns of a chart."""

from __future__ import annotations

from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, frozen_array
from zmp_sqp.errors import ProblemError

__all__ = ["axis_values", "steps"]

MOST_STEPS = 12  # rows or columns that a chart has unless they are given
MOST_VALUES = 200  # rows or columns that may be given
ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)  # digits of round steps


def steps(lowest: float, highest: float, *, positive: bool) -> Array:
    """Multiples of a round step that cover an interval with at most about `MOST_STEPS` of them.

    Args:
        lowest: Lower end [m].
        highest: Upper end [m].
        positive: Whether only positive values are wanted.
    """
    least = max((highest - (0.0 if positive else lowest)) / MOST_STEPS, 1e-3)
    power = 10.0 ** np.floor(np.log10(least))
    step = next(digit * power for digit in ROUND if digit * power >= least * (1.0 - 1e-9))
    first, last = np.floor(lowest / step), np.ceil(highest / step)
    numbers = np.arange(max(first, 1.0) if positive else first, last + 1.0)
    return np.asarray(np.round(step * numbers, 9))


def axis_values(given: Any, name: str, *, positive: bool = False) -> Array:
    """Radii or heights that a user gives, increasing, shape (K,) [m].

    Raises:
        ProblemError: No number, more than `MOST_VALUES`, not increasing, or not positive.
    """
    values = frozen_array(given, name=name, shape=(None,), error=ProblemError)
    if not 1 <= len(values) <= MOST_VALUES:
        raise ProblemError(f"{name} must be 1 to {MOST_VALUES} numbers, not {len(values)}")
    if (fault := np.flatnonzero(np.diff(values) <= 0.0)).size:
        at = int(fault[0])
        raise ProblemError(
            f"{name} must increase, but {values[at + 1]:g} m follows {values[at]:g} m"
        )
    if positive and values[0] <= 0.0:
        raise ProblemError(f"{name} must be positive, not {values[0]:g} m")
    return values
