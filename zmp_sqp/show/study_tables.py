"""Tables of studies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from zmp_sqp.show.tables import new_table

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["ENVELOPE_LEGEND", "envelope_tables", "tradeoff_table"]

NOTHING = "-"
PADDING = 3  # characters between the columns of a table
REFUSED = "refused"
IMPOSSIBLE, UNSOLVED = "x", "?"  # cells without a motion
ENVELOPE_LEGEND = f"{IMPOSSIBLE}: start or goal is impossible; {UNSOLVED}: no motion was found"


def envelope_tables(
    rows: Sequence[Mapping[str, Any]], x: str, y: str, *, width: int
) -> list[Table]:
    """Durations [s] over two keys: x to the right, y upwards.

    What stands in cells without a motion says `ENVELOPE_LEGEND`. Where a line has
    not enough characters for all values of x, several tables follow each other.

    Args:
        rows: Results, with the values of both keys.
        x, y: The keys.
        width: Characters of a line.
    """
    xs, ys = (sorted({row[key] for row in rows}) for key in (x, y))
    found = {(row[x], row[y]): row for row in rows}
    texts = {value: f"{value:.4g}" for value in (*xs, *ys)}
    cells = {(a, b): _duration(found.get((a, b))) for a in xs for b in ys}
    widest = max(map(len, (*texts.values(), *cells.values())))
    columns = max((width - PADDING) // (widest + PADDING) - 1, 1)
    tables = []
    for first in range(0, len(xs), columns):
        some = xs[first : first + columns]
        table = new_table("", *(texts[value] for value in some))
        for at_y in reversed(ys):
            table.add_row(texts[at_y], *(cells[at_x, at_y] for at_x in some))
        tables.append(table)
    return tables


def _duration(row: Mapping[str, Any] | None) -> str:
    if row is None:
        return NOTHING
    if row["success"]:
        return f"{row['duration']:.3f}"
    return IMPOSSIBLE if row["status"] == REFUSED else UNSOLVED


def tradeoff_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Durations and what they cost against the first, by margin.

    Args:
        rows: Results, with the margin that was asked for.
    """
    table = new_table("margin asked for [m]", "duration [s]", "longer by [%]", "guaranteed [m]")
    least = next((row["duration"] for row in rows if row["success"]), None)
    for row in rows:
        asked = f"{row['plan.margin']:.4f}"
        if row["success"] and least is not None:
            longer = 100.0 * (row["duration"] / least - 1.0) if least else 0.0
            table.add_row(asked, f"{row['duration']:.4f}", f"{longer:.2f}", f"{row['margin']:.4f}")
        else:
            table.add_row(asked, row["status"], NOTHING, NOTHING)
    return table
