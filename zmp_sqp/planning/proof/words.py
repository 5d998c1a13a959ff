"""Guarantees that do not hold, in words."""

from __future__ import annotations

import numpy as np

from zmp_sqp.planning.constraints.guarantee import Guarantee
from zmp_sqp.planning.proof.base_check import ARRIVAL

__all__ = ["fault_of"]


def fault_of(guarantee: Guarantee) -> str:
    """What is wrong, in words that follow "the motion"; empty if the guarantee is kept.

    Args:
        guarantee: Of any constraint but "tip_over" and "contact", which need the polygon's words.
    """
    if guarantee.kept:
        return ""
    if guarantee.name == "base":
        return _base_fault(guarantee)
    short, at = f"{guarantee.shortfall:.3g} {guarantee.unit}".strip(), f"{guarantee.time:.2f} s"
    if guarantee.name == "joint_limits":
        joint, _, limit = guarantee.label.partition(" ")
        return f"exceeds the {limit} limit of joint {joint!r} by {short} at {at}"
    what = f"{guarantee.name} ({guarantee.label})"
    if not np.isfinite(guarantee.value):
        return f"has no provable bound on {what}: near {at} its value may be anything"
    seen = "breaks" if guarantee.proven else "breaks (sampled)"
    corner = f" with {guarantee.corner}" if guarantee.corner else ""
    return f"{seen} {what} by {short} at {at}{corner}"


def _base_fault(guarantee: Guarantee) -> str:
    side, _, what = guarantee.label.partition(" ")
    off = guarantee.shortfall
    if guarantee.label.endswith("_bounds"):
        where = f"{guarantee.label} near {guarantee.time:.3f} s"
        if np.isfinite(off):
            return f"takes the base {off:.3g} m out of its {where}"
        return (
            f"may take the base out of its {where}: its path is not known well enough there, "
            "give more nodes"
        )
    if not what:
        return f"exceeds the base's {guarantee.label} by {off:.3g} {guarantee.unit}"
    verb = {"start": "begins", "goal": "ends"}[side]
    allowed = f"of the base ({ARRIVAL:g} m and rad count as there)"
    if what == "position":
        return f"{verb} {ARRIVAL + off:.3g} m beside the {side} {allowed}"
    if what == "yaw":
        return f"{verb} turned by {ARRIVAL + off:.3g} rad against the {side} {allowed}"
    return f"{verb} with other rates of the base than asked for: off by {off:.3g} m/s or rad/s"
