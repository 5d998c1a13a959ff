"""Positions of points that are fixed to frames of a machine, with their Jacobians."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array, frozen_array
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.workspace import workspace_of

__all__ = ["frame_index", "point_on"]

ROOT_RATES = 6  # columns of the root in Pinocchio's Jacobians


def frame_index(model: Any, name: str, *, purpose: str = "") -> int:
    """Index of a frame of the machine.

    A link takes precedence over a joint of this name: in many URDFs, also in the ones shipped here,
    a joint and its child link share a name.

    Args:
        model: Pinocchio model with a free-flyer root.
        name: Name of the frame.
        purpose: What the frame is for, in words that follow its name in a message.

    Raises:
        MachineError: Unknown frame; the message lists the known frames.
    """
    # joint 0 is the universe, which is no part of the machine
    frames = [(i, frame) for i, frame in enumerate(model.frames) if frame.parentJoint > 0]
    named = [(i, frame) for i, frame in frames if frame.name == name]
    links = [i for i, frame in named if frame.type == pin.FrameType.BODY]
    if not named:
        known = ", ".join(dict.fromkeys(frame.name for _, frame in frames))
        raise MachineError(f"there is no frame {name!r}{purpose}; frames are {known}")
    return links[0] if links else named[0][0]


def point_on(model: Any, frame: str, configurations: Array, offset: Any) -> tuple[Array, Array]:
    """Positions of a point on a frame, root frame, and their Jacobian.

    Args:
        model: Pinocchio model with a free-flyer root.
        frame: Name of the frame.
        configurations: Configurations with the root at the identity, shape (K, nq).
        offset: The point, in the axes of the frame, shape (3,) [m].

    Returns:
        Positions, shape (K, 3) [m], and their Jacobian by all m movable joints, shape (K, 3, m).

    Raises:
        MachineError: Unknown frame, or an offset that is not three numbers.
    """
    index, data = frame_index(model, frame), workspace_of(model).data
    at = frozen_array(offset, name="offset", shape=(3,), error=MachineError)
    count = len(configurations)
    positions, jacobian = np.empty((count, 3)), np.empty((count, 3, model.nv))
    for k, one in enumerate(configurations):
        moved = pin.computeFrameJacobian(model, data, one, index, pin.LOCAL_WORLD_ALIGNED)
        placement = pin.updateFramePlacement(model, data, index)
        arm = placement.rotation @ at
        positions[k] = placement.translation + arm
        jacobian[k] = moved[:3] + np.cross(moved[3:].T, arm).T
    return positions, jacobian[:, :, ROOT_RATES:]
