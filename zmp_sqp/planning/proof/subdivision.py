"""Adaptive subdivision of time: guaranteed least values from bounds on stretches of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array, Indices

Mask = npt.NDArray[np.bool_]

__all__ = ["LeastValue", "StretchValues", "Wanted", "subdivide"]

MOST_PARTS = 16  # largest number of parts into which a stretch is cut at once
MOST_STRETCHES = 200_000  # stretches evaluated before subdivision ends, which limits time
# a bound is expected to tighten with the square of the length; this factor is in reserve, because
# one round more costs as much as thirty stretches
HEADROOM = 4.0
# rounding error of values: certificates take it off, and stretches whose bound is as close as this
# to what shorter ones could give are not cut
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Wanted:
    """How tight the guaranteed least value of a constraint has to be.

    Attributes:
        required: Required value. A negative one counts only where zero cannot be proven.
        resolution: Largest difference between the sampled and the guaranteed least value.
        tight_if_kept: Whether the resolution counts even if the required value is proven.
    """

    required: float
    resolution: float
    tight_if_kept: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class StretchValues:
    """Values of one constraint on K stretches, shape (K,) each.

    Attributes:
        least: Least value at the two ends.
        time: Time of the least value [s].
        row: Row of the constraint that has the least value.
        bound: Guaranteed least value inside.
        reachable: Limit of `bound` as the stretch gets shorter.
    """

    least: Array
    time: Array
    row: Indices
    bound: Array
    reachable: Array

    @classmethod
    def without_limit(cls, count: int) -> StretchValues:
        """Infinite values of stretches on which a constraint does not count, to be set by `put`."""
        infinite = np.full((4, count), np.inf)
        rows = np.zeros(count, dtype=int)
        return cls(infinite[0], np.zeros(count), rows, infinite[2], infinite[3])

    def put(self, chosen: Mask, part: StretchValues) -> None:
        """Set the values of some stretches, given by a mask."""
        for name in ("least", "time", "row", "bound", "reachable"):
            getattr(self, name)[chosen] = getattr(part, name)


@dataclass(slots=True)
class LeastValue:
    """Least value of one constraint over a whole motion.

    Attributes:
        guaranteed: Value that the constraint has at least, at all times.
        sampled: Least value at an end of a stretch.
        time: Time of the sampled value [s].
        row: Row of the constraint that has the sampled value.
        interval: Index of the interval of `subdivide` that has the sampled value.
        exhausted: Whether subdivision ended early because of too many stretches.
    """

    guaranteed: float = np.inf
    sampled: float = np.inf
    time: float = 0.0
    row: int = 0
    interval: int = 0
    exhausted: bool = False
    _best: float = np.inf

    def take(self, interval: Indices, found: StretchValues, wanted: Wanted) -> tuple[Mask, Indices]:
        """Update by the values of K stretches, and choose the stretches to cut.

        Returns:
            Whether the bound of each stretch is too loose, and the number of parts to cut it into,
            shape (K,) each.
        """
        worst = int(np.argmin(found.least))
        if found.least[worst] < self.sampled:
            self.sampled = float(found.least[worst])
            self.time, self.row = float(found.time[worst]), int(found.row[worst])
            self.interval = int(interval[worst])
        self._best = min(self._best, float(found.reachable.min()))
        bound, reachable = found.bound, found.reachable
        # certificates take ROUNDING off the guaranteed value
        asked = max(wanted.required, 0.0) + ROUNDING
        # a negative required value counts only where zero cannot be proven
        target = np.where(reachable >= asked, asked, wanted.required + ROUNDING)
        undecided = (bound < target) & (reachable >= target)
        tight = wanted.tight_if_kept or self._best < asked
        floor = self._best - wanted.resolution if tight else -np.inf
        loose = (undecided | (bound < floor)) & (bound < reachable - ROUNDING)
        if not np.isfinite(self.sampled):
            loose[:] = False
        enough = np.where(undecided, np.maximum(target, floor), floor)
        with np.errstate(all="ignore"):
            parts = np.ceil(np.sqrt(HEADROOM * (reachable - bound) / (reachable - enough)))
        return loose, np.clip(np.nan_to_num(parts, nan=MOST_PARTS), 2, MOST_PARTS).astype(int)

    def keep(self, bounds: Array) -> None:
        """Update by the bounds of stretches that are not cut any further; NaN bounds nothing."""
        least = float(bounds.min(initial=np.inf))
        self.guaranteed = -np.inf if np.isnan(least) else min(self.guaranteed, least)


def subdivide(
    parts: Indices,
    evaluate: Callable[[Indices, Array, Array], Sequence[StretchValues]],
    wanted: Sequence[Wanted],
) -> list[LeastValue]:
    """Least values of several constraints over N intervals.

    Stretches whose bounds are too loose are cut into parts until all are tight enough.

    Args:
        parts: Number of stretches that each interval is cut into at first, shape (N,).
        evaluate: Function of K stretches that returns the values of each constraint. Its arguments,
            shape (K,) each, are the interval of each stretch, its start, and its length, the
            latter two as shares of the interval.
        wanted: Tightness of each constraint's least value.

    Returns:
        Least value of each constraint.
    """
    least = [LeastValue() for _ in wanted]
    interval = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(interval)) - np.repeat(np.cumsum(parts) - parts, parts)
    share = number / parts[interval]
    length = (1.0 / parts)[interval]
    evaluated = 0
    while len(interval):
        found = evaluate(interval, share, length)
        evaluated += len(interval)
        loose, cuts = np.zeros(len(interval), dtype=bool), np.zeros(len(interval), dtype=int)
        for value, values, want in zip(least, found, wanted, strict=True):
            more, count = value.take(interval, values, want)
            loose |= more
            cuts = np.maximum(cuts, np.where(more, count, 0))
        if evaluated + int(cuts[loose].sum()) > MOST_STRETCHES:
            loose[:] = False
            for value in least:
                value.exhausted = True
        for value, values in zip(least, found, strict=True):
            value.keep(values.bound[~loose])
        cuts = cuts[loose]
        interval = np.repeat(interval[loose], cuts)
        length = np.repeat(length[loose] / cuts, cuts)
        number = np.arange(len(length)) - np.repeat(np.cumsum(cuts) - cuts, cuts)
        share = np.repeat(share[loose], cuts) + length * number
    return least
