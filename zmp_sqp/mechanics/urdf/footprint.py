"""Support polygon from the collision shapes that touch the ground."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, length_text
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.mechanics.urdf.contact_points import (
    LEVEL,
    axle_of,
    is_round,
    link_placement,
    lowest_points,
    rolling_placement,
    wheel_placement,
)
from zmp_sqp.mechanics.urdf.description import UrdfDescription
from zmp_sqp.mechanics.urdf.elements import Shape
from zmp_sqp.mechanics.urdf.meshes import MeshFolders
from zmp_sqp.mechanics.urdf.plausibility import first

__all__ = ["Footprint", "footprint", "footprint_of_links"]

# A contact may end this much above the lowest one: SHARE of the machine's width, or LEVEL if that
# is more; but never more than MOST [m], and on small machines SMALL of the width, not LEVEL.
SHARE, SMALL, MOST = 5e-3, 0.01, 0.02
Contact = tuple[str, Array]  # name of a link, and the lowest points of one of its shapes
NEAR = 3.0  # times that height, up to which a contact that is left out is worth a word
GROWTH = 2.0  # times the polygon's area, beyond which raised parts of links that stand are, too
# corners of a polygon, every one of which is a constraint; rounded meshes have hundreds
MOST_CORNERS = 32
SLAB = 0.1  # share of the machine's width within which shapes suggest a support polygon


@dataclass(frozen=True, slots=True, eq=False)
class Footprint:
    """Support polygon of a URDF, and what there is to say about it.

    Attributes:
        polygon: The polygon, or None if the URDF gives none.
        said: Sentence for a warning; empty if there is nothing to warn of.
        hint: How to give a polygon, where there is none.
        wheels: Planned joints that turn wheels on which the machine stands.
    """

    polygon: SupportPolygon | None
    said: str = ""
    hint: str = ""
    wheels: tuple[str, ...] = ()


def footprint(description: UrdfDescription, model: Any, meshes: MeshFolders) -> Footprint:
    """Support polygon of all links that the planned joints do not move, and of wheels.

    It is the convex hull of the points in which their collision shapes touch the ground. Wheels
    count although a planned joint may turn them: they touch the ground below their axles.

    Args:
        description: Content of the URDF.
        model: Pinocchio model of the URDF, in which held joints are fixed.
        meshes: Folders in which meshes may lie.
    """
    still = [link for link in description.shapes if link_placement(model, link) is not None]
    try:
        contacts = [
            (link, points)
            for link in still
            for points in _contacts(description, model, link, description.shapes[link], meshes)
        ]
        wheels = list(_wheels(description, model, meshes))
    except MachineError as fault:
        why, contacts, wheels = str(fault), [], []
    else:
        why = "no link that stands still has a collision shape"
        if contacts or wheels:
            try:
                _check_rolling([*contacts, *wheels], description, model, meshes)
            except MachineError as fault:
                return Footprint(None, hint=str(fault))
            try:
                joints = {link: _moved_by(description, model, link) for link, _ in wheels}
                return _with_wheels(_polygon([*contacts, *wheels]), contacts, wheels, joints)
            except MachineError as fault:
                why = str(fault)
    rolling = [points for _, points in wheels]
    return Footprint(None, hint=why + _suggestion(description, model, still, rolling, meshes))


def footprint_of_links(
    description: UrdfDescription, model: Any, links: Sequence[str], meshes: MeshFolders
) -> Footprint:
    """Support polygon of given links: convex hull of the points in which they touch the ground.

    Args:
        description: Content of the URDF.
        model: Pinocchio model of the URDF, in which held joints are fixed.
        links: Names of the contact links.
        meshes: Folders in which meshes may lie.

    Raises:
        MachineError: A link is unknown, moves with a planned joint, has no collision shape or a
            mesh that cannot be read, or is higher above the ground than the others; or the links
            span no polygon. The message names the link.
    """
    contacts: list[Contact] = []
    for link in links:
        if link not in description.shapes:
            raise MachineError(
                f"there is no contact link {link!r}; links are {', '.join(description.shapes)}"
            )
        if link_placement(model, link) is None:
            joint = _moved_by(description, model, link)
            raise MachineError(
                f"contact link {link!r} moves with joint {joint!r}, which is planned: hold that "
                f"joint, hold={{{joint!r}: 0.0}}, or plan others, joints=[...]"
            )
        shapes = description.shapes[link]
        if not shapes:
            raise MachineError(f"contact link {link!r} has no collision shape")
        try:
            found = _contacts(description, model, link, shapes, meshes)
        except MachineError as fault:
            raise MachineError(f"contact {fault}") from None
        contacts += [(link, points) for points in found]
    if not contacts:
        raise MachineError("support names no contact links")
    ground, tolerance = _ground(contacts)
    for link in links:
        low = min(points[:, 2].min() for name, points in contacts if name == link)
        if low > ground + tolerance:
            raise MachineError(
                f"contact link {link!r} ends {low - ground:.3f} m above the lowest contact"
            )
    return _polygon(contacts)


def _wheels(description: UrdfDescription, model: Any, meshes: MeshFolders) -> Iterator[Contact]:
    """Contacts of wheels that planned joints turn.

    A wheel turns without limits on the part that stands still, about a horizontal axis, carries no
    other joint, and is as low at every angle.
    """
    for link, shapes in description.shapes.items():
        placement = wheel_placement(model, link)
        axle = None if placement is None else axle_of(description, model, link)
        for shape in shapes if axle is not None else ():
            if axle is not None and is_round(shape, placement, axle, meshes):
                yield link, lowest_points(shape, placement, axle, meshes)


def _check_rolling(
    contacts: Sequence[Contact], description: UrdfDescription, model: Any, meshes: MeshFolders
) -> None:
    """Refuse contacts above wheels that planned joints move: the machine stands on these.

    Raises:
        MachineError: Such a wheel reaches below the contacts, or may do so, as it cannot be read.
    """
    ground, tolerance = _ground(contacts)
    for link, shapes in description.shapes.items():
        found = rolling_placement(description, model, link) if shapes else None
        if found is None:
            continue
        placement, axle = found
        try:
            low = min(
                (
                    lowest_points(shape, placement, None, meshes)[:, 2].min()
                    for shape in shapes
                    if is_round(shape, placement, axle, meshes)
                ),
                default=np.inf,
            )
        except MachineError as fault:
            if axle[0][2] >= ground - tolerance:
                continue
            raise MachineError(f"link {link!r}: {fault}") from None
        if low < ground - tolerance:
            raise MachineError(
                f"link {link!r}, which turns like a wheel and which planned joints move, reaches "
                f"{length_text(ground - low)} below all links that stand still: hold its joints"
            )


def _with_wheels(
    found: Footprint,
    contacts: Sequence[Contact],
    wheels: Sequence[Contact],
    joints: Mapping[str, str],
) -> Footprint:
    """Footprint with a warning where the machine stands on wheels that planned joints turn."""
    ground, tolerance = _ground([*contacts, *wheels])
    standing = [joints[link] for link, points in wheels if points[:, 2].min() <= ground + tolerance]
    if not standing:
        return found
    turning = tuple(dict.fromkeys(standing))
    words = f"the machine stands on wheels that planned joints turn: hold {first(turning)}"
    return replace(found, said="; ".join(filter(None, (found.said, words))), wheels=turning)


def _contacts(
    description: UrdfDescription,
    model: Any,
    link: str,
    shapes: Sequence[Shape],
    meshes: MeshFolders,
) -> list[Array]:
    """Lowest points of each of a link's shapes, root frame, shape (P, 3) [m]; the link is still."""
    axle, placement = axle_of(description, model, link), link_placement(model, link)
    points = []
    for shape in shapes:
        try:
            # legs and tracks may be on joints without limits, too
            rolls = axle is not None and is_round(shape, placement, axle, meshes)
            points.append(lowest_points(shape, placement, axle if rolls else None, meshes))
        except MachineError as fault:
            raise MachineError(f"link {link!r}: {fault}") from None
    return points


def _ground(contacts: Sequence[Contact]) -> tuple[float, float]:
    """Height of the lowest contact, and how far above it another may end [m]."""
    points = np.concatenate([points for _, points in contacts])
    ground = float(points[:, 2].min())
    low = points[points[:, 2] <= ground + NEAR * MOST]
    width = float(np.linalg.norm(np.ptp(low[:, :2], axis=0)))
    # rounding of sums of decimal numbers must not decide
    return ground, min(max(min(LEVEL, SMALL * width), SHARE * width), MOST) + 1e-9


def _polygon(contacts: Sequence[Contact]) -> Footprint:
    """Support polygon of those contacts, (P, 3) each, that touch the ground."""
    ground, tolerance = _ground(contacts)
    touching = [(link, points[points[:, 2] <= ground + tolerance]) for link, points in contacts]
    higher = [
        (link, points)
        for link, points in contacts
        if ground + tolerance < points[:, 2].min() <= ground + NEAR * tolerance
    ]
    try:
        polygon = _hull(touching, ground)
    except MachineError as fault:
        said = f" ({_left_out(higher, ground)} left out)" if higher else ""
        raise MachineError(f"{fault}{said}") from None
    standing = {link for link, points in touching if len(points)}
    # a link that stands may have raised ends, as tracks have
    larger = _area(_hull([*touching, *higher], ground)) > GROWTH * _area(polygon)
    missed = [
        (link, points)
        for link, points in higher
        if (polygon.signed_distance(points[:, :2]) < -tolerance).any()
        and (larger or link not in standing)
    ]
    if not missed:
        return Footprint(polygon)
    return Footprint(
        polygon,
        f"the support polygon leaves out {_left_out(missed, ground)}: "
        "give support= if the ground reaches there",
    )


def _hull(contacts: Sequence[Contact], height: float) -> SupportPolygon:
    """Support polygon of some contacts; of many corners those that matter most."""
    points = np.concatenate([points[:, :2] for _, points in contacts])
    polygon = SupportPolygon.convex_hull(points, height)
    corners = polygon.vertices
    if len(corners) <= MOST_CORNERS:
        return polygon
    while len(corners) > MOST_CORNERS:  # without the corner that takes the least area with it
        to, fro = np.roll(corners, -1, axis=0) - corners, np.roll(corners, 1, axis=0) - corners
        corners = np.delete(corners, np.argmin(to[:, 0] * fro[:, 1] - to[:, 1] * fro[:, 0]), axis=0)
    return SupportPolygon.convex_hull(corners, height)


def _area(polygon: SupportPolygon) -> float:
    """Area of a polygon [m^2]."""
    (x, y), (far_x, far_y) = polygon.vertices.T, np.roll(polygon.vertices, -1, axis=0).T
    return float(0.5 * (x @ far_y - y @ far_x))


def _left_out(contacts: Sequence[Contact], ground: float) -> str:
    """Links that end just above the contacts, in words."""
    gaps: dict[str, float] = {}
    for link, points in contacts:
        gaps[link] = min(gaps.get(link, np.inf), float(points[:, 2].min()) - ground)
    named = [f"link {link!r}, {length_text(gap)} above the ground" for link, gap in gaps.items()]
    return first(named)


def _moved_by(description: UrdfDescription, model: Any, link: str) -> str:
    """Name of the joint that moves a link."""
    above = {joint.child: joint for joint in description.joints}
    while not model.existJointName(above[link].name):
        link = above[link].parent
    return above[link].name


def _suggestion(
    description: UrdfDescription,
    model: Any,
    still: Sequence[str],
    rolling: Sequence[Array],
    meshes: MeshFolders,
) -> str:
    """Bounding rectangle of the shapes near the ground, as code; empty if there are none.

    Args:
        description: Content of the URDF.
        model: Pinocchio model of the URDF, in which held joints are fixed.
        still: Links that no planned joint moves.
        rolling: Lowest points of wheels that planned joints turn, shape (P, 3) each [m].
        meshes: Folders in which meshes may lie.
    """
    found = [
        points
        for shapes in (description.shapes, description.visuals)
        for points in _readable(description, model, still, shapes, meshes)
    ]
    found += rolling
    if not found:
        return ""
    points = np.concatenate(found)
    width = float(np.linalg.norm(np.ptp(points[:, :2], axis=0)))
    ground = float(points[:, 2].min())
    low = points[points[:, 2] <= ground + max(SLAB * width, LEVEL)]
    (x, y), (far_x, far_y) = low[:, :2].min(axis=0), low[:, :2].max(axis=0)
    if min(far_x - x, far_y - y) < LEVEL:
        return ""
    corners = ", ".join(
        f"[{a:.3f}, {b:.3f}]" for a, b in ((x, y), (far_x, y), (far_x, far_y), (x, far_y))
    )
    return (
        "; if it stands on the rectangle around its lowest shapes: "
        f"support=zs.SupportPolygon([{corners}], height={ground:.3f})"
    )


def _readable(
    description: UrdfDescription,
    model: Any,
    still: Sequence[str],
    shapes: Mapping[str, tuple[Shape, ...]],
    meshes: MeshFolders,
) -> list[Array]:
    """Lowest points of those shapes that can be read."""
    found = []
    for link in still:
        for shape in shapes.get(link, ()):
            try:
                found += _contacts(description, model, link, [shape], meshes)
            except MachineError:
                continue
    return found
