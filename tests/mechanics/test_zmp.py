from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from tests.mechanics.conftest import STEM, TREE_COM, random_motion
from zmp_sqp.errors import ContactLost, MachineError
from zmp_sqp.mechanics.ground import Slope
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.payload import Payload
from zmp_sqp.mechanics.zero_moment_point import stability_margin, zmp

PRINTED = 1e-3  # [m], the reference values of paper.md have three decimals
DERIVATIONS = 1e-9  # [m], two derivations in double precision
DIFFERENCES = 1e-6  # [m], eq. (5) on central differences of positions

LEFT = Slope(roll=-np.radians(20.0))
REST = np.zeros(5)
ATTITUDE = -2.0 * np.pi / 3.0  # q2 + q3 + q4 of the paper's start pose


@pytest.mark.parametrize(
    ("pose", "expected"),
    [
        ([np.pi / 2, -np.pi / 6, -2 * np.pi / 3, np.pi / 6, -np.pi / 2], [0.0, 2.056]),
        ([np.pi / 2, 0.0, -np.pi, ATTITUDE + np.pi, -np.pi / 2], [0.0, 1.131]),
        ([0.0, -np.pi / 6, -2 * np.pi / 3, np.pi / 6, -np.pi / 2], [1.270, 0.786]),
    ],
    ids=["arm over the left side", "arm folded", "start"],
)
def test_static_zmp_of_the_paper_on_a_20_degree_roll(
    paper: Machine, pose: list[float], expected: list[float]
) -> None:
    np.testing.assert_allclose(zmp(paper, pose, REST, REST, LEFT), expected, atol=PRINTED)


def test_arm_over_the_downhill_side_stands_outside_the_polygon(paper: Machine) -> None:
    over_left = [np.pi / 2, -np.pi / 6, -2 * np.pi / 3, np.pi / 6, -np.pi / 2]
    assert stability_margin(paper, over_left, REST, REST, LEFT) == pytest.approx(
        1.615 - 2.056, abs=PRINTED
    )


@pytest.mark.parametrize("fixture", ["loaded", "paper", "permuted"])
def test_zmp_is_the_centroidal_momentum_rate_over_the_normal_force(
    fixture: str, request: pytest.FixtureRequest
) -> None:
    machine: Machine = request.getfixturevalue(fixture)
    ground = Slope(roll=0.3, pitch=-0.2)
    q, v, a = random_motion(machine, 50, seed=1)
    points = zmp(machine, q, v, a, ground)
    data, zero = machine.model.createData(), np.zeros(machine.model.nv)
    for k, configuration in enumerate(machine.configuration(q)):
        full_v, full_a = zero.copy(), zero.copy()
        full_v[machine.index_v], full_a[machine.index_v] = v[k], a[k]
        pin.computeCentroidalMomentumTimeVariation(
            machine.model, data, configuration, full_v, full_a
        )
        force = data.dhg.linear - machine.mass * ground.gravity()
        moment = data.dhg.angular + np.cross(data.com[0], force)
        normal = np.array([0.0, 0.0, 1.0])
        np.testing.assert_allclose(
            points[k], (np.cross(normal, moment) / force[2])[:2], atol=DERIVATIONS
        )


def point_masses(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Table I by hand: masses (7,) and positions (7, 3), x forward, y left.

    Arm angles are measured backwards from upright.
    """
    # (forward, up) of boom, stick, tilt link
    along = [np.array([-np.sin(s), np.cos(s)]) for s in np.cumsum(q[1:4])]
    boom = np.array([0.0, 1.60 + 0.96])
    stick, tilt = boom + 3.27 * along[0], boom + 3.27 * (along[0] + along[1])
    head = tilt + 0.458 * along[2]
    upright = np.array([-along[2][1], along[2][0]])  # z5 = -y4
    plane = [
        np.array([0.0, 0.80]),
        np.array([0.0, 1.60 + 0.48]),
        boom + 0.5 * 3.27 * along[0],
        stick + 0.5 * 3.27 * along[1],
        tilt + 0.5 * 0.458 * along[2],
        head,
        head + TREE_COM[2] * upright,
    ]
    masses = np.array([13000.0, 5000.0, 2000.0, 1000.0, 50.0, 2600.0, 4000.0])
    return masses, np.array(
        [[reach * np.cos(q[0]), reach * np.sin(q[0]), height] for reach, height in plane]
    )


def test_zmp_of_point_masses_is_equation_5_on_differences_of_positions(paper: Machine) -> None:
    ground, step = Slope(roll=-0.35, pitch=0.26), 2e-3  # [s]
    gravity = ground.gravity()
    q, v, a = random_motion(paper, 50, seed=2)
    points = zmp(paper, q, v, a, ground)
    for k in range(50):
        path = [
            point_masses(q[k] + v[k] * t + 0.5 * a[k] * t**2)[1] for t in step * np.arange(-2, 3)
        ]
        accelerations = (-path[0] + 16 * path[1] - 30 * path[2] + 16 * path[3] - path[4]) / (
            12 * step**2
        )
        masses, (x, y, z) = point_masses(q[k])[0], path[2].T
        pull = (accelerations - gravity).T
        expected = [masses @ (pull[2] * x - pull[0] * z), masses @ (pull[2] * y - pull[1] * z)] / (
            masses @ pull[2]
        )
        np.testing.assert_allclose(points[k], expected, atol=DIFFERENCES)


def test_pitching_the_stem_moves_the_zmp_by_what_point_masses_neglect(
    feller_buncher: Machine,
) -> None:
    point = feller_buncher.with_payload(Payload(4000.0, TREE_COM, "head"))
    stem = feller_buncher.with_payload(
        Payload(4000.0, TREE_COM, "head", np.diag([STEM, STEM, 0.0]))
    )
    # tilt link, head and tree balance over the tilt joint, so that pitching them does not change
    # the normal force
    balanced = np.arctan2(-4000.0 * TREE_COM[2], 50.0 * 0.229 + 6600.0 * 0.458)
    pose, pitching = (
        [0.0, -np.pi / 6, -2 * np.pi / 3, balanced + 5 * np.pi / 6, -np.pi / 2],
        [0, 0, 0, np.pi / 2, 0],
    )
    shift = zmp(stem, pose, REST, pitching, Slope()) - zmp(point, pose, REST, pitching, Slope())
    assert np.linalg.norm(shift) == pytest.approx(0.124, abs=PRINTED)


def test_one_state_gives_one_point_and_many_give_many(loaded: Machine) -> None:
    q, v, a = random_motion(loaded, 4, seed=3)
    points, margins = zmp(loaded, q, v, a, LEFT), stability_margin(loaded, q, v, a, LEFT)
    assert points.shape == (4, 2)
    assert margins.shape == (4,)
    np.testing.assert_array_equal(zmp(loaded, q[2], v[2], a[2], LEFT), points[2])
    assert stability_margin(loaded, q[2], v[2], a[2], LEFT).shape == ()
    assert zmp(loaded, q[:0], v[:0], a[:0], LEFT).shape == (0, 2)


def test_zmp_lies_in_the_plane_of_the_support(loaded: Machine) -> None:
    support = loaded.support
    assert support is not None
    raised = loaded.with_support(type(support)(support.vertices, height=0.7))
    q = random_motion(loaded, 1, seed=4)[0]
    low, high = zmp(loaded, q[0], REST, REST, LEFT), zmp(raised, q[0], REST, REST, LEFT)
    gravity = LEFT.gravity()  # at rest the reaction acts along gravity through both points
    np.testing.assert_allclose(high - low, 0.7 * gravity[:2] / gravity[2], atol=DERIVATIONS)


def test_lift_off_raises_and_names_the_index(loaded: Machine) -> None:
    q, v, a = random_motion(loaded, 3, seed=5)
    q[:] = [0.0, -np.pi / 3, 0.0, 0.0, 0.0]
    a[1] = [0.0, -100.0, 0.0, 0.0, 0.0]  # [rad/s^2], the arm falls faster than gravity pulls
    with pytest.raises(ContactLost, match="index 1"):
        zmp(loaded, q, 0 * v, a * [[0], [1], [0]], Slope())


@pytest.mark.parametrize(
    ("q", "v", "a", "ground", "named"),
    [
        ([0, np.nan, 0, 0, 0], REST, REST, LEFT, "q of joint 'boom'"),
        (
            np.zeros((2, 5)),
            [[0] * 5, [0, 0, 0, np.inf, 0]],
            np.zeros((2, 5)),
            LEFT,
            "v of joint 'tilt' at index 1",
        ),
        (REST, REST, np.zeros(4), LEFT, "a must have shape (5,)"),
        (np.zeros((3, 5)), np.zeros((2, 5)), np.zeros((3, 5)), LEFT, "v must have the shape of q"),
        ("five", REST, REST, LEFT, "q must be numbers"),
        ([[0], [0, 1]], REST, REST, LEFT, "q must be numbers"),
        (REST, REST, REST, 0.3, "ground"),
    ],
    ids=["nan", "inf", "length", "counts differ", "text", "ragged", "ground"],
)
def test_bad_states_are_refused_by_name(
    loaded: Machine, q: object, v: object, a: object, ground: Slope, named: str
) -> None:
    with pytest.raises(MachineError, match=re.escape(named)):
        zmp(loaded, q, v, a, ground)


def test_margin_without_a_support_is_refused(permuted: Machine) -> None:
    bare = replace(permuted, support=None)
    zero = np.zeros(3)
    assert zmp(bare, zero, zero, zero, Slope()).shape == (2,)
    with pytest.raises(MachineError, match="'permuted' has no support polygon"):
        stability_margin(bare, zero, zero, zero, Slope())
