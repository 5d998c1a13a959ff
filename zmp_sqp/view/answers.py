"""What the page shows, as JSON: verdict and tables in HTML, and samples of a motion or a pose."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from html import escape
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array, length_text
from zmp_sqp.errors import ZmpSqpError
from zmp_sqp.mechanics import Ground, Machine
from zmp_sqp.mechanics.inspection import PoseReport
from zmp_sqp.mechanics.summary import mass_text
from zmp_sqp.planning import Plan
from zmp_sqp.report.page import GUARANTEE_HEADS, LEAST
from zmp_sqp.report.parts import payload_parts, pose_entries
from zmp_sqp.report.record import body_poses, motion_fields, scene_fields
from zmp_sqp.report.verdict import guarantee_rows, number, rests_on_rows, table, verdict_line
from zmp_sqp.show.basis import Basis, basis_fields
from zmp_sqp.show.guarantees import guarantee_fields
from zmp_sqp.show.results import plan_fields
from zmp_sqp.view.stance import Stance

__all__ = [
    "SAMPLES",
    "plan_answer",
    "pose_answer",
    "pose_record",
    "refusal",
    "unfinished_answer",
]

SAMPLES = 60  # of a motion, beside the ends of its intervals
UNFINISHED = "No motion is certified yet: none was found within {budget:g} s. The search goes on."
NOTHING = "There is nothing to show."
AT_REST = "Shown is the machine at rest at the {pose}; it does not move."


def plan_answer(found: Plan, drawn: Collection[int], *, settled: bool) -> dict[str, Any]:
    """Answer with a plan: a certified motion, or the least-violating one, marked as unsafe.

    Args:
        found: The plan.
        drawn: Indices of the joints whose bodies are drawn, without payloads.
        settled: Whether the search had all the time that it takes.
    """
    problem = found.problem
    result = {
        **plan_fields(found),
        "margin_asked": problem.margin,
        "guarantees": guarantee_fields(found.certificate.guarantees),
        "rests_on": basis_fields(Basis.of_problem(problem)),
    }
    record = None
    if found.attempt is not None:
        try:
            record = _scene(problem.machine, problem.ground, problem.margin, not found.success)
            joints = _joints(drawn, record)
            record["plan"] = motion_fields(problem, found.attempt, joints, SAMPLES)
        except ZmpSqpError:  # a motion that failed may lead off the map
            record = None
    note = escape(str(result["message"])) if found.success else LEAST if record else NOTHING
    return {
        "state": "safe" if found.success else "unsafe",
        "settled": settled,
        "verdict": f'<p class="line">{verdict_line(result)}</p><p>{note}</p>',
        "guarantees_table": table(GUARANTEE_HEADS, guarantee_rows(result)),
        "rests_on_table": table((), rests_on_rows(result)),
        "duration": result["duration"],
        "margin": result["margin"],
        "guarantees": result["guarantees"],
        "record": record,
    }


def unfinished_answer(budget: float) -> dict[str, Any]:
    """Answer of a search that found nothing certified in time, and shall go on."""
    words = UNFINISHED.format(budget=budget)
    return {
        "state": "searching",
        "settled": False,
        "verdict": f'<p class="line"><strong>{words}</strong></p>',
        "record": None,
    }


def refusal(message: str, record: Mapping[str, Any] | None) -> dict[str, Any]:
    """Answer to a question that is refused.

    Args:
        message: Why.
        record: The machine at rest in the pose that the record names; None if there is none.
    """
    note = NOTHING if record is None else AT_REST.format(pose=record["pose"])
    sentence = message[:1].upper() + message[1:]
    return {
        "state": "refused",
        "settled": True,
        "verdict": f'<p class="line"><strong>No safe motion.</strong> {escape(sentence)}</p>'
        f"<p>{note}</p>",
        "record": record,
    }


def pose_answer(
    machine: Machine, stance: Stance, report: PoseReport, drawn: Collection[int], margin: float
) -> dict[str, Any]:
    """Answer with a machine at rest: centre of mass, ZMP, margin and tipping load.

    Args:
        machine: The machine.
        stance: Where it stands.
        report: How it stands.
        drawn: Indices of the joints whose bodies are drawn, without payloads.
        margin: Distance asked for between ZMP and every edge [m].
    """
    record = pose_record(machine, stance, report, drawn, margin)
    tips = record["plan"]["margin"][0] is None or report.margin < 0.0
    return {
        "state": "tips" if tips and machine.support is not None else "rest",
        "settled": True,
        "verdict": f'<p class="line">{_stands(machine, report, margin)}</p>'
        f"<p>{_carries(machine, report)}</p>",
        "margin": record["plan"]["margin"][0],
        "record": record,
    }


def pose_record(
    machine: Machine, stance: Stance, report: PoseReport, drawn: Collection[int], margin: float
) -> dict[str, Any]:
    """Picture of a machine at rest, as a motion of one sample."""
    broken = machine.support is not None and not report.margin >= 0.0
    record = _scene(machine, stance.ground, margin, broken)
    positions, rotations = stance.root(machine)
    record["plan"] = {
        "duration": 0.0,
        "times": [0.0],
        "root": [_placed(positions, rotations)],
        "bodies": body_poses(machine, report.q[None], _joints(drawn, record)),
        "zmp": [_numbers(report.zmp)],
        "margin": [_number(report.margin)],
        "com": [_numbers(report.com)],
        "charts": [],
    }
    return record


def _scene(machine: Machine, ground: Ground, margin: float, broken: bool) -> dict[str, Any]:
    """What stands still in the picture, payloads included; other parts are sent once."""
    scene = scene_fields(machine, ground, margin)
    return {**scene, "payloads": payload_parts(machine), "broken": broken, "blind": None}


def _joints(drawn: Collection[int], record: Mapping[str, Any]) -> list[int]:
    """Indices of all joints whose bodies are drawn."""
    return sorted({*drawn, *(part["joint"] for part in record["payloads"])})


def _placed(position: Array, rotation: Array) -> list[float]:
    return pose_entries(pin.SE3(rotation, position))


def _stands(machine: Machine, report: PoseReport, asked: float) -> str:
    """Whether a machine at rest stands, as HTML."""
    if machine.support is None:
        return "<strong>At rest.</strong> There is no support polygon, so no margin is known."
    if not np.isfinite(report.margin):
        return "<strong>Tips over at rest.</strong> The ground would have to pull."
    edge = escape(report.edge if report.edge.startswith("edge") else f"{report.edge} edge")
    away = number(report.margin, length_text(abs(report.margin)))
    if report.margin < 0.0:
        return (
            f"<strong>Tips over at rest:</strong> the ZMP is {away} outside the {edge} "
            "of the support polygon."
        )
    short = ""
    if report.margin < asked:
        short = f"; that is {length_text(asked - report.margin)} short of the margin asked for"
    return f"<strong>Stands at rest:</strong> the ZMP is {away} from the {edge}{short}."


def _carries(machine: Machine, report: PoseReport) -> str:
    """Centre of mass and tipping load, as HTML."""
    x, y, z = (round(float(entry), 3) + 0.0 for entry in report.com)
    words = f"Centre of mass at ({x:g}, {y:g}, {z:g}) m in the root frame."
    if report.tipping is None or machine.support is None:
        return words
    if not np.isfinite(report.tipping.mass):
        return f"{words} No load at its tip tips it over."
    mass = number(report.tipping.mass, mass_text(report.tipping.mass))
    return f"{words} Largest load at its tip before it tips over at rest: {mass} (no rated load)."


def _number(value: float) -> float | None:
    return round(float(value), 6) if np.isfinite(value) else None


def _numbers(values: Array) -> list[float] | None:
    return np.round(values, 5).tolist() if np.isfinite(values).all() else None
