"""Whether the nodes of a motion follow from its accelerations over many nodes."""

from __future__ import annotations

import numpy as np

from zmp_sqp.motion.trajectory import Trajectory

__all__ = ["drift_fault"]

# [rad/s or m/s, rad or m] largest total by which nodes may deviate from the integrated motion
DRIFT = 1e-6
OPERATIONS = 100.0  # rounding errors that add up from node to node, with a factor to spare
EPSILON = float(np.finfo(float).eps)


def drift_fault(trajectory: Trajectory) -> str:
    """What drifts away from the integrated accelerations, in words; empty if nothing does.

    `Trajectory` tolerates a small difference at every node. Over many nodes these differences would
    add up to an acceleration that no bound accounts for.
    """
    q, v, _ = trajectory.state_in(np.arange(trajectory.intervals), np.diff(trajectory.times))
    followed = [("velocities", trajectory.velocities, v), ("positions", trajectory.positions, q)]
    if (base := trajectory.base) is not None:
        pose, velocity, _ = base.state_in(np.arange(trajectory.intervals), np.diff(base.times))
        followed += [
            ("base velocities", base.velocities, velocity),
            ("base poses", base.poses, pose),
        ]
    for name, values, reached in followed:
        with np.errstate(all="ignore"):
            drifts = np.cumsum(values[1:] - reached, axis=0)
            drift = float((drifts.max(axis=0).clip(0.0) - drifts.min(axis=0).clip(None, 0.0)).max())
            allowed = DRIFT + OPERATIONS * EPSILON * float(np.abs(values).sum(axis=0).max())
        if not drift <= allowed:
            return f"{name} drift by {drift:.3g} away from what the accelerations produce"
    return ""
