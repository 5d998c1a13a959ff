"""Short text about a machine: what `print(machine)` shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.limits import JointLimits
from zmp_sqp.mechanics.support import SupportPolygon

__all__ = ["MISSING", "aligned", "held_lines", "joint_lines", "mass_text", "support_text"]

COLUMNS = ("position_lower", "position_upper", "velocity", "acceleration", "effort")
HEADS = ("joint", "unit", "lower", "upper", "velocity", "acceleration", "effort")
MISSING, UNLIMITED = "missing", "none"  # shown for NaN and for infinity
MOST_HELD = 8  # held joints that are listed one by one
MOST_VERTICES = 6  # of a support polygon that are listed one by one


def joint_lines(names: Sequence[str], units: Sequence[str], limits: JointLimits) -> list[str]:
    """One line of text per joint, under a line of column heads, in aligned columns.

    Args:
        names: Names of the n joints.
        units: Unit of each joint coordinate, "rad" or "m".
        limits: Limits in these units, per second and per second squared; efforts in N m or N.
    """
    rows: list[Sequence[str]] = [HEADS]
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        rows.append((name, unit, *(_limit_text(getattr(limits, key)[i]) for key in COLUMNS)))
    return aligned(rows, left=(0, 1))


def held_lines(held: Mapping[str, float]) -> list[str]:
    """One line about the joints that are held; none if no joint is.

    Args:
        held: Coordinates by joint [rad or m].
    """
    if not held:
        return []
    shown = [f"{name} at {value + 0.0:.4g}" for name, value in held.items()][:MOST_HELD]
    more = f" and {len(held) - MOST_HELD} more" if len(held) > MOST_HELD else ""
    return [f"held: {', '.join(shown)}{more}"]


def aligned(rows: Sequence[Sequence[str]], *, left: Sequence[int]) -> list[str]:
    """One line per row with cells in columns, left-aligned in the columns `left`, else right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if i in left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def _limit_text(value: float) -> str:
    """A limit in four significant digits; 'missing' for NaN, 'none' for infinity."""
    if np.isnan(value):
        return MISSING
    return f"{value:.4g}" if np.isfinite(value) else UNLIMITED


def mass_text(mass: float) -> str:
    """A mass with its unit, in as many digits as it takes: 23650 kg, 18.4 kg, 0.52 kg."""
    digits = 0 if mass >= 1000.0 else 1 if mass >= 10.0 else 2
    return f"{mass:.{digits}f} kg"


def support_text(support: SupportPolygon | None) -> str:
    """Size and place of a support polygon in one line."""
    if support is None:
        return "support polygon: none (give one by support=...)"
    low, high = support.vertices.min(axis=0), support.vertices.max(axis=0)
    corners = len(support.vertices)
    shape = f"{corners} corners" if corners > MOST_VERTICES else _listed(support.vertices)
    return (
        f"support polygon: {high[0] - low[0]:.3g} m along x (forward), "
        f"{high[1] - low[1]:.3g} m along y (left), at z = {support.height:.3g} m; {shape}"
    )


def _listed(vertices: Array) -> str:
    return "corners " + ", ".join(f"({x:.3g}, {y:.3g})" for x, y in vertices + 0.0)
