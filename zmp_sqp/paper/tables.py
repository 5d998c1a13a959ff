"""Results of Song & Sharf 2020 beside those of zmp_sqp: tables for the terminal and Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from zmp_sqp.paper.runs import MODELS, PAPER_DURATION, PAPER_TIMES

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

REASON = "why not"  # head of the column with reasons
INSIDE = -1e-6  # [m] rounding of a margin of zero


class Sheet(NamedTuple):
    """Table as text.

    Attributes:
        title: Title of the table.
        columns: Heads of the columns.
        rows: Cells of each row.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


def sheets(result: Mapping[str, Any]) -> list[Sheet]:
    """Tables of a result of `zmp-sqp paper`, in the order in which they are shown."""
    found = [
        comparison_sheet(result["tests"]),
        _planner_sheet(result["tests"]),
        _base_sheet(result["tests"]),
        driving_sheet(result["driving"]),
        _slew_sheet(result["slews"]),
    ]
    return [*found, ladder_sheet(result["ladder"])] if result["ladder"] else found


def comparison_sheet(tests: Iterable[Mapping[str, Any]]) -> Sheet:
    """Results that the paper gives, ours beside them, and their ratio."""
    rows: list[Sequence[str]] = []
    for test in tests:
        if test["name"] not in ("test_1", "test_2"):
            continue
        number, planners = test["name"][-1], test["planners"]
        for name in ("phase plane", *MODELS):
            ours = planners[name]["duration"]
            ratio = "-" if ours is None else f"{ours / PAPER_DURATION:.4f}"
            rows.append(
                (
                    f"test {number}: duration, {name} [s]",
                    f"{PAPER_DURATION}",
                    _number(ours),
                    ratio,
                )
            )
        for name, theirs in PAPER_TIMES[test["name"]].items():
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
        for run in test["base"]:
            if not run.get("blind") and run["distance"] == -2.0:
                rows.append(
                    (f"test {number}: ZMP, arm and base 2 m back", "inside", _whether(run), "")
                )
    return Sheet("Song & Sharf 2020 beside zmp_sqp", ("", "paper", "ours", "ratio"), rows)


def _planner_sheet(tests: Iterable[Mapping[str, Any]]) -> Sheet:
    """Durations, margins and computation times of every planner in every test."""
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
    """Base motions beside the planned arm motion of test 2."""
    rows: list[Sequence[str]] = []
    for run in (run for test in tests for run in test["base"]):
        if run.get("blind"):
            name, bound, share = "phase plane, blind", "-", "-"
        elif not run["success"]:
            rows.append(("eq. (21)", f"{-run['distance']:g}", "-", "-", "-", run["message"]))
            continue
        else:
            name, bound, share = (
                "eq. (21)",
                f"{run['lower']:.3f} ... {run['upper']:.3f}",
                f"{run['factor']:.3f}",
            )
        motion = (_number(run["duration"]), _margin(run["margin"]))
        rows.append((name, f"{-run['distance']:g}", bound, share, *motion))
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
    """Durations and margins of test 2, base and arm planned in two steps and in one program."""
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
    """Durations and computation times of the analytic slew and of the SQP."""
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
    """Results of the ladder, one row per rung and model; without a motion, the reason."""
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
        rows.append((*where, *found, *cost, "" if rung["success"] else rung["reason"]))
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
        "the ladder: half a turn on 20 degrees of roll, payload and reach raised",
        columns,
        rows,
    )


def ladder_overview(rungs: Sequence[Mapping[str, Any]]) -> Sheet:
    """Durations on the ladder, one row per payload and one column per reach."""
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
    """Table for the terminal, as an object of rich."""
    from rich import box
    from rich.table import Table
    from rich.text import Text  # strings would be parsed for markup, which swallows [m]

    table = Table(title=Text(sheet.title), title_justify="left", box=box.SIMPLE_HEAD)
    for i, column in enumerate(sheet.columns):
        words = i == 0 or column == REASON
        table.add_column(Text(column), justify="left" if words else "right", overflow="fold")
    for row in sheet.rows:
        table.add_row(*map(Text, row))
    return table


def markdown(sheet: Sheet) -> str:
    """Table in Markdown, with its title in bold."""
    lines = [list(sheet.columns), ["---"] + ["--:"] * (len(sheet.columns) - 1), *sheet.rows]
    return f"**{sheet.title}**\n\n" + "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


def _milliseconds(planned: Mapping[str, Any]) -> str:
    return f"{1e3 * planned['time']:.0f}"


def _margin(value: float | None) -> str:
    """Margin [m] with four digits; None means that the machine lifts off."""
    # adding 0.0 turns -0.0 into 0.0
    return "lifts off" if value is None else f"{round(value, 4) + 0.0:.4f}"


def _whether(motion: Mapping[str, Any]) -> str:
    """Whether the ZMP of a motion stays inside the support polygon, and by how much."""
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
