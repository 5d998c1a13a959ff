"""Tables of a plan on the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from zmp_sqp.mechanics import Machine
from zmp_sqp.planning import Plan

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

__all__ = [
    "history_table",
    "joint_table",
    "joint_unit",
    "key_table",
    "margin_text",
    "new_table",
    "summary_table",
]


def summary_table(result: Mapping[str, Any]) -> Table:
    """Durations and margins of the planned motion and of the phase-plane baseline, side by side.

    Both margins are guaranteed ones, under all uncertainties of the problem; where there are any,
    a second row has the margins without them.

    Args:
        result: Made by `make_result`.
    """
    baseline = result["phase_plane"] or {}
    table = new_table("", "planned", "phase plane")
    table.add_row("duration [s]", _number(result["duration"]), _number(baseline.get("duration")))
    table.add_row("lower bound [s]", _number(result["lower_bound"]))
    if result["success"] and result["lower_bound"] > 0.0:
        table.add_row(
            "above the bound [%]",
            _number(100.0 * (result["duration"] / result["lower_bound"] - 1.0), 2),
        )
    rows = {"guaranteed stability margin [m]": "margin"}
    if result["corner"]:
        rows["the same, nothing uncertain [m]"] = "nominal_margin"
    for name, key in rows.items():
        motions = (result, baseline)
        table.add_row(name, *(margin_text(one[key]) if _there(one) else "-" for one in motions))
    table.add_row("SQP iterations", str(result["iterations"]))
    table.add_row("solve time [ms]", _number(1e3 * result["solve_time"], 1))
    table.add_row("QP solver", result["qp_solver"])
    return table


def key_table(values: Mapping[str, float | None]) -> Table:
    """Table with one named number per row; None is shown as a dash."""
    table = new_table("", "")
    for name, value in values.items():
        table.add_row(name, _number(value))
    return table


def joint_table(result: Mapping[str, Any], unit: str) -> Table:
    """Peak rates and accelerations of the joints beside their limits.

    Args:
        result: Made by `make_result` from a successful plan.
        unit: Unit of the joint coordinates, for the column heads.
    """
    table = new_table(
        "joint", f"peak rate\n[{unit}/s]", "limit", f"peak acceleration\n[{unit}/s^2]", "limit"
    )
    for name, joint in result["joints"].items():
        table.add_row(name, *(_number(value) for value in joint.values()))
    return table


def joint_unit(machine: Machine) -> str:
    """Unit of the joint coordinates: "rad", "m", or "rad or m" if both occur."""
    return " or ".join(unit for unit in ("rad", "m") if unit in machine.joint_units)


def history_table(found: Plan) -> Table:
    """Table with one row per SQP iteration."""
    table = new_table(
        "", "QP solver", "inner", "rows", "objective", "violation", "step", "notes", "ms"
    )
    table.caption = "notes: R relaxed QP, C curvature of the constraints, S second-order correction"
    for record in found.history:
        qp = (record.backend, str(record.inner_iterations), str(record.rows))
        step = (f"{record.objective:.8g}", f"{record.violation:.1e}", f"{record.step:.3g}")
        notes = "R" * record.relaxed + "C" * record.curvature + "S" * record.corrected
        table.add_row(str(record.iteration), *qp, *step, notes, f"{1e3 * record.time:.1f}")
    return table


def runs_table(found: Plan) -> Table:
    """Table with one row per run of the search: guess, grid, QP solver, outcome."""
    table = new_table("run of the search", "grid", "QP solver", "iterations", "outcome", "T [s]")
    for run in found.runs:
        how = (str(run.intervals), run.backend, str(run.iterations))
        table.add_row(run.purpose, *how, run.status.replace("_", " "), f"{run.duration:.4f}")
    return table


def new_table(first: str, *others: str) -> Table:
    """Empty table with these column heads: the first column left-aligned, the others right."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    table.add_column(first, overflow="fold")
    for header in others:
        table.add_column(header, justify="right", overflow="fold")
    return table


def _number(value: float | None, digits: int = 4) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _there(motion: Mapping[str, Any]) -> bool:
    return motion.get("duration") is not None


def margin_text(margin: float | None) -> Text:
    """Margin [m] as text, red if it is negative or None, which means that the machine lifts off."""
    from rich.text import Text

    # adding 0.0 turns -0.0 into 0.0
    text = "lifts off" if margin is None else _number(round(margin, 4) + 0.0)
    return Text(text, style="" if margin is not None and round(margin, 4) >= 0.0 else "bold red")
