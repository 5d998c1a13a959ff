"""Reads and checks the XML of a URDF; a fault is reported in one sentence."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.urdf.elements import (
    Body,
    Joint,
    Shape,
    numbers,
    read_body,
    read_joint,
    read_shape,
    spell,
)
from zmp_sqp.mechanics.urdf.xml_reader import parse_xml

__all__ = ["UrdfDescription", "read_description"]

# attributes of URDF elements that hold one number each
SINGLE_NUMBERS = (
    "radius",
    "length",
    "lower",
    "upper",
    "velocity",
    "effort",
    *("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
)


@dataclass(frozen=True, slots=True, eq=False)
class UrdfDescription:
    """Checked content of a URDF.

    Attributes:
        name: Name of the robot.
        root: Name of the root link.
        bodies: Mass properties of the links that have an <inertial>, by name of the link.
        joints: All joints, in the order of the file.
        shapes: Collision shapes of every link, by name of the link.
        visuals: Visual shapes of every link that can be read, by name of the link.
        xml: URDF for Pinocchio, without visual and collision elements.
    """

    name: str
    root: str
    bodies: Mapping[str, Body]
    joints: tuple[Joint, ...]
    shapes: Mapping[str, tuple[Shape, ...]]
    visuals: Mapping[str, tuple[Shape, ...]]
    xml: str


def read_description(content: bytes) -> UrdfDescription:
    """Parse and check a URDF.

    Args:
        content: Content of the file.

    Raises:
        MachineError: Invalid or unsupported content; the message names the line, link or joint, but
            not the file.
    """
    robot = _parse(content)
    links, joints = robot.findall("link"), robot.findall("joint")
    if not links:
        raise MachineError("the robot has no links")
    for kind, elements in (("link", links), ("joint", joints)):
        names: set[str] = set()
        for element in elements:
            name = element.get("name", "")
            if not name or name == "universe":
                raise MachineError(
                    f"a {kind} is named {name!r}: every {kind} needs a name, and 'universe' is "
                    "reserved by Pinocchio"
                )
            if name in names:
                raise MachineError(f"{kind} {name!r} is there twice: names must be unique")
            names.add(name)
    for element in (*links, *joints):
        _check_numbers(element)
    chain = tuple(read_joint(element) for element in joints)
    root = _root([link.attrib["name"] for link in links], chain)
    bodies = {
        link.attrib["name"]: read_body(link) for link in links if link.find("inertial") is not None
    }
    shapes = {
        link.attrib["name"]: tuple(map(read_shape, link.findall("collision/geometry/..")))
        for link in links
    }
    visuals = {link.attrib["name"]: tuple(_visuals(link)) for link in links}
    return UrdfDescription(
        robot.attrib["name"], root, bodies, chain, shapes, visuals, _for_pinocchio(robot)
    )


def _parse(content: bytes) -> ET.Element:
    """Root element <robot> of a URDF."""
    robot = parse_xml(content, "robot", "a URDF")
    if not robot.get("name"):
        raise MachineError("<robot> has no name")
    return robot


def _visuals(link: ET.Element) -> Iterator[Shape]:
    """Visual shapes of a link whose numbers can be read."""
    for visual in link.findall("visual/geometry/.."):
        try:
            yield read_shape(visual)
        except MachineError:
            continue


def _check_numbers(element: ET.Element) -> None:
    """Raise MachineError for an attribute that must be a finite number and is not.

    Visual elements are not checked, because nothing is computed from them.
    """
    for child in element:
        for part in child.iter() if child.tag != "visual" else ():
            for attribute, count in (
                ("xyz", 3),
                ("rpy", 3),
                ("size", 3),
                *((key, 1) for key in SINGLE_NUMBERS),
            ):
                if attribute in part.attrib:
                    numbers(part, attribute, count, spell(element))


def _root(links: list[str], joints: Iterable[Joint]) -> str:
    """Name of the root link, the only link without a parent.

    Raises:
        MachineError: Unknown link, link with two parents, several root links, or a loop of joints.
    """
    parents: dict[str, str] = {}
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in links:
                raise MachineError(f"joint {joint.name!r} names link {link!r}, which is not there")
        if joint.child in parents:
            raise MachineError(
                f"link {joint.child!r} has two parents, {parents[joint.child]!r} and "
                f"{joint.parent!r}"
            )
        parents[joint.child] = joint.parent
    roots = [link for link in links if link not in parents]
    if len(roots) > 1:
        raise MachineError(f"there are several root links: {', '.join(map(repr, roots))}")
    for link in links:
        seen, at = {link}, link
        while at in parents:
            at = parents[at]
            if at in seen:
                raise MachineError(
                    f"link {link!r} hangs on a loop of joints, but a URDF must be a tree"
                )
            seen.add(at)
    return roots[0]


def _for_pinocchio(robot: ET.Element) -> str:
    """URDF reduced to what Pinocchio has to read.

    Links have no shapes, so that meshes are never opened. Joints have zero limits, because the
    parser insists on limits and the actual ones are read by `read_joint`. There is no <mimic>
    either, see `JointCoupling`.
    """
    copy = ET.Element("robot", {"name": robot.attrib["name"]})
    for element in robot:
        if element.tag == "link":
            link = ET.SubElement(copy, "link", element.attrib)
            link.extend(child for child in element if child.tag == "inertial")
        elif element.tag == "joint":
            joint = ET.SubElement(copy, "joint", element.attrib)
            joint.extend(child for child in element if child.tag not in ("limit", "mimic"))
            if element.get("type") in ("revolute", "prismatic"):
                ET.SubElement(
                    joint, "limit", {"lower": "0", "upper": "0", "velocity": "0", "effort": "0"}
                )
    return ET.tostring(copy, encoding="unicode")
