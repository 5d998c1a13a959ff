"""MuJoCo's machine is Pinocchio's: mass matrix, bias forces and static ZMP are the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import random_scene
from benchmarks.problems.scene import FOOTPRINT
from zmp_sqp.simulation.multibody import contact_time, multibody_spec

mujoco = pytest.importorskip("mujoco")
pytestmark = pytest.mark.physics

# relative: two engines on the same numbers; bodies get a billionth of their inertia on top
ENGINES = 1e-7
STATIC = 1e-5  # [m] issue 5: static ZMP from contact forces against ours
OURS = ("excavator", "forwarder_crane", "mobile_manipulator")
ODD = """<robot name="odd">
  <link name="base"><inertial><origin xyz="0.1 0 0.3"/><mass value="400"/>
    <inertia ixx="30" ixy="2" ixz="1" iyy="40" iyz="-1" izz="50"/></inertial></link>
  <link name="wheel"><inertial><origin xyz="0 0.1 0.2" rpy="0.3 0.2 0.1"/><mass value="50"/>
    <inertia ixx="3" ixy="0" ixz="0" iyy="4" iyz="0" izz="5"/></inertial></link>
  <joint name="wheel" type="continuous"><parent link="base"/><child link="wheel"/>
    <origin xyz="0.2 0.1 0.6" rpy="0.4 -0.3 0.2"/><axis xyz="0.6 0 0.8"/></joint>
  <link name="ram"><inertial><mass value="20"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="2"/></inertial></link>
  <joint name="ram" type="prismatic"><parent link="wheel"/><child link="ram"/>
    <origin xyz="0 0.3 0.1" rpy="0.1 0.5 0"/><axis xyz="0 0.6 -0.8"/><limit lower="-1"
    upper="1"/></joint>
  <link name="fork"><inertial><origin xyz="0.1 0 0"/><mass value="30"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="2"/></inertial></link>
  <joint name="fork" type="revolute"><parent link="base"/><child link="fork"/>
    <origin xyz="-0.4 0 0.5"/><axis xyz="0 1 0"/><limit lower="-1" upper="1"/></joint>
</robot>"""


def machines(folder: Path) -> dict[str, zs.Machine]:
    path = folder / "odd.urdf"
    path.write_text(ODD, encoding="utf-8")
    foot = zs.SupportPolygon(FOOTPRINT, height=0.05)
    loaded = random_scene(3)[0].load()
    return {
        "odd": zs.load_machine(path, support=foot),
        "crane": zs.load_machine("slewing_crane", support=foot),
        "slider": zs.load_machine("slider", support=foot),
        "loaded": loaded,
        "points": loaded.with_point_masses(),
        **{name: zs.load_machine(name) for name in OURS},
    }


@pytest.mark.parametrize("name", ["odd", "crane", "slider", "loaded", "points", *OURS])
def test_inertia_and_bias_forces_are_pinocchios(tmp_path: Path, name: str) -> None:
    machine, slope = machines(tmp_path)[name], zs.Slope(roll=-0.3, pitch=0.2)
    model = multibody_spec(machine, slope, time_step=1e-3, friction=(1.0, 1.0)).compile()
    data = mujoco.MjData(model)
    random = np.random.default_rng(5)
    q, v = random.uniform(-0.8, 0.8, (2, machine.size))
    at = [model.joint(joint) for joint in machine.joint_names]
    at_v = np.array([joint.dofadr[0] for joint in at])
    data.qpos[[joint.qposadr[0] for joint in at]] = q
    data.qvel[at_v] = v
    mujoco.mj_forward(model, data)

    ours, rates = machine.model.createData(), np.zeros(machine.model.nv)
    rates[machine.index_v] = v
    configuration = machine.configuration(q[None])[0]
    mass = np.triu(pin.crba(machine.model, ours, configuration))
    mass += np.triu(mass, 1).T
    still = np.concatenate([-slope.gravity(), np.zeros(machine.model.nv - 3)])
    bias = pin.rnea(machine.model, ours, configuration, rates, still)

    order = np.concatenate([np.arange(6), machine.index_v])
    places = np.concatenate([np.arange(6), at_v])
    theirs = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, theirs)
    theirs -= np.diag(model.dof_armature)
    scale = np.abs(mass).max()
    drives = 1e-15 * model.dof_armature.max()  # what their inertia rounds off
    np.testing.assert_allclose(
        theirs[np.ix_(places, places)], mass[np.ix_(order, order)], atol=ENGINES * scale + drives
    )
    np.testing.assert_allclose(
        data.qfrc_bias[places], bias[order], atol=ENGINES * np.abs(bias).max()
    )


@pytest.mark.parametrize("seed", range(4))
def test_the_static_zmp_of_the_contact_forces_is_ours(seed: int) -> None:
    scene, poses = random_scene(seed)
    machine, still = scene.load(), np.zeros(5)
    for pose in poses:
        stand = zs.Trajectory(
            machine.joint_names, [0.0, 0.01], [pose, pose], np.zeros((2, 5)), np.zeros((1, 5))
        )
        replay = zs.replay(machine, stand, scene.ground, hold=0.0)
        np.testing.assert_allclose(
            replay.zmp[-1], zs.zmp(machine, pose, still, still, scene.ground), atol=STATIC
        )
        weight = -machine.mass * scene.ground.gravity()[2]
        assert replay.loads[-1].sum() == pytest.approx(weight, rel=1e-6)
        assert replay.lift < 1e-5
        assert replay.slide < 1e-5


def test_ground_sinks_as_far_as_it_is_told_to() -> None:
    """To a factor: MuJoCo scales a foot's spring by the inertia that the foot meets."""
    machine = zs.load_machine(
        "slewing_crane", support=zs.SupportPolygon([[-2, -2], [2, -2], [2, 2], [-2, 2]])
    )
    pose = np.zeros(1)
    for sinkage in (1e-4, 1e-3, 1e-2):
        motion: Any = zs.Trajectory(
            machine.joint_names, [0.0, 0.01], [pose, pose], np.zeros((2, 1)), np.zeros((1, 1))
        )
        replay = zs.replay(machine, motion, zs.Slope(), sinkage=sinkage)
        assert 0.3 * sinkage < -replay.lifts[-1].mean() < 3.0 * sinkage
        assert contact_time(sinkage) > 2e-3
