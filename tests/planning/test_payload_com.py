"""Uncertain centre of mass of the payload: corners of its box, points between, plans."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from tests.planning.test_robustness import (
    FRACTION,
    GOAL,
    LEFT,
    SAME,
    START,
    least_margin,
    machine,
    problem,
)
from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.bounds.payload_spread import moment_of_spread, turning_bounds
from zmp_sqp.mechanics.wrench import ground_reaction
from zmp_sqp.planning.proof.certificate import certify_for
from zmp_sqp.scenario import load_scenario

STEEP = zs.Slope(roll=np.radians(-28.0))
BOX = np.array([0.1, 0.2, 0.5])  # [m]


def moment(offset: Array, rate: Array, push: Array) -> Array:
    """Moment about its frame that a unit mass at an offset adds, to second order."""
    return np.cross(offset, np.cross(push, offset) + np.cross(rate, np.cross(rate, offset)))


def test_a_moved_payload_is_that_payload_put_elsewhere() -> None:
    bare, inertia = zs.load_machine("feller_buncher"), np.diag([9e3, 8e3, 2e3])
    tree = bare.with_payload(
        zs.Payload(mass=4000.0, com=(0.1, 0.0, 3.3), frame="head", inertia=inertia)
    )
    there = bare.with_payload(
        zs.Payload(mass=4000.0, com=(0.2, -0.3, 2.9), frame="head", inertia=inertia)
    )
    q, v, a = 0.3 * np.random.default_rng(0).normal(size=(3, 7, 5))
    for kind in (lambda loaded: loaded, zs.Machine.with_point_masses):
        found = zs.zmp(kind(tree).with_payload_moved((0.1, -0.3, -0.4)), q, v, a, LEFT)
        np.testing.assert_allclose(found, zs.zmp(kind(there), q, v, a, LEFT), atol=SAME)
    with pytest.raises(
        zs.MachineError, match="carries 0 payloads; only a single payload can be moved"
    ):
        bare.with_payload_moved((0.1, 0.0, 0.0))
    with pytest.raises(zs.MachineError, match="payload offset"):
        tree.with_payload_moved((0.1, np.nan, 0.0))


def test_nothing_in_the_box_is_worse_than_its_corners_by_more_than_the_spread_allows() -> None:
    rng, tightest, needed = np.random.default_rng(0), 0.0, 0
    for _ in range(300):
        rate, push, row, linear = rng.normal(size=(4, 3))
        box = rng.uniform(0.0, 1.0, 3)

        def value(offset: Array, of: tuple[Array, ...] = (rate, push, row, linear)) -> float:
            return float(of[2] @ moment(offset, *of[:2]) + of[3] @ offset)

        corners = max(value(np.array(signs) * box) for signs in product((-1.0, 1.0), repeat=3))
        inside = max(value(rng.uniform(-1.0, 1.0, 3) * box) for _ in range(100))
        allowed = np.linalg.norm(row) * (box @ box) * (np.linalg.norm(push) + 0.5 * rate @ rate)
        assert inside <= corners + allowed + SAME
        needed += inside > corners
        tightest = max(tightest, (inside - corners) / allowed)
    assert needed > 10  # corners alone would not do
    assert tightest > 0.05


def test_no_link_turns_faster_than_its_bounds() -> None:
    """Angular velocity and acceleration of the head from Pinocchio, in random states."""
    import pinocchio as pin

    arm, rng = machine(), np.random.default_rng(1)
    model, data = arm.model, arm.model.createData()
    for _ in range(100):
        q, v, a = rng.normal(size=(3, arm.size))
        full = np.zeros((2, model.nv))
        full[:, arm.index_v] = v, a
        pin.forwardKinematics(model, data, arm.configuration(q[None])[0], *full)
        rate, push = turning_bounds(arm, np.abs(v)[None], np.abs(a)[None])
        for joint in range(2, model.njoints):
            assert np.linalg.norm(data.v[joint].angular) <= rate[0] + SAME
            assert np.linalg.norm(data.a[joint].angular) <= push[0] + SAME
    still = np.zeros((1, arm.size))
    assert moment_of_spread(arm, still, still, spread=100.0).item() == 0.0


def random_motion(rng: np.random.Generator) -> zs.Trajectory:
    times = np.cumsum(np.append(0.0, rng.uniform(0.05, 0.4, 8)))
    pushes, jerks = 0.8 * rng.normal(size=(2, 8, 5))
    q, v = [START + 0.2 * rng.normal(size=5)], [0.3 * rng.normal(size=5)]
    for h, a, j in zip(np.diff(times), pushes, jerks, strict=True):
        q.append(q[-1] + h * v[-1] + 0.5 * h**2 * a + h**3 * j / 6.0)
        v.append(v[-1] + h * a + 0.5 * h**2 * j)
    return zs.Trajectory(machine().joint_names, times, np.array(q), np.array(v), pushes, jerks)


@pytest.mark.parametrize("seed", range(6))
def test_the_certificate_of_random_motions_holds_for_every_centre_in_the_box(seed: int) -> None:
    rng = np.random.default_rng(seed)
    box = rng.uniform(0.0, 1.0, 3) * rng.choice([0.0, 1.0], 3, p=[0.2, 0.8])
    asked = problem(payload_com_uncertainty=0.01, payload_uncertainty=0.1)
    # too much for its start, but not for a certificate
    object.__setattr__(asked, "payload_com_uncertainty", box)
    motion = random_motion(rng)
    proven = certify_for(asked, motion)
    assert np.isfinite(proven.margin)
    for _ in range(40):
        loaded = (
            machine()
            .with_payload_scaled(rng.uniform(0.9, 1.1))
            .with_payload_moved(rng.uniform(-1.0, 1.0, 3) * box)
        )
        _, q, v, a = motion.within(np.linspace(0.0, 1.0, 21))
        wrench = ground_reaction(
            loaded, q, v, a, root_acceleration=np.concatenate([-LEFT.gravity(), np.zeros(3)])
        )
        assert loaded.support is not None
        found = (-(wrench @ loaded.support.wrench_rows().T) / wrench[:, 2:3]).min()
        assert proven.margin <= found + SAME


@cache
def demanding_plan() -> zs.Plan:
    return zs.plan(
        problem(ground=STEEP, intervals=18, payload_com_uncertainty=BOX, tipping_fraction=FRACTION)
    )


def test_a_plan_is_safe_for_every_centre_of_mass_in_the_box() -> None:
    plan, rng, worst = demanding_plan(), np.random.default_rng(2), np.inf
    assert plan.success, plan.message
    assert "its centre off by (" in plan.certificate.corner
    for _ in range(200):
        offset = BOX * rng.choice([-1.0, 1.0, 0.0, rng.uniform(-1.0, 1.0)], 3)
        loaded = (
            machine()
            .with_payload_scaled(rng.choice([1.0, 1.0 / FRACTION]))
            .with_payload_moved(offset)
        )
        worst = min(worst, least_margin(loaded, plan.trajectory, STEEP.gravity()))
    assert plan.margin >= 0.0
    assert worst >= plan.margin - SAME


def test_a_plan_that_knows_nothing_of_it_is_not() -> None:
    """Otherwise the test above would prove nothing."""
    blind = zs.plan(problem(ground=STEEP, intervals=18, tipping_fraction=FRACTION))
    heavy = machine().with_payload_scaled(1.0 / FRACTION)
    worst = min(
        least_margin(
            heavy.with_payload_moved(np.array(signs) * BOX), blind.trajectory, STEEP.gravity()
        )
        for signs in product((-1.0, 1.0), repeat=3)
    )
    assert blind.success
    assert worst < -0.01


def test_a_base_that_drives_turns_the_payload_too() -> None:
    plain = load_scenario("paper_2_joint").problem
    plan = zs.plan(replace(plain, payload_com_uncertainty=(0.2, 0.0, 0.3)))
    assert plan.success, plan.message
    t, rng = np.linspace(0.0, plan.duration, 400), np.random.default_rng(3)
    for _ in range(30):
        loaded = plain.machine.with_payload_moved(rng.uniform(-1.0, 1.0, 3) * (0.2, 0.0, 0.3))
        points = zs.trajectory_zmp(loaded, plan.trajectory, t, plain.ground)
        assert loaded.support is not None
        assert loaded.support.signed_distance(points).min() >= plan.margin - SAME


def test_a_scalar_is_a_cube_and_zero_is_nothing() -> None:
    np.testing.assert_array_equal(
        problem(payload_com_uncertainty=0.2).payload_com_uncertainty, np.full(3, 0.2)
    )
    assert [corner.text for corner in problem().corners(every=True)] == [""]
    corners = problem(payload_com_uncertainty=(0.1, 0.0, 0.2)).corners()
    assert corners[0].text == "its centre off by (-0.10, +0.00, -0.20) m"
    assert len(corners) == 4


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (-0.1, r"payload_com_uncertainty must lie within \[0, 10\] m along each axis"),
        ((0.1, np.nan, 0.0), r"payload_com_uncertainty.*y"),
        ((0.1, 0.2), r"payload_com_uncertainty"),
        ("much", r"payload_com_uncertainty"),
        ((0.1, 0.2, 0.3, 0.4), r"must be one number, or three for x, y and z"),
        (11.0, r"within \[0, 10\] m"),
        (9.0, r"tips over at rest at the (start|goal) with its centre off by"),
    ],
)
def test_bad_boxes_get_one_sentence(given: Any, message: str) -> None:
    with pytest.raises(zs.ProblemError, match=message):
        problem(payload_com_uncertainty=given)


def test_without_one_payload_there_is_no_centre_to_be_off() -> None:
    bare, tree = (
        zs.load_machine("feller_buncher"),
        zs.Payload(mass=500.0, com=(0.0, 0.0, 1.0), frame="head"),
    )
    for arm, count in ((bare, 0), (bare.with_payload(tree).with_payload(tree), 2)):
        with pytest.raises(
            zs.ProblemError, match=f"needs one payload, but machine .* carries {count}"
        ):
            zs.Problem(arm, START, GOAL, payload_com_uncertainty=0.1)


def test_a_negative_spread_is_refused() -> None:
    with pytest.raises(zs.ProblemError, match="spread must not be negative"):
        zs.certify(machine(), random_motion(np.random.default_rng(0)), LEFT, spread=-1.0)
