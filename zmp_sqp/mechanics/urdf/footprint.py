"""Support polygon from the collision shapes that touch the ground."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.mechanics.urdf.description import UrdfDescription
from zmp_sqp.mechanics.urdf.elements import Shape

__all__ = ["footprint", "footprint_of_links"]

LEVEL = 0.01  # [m] largest height above the lowest point at which a point touches the ground, too
# number of points on the rim of an upright cylinder; they form an inscribed polygon, which is never
# larger than the disc
RIM_POINTS = 32


def footprint(description: UrdfDescription, model: Any) -> SupportPolygon | None:
    """Support polygon of the root link and all links fixed to it.

    The polygon is the convex hull of the lowest points of their collision shapes.

    Args:
        description: Content of the URDF.
        model: Pinocchio model of the URDF.

    Returns:
        Polygon in the plane of the lowest point; None if the shapes span no polygon, or if one of
        them is a mesh.
    """
    links = [
        link for link in description.shapes if model.frames[_frame(model, link)].parentJoint == 1
    ]
    if any(shape.kind == "mesh" for link in links for shape in description.shapes[link]):
        return None
    points = np.concatenate(
        [np.empty((0, 3)), *(_contacts(description, model, link) for link in links)]
    )
    try:
        return _hull(points)
    except MachineError:
        return None


def footprint_of_links(
    description: UrdfDescription, model: Any, links: Sequence[str]
) -> SupportPolygon:
    """Support polygon of given links: convex hull of the lowest points of their collision shapes.

    Args:
        description: Content of the URDF.
        model: Pinocchio model of the URDF.
        links: Names of the contact links.

    Raises:
        MachineError: A link is unknown, moves with a joint, has no collision shape or a mesh, or is
            higher above the ground than the others; or the links span no polygon. The message
            names the link.
    """
    contacts = {}
    for link in links:
        if link not in description.shapes:
            raise MachineError(
                f"there is no contact link {link!r}; links are {', '.join(description.shapes)}"
            )
        joint = model.frames[_frame(model, link)].parentJoint
        if joint != 1:
            raise MachineError(
                f"contact link {link!r} moves with joint {model.names[joint]!r}: "
                "contacts must be fixed to the root"
            )
        shapes = description.shapes[link]
        if not shapes:
            raise MachineError(f"contact link {link!r} has no collision shape")
        if any(shape.kind == "mesh" for shape in shapes):
            raise MachineError(
                f"contact link {link!r} has a mesh for a collision shape: "
                "only box, cylinder and sphere are read"
            )
        contacts[link] = _contacts(description, model, link)
    if not contacts:
        raise MachineError("support names no contact links")
    ground = min(points[:, 2].min() for points in contacts.values())
    for link, points in contacts.items():
        if points[:, 2].min() > ground + LEVEL:
            raise MachineError(
                f"contact link {link!r} ends {points[:, 2].min() - ground:.3f} m "
                "above the lowest contact"
            )
    return _hull(np.concatenate(list(contacts.values())))


def _hull(points: Array) -> SupportPolygon:
    """Support polygon of those points (P, 3) that lie within `LEVEL` of the lowest one."""
    if not len(points):
        raise MachineError("there are no contact points")
    height = float(points[:, 2].min())
    return SupportPolygon.convex_hull(points[points[:, 2] <= height + LEVEL, :2], height)


def _contacts(description: UrdfDescription, model: Any, link: str) -> Array:
    """Lowest points of the shapes of a link fixed to the root, root frame, shape (P, 3) [m]."""
    placement = model.frames[_frame(model, link)].placement
    points = [_lowest(shape, placement) for shape in description.shapes[link]]
    return np.concatenate([np.empty((0, 3)), *points])


def _lowest(shape: Shape, link: Any) -> Array:
    """Lowest points of a shape on a link with the given placement, root frame, shape (P, 3) [m]."""
    rotation = link.rotation @ shape.rotation
    centre = link.translation + link.rotation @ shape.translation
    if shape.kind == "sphere":
        return np.asarray(centre - [0.0, 0.0, shape.dimensions[0]])[None]
    if shape.kind == "box":
        points = (
            centre + np.array(list(product((-0.5, 0.5), repeat=3))) * shape.dimensions @ rotation.T
        )
    else:
        points = _rims(rotation, shape.dimensions[0], shape.dimensions[1]) + centre
    return np.asarray(points[points[:, 2] <= points[:, 2].min() + LEVEL])


def _rims(rotation: Array, radius: float, length: float) -> Array:
    """Points on the two rims of a cylinder, relative to its centre, shape (P, 3) [m].

    Each rim has `RIM_POINTS` points if the cylinder is upright, otherwise its lowest point only.
    """
    axis = rotation[:, 2]
    # projection of the downward direction onto the plane of the rims; its length is sin(tilt)
    down = np.array([0.0, 0.0, -1.0]) + axis[2] * axis
    tilt = float(np.linalg.norm(down))
    if 2.0 * radius * tilt > LEVEL:
        rim = radius * down[None] / tilt
    else:
        angles = np.linspace(0.0, 2.0 * np.pi, RIM_POINTS, endpoint=False)
        rim = radius * np.column_stack([np.cos(angles), np.sin(angles)]) @ rotation[:, :2].T
    return np.concatenate([rim - 0.5 * length * axis, rim + 0.5 * length * axis])


def _frame(model: Any, link: str) -> int:
    """Index of the frame of a link."""
    return int(model.getFrameId(link, pin.FrameType.BODY))
