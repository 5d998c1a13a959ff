"""Polygons and limits that look like another unit: millimetres for metres, degrees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.mechanics.limits import JointLimits
from zmp_sqp.mechanics.support import SupportPolygon

__all__ = ["doubtful_limits", "doubtful_support", "machine_size"]

# times the machine's own size beyond which a length looks like millimetres
FAR = 100.0
HEAVY_MACHINE = 500.0  # [kg] from which on joints are slow
# [rad] and [rad/s] beyond which limits of turning joints look like degrees; more than the former's
# upper bound stands for "no limit" in many URDFs. The latter is for heavy machines only.
TURNS, WITHOUT_END = 8.0 * np.pi, 750.0
FAST, WITHOUT_LIMIT = 15.0, 90.0


def machine_size(model: Any) -> float:
    """Largest distance of a link's origin or centre of mass from the root's origin [m].

    All joints are at zero; the lengths by which prismatic joints extend it are not known here.
    """
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    points = [
        point
        for frame, placement in zip(model.frames, data.oMf, strict=True)
        if frame.type == pin.FrameType.BODY
        for point in (placement.translation, placement.act(frame.inertia.lever))
    ]
    return float(np.linalg.norm(points, axis=1).max()) if points else 0.0


def doubtful_support(support: SupportPolygon | None, size: float) -> str:
    """Sentence about a support polygon that is far too large; empty if it looks right.

    Args:
        support: The polygon.
        size: Size of the machine, see `machine_size` [m].
    """
    if support is None or size <= 0.0 or support.reach <= FAR * size:
        return ""
    return (
        f"the support polygon reaches {support.reach:.6g} m from the root, the machine itself "
        f"{size:.3g} m: if lengths are in millimetres, divide them by 1000"
    )


def doubtful_limits(
    names: Sequence[str], units: Sequence[str], limits: JointLimits, machine_mass: float
) -> str:
    """Sentence about limits of turning joints that look like degrees; empty if there are none.

    Args:
        names, units: Names and units of the n joints; only those in "rad" are looked at.
        limits: Their limits.
        machine_mass: Mass of the machine [kg].
    """
    found = []
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        if unit != "rad":
            continue
        ends = (limits.position_lower[i], limits.position_upper[i])
        far = max(abs(end) if np.isfinite(end) else 0.0 for end in ends)
        if TURNS < far <= WITHOUT_END:
            found.append(f"joint {name!r} may turn to {far:.6g} rad")
        elif machine_mass >= HEAVY_MACHINE and FAST < limits.velocity[i] <= WITHOUT_LIMIT:
            found.append(f"joint {name!r} may turn at {limits.velocity[i]:.6g} rad/s")
    if not found:
        return ""
    more = f" and {len(found) - 2} more" if len(found) > 2 else ""
    return f"{', '.join(found[:2])}{more}: limits are in radians, these look like degrees"
