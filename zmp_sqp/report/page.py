"""The page: one HTML file with the data, the renderer and the style in it, and no links."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from typing import Any

from zmp_sqp.arrays import shortened
from zmp_sqp.errors import ScenarioError
from zmp_sqp.report.verdict import (
    guarantee_rows,
    rests_on_rows,
    second_opinion,
    table,
    verdict_line,
)

__all__ = ["GUARANTEE_HEADS", "LEAST", "SCRIPTS", "asset", "embedded", "make_page", "read_plan"]

SCRIPTS = ("three.min.js", "time.js", "plots.js", "view.js", "main.js")  # in this order
NEEDED: dict[str, type | tuple[type, ...]] = {  # entries of a plan.json that are shown
    "record": (dict, type(None)),
    "scenario_text": str,
    "guarantees": list,
    "rests_on": dict,
    "success": bool,
    "message": str,
    "title": str,
    "versions": dict,
}
LEAST = "Shown is the motion of the search that violates its constraints least; red is violated."
GUARANTEE_HEADS = ("constraint", "room guaranteed", "asked for", "least at", "")


def read_plan(text: str, name: str) -> dict[str, Any]:
    """Content of a plan.json.

    Args:
        text: The file.
        name: Its name, for messages.

    Raises:
        ScenarioError: It is no plan.json, or one of an earlier version that lacks what a report
            shows.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as cause:
        raise ScenarioError(f"{name}: not a JSON file: {cause}") from None
    named = isinstance(content, dict) and isinstance(content.get("scenario"), str)
    if not named or "success" not in content:
        raise ScenarioError(f"{name}: not a plan.json, which `zmp-sqp plan --out DIR` writes")
    lacking = [key for key in NEEDED if key not in content]
    if lacking:
        raise ScenarioError(
            f"{name}: made by an earlier version, it lacks {', '.join(lacking)}; plan again with "
            f"`zmp-sqp plan {content['scenario']} --out DIR`"
        )
    for key, kind in NEEDED.items():
        if not isinstance(content[key], kind):
            raise ScenarioError(
                f"{name}: {key} cannot be {shortened(content[key])}: the file is damaged"
            )
    return _shown(content, name)


def _shown(content: dict[str, Any], name: str) -> dict[str, Any]:
    """Content of a plan.json that a page can be made of; raises ScenarioError if none can."""
    try:
        record = content["record"]
        if record is not None:
            for key in ("support", "parts", "ground", "plan", "blind", "margin_asked"):
                _ = record[key]
            for key in ("times", "zmp", "margin", "charts", "root", "bodies", "duration"):
                _ = record["plan"][key]
        make_page([content])
    except (LookupError, TypeError, ValueError, AttributeError) as cause:
        raise ScenarioError(
            f"{name}: the file is damaged ({type(cause).__name__}: {cause})"
        ) from None
    return content


def make_page(results: Sequence[Mapping[str, Any]]) -> str:
    """A report as HTML: one plan, or several side by side.

    Args:
        results: Contents of plan.json files, see `RESULT_KEYS` and `RECORD_KEYS`.
    """
    titles = [str(result["title"]) for result in results]
    page = asset("report.html")
    for place, content in (
        ("title", escape(" | ".join(titles))),
        ("style", asset("style.css")),
        ("plans", "\n".join(_article(i, result) for i, result in enumerate(results))),
        ("data", embedded(list(results))),
        ("scripts", "\n".join(f"<script>\n{asset(name)}\n</script>" for name in SCRIPTS)),
    ):
        page = page.replace(f"<!-- {place} -->", content, 1)
    return page


def asset(name: str) -> str:
    """Text of a file of the folder `assets`."""
    return (resources.files(__package__) / "assets" / name).read_text(encoding="utf-8")


def embedded(content: Any) -> str:
    """Lists and mappings as JSON that ends no script element."""
    return json.dumps(content, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _article(number: int, result: Mapping[str, Any]) -> str:
    """Everything about one plan; scripts fill its view and its plots."""
    kind = "safe" if result["success"] else "unsafe"
    message = escape(
        str(result["message"]) if result["success"] else LEAST if result["record"] else ""
    )
    versions = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    return f"""\
<article class="plan" data-plan="{number}">
<header class="verdict {kind}">
<h2>{escape(str(result["scenario"]))}: {escape(str(result["title"]))}</h2>
<p class="line">{verdict_line(result)}</p>
<p>{message} {second_opinion(result)}</p></header>
<div class="stage">
<figure class="view" aria-label="The machine in 3-D"><div class="canvas"></div>
<figcaption class="now" role="status"></figcaption></figure>
<figure class="map"></figure>
</div>
<section class="charts constraints"><h3>Room left to every constraint</h3><div></div></section>
<section class="charts joints"><h3>Joints against their limits</h3><div></div></section>
<section><h3>What is guaranteed</h3>{table(GUARANTEE_HEADS, guarantee_rows(result))}</section>
<section><h3>What the verdict rests on</h3>{table((), rests_on_rows(result))}</section>
<details><summary>Scenario and versions</summary>
<p>{escape(versions)}</p>
<pre>{escape(str(result["scenario_text"]))}</pre>
</details>
</article>"""
