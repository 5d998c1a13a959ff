"""Tree of links and joints of a machine, with the mass of each link."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from zmp_sqp.mechanics.machine import Machine

__all__ = ["Link", "default_tip", "link_tree"]

ROOT_JOINT = 1  # index of the free-flyer joint that carries the root link


@dataclass(frozen=True, slots=True)
class Link:
    """One link, and the joint by which it hangs on the link above.

    Attributes:
        name: Name of the link; of a payload, the name of its frame.
        mass: Mass of this link alone [kg].
        depth: Number of links above it; 0 for the root link.
        parent: Name of the link above; empty for the root link.
        joint: Name of the joint between both; empty for the root link and for payloads.
        motion: What the joint does: 'root', 'payload', 'fixed', 'turns' or 'slides'.
        planned: Whether the joint is one of the machine's planned joints.
        frame: Index of the link's frame in the Pinocchio model.
        parent_frame: Index of the frame of the link above; 0 for the root link.
    """

    name: str
    mass: float
    depth: int
    parent: str
    joint: str
    motion: str
    planned: bool
    frame: int
    parent_frame: int


def link_tree(machine: Machine) -> tuple[Link, ...]:
    """Links of a machine and its payloads, each followed by the links that hang on it."""
    model = machine.model
    bodies = {
        index: frame
        for index, frame in enumerate(model.frames)
        if index > 0 and (frame.type == pin.FrameType.BODY or _is_payload(frame))
    }
    parents = {index: _body_above(machine, index) for index in bodies}
    children: dict[int, list[int]] = {}
    for index, parent in parents.items():
        children.setdefault(parent, []).append(index)
    found: list[Link] = []
    waiting = [(index, 0) for index in reversed(children.get(0, []))]
    while waiting:  # depth first
        index, depth = waiting.pop()
        parent = parents[index]
        found.append(_link(machine, index, depth, parent))
        waiting += [(child, depth + 1) for child in reversed(children.get(index, []))]
    return tuple(found)


def default_tip(machine: Machine) -> str:
    """Name of the link at the end of the arm.

    Of the links that most planned joints move it is the one whose origin lies farthest from the
    joint that moves it; of several at one place, the last in the file.
    """
    model = machine.model
    planned = {model.getJointId(name) for name in machine.joint_names}
    counts = [sum(joint in planned for joint in support) for support in model.supports]
    links = [frame for frame in model.frames if frame.type == pin.FrameType.BODY]
    most = max(counts[frame.parentJoint] for frame in links)
    candidates = [frame for frame in links if counts[frame.parentJoint] == most]
    reaches = np.array([np.linalg.norm(frame.placement.translation) for frame in candidates])
    last = np.flatnonzero(reaches >= reaches.max() * (1.0 - 1e-9))[-1]
    return str(candidates[int(last)].name)


def _is_payload(frame: pin.Frame) -> bool:
    return bool(frame.type == pin.FrameType.OP_FRAME and frame.inertia.mass > 0.0)


def _body_above(machine: Machine, index: int) -> int:
    """Index of the frame of the link above; 0 if there is none."""
    frames = machine.model.frames
    at = frames[index].parentFrame
    while at > 0 and frames[at].type != pin.FrameType.BODY:
        at = frames[at].parentFrame
    return int(at)


def _link(machine: Machine, index: int, depth: int, parent: int) -> Link:
    model = machine.model
    frame = model.frames[index]
    joint, motion = "", "payload"
    if frame.type == pin.FrameType.BODY:
        above = model.frames[frame.parentFrame]
        joint, motion = above.name, "fixed"
        if above.type == pin.FrameType.JOINT:
            kind = model.joints[above.parentJoint].shortname()
            # JointModelPX, ...PY, ...PZ or ...PrismaticUnaligned
            motion = "slides" if kind.startswith("JointModelP") else "turns"
            if above.parentJoint == ROOT_JOINT:
                joint, motion = "", "root"
    planned = joint in machine.joint_names and motion in ("turns", "slides")
    return Link(
        name=frame.name,
        mass=float(frame.inertia.mass),
        depth=depth,
        parent=model.frames[parent].name if parent else "",
        joint=joint,
        motion=motion,
        planned=planned,
        frame=index,
        parent_frame=parent,
    )
