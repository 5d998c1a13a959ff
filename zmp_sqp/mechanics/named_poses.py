"""Poses of a machine that have a name: those it came with, zero, and the middle of its limits."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.machine import Machine

__all__ = ["MIDDLE", "ZERO", "named_poses"]

ZERO, MIDDLE = "zero", "middle"


def named_poses(machine: Machine) -> dict[str, Array]:
    """Joint coordinates by name of the pose, shape (n,) each [rad or m].

    The states of the machine's SRDF that name all planned joints come first, in their order. 'zero'
    has all coordinates at zero, or at the limit nearest to it; 'middle' has them in the middle of
    their limits, and where a joint has no limits at zero. A state of the SRDF with one of these
    names takes its place.
    """
    lower, upper = machine.limits.position_lower, machine.limits.position_upper
    low, high = (
        np.where(np.isnan(values), side, values)
        for values, side in zip((lower, upper), (-np.inf, np.inf), strict=True)
    )
    zero = np.clip(np.zeros(machine.size), low, high)
    bounded = np.isfinite(low) & np.isfinite(high)
    middle = zero.copy()
    middle[bounded] = 0.5 * (low[bounded] + high[bounded])
    found = {
        name: machine.pose(name)
        for name, pose in machine.poses.items()
        if all(joint in pose for joint in machine.joint_names)
    }
    for name, pose in ((ZERO, zero), (MIDDLE, middle)):
        found.setdefault(name, pose)
    return found
