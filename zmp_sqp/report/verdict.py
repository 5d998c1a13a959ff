"""Verdict on a plan in one line, and tables of what it is about, as HTML."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from html import escape
from typing import Any

from zmp_sqp.planning.constraints.guarantee import amount_in_words

__all__ = ["guarantee_rows", "number", "rests_on_rows", "second_opinion", "table", "verdict_line"]

HEADS = {
    "looked_at": "looked at",
    "not_looked_at": "not looked at",
    "exact": "taken as exact",
    "uncertainties": "holds for",
}


def number(value: float, words: str) -> str:
    """A number in words whose element carries the exact value."""
    return f'<data value="{value!r}">{escape(words)}</data>'


def verdict_line(result: Mapping[str, Any]) -> str:
    """Duration, gap to the bound, guaranteed margin and where it is least, in one line of HTML.

    Args:
        result: Content of a plan.json.
    """
    tip_over = _tip_over(result)
    if not result["success"]:
        return f"<strong>No safe motion.</strong> {escape(result['message'])}"
    duration, bound = result["duration"], result["lower_bound"]
    gap = ""
    if bound is not None and bound > 0.0:
        share = 100.0 * (duration / bound - 1.0)
        gap = f", {share:.2f} % above the bound of {number(bound, f'{bound:.4f} s')}"
    margin, asked = result["margin"], result["margin_asked"]
    words = number(margin, amount_in_words(margin, "m"))
    where = ""
    if tip_over is not None:
        at = number(tip_over["time"], f"{tip_over['time']:.2f} s")
        corner = f", {tip_over['corner']}" if tip_over["corner"] else ""
        where = f", least at the {escape(tip_over['label'] + corner)} at {at}"
    proven = all(found["proven"] for found in result["guarantees"])
    safe = "Safe, proven for all times" if proven else "Safe; sampled only where the table says so"
    return (
        f"<strong>{safe}.</strong> {number(duration, f'{duration:.4f} s')}{gap}; the ZMP keeps "
        f"at least {words} from every edge ({asked:g} m asked for){where}."
    )


def second_opinion(result: Mapping[str, Any]) -> str:
    """Sentence about the second opinion of `--rigorous`, as HTML; empty without one."""
    opinion = result.get("rigorous")
    if not opinion:
        return ""
    if opinion["confirmed"]:
        return "A second opinion in ball arithmetic confirms every guarantee that it looks at."
    doubted = [
        f"{found['name']} ({found['verdict']})"
        for found in opinion["guarantees"]
        if found["verdict"] in ("refuted", "undecided")
    ]
    words = escape(", ".join(doubted))
    return f'<span class="broken">A second opinion does not confirm: {words}.</span>'


def guarantee_rows(result: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Rows of the table of guarantees, as HTML: constraint, room, asked for, when, proof."""
    for found in result["guarantees"]:
        value, required, unit = found["value"], found["required"], found["unit"]
        kept = value is not None and value >= max(required, 0.0)
        room = "nothing" if value is None else amount_in_words(value, unit)
        corner = f", {found['corner']}" if found["corner"] else ""
        yield (
            escape(f"{found['name']}: {found['label']}{corner}"),
            escape(room) if kept else f'<span class="broken">{escape(room)} &#10007;</span>',
            escape(amount_in_words(required, unit)),
            f"{found['time']:.2f} s",
            "proven" if found["proven"] else "sampled only",
        )


def rests_on_rows(result: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Rows of the table of what the verdict rests on, as HTML."""
    for name, entry in result["rests_on"].items():
        if name == "margin":
            entry = f"{entry:g} m asked for between ZMP and every edge"
        text = "; ".join(entry) if isinstance(entry, list) else str(entry)
        if text:
            yield escape(HEADS.get(name, name)), escape(text)


def table(heads: Iterable[str], rows: Iterable[tuple[str, ...]]) -> str:
    """A table of cells that are HTML already; the first cell of a row is its head."""
    first = "".join(f'<th scope="col">{escape(head)}</th>' for head in heads)
    body = "".join(
        f'<tr><th scope="row">{head}</th>' + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"
        for head, *cells in rows
    )
    top = f"<thead><tr>{first}</tr></thead>" if first else ""
    return f'<div class="scroll"><table>{top}<tbody>{body}</tbody></table></div>'


def _tip_over(result: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Entry of the guarantee against tip-over; None if there is none."""
    every: list[Mapping[str, Any]] = result["guarantees"]
    return next((found for found in every if found["name"] == "tip_over"), None)
