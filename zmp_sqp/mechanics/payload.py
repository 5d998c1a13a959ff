"""A body that the machine carries, such as a felled tree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array, finite_number, frozen_array, set_frozen_state
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.frame_points import frame_index
from zmp_sqp.mechanics.inertia import checked_inertia

__all__ = ["Payload"]

# [kg] and [m] largest mass and distance: beyond them, products of masses and squared distances
# leave too few of the digits of a float
HEAVIEST, FARTHEST = 1e12, 1e5


@dataclass(frozen=True, slots=True, eq=False)
class Payload:
    """Rigid body fixed to one frame of the machine.

    Attributes:
        mass: Mass [kg].
        com: Centre of mass in the frame that carries the payload, shape (3,) [m].
        frame: Name of the link (or other frame) that carries the payload.
        inertia: Rotational inertia about the payload's centre of mass, in the axes of the frame
            that carries it, shape (3, 3) [kg m^2]; None is a point mass.

    Raises:
        MachineError: Mass not positive or above 1e12 kg, a centre of mass farther than 1e5 m,
            anything not finite, or an inertia that no body can have.
    """

    mass: float
    com: Array
    frame: str
    inertia: Array | None = None

    __setstate__ = set_frozen_state

    def __post_init__(self) -> None:
        mass = finite_number(self.mass, name="payload mass", error=MachineError)
        if mass <= 0.0:
            raise MachineError(f"payload mass must be positive, not {mass} kg")
        if mass > HEAVIEST:
            raise MachineError(f"payload mass must be at most {HEAVIEST:g} kg, not {mass:g} kg")
        if not isinstance(self.frame, str):
            raise MachineError(f"payload frame must be the name of a link, not {self.frame!r}")
        com = frozen_array(self.com, name="payload com", shape=(3,), error=MachineError)
        if np.abs(com).max() > FARTHEST:
            raise MachineError(f"payload com must lie within +-{FARTHEST:g} m, not {com.tolist()}")
        object.__setattr__(self, "mass", mass)
        object.__setattr__(self, "com", com)
        if self.inertia is not None:
            inertia = checked_inertia(self.inertia, name="payload inertia", semidefinite=True)
            object.__setattr__(self, "inertia", inertia)

    def attached_to(self, model: Any) -> Any:
        """Copy of a Pinocchio model to which this payload is attached.

        The payload becomes a frame with its own inertia, so that `Machine.with_point_masses` can
        tell it from the link that carries it.

        Args:
            model: Pinocchio model; it is not changed.

        Raises:
            MachineError: Unknown frame; the message lists the known frames.
        """
        index = frame_index(model, self.frame, purpose=" to carry the payload")
        carrier = model.frames[index]
        inertia = pin.Inertia(
            self.mass, self.com, np.zeros((3, 3)) if self.inertia is None else self.inertia
        )
        names = {frame.name for frame in model.frames}
        count = next(i for i in range(1, len(names) + 2) if f"payload {i}" not in names)
        loaded = model.copy()
        loaded.addFrame(
            pin.Frame(
                f"payload {count}",
                carrier.parentJoint,
                index,
                carrier.placement,
                pin.FrameType.OP_FRAME,
                inertia,
            ),
            True,  # adds the inertia to the joint that moves the frame
        )
        return loaded
