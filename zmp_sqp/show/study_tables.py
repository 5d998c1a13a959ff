"""Tables of studies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from zmp_sqp.show.tables import new_table

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["envelope_table", "tradeoff_table"]

NOTHING = "-"
REFUSED = "refused"
IMPOSSIBLE, UNSOLVED = "x", "?"  # cells without a motion


def envelope_table(rows: Sequence[Mapping[str, Any]], x: str, y: str) -> Table:
    """Durations [s] over two keys: x to the right, y upwards.

    `x` stands where start or goal are impossible, `?` where no motion was found.

    Args:
        rows: Results, with the values of both keys.
        x, y: The keys.
    """
    xs, ys = (sorted({row[key] for row in rows}) for key in (x, y))
    found = {(row[x], row[y]): row for row in rows}
    table = new_table(f"duration [s]: {y} / {x}", *(f"{value:.4g}" for value in xs))
    for at_y in reversed(ys):
        cells = [_duration(found.get((at_x, at_y))) for at_x in xs]
        table.add_row(f"{at_y:.4g}", *cells)
    table.caption = f"{IMPOSSIBLE}: start or goal is impossible; {UNSOLVED}: no motion was found"
    return table


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
