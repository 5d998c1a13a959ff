"""What came out of planning: one object for programs, tables for people."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from contextlib import suppress
from importlib import metadata
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp import __version__
from zmp_sqp.errors import ContactLost
from zmp_sqp.mechanics import stability_margin
from zmp_sqp.planning import Plan, Problem, Trajectory
from zmp_sqp.scenario import Scenario
from zmp_sqp.show.plots import sample_times

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

__all__ = [
    "RESULT_KEYS",
    "history_table",
    "joint_table",
    "key_table",
    "make_result",
    "plan_fields",
    "summary_table",
    "versions",
]

# whose versions a result names
PACKAGES = ("numpy", "scipy", "pin", "proxsuite", "daqp", "piqp", "qpsolvers")
RESULT_KEYS = """\
--json writes one object; SI units, null where there is no value:
  scenario, title           what was planned
  success, status, message  whether a motion was found, and why not
  duration, lower_bound     [s]; no motion within the joint limits is faster than the bound
  margin                    [m] from the ZMP to the nearest edge at its least, negative outside
  iterations                of the SQP
  qp_solver                 the QP solver that was asked for
  corner                    payload and slope for which the margin is least, or empty
  solve_time                [s]
  phase_plane               duration and margin of the motion that knows no ZMP;
                            null if the start or the goal is in motion, or the base drives
  diagnosis                 without success: largest_payload [kg], steepest_slope [rad]; or null
  joints                    by name: peak_rate, rate_limit, peak_acceleration, acceleration_limit
  versions                  of Python, of this package and of what it stands on
"""


def plan_fields(found: Plan) -> dict[str, Any]:
    """What every result tells of a plan, ready for JSON: SI units, None where there is no value."""
    return {
        "success": found.success,
        "status": found.status.name.lower(),
        "message": found.message,
        "duration": found.duration if found.success else None,
        "lower_bound": found.lower_bound,
        "margin": found.margin if found.success else None,
        "iterations": found.iterations,
        "qp_solver": found.qp_solver,
    }


def make_result(
    scenario: Scenario, found: Plan, baseline: Trajectory | None, qp_solver: str
) -> dict[str, Any]:
    """What `--json` writes; `RESULT_KEYS` explains it."""
    return {
        "scenario": scenario.name,
        "title": scenario.title,
        **plan_fields(found),
        "corner": found.certificate.corner,
        "solve_time": found.solve_time,
        "phase_plane": None if baseline is None else _baseline_result(found.problem, baseline),
        "diagnosis": None,
        "joints": _joint_peaks(found.problem, found.trajectory) if found.success else None,
        "versions": versions(),
    }


def _baseline_result(problem: Problem, baseline: Trajectory) -> dict[str, float | None]:
    """Its margin is sampled; None where the machine lifts off and there is no ZMP."""
    q, v, a = baseline(np.concatenate(sample_times(baseline)))
    try:
        margin = float(stability_margin(problem.machine, q, v, a, problem.ground).min())
    except ContactLost:
        margin = None
    return {"duration": baseline.duration, "margin": margin}


def _joint_peaks(problem: Problem, trajectory: Trajectory) -> dict[str, dict[str, float]]:
    """Rates peak at nodes, because accelerations are constant between them."""
    limits = problem.machine.limits
    columns = {
        "peak_rate": np.abs(trajectory.velocities).max(axis=0),
        "rate_limit": limits.velocity,
        "peak_acceleration": np.abs(trajectory.accelerations).max(axis=0),
        "acceleration_limit": limits.acceleration,
    }
    names = trajectory.joint_names
    return {
        name: {key: float(column[i]) for key, column in columns.items()}
        for i, name in enumerate(names)
    }


def summary_table(result: Mapping[str, Any]) -> Table:
    """The motion beside the one that knows no ZMP."""
    baseline = result["phase_plane"] or {}
    table = _table("", "planned", "phase plane")
    table.add_row("duration [s]", _number(result["duration"]), _number(baseline.get("duration")))
    table.add_row("lower bound [s]", _number(result["lower_bound"]))
    if result["success"] and result["lower_bound"] > 0.0:
        table.add_row(
            "above the bound [%]",
            _number(100.0 * (result["duration"] / result["lower_bound"] - 1.0), 2),
        )
    table.add_row("least stability margin [m]", _margin(result), _margin(baseline))
    if result["corner"]:
        table.add_row("the least of all, with", result["corner"])
    table.add_row("SQP iterations", str(result["iterations"]))
    table.add_row("solve time [ms]", _number(1e3 * result["solve_time"], 1))
    table.add_row("QP solver", result["qp_solver"])
    return table


def key_table(values: Mapping[str, float | None]) -> Table:
    """One number per row, by its name."""
    table = _table("", "")
    for name, value in values.items():
        table.add_row(name, _number(value))
    return table


def joint_table(result: Mapping[str, Any], unit: str) -> Table:
    """Peak rates and accelerations beside their limits; `unit` is that of the joint coordinates."""
    table = _table(
        "joint", f"peak rate\n[{unit}/s]", "limit", f"peak acceleration\n[{unit}/s^2]", "limit"
    )
    for name, joint in result["joints"].items():
        table.add_row(name, *(_number(value) for value in joint.values()))
    return table


def history_table(found: Plan) -> Table:
    """One row per iteration of the SQP."""
    table = _table(
        "", "QP solver", "inner", "rows", "objective", "violation", "step", "notes", "ms"
    )
    table.caption = "notes: R relaxed QP, C curvature of the constraints, S second-order correction"
    for record in found.history:
        qp = (record.backend, str(record.inner_iterations), str(record.rows))
        step = (f"{record.objective:.8g}", f"{record.violation:.1e}", f"{record.step:.3g}")
        notes = "R" * record.relaxed + "C" * record.curvature + "S" * record.corrected
        table.add_row(str(record.iteration), *qp, *step, notes, f"{1e3 * record.time:.1f}")
    return table


def _table(first: str, *others: str) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    table.add_column(first, overflow="fold")
    for header in others:
        table.add_column(header, justify="right", overflow="fold")
    return table


def _number(value: float | None, digits: int = 4) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _margin(motion: Mapping[str, Any]) -> str | Text:
    """Unsafe ones in red; a motion that was evaluated and has no margin has left the ground."""
    from rich.text import Text

    if motion.get("duration") is None:
        return "-"
    margin = motion["margin"]
    # no minus sign before zeros
    text = "lifts off" if margin is None else _number(round(margin, 4) + 0.0)
    return Text(text, style="" if margin is not None and round(margin, 4) >= 0.0 else "bold red")


def versions(*extras: str) -> dict[str, str]:
    """Of this program, of Python, of what it stands on, and of these packages."""
    versions = {"zmp-sqp": __version__, "python": platform.python_version()}
    for package in (*PACKAGES, *extras):
        with suppress(metadata.PackageNotFoundError):
            versions[package] = metadata.version(package)
    return versions
