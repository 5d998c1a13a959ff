"""Polynomials of time in place of inverse dynamics: their errors, control points and corners."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pinocchio as pin
import pytest

import zmp_sqp as zs
from tests.planning.test_certificate import (
    MACHINES,
    OURS,
    SPEEDS,
    Case,
    driving_case,
    is_below,
    least_sampled,
    machine_of,
    margins,
    random_case,
)
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.uncertainty import Corner, corners
from zmp_sqp.mechanics.wrench import efforts
from zmp_sqp.motion.root_motion import root_motion, with_ground
from zmp_sqp.planning.constraints.effort_rows import EffortRows
from zmp_sqp.planning.proof import effort_curves
from zmp_sqp.planning.proof.certificate import certify_at
from zmp_sqp.planning.proof.corner_efforts import CornerEfforts, grouped
from zmp_sqp.planning.proof.effort_curves import EffortCurves, control_points

Array = np.ndarray
ROUNDING = 1e-9  # relative
SAME = 1e-5  # [m] to which margins are found


def exact_efforts(corner: Corner, trajectory: zs.Trajectory, k: Array, since: Array) -> Array:
    """Inverse dynamics of one corner, wrench and joints, shape (K, 6 + n)."""
    machine, driven = corner.machine, with_ground(trajectory, corner.ground)
    gravity = corner.ground.gravity()
    assert machine.support is not None
    twist, root = root_motion(driven, gravity, k, since, height=machine.support.height)
    states = driven.state_in(k, since)
    return efforts(machine, *states, root_acceleration=root, root_velocity=twist)


def largest_share(case: Case, *, samples: int = 40) -> float:
    """Largest error of the polynomials as a share of its bound; asserts that it is below one."""
    corner = Corner(case.machine, case.ground)
    with np.errstate(all="ignore"):
        curves = EffortCurves.of(CornerEfforts([corner], case.trajectory, joints=True))
    pieces, worst = np.arange(len(curves.interval)), 0.0
    for share in np.linspace(0.0, 1.0, samples):
        zero = 0.0 * curves.length
        with np.errstate(all="ignore"):
            found, _, error = curves.stretches(0 * pieces, pieces, zero + share, zero)
        since = curves.since + share * curves.length
        off = found[0] - exact_efforts(corner, case.trajectory, curves.interval, since)
        for part, bound in (
            (np.linalg.norm(off[:, :3], axis=1), error.force),
            (np.linalg.norm(off[:, 3:6], axis=1), error.moment),
            (np.abs(off[:, 6:]), error.joints),
        ):
            known = np.isfinite(bound) & (bound > 0.0)
            assert (part[known] <= bound[known]).all()
            worst = max(worst, float((part[known] / bound[known]).max(initial=0.0)))
    return worst


# one speed for each machine that is not an oracle: they differ in their numbers only
CASES = [*product(MACHINES[: -len(OURS)], SPEEDS), *product(OURS, ["fast"])]


@pytest.mark.parametrize(("name", "speed"), CASES)
def test_polynomials_of_every_degree_are_as_close_to_inverse_dynamics_as_they_say(
    name: str, speed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(effort_curves, "TOLERANCE", np.inf)
    for degree in (1, 3, 5, 8, 10):
        monkeypatch.setattr(effort_curves, "DEGREES", (degree,))
        for seed in range(4):
            largest_share(random_case(name, SPEEDS[speed], seed))


@pytest.mark.parametrize("speed", [0.1, 1.0, 5.0])
def test_polynomials_are_as_close_as_they_say_while_the_base_drives(
    speed: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(effort_curves, "TOLERANCE", np.inf)
    for degree in (1, 3, 6):
        monkeypatch.setattr(effort_curves, "DEGREES", (degree,))
        for seed in range(6):
            steps = np.array([0.2, 0.1, 0.3]) / max(speed, 1.0)
            largest_share(driving_case(seed, speed, steps))


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5, 6])
def test_the_bound_on_a_crane_that_slews_steadily_is_within_a_factor_of_a_hundred(
    degree: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its centripetal force turns; Cauchy's estimate of a sine's coefficients costs a factor."""
    monkeypatch.setattr(effort_curves, "TOLERANCE", np.inf)
    monkeypatch.setattr(effort_curves, "DEGREES", (degree,))
    machine = machine_of("slewing_crane")
    rate, length, rest = np.array([30.0]), 0.1, np.zeros((1, 1))
    q = np.array([[0.0], length * rate])
    trajectory = zs.Trajectory(machine.joint_names, [0.0, length], q, [rate, rate], rest)
    share = largest_share(Case(machine, trajectory, zs.Slope()), samples=200)
    assert 0.01 < share < 1.0


@pytest.mark.parametrize("degree", effort_curves.DEGREES)
def test_control_points_enclose_a_polynomial_on_any_part_of_its_piece(degree: int) -> None:
    rng, count = np.random.default_rng(degree), 40
    coefficients = rng.normal(size=(degree + 1, count, 2))
    start = rng.uniform(0.0, 0.9, count)
    length = rng.uniform(0.0, 1.0 - start)
    nodes = effort_curves._points(degree)
    values = np.polynomial.polynomial.polyval(nodes, coefficients)  # (K, R, n + 1)
    control = control_points(values.transpose(2, 0, 1), start, length)
    for x in np.linspace(0.0, 1.0, 21):
        w = 2.0 * (start + x * length) - 1.0
        powers = w ** np.arange(degree + 1)[:, None]
        exact = np.einsum("nk,nkr->kr", powers, coefficients)
        slack = ROUNDING * np.abs(coefficients).sum(axis=0)
        assert (exact <= control.max(axis=0) + slack).all()
        assert (exact >= control.min(axis=0) - slack).all()
        if x in (0.0, 1.0):
            assert (np.abs(exact - control[0 if x == 0.0 else -1]) <= slack).all()
    whole = control_points(values.transpose(2, 0, 1))
    same = control_points(values.transpose(2, 0, 1), 0.0 * start, 1.0 + 0.0 * start)
    np.testing.assert_allclose(whole, same, atol=ROUNDING * np.abs(whole).max())


# --- several corners ----------------------------------------------------------------------------


def uncertain(case: Case, box: tuple[float, float, float] = (0.1, 0.2, 0.0)) -> tuple[Corner, ...]:
    return corners(
        case.machine,
        case.ground,
        tipping_fraction=0.8,
        payload_uncertainty=0.1,
        slope_uncertainty=0.03,
        payload_com_uncertainty=np.array(box),
        every=True,
    )


def loaded_case(seed: int, speed: float, *, drives: bool) -> Case:
    steps = np.array([0.2, 0.1, 0.3]) / max(speed, 1.0)
    if not drives:
        return random_case("permuted with payload", speed, seed, steps=steps)
    case = driving_case(2 * seed + 1, speed, steps)  # of the machine with branches
    payload = zs.Payload(50.0, (0.3, -0.2, 0.5), "tool", np.diag([5.0, 6.0, 7.0]))
    return replace(case, machine=case.machine.with_payload(payload))


@pytest.mark.parametrize("drives", [False, True])
def test_efforts_of_all_corners_are_those_of_each_alone(drives: bool) -> None:
    for seed, speed in enumerate((0.1, 1.0, 5.0)):
        case = loaded_case(seed, speed, drives=drives)
        every, k = uncertain(case), np.array([0, 0, 1, 2])
        since = np.array([0.0, 0.5, 0.3, 1.0]) * np.diff(case.trajectory.times)[k]
        for joints in (False, True):
            found = CornerEfforts(every, case.trajectory, joints).at(k, since)
            for i, corner in enumerate(every):
                exact = exact_efforts(corner, case.trajectory, k, since)
                exact = exact if joints else exact[:, :6]
                np.testing.assert_allclose(
                    found[:, i], exact, atol=1e-12 * np.abs(exact).max(), rtol=0.0
                )


@pytest.mark.parametrize("drives", [False, True])
def test_the_guarantee_for_all_corners_is_the_least_of_each(drives: bool) -> None:
    for seed, speed in enumerate((0.1, 1.0, 3.0)):
        case = loaded_case(seed, speed, drives=drives)
        every = uncertain(case, (0.0, 0.0, 0.0))  # a box costs margin by the length of pieces
        together = certify_at(every, case.trajectory, 0.0)
        alone = [certify_at([corner], case.trajectory, 0.0).margin for corner in every]
        worst = every[int(np.argmin(alone))]
        assert together.margin <= together.sampled
        assert together.margin == pytest.approx(min(alone), abs=SAME)
        assert together.corner == worst.text


@pytest.mark.parametrize("speed", [0.1, 1.0, 4.0])
def test_no_payload_and_slope_between_the_corners_has_less_than_the_guarantee(
    speed: float,
) -> None:
    rng = np.random.default_rng(int(10.0 * speed))
    for seed in range(4):
        case = loaded_case(seed, speed, drives=False)
        box = rng.uniform(0.0, 0.3, 3)
        found = certify_at(uncertain(case, tuple(box)), case.trajectory, 0.0)
        least = np.inf
        for _ in range(30):
            factor = rng.choice([0.9, 1.1 / 0.8, rng.uniform(0.9, 1.1 / 0.8)])
            offset = box * rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)], size=3)
            machine = case.machine.with_payload_scaled(factor).with_payload_moved(offset)
            g, angle = case.ground.gravity(), 0.03 * rng.choice([1.0, rng.random()])
            axis = np.cross(g, rng.normal(size=3))
            axis /= np.linalg.norm(axis)
            turned = np.cos(angle) * g + np.sin(angle) * np.cross(axis, g)
            _, q, v, a = case.trajectory.within(np.linspace(0.0, 1.0, 21))
            least = min(least, float(margins(machine, q, v, a, turned).min()))
        assert is_below(found.margin, least), seed


@dataclass(frozen=True)
class JointEfforts:
    """Joint efforts within bounds of either sign."""

    limit: float
    name = "joint_efforts"

    def rows(self, machine: Machine, coordinates: Coordinates) -> EffortRows:
        n = machine.size
        C = np.zeros((2 * n, 6 + n))
        C[:n, 6:], C[n:, 6:] = np.eye(n), -np.eye(n)
        return EffortRows(
            C=C,
            c=np.full(2 * n, -1.0),
            divisor=np.full(2 * n, self.limit),
            labels=machine.joint_names * 2,
            units=("N m",) * (2 * n),
            resolution=np.full(2 * n, 1e-3 * self.limit),
        )


@pytest.mark.parametrize("drives", [False, True])
def test_joint_efforts_are_bounded_at_all_corners(drives: bool) -> None:
    for seed, speed in enumerate((0.1, 1.0, 3.0)):
        case = loaded_case(seed, speed, drives=drives)
        every = uncertain(case, (0.1, 0.0, 0.0))
        certificate = certify_at(every, case.trajectory, 0.0, constraints=[JointEfforts(1e3)])
        found = next(one for one in certificate.guarantees if one.name == "joint_efforts")
        shares = np.linspace(0.0, 1.0, 101)
        k = np.repeat(np.arange(3), len(shares))
        since = np.outer(np.diff(case.trajectory.times), shares).ravel()
        most = max(
            float(np.abs(exact_efforts(corner, case.trajectory, k, since)[:, 6:]).max())
            for corner in every
        )
        spread = max(corner.spread for corner in every)
        assert found.value <= 1e3 - most + 1e-6
        if spread * speed**2 < 1.0:
            assert found.value >= 1e3 - most - 10.0


def test_machines_with_other_joints_or_polygons_are_proven_apart() -> None:
    case = random_case("permuted", 1.0, 0)
    first = case.machine
    loaded = first.with_payload(zs.Payload(50.0, (0.3, -0.2, 0.5), "tool"))
    aside = first.with_support(
        zs.SupportPolygon(first.support.vertices + 0.5, first.support.height)
    )
    model = first.model.copy()
    model.jointPlacements[2] = pin.SE3(np.eye(3), np.array([0.0, 0.0, 9.0]))
    for other, groups in ((loaded, 1), (aside, 2), (replace(first, model=model), 2)):
        found = grouped([Corner(first, case.ground), Corner(other, case.ground)], case.trajectory)
        assert len(found) == groups


def test_a_long_and_violent_motion_ends_without_a_margin_and_says_why() -> None:
    machine = machine_of("feller_buncher")
    q, v = np.zeros((2, 5)), np.full((2, 5), 1e4)
    q[1] = 1e4 * 1e2
    motion = zs.Trajectory(machine.joint_names, [0.0, 1e2], q, v, np.zeros((1, 5)))
    found = zs.certify(machine, motion, zs.Slope())
    assert found.margin == -np.inf
    assert not found.safe


def test_the_guaranteed_margin_is_within_20_micrometres_of_dense_samples() -> None:
    case = random_case("rigid", 0.6, 1)
    assert zs.certify(case.machine, case.trajectory, case.ground).margin == pytest.approx(
        least_sampled(case), abs=2e-5
    )


def test_powers_of_chebyshev_polynomials_are_those_of_numpy() -> None:
    for degree in (0, 1, 2, 7, 24, 40):
        found = effort_curves._chebyshev_powers(degree)
        for k in range(degree + 1):
            expected = np.zeros(degree + 1)
            expected[: k + 1] = np.polynomial.chebyshev.cheb2poly([0.0] * k + [1.0])
            np.testing.assert_array_equal(found[:, k], expected)
