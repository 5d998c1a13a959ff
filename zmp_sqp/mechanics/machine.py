"""The machine: a Pinocchio model on a free-flyer root, with its limits and its support polygon."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array, Indices, finite_number, frozen_array
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.limits import JointLimits
from zmp_sqp.mechanics.payload import Payload
from zmp_sqp.mechanics.support import SupportPolygon

__all__ = ["Machine"]


@dataclass(frozen=True, slots=True, eq=False)
class Machine:
    """A machine that stands on the ground: n planned joints on an undercarriage.

    The model hangs on a free-flyer root, so that the undercarriage's mass counts (Pinocchio leaves
    the root link's mass out of a fixed-base model) and so that the first six rows of its inverse
    dynamics are the ground reaction wrench. Its own gravity is zero: gravity enters as an
    acceleration of the root.

    Attributes:
        name: The robot's name in the URDF.
        model: Pinocchio model, with the inertia of each link in the link's frame; do not change it
            in place.
        joint_names: The n planned joints, in the order of the URDF file.
        limits: Position, velocity, acceleration and effort limits, each of shape (n,).
        support: Support polygon in the root frame, or None if the URDF shows none.
        index_q: Where each joint's coordinate stands in Pinocchio's q, shape (n,).
        index_v: Where each joint's rate stands in Pinocchio's v, shape (n,).
        continuous: Which joints are continuous: Pinocchio keeps (cos, sin) of those, shape (n,).
    """

    name: str
    model: Any = field(repr=False)
    joint_names: tuple[str, ...]
    limits: JointLimits
    support: SupportPolygon | None
    index_q: Indices = field(repr=False)
    index_v: Indices = field(repr=False)
    continuous: tuple[bool, ...] = field(repr=False)

    @property
    def size(self) -> int:
        """Number n of planned joints."""
        return len(self.joint_names)

    @property
    def mass(self) -> float:
        """Total mass, undercarriage and payload included [kg]."""
        return float(sum(inertia.mass for inertia in self.model.inertias))

    def configuration(self, q: Array) -> Array:
        """Pinocchio's configurations of joint angles, the root at the identity.

        Args:
            q: Joint coordinates, shape (K, n) [rad or m].

        Returns:
            Shape (K, nq).
        """
        full = np.zeros((q.shape[0], self.model.nq))
        full[:, 6] = 1.0  # unit quaternion (0, 0, 0, 1) of the root
        full[:, self.index_q] = q
        for column, at in zip(
            np.flatnonzero(self.continuous), self.index_q[list(self.continuous)], strict=True
        ):
            full[:, at], full[:, at + 1] = np.cos(q[:, column]), np.sin(q[:, column])
        return full

    @property
    def joint_units(self) -> tuple[str, ...]:
        """Of each joint's coordinate: "rad" where it turns, "m" where it slides."""
        kinds = (
            self.model.joints[self.model.getJointId(name)].shortname() for name in self.joint_names
        )
        # PX, PY, PZ, PrismaticUnaligned
        return tuple("m" if kind.startswith("JointModelP") else "rad" for kind in kinds)

    def with_payload(self, payload: Payload) -> Machine:
        """The same machine with a payload fixed to one of its frames.

        Raises:
            MachineError: Unknown frame; the message lists the frames there are.
        """
        if not isinstance(payload, Payload):
            raise MachineError(f"payload must be a Payload, not {type(payload).__name__}")
        return replace(self, model=payload.attached_to(self.model))

    @property
    def payload_mass(self) -> float:
        """Mass of everything that `with_payload` has attached [kg]."""
        return float(sum(frame.inertia.mass for frame in _payloads(self.model)))

    def with_payload_scaled(self, factor: float) -> Machine:
        """The same machine with mass and inertia of all its payloads times a factor; zero leaves massless ones.

        Raises:
            MachineError: The factor is negative or not a number.
        """
        factor = finite_number(factor, name="payload factor", error=MachineError)
        if factor < 0.0:
            raise MachineError(f"payload factor must not be negative, not {factor}")
        model = self.model.copy()
        for frame in _payloads(model):
            body = frame.inertia
            frame.inertia = pin.Inertia(factor * body.mass, body.lever, factor * body.inertia)
        for joint in {frame.parentJoint for frame in _payloads(self.model)}:
            model.inertias[joint] = _sum_of_frames(model, joint)
        return replace(self, model=model)

    def with_payload_moved(self, offset: Any) -> Machine:
        """The same machine with the centre of mass of its only payload elsewhere, and the inertia about it unchanged.

        Args:
            offset: From where it is, in the axes of the frame that carries it, shape (3,) [m].

        Raises:
            MachineError: No payload or several, or an offset that is not three finite numbers.
        """
        offset = frozen_array(offset, name="payload offset", shape=(3,), error=MachineError)
        model = self.model.copy()
        carried = _payloads(model)
        if len(carried) != 1:
            raise MachineError(
                f"machine {self.name!r} carries {len(carried)} payloads; to move one needs just one"
            )
        body = carried[0].inertia
        carried[0].inertia = pin.Inertia(body.mass, body.lever + offset, body.inertia)
        joint = carried[0].parentJoint
        model.inertias[joint] = _sum_of_frames(model, joint)
        return replace(self, model=model)

    @property
    def payload_count(self) -> int:
        """Number of bodies that `with_payload` has attached."""
        return len(_payloads(self.model))

    def with_limits(self, *, velocity: Any = None, acceleration: Any = None) -> Machine:
        """The same machine with other velocity or acceleration limits; None keeps what it has.

        Args:
            velocity: Scalar, shape (n,), or a mapping from joint names to numbers [rad/s or m/s].
            acceleration: Likewise [rad/s^2 or m/s^2].

        Raises:
            MachineError: Wrong shape, unknown joint, or a limit that is not positive.
        """
        given = {"velocity": velocity, "acceleration": acceleration}
        changes: Mapping[str, Any] = {
            key: value for key, value in given.items() if value is not None
        }
        return replace(self, limits=self.limits.updated(changes, self.joint_names))

    def with_support(self, support: SupportPolygon) -> Machine:
        """The same machine on another support polygon."""
        if not isinstance(support, SupportPolygon):
            raise MachineError(f"support must be a SupportPolygon, not {type(support).__name__}")
        return replace(self, support=support)

    def with_point_masses(self) -> Machine:
        """The same machine with every body a point mass at its own centre of mass: Song & Sharf 2020, eq. (5).

        Bodies fixed to one another (a link and its payload) stay apart: each is a point of its own.
        Pinocchio lumps them into the joint that moves them, but the frame of each link and payload
        still holds its own inertia.
        """
        model = self.model.copy()
        for frame in model.frames:
            frame.inertia = pin.Inertia(frame.inertia.mass, frame.inertia.lever, np.zeros((3, 3)))
        for joint in range(1, model.njoints):
            model.inertias[joint] = _sum_of_frames(model, joint)
        return replace(self, model=model)


def _sum_of_frames(model: Any, joint: int) -> Any:
    """Inertia of all that a joint moves up to the next one: Pinocchio lumps it, but frames keep their own."""
    total = pin.Inertia.Zero()
    for frame in model.frames:
        if frame.parentJoint == joint:
            total += frame.placement.act(frame.inertia)
    return total


def _payloads(model: Any) -> list[Any]:
    """Frames of the payloads: those with an inertia that are no link."""
    return [
        frame
        for frame in model.frames
        if frame.type == pin.FrameType.OP_FRAME and frame.inertia.mass > 0.0
    ]
