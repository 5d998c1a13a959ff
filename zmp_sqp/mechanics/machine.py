"""The machine: a Pinocchio model on a free-flyer root, with joint limits and support polygon."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array, Indices, finite_number, frozen_array
from zmp_sqp.errors import MachineError, warn_of_machine
from zmp_sqp.mechanics.frame_points import point_on
from zmp_sqp.mechanics.joint_coupling import JointCoupling
from zmp_sqp.mechanics.likely_units import doubtful_support, machine_size
from zmp_sqp.mechanics.limits import JointLimits
from zmp_sqp.mechanics.payload import Payload
from zmp_sqp.mechanics.plausible_payload import payload_doubts
from zmp_sqp.mechanics.summary import held_lines, joint_lines, mass_text, support_text
from zmp_sqp.mechanics.support import SupportPolygon

__all__ = ["Machine"]

ROOT = 6  # number of rates of the root's free-flyer joint, which come first in Pinocchio's v


@dataclass(frozen=True, slots=True, eq=False)
class Machine:
    """Mobile manipulator on the ground: an undercarriage that carries n planned joints.

    The root link is attached to the world by a free-flyer joint for two reasons: the mass of the
    undercarriage counts (Pinocchio drops the root link's mass from a fixed-base model), and the
    first six rows of the inverse dynamics are the ground reaction wrench. Gravity in the model is
    zero; it enters as an acceleration of the root.

    Attributes:
        name: Name of the robot in the URDF.
        model: Pinocchio model; every frame of a link or payload holds the inertia of that body. Do
            not change it in place.
        joint_names: The n planned joints, in the order of the URDF file.
        limits: Position, velocity, acceleration and effort limits, each of shape (n,).
        support: Support polygon in the root frame, or None if none is known.
        coupling: Map from the planned joints to all movable joints of the model; the others mimic
            planned ones.
        held: Coordinates of the joints of the URDF that are held, by name [rad or m].
        poses: Joint coordinates by joint, by name of the pose: the group states of the SRDF.
        support_hint: How to give a support polygon where there is none; empty if it is not known.
        wheels: Planned joints that turn wheels on which the machine stands: better held.
    """

    name: str
    model: Any = field(repr=False)
    joint_names: tuple[str, ...]
    limits: JointLimits
    support: SupportPolygon | None
    coupling: JointCoupling = field(repr=False)
    held: Mapping[str, float] = field(default_factory=dict, repr=False)
    poses: Mapping[str, Mapping[str, float]] = field(default_factory=dict, repr=False)
    support_hint: str = field(default="", repr=False)
    wheels: tuple[str, ...] = field(default=(), repr=False)

    def __str__(self) -> str:
        """Name, mass, support polygon, planned joints with units and limits, and held joints."""
        carried = self.payload_mass
        load = f", of which {mass_text(carried)} payload" if carried > 0.0 else ""
        joints = f"{self.size} planned joint{'' if self.size == 1 else 's'}"
        return "\n".join(
            (
                f"{self.name}: {mass_text(self.mass)}{load}, {joints}",
                support_text(self.support),
                *joint_lines(self.joint_names, self.joint_units, self.limits),
                *held_lines(self.held),
            )
        )

    @property
    def size(self) -> int:
        """Number n of planned joints."""
        return len(self.joint_names)

    @property
    def mass(self) -> float:
        """Total mass, including undercarriage and payloads [kg]."""
        return float(pin.computeTotalMass(self.model))

    @property
    def unplanned(self) -> frozenset[str]:
        """Names of the joints of the URDF that do not move: those that are held or fixed."""
        return frozenset(
            frame.name for frame in self.model.frames if frame.type == pin.FrameType.FIXED_JOINT
        )

    def pose(self, name: str) -> Array:
        """Coordinates of the planned joints in one of the `poses`, shape (n,) [rad or m].

        Raises:
            MachineError: There is no such pose, or it lacks planned joints; the message names them.
        """
        if name not in self.poses:
            raise MachineError(
                f"machine {self.name!r} has no pose {name!r}; poses are "
                f"{', '.join(self.poses) or 'none (they are group states of an SRDF)'}"
            )
        missing = [joint for joint in self.joint_names if joint not in self.poses[name]]
        if missing:
            raise MachineError(
                f"pose {name!r} has no coordinate for joint {', '.join(map(repr, missing))}"
            )
        return np.array([self.poses[name][joint] for joint in self.joint_names])

    def point(self, frame: str, q: Array, offset: Any = (0.0, 0.0, 0.0)) -> tuple[Array, Array]:
        """Positions of a point that is fixed to a frame, and their Jacobian by the joints.

        For constraints of your own (`PathRows`), such as a boom that shall stay below wires.

        Args:
            frame: Name of a link or another frame.
            q: Joint coordinates, shape (K, n) [rad or m].
            offset: The point, in the axes of the frame, shape (3,) [m].

        Returns:
            Positions in the root frame, shape (K, 3) [m], and their Jacobian by the planned joints,
            with those that mimic them, shape (K, 3, n).

        Raises:
            MachineError: Unknown frame (the message lists the links), or a wrong shape.
        """
        states = np.asarray(q, dtype=float)
        if states.ndim != 2 or states.shape[1] != self.size:
            raise MachineError(f"q must have shape (K, {self.size}), not {states.shape}")
        found, by_all = point_on(self.model, frame, self.configuration(states), offset)
        return found, self.coupling.columns(by_all)

    def configuration(self, q: Array) -> Array:
        """Pinocchio configurations of joint coordinates, with the root pose at the identity.

        Args:
            q: Joint coordinates, shape (K, n) [rad or m].

        Returns:
            Configuration vectors, shape (K, nq).
        """
        full = np.zeros((q.shape[0], self.model.nq))
        full[:, 6] = 1.0  # unit quaternion (0, 0, 0, 1) of the root
        positions = self.coupling.positions(q)
        full[:, self.coupling.index_q] = positions
        for row in self.coupling.continuous:
            at, angle = self.coupling.index_q[row], positions[:, row]
            full[:, at], full[:, at + 1] = np.cos(angle), np.sin(angle)
        return full

    @property
    def index_q(self) -> Indices:
        """Index of each planned joint's own coordinate in Pinocchio's q, shape (n,).

        A continuous joint has two entries there, cos and sin; this is the index of the first.
        """
        return np.asarray(self.coupling.index_q[self.coupling.own])

    @property
    def index_v(self) -> Indices:
        """Index of each planned joint's own rate in Pinocchio's v, shape (n,)."""
        return np.asarray(ROOT + self.coupling.own)

    @property
    def continuous(self) -> tuple[bool, ...]:
        """Whether each planned joint is continuous (turns without limits), shape (n,)."""
        return tuple(int(row) in self.coupling.continuous for row in self.coupling.own)

    @property
    def mimics(self) -> dict[str, tuple[str, float, float]]:
        """Planned joint, multiplier and offset of each joint that follows one, by its name."""
        coupling, names = self.coupling, list(self.model.names)[2:]
        own = set(coupling.own.tolist())
        return {
            names[row]: (
                self.joint_names[coupling.leader[row]],
                float(coupling.multiplier[row]),
                float(coupling.offset[row]),
            )
            for row in range(len(names))
            if row not in own
        }

    def mimics_of(self, joint: str) -> tuple[str, ...]:
        """Names of the joints that move with a planned joint, which they mimic."""
        every = self.mimics.items()
        return tuple(name for name, (leader, by, _) in every if leader == joint and by != 0.0)

    @property
    def joint_units(self) -> tuple[str, ...]:
        """Unit of each joint coordinate: "rad" for a joint that turns, "m" for one that slides."""
        return _joint_units(self)

    def with_payload(self, payload: Payload) -> Machine:
        """Copy of this machine that carries one more payload, fixed to one of its frames.

        A payload whose mass or distance looks like another unit gives a `MachineWarning`.

        Raises:
            MachineError: Not a Payload, or an unknown frame; the message lists the known frames.
        """
        if not isinstance(payload, Payload):
            raise MachineError(f"payload must be a Payload, not {type(payload).__name__}")
        loaded = replace(self, model=payload.attached_to(self.model))
        for doubt in payload_doubts(payload, self.mass, self.support):
            warn_of_machine(doubt)
        return loaded

    @property
    def payload_mass(self) -> float:
        """Total mass of all payloads [kg]."""
        return float(sum(frame.inertia.mass for frame in _payloads(self.model)))

    def with_payload_scaled(self, factor: float) -> Machine:
        """Copy of this machine with mass and inertia of all payloads multiplied by a factor.

        Args:
            factor: At least 0; at 0 the payloads become massless.

        Raises:
            MachineError: The factor is negative or not a finite number.
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
        """Copy of this machine with the centre of mass of its only payload displaced.

        The payload's inertia about its own centre of mass does not change.

        Args:
            offset: Displacement of the centre of mass in the axes of the frame that carries the
                payload, shape (3,) [m].

        Raises:
            MachineError: No payload or several, or an offset that is not three finite numbers.
        """
        offset = frozen_array(offset, name="payload offset", shape=(3,), error=MachineError)
        model = self.model.copy()
        carried = _payloads(model)
        if len(carried) != 1:
            raise MachineError(
                f"machine {self.name!r} carries {len(carried)} payloads; only a single payload "
                "can be moved"
            )
        body = carried[0].inertia
        carried[0].inertia = pin.Inertia(body.mass, body.lever + offset, body.inertia)
        joint = carried[0].parentJoint
        model.inertias[joint] = _sum_of_frames(model, joint)
        return replace(self, model=model)

    @property
    def payload_count(self) -> int:
        """Number of payloads with a mass above zero."""
        return len(_payloads(self.model))

    @property
    def payloads(self) -> tuple[Payload, ...]:
        """The payloads with a mass above zero, in the order in which they were attached."""
        return tuple(
            Payload(
                frame.inertia.mass,
                np.array(frame.inertia.lever),
                self.model.frames[frame.parentFrame].name,
                np.array(frame.inertia.inertia),
            )
            for frame in _payloads(self.model)
        )

    def with_massless(self, links: Collection[str]) -> Machine:
        """Copy of this machine in which some links weigh nothing.

        Raises:
            MachineError: An unknown link; the message lists the known ones.
        """
        model = self.model.copy()
        bodies = [frame for frame in model.frames if frame.type == pin.FrameType.BODY]
        if unknown := sorted(set(links) - {frame.name for frame in bodies}):
            raise MachineError(
                f"there is no link {unknown[0]!r}; links are "
                f"{', '.join(frame.name for frame in bodies)}"
            )
        for frame in bodies:
            if frame.name in links:
                frame.inertia = pin.Inertia.Zero()
        for joint in {frame.parentJoint for frame in bodies if frame.name in links}:
            model.inertias[joint] = _sum_of_frames(model, joint)
        return replace(self, model=model)

    def with_limits(
        self,
        *,
        velocity: Any = None,
        acceleration: Any = None,
        position_lower: Any = None,
        position_upper: Any = None,
    ) -> Machine:
        """Copy of this machine with other limits.

        Each argument is a scalar for all joints, an array of shape (n,), or a mapping from joint
        names to numbers; None keeps the limits.

        Args:
            velocity: Velocity limits [rad/s or m/s].
            acceleration: Acceleration limits [rad/s^2 or m/s^2].
            position_lower, position_upper: Position limits [rad or m].

        Raises:
            MachineError: Wrong shape, unknown joint, a limit of rates or accelerations that is not
                positive and finite, or a lower limit above the upper one.
        """
        given = {
            "velocity": velocity,
            "acceleration": acceleration,
            "position_lower": position_lower,
            "position_upper": position_upper,
        }
        changes: Mapping[str, Any] = {
            key: value for key, value in given.items() if value is not None
        }
        return replace(self, limits=self.limits.updated(changes, self.joint_names))

    def with_support(self, support: SupportPolygon) -> Machine:
        """Copy of this machine with another support polygon.

        Raises:
            MachineError: Not a SupportPolygon.
        """
        if not isinstance(support, SupportPolygon):
            raise MachineError(f"support must be a SupportPolygon, not {type(support).__name__}")
        doubt = doubtful_support(support, machine_size(self.model))
        if doubt:
            warn_of_machine(f"machine {self.name!r}: {doubt}")
        return replace(self, support=support)

    def with_point_masses(self) -> Machine:
        """Copy of this machine in which every body is a point mass at its centre of mass.

        This is the mass model of Song & Sharf 2020, eq. (5). Bodies that are fixed to one another
        (such as a link and its payload) become separate points: Pinocchio lumps their inertias
        into the joint that moves them, but the frame of each link and payload holds its own.
        """
        model = self.model.copy()
        for frame in model.frames:
            frame.inertia = pin.Inertia(frame.inertia.mass, frame.inertia.lever, np.zeros((3, 3)))
        for joint in range(1, model.njoints):
            model.inertias[joint] = _sum_of_frames(model, joint)
        return replace(self, model=model)


@lru_cache(maxsize=32)
def _joint_units(machine: Machine) -> tuple[str, ...]:
    """Unit of each joint coordinate; cached, because a model is slow to ask for them."""
    model = machine.model
    kinds = (model.joints[model.getJointId(name)].shortname() for name in machine.joint_names)
    # JointModelPX, ...PY, ...PZ or ...PrismaticUnaligned
    return tuple("m" if kind.startswith("JointModelP") else "rad" for kind in kinds)


def _sum_of_frames(model: Any, joint: int) -> Any:
    """Inertia of all bodies fixed to a joint, summed over their frames, in the joint's frame."""
    total = pin.Inertia.Zero()
    for frame in model.frames:
        if frame.parentJoint == joint:
            total += frame.placement.act(frame.inertia)
    return total


def _payloads(model: Any) -> list[Any]:
    """Frames of the payloads: operational frames (not links) that have a mass."""
    return [
        frame
        for frame in model.frames
        if frame.type == pin.FrameType.OP_FRAME and frame.inertia.mass > 0.0
    ]
