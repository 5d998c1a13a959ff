"""Reads single elements of a URDF: the mass of a link, a joint, a collision shape."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from math import isfinite, nan

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.errors import MachineError

__all__ = [
    "MOVABLE",
    "UNPLANNED",
    "Body",
    "Joint",
    "Mimic",
    "Shape",
    "numbers",
    "read_body",
    "read_joint",
    "read_shape",
    "spell",
]

MOVABLE = ("revolute", "continuous", "prismatic")  # types of joints that can be planned
UNPLANNED = ("planar", "floating")  # types of joints that can only be held at zero


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """Mass properties of one link.

    Attributes:
        mass: Mass [kg].
        com: Centre of mass in the link frame, shape (3,) [m].
        inertia: Rotational inertia about the centre of mass, link axes, shape (3, 3) [kg m^2].
    """

    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True, slots=True)
class Mimic:
    """A <mimic>: the coordinate of a joint is multiplier times that of another, plus an offset.

    Attributes:
        joint: Name of the other joint.
        multiplier: Factor of its coordinate.
        offset: Coordinate of the mimicking joint where that of the other is zero [rad or m].
    """

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """One joint of a URDF; limits that the file does not give are NaN.

    Attributes:
        name: Name of the joint.
        kind: Type in the URDF, one of `MOVABLE` and `UNPLANNED`, or 'fixed'.
        parent: Name of the parent link.
        child: Name of the child link.
        lower: Lowest coordinate [rad or m].
        upper: Highest coordinate [rad or m].
        velocity: Largest rate [rad/s or m/s].
        effort: Largest torque or force [N m or N].
        mimic: Joint that this one follows, or None; a fixed joint follows none.
        axis: Direction in which the joint turns or slides, link frame, shape (3,).
    """

    name: str
    kind: str
    parent: str
    child: str
    lower: float
    upper: float
    velocity: float
    effort: float
    mimic: Mimic | None = None
    axis: tuple[float, ...] = (1.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One visual or collision shape.

    Attributes:
        kind: 'box', 'cylinder', 'sphere', or 'mesh' for anything else.
        dimensions: Edges of a box; radius and length of a cylinder; radius of a sphere; empty for a
            mesh [m].
        rotation: Rotation from the axes of the shape to those of the link, shape (3, 3).
        translation: Centre of the shape in the link frame, shape (3,) [m].
        filename: File of a mesh as the URDF names it; empty for anything else.
        scale: Factors of a mesh's x, y and z.
    """

    kind: str
    dimensions: tuple[float, ...]
    rotation: Array
    translation: Array
    filename: str = ""
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)


def numbers(element: ET.Element, attribute: str, count: int, where: str) -> tuple[float, ...]:
    """Finite numbers in an attribute of an element.

    Args:
        element: XML element.
        attribute: Name of the attribute.
        count: How many numbers it must hold.
        where: Name of the link or joint, for error messages.

    Raises:
        MachineError: The attribute is missing, or is not `count` finite numbers.
    """
    text = element.get(attribute)
    spelled = f"{where}: <{element.tag} {attribute}>"
    if text is None:
        raise MachineError(f"{spelled} is missing")
    try:
        # float() would accept 1_000, which other URDF parsers do not
        found = tuple(float(word) for word in text.replace("_", "?").split())
    except ValueError:
        found = ()
    if len(found) != count:
        raise MachineError(
            f"{spelled} must be {'a number' if count == 1 else f'{count} numbers'}, not {text!r}"
        )
    if not all(map(isfinite, found)):
        raise MachineError(f"{spelled} must be finite, not {text!r}")
    return found


def spell(element: ET.Element) -> str:
    """Tag and name of an element, for error messages."""
    return f"{element.tag} {element.get('name')!r}"


def read_joint(element: ET.Element) -> Joint:
    """Joint of a <joint> element.

    Raises:
        MachineError: Unsupported type, <mimic> of no joint, no parent or child, zero axis, or
            impossible limits; the message names the joint.
    """
    where, kind = spell(element), element.get("type", "")
    if kind not in (*MOVABLE, *UNPLANNED, "fixed"):
        raise MachineError(
            f"{where} has type {kind!r}; supported are "
            f"{', '.join((*MOVABLE, *UNPLANNED))} and fixed"
        )
    ends = []
    for tag in ("parent", "child"):
        end = element.find(tag)
        if end is None or not end.get("link"):
            raise MachineError(f"{where} has no <{tag} link>")
        ends.append(end.attrib["link"])
    axis = element.find("axis")
    direction: tuple[float, ...] = (1.0, 0.0, 0.0)
    if axis is not None and kind in (*MOVABLE, "planar"):
        direction = numbers(axis, "xyz", 3, where)
        if not any(direction):
            raise MachineError(f"{where}: its axis is zero")
    lower, upper, velocity, effort = _limits(element, kind, where)
    mimic = element.find("mimic") if kind != "fixed" else None
    return Joint(
        element.attrib["name"],
        kind,
        ends[0],
        ends[1],
        lower,
        upper,
        velocity,
        effort,
        mimic=None if mimic is None else _mimic(mimic, where),
        axis=direction,
    )


def _limits(element: ET.Element, kind: str, where: str) -> tuple[float, float, float, float]:
    """Lower and upper position limit, velocity and effort limit of a joint; NaN where not given."""
    lower = upper = velocity = effort = nan
    limit = element.find("limit")
    if limit is not None and kind != "fixed":
        given = {
            key: numbers(limit, key, 1, where)[0]
            for key in ("lower", "upper", "velocity", "effort")
            if key in limit.attrib
        }
        for key in ("velocity", "effort"):
            if given.get(key, 0.0) < 0.0:
                raise MachineError(f"{where}: {key} limit must not be negative, not {given[key]}")
        # zero means "unknown" in many URDFs
        velocity, effort = (given.get(key) or nan for key in ("velocity", "effort"))
        # the URDF specification: a bound that is left out is 0
        if "lower" in given or "upper" in given:
            lower, upper = given.get("lower", 0.0), given.get("upper", 0.0)
    if kind == "continuous":
        lower, upper = -np.inf, np.inf
    if kind in UNPLANNED:
        lower = upper = nan
    if lower > upper:
        raise MachineError(
            f"{where}: lower position limit {lower} is above upper position limit {upper}"
        )
    return lower, upper, velocity, effort


def _mimic(element: ET.Element, where: str) -> Mimic:
    """Values of a <mimic> element."""
    if not element.get("joint"):
        raise MachineError(f"{where}: its <mimic> names no joint")
    given = {
        key: numbers(element, key, 1, where)[0]
        for key in ("multiplier", "offset")
        if key in element.attrib
    }
    return Mimic(element.attrib["joint"], **given)


def read_body(link: ET.Element) -> Body:
    """Mass properties of a <link> element that has an <inertial>.

    The inertia is taken as it is, also if no body can have it.

    Raises:
        MachineError: Mass missing or negative, inertia missing, or a number that is not finite;
            the message names the link.
    """
    where, inertial = spell(link), link.find("inertial")
    parts = {} if inertial is None else {child.tag: child for child in inertial}
    if "mass" not in parts:
        raise MachineError(f"{where}: its <inertial> has no <mass>")
    mass = numbers(parts["mass"], "value", 1, where)[0]
    if mass < 0.0:
        raise MachineError(f"{where}: mass must not be negative, not {mass} kg")
    if "inertia" not in parts:
        raise MachineError(f"{where}: its <inertial> has no <inertia>")
    xx, xy, xz, yy, yz, zz = (
        numbers(parts["inertia"], key, 1, where)[0]
        for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    own_axes = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    rotation, translation = _origin(parts.get("origin"), where)
    return Body(mass, translation, rotation @ own_axes @ rotation.T)


def read_shape(collision: ET.Element) -> Shape:
    """Shape of a <collision> or <visual> element."""
    rotation, translation = _origin(collision.find("origin"), "collision")
    geometry = collision.find("geometry")
    for solid in () if geometry is None else geometry:
        if solid.tag == "box":
            return Shape("box", numbers(solid, "size", 3, "collision"), rotation, translation)
        if solid.tag == "cylinder":
            size = (
                *numbers(solid, "radius", 1, "collision"),
                *numbers(solid, "length", 1, "collision"),
            )
            return Shape("cylinder", size, rotation, translation)
        if solid.tag == "sphere":
            return Shape("sphere", numbers(solid, "radius", 1, "collision"), rotation, translation)
        if solid.tag == "mesh":
            scale = numbers(solid, "scale", 3, "mesh") if "scale" in solid.attrib else (1.0,) * 3
            return Shape("mesh", (), rotation, translation, solid.get("filename", ""), scale)
    return Shape("mesh", (), rotation, translation)


def _origin(origin: ET.Element | None, where: str) -> tuple[Array, Array]:
    """Rotation matrix and translation of an <origin>; the default of both is zero."""
    values = {
        key: (0.0, 0.0, 0.0)
        if origin is None or key not in origin.attrib
        else numbers(origin, key, 3, where)
        for key in ("rpy", "xyz")
    }
    return np.asarray(pin.rpy.rpyToMatrix(np.array(values["rpy"]))), np.array(values["xyz"])
