"""Solids to draw a machine: visuals of a shipped URDF, or bars between the joints of any other."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.urdf.elements import read_shape
from zmp_sqp.mechanics.urdf.loader import shipped_machines

__all__ = ["STEEL", "Solid", "bar_solids", "machine_solids", "payload_solids"]

STEEL, WOOD = (0.35, 0.37, 0.40, 1.0), (0.55, 0.38, 0.22, 1.0)  # red, green, blue, opacity
SLENDER = 0.03  # least radius of a drawn payload over its length
# radius of a bar over half the size of the support polygon; also the least half size and radius of
# a drawn solid [m]
BAR = 0.02
PLATE = 0.2  # [m] height of the plate that stands for an undercarriage


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """Geometric solid to be drawn.

    Attributes:
        kind: 'box', 'cylinder', 'capsule' or 'sphere'.
        size: Half edges of a box; radius and half length of a cylinder or capsule; radius of a
            sphere [m].
        joint: Index of the joint in the Pinocchio model that moves the solid.
        placement: Placement of the solid in that joint's frame, a `pin.SE3`.
        colour: Red, green, blue and opacity, from 0 to 1.
    """

    kind: str
    size: tuple[float, ...]
    joint: int
    placement: Any
    colour: tuple[float, ...]


def machine_solids(machine: Machine) -> list[Solid]:
    """All solids of a machine, including its payloads."""
    path = shipped_machines().get(machine.name)
    known = path is not None and {link.name for link in _links(machine)} == set(_urdf_links(path))
    return [*(_visuals(machine, path) if known else bar_solids(machine)), *payload_solids(machine)]


def _links(machine: Machine) -> list[Any]:
    """Frames of the machine's links."""
    return [
        frame
        for frame in machine.model.frames
        if frame.type == pin.FrameType.BODY and frame.parentJoint > 0
    ]


def _urdf_links(path: Any) -> list[str]:
    """Names of the links in a URDF."""
    return [link.attrib["name"] for link in ET.parse(path).getroot().findall("link")]


def _visuals(machine: Machine, path: Any) -> Iterator[Solid]:
    """Visual elements of the machine's URDF, except meshes."""
    robot = ET.parse(path).getroot()
    colours = {
        material.get("name"): tuple(map(float, paint.attrib["rgba"].split()))
        for material in robot.findall("material")
        if (paint := material.find("color")) is not None
    }
    links = {frame.name: frame for frame in _links(machine)}
    for link in robot.findall("link"):
        frame = links[link.attrib["name"]]
        for visual in link.findall("visual"):
            shape, material = read_shape(visual), visual.find("material")
            if shape.kind == "mesh":
                continue
            edges = shape.dimensions
            halves = {
                "box": tuple(0.5 * edge for edge in edges),
                "cylinder": (edges[0], 0.5 * edges[-1]),
            }
            placement = frame.placement * pin.SE3(shape.rotation, shape.translation)
            name = None if material is None else material.get("name")
            size, colour = halves.get(shape.kind, edges), colours.get(name, STEEL)
            yield Solid(shape.kind, size, frame.parentJoint, placement, colour)


def bar_solids(machine: Machine) -> Iterator[Solid]:
    """Stand-ins for a machine without known visuals.

    A plate stands on the ground. A bar leads from each joint to the next, or from the last joint to
    the centre of mass of the last body, and a sphere marks each joint.
    """
    model, support = machine.model, machine.support
    points = np.zeros((1, 2)) if support is None else support.vertices
    low, high, height = (
        points.min(axis=0),
        points.max(axis=0),
        0.0 if support is None else support.height,
    )
    half, middle = 0.5 * (high - low), 0.5 * (high + low)
    plate = pin.SE3(np.eye(3), np.array([*middle, height + 0.5 * PLATE]))
    yield Solid("box", (*np.maximum(half, BAR), 0.5 * PLATE), 1, plate, STEEL)
    radius = max(BAR * float(half.max()), 0.5 * BAR)
    for joint in range(1, model.njoints):
        following = [i for i in range(joint + 1, model.njoints) if model.parents[i] == joint]
        ends = [model.jointPlacements[i].translation for i in following] or [
            model.inertias[joint].lever
        ]
        for end in ends:
            length = float(np.linalg.norm(end))
            if length > 0.0:
                turn = pin.Quaternion.FromTwoVectors(
                    np.array([0.0, 0.0, 1.0]), end / length
                ).matrix()
                yield Solid(
                    "capsule", (radius, 0.5 * length), joint, pin.SE3(turn, 0.5 * end), STEEL
                )
        hub = pin.SE3(np.eye(3), np.zeros(3))
        yield Solid("sphere", (1.5 * radius,), joint, hub, STEEL)


def payload_solids(machine: Machine) -> Iterator[Solid]:
    """Payloads as uniform cylinders.

    Radius r and length l follow from a payload's mass m and its moments of inertia m r^2 / 2 and
    m (l^2 / 12 + r^2 / 4). A point mass is drawn as a rod that begins at the frame that carries it.
    """
    for frame in machine.model.frames:
        if frame.type != pin.FrameType.OP_FRAME or frame.inertia.mass <= 0.0:
            continue
        mass, lever = frame.inertia.mass, np.array(frame.inertia.lever)
        # ascending: the axis of the cylinder comes first
        moments, axes = np.linalg.eigh(np.array(frame.inertia.inertia))
        radius = float(np.sqrt(2.0 * max(moments[0], 0.0) / mass))
        length = float(np.sqrt(max(12.0 * moments[2] / mass - 3.0 * radius**2, 0.0)))
        axes = axes[:, [1, 2, 0]] * np.array([1.0, 1.0, np.linalg.det(axes)])
        if moments[2] <= 0.0 < np.linalg.norm(lever):
            length = 2.0 * float(np.linalg.norm(lever))
            axes = pin.Quaternion.FromTwoVectors(
                np.array([0.0, 0.0, 1.0]), 2.0 * lever / length
            ).matrix()
        radius = max(radius, SLENDER * length, BAR)
        kind, size = (
            ("cylinder", (radius, 0.5 * length))
            if length > radius
            else ("sphere", (max(radius, 5.0 * BAR),))
        )
        yield Solid(kind, size, frame.parentJoint, frame.placement * pin.SE3(axes, lever), WOOD)
