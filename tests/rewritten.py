"""The feller-buncher's URDF rewritten: root axes turned, root raised. The machine is the same."""

from __future__ import annotations

import importlib
import pkgutil
import sys
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pinocchio as pin

import zmp_sqp as zs
from zmp_sqp.mechanics.ground import GRAVITY, Slope

__all__ = ["LIMITS", "REWRITINGS", "Array", "Rewriting", "rewritten", "slope_of", "turned_urdf"]

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
    return Slope(roll=float(np.arctan2(-y, -z)), pitch=float(np.arcsin(x)))


# --- the whole suite on a rewritten machine -------------------------------------------------------

REWRITINGS = {
    "y-forward": {"turn": np.pi / 2},
    "raised": {"raised": 0.5},
    "both": {"turn": np.pi / 2, "raised": 0.5},
}


@dataclass(frozen=True)
class Rewriting:
    """Puts a rewritten URDF in place of the feller-buncher's for all tests of a session.

    Tests state slopes, and polygons of the feller-buncher, in the axes of the usual root. Where
    they enter the library (`zs.load_machine`, `Machine.with_support`, `zs.Slope`, scenario files
    and options of commands), they are turned into the axes of the rewritten one. Models that tests
    build themselves from the shipped URDF stay as they are, and judge what the library plans.

    Attributes:
        folder: Folder for the rewritten URDF and its joint limits.
        turn: Angle by which the machine turns in the root's axes [rad].
        raised: Height of the new root origin above the old one [m].
    """

    folder: Path
    turn: float = 0.0
    raised: float = 0.0

    def install(self) -> None:
        """Replace what tests and the library's readers of stated numbers call."""
        for found in pkgutil.walk_packages(zs.__path__, "zmp_sqp."):
            if not found.name.endswith("__main__"):
                importlib.import_module(found.name)  # with the names that are replaced below
        rewritten()  # the usual machine, which `concerns` compares with
        source = zs.shipped_machines()["feller_buncher"]
        path = self.folder / source.name
        path.write_text(turned_urdf(source.read_text(), turn=self.turn, raised=self.raised))
        (self.folder / LIMITS).write_text(source.with_name(LIMITS).read_text())
        shipped, load, zmp = zs.shipped_machines, zs.load_machine, zs.zmp
        with_support = zs.Machine.with_support

        def shipped_machines() -> dict[str, Path]:
            return {**shipped(), "feller_buncher": path}

        def load_machine(source: Any, *, support: Any = None, **options: Any) -> zs.Machine:
            machine = load(source, support=support, **options)
            if isinstance(support, zs.SupportPolygon) and self.concerns(machine):
                return replace(machine, support=self.polygon(support))
            return machine

        def stated_support(machine: zs.Machine, support: zs.SupportPolygon) -> zs.Machine:
            if isinstance(support, zs.SupportPolygon) and self.concerns(machine):
                support = self.polygon(support)
            return with_support(machine, support)

        def stated_zmp(machine: zs.Machine, *state: Any, **options: Any) -> Array:
            points = zmp(machine, *state, **options)
            return points @ self.R if self.concerns(machine) else points

        stated: Any = zs.Machine
        stated.with_support = stated_support
        new: list[tuple[Any, Any]] = [
            (shipped, shipped_machines),
            (load, load_machine),
            (zmp, stated_zmp),
        ]
        if self.turn:
            new.append((zs.Slope, _stated_slope(zs.Slope, self.turn)))
        self._replace(new)

    def concerns(self, machine: zs.Machine) -> bool:
        """Whether a machine is the rewritten feller-buncher, or made from its URDF."""
        if machine.joint_names[:1] != ("slew",) or "head" not in machine.joint_names:
            return False
        first = machine.model.jointPlacements[machine.model.getJointId("slew")]
        given = rewritten().model.jointPlacements[rewritten().model.getJointId("slew")]
        return not np.allclose(first.homogeneous, given.homogeneous)

    @property
    def R(self) -> Array:
        """Matrix from the usual root's horizontal axes to the rewritten one's, shape (2, 2)."""
        return np.asarray(pin.rpy.rpyToMatrix(0.0, 0.0, self.turn)[:2, :2])

    def polygon(self, support: zs.SupportPolygon) -> zs.SupportPolygon:
        """A support polygon of the usual root in the axes of the rewritten one."""
        return zs.SupportPolygon(support.vertices @ self.R.T, support.height - self.raised)

    @staticmethod
    def _replace(new: Sequence[tuple[Any, Any]]) -> None:
        """Put new values in place of old ones in all modules that take stated numbers."""
        stated = ("zmp_sqp", "zmp_sqp.mechanics", *STATED)
        for name, module in list(sys.modules.items()):
            if name in stated or name.startswith(STATED_IN):
                for key, value in list(vars(module).items()):
                    for old, other in new:
                        if value is old:
                            setattr(module, key, other)


STATED = (
    "zmp_sqp.mechanics.ground",
    "zmp_sqp.mechanics.urdf.loader",
    "zmp_sqp.mechanics.urdf.sources",
)
STATED_IN = ("zmp_sqp.scenario", "zmp_sqp.commands", "zmp_sqp.paper", "benchmarks")


def _stated_slope(slope: type[zs.Slope], turn: float) -> Any:
    """Class in place of `Slope` that turns roll and pitch as stated about the usual root's axes."""

    class Turned(type):
        def __call__(cls, roll: float = 0.0, pitch: float = 0.0) -> zs.Slope:
            given = slope(roll, pitch)
            return slope_of(given, turn) if given.roll or given.pitch else given

        def __instancecheck__(cls, instance: Any) -> bool:
            return isinstance(instance, slope)

    class StatedSlope(metaclass=Turned):
        gravity, base_pose = slope.gravity, slope.base_pose

    return StatedSlope
