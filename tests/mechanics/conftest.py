"""Machines, terrain and random motions for the tests of the mechanics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.payload import Payload
from zmp_sqp.mechanics.terrain.heightmap import Heightmap
from zmp_sqp.mechanics.urdf.loader import load_machine

TREE_COM = (0.0, 0.0, 3.323)  # [m] in the head's frame, paper.md
STEM = 4000.0 * 8.0**2 / 12.0  # [kg m^2] uniform stem about its transverse axes, paper.md

# Pinocchio sorts siblings by name, so its order differs from the file's: 'a_turn' comes before
# 'z_slide' and all joints below it. The axes are oblique, two joints are continuous (nq = 2), one
# is prismatic, and a tool with mass is fixed to the last link.
PERMUTED = """<robot name="permuted">
  <link name="base"><inertial><origin xyz="0.1 -0.2 0.3"/><mass value="300"/>
    <inertia ixx="20" ixy="1" ixz="0" iyy="25" iyz="0" izz="30"/></inertial>
    <collision><origin xyz="0 0 0.2"/><geometry><box size="2 1 0.4"/></geometry></collision></link>
  <joint name="z_slide" type="prismatic"><parent link="base"/><child link="slide"/>
    <origin xyz="0.3 0.1 0.5" rpy="0.2 0.1 -0.4"/><axis xyz="0.6 0 0.8"/>
    <limit lower="-1" upper="2" velocity="0.5" effort="100"/></joint>
  <link name="slide"><inertial><origin xyz="0 0.1 0.2" rpy="0.3 0 0"/><mass value="40"/>
    <inertia ixx="2" ixy="0" ixz="0.1" iyy="3" iyz="0" izz="4"/></inertial></link>
  <joint name="a_turn" type="continuous"><parent link="base"/><child link="turn"/>
    <origin xyz="-0.4 0 0.6"/><axis xyz="0 0.6 0.8"/><limit velocity="1.5" effort="0"/></joint>
  <link name="turn"><inertial><origin xyz="0.5 0 0.1"/><mass value="25"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0.2" izz="2"/></inertial></link>
  <joint name="wrist" type="continuous"><parent link="slide"/><child link="hand"/>
    <origin xyz="0.2 0 0.4" rpy="0 1 0"/><axis xyz="1 0 0"/><limit velocity="2" effort="5"/></joint>
  <link name="hand"><inertial><origin xyz="0.3 0.2 0"/><mass value="12"/>
    <inertia ixx="0.5" ixy="0" ixz="0" iyy="0.6" iyz="0" izz="0.7"/></inertial></link>
  <joint name="tool_mount" type="fixed"><parent link="hand"/><child link="tool"/>
    <origin xyz="0.1 0 0.3" rpy="0 0 0.5"/></joint>
  <link name="tool"><inertial><origin xyz="0 0 0.2"/><mass value="6"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.12" iyz="0" izz="0.15"/></inertial></link>
</robot>
"""


@pytest.fixture(scope="session")
def feller_buncher() -> Machine:
    return load_machine("feller_buncher")


@pytest.fixture(scope="session")
def loaded(feller_buncher: Machine) -> Machine:
    """The paper's machine and tree, rigid bodies."""
    return feller_buncher.with_payload(
        Payload(4000.0, TREE_COM, "head", np.diag([STEM, STEM, 0.0]))
    )


@pytest.fixture(scope="session")
def paper(loaded: Machine) -> Machine:
    """The paper's machine and tree, point masses."""
    return loaded.with_point_masses()


@pytest.fixture(scope="session")
def permuted(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    path: Path = tmp_path_factory.mktemp("permuted") / "permuted.urdf"
    path.write_text(PERMUTED)
    return load_machine(path)


def random_motion(
    machine: Machine, count: int, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, rates and accelerations within the paper's limits, shape (count, n) each."""
    random = np.random.default_rng(seed)
    size = (count, machine.size)
    return (
        random.uniform(-2.5, 2.5, size),
        random.uniform(-0.8, 0.8, size),
        random.uniform(-1.6, 1.6, size),
    )


# --- terrain -----------------------------------------------------------------------------------

RESOLUTION = 0.5  # [m]
MAP_X, MAP_Y = -3.0 + RESOLUTION * np.arange(60), 1.0 + RESOLUTION * np.arange(50)  # [m]
MAP_ORIGIN = (float(MAP_X[0]), float(MAP_Y[0]))


@pytest.fixture(scope="session")
def rolling() -> Heightmap:
    """A side slope with waves of about 16 by 21 m."""
    x, y = MAP_X[None, :], MAP_Y[:, None]
    return Heightmap(
        0.3 * np.sin(0.4 * x) * np.cos(0.3 * y) + 0.15 * x - 0.3 * y, RESOLUTION, MAP_ORIGIN
    )


def random_drive(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses on the map, rates and accelerations of a tracked base.

    Shapes (count, 3), (count, 2), (count, 2).
    """
    random = np.random.default_rng(seed)
    low, high = [MAP_X[0] + 2.0, MAP_Y[0] + 2.0, -4.0], [MAP_X[-1] - 2.0, MAP_Y[-1] - 2.0, 4.0]
    pose = random.uniform(low, high, (count, 3))
    return pose, random.uniform(-3.0, 3.0, (count, 2)), random.uniform(-2.0, 2.0, (count, 2))
