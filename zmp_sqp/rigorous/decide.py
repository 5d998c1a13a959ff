"""Adaptive bisection of time until guarantees are decided and their least room is enclosed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from typing import NamedTuple

from zmp_sqp.rigorous.motion_series import Stretch

__all__ = ["Asked", "Bound", "Enclosure", "decide"]

DEEPEST = 2.0**-24  # shortest stretch, as a share of its interval
MOST_PER_INTERVAL = 8  # number of stretches, in the mean, at which bisection ends
MOST_BESIDE = 2000  # and as many in addition


class Bound(NamedTuple):
    """Bounds on the room of one guarantee on a stretch.

    Attributes:
        lower: Lower bound on the room at all its times.
        reachable: What `lower` can rise to, at most, if the stretch is cut further.
        upper: Room at one of its times, rounded up; inf if there is none.
        time: That time [s].
        row, corner: Where the room is `upper`.
    """

    lower: float
    reachable: float
    upper: float
    time: float
    row: int
    corner: int = 0


class Asked(NamedTuple):
    """Required room of a guarantee, and how closely its least room is to be enclosed."""

    required: float
    resolution: float = inf


@dataclass(slots=True)
class Enclosure:
    """Enclosure of the least room of one guarantee over all stretches."""

    lower: float
    upper: float
    time: float
    row: int
    corner: int


def decide(
    stretches: Sequence[Stretch],
    evaluate: Callable[[Stretch], Sequence[Bound]],
    asked: Sequence[Asked],
    progress: Callable[[int], None] | None = None,
) -> tuple[list[Enclosure], int]:
    """Enclosures of the least rooms, and the number of stretches that were evaluated.

    A stretch is halved while a guarantee is neither kept on it nor refuted elsewhere, and where the
    least room may be lower than elsewhere by more than the resolution.

    Args:
        stretches: Stretches that cover all times.
        evaluate: Bounds of every guarantee on a stretch.
        asked: What is asked of every guarantee.
        progress: Called after every stretch with the number of those evaluated.
    """
    most = MOST_PER_INTERVAL * len(stretches) + MOST_BESIDE
    count, waiting = 0, list(stretches)
    leaves: list[tuple[Stretch, Sequence[Bound]]] = []
    best: list[Bound] = [Bound(inf, inf, inf, 0.0, 0)] * len(asked)
    while waiting:
        for number, stretch in enumerate(waiting, count + 1):
            bounds = evaluate(stretch)
            leaves.append((stretch, bounds))
            best = [min(one, other, key=_upper) for one, other in zip(best, bounds, strict=True)]
            if progress is not None:
                progress(number)
        count += len(waiting)
        reachable = [min(part[1][i].reachable for part in leaves) for i in range(len(asked))]
        waiting, kept = [], []
        for stretch, bounds in leaves:
            if (
                stretch.end - stretch.start > DEEPEST
                and count + len(waiting) < most
                and any(
                    _open(bound, what, top.upper, reach)
                    for bound, what, top, reach in zip(bounds, asked, best, reachable, strict=True)
                )
            ):
                waiting += stretch.halves()
            else:
                kept.append((stretch, bounds))
        leaves = kept
    return [
        Enclosure(
            min(part[1][i].lower for part in leaves), one.upper, one.time, one.row, one.corner
        )
        for i, one in enumerate(best)
    ], count


def _upper(bound: Bound) -> float:
    return bound.upper


def _open(bound: Bound, asked: Asked, upper: float, reachable: float) -> bool:
    """Whether cutting a stretch further can help to decide or to enclose."""
    refuted = upper < asked.required
    if not refuted and bound.lower < asked.required <= bound.reachable:
        return True
    return bound.lower < min(upper, reachable) - asked.resolution
