"""Solids and meshes with which a machine is drawn, ready for JSON."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics import Machine
from zmp_sqp.mechanics.urdf.elements import Shape, read_shape
from zmp_sqp.mechanics.urdf.meshes import MeshFolders
from zmp_sqp.mechanics.urdf.sources import package_folders
from zmp_sqp.mechanics.urdf.xacro_files import expanded
from zmp_sqp.report.surface import coarsened
from zmp_sqp.simulation.shapes import STEEL, Solid, bar_solids, payload_solids

__all__ = ["machine_parts", "payload_parts", "pose_entries"]

MOST_TRIANGLES = 40_000  # of all meshes together: keeps a page below 5 MB
HALVES = {"box": 3, "cylinder": 1}  # trailing dimensions of a shape that a Solid has halves of
DIGITS = 5  # [1e-5 m] of lengths and of quaternions


def machine_parts(
    machine: Machine, urdf: Path | None, package_dirs: Sequence[str | Path] = ()
) -> list[dict[str, Any]]:
    """Everything that is drawn of a machine, payloads included, each a table for JSON.

    A link's visual shapes are taken, or its collision shapes if it has no visual ones that can be
    drawn. Meshes that cannot be read are left out. A machine without shapes is drawn as bars
    between its joints.

    Args:
        machine: The machine.
        urdf: The file that it was loaded from; None draws bars.
        package_dirs: Folders of packages, as for `load_machine`.

    Returns:
        Tables with `kind` (box, cylinder, capsule, sphere or mesh), `size` [m] as in `Solid`,
        `joint` (index in the Pinocchio model), `pose` in that joint's frame (`pose_entries`),
        `colour` (red, green, blue, opacity) and `payload`; a mesh has `vertices` [m] and `faces`.
    """
    drawn = [] if urdf is None else list(_shapes(machine, urdf, package_dirs))
    if not drawn:
        drawn = [_of_solid(solid) for solid in bar_solids(machine)]
    _fit(drawn)
    return [*drawn, *payload_parts(machine)]


def payload_parts(machine: Machine) -> list[dict[str, Any]]:
    """Payloads alone, as in `machine_parts`."""
    return [_of_solid(solid) | {"payload": True} for solid in payload_solids(machine)]


def pose_entries(placement: Any) -> list[float]:
    """Position [m] and quaternion (x, y, z, w) of a `pin.SE3`, rounded."""
    turn = pin.Quaternion(placement.rotation).coeffs()
    return [round(float(entry), DIGITS) for entry in (*placement.translation, *turn)]


def _of_solid(solid: Solid) -> dict[str, Any]:
    return {
        "kind": solid.kind,
        "size": [round(float(edge), DIGITS) for edge in solid.size],
        "joint": solid.joint,
        "pose": pose_entries(solid.placement),
        "colour": list(solid.colour),
        "payload": False,
    }


def _shapes(
    machine: Machine, urdf: Path, package_dirs: Sequence[str | Path]
) -> Iterator[dict[str, Any]]:
    """Shapes of the links of a URDF that the machine has."""
    folders = package_folders(list(package_dirs) or None)
    meshes = MeshFolders(urdf.parent, folders)
    robot = ET.fromstring(expanded(urdf.read_bytes(), urdf, folders))
    colours = dict(_colours(robot))
    links = {
        frame.name: frame
        for frame in machine.model.frames
        if frame.type == pin.FrameType.BODY and frame.parentJoint > 0
    }
    for link in robot.findall("link"):
        frame = links.get(link.get("name", ""))
        for kind in ("visual", "collision") if frame is not None else ():
            found = [
                part
                for element in link.findall(kind)
                if (part := _shape(element, frame, meshes, colours)) is not None
            ]
            yield from found
            if found:
                break


def _shape(
    element: ET.Element, frame: Any, meshes: MeshFolders, colours: Mapping[str, Sequence[float]]
) -> dict[str, Any] | None:
    """Table of a visual or collision element; None if it cannot be drawn."""
    material = element.find("material")
    colour = STEEL if material is None else _colour(material, colours)
    try:
        shape = read_shape(element)
        placement = frame.placement * pin.SE3(shape.rotation, shape.translation)
        if shape.kind != "mesh":
            return _of_solid(Solid(shape.kind, _size(shape), frame.parentJoint, placement, colour))
        points, faces = meshes.triangles(shape.filename, shape.scale)
    except MachineError:  # a mesh that is not there, or numbers that are none
        return None
    solid = Solid("mesh", (), frame.parentJoint, placement, colour)
    return _of_solid(solid) | {"vertices": points, "faces": faces}


def _size(shape: Shape) -> tuple[float, ...]:
    """Size of a shape as a Solid has it: half edges, half lengths."""
    halved = HALVES.get(shape.kind, 0)
    whole = len(shape.dimensions) - halved
    return (*shape.dimensions[:whole], *(0.5 * edge for edge in shape.dimensions[whole:]))


def _colours(robot: ET.Element) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Named materials of a URDF."""
    for material in robot.iter("material"):
        if (rgba := _rgba(material)) is not None:
            yield material.get("name", ""), rgba


def _colour(
    material: ET.Element, named: Mapping[str, Sequence[float]]
) -> tuple[float, float, float, float]:
    """Colour of a material, its own or that of its name."""
    red, green, blue, opacity = _rgba(material) or named.get(material.get("name", ""), STEEL)
    return red, green, blue, opacity


def _rgba(material: ET.Element) -> tuple[float, ...] | None:
    """Four numbers from 0 to 1 of a material; None if it has none."""
    paint = material.find("color")
    try:
        entries = np.array((paint.get("rgba", "") if paint is not None else "").split(), float)
    except ValueError:
        return None
    if entries.shape != (4,) or not np.isfinite(entries).all():
        return None
    return tuple(entries.clip(0.0, 1.0).tolist())


def _fit(parts: Sequence[dict[str, Any]]) -> None:
    """Coarsen meshes until all have `MOST_TRIANGLES` at most, and make lists of their arrays."""
    meshes = [part for part in parts if part["kind"] == "mesh"]
    total = sum(len(part["faces"]) for part in meshes)
    share = min(1.0, MOST_TRIANGLES / total) if total else 1.0
    for part in meshes:
        points: Array = part["vertices"]
        points, faces = coarsened(points, part["faces"], int(share * len(part["faces"])))
        part["vertices"] = np.round(points, 4).ravel().tolist()
        part["faces"] = faces.ravel().tolist()
