"""Which chains the simplified model serves, with signs of their own, and what it says to others."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
from tests.planning.conftest import pose
from tests.rewritten import LIMITS
from zmp_sqp.planning import simplified_coordinates

SAME = 1e-9  # [s]


def positions_of(plan: zs.Plan) -> np.ndarray:
    """Joint positions at 100 times, shape (100, 5)."""
    return np.asarray(plan.trajectory(np.linspace(0.0, plan.duration, 100))[0])


@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_the_signs_of_the_simplified_models_joints_are_the_machines_own(
    signs: tuple[int, int], tmp_path: Path
) -> None:
    """Axes of boom and stick the other way round: the same motions with other signs."""
    source = zs.shipped_machines()["feller_buncher"]
    path, text = tmp_path / "machine.urdf", source.read_text()
    boom, stick = signs
    path.write_text(_with_axes(text, {"boom": boom, "stick": stick, "tilt": -stick}))
    machine = zs.load_machine(path, limits=source.with_name(LIMITS))
    flips = np.array([1.0, boom, stick, -stick, 1.0])
    limits = {
        "position_lower": np.minimum(
            flips * machine.limits.position_lower, flips * machine.limits.position_upper
        ),
        "position_upper": np.maximum(
            flips * machine.limits.position_lower, flips * machine.limits.position_upper
        ),
    }
    machine = replace(machine, limits=machine.limits.updated(limits, machine.joint_names))
    for bounds in (None, zs.DistanceLimits(0.9, 1.2)):
        plans = [
            zs.plan(
                zs.Problem(
                    side,
                    flip * pose(0.0, -0.6),
                    flip * pose(2.0, -0.3),
                    ground=zs.Slope(roll=-0.2),
                    model="simplified",
                    distance_limits=bounds,
                )
            )
            for side, flip in ((zs.load_machine(source), np.ones(5)), (machine, flips))
        ]
        assert plans[0].success
        assert plans[1].success, plans[1].message
        assert abs(plans[1].duration - plans[0].duration) <= SAME
        assert abs(plans[1].certificate.margin - plans[0].certificate.margin) <= 1e-6
        np.testing.assert_allclose(
            positions_of(plans[1]), flips * positions_of(plans[0]), atol=1e-4
        )
    start = flips * pose(0.0, -0.6) + np.array([0.0, 0.0, 0.1, 0.0, 0.0])
    with pytest.raises(zs.ProblemError, match=r"'stick' = -?pi [-+] 2 'boom'"):
        zs.Problem(machine, start, start, model="simplified")


def _with_axes(text: str, signs: dict[str, int]) -> str:
    """URDF in which the axes of some joints are multiplied by 1 or -1."""
    robot = ET.fromstring(text)
    for joint in robot.findall("joint"):
        for axis in joint.findall("axis") if joint.get("name") in signs else ():
            given = np.array(axis.attrib["xyz"].split(), dtype=float)
            axis.set("xyz", " ".join(map(str, signs[joint.attrib["name"]] * given)))
    return ET.tostring(robot, encoding="unicode")


@pytest.mark.parametrize(
    ("joint", "change", "words"),
    [
        ("slew", {"axis": "0 0.6 0.8"}, "'slew' to turn about the z axis of the root link, not"),
        ("slew", {"axis": "0 0 -1"}, ""),
        ("boom", {"axis": "0 -0.8 0.6"}, "axes of 'boom' and 'stick' to be parallel, but they are"),
        ("tilt", {"axis": "1 0 0"}, "axes of 'boom' and 'tilt' to be parallel"),
        ("boom", {"type": "prismatic"}, "revolute joints, but 'boom' is prismatic"),
        ("stick", {"parent": "slew"}, "joint 'stick' does not follow 'boom'"),
        ("stick", {"origin": "0 0 3"}, "equal length.*3 m and 3.27 m long"),
        ("stick", {"origin": "3.27 0 0"}, "'boom' to point straight up .*3.27 m ahead of 'boom'"),
        ("tilt", {"origin": "0 0 -3.27"}, "'stick' to point straight up at q = 0"),
        ("stick", {"origin": "0 0.4 3.27"}, ""),  # aside of the plane of the arm
    ],
)
def test_the_simplified_model_says_what_a_chain_lacks(
    joint: str, change: dict[str, str], words: str, tmp_path: Path
) -> None:
    source = zs.shipped_machines()["feller_buncher"]
    robot = ET.fromstring(source.read_text())
    (element,) = (one for one in robot.findall("joint") if one.get("name") == joint)
    keys = {"axis": ("axis", "xyz"), "parent": ("parent", "link"), "origin": ("origin", "xyz")}
    for key, value in change.items():
        if key == "type":
            element.set(key, value)
            continue
        tag, attribute = keys[key]
        (part,) = element.findall(tag)
        part.set(attribute, value)
    path = tmp_path / "machine.urdf"
    path.write_text(ET.tostring(robot, encoding="unicode"))
    machine, start = zs.load_machine(path), pose(0.0, -0.5)
    if not words:
        assert simplified_coordinates(machine, start).size == 2
        return
    with pytest.raises(zs.ProblemError, match=f"^the simplified model needs .*{words}"):
        simplified_coordinates(machine, start)


def test_the_simplified_model_says_why_it_does_not_serve_the_excavator() -> None:
    machine = zs.load_machine("excavator")
    rest = np.array([0.0, 0.68, -0.98, -1.27])
    with pytest.raises(zs.ProblemError, match=r"'boom' and 'stick' are 5\.7 m and 2\.925 m long"):
        zs.Problem(machine, rest, rest, model="simplified")


def test_a_centre_of_mass_off_the_arm_has_no_lumped_mass() -> None:
    machine = zs.load_machine("feller_buncher")
    model = machine.model.copy()
    body = model.inertias[model.getJointId("boom")]
    body.lever = body.lever + np.array([0.3, 0.0, 0.0])
    model.inertias[model.getJointId("boom")] = body
    bulky = replace(machine, model=model)
    start = pose(0.0, -0.5)
    zs.Problem(bulky, start, start, model="simplified")  # distances are not needed
    with pytest.raises(zs.ProblemError, match=r"eq. \(9\)\).*centres of mass of boom and stick"):
        zs.plan(
            zs.Problem(
                bulky,
                start,
                pose(1.0, -0.5),
                model="simplified",
                distance_limits=zs.DistanceLimits(1.0, 1.0),
            )
        )
