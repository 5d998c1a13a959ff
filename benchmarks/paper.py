"""Song & Sharf 2020 beside our numbers, and the tables of docs/paper.md.

    python -m benchmarks.paper [--repeats 7] [--json benchmarks/results/paper.json]
    python -m benchmarks.paper --docs

The first command computes the numbers, as `zmp-sqp paper` does (zmp_sqp/paper). The second one
computes nothing: it makes the tables of docs/paper.md from benchmarks/results/paper.json. The exit
code is 1 where a motion that should be safe is not.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.harness import benchmark_parser, console, exit_code, save_json
from zmp_sqp.commands.paper import paper_result
from zmp_sqp.paper.tables import (
    comparison_sheet,
    driving_sheet,
    ladder_overview,
    markdown,
    sheets,
    terminal,
)

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results" / "paper.json"
PAGE = ROOT / "docs" / "paper.md"
BEGIN, END = "<!-- made by python -m benchmarks.paper --docs -->", "<!-- end -->"
ASKED = 60  # [F] most that a cold call with the simplified model may take


def page_tables(result: Mapping[str, Any]) -> str:
    """Text of the page from the first mark to the last."""
    found = (
        comparison_sheet(result["tests"]),
        driving_sheet(result["driving"]),
        ladder_overview(result["ladder"]),
    )
    return "\n".join([f"{BEGIN}\n", *map(markdown, found), END])


def update_page(text: str, result: Mapping[str, Any]) -> str:
    """Text of the page with new tables."""
    pattern = re.compile(f"{re.escape(BEGIN)}.*?{re.escape(END)}", re.DOTALL)
    if len(pattern.findall(text)) != 1:
        raise SystemExit(f"{PAGE.relative_to(ROOT)} must hold {BEGIN} ... {END} once")
    return pattern.sub(lambda _: page_tables(result), text)


def main() -> int:
    parser = benchmark_parser(__doc__)
    parser.add_argument(
        "--repeats", type=int, default=7, help="plans per time, of which the median counts"
    )
    parser.add_argument(
        "--docs",
        action="store_true",
        help=f"make the tables of docs/paper.md from {RESULTS.relative_to(ROOT)}",
    )
    options = parser.parse_args()
    if options.docs:
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(update_page(text, json.loads(RESULTS.read_text())), encoding="utf-8")
        return 0

    result, _ = paper_result(
        repeats=options.repeats, step=lambda what: console.print(f"  {what}", style="dim")
    )
    for sheet in sheets(result):
        console.print(terminal(sheet))
    for test in result["tests"]:
        numbers = test["planners"]["simplified"]
        busy, wall = numbers["time_in_F"], numbers["time"] / numbers["F"]
        cost = f"{busy:.0f} F of CPU, {wall:.0f} F on the wall"
        console.print(f"{test['title']}: simplified model from cold in {cost} (asked: {ASKED})")
    for failure in result["failures"]:
        console.print(failure, style="bold red")
    if options.json is not None:
        save_json(options.json, result)
    return exit_code(success=not result["failures"])


if __name__ == "__main__":
    sys.exit(main())
