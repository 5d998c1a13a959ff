"""Links without mass and inertias that no body can have are taken as the URDF has them."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import zmp_sqp as zs
from tests.mechanics.test_urdf import ARM, BASE, TOY, TURN, edited, write
from zmp_sqp.mechanics.bounds.effort_bounds import effort_bounds
from zmp_sqp.mechanics.wrench import efforts

SQUARE = zs.SupportPolygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
LIMITS = {"acceleration": 1.0}


def wrench(model: pin.Model, q: float, v: float, a: float) -> np.ndarray:
    """Ground reaction of a model that Pinocchio reads from the file itself."""
    root = np.array([0, 0, 9.81, 0, 0, 0])
    configuration = np.array([0, 0, 0, 0, 0, 0, 1, q])
    model.gravity = pin.Motion.Zero()
    return pin.rnea(model, model.createData(), configuration, np.r_[np.zeros(6), v], np.r_[root, a])


@pytest.mark.parametrize(
    "text",
    [
        edited('value="2"', 'value="0"'),
        edited('value="2"', 'value="1e-9"'),
        edited(ARM, '<link name="arm"/>'),
        edited(BASE, '<link name="base"/>'),
        edited(BASE, '<link name="base"/>').replace('value="2"', 'value="0.0"'),
        edited('ixy="0" ixz="0"', 'ixy="0.3" ixz="1e-9"'),
        edited('izz="1"', 'izz="0"'),
        edited('izz="1"', 'izz="-4"'),
        edited('ixx="1" ixy="0" ixz="0" iyy="1"', 'ixx="-3" ixy="5" ixz="0" iyy="-1e-9"'),
    ],
)
def test_masses_and_inertias_are_those_that_pinocchio_reads(tmp_path: Path, text: str) -> None:
    path = write(tmp_path, text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", zs.MachineWarning)
        machine = zs.load_machine(path)
    read = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    q, v, a = 0.3, -0.7, 1.1
    root = np.array([0, 0, 9.81, 0, 0, 0])
    found = efforts(machine, *(np.array([[x]]) for x in (q, v, a)), root_acceleration=root)[0]
    np.testing.assert_allclose(found, wrench(read, q, v, a), rtol=1e-12, atol=1e-12)
    assert machine.with_point_masses().mass == pytest.approx(machine.mass)


def test_a_frame_as_root_stands_where_the_file_puts_it(tmp_path: Path) -> None:
    foot = '<link name="base_footprint"/><joint name="raised" type="fixed">'
    foot += '<parent link="base_footprint"/><child link="base"/><origin xyz="0 0 0.5"/></joint>'
    box = '<collision><geometry><box size="2 1 1"/></geometry></collision></link>'
    text = TOY.replace(BASE, BASE.replace("</link>", box) + foot)
    machine = zs.load_machine(write(tmp_path, text))
    assert machine.support is not None
    assert machine.support.height == pytest.approx(0.0, abs=1e-12)
    assert machine.mass == pytest.approx(12.0)


@pytest.mark.parametrize(
    "inertia",
    [
        'ixx="1e-6" ixy="1e-6" ixz="1e-6" iyy="1e-6" iyz="1e-6" izz="1e-6"',  # a placeholder
        'ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="2.001"',
        'ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"',
        'ixx="0" ixy="0" ixz="0" iyy="-1e-20" iyz="0" izz="1e-20"',
    ],
)
def test_rounding_and_placeholders_pass_without_a_word(tmp_path: Path, inertia: str) -> None:
    text = re.sub('ixx="1".*?izz="1"', inertia, TOY, count=1)
    assert zs.load_machine(write(tmp_path, text), strict=True).mass == pytest.approx(12.0)


def test_impossible_inertias_are_one_warning_and_with_strict_an_error(tmp_path: Path) -> None:
    path = write(tmp_path, TOY.replace('izz="1"', 'izz="3"'))  # both links
    with pytest.warns(zs.MachineWarning) as said:
        zs.load_machine(path)
    text = str(said[0].message)
    assert len(said) == 1
    assert said[0].filename == __file__
    for part in (str(path), "link 'base'", "link 'arm'", "1, 1, 3 kg m^2"):
        assert part in text
    shift = 1e3 * (1.0 + 1.0) / (12.0 * 9.80665)
    assert float(re.search(r"up to (\S+) mm", text)[1]) == pytest.approx(shift, rel=0.05)
    with pytest.raises(zs.MachineError, match="link 'base' has the principal moments"):
        zs.load_machine(path, strict=True)


def test_a_planned_joint_that_moves_no_mass_is_warned_of_and_planned(tmp_path: Path) -> None:
    path = write(tmp_path, edited(ARM, '<link name="arm"/>'))
    with pytest.warns(zs.MachineWarning, match=r"'turn' \(link 'arm'\)"):
        machine = zs.load_machine(path, support=SQUARE, limits=LIMITS)
    constraints = [zs.TorqueLimits()]
    plan = zs.plan(zs.Problem(machine, [-0.5], [0.5], intervals=10, constraints=constraints))
    assert plan.success
    assert plan.certificate.margin == pytest.approx(1.0)
    assert plan.duration == pytest.approx(2.0)  # [s] 2 sqrt(1 / 1)


def test_a_machine_without_joints_or_mass_loads_but_is_not_planned(tmp_path: Path) -> None:
    still = zs.load_machine(write(tmp_path, edited('type="revolute"', 'type="fixed"')))
    assert still.size == 0
    none = np.zeros((1, 0))
    np.testing.assert_allclose(
        zs.zmp(still.with_support(SQUARE), none, none, none, zs.Slope()), [[0.0, 0.0]], atol=1e-12
    )
    with pytest.raises(zs.ProblemError, match="'toy' has no movable joint"):
        zs.Problem(still.with_support(SQUARE), [], [])
    bare = f'<robot name="toy"><link name="base"/><link name="arm"/>{TURN}</robot>'
    with pytest.warns(zs.MachineWarning, match="'turn'"):
        light = zs.load_machine(write(tmp_path, bare), support=SQUARE, limits=LIMITS)
    with pytest.raises(zs.ProblemError, match="'toy' has no mass"):
        zs.Problem(light, [0.0], [0.5])


def test_bounds_hold_for_negative_moments(tmp_path: Path) -> None:
    arm = '<link name="arm"><inertial><mass value="2"/><inertia ixx="0.1" ixy="0" ixz="0" '
    arm += 'iyy="0.1" iyz="0" izz="-7"/></inertial></link>'
    with pytest.warns(zs.MachineWarning, match="'arm'"):
        machine = zs.load_machine(write(tmp_path, edited(ARM, arm)))
    one = np.ones((1, 1))
    root = np.zeros(6)
    torque = efforts(machine, one, 0.0 * one, 3.0 * one, root_acceleration=root)[0, 6]
    size, _ = effort_bounds(
        machine, 0.0 * one, 3.0 * one, 0.0 * one, reach=one, gravity=0.0, joints=True
    )
    assert torque == pytest.approx(-21.0)
    assert size.joints[0, 0] >= 21.0
