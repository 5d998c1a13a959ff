"""Guarantees of a motion, for JSON and on the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.planning import Guarantee
from zmp_sqp.planning.constraints.guarantee import amount_in_words
from zmp_sqp.show.tables import new_table

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["GUARANTEE_KEYS", "guarantee_fields", "guarantee_table"]

GUARANTEE_KEYS = """\
  guarantees                list, one entry per constraint (base: several):
    name, label             constraint, and that of its rows which has the least room; room is the
                            distance to the limit, negative beyond it
    corner                  payload and slope for which the room is least; empty if exact
    value, unit             room that is guaranteed; null if none is
    required                room that was asked for
    time                    [s] at which the sampled room is least
    proven                  true: at all times; false: only at 2000 samples per second
"""
ARRIVALS = ("start ", "goal ")  # labels of the base that say whether it starts and ends as asked


def guarantee_fields(guarantees: Iterable[Guarantee]) -> list[dict[str, Any]]:
    """Guarantees ready for JSON: SI units, None for a value that is not finite."""
    entries = [asdict(found) for found in guarantees]
    return [
        entry | {"value": entry["value"] if np.isfinite(entry["value"]) else None}
        for entry in entries
    ]


def guarantee_table(guarantees: Sequence[Mapping[str, Any]]) -> Table:
    """Table with one row per constraint: what it guarantees, what was asked for, and when.

    Constraints that are not proven are marked "sampled only". Start and goal of a base, which it
    meets or not, are left out where they are met.

    Args:
        guarantees: Made by `guarantee_fields`.
    """
    from rich.text import Text

    heads = ("room guaranteed", "asked for", "at [s]")
    proven = all(found["proven"] for found in guarantees)
    table = new_table("constraint", *heads, *(() if proven else ("",)))
    for column in table.columns[1:]:
        column.no_wrap = True  # long names of rows and corners wrap instead
    for found in guarantees:
        value, required, unit = found["value"], found["required"], found["unit"]
        kept = value is not None and value >= max(required, 0.0)
        if kept and found["name"] == "base" and found["label"].startswith(ARRIVALS):
            continue
        room = "nothing" if value is None else amount_in_words(value, unit)
        corner = f", {found['corner']}" if found["corner"] else ""
        table.add_row(
            f"{found['name']}: {found['label']}{corner}",
            Text(room, style="" if kept else "bold red"),
            amount_in_words(required, unit),
            f"{found['time']:.2f}",
            *(() if proven else ("" if found["proven"] else "sampled only",)),
        )
    return table
