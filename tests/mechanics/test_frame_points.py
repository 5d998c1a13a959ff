"""Points on frames: positions and Jacobians against Pinocchio's placements and differences."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import zmp_sqp as zs
from tests.mimics import MACHINES, coupled

STEP = 1e-6
OFFSET = np.array([0.3, -0.2, 0.5])  # [m]


def machine(name: str) -> zs.Machine:
    return zs.load_machine(name) if name == "feller_buncher" else coupled(name).machine


@pytest.mark.parametrize("name", ["feller_buncher", *MACHINES])
def test_points_are_where_pinocchio_puts_them_and_move_as_their_jacobian_says(name: str) -> None:
    of, rng = machine(name), np.random.default_rng(2)
    q = rng.uniform(-1.0, 1.0, (4, of.size))
    links = [one.name for one in of.model.frames if one.type == pin.FrameType.BODY]
    data = of.model.createData()
    for link in links:
        positions, jacobian = of.point(link, q, OFFSET)
        for k, configuration in enumerate(of.configuration(q)):
            pin.framesForwardKinematics(of.model, data, configuration)
            placement = data.oMf[of.model.getFrameId(link, pin.FrameType.BODY)]
            np.testing.assert_allclose(positions[k], placement.act(OFFSET), atol=1e-12)
        for i in range(of.size):
            step = STEP * np.eye(of.size)[i]
            ahead, behind = (of.point(link, q + side * step, OFFSET)[0] for side in (1, -1))
            found = (ahead - behind) / (2.0 * STEP)
            np.testing.assert_allclose(jacobian[:, :, i], found, atol=1e-8)


def test_a_link_stays_below_a_wire() -> None:
    of = zs.load_machine("feller_buncher")
    start = np.array([0.0, -1.3, -1.2, 0.7, 0.0])
    goal = start + np.array([1.5, 0.0, 0.0, 0.0, 0.0])

    def low(of: zs.Machine, q, v, a):
        position, by_joints = of.point("stick", q)
        jacobian = np.zeros((len(q), 1, 3 * of.size))
        jacobian[:, 0, : of.size] = by_joints[:, 2]
        return position[:, 2:] - height, jacobian

    height = float(of.point("stick", start[None])[0][0, 2]) + 1e-3  # [m]
    plan = zs.plan(zs.Problem(of, start, goal, constraints=[zs.PathRows("wire", low)]))
    assert plan.success
    _, q, _, _ = plan.trajectory.within(np.linspace(0.0, 1.0, 21))
    assert of.point("stick", q)[0][:, 2].max() <= height


@pytest.mark.parametrize(
    ("frame", "q", "offset", "complaint"),
    [
        ("bom", np.zeros((1, 5)), (0, 0, 0), "there is no frame 'bom'; frames are .*boom"),
        (3, np.zeros((1, 5)), (0, 0, 0), "there is no frame 3"),
        ("boom", np.zeros(5), (0, 0, 0), r"q must have shape \(K, 5\), not \(5,\)"),
        ("boom", np.zeros((1, 5)), (0, 0), "offset"),
        ("boom", np.zeros((1, 5)), (0, 0, np.nan), "offset"),
    ],
)
def test_wrong_points_are_refused(frame, q, offset, complaint) -> None:
    with pytest.raises(zs.MachineError, match=complaint):
        zs.load_machine("feller_buncher").point(frame, q, offset)
