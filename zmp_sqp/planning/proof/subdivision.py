"""Adaptive subdivision of time: guaranteed least values from values at the ends of stretches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array, Indices

Mask = npt.NDArray[np.bool_]

__all__ = ["LeastValue", "StretchValues", "Wanted", "subdivide"]

MOST_PARTS = 16  # into which a stretch is cut whose bound is too loose
MAX_STATES = 200_000  # stretches looked at before bounds are left as loose as they are
# more parts than a bound that falls with the square of the length asks for, by this factor
HEADROOM = 1.2
ROUNDING = 1e-9  # difference of values below which shorter stretches cannot help


@dataclass(frozen=True, slots=True)
class Wanted:
    """How well the least of some values has to be known.

    Attributes:
        required: Value that is asked for. A negative one is asked for only where zero is out of
            reach.
        resolution: How far the guaranteed least value may fall short of the sampled one.
        tight_if_kept: Whether that holds even where the required value is proven already.
    """

    required: float
    resolution: float
    tight_if_kept: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class StretchValues:
    """Values of one constraint on K stretches, shape (K,) each.

    Attributes:
        least: Least value at the two ends.
        time: When, [s].
        row: Which row of the constraint.
        bound: Least value guaranteed inside.
        reachable: What `bound` tends to as stretches get shorter.
    """

    least: Array
    time: Array
    row: Indices
    bound: Array
    reachable: Array

    @classmethod
    def without_limit(cls, count: int) -> StretchValues:
        """Values of stretches on which a constraint asks for nothing, to be filled by `put`."""
        infinite = np.full((4, count), np.inf)
        rows = np.zeros(count, dtype=int)
        return cls(infinite[0], np.zeros(count), rows, infinite[2], infinite[3])

    def put(self, chosen: Mask, part: StretchValues) -> None:
        """Fill in the values of some stretches, given by a mask."""
        for name in ("least", "time", "row", "bound", "reachable"):
            getattr(self, name)[chosen] = getattr(part, name)


@dataclass(slots=True)
class LeastValue:
    """Least value of one constraint over a whole motion.

    Attributes:
        guaranteed: Holds at all times.
        sampled: Least value that was found.
        time: When it was found [s].
        row: Which row of the constraint it was.
        interval: In which of the intervals that `subdivide` was given.
        exhausted: Whether subdivision ended because it would have taken too many stretches.
    """

    guaranteed: float = np.inf
    sampled: float = np.inf
    time: float = 0.0
    row: int = 0
    interval: int = 0
    exhausted: bool = False
    _best: float = np.inf

    def take(self, interval: Indices, found: StretchValues, wanted: Wanted) -> tuple[Mask, Indices]:
        """Take the values in; which stretches are still too loose, and into how many parts to cut.

        Returns:
            Shapes (K,) each.
        """
        worst = int(np.argmin(found.least))
        if found.least[worst] < self.sampled:
            self.sampled = float(found.least[worst])
            self.time, self.row = float(found.time[worst]), int(found.row[worst])
            self.interval = int(interval[worst])
        self._best = min(self._best, float(found.reachable.min()))
        bound, reachable = found.bound, found.reachable
        asked = max(wanted.required, 0.0)
        # a negative value is asked for only where zero is out of reach
        target = np.where(reachable >= asked, asked, wanted.required)
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
        """Take in the bounds of stretches that are not cut any further."""
        self.guaranteed = min(self.guaranteed, float(bounds.min(initial=np.inf)))


def subdivide(
    parts: Indices,
    evaluate: Callable[[Indices, Array, Array], Sequence[StretchValues]],
    wanted: Sequence[Wanted],
) -> list[LeastValue]:
    """Least values of several constraints over all intervals, by cutting what is too loose.

    Args:
        parts: Into how many stretches each interval is cut at first, shape (N,).
        evaluate: From stretches, given by their interval, where they start and how long they are
            (shares of the interval, shape (K,) each), to the values of each constraint.
        wanted: How well each constraint's least value has to be known.

    Returns:
        One least value per constraint.
    """
    least = [LeastValue() for _ in wanted]
    interval = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(interval)) - np.repeat(np.cumsum(parts) - parts, parts)
    share = number / parts[interval]
    length = (1.0 / parts)[interval]
    states = 0
    while len(interval):
        found = evaluate(interval, share, length)
        states += len(interval)
        loose, cuts = np.zeros(len(interval), dtype=bool), np.zeros(len(interval), dtype=int)
        for value, values, want in zip(least, found, wanted, strict=True):
            more, count = value.take(interval, values, want)
            loose |= more
            cuts = np.maximum(cuts, np.where(more, count, 0))
        if states + int(cuts[loose].sum()) > MAX_STATES:
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
