"""A machine as plain numbers: joints, placements, axes, and the bodies that each joint carries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.rigorous.series_algebra import Matrix, Scalar, Vector

__all__ = ["Body", "JointNumbers", "bodies_of", "joints_of", "payload_link"]

FIRST = 2  # Pinocchio's index of the first joint behind universe and root


@dataclass(frozen=True, slots=True)
class JointNumbers:
    """A movable joint; link 0 is the root, link i + 1 is moved by joint i.

    Attributes:
        parent: Link that carries the joint.
        rotation: Axes of the joint in those of its parent link, rows of a 3 x 3 matrix.
        origin: Origin of the joint in its parent link [m].
        axis: Unit vector about or along which it moves, in its own axes.
        slides: Whether it is prismatic.
        leader: Planned joint that it follows.
        multiplier, offset: q = multiplier y + offset.
    """

    parent: int
    rotation: tuple[tuple[float, ...], ...]
    origin: tuple[float, ...]
    axis: tuple[float, ...]
    slides: bool
    leader: int
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True)
class Body:
    """All that one link carries, lumped: numbers as balls.

    Attributes:
        key: The numbers of its parts, which tell bodies of different corners apart.
        mass: Ball [kg].
        com: Centre of mass in link axes [m].
        inertia: About the centre of mass, link axes [kg m^2].
    """

    key: tuple[float, ...]
    mass: Scalar
    com: Vector
    inertia: Matrix


def joints_of(machine: Machine) -> tuple[JointNumbers, ...]:
    """Joints of a machine, in the order of its model.

    Raises:
        MachineError: A joint neither turns about an axis nor slides along one.
    """
    model, coupling, found = machine.model, machine.coupling, []
    for index in range(FIRST, model.njoints):
        placement, row = model.jointPlacements[index], index - FIRST
        axis, slides = _axis(model, index)
        found.append(
            JointNumbers(
                parent=int(model.parents[index]) - 1,
                rotation=tuple(tuple(line) for line in placement.rotation.tolist()),
                origin=tuple(placement.translation.tolist()),
                axis=axis,
                slides=slides,
                leader=int(coupling.leader[row]),
                multiplier=float(coupling.multiplier[row]),
                offset=float(coupling.offset[row]),
            )
        )
    return tuple(found)


def _axis(model: Any, index: int) -> tuple[tuple[float, ...], bool]:
    """Axis of a joint, from its constant motion subspace, and whether the joint slides along it."""
    joint = model.joints[index]
    subspace = np.asarray(joint.createData().S, dtype=np.float64)
    linear, angular = subspace.reshape(6, -1)[:3], subspace.reshape(6, -1)[3:]
    if joint.nv != 1 or (linear.any() and angular.any()):
        raise MachineError(
            f"joint {model.names[index]!r} is a {joint.shortname()}, but ball arithmetic knows "
            "joints that turn about one axis or slide along it"
        )
    slides = bool(linear.any())
    return tuple((linear if slides else angular).ravel().tolist()), slides


def payload_link(machine: Machine) -> int:
    """Link that carries the last payload; 0, the root, if there is none."""
    carried = [
        int(frame.parentJoint) - 1
        for frame in machine.model.frames
        if frame.type == pin.FrameType.OP_FRAME and frame.inertia.mass > 0.0
    ]
    return carried[-1] if carried else 0


def bodies_of(flint: Any, machine: Machine) -> tuple[Body, ...]:
    """Bodies of all links, the root first, lumped here from those of all links and payloads."""
    parts: list[list[tuple[float, ...]]] = [[] for _ in range(machine.model.njoints - 1)]
    for frame in machine.model.frames:
        inertia = frame.inertia
        if frame.parentJoint > 0 and (inertia.mass > 0.0 or np.any(inertia.inertia)):
            parts[frame.parentJoint - 1].append(
                (
                    float(inertia.mass),
                    *inertia.lever.tolist(),
                    *inertia.inertia.ravel().tolist(),
                    *frame.placement.translation.tolist(),
                    *frame.placement.rotation.ravel().tolist(),
                )
            )
    return tuple(_lumped(flint, rows) for rows in parts)


def _lumped(flint: Any, parts: list[tuple[float, ...]]) -> Body:
    """One body from several, by the parallel axis theorem on balls."""
    arb, mat = flint.arb, flint.arb_mat
    mass, first = arb(0), mat(3, 1)
    masses, centres, turned = [], [], []
    for row in parts:
        m, lever, own = arb(row[0]), mat(3, 1, row[1:4]), mat(3, 3, row[4:13])
        R = mat(3, 3, row[16:25])
        centre = mat(3, 1, row[13:16]) + R * lever
        masses.append(m)
        centres.append(centre)
        turned.append(R * own * R.transpose())
        mass, first = mass + m, first + m * centre
    com = first * (1 / mass) if mass > 0 else mat(3, 1)
    total = mat(3, 3)
    for m, centre, own in zip(masses, centres, turned, strict=True):
        off = centre - com
        square = (off.transpose() * off)[0, 0]
        total = total + own + m * (square * mat([[1, 0, 0], [0, 1, 0], [0, 0, 1]]))
        total = total - m * (off * off.transpose())
    rows = [tuple(_plain(total[i, j]) for j in range(3)) for i in range(3)]
    return Body(
        key=tuple(number for row in parts for number in row),
        mass=_plain(mass),
        com=(_plain(com[0, 0]), _plain(com[1, 0]), _plain(com[2, 0])),
        inertia=(rows[0], rows[1], rows[2]),
    )


def _plain(ball: Any) -> Any:
    """Exact zero for a ball that is exactly zero, else the ball."""
    return 0 if ball.is_zero() else ball
