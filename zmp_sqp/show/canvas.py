"""Canvas of figures, colours of planners, and times at which motions are sampled.

matplotlib is an optional package, so it is imported only when a figure is made.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.planning import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["PLANNER_COLOURS", "new_figure", "planner_colours", "sample_times", "save"]

# colours of the figures of Song & Sharf 2020, by planner
PLANNER_COLOURS = {"phase plane": "tab:green", "full model": "tab:red", "simplified": "tab:blue"}
OTHER_COLOURS = ("tab:purple", "tab:orange", "tab:brown", "tab:pink", "tab:olive", "tab:cyan")
RESOLUTION = 100  # [dots per inch]


def new_figure(*, width: float, height: float) -> Figure:
    """Empty figure of the given size in inches; it needs no display and no state of pyplot."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure to a file; the ending of the path chooses the format."""
    figure.savefig(path, dpi=RESOLUTION)


def planner_colours(names: Iterable[str]) -> dict[str, str]:
    """Colours by planner: `PLANNER_COLOURS`, and `OTHER_COLOURS` in turn for other names."""
    others = [name for name in names if name not in PLANNER_COLOURS]
    return PLANNER_COLOURS | {
        name: OTHER_COLOURS[i % len(OTHER_COLOURS)] for i, name in enumerate(others)
    }


def sample_times(trajectory: Trajectory, count: int = 600) -> list[Array]:
    """Times within each interval of a trajectory, its ends included.

    Accelerations jump at nodes. The last time of an interval is one rounding error before its end,
    so that the trajectory has the acceleration of that interval there, not of the next.

    Args:
        trajectory: The trajectory.
        count: Number of times in all, approximately.

    Returns:
        One array of times for each of the N intervals [s].
    """
    per_second = count / trajectory.duration if trajectory.duration > 0.0 else 0.0
    pieces = []
    for begin, end in zip(trajectory.times[:-1], trajectory.times[1:], strict=True):
        times = np.linspace(begin, end, 2 + int(per_second * (end - begin)))
        pieces.append(np.minimum(times, np.nextafter(end, begin)))
    return pieces
