"""The feller-buncher's URDF rewritten: root axes turned, root raised. The machine is the same."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin

import zmp_sqp as zs
from zmp_sqp.mechanics.ground import GRAVITY

__all__ = ["Array", "rewritten", "slope_of", "turned_urdf"]

Array = np.ndarray
LIMITS = "feller_buncher.joint_limits.yaml"


def turned_urdf(text: str, *, turn: float = 0.0, raised: float = 0.0) -> str:
    """URDF in which all that hangs on the root link is turned about z and lowered.

    Args:
        text: URDF with a root link named base_link.
        turn: Angle by which the machine turns in the root's axes [rad]; pi / 2: y is forward.
        raised: Height of the new root origin above the old one [m].
    """
    robot = ET.fromstring(text)
    (root,) = (link for link in robot.findall("link") if link.get("name") == "base_link")
    hanging = [*root.findall("inertial"), *root.findall("visual"), *root.findall("collision")]
    for joint in robot.findall("joint"):
        parent = joint.find("parent")
        if parent is not None and parent.get("link") == "base_link":
            hanging.append(joint)
    R = pin.rpy.rpyToMatrix(0.0, 0.0, turn)
    for element in hanging:
        origin = element.find("origin")
        if origin is None:
            origin = ET.SubElement(element, "origin")
        given = [np.array(origin.get(key, "0 0 0").split(), dtype=float) for key in ("xyz", "rpy")]
        place = R @ given[0] - [0.0, 0.0, raised]
        rpy = pin.rpy.matrixToRpy(R @ pin.rpy.rpyToMatrix(given[1]))
        origin.set("xyz", " ".join(map(repr, place.tolist())))
        origin.set("rpy", " ".join(map(repr, rpy.tolist())))
    return ET.tostring(robot, encoding="unicode")


@cache
def rewritten(*, turn: float = 0.0, raised: float = 0.0) -> zs.Machine:
    """The feller-buncher of such a URDF, with its own joint limits."""
    source = zs.shipped_machines()["feller_buncher"]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "feller_buncher.urdf"
        path.write_text(turned_urdf(source.read_text(), turn=turn, raised=raised))
        return zs.load_machine(path, limits=source.with_name(LIMITS))


def slope_of(ground: zs.Slope, turn: float) -> zs.Slope:
    """The slope in the axes of a root in which the machine is turned: gravity turns with it.

    Gravity in the root frame is (sin(pitch), -cos(pitch) sin(roll), -cos(pitch) cos(roll)) times g.
    """
    x, y, z = pin.rpy.rpyToMatrix(0.0, 0.0, turn) @ ground.gravity() / GRAVITY
    return zs.Slope(roll=float(np.arctan2(-y, -z)), pitch=float(np.arcsin(x)))
