"""The claims of urdf/README.md: masses of Table I, inertias of solids, footprint."""

import math
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

URDF = Path(__file__).resolve().parents[1] / "urdf"
OURS = ("excavator", "forwarder_crane", "mobile_manipulator")
NAMES = ("feller_buncher", "slider", "slewing_crane", *OURS)
ROUNDING = 1e-6  # [kg m^2], six decimals in the file


def parse(name):
    builder = ET.TreeBuilder(insert_comments=True)
    return ET.parse(URDF / f"{name}.urdf", ET.XMLParser(target=builder)).getroot()


def vector(element, key, default="0 0 0"):
    return np.array(
        [float(x) for x in (default if element is None else element.get(key, default)).split()]
    )


INERTIALS = [
    pytest.param(inertial, id=f"{name}-{link.get('name')}")
    for name in NAMES
    for link in parse(name).iter("link")
    for inertial in link.iter("inertial")
]


def tensor(inertial):
    entry = inertial.find("inertia")
    xx, xy, xz, yy, yz, zz = (
        float(entry.get(key)) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def solid_inertia(mass, description):
    """Diagonal inertia of the solid that a comment in the URDF names [kg m^2]."""
    numbers = [float(x) for x in re.findall(r"\d+\.\d+", description)]
    if "box" in description:
        x, y, z = numbers
        return mass / 12 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])
    if "cylinder" in description:
        radius, length = numbers
        across = mass * (3 * radius**2 + length**2) / 12
        return np.array([across, across, mass * radius**2 / 2])
    assert "sphere" in description
    return np.full(3, 0.4 * mass * numbers[0] ** 2)


@pytest.mark.parametrize("inertial", INERTIALS)
def test_inertias_are_those_of_the_stated_solids(inertial):
    (solid,) = (child.text for child in inertial if child.tag is ET.Comment)
    mass = float(inertial.find("mass").get("value"))
    np.testing.assert_allclose(
        tensor(inertial), np.diag(solid_inertia(mass, solid)), rtol=0, atol=ROUNDING
    )


@pytest.mark.parametrize("inertial", INERTIALS)
def test_inertias_are_positive_definite_and_satisfy_the_triangle_inequality(inertial):
    smallest, middle, largest = np.linalg.eigvalsh(tensor(inertial))
    assert smallest > 0.0
    assert smallest + middle > largest


def build(name):
    return pin.buildModelFromUrdf(str(URDF / f"{name}.urdf"), pin.JointModelFreeFlyer())


def zmp_of_one_joint(name, q, v, a):
    model = build(name)
    configuration = pin.neutral(model)
    configuration[7] = q
    still = np.zeros(6)
    wrench = pin.rnea(
        model, model.createData(), configuration, np.append(still, v), np.append(still, a)
    )[:6]
    return np.array([-wrench[4], wrench[3]]) / wrench[2]


def test_masses_and_centres_of_mass_are_those_of_the_table():
    # Song & Sharf 2020, Table I [kg]; centre of mass in the link's frame, urdf/README.md [m]
    table = {
        "root_joint": (13000.0, (0, 0, 0.80)),
        "slew": (5000.0, (0, 0, 0.48)),
        "boom": (2000.0, (0, 0, 1.635)),
        "stick": (1000.0, (0, 0, 1.635)),
        "tilt": (50.0, (0, 0, 0.229)),
        "head": (2600.0, (0, 0, 0)),
    }
    model = build("feller_buncher")
    bodies = {
        name: (i.mass, i.lever)
        for name, i in zip(model.names, model.inertias, strict=True)
        if name != "universe"
    }
    assert list(bodies) == list(table)
    for name, (mass, centre) in table.items():
        assert bodies[name][0] == pytest.approx(mass, abs=1e-9)
        np.testing.assert_allclose(bodies[name][1], centre, atol=1e-12)
    assert sum(mass for mass, _ in bodies.values()) == pytest.approx(23650.0, abs=1e-9)


def test_link_lengths_are_those_of_the_table():
    model = build("feller_buncher")
    placement = {
        name: model.jointPlacements[model.getJointId(name)].translation for name in model.names[2:]
    }
    expected = {"slew": 1.60, "boom": 0.96, "stick": 3.27, "tilt": 3.27, "head": 0.458}
    for name, height in expected.items():
        np.testing.assert_allclose(placement[name], (0, 0, height), atol=1e-12)


def test_the_head_axis_points_up_when_the_tilt_link_is_level():
    model = build("feller_buncher")
    data, q = model.createData(), pin.neutral(model)
    q[7:] = [0.3, -math.pi / 6, -2 * math.pi / 3, math.pi / 3, 0.7]  # boom + stick + tilt = -pi/2
    pin.forwardKinematics(model, data, q)
    np.testing.assert_allclose(
        data.oMi[model.getJointId("head")].rotation[:, 2], (0, 0, 1), atol=1e-12
    )


def test_limits_are_those_of_section_v():
    joints = [
        joint for joint in parse("feller_buncher").iter("joint") if joint.get("type") == "revolute"
    ]
    accelerations = yaml.safe_load((URDF / "feller_buncher.joint_limits.yaml").read_text())[
        "joint_limits"
    ]
    assert [joint.get("name") for joint in joints] == list(accelerations)
    for joint in joints:
        assert float(joint.find("limit").get("velocity")) == math.pi / 4
        assert accelerations[joint.get("name")]["max_acceleration"] == math.pi / 2


def test_the_tracks_stand_on_the_ground_and_span_the_support_rectangle():
    root = parse("feller_buncher")
    corners = []
    for side in ("left_track", "right_track"):
        (box,) = (
            link.find("collision/geometry/box")
            for link in root.iter("link")
            if link.get("name") == side
        )
        (mount,) = (
            j
            for j in root.iter("joint")
            if j.find("child") is not None and j.find("child").get("link") == side
        )
        centre, half = vector(mount.find("origin"), "xyz"), vector(box, "size") / 2
        corners += [centre - half, centre + half]
    lower, upper = np.min(corners, axis=0), np.max(corners, axis=0)
    np.testing.assert_allclose(lower, (-2.5, -1.615, 0.0), atol=1e-12)
    np.testing.assert_allclose(upper[:2], (2.5, 1.615), atol=1e-12)


@pytest.mark.parametrize(("x", "acceleration"), [(0.3, 0.0), (-0.4, 1.7), (0.1, -2.5)])
def test_the_slider_moves_the_zmp_as_its_closed_form_says(x, acceleration):
    model = build("slider")
    gravity = -model.gravity.linear[2]
    expected = 1000 / 1100 * (x - 2.0 / gravity * acceleration)
    np.testing.assert_allclose(
        zmp_of_one_joint("slider", x, 0.2, acceleration), (expected, 0.0), atol=1e-12
    )


@pytest.mark.parametrize(("rate", "acceleration"), [(0.0, 0.0), (0.5, 0.0), (0.4, -1.2)])
def test_the_slewing_crane_moves_the_zmp_as_its_quadrature_says(rate, acceleration):
    gravity = -build("slewing_crane").gravity.linear[2]
    lever = 1000 * 2.0 / 2000  # m d / M
    expected = lever * math.hypot(1 + 3.0 * rate**2 / gravity, 3.0 * acceleration / gravity)
    zmp = zmp_of_one_joint("slewing_crane", 0.8, rate, acceleration)
    assert np.linalg.norm(zmp) == pytest.approx(expected, abs=1e-12)


@pytest.mark.physics
@pytest.mark.parametrize(
    ("name", "mass"),
    [
        ("feller_buncher", 23650.0),
        ("slider", 1100.0),
        ("slewing_crane", 2000.0),
        ("excavator", 22500.0),
        ("forwarder_crane", 17880.0),
        ("mobile_manipulator", 119.104),
    ],
)
def test_mujoco_sees_the_same_mass(name, mass):
    mujoco = pytest.importorskip("mujoco")
    text = (URDF / f"{name}.urdf").read_text()
    options = '<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco>'
    spec = mujoco.MjSpec.from_string(text.replace("</robot>", f"{options}</robot>"))
    spec.worldbody.first_body().add_freejoint()
    assert spec.compile().body_mass.sum() == pytest.approx(mass, abs=1e-6)
