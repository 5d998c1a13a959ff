"""Canvas of figures, colours, and times at which motions are sampled.

matplotlib is an optional package, so it is imported only when a figure is made.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import MissingExtra
from zmp_sqp.planning import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "ALARM",
    "COLOURS",
    "LINE_STYLES",
    "PLANNER_COLOURS",
    "colour_of",
    "new_figure",
    "planner_colours",
    "sample_times",
    "save",
    "style_of",
]

# Okabe & Ito 2008: distinguishable with any colour vision; black is for limits and text
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#666666")
LINE_STYLES = ("-", ":", "-.")  # in turn once the colours are used up
# by planner: green, red and blue as in Song & Sharf 2020, in the shades of Okabe & Ito
PLANNER_COLOURS = {"phase plane": COLOURS[2], "full model": COLOURS[1], "simplified": COLOURS[0]}
OTHER_COLOURS = COLOURS[3:]
ALARM = "#c1121f"  # of what is violated; drawn thicker as well
RESOLUTION = 100  # [dots per inch]


def new_figure(*, width: float, height: float) -> Figure:
    """Empty figure of the given size in inches; it needs no display and no state of pyplot.

    Raises:
        MissingExtra: matplotlib is not installed.
    """
    try:
        import matplotlib.figure  # noqa: F401 - says whether matplotlib is there

        from zmp_sqp.plots.vector_figure import VectorFigure
    except ModuleNotFoundError as missing:
        if missing.name is None or missing.name.partition(".")[0] != "matplotlib":
            raise
        raise MissingExtra(
            "figures need matplotlib: `pip install zmp-sqp[plots]`, or `pip install matplotlib`"
        ) from None
    return VectorFigure(figsize=(width, height), layout="constrained")


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure to a file; the ending of the path chooses the format.

    Args:
        figure: The figure.
        path: Its ending is .svg or .pdf for vectors, with text as text, or .png.
    """
    figure.savefig(path, dpi=RESOLUTION)


def colour_of(number: int) -> str:
    """Colour of a curve among several, by its number from 0."""
    return COLOURS[number % len(COLOURS)]


def style_of(number: int) -> str:
    """Line style of a curve among several, by its number from 0."""
    return LINE_STYLES[number // len(COLOURS) % len(LINE_STYLES)]


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
