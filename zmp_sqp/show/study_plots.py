"""Figures of studies: maps over two numbers, and duration against margin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.show.canvas import new_figure, save
from zmp_sqp.show.study_tables import REFUSED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_envelope", "plot_tradeoff"]

COLOURS = {"duration": "viridis", "margin": "cividis"}
TITLES = {"duration": "duration [s]", "margin": "guaranteed margin [m]"}
UNITS = {"deg": "degrees", "mass": "kg", "margin": "m"}
LEVELS = 6


def plot_envelope(rows: Sequence[Mapping[str, Any]], x: str, y: str, path: Path) -> None:
    """Draw duration and guaranteed margin over two keys of a scenario.

    Coloured cells have a safe motion, hatched ones have no motion that was found, and grey ones are
    impossible at start or goal. The thick line is where motions end.

    Args:
        rows: Results, with the values of both keys.
        x, y: The keys.
        path: File to write; its ending chooses the format.
    """
    xs, ys = (np.array(sorted({row[key] for row in rows})) for key in (x, y))
    found = {(row[x], row[y]): row for row in rows}
    figure = new_figure(width=11.0, height=4.6)
    for axes, name in zip(figure.subplots(1, 2), COLOURS, strict=True):
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
    save(figure, path)


def _map(axes: Axes, at: tuple[Array, Array], grid: Array, state: Array, name: str) -> None:
    """Map of one quantity, with its contour lines and the border of what is possible."""
    xs, ys = at
    axes.set_facecolor("0.85")
    mesh = axes.pcolormesh(xs, ys, grid, cmap=COLOURS[name], shading="nearest")
    axes.figure.colorbar(mesh, ax=axes)
    missing = np.ma.masked_where(state != 2, np.ones_like(state))
    axes.pcolor(xs, ys, missing, hatch="///", alpha=0.0, shading="nearest", edgecolor="0.3")
    safe = (state == 3).astype(float)
    if 0.0 < safe.mean() < 1.0:
        axes.contour(xs, ys, safe, levels=[0.5], colors="tab:red", linewidths=2.0)
    values = grid[np.isfinite(grid)]
    if len(values) and np.ptp(values) > 1e-3 * max(1.0, np.abs(values).max()):
        lines = axes.contour(xs, ys, grid, levels=LEVELS, colors="white", linewidths=0.7)
        axes.clabel(lines, fontsize=7, fmt="%.3g")


def _label(key: str) -> str:
    """Key with its unit, where its name tells it."""
    last = key.partition("[")[0].rpartition(".")[2].rpartition("_")[2]
    return f"{key} [{UNITS[last]}]" if last in UNITS else key


def plot_tradeoff(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Draw the duration over the margin that is asked for.

    Args:
        rows: Results, with the margin that was asked for.
        path: File to write; its ending chooses the format.
    """
    figure = new_figure(width=6.4, height=4.2)
    axes = figure.subplots()
    safe = [row for row in rows if row["success"]]
    margins = [row["plan.margin"] for row in safe]
    axes.plot(margins, [row["duration"] for row in safe], "o-", color="tab:red", label="planned")
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
    save(figure, path)
