"""Figures of studies: maps over two numbers, and duration against margin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError
from zmp_sqp.plots.canvas import ALARM, COLOURS, new_figure
from zmp_sqp.show.study_tables import REFUSED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["envelope", "tradeoff"]

MAPS = {"duration": "viridis", "margin": "cividis"}  # colours of quantities
TITLES = {"duration": "duration [s]", "margin": "guaranteed margin [m]"}
UNITS = {"deg": "degrees", "mass": "kg", "margin": "m"}
LEVELS = 6


def envelope(rows: Sequence[Mapping[str, Any]], x: str, y: str) -> Figure:
    """Duration and guaranteed margin over two keys of a scenario.

    Coloured cells have a safe motion, hatched ones have no motion that was found, and grey ones are
    impossible at start or goal. The thick line is where motions end.

    Args:
        rows: Results of `zmp-sqp envelope`, as under `rows` of its --json: the values of both keys,
            success, status, duration [s], margin [m].
        x, y: The keys, such as "ground.roll_deg".

    Raises:
        MissingExtra: matplotlib is not installed.
        ProblemError: There are no rows, or they lack a key.
    """
    check_rows(rows, (x, y, "success", "status", "duration", "margin"))
    xs, ys = (np.array(sorted({row[key] for row in rows})) for key in (x, y))
    found = {(row[x], row[y]): row for row in rows}
    figure = new_figure(width=11.0, height=4.6)
    for axes, name in zip(figure.subplots(1, 2), MAPS, strict=True):
        grid = np.full((len(ys), len(xs)), np.nan)
        state = np.zeros(grid.shape)  # 0 not planned, 1 refused, 2 not found, 3 safe
        for i, at_y in enumerate(ys):
            for j, at_x in enumerate(xs):
                row = found.get((at_x, at_y))
                if row is None:
                    continue
                state[i, j] = 3 if row["success"] else 1 if row["status"] == REFUSED else 2
                if row["success"]:
                    grid[i, j] = row[name]
        _map(axes, (xs, ys), grid, state, name)
        axes.set(xlabel=_label(x), ylabel=_label(y), title=TITLES[name])
    return figure


def _map(axes: Axes, at: tuple[Array, Array], grid: Array, state: Array, name: str) -> None:
    """Map of one quantity, with its contour lines and the border of what is possible."""
    xs, ys = at
    axes.set_facecolor("0.85")
    mesh = axes.pcolormesh(xs, ys, grid, cmap=MAPS[name], shading="nearest")
    bar: Any = axes.figure.colorbar(mesh, ax=axes, label=TITLES[name])
    bar.solids.set(rasterized=False, edgecolor="face")  # an image in vector files otherwise
    missing = np.ma.masked_where(state != 2, np.ones_like(state))
    axes.pcolor(xs, ys, missing, hatch="///", alpha=0.0, shading="nearest", edgecolor="0.3")
    safe = (state == 3).astype(float)
    if 0.0 < safe.mean() < 1.0:
        axes.contour(xs, ys, safe, levels=[0.5], colors=ALARM, linewidths=2.0)
    values = grid[np.isfinite(grid)]
    if len(values) and np.ptp(values) > 1e-3 * max(1.0, np.abs(values).max()):
        lines = axes.contour(xs, ys, grid, levels=LEVELS, colors="white", linewidths=0.7)
        axes.clabel(lines, fontsize=7, fmt="%.3g")


def _label(key: str) -> str:
    """Key with its unit, where its name tells it."""
    last = key.partition("[")[0].rpartition(".")[2].rpartition("_")[2]
    return f"{key} [{UNITS[last]}]" if last in UNITS else key


def tradeoff(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Duration over the margin that is asked for.

    Args:
        rows: Results of `zmp-sqp tradeoff`, as under `rows` of its --json: plan.margin [m],
            success, duration [s], lower_bound [s].

    Raises:
        MissingExtra: matplotlib is not installed.
        ProblemError: There are no rows, or they lack a key.
    """
    check_rows(rows, ("plan.margin", "success", "duration", "lower_bound"))
    figure = new_figure(width=6.4, height=4.2)
    axes = figure.subplots()
    safe = [row for row in rows if row["success"]]
    margins = [row["plan.margin"] for row in safe]
    axes.plot(margins, [row["duration"] for row in safe], "o-", color=COLOURS[1], label="planned")
    if safe:
        axes.axhline(
            safe[0]["lower_bound"], color="0.4", linestyle="--", label="least within joint limits"
        )
    failed = [row["plan.margin"] for row in rows if not row["success"]]
    for number, margin in enumerate(failed):
        label = "no motion found" if number == 0 else None
        axes.axvline(margin, color="0.8", linewidth=4.0, zorder=0, label=label)
    axes.set(xlabel="margin asked for [m]", ylabel="duration [s]")
    axes.grid(alpha=0.3)
    axes.legend()
    return figure


def check_rows(rows: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> None:
    """Refuse results of a study that cannot be drawn.

    Raises:
        ProblemError: There are none, or a row lacks one of the keys.
    """
    if not rows:
        raise ProblemError("there are no results to draw: rows is empty")
    for number, row in enumerate(rows):
        if lacking := [key for key in keys if key not in row]:
            raise ProblemError(f"row {number} lacks {', '.join(map(repr, lacking))}")
