"""Second opinion on a motion, for JSON and on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.planning.constraints.guarantee import amount_in_words
from zmp_sqp.rigorous import RigorousCheck, Verdict
from zmp_sqp.show.tables import new_table

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["RIGOROUS_KEYS", "rigorous_fields", "rigorous_line", "rigorous_table"]

RIGOROUS_KEYS = """\
  rigorous                  second opinion of --rigorous, null without it:
    confirmed               whether every guarantee that was looked at is confirmed
    stretches               number of stretches of time that were evaluated
    guarantees              list: name, label, verdict (confirmed, refuted, undecided, not looked
                            at), required, lower and upper (bounds on the least room that hold with
                            certainty), unit, time [s] of upper, corner, reason
"""
ARRIVALS = ("start ", "goal ")  # labels of the base that say whether it starts and ends as asked
STYLES = {Verdict.CONFIRMED: "green", Verdict.REFUTED: "bold red", Verdict.UNDECIDED: "yellow"}


def rigorous_fields(found: RigorousCheck) -> dict[str, Any]:
    """Verdicts ready for JSON; None for a number that is not finite."""
    entries = []
    for one in found.guarantees:
        entry = asdict(one) | {"verdict": one.verdict.value}
        for key in ("required", "lower", "upper", "time"):
            entry[key] = float(entry[key]) if np.isfinite(entry[key]) else None
        entries.append(entry)
    return {
        "confirmed": found.confirmed,
        "stretches": found.stretches,
        "guarantees": entries,
    }


def rigorous_table(found: RigorousCheck) -> Table:
    """Table with one row per guarantee: verdict, bounds on the least room, and when it is least.

    Start and goal of a base are left out where they are confirmed.
    """
    from rich.text import Text

    heads = ("verdict", "asked for", "at least", "at most", "at [s]")
    table = new_table("second opinion", *heads)
    for one in found.guarantees:
        if one.verdict is Verdict.CONFIRMED and one.label.startswith(ARRIVALS):
            continue
        named = f"{one.name}: {one.label}" if one.label else one.name
        unit = f" [{one.unit}]" if one.unit else ""
        corner = f", {one.corner}" if one.corner else ""
        numbers = [""] * 4
        if one.verdict is not Verdict.NOT_CHECKED and np.isfinite(one.lower) | np.isfinite(
            one.upper
        ):
            values = (one.required, one.lower, one.upper)
            numbers = [*(f"{value:.6g}" for value in values), f"{one.time:.2f}"]
        table.add_row(
            f"{named}{corner}{unit}",
            Text(one.verdict.value, style=STYLES.get(one.verdict, "")),
            *numbers,
        )
    return table


def rigorous_line(found: RigorousCheck) -> str:
    """One sentence: what the second opinion found."""
    for verdict, words in ((Verdict.REFUTED, "refutes"), (Verdict.UNDECIDED, "cannot decide")):
        some = [one for one in found.guarantees if one.verdict is verdict]
        if some:
            return f"Second opinion: ball arithmetic {words} {_reasons(some)}."
    unseen = [one.name for one in found.guarantees if one.verdict is Verdict.NOT_CHECKED]
    but = f"; not looked at: {', '.join(unseen)}" if unseen else ""
    return f"Second opinion: confirmed at all times in ball arithmetic{but}."


def _reasons(some: Sequence[Any]) -> str:
    words = []
    for one in some:
        named = f"{one.name} ({one.label})" if one.label else one.name
        if one.verdict is Verdict.REFUTED:
            least = "the ground would have to pull"
            if np.isfinite(one.upper):
                room = _words(one.upper, one.unit)
                least = f"{room} where {_words(one.required, one.unit)} is asked for"
            words.append(f"{named}, {least} at {one.time:.2f} s")
        else:
            words.append(f"{named}: {one.reason}")
    return "; ".join(words)


def _words(value: float, unit: str) -> str:
    """Number with its unit; nothing where it is not finite."""
    return amount_in_words(value, unit) if np.isfinite(value) else "nothing"
