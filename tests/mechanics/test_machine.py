from __future__ import annotations

import pickle

import numpy as np
import pinocchio as pin
import pytest

from tests.mechanics.conftest import TREE_COM, random_motion
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.ground import Slope
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.payload import Payload
from zmp_sqp.mechanics.zero_moment_point import zmp

SAME = 1e-12  # [m], the same sums in another order


def test_joints_keep_the_order_of_the_file_where_pinocchio_permutes_them(permuted: Machine) -> None:
    assert permuted.joint_names == ("z_slide", "a_turn", "wrist")
    assert [permuted.model.names[i] for i in range(2, 5)] == ["a_turn", "z_slide", "wrist"]
    np.testing.assert_array_equal(permuted.limits.velocity, [0.5, 1.5, 2.0])
    np.testing.assert_array_equal(permuted.limits.position_upper, [2.0, np.inf, np.inf])
    assert permuted.continuous == (False, True, True)


def test_each_coordinate_moves_the_joint_of_its_name(permuted: Machine) -> None:
    data = permuted.model.createData()
    for column, name in enumerate(permuted.joint_names):
        q = np.zeros((2, 3))
        q[1, column] = 0.4
        still, moved = [], []
        for into, configuration in zip((still, moved), permuted.configuration(q), strict=True):
            pin.forwardKinematics(permuted.model, data, configuration)
            into.extend(placement.copy() for placement in data.liMi)
        shifted = [
            permuted.model.names[j]
            for j in range(1, permuted.model.njoints)
            if not still[j].isApprox(moved[j])
        ]
        assert shifted == [name]


def test_continuous_joints_are_periodic(permuted: Machine) -> None:
    q, v, a = random_motion(permuted, 1, seed=11)
    turned = q + np.array([0.0, 2 * np.pi, -4 * np.pi])
    np.testing.assert_allclose(
        zmp(permuted, turned, v, a, Slope()), zmp(permuted, q, v, a, Slope()), atol=1e-9
    )


@pytest.mark.parametrize("fixture", ["loaded", "paper", "permuted"])
def test_machine_survives_pickling(fixture: str, request: pytest.FixtureRequest) -> None:
    machine: Machine = request.getfixturevalue(fixture)
    twin = pickle.loads(pickle.dumps(machine))
    q, v, a = random_motion(machine, 3, seed=12)
    np.testing.assert_array_equal(zmp(twin, q, v, a, Slope()), zmp(machine, q, v, a, Slope()))
    assert twin.joint_names == machine.joint_names
    # needs the inertias of the frames
    point_masses = (each.with_point_masses() for each in (twin, machine))
    np.testing.assert_array_equal(*(zmp(each, q, v, a, Slope()) for each in point_masses))


def test_payload_and_point_masses_commute(feller_buncher: Machine) -> None:
    tree = Payload(4000.0, TREE_COM, "head")
    first, last = (
        feller_buncher.with_payload(tree).with_point_masses(),
        feller_buncher.with_point_masses().with_payload(tree),
    )
    q, v, a = random_motion(first, 5, seed=13)
    np.testing.assert_allclose(zmp(first, q, v, a, Slope()), zmp(last, q, v, a, Slope()), atol=SAME)


@pytest.mark.parametrize("fixture", ["loaded", "permuted"])
def test_point_masses_keep_mass_and_centre_of_mass(
    fixture: str, request: pytest.FixtureRequest
) -> None:
    machine: Machine = request.getfixturevalue(fixture)
    twin = machine.with_point_masses()
    assert twin.mass == pytest.approx(machine.mass)
    for ours, theirs in zip(twin.model.inertias, machine.model.inertias, strict=True):
        np.testing.assert_allclose(ours.mass * ours.lever, theirs.mass * theirs.lever, atol=1e-9)


def test_frames_hold_the_inertia_that_pinocchio_lumps_into_the_joints(permuted: Machine) -> None:
    for joint in range(1, permuted.model.njoints):
        frames = [frame for frame in permuted.model.frames if frame.parentJoint == joint]
        total = sum(
            (frame.placement.act(frame.inertia) for frame in frames), start=pin.Inertia.Zero()
        )
        assert total.isApprox(permuted.model.inertias[joint], 1e-9)


def test_changes_leave_the_original_alone(feller_buncher: Machine) -> None:
    heavier = feller_buncher.with_payload(Payload(100.0, (0, 0, 0), "head")).with_limits(
        velocity=0.1
    )
    assert feller_buncher.mass == pytest.approx(23650.0)
    assert heavier.mass == pytest.approx(23750.0)
    assert feller_buncher.limits.velocity[0] == pytest.approx(np.pi / 4)
    assert heavier.limits.velocity[0] == 0.1
    assert heavier.limits.acceleration[0] == pytest.approx(np.pi / 2)


def test_support_must_be_a_support_polygon(feller_buncher: Machine) -> None:
    with pytest.raises(MachineError, match="SupportPolygon, not list"):
        feller_buncher.with_support([[0, 0], [1, 0], [0, 1]])
