"""Verdict of `zmp-sqp check`: its faults, its numbers, its sentence."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import finite_number
from zmp_sqp.commands.check_motion import ends_in_motion, finite, limit_faults
from zmp_sqp.commands.check_question import Question
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.motion.reading import RecordedMotion
from zmp_sqp.planning import Certificate
from zmp_sqp.planning.problem.zmp_words import zmp_position
from zmp_sqp.planning.proof.limits_in_time import LimitPeak
from zmp_sqp.planning.proof.words import broken_own, fault_of
from zmp_sqp.show.tables import key_table

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "boundary_faults",
    "certificate_faults",
    "check_table",
    "checked_share",
    "limit_fields",
    "verdict",
]


def checked_share(share: float | None) -> float | None:
    """Value of `--limit-tolerance`.

    Raises:
        ProblemError: It is not a number from 0 to 1.
    """
    if share is None:
        return None
    share = finite_number(share, name="--limit-tolerance", error=ProblemError)
    if not 0.0 <= share <= 1.0:
        raise ProblemError(f"--limit-tolerance must lie within [0, 1], not {share:g}")
    return share


def boundary_faults(
    question: Question, read: RecordedMotion, arguments: argparse.Namespace
) -> tuple[list[str], list[str]]:
    """Ends in motion that were allowed, in words, and faults of those that were not.

    A scenario whose own start or goal is in motion allows it.
    """
    words, faults = [], []
    problem = question.problem
    for side, option, key in (
        (0, "starts", "start_velocity"),
        (-1, "ends", "goal_velocity"),
    ):
        rounding = read.samples.error_of("velocity")
        moving = ends_in_motion(read.trajectory, side, rounding, question.machine)
        if not moving:
            continue
        asked = problem is not None and (
            bool(getattr(problem, key).any())
            or (problem.base is not None and bool(np.any(getattr(problem.base, key))))
        )
        if asked or getattr(arguments, f"{option}_in_motion"):
            words.append(f"{moving}, as allowed")
        else:
            faults.append(f"the motion {moving} (--{option}-in-motion allows it)")
    return words, faults


def certificate_faults(
    found: Certificate, support: SupportPolygon, peaks: Sequence[LimitPeak]
) -> list[str]:
    """What is not guaranteed, one clause each.

    Args:
        found: The certificate.
        support: Support polygon of the machine.
        peaks: Largest values beside the joint limits.
    """
    reasons, required = [], max(found.required, 0.0)
    extreme = f" with {found.corner}" if found.corner else ""
    if not np.isfinite(found.sampled):
        reasons.append(
            f"at {found.margin_at:.2f} s the ground would have to hold the machine down{extreme}"
        )
    elif not np.isfinite(found.margin):
        reasons.append(f"no margin is proven{extreme}: {found.doubt}")
    elif found.margin < required:
        modal = "" if found.sampled < required else "may"
        where = zmp_position(
            support, found.edge, distance=found.margin, margin=required, modal=modal
        )
        reasons.append(f"at {found.margin_at:.2f} s the ZMP {where}{extreme}")
    faults = [fault_of(broken) for broken in broken_own(found.guarantees)]
    of_base = [row for row in found.guarantees if row.name == "base" and not row.kept]
    faults += limit_faults(peaks) + [fault_of(row) for row in of_base[:1]]
    reasons += [f"the motion {fault}" for fault in faults]
    if not (reasons or found.safe):
        reasons.append("the ground would have to pull at the machine")
    return reasons


def limit_fields(peaks: Sequence[LimitPeak]) -> list[dict[str, Any]]:
    """Largest values beside the joint limits, for JSON; None where there is no limit."""
    return [
        {
            key: finite(value) if isinstance(value, float) else value
            for key, value in asdict(peak).items()
        }
        for peak in peaks
    ]


def check_table(result: Mapping[str, Any]) -> Table:
    """Numbers of the result, one per row."""

    def scaled(key: str, factor: float) -> float | None:
        return None if result[key] is None else factor * result[key]

    return key_table(
        {
            "guaranteed margin [m]": result["margin"],
            "asked for [m]": result["required"],
            f"least sampled margin [m], at the {result['edge']} edge": result["sampled"],
            "at [s]": result["margin_at"],
            "duration [s]": result["duration"],
            "above the bound of joints and base [%]": scaled("gap", 100.0),
            "largest load transfer ratio": result["load_transfer_ratio"],
            "least force angle [rad]": result["force_angle"],
            "least tip-over energy [kJ]": scaled("tip_over_energy", 1e-3),
        }
    )


def verdict(result: Mapping[str, Any]) -> str:
    """One sentence: safe, or what is not."""
    if not result["safe"]:
        return f"Not safe: {result['fault']}."
    worst = f"; the margin is least with {result['corner']}" if result["corner"] else ""
    sampled = [found["name"] for found in result["guarantees"] if not found["proven"]]
    but = f"; not proven, but safe at 2000 samples a second: {', '.join(sampled)}"
    return f"Safe at all times{worst}{but if sampled else ''}."
