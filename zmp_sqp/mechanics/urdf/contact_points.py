"""Lowest points of the shapes of links that do not move, and of wheels."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.urdf.description import UrdfDescription
from zmp_sqp.mechanics.urdf.elements import Joint, Shape
from zmp_sqp.mechanics.urdf.meshes import MeshFolders

__all__ = [
    "LEVEL",
    "Axle",
    "axle_of",
    "is_round",
    "link_placement",
    "lowest_points",
    "rolling_placement",
    "wheel_placement",
]

LEVEL = 0.01  # [m] height above a shape's lowest point up to which it touches the ground, too
# [m] the same for meshes: a ball of 30 mm radius touches within 11 mm of its lowest point
MESH_LEVEL = 2e-3
# number of points on the rim of an upright cylinder; they form an inscribed polygon, which is never
# larger than the disc
RIM_POINTS = 32
TURNS = (0.0, 0.4, 1.1, 2.0, 3.0, 4.3, 5.5)  # [rad] at which a link that turns must be as low
ROUND = 0.05  # share of a wheel's radius by which its lowest point may rise and fall as it turns
HORIZONTAL = 0.1  # sine of the largest angle between the axle of a wheel and the ground plane
BETWEEN = 3  # joints between such a wheel and the part that stands still at most; an arm has more
ROLLING = 0.35  # the same for a wheel that planned joints move, which may be cambered or steered

Axle = tuple[Array, Array]  # a point of a wheel's axle and its direction, root frame, (3,) each


def link_placement(model: Any, link: str) -> Any:
    """Placement of a link that does not move, root frame, a `pin.SE3`; None for one that moves."""
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    return frame.placement if frame.parentJoint == 1 else None


def axle_of(description: UrdfDescription, model: Any, link: str) -> Axle | None:
    """Axle of the wheel to which a link belongs, root frame; None if it belongs to none.

    A wheel is what the nearest movable joint before the link turns without limits about a
    horizontal axis.
    """
    above: dict[str, Joint] = {joint.child: joint for joint in description.joints}
    joint = above.get(link)
    while joint is not None and joint.kind == "fixed":
        joint = above.get(joint.parent)
    if joint is None or joint.kind != "continuous":
        return None
    placement = link_placement(model, joint.child) or wheel_placement(model, joint.child)
    axis = placement.rotation @ joint.axis
    axis /= np.linalg.norm(axis)
    return None if abs(axis[2]) > HORIZONTAL else (placement.translation, axis)


def wheel_placement(model: Any, link: str) -> Any:
    """Placement of a link that one joint without limits turns on the root, a `pin.SE3`.

    Args:
        model: Pinocchio model of the URDF, in which held joints are fixed.
        link: Name of the link.

    Returns:
        Placement in the root frame where the joint is at zero; None where another joint moves the
        link, or is behind it.
    """
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    joint = frame.parentJoint
    alone = joint > 1 and model.parents[joint] == 1 and len(model.subtrees[joint]) == 1
    if not alone or model.joints[joint].nq != 2:  # a joint without limits has cosine and sine
        return None
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    return data.oMi[joint] * frame.placement


def rolling_placement(
    description: UrdfDescription, model: Any, link: str
) -> tuple[Any, Axle] | None:
    """Placement and axle of a link that may roll like a wheel, however planned joints move it.

    The last joint before it turns by a full turn at least, about an axis that is level to within
    `ROLLING`. At most `BETWEEN` other joints, as of suspension and steering, lead to it.

    Args:
        description: Content of the URDF.
        model: Pinocchio model of the URDF, in which held joints are fixed.
        link: Name of the link.

    Returns:
        Placement of the link in the root frame, a `pin.SE3`, where all joints are at zero, and its
        axle; None for any other link.
    """
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    joint = frame.parentJoint
    if joint <= 1 or len(model.supports[joint]) - 3 > BETWEEN:  # universe, root and its own joint
        return None
    given = next(one for one in description.joints if one.name == model.names[joint])
    limited = given.upper - given.lower < 2.0 * np.pi  # False for limits that are not given
    if given.kind != "continuous" and (given.kind != "revolute" or limited):
        return None
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    axis = data.oMi[joint].rotation @ given.axis
    axis /= np.linalg.norm(axis)
    if abs(axis[2]) > ROLLING:
        return None
    return data.oMi[joint] * frame.placement, (data.oMi[joint].translation.copy(), axis)


def is_round(shape: Shape, link: Any, axle: Axle, meshes: MeshFolders) -> bool:
    """Whether a shape is as low at every angle about an axle, as that of a wheel is.

    Args:
        shape, link, meshes: Arguments of `lowest_points`.
        axle: The axle.
    """
    centre, axis = axle
    lowest = []
    for angle in TURNS:
        turn = pin.exp3(angle * axis)
        place = pin.SE3(turn @ link.rotation, centre + turn @ (link.translation - centre))
        lowest.append(lowest_points(shape, place, None, meshes)[:, 2].min())
    return bool(np.ptp(lowest) <= max(LEVEL, ROUND * (centre[2] - min(lowest))))


def lowest_points(shape: Shape, link: Any, axle: Axle | None, meshes: MeshFolders) -> Array:
    """Points in which a shape touches the ground if nothing lies lower, root frame, (P, 3) [m].

    A wheel touches it below its axle only.

    Args:
        shape: Shape of a link.
        link: Placement of the link in the root frame, a `pin.SE3`.
        axle: Axle of the link if it is a wheel.
        meshes: Folders in which meshes may lie.

    Raises:
        MachineError: The shape is a mesh that cannot be read.
    """
    rotation = link.rotation @ shape.rotation
    centre = link.translation + link.rotation @ shape.translation
    level = LEVEL
    if shape.kind == "sphere":
        points = np.asarray(centre - [0.0, 0.0, shape.dimensions[0]])[None]
    elif shape.kind == "box":
        corners = np.array(list(product((-0.5, 0.5), repeat=3))) * shape.dimensions
        points = centre + corners @ rotation.T
    elif shape.kind == "cylinder":
        points = _rims(rotation, shape.dimensions[0], shape.dimensions[1]) + centre
    else:
        points, level = centre + meshes.hull(shape.filename, shape.scale) @ rotation.T, MESH_LEVEL
    points = points[points[:, 2] <= points[:, 2].min() + level]
    if axle is not None:
        points = _below(points, axle)
    return np.asarray(points)


def _below(points: Array, axle: Axle) -> Array:
    """Points moved horizontally into the vertical plane through an axle."""
    centre, direction = axle[0][:2], axle[1][:2] / np.linalg.norm(axle[1][:2])
    along = (points[:, :2] - centre) @ direction
    return np.column_stack([centre + along[:, None] * direction, points[:, 2]])


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
