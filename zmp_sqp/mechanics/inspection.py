"""What was understood of a machine: masses, joints, limits, support, and how firmly it stands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array, frozen_array
from zmp_sqp.errors import ContactLost, MachineError
from zmp_sqp.mechanics.ground import Ground, Slope
from zmp_sqp.mechanics.link_tree import Link, default_tip, link_tree
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.named_poses import named_poses
from zmp_sqp.mechanics.stability_measures import center_of_mass
from zmp_sqp.mechanics.tipping_load import (
    TippingLoad,
    frame_index,
    frame_position,
    tipping_load,
    worst_turn,
)
from zmp_sqp.mechanics.zero_moment_point import zmp

__all__ = ["Inspection", "PoseReport", "inspect", "slew_joint"]

PROBE = 0.1  # [rad or m] by which joints are moved to see what moves with them
UPRIGHT = 1e-3  # sine of the largest angle between a slew axis and the root's z axis


@dataclass(frozen=True, slots=True, eq=False)
class PoseReport:
    """A machine at rest in one pose.

    Attributes:
        name: Name of the pose.
        q: Joint coordinates, shape (n,) [rad or m].
        com: Centre of mass of machine and payloads, root frame, shape (3,) [m].
        zmp: Zero moment point in the support plane, root frame, shape (2,) [m].
        margin: Signed distance from the ZMP to the nearest edge, positive inside [m]; NaN without
            support polygon.
        edge: Name of that edge; empty without support polygon.
        tip: Position of the point that carries the load, root frame, shape (3,) [m].
        tipping: Largest point mass there before the machine tips over, on top of the payloads that
            it carries; None without support polygon.
        worst: The least of these while the slew joint turns through its range; None without support
            polygon or slew joint.
    """

    name: str
    q: Array
    com: Array
    zmp: Array
    margin: float
    edge: str
    tip: Array
    tipping: TippingLoad | None
    worst: TippingLoad | None


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """What was understood of a machine.

    Attributes:
        machine: The machine.
        ground: Ground on which it was looked at.
        links: Its links from the root outwards.
        missing: Limits that planning needs but that are given nowhere: names of joints by name of
            the limit (see `JointLimits.missing`).
        tip: Name of the frame that carries the load of `tipping`.
        tip_offset: Position of the load in that frame, shape (3,) [m].
        slew: Name of the planned joint that turns about the vertical; empty if there is none.
        poses: The machine at rest in each pose, in the order of `named_poses`.
    """

    machine: Machine
    ground: Ground
    links: tuple[Link, ...]
    missing: Mapping[str, tuple[str, ...]]
    tip: str
    tip_offset: Array
    slew: str
    poses: tuple[PoseReport, ...]


def inspect(
    machine: Machine,
    ground: Ground | None = None,
    *,
    tip: str | None = None,
    tip_offset: Any = None,
    poses: Mapping[str, Any] | None = None,
) -> Inspection:
    """Describe a machine at rest: tree of links, limits, and how firmly it stands in each pose.

    Args:
        machine: The machine.
        ground: Ground on which it stands; None is level ground.
        tip: Name of the link (or other frame) at which a load hangs; None is the outermost link.
        tip_offset: Point of the load in that frame, shape (3,) [m]; None is its origin, or the
            link's centre of mass if no joint moves the origin.
        poses: Joint coordinates by name of the pose, shape (n,) each [rad or m]; None takes the
            states of the SRDF, zero and the middle of the limits.

    Raises:
        MachineError: Not a machine, a machine without mass, an unknown frame, or a pose of the
            wrong shape.
    """
    if not isinstance(machine, Machine):
        raise MachineError(
            f"machine must be a Machine (see load_machine), not {type(machine).__name__}"
        )
    if not machine.mass > 0.0:
        raise MachineError(
            f"machine {machine.name!r} has no mass: give its links an <inertial> with <mass>"
        )
    ground = Slope() if ground is None else ground
    tip = default_tip(machine) if tip is None else tip
    if tip_offset is None:
        tip_offset = _moved_point(machine, tip)
    offset = frozen_array(tip_offset, name="tip offset", shape=(3,), error=MachineError)
    chosen = named_poses(machine) if poses is None else poses
    slew = slew_joint(machine, tip)
    load = {"frame": tip, "offset": offset}
    return Inspection(
        machine=machine,
        ground=ground,
        links=link_tree(machine),
        missing=machine.limits.missing(machine.joint_names),
        tip=tip,
        tip_offset=offset,
        slew=slew,
        poses=tuple(_report(machine, ground, name, q, slew, load) for name, q in chosen.items()),
    )


def slew_joint(machine: Machine, tip: str) -> str:
    """Name of the first planned joint that turns a frame about the root's z axis at q = 0.

    A joint that others mimic does not count: they would turn elsewhere at the same time.

    Args:
        machine: The machine.
        tip: Name of the frame.

    Returns:
        The name; empty if there is none.

    Raises:
        MachineError: An unknown frame.
    """
    model = machine.model
    data = model.createData()
    pin.forwardKinematics(model, data, machine.configuration(np.zeros((1, machine.size)))[0])
    moving = set(model.supports[model.frames[frame_index(machine, tip)].parentJoint])
    for name, unit in zip(machine.joint_names, machine.joint_units, strict=True):
        joint = model.getJointId(name)
        axis = data.oMi[joint].rotation @ _axis(machine, joint)
        turns = unit == "rad" and joint in moving and not machine.mimics_of(name)
        if turns and np.hypot(axis[0], axis[1]) < UPRIGHT:
            return name
    return ""


def _moved_point(machine: Machine, tip: str) -> Array:
    """Origin of a frame, or its centre of mass if no planned joint moves the origin, (3,) [m]."""
    poses = np.vstack([np.zeros(machine.size), PROBE * np.eye(machine.size)])
    origins = frame_position(machine, poses, tip)
    if np.abs(origins - origins[0]).max() > 1e-3 * PROBE:
        return np.zeros(3)
    kind = pin.FrameType.BODY
    frames = machine.model.frames
    body = next((f for f in frames if f.name == tip and f.type == kind), None)
    return np.zeros(3) if body is None else np.array(body.inertia.lever)


def _axis(machine: Machine, joint: int) -> Array:
    """Axis about which a joint turns, in its own frame, shape (3,); zero if it slides."""
    model = machine.model
    data = model.createData()
    pin.computeJointJacobians(model, data, machine.configuration(np.zeros((1, machine.size)))[0])
    column = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL)
    return np.asarray(column[3:, model.joints[joint].idx_v])


def _report(
    machine: Machine, ground: Ground, name: str, pose: Any, slew: str, load: dict[str, Any]
) -> PoseReport:
    q = frozen_array(
        pose,
        name=f"pose {name!r}",
        shape=(machine.size,),
        error=MachineError,
        labels=machine.joint_names,
    )
    still = np.zeros(machine.size)
    try:
        point = zmp(machine, q, still, still, ground)
    except ContactLost:
        point = np.full(2, np.nan)
    support = machine.support
    margin, edge, tipping, worst = np.nan, "", None, None
    if support is not None:
        room = support.offsets - support.normals @ point
        margin, edge = float(room.min()), support.edge_name(int(np.argmin(room)))
        tipping = tipping_load(machine, q, ground, **load)
        if slew:
            worst = worst_turn(machine, q, ground, joint=slew, **load)
    return PoseReport(
        name=name,
        q=q,
        com=center_of_mass(machine, q[None])[0],
        zmp=point,
        margin=margin,
        edge=edge,
        tip=frame_position(machine, q[None], **load)[0],
        tipping=tipping,
        worst=worst,
    )
