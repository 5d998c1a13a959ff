"""Figures of load charts: reach from the side, and the table as operators know it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.charts import LoadChart, SwingChart
from zmp_sqp.charts.static_loads import ALL_ROUND, TIPPING
from zmp_sqp.plots.canvas import new_figure
from zmp_sqp.show.chart_tables import (
    OUT_OF_REACH,
    amount_text,
    chart_notes,
    length_texts,
    letters_in_words,
    load_text,
    load_unit,
    swing_notes,
    swing_text,
    swing_title,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["load_chart", "swing_chart"]

CELL_WIDTH, CELL_HEIGHT = 0.62, 0.26  # [in] of the table
SIDE_VIEW = 4.6  # [in] width and height of the picture from the side
LINES = 0.19  # [in] height of a line of notes
TITLE, BORDER = 0.5, 0.15  # [in] height of the title, space around parts
LEAST_WIDTH = 11.0  # [in] for the notes
FONT = 8.0  # [points]
HEADER, TIPS, HOLDS, NONE = "#dde3ea", "#ffffff", "#fde9c4", "#f0f0f0"  # colours of cells
COLOURS = "viridis_r"


@dataclass(frozen=True, slots=True)
class _Cell:
    """Text and colour of one cell of a table."""

    text: str
    colour: str


def load_chart(chart: LoadChart) -> Figure:
    """Load chart: heights from the top, radii split over the sectors, largest radius last.

    Cells limited by tipping are white, those limited by a joint are shaded. Above the table the
    loads all round are drawn over radius and height, with the largest radius of each height.

    Args:
        chart: The chart.

    Raises:
        MissingExtra: matplotlib is not installed.
    """
    unit = load_unit(chart)
    count = len(chart.sectors)
    radii = [f"{text} m" for text in length_texts(chart.radii)]
    groups = [("height", 1), *((radius, count) for radius in radii), ("max. radius", 1 + count)]
    heads = ["", *list(chart.sectors) * len(radii), "", *chart.sectors]
    table = [_row(chart, row, unit) for row in range(len(chart.heights) - 1, -1, -1)]
    notes = [letters_in_words(chart), *chart_notes(chart)]
    title = f"{chart.machine.name}: rated load [{unit}]"
    loads = chart.grid.rated[:, :, ALL_ROUND]
    return _draw(chart, loads, title, (groups, heads, table), notes)


def swing_chart(swing: SwingChart) -> Figure:
    """Largest loads of a swing over radius and height, and as a table.

    Args:
        swing: The loads.

    Raises:
        MissingExtra: matplotlib is not installed.
    """
    chart, unit = swing.chart, load_unit(swing.chart)
    groups = [("height", 1), *((f"{text} m", 1) for text in length_texts(chart.radii))]
    table = []
    for row in range(len(chart.heights) - 1, -1, -1):
        texts = [swing_text(swing, row, column, unit) for column in range(len(chart.radii))]
        cells = [_Cell(text, NONE if text == OUT_OF_REACH else TIPS) for text in texts]
        table.append([_Cell(f"{length_texts(chart.heights)[row]} m", HEADER), *cells])
    title = f"{chart.machine.name}: {swing_title(swing)}"
    return _draw(chart, swing.loads, title, (groups, None, table), swing_notes(swing))


def _row(chart: LoadChart, row: int, unit: str) -> list[_Cell]:
    """Cells of one height: loads by radius and sector, then the largest radius and its loads."""
    cells = [_Cell(f"{length_texts(chart.heights)[row]} m", HEADER)]
    places = [(chart.grid, (row, column)) for column in range(len(chart.radii))]
    for points, at in [*places, (chart.reach, (row,))]:
        if points is chart.reach:
            radius = float(points.radius[at])
            text = OUT_OF_REACH if np.isnan(radius) else f"{radius:.2f} m"
            cells.append(_Cell(text, HEADER))
        for sector in range(len(chart.sectors)):
            text = load_text(points, at, sector, unit, chart.letters)
            holds = int(points.limit[(*at, sector)]) > TIPPING
            cells.append(_Cell(text, NONE if text == OUT_OF_REACH else HOLDS if holds else TIPS))
    return cells


def _draw(
    chart: LoadChart,
    loads: Array,
    title: str,
    table: tuple[Sequence[tuple[str, int]], Sequence[str] | None, Sequence[Sequence[_Cell]]],
    notes: Sequence[str],
) -> Figure:
    """Picture, table and notes one above the other.

    Args:
        chart: The chart.
        loads: Loads of the picture, shape (R, C) [kg].
        title: Title of the figure.
        table: Groups of columns with their widths, heads of columns or None, and rows.
        notes: Sentences below the table.
    """
    groups, heads, rows = table
    columns = sum(width for _, width in groups)
    lines = 1 + (heads is not None) + len(rows)
    width = max(CELL_WIDTH * columns, LEAST_WIDTH) + 2.0 * BORDER
    spans = (TITLE, SIDE_VIEW, CELL_HEIGHT * lines + BORDER, LINES * len(notes) + BORDER)
    height = sum(spans)
    figure = new_figure(width=width, height=height)
    figure.set_layout_engine("none")  # every part has its size in inches
    figure.suptitle(title, fontsize=FONT + 3.0, y=1.0 - 0.3 * TITLE / height)
    tops = 1.0 - np.cumsum(spans) / height  # lower ends of the parts, as shares of the height
    left = BORDER / width

    def axes(part: int, share: float) -> Axes:
        """Axes for a part of the figure over a share of its width."""
        return figure.add_axes((left, tops[part], share - 2.0 * left, spans[part] / height))

    picture = figure.add_axes(
        (0.7 / width, tops[1] + 0.6 / height, 0.6, (SIDE_VIEW - 0.6) / height)
    )
    _draw_side_view(picture, chart, loads)
    _draw_table(axes(2, columns * CELL_WIDTH / width + 2.0 * left), groups, heads, rows)
    text = axes(3, 1.0)
    text.axis("off")
    text.text(0.0, 0.9, "\n".join(notes), fontsize=FONT, va="top", transform=text.transAxes)
    return figure


def _draw_side_view(axes: Axes, chart: LoadChart, loads: Array) -> None:
    """Draw loads over radius and height, in colours, with the largest radius of each height."""
    unit = load_unit(chart)
    finite = np.isfinite(loads)
    scale = 1e-3 if unit == "t" else 1.0
    radii, heights = np.meshgrid(chart.radii, chart.heights)
    if finite.any():
        # loads near the slew axis are many times those at reach
        shown = np.sqrt(scale * loads[finite])
        dots: Any = axes.scatter(
            radii[finite], heights[finite], c=shown, s=320, cmap=COLOURS, marker="s", alpha=0.45
        )
        for radius, height, load in zip(radii[finite], heights[finite], loads[finite], strict=True):
            axes.text(
                radius, height, amount_text(load, unit), fontsize=6.0, ha="center", va="center"
            )
        dots.set_clim(0.0, max(float(shown.max()), 1e-9))
    axes.plot(chart.reach.radius, chart.heights, "k-", linewidth=1.2, label="largest radius")
    axes.axhline(0.0, color="tab:brown", linewidth=1.0)
    axes.axvline(0.0, color="grey", linewidth=0.8, linestyle="-.", label="slew axis")
    axes.set(xlabel="radius [m]", ylabel="height [m]", aspect="equal")
    axes.legend(fontsize=FONT, loc="center left", bbox_to_anchor=(1.02, 0.5))


def _draw_table(
    axes: Axes,
    groups: Sequence[tuple[str, int]],
    heads: Sequence[str] | None,
    rows: Sequence[Sequence[_Cell]],
) -> None:
    """Draw a table of equal cells, with one line of groups and one of heads above."""
    lines: list[list[tuple[str, int, str]]] = [[(text, width, HEADER) for text, width in groups]]
    if heads is not None:
        lines.append([(head, 1, HEADER) for head in heads])
    lines += [[(cell.text, 1, cell.colour) for cell in row] for row in rows]
    for number, line in enumerate(lines):
        left = 0
        for text, width, colour in line:
            _draw_cell(axes, text, colour, (left, -number - 1.0), width)
            left += width
    axes.set(xlim=(0.0, float(left)), ylim=(-float(len(lines)), 0.0))
    axes.axis("off")


def _draw_cell(axes: Axes, text: str, colour: str, at: tuple[float, float], width: int) -> None:
    from matplotlib.patches import Rectangle

    axes.add_patch(Rectangle(at, width, 1.0, facecolor=colour, edgecolor="grey", linewidth=0.5))
    middle = at[0] + 0.5 * width, at[1] + 0.5
    axes.text(*middle, text, fontsize=FONT - 1.0, ha="center", va="center")
