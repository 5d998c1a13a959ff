"""Reads groups of joints and named poses from an SRDF, MoveIt's companion of a URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.urdf.elements import Joint, numbers, spell
from zmp_sqp.mechanics.urdf.xml_reader import parse_xml

__all__ = ["Srdf", "read_srdf"]


@dataclass(frozen=True, slots=True)
class Group:
    """One <group>: what it names, before it is looked up in the URDF.

    Attributes:
        joints: Names of joints.
        links: Names of links; the joint above each of them belongs to the group.
        chains: Names of the first and the last link of each chain.
        groups: Names of other groups.
    """

    joints: tuple[str, ...]
    links: tuple[str, ...]
    chains: tuple[tuple[str, str], ...]
    groups: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Srdf:
    """Content of an SRDF that concerns joints.

    Attributes:
        robot: Name of the robot.
        groups: Groups by name.
        poses: Joint coordinates by joint, by name of the <group_state> [rad or m]. States of one
            name for several groups are one pose; where they contradict each other, the later one is
            named 'group/state'.
        virtual: Names of virtual joints, which are not in the URDF.
        passive: Names of joints that nothing drives.
    """

    robot: str
    groups: Mapping[str, Group]
    poses: Mapping[str, Mapping[str, float]]
    virtual: frozenset[str]
    passive: frozenset[str]

    def check(self, robot: str, joints: Collection[str], links: Collection[str]) -> None:
        """Raise MachineError if this is the SRDF of another robot.

        An SRDF may name joints and links that a variant of its robot lacks. It is that of another
        robot if it names unknown ones and neither name of the two robots is part of the other, or
        if it names no known one.

        Args:
            robot: Name of the robot in the URDF.
            joints: Names of its joints.
            links: Names of its links.
        """
        named = [(joint, "joint") for group in self.groups.values() for joint in group.joints]
        named += [(joint, "joint") for pose in self.poses.values() for joint in pose]
        named += [(link, "link") for group in self.groups.values() for link in group.links]
        named += [
            (link, "link")
            for group in self.groups.values()
            for chain in group.chains
            for link in chain
        ]
        named = [(name, kind) for name, kind in named if name not in self.virtual]
        known = {"joint": joints, "link": links}
        strange = [(name, kind) for name, kind in named if name not in known[kind]]
        ours, theirs = self.robot.casefold(), robot.casefold()
        variant = bool(ours) and (ours in theirs or theirs in ours)
        if strange and (not variant or len(strange) == len(named)):
            name, kind = strange[0]
            raise MachineError(
                f"it is for robot {self.robot!r}, not for {robot!r}, which has no {kind} {name!r}"
            )

    def joints_of(self, group: str, joints: Sequence[Joint]) -> frozenset[str]:
        """Names of the joints of a group that the URDF has, fixed and passive ones included.

        Raises:
            MachineError: There is no such group, it contains itself, or it names a joint or link
                that the URDF does not have.
        """
        return self._joints_of(group, {joint.child: joint for joint in joints}, ())

    def _joints_of(
        self, name: str, above: Mapping[str, Joint], within: tuple[str, ...]
    ) -> frozenset[str]:
        """`joints_of` for a group that is part of others; `above` gives the joint of each link."""
        if name not in self.groups:
            part = f", which group {within[-1]!r} names" if within else ""
            known = ", ".join(self.groups) or "none"
            raise MachineError(f"there is no group {name!r}{part}; groups are {known}")
        if name in within:
            raise MachineError(f"group {name!r} contains itself")
        group, known_joints = self.groups[name], {joint.name for joint in above.values()}
        found = {joint for joint in group.joints if joint not in self.virtual}
        for joint in sorted(found - known_joints):
            raise MachineError(
                f"group {name!r} names joint {joint!r}, which the URDF does not have"
            )
        links = {joint.parent for joint in above.values()} | set(above)
        for link in (*group.links, *(end for chain in group.chains for end in chain)):
            if link not in links:
                raise MachineError(
                    f"group {name!r} names link {link!r}, which the URDF does not have"
                )
        found |= {above[link].name for link in group.links if link in above}
        for base, tip in group.chains:
            found |= _chain(name, base, tip, above)
        for part in group.groups:
            found |= self._joints_of(part, above, (*within, name))
        return frozenset(found)


def _chain(group: str, base: str, tip: str, above: Mapping[str, Joint]) -> set[str]:
    """Names of the joints between two links."""
    found, link = set(), tip
    while link != base:
        if link not in above:
            raise MachineError(
                f"group {group!r} has a chain from {base!r} to {tip!r}, "
                f"but link {tip!r} does not hang on {base!r}"
            )
        found.add(above[link].name)
        link = above[link].parent
    return found


def read_srdf(path: Path) -> Srdf:
    """Read groups, group states and virtual joints of an SRDF.

    Raises:
        MachineError: The file cannot be read or is no SRDF; the message names the file, and the
            group or joint.
    """
    try:
        content = path.read_bytes()
    except OSError as cause:
        raise MachineError(f"cannot read {path}: {cause.strerror or cause}") from None
    try:
        robot = parse_xml(content, "robot", "an SRDF")
        if robot.find("link") is not None:
            raise MachineError("this is a URDF, not an SRDF: it has a <link>")
        return _read(robot)
    except MachineError as fault:
        raise MachineError(f"{path}: {fault}") from None


def _read(robot: ET.Element) -> Srdf:
    """Content of the <robot> element of an SRDF."""
    groups: dict[str, Group] = {}
    for element in robot.findall("group"):
        name = _name(element, "name", "a <group>")
        if name in groups:
            raise MachineError(f"group {name!r} is there twice: names must be unique")
        where = f"group {name!r}"
        groups[name] = Group(
            tuple(_name(part, "name", where) for part in element.findall("joint")),
            tuple(_name(part, "name", where) for part in element.findall("link")),
            tuple(
                (_name(part, "base_link", where), _name(part, "tip_link", where))
                for part in element.findall("chain")
            ),
            tuple(_name(part, "name", where) for part in element.findall("group")),
        )
    return Srdf(
        robot.get("name", ""),
        groups,
        _poses(robot),
        frozenset(part.get("name", "") for part in robot.findall("virtual_joint")),
        frozenset(part.get("name", "") for part in robot.findall("passive_joint")),
    )


def _poses(robot: ET.Element) -> dict[str, dict[str, float]]:
    """Coordinates of the joints in each <group_state>; joints with several are left out."""
    poses: dict[str, dict[str, float]] = {}
    for state in robot.findall("group_state"):
        name, where = _name(state, "name", "a <group_state>"), spell(state)
        pose = {
            _name(joint, "name", where): numbers(joint, "value", 1, f"{where}, {spell(joint)}")[0]
            for joint in state.findall("joint")
            if len(joint.get("value", "").split()) <= 1  # a floating joint has seven
        }
        known = poses.get(name, {})
        if any(known.get(joint, value) != value for joint, value in pose.items()):
            name, known = f"{state.get('group', '')}/{name}", {}
        poses[name] = known | pose
    return poses


def _name(element: ET.Element, attribute: str, where: str) -> str:
    """A name in an attribute, which must not be empty."""
    name = element.get(attribute)
    if not name:
        raise MachineError(f"{where}: <{element.tag} {attribute}> is missing")
    return name
