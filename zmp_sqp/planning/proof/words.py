"""Guarantees that do not hold, in words."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from zmp_sqp.planning.constraints.guarantee import Guarantee, amount_in_words
from zmp_sqp.planning.proof.base_check import ARRIVAL

__all__ = ["broken_own", "fault_of", "has_no_value", "limit_fault", "name_in_words"]

TIP_OVER = ("tip_over", "contact")  # names of guarantees whose words need the support polygon
LIMITS = ("joint_limits", "base")


def fault_of(guarantee: Guarantee) -> str:
    """What is wrong, in words that follow "the motion"; empty if the guarantee is kept.

    Args:
        guarantee: Of any constraint but "tip_over" and "contact", which need the polygon's words.
    """
    if guarantee.kept:
        return ""
    if guarantee.name == "base":
        return _base_fault(guarantee)
    at = f"{guarantee.time:.2f} s"
    if guarantee.name == "joint_limits":
        joint, _, limit = guarantee.label.partition(" ")
        short = f"{guarantee.shortfall:.3g} {guarantee.unit}"
        return f"exceeds the {limit} limit of joint {joint!r} by {short} at {at}"
    what = name_in_words(guarantee)
    corner = f" with {guarantee.corner}" if guarantee.corner else ""
    if has_no_value(guarantee):
        return f"comes to states where {what} has no value, near {at}{corner}"
    if not np.isfinite(guarantee.value):
        return f"is not proven to keep {what} at all: no bound is known near {at}{corner}"
    short = amount_in_words(guarantee.shortfall, guarantee.unit)
    return f"breaks {what} by {short} at {at}{corner}"


def has_no_value(guarantee: Guarantee) -> bool:
    """Whether a constraint that is only sampled has no finite value at a sample."""
    return bool(np.isneginf(guarantee.value)) and not guarantee.proven


def name_in_words(guarantee: Guarantee) -> str:
    """Constraint and row, such as "torque_limits (boom torque)"."""
    return f"{guarantee.name} ({guarantee.label})"


def broken_own(guarantees: Iterable[Guarantee]) -> list[Guarantee]:
    """Guarantees of a problem's own constraints that are not kept."""
    return [found for found in guarantees if not (found.kept or found.name in TIP_OVER + LIMITS)]


def limit_fault(guarantees: Iterable[Guarantee]) -> str:
    """The first limit that is not kept, one of a joint before one of the base; empty if all are."""
    broken = [found for found in guarantees if found.name in LIMITS and not found.kept]
    broken.sort(key=lambda found: found.name != "joint_limits")
    return next((fault_of(found) for found in broken), "")


def _base_fault(guarantee: Guarantee) -> str:
    """`fault_of` a guarantee of the base."""
    side, _, what = guarantee.label.partition(" ")
    off = guarantee.shortfall
    if guarantee.label.endswith("_bounds"):
        where = f"{guarantee.label} near {guarantee.time:.3f} s"
        if np.isfinite(off):
            return f"takes the base {off:.3g} m out of its {where}"
        return (
            f"may take the base out of its {where}, where its path is not known well enough: give "
            "more nodes"
        )
    if not what:
        return f"exceeds the base's {guarantee.label} by {off:.3g} {guarantee.unit}"
    verb = {"start": "begins", "goal": "ends"}[side]
    allowed = f"of the base ({ARRIVAL:g} m or rad are allowed)"
    if what == "position":
        return f"{verb} {ARRIVAL + off:.3g} m beside the {side} {allowed}"
    if what == "yaw":
        return f"{verb} turned by {ARRIVAL + off:.3g} rad against the {side} {allowed}"
    rates = "rates of the base that differ from those asked for"
    return f"{verb} with {rates} by {off:.3g} m/s or rad/s"
