"""The paper's numbers beside ours as tables: on the terminal, and in Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from zmp_sqp.paper.runs import MODELS, PAPER

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "Sheet",
    "comparison_sheet",
    "driving_sheet",
    "ladder_overview",
    "ladder_sheet",
    "markdown",
    "sheets",
    "terminal",
]

REASON = "why not"
INSIDE = -1e-6  # [m] rounding of a margin that is kept
LEFT = re.compile(r"the ZMP would leave the (?P<edge>\S+) edge.* by (?P<way>\S+) m")


class Sheet(NamedTuple):
    """One table in words."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


def sheets(result: Mapping[str, Any]) -> list[Sheet]:
    """Every table of a result of `zmp-sqp paper`, in the order in which they are shown."""
    found = [
        comparison_sheet(result["tests"]),
        _planner_sheet(result["tests"]),
        _base_sheet(result["tests"]),
        driving_sheet(result["driving"]),
        _slew_sheet(result["slews"]),
    ]
    return [*found, ladder_sheet(result["ladder"])] if result["ladder"] else found


def comparison_sheet(tests: Iterable[Mapping[str, Any]]) -> Sheet:
    """Theirs, ours, ratio, for what the paper prints."""
    rows: list[Sequence[str]] = []
    for test in tests:
        if test["name"] not in ("test_1", "test_2"):
            continue
        number, planners = test["name"][-1], test["planners"]
        for name in ("phase plane", *MODELS):
            ours = planners[name]["duration"]
            ratio = "-" if ours is None else f"{ours / PAPER['duration']:.4f}"
            rows.append(
                (
                    f"test {number}: duration, {name} [s]",
                    f"{PAPER['duration']}",
                    _number(ours),
                    ratio,
                )
            )
        printed: Mapping[str, float] = PAPER[test["name"]]  # type: ignore[assignment]
        for name, theirs in printed.items():
            ours = planners[name]["time"]
            said = "> 18000" if name == "full" else f"{theirs}"
            rows.append(
                (
                    f"test {number}: computation, {name} [s]",
                    said,
                    f"{ours:.3f}",
                    f"1/{theirs / ours:.0f}",
                )
            )
        for name in ("phase plane", *MODELS):
            said = "leaves" if name == "phase plane" else "inside"
            rows.append(
                (
                    f"test {number}: ZMP, {name}",
                    said if number == "1" else "-",
                    _whether(planners[name]),
                    "",
                )
            )
        for way in test["base"]:
            if not way.get("blind") and way["distance"] == -2.0:
                rows.append(
                    (f"test {number}: ZMP, arm and base 2 m back", "inside", _whether(way), "")
                )
    return Sheet("Song & Sharf 2020 beside zmp_sqp", ("", "paper", "ours", "ratio"), rows)


def _planner_sheet(tests: Iterable[Mapping[str, Any]]) -> Sheet:
    rows = []
    for test in tests:
        for name, planned in test["planners"].items():
            cost = (
                (str(planned["iterations"]), _milliseconds(planned), f"{planned['time_in_F']:.0f}")
                if "time" in planned
                else ("", "", "")
            )
            rows.append(
                (
                    test["title"],
                    name,
                    _number(planned["duration"]),
                    _margin(planned["margin"]),
                    *cost,
                )
            )
    columns = (
        "",
        "planner",
        "duration [s]",
        "least margin [m]",
        "iterations",
        "time [ms]",
        "time [F]",
    )
    return Sheet(
        "every planner and variant (F: 100 calls of computeRNEADerivatives, CPU time)",
        columns,
        rows,
    )


def _base_sheet(tests: Iterable[Mapping[str, Any]]) -> Sheet:
    rows: list[Sequence[str]] = []
    for way in (way for test in tests for way in test["base"]):
        if way.get("blind"):
            name, bound, share = "phase plane, blind", "-", "-"
        elif not way["success"]:
            rows.append(
                ("eq. (21)", f"{-way['distance']:g}", "-", "-", "-", _short(way["message"]))
            )
            continue
        else:
            name, bound, share = (
                "eq. (21)",
                f"{way['lower']:.3f} ... {way['upper']:.3f}",
                f"{way['factor']:.3f}",
            )
        motion = (_number(way["duration"]), _margin(way["margin"]))
        rows.append((name, f"{-way['distance']:g}", bound, share, *motion))
    columns = (
        "base",
        "back [m]",
        "bound [m/s^2]",
        "share used",
        "duration [s]",
        "least margin [m]",
    )
    return Sheet(
        "test 2: the base backs up beside the arm, ZMP from the complete wrench", columns, rows
    )


def driving_sheet(rows: Iterable[Mapping[str, Any]]) -> Sheet:
    """Test 2 in the paper's two steps and in one program: durations, and margins proven and sampled."""
    entries: list[Sequence[str]] = []
    for row in rows:
        margins = [
            f"{1e3 * row[key]:.2f}" if row["success"] else "-" for key in ("margin", "sampled")
        ]
        over = (
            _number(row["lower_bound"]),
            _number(row["duration"]) if row["success"] else "none found",
        )
        cost = str(row["iterations"]), _milliseconds(row)
        entries.append((row["planner"], f"{-row['distance']:g}", *over, *margins, *cost))
    columns = (
        "test 2",
        "back [m]",
        "bound [s]",
        "duration [s]",
        "proven margin [mm]",
        "sampled [mm]",
        "iterations",
        "time [ms]",
    )
    return Sheet(
        "the base backs up: planned with the arm, and in the paper's two steps", columns, entries
    )


def _slew_sheet(slews: Iterable[Mapping[str, Any]]) -> Sheet:
    rows = []
    for row in slews:
        limits = "the paper's" if row["paper_limits"] else "none"
        ratio = "-" if row["sqp"] is None else f"{row['analytic'] / row['sqp']:.5f}"
        times = (f"{1e3 * row['analytic_time']:.0f}", f"{1e3 * row['sqp_time']:.0f}")
        rows.append(
            (
                f"{row['radius']:g}",
                limits,
                _number(row["analytic"]),
                _number(row["sqp"]),
                ratio,
                *times,
            )
        )
    columns = (
        "radius [m]",
        "joint limits",
        "analytic [s]",
        "SQP [s]",
        "ratio",
        "analytic [ms]",
        "SQP [ms]",
    )
    return Sheet(
        "half a turn of a crane on a round foot: analytic slew against the SQP", columns, rows
    )


def ladder_sheet(rungs: Iterable[Mapping[str, Any]]) -> Sheet:
    """A row per rung and model; without a motion, the reason."""
    rows: list[Sequence[str]] = []
    for rung in rungs:
        where = (f"{rung['payload'] / 1e3:g}", f"{rung['reach']:.2f}", rung["model"])
        if rung["success"]:
            over = f"{100.0 * (rung['duration'] / rung['lower_bound'] - 1.0):.1f}"
            found = (
                _number(rung["duration"]),
                _number(rung["lower_bound"]),
                over,
                _margin(rung["margin"]),
            )
        else:
            found = (
                "refused" if rung["status"] == "refused" else "none found",
                _number(rung["lower_bound"]),
                "-",
                "-",
            )
        cost = (
            ("-", "-", "-")
            if rung["time"] is None
            else (str(rung["iterations"]), _milliseconds(rung), f"{rung['time_in_F']:.0f}")
        )
        rows.append((*where, *found, *cost, "" if rung["success"] else _short(rung["message"])))
    columns = (
        "payload [t]",
        "reach [m]",
        "model",
        "duration [s]",
        "bound [s]",
        "above [%]",
        "margin [m]",
        "iterations",
        "time [ms]",
        "time [F]",
        REASON,
    )
    return Sheet(
        "the ladder: half a turn on 20 degrees of roll, payload and reach raised, QPs by PIQP",
        columns,
        rows,
    )


def ladder_overview(rungs: Sequence[Mapping[str, Any]]) -> Sheet:
    """Durations alone [s], full / simplified: a row per payload, a column per reach."""
    at = {(rung["payload"], round(rung["reach"], 2), rung["model"]): rung for rung in rungs}
    payloads, reaches = (sorted({key[i] for key in at}) for i in range(2))

    def entry(payload: float, reach: float) -> str:
        pair = [at.get((payload, reach, model)) for model in MODELS]
        if any(rung is None or rung["status"] == "refused" for rung in pair):
            return "tips over at rest"
        return " / ".join(
            f"{rung['duration']:.3f}" if rung and rung["success"] else "-" for rung in pair
        )

    columns = ("payload", *(f"reach {reach:.2f} m" for reach in reaches))
    rows = [
        (f"{payload / 1e3:g} t", *(entry(payload, reach) for reach in reaches))
        for payload in payloads
    ]
    return Sheet(
        "duration [s], full / simplified model; - where no safe motion was found", columns, rows
    )


def terminal(sheet: Sheet) -> Table:
    """For rich."""
    from rich import box
    from rich.table import Table
    from rich.text import Text  # a unit such as [m] is no markup

    table = Table(title=Text(sheet.title), title_justify="left", box=box.SIMPLE_HEAD)
    for i, column in enumerate(sheet.columns):
        words = i == 0 or column == REASON
        table.add_column(Text(column), justify="left" if words else "right", overflow="fold")
    for row in sheet.rows:
        table.add_row(*map(Text, row))
    return table


def markdown(sheet: Sheet) -> str:
    """For a Markdown file."""
    lines = [list(sheet.columns), ["---"] + ["--:"] * (len(sheet.columns) - 1), *sheet.rows]
    return f"**{sheet.title}**\n\n" + "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


def _milliseconds(planned: Mapping[str, Any]) -> str:
    return f"{1e3 * planned['time']:.0f}"


def _margin(value: float | None) -> str:
    """Without a minus sign before zeros."""
    return "lifts off" if value is None else f"{round(value, 4) + 0.0:.4f}"


def _whether(motion: Mapping[str, Any]) -> str:
    if motion.get("success") is False:
        return "no motion"
    margin = motion["margin"]
    if margin is None:
        return "lifts off"
    return (
        f"inside by {1e3 * max(margin, 0.0):.2f} mm"
        if margin >= INSIDE
        else f"leaves by {-margin:.3f} m"
    )


def _short(reason: str) -> str:
    """What differs from rung to rung: who tips over at rest, or which edge the last attempt leaves."""
    if attempt := LEFT.search(reason):
        return f"{attempt['edge']} edge by {attempt['way']} m"
    words = reason.partition(": ")[2] if reason.startswith("Not solved: ") else reason
    return words.partition(";")[0].partition(":")[0].removeprefix("the machine ").rstrip(".")
