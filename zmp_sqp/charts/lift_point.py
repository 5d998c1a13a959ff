"""What a load chart lifts, and at which frame."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.errors import GIVE_SUPPORT, MachineError
from zmp_sqp.mechanics import Ground, Machine, Payload
from zmp_sqp.mechanics.ground import check_ground

__all__ = ["carried_links", "check_machine", "unit_payload"]


def check_machine(machine: Machine, ground: Ground) -> None:
    """Refuse arguments that are no machine with a support polygon, or no ground.

    Raises:
        MachineError: The message says which.
    """
    if not isinstance(machine, Machine):
        raise MachineError(
            f"machine must be a Machine (see load_machine), not {type(machine).__name__}"
        )
    check_ground(ground, MachineError)
    if machine.support is None:
        raise MachineError(
            f"machine {machine.name!r} has no support polygon: {GIVE_SUPPORT.arguments}"
        )


def unit_payload(machine: Machine, frame: str | None, com: Any) -> Payload:
    """Load of 1 kg at the frame that is given, or at that of the machine's only payload.

    Args:
        machine: The machine.
        frame: Frame that carries the load; None takes that of the payload, and its inertia.
        com: Centre of mass in that frame, shape (3,) [m]; None takes that of the payload, or the
            origin of a frame that is given.

    Raises:
        MachineError: No frame is given, and the machine does not carry exactly one payload.
    """
    if frame is not None:
        return Payload(1.0, np.zeros(3) if com is None else com, frame)
    carried = machine.payloads
    if len(carried) != 1:
        raise MachineError(
            f"machine {machine.name!r} carries {len(carried)} payloads: say which frame lifts the "
            "load, by frame=... (--payload-frame)"
        )
    only = carried[0]
    inertia = None if only.inertia is None else only.inertia / only.mass
    return Payload(1.0, only.com if com is None else com, only.frame, inertia)


def carried_links(machine: Machine, frame: str) -> tuple[str, ...]:
    """Links with a mass that a frame's link carries, or that link itself if it carries none.

    A bucket that hangs at the stick is the attachment of a lift point at the stick, and of one at
    the bucket.

    Raises:
        MachineError: There is no such frame.
    """
    frames = list(machine.model.frames)
    loaded = Payload(1.0, np.zeros(3), frame).attached_to(machine.model)
    below = {int(loaded.frames[-1].parentFrame)}
    for index, one in enumerate(frames):  # parents come before children
        if one.parentFrame in below:
            below.add(index)
    first = min(below)
    found = [
        frames[index].name
        for index in sorted(below)
        if frames[index].type == pin.FrameType.BODY and frames[index].inertia.mass > 0.0
    ]
    return tuple([name for name in found if name != frames[first].name] or found)
