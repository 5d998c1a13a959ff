"""Outlines of a machine's links: points whose convex hulls are the shapes of its URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from os import PathLike
from pathlib import Path

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics import Machine, shipped_machines
from zmp_sqp.mechanics.urdf.elements import Shape, read_shape
from zmp_sqp.mechanics.urdf.meshes import MeshFolders
from zmp_sqp.mechanics.urdf.sources import find_machine, package_folders
from zmp_sqp.mechanics.urdf.xacro_files import expanded
from zmp_sqp.simulation.shapes import Solid, bar_solids, payload_solids

__all__ = [
    "Outline",
    "hull",
    "joint_colours",
    "link_shapes",
    "machine_outlines",
    "shape_points",
    "shapes_of",
]

# Okabe & Ito 2008: distinguishable with any colour vision; black is for text and centre of mass
LINK_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")
BASE_COLOUR = "#8a8f98"  # of all that no planned joint moves
LOAD_COLOUR = "#6b4423"  # of payloads

ROUND = 24  # points around a cylinder or sphere
RINGS = 7  # rings of points between the poles of a sphere
FLAT = 1e-9  # [m] extent below which points have no area to fill


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Points whose convex hull is drawn.

    Attributes:
        joint: Index in the Pinocchio model of the joint that moves them.
        points: In the frame of that joint, shape (P, 3) [m].
        colour: Colour of what the joint moves, or of payloads.
    """

    joint: int
    points: Array
    colour: str


def machine_outlines(
    machine: Machine,
    urdf: str | PathLike[str] | None = None,
    package_dirs: Sequence[str | Path] = (),
) -> list[Outline]:
    """All that is drawn of a machine: shapes of its links, then its payloads as cylinders.

    Args:
        machine: The machine.
        urdf, package_dirs: Arguments of `shapes_of`. Without shapes, bars join the joints.

    Raises:
        MachineError: There is no such file, or it cannot be read.
    """
    shapes, colours, found = shapes_of(machine, urdf, package_dirs), joint_colours(machine), []
    for frame in machine.model.frames:
        if frame.type == pin.FrameType.BODY and frame.parentJoint > 0:
            turn, shift = frame.placement.rotation, frame.placement.translation
            for points in shapes.get(frame.name, ()):
                placed = points @ turn.T + shift
                found.append(Outline(frame.parentJoint, placed, colours[frame.parentJoint]))
    for solid in () if found else bar_solids(machine):
        found.append(Outline(solid.joint, _solid_points(solid), colours[solid.joint]))
    loads = payload_solids(machine)
    return found + [Outline(solid.joint, _solid_points(solid), LOAD_COLOUR) for solid in loads]


def _solid_points(solid: Solid) -> Array:
    """Points whose convex hull is that of a solid, frame of its joint, (P, 3) [m]."""
    turn, shift = solid.placement.rotation, solid.placement.translation
    kind = "cylinder" if solid.kind == "capsule" else solid.kind
    halved = {"box": 3, "cylinder": 1}.get(kind, 0)  # trailing sizes that are halves
    whole = len(solid.size) - halved
    dimensions = (*solid.size[:whole], *(2.0 * size for size in solid.size[whole:]))
    return shape_points(Shape(kind, dimensions, turn, shift), MeshFolders(Path(), []))


def shapes_of(
    machine: Machine,
    urdf: str | PathLike[str] | None = None,
    package_dirs: Sequence[str | Path] = (),
) -> Mapping[str, Sequence[Array]]:
    """Shapes of a machine's links, see `link_shapes`.

    Args:
        machine: The machine.
        urdf: File or name from which it was loaded; None is that of a shipped machine with the same
            name and links, and no shapes otherwise.
        package_dirs: Folders of packages, as for `load_machine`.

    Raises:
        MachineError: There is no such file, or it cannot be read.
    """
    if urdf is not None:
        return link_shapes(find_machine(urdf), package_dirs)
    path = shipped_machines().get(machine.name)
    if path is None:
        return {}
    own = {frame.name for frame in machine.model.frames if frame.type == pin.FrameType.BODY}
    links = {link.attrib["name"] for link in ET.parse(path).getroot().findall("link")}
    return link_shapes(path) if links <= own else {}


def joint_colours(machine: Machine) -> dict[int, str]:
    """Colour of what each joint of the model moves: a new one after each planned joint."""
    model = machine.model
    colours = {0: BASE_COLOUR, 1: BASE_COLOUR}
    planned = {model.getJointId(name): i for i, name in enumerate(machine.joint_names)}
    for joint in range(2, model.njoints):
        colours[joint] = (
            LINK_COLOURS[planned[joint] % len(LINK_COLOURS)]
            if joint in planned
            else colours[model.parents[joint]]
        )
    return colours


def link_shapes(urdf: Path, package_dirs: Sequence[str | Path] = ()) -> dict[str, list[Array]]:
    """Corner points of every shape, in the link's frame, shape (P, 3) [m], by name of the link.

    A link's visual shapes are taken, or its collision shapes if it has no visual ones that can be
    drawn. Meshes that cannot be read are left out.

    Args:
        urdf: A URDF that `load_machine` has accepted.
        package_dirs: Folders of packages, as for `load_machine`.

    Raises:
        MachineError: The file is in xacro and cannot be expanded, or a folder is not there.
    """
    folders = package_folders(list(package_dirs) or None)
    meshes, found = MeshFolders(urdf.parent, folders), {}
    for link in ET.fromstring(expanded(urdf.read_bytes(), urdf, folders)).findall("link"):
        for kind in ("visual", "collision"):
            shapes = list(_shapes(link, kind, meshes))
            if shapes:
                found[link.attrib["name"]] = shapes
                break
    return found


def shape_points(shape: Shape, meshes: MeshFolders) -> Array:
    """Points whose convex hull is that of a shape, link frame, (P, 3) [m].

    Round shapes are replaced by inscribed ones with `ROUND` corners.

    Args:
        shape: The shape.
        meshes: Finds and reads meshes.

    Raises:
        MachineError: A mesh cannot be read.
    """
    angles = np.linspace(0.0, 2.0 * np.pi, ROUND, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    if shape.kind == "box":
        local = np.array(list(product((-0.5, 0.5), repeat=3))) * shape.dimensions
    elif shape.kind == "cylinder":
        radius, length = shape.dimensions
        local = np.vstack(
            [
                np.column_stack([radius * circle, np.full(ROUND, end)])
                for end in (-length / 2, length / 2)
            ]
        )
    elif shape.kind == "sphere":
        heights = np.cos(np.linspace(0.0, np.pi, RINGS))
        local = shape.dimensions[0] * np.vstack(
            [np.column_stack([np.sqrt(1.0 - z * z) * circle, np.full(ROUND, z)]) for z in heights]
        )
    else:
        local = meshes.hull(shape.filename, shape.scale)
    return np.asarray(local @ shape.rotation.T + shape.translation)


def hull(points: Array) -> Array:
    """Convex hull of points in the plane, (P, 2), counter-clockwise; a line keeps its two ends."""
    from scipy.spatial import ConvexHull, QhullError  # slow to import

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        along = points - points.mean(axis=0)
        if np.abs(along).max(initial=0.0) < FLAT:
            return points[:1]
        direction = np.linalg.svd(along, full_matrices=False)[2][0]
        order = np.argsort(along @ direction)
        return points[[order[0], order[-1]]]


def _shapes(link: ET.Element, kind: str, meshes: MeshFolders) -> Iterator[Array]:
    for element in link.findall(kind):
        try:
            yield shape_points(read_shape(element), meshes)
        except MachineError:  # no mesh, or a visual shape whose numbers are none: not drawn
            continue
