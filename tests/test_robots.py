"""Machines of others: all that Pinocchio loads, load; some are planned, and checked without it."""

from __future__ import annotations

import warnings
from pathlib import Path

import pinocchio as pin
import pytest

import zmp_sqp as zs
from benchmarks.problems.robots import (
    load_robot,
    random_problems,
    robot_files,
    robots_folder,
)
from benchmarks.robots import run

FOLDER = robots_folder()
pytestmark = pytest.mark.skipif(FOLDER is None, reason="example-robot-data is not installed")
PLANNED = (
    "tiago_description/robots/tiago.urdf",
    "tiago_pro_description/robots/tiago_pro.urdf",
    "pr2_description/urdf/pr2.urdf",
    "baxter_description/urdf/baxter.urdf",
    "talos_data/robots/talos_reduced.urdf",
    "centauro_description/urdf/centauro.urdf",
    "anymal_b_simple_description/robots/anymal-kinova.urdf",
    "b1_description/urdf/b1-z1.urdf",
)


def pinocchio_loads(path: Path) -> bool:
    try:
        pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    except ValueError:
        return False
    return True


def test_what_pinocchio_loads_loads_with_its_mass_and_joints() -> None:
    loaded = 0
    for path in robot_files(FOLDER):
        if not pinocchio_loads(path):
            with pytest.raises(zs.MachineError, match=path.name):
                zs.load_machine(path)
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", zs.MachineWarning)
            machine = zs.load_machine(path, package_dirs=[FOLDER.parents[1]])
        model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
        assert machine.mass == pytest.approx(sum(body.mass for body in model.inertias))
        assert len(machine.coupling.leader) == model.njoints - 2
        loaded += 1
    assert loaded >= 75


@pytest.mark.parametrize("name", PLANNED)
def test_arms_of_others_are_planned_and_certified(name: str) -> None:
    row = run(FOLDER / name, FOLDER, 2)
    assert (row["problems"], row["solved"]) == (2, 2), row
    assert row["standing"] >= 0.5
    assert row["held"] > 0


def test_all_joints_of_a_humanoid_are_planned_on_few_intervals() -> None:
    path = FOLDER / "talos_data/robots/talos_reduced.urdf"
    robot = load_robot(path, FOLDER, whole=True)
    assert robot.machine is not None
    assert robot.machine.size == 20
    assert "torso_1_joint" in robot.machine.joint_names
    assert not any(name.startswith("leg") for name in robot.machine.joint_names)
    assert next(random_problems(robot, 1))[1].intervals == 24
    row = run(path, FOLDER, 2, whole=True)
    assert (row["problems"], row["solved"]) == (2, 2), row


def test_blocked_problems_are_told_from_missed_ones() -> None:
    """The shoulder of a UR5 passes the horizontal; one with narrower limits never has to."""
    row = run(FOLDER / "ur_description/urdf/ur5_robot.urdf", FOLDER, 2)
    assert (row["problems"], row["solved"], row["blocked"]) == (2, 0, 2)
    row = run(FOLDER / "ur_description/urdf/ur10_joint_limited_robot.urdf", FOLDER, 2)
    assert (row["problems"], row["solved"], row["blocked"]) == (2, 2, 0)


def test_what_has_no_arm_says_so() -> None:
    robot = load_robot(FOLDER / "go2_description/urdf/go2.urdf", FOLDER)
    assert robot.machine is None
    assert "no arm on a base: link 'FL_foot' moves" in robot.refusal
