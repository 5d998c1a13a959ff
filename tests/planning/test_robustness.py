"""Uncertain payloads and slopes: corners, what lies between them, and plans for all."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.paper import paper_scene
from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.uncertainty import leaning_corners
from zmp_sqp.mechanics.wrench import ground_reaction
from zmp_sqp.planning.search.keep_bound import ABOVE

START = np.array([0.0, -np.pi / 6, -2 * np.pi / 3, np.pi / 6, -np.pi / 2])
GOAL = START + np.array([np.pi, 0.0, 0.0, 0.0, 0.0])
LEFT = zs.Slope(roll=np.radians(-20.0))
SAME = 1e-9
STEEP, FRACTION = 28.5, 0.6  # so that it costs time
# 18 intervals: the slew's switching times fall on the grid, so that the bound can be reached on it


@cache
def machine() -> zs.Machine:
    return paper_scene(point_masses=False).load()


def problem(**options: Any) -> zs.Problem:
    return zs.Problem(machine(), START, GOAL, **({"ground": LEFT} | options))


@cache
def demanding_plan() -> zs.Plan:
    """The paper's first motion, on a steep slope, with all that can be uncertain."""
    steep = zs.Slope(roll=np.radians(-STEEP))
    return zs.plan(
        problem(
            ground=steep,
            intervals=18,
            payload_uncertainty=0.1,
            tipping_fraction=FRACTION,
            slope_uncertainty=np.radians(2.0),
        )
    )


def least_margin(loaded: zs.Machine, trajectory: zs.Trajectory, gravity: Array) -> float:
    _, q, v, a = trajectory.within(np.linspace(0.0, 1.0, 21))
    wrench = ground_reaction(
        loaded, q, v, a, root_acceleration=np.concatenate([-gravity, np.zeros(3)])
    )
    assert loaded.support is not None
    assert wrench[:, 2].min() > 0.0
    return float((-(wrench @ loaded.support.wrench_rows().T) / wrench[:, 2:3]).min())


def leaning(ground: zs.Slope, angle: float, rng: np.random.Generator) -> Array:
    """Gravity turned by an angle about a random axis across it (Rodrigues)."""
    g = ground.gravity()
    axis = np.cross(g, rng.normal(size=3))
    axis /= np.linalg.norm(axis)
    return np.asarray(np.cos(angle) * g + np.sin(angle) * np.cross(axis, g))


def test_every_gravity_within_the_angle_lies_in_the_pyramid() -> None:
    rng = np.random.default_rng(0)
    for _ in range(2000):
        ground, delta = zs.Slope(*rng.uniform(-0.6, 0.6, 2)), rng.uniform(1e-3, 0.3)
        g = leaning(ground, delta * rng.choice([1.0, rng.random()]), rng)
        corners = np.array([corner for corner, _, _ in leaning_corners(ground, delta)])
        tau = g @ ground.gravity() / 9.81**2
        assert np.cos(delta) - SAME <= tau <= 1.0 + SAME
        first, second = corners[2] - corners[0], corners[1] - corners[0]  # the sides of the square
        place = g / tau - corners.mean(axis=0)
        assert abs(place @ first) <= 0.5 * first @ first + SAME
        assert abs(place @ second) <= 0.5 * second @ second + SAME
        assert (place @ ground.gravity()) == pytest.approx(0.0, abs=1e-9)


def test_corners_lean_as_their_words_say() -> None:
    ground = zs.Slope(roll=0.1, pitch=-0.2)
    for gravity, roll, pitch in leaning_corners(ground, 0.01):
        named = zs.Slope(0.1 + np.radians(roll), -0.2 + np.radians(pitch)).gravity()
        # to first order: 9.81 (0.01)^2 and the coupling of both
        np.testing.assert_allclose(gravity, named, atol=0.01)


def test_a_scaled_payload_is_that_payload_made_heavier() -> None:
    bare, inertia = zs.load_machine("feller_buncher"), np.diag([9e3, 8e3, 2e3])
    tree = bare.with_payload(
        zs.Payload(mass=4000.0, com=(0.1, 0.0, 3.3), frame="head", inertia=inertia)
    )
    heavier = bare.with_payload(
        zs.Payload(mass=5000.0, com=(0.1, 0.0, 3.3), frame="head", inertia=1.25 * inertia)
    )
    q, v, a = 0.3 * np.random.default_rng(0).normal(size=(3, 7, 5))
    for kind in (lambda loaded: loaded, zs.Machine.with_point_masses):
        expected = zs.zmp(kind(heavier), q, v, a, LEFT)
        np.testing.assert_allclose(
            zs.zmp(kind(tree).with_payload_scaled(1.25), q, v, a, LEFT), expected, atol=SAME
        )
        np.testing.assert_allclose(
            zs.zmp(kind(tree.with_payload_scaled(1.25)), q, v, a, LEFT), expected, atol=SAME
        )
    empty = zs.zmp(tree.with_payload_scaled(0.0), q, v, a, LEFT)
    np.testing.assert_allclose(empty, zs.zmp(bare, q, v, a, LEFT), atol=SAME)
    assert tree.payload_mass == 4000.0
    assert tree.with_payload_scaled(1.25).mass == pytest.approx(heavier.mass)
    for factor in (-0.1, np.nan):
        with pytest.raises(zs.MachineError, match="payload factor"):
            tree.with_payload_scaled(factor)


def test_a_robust_plan_is_safe_for_every_payload_and_slope_that_it_names() -> None:
    plan = demanding_plan()
    assert plan.success, plan.message
    assert plan.status is zs.Status.OPTIMAL  # it costs time, so the corners are active
    asked, rng = plan.problem, np.random.default_rng(1)
    worst = np.inf
    for _ in range(300):
        mu = rng.choice([0.9, 1.1 / FRACTION, rng.uniform(0.9, 1.1 / FRACTION)])
        angle = asked.slope_uncertainty * rng.choice([1.0, rng.random()])
        loaded = machine().with_payload_scaled(mu)
        worst = min(worst, least_margin(loaded, plan.trajectory, leaning(asked.ground, angle, rng)))
    assert plan.margin >= 0.0
    assert worst >= plan.margin - SAME


def test_a_plan_that_ignores_what_is_uncertain_is_not() -> None:
    """Otherwise the test above would prove nothing."""
    asked = demanding_plan().problem
    blind = zs.plan(problem(ground=asked.ground, intervals=18))
    assert blind.success
    assert blind.duration < demanding_plan().duration
    heavy = machine().with_payload_scaled(1.1 / FRACTION)
    leaned = zs.Slope(roll=asked.ground.roll - asked.slope_uncertainty).gravity()
    assert least_margin(heavy, blind.trajectory, leaned) < -0.05


def test_the_certificate_names_the_worst_corner() -> None:
    plan = demanding_plan()
    assert plan.certificate.corner.startswith("payload 7333 kg, the slope off by roll -2.0")
    least = min(
        zs.certify(corner.machine, plan.trajectory, corner.ground).margin
        for corner in plan.problem.corners(every=True)
    )
    assert plan.margin == pytest.approx(least, abs=1e-5)


def test_a_safer_problem_is_never_faster() -> None:
    options: list[dict[str, Any]] = [
        {},
        {"payload_uncertainty": 0.1},
        {"tipping_fraction": 0.75},
        {"slope_uncertainty": np.radians(2.0)},
    ]
    steep = zs.Slope(roll=np.radians(-STEEP))
    durations = [
        zs.plan(problem(ground=steep, intervals=18, **option)).duration for option in options
    ]
    # motions at the bound are up to 0.03 % slower than it
    assert min(durations) >= durations[0] * (1.0 - 1.15 * ABOVE)
    assert demanding_plan().duration > durations[0] * 1.0001


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tipping_fraction": 0.0}, r"tipping_fraction must lie within \[0.1, 1\]"),
        ({"tipping_fraction": 1.2}, r"tipping_fraction must lie within"),
        ({"payload_uncertainty": -0.1}, r"payload_uncertainty must lie within \[0, 0.9\]"),
        ({"payload_uncertainty": np.nan}, r"payload_uncertainty"),
        ({"slope_uncertainty": 1.0}, r"slope_uncertainty must lie within \[0, 0.5\]"),
        ({"slope_uncertainty": "2 deg"}, r"slope_uncertainty"),
        ({"tipping_fraction": 0.2}, r"tips over at rest at the (start|goal) with payload 20000 kg"),
        (
            {"slope_uncertainty": 0.3},
            r"tips over at rest at the (start|goal) with the slope off by roll [+-]17.2 and pitch",
        ),
    ],
)
def test_bad_uncertainties_get_one_sentence(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(zs.ProblemError, match=message):
        problem(**changes)


def test_a_slope_so_uncertain_that_gravity_may_point_upwards_is_refused() -> None:
    for changes in ({}, {"start_velocity": [0.1, 0.0, 0.0, 0.0, 0.0]}):
        with pytest.raises(
            zs.ProblemError,
            match=r"(gravity would point away from the ground|tips over at the start)",
        ):
            problem(ground=zs.Slope(roll=np.radians(70.0)), slope_uncertainty=0.5, **changes)


def test_without_a_payload_or_a_slope_there_is_nothing_to_be_uncertain_of() -> None:
    bare = zs.load_machine("feller_buncher")
    with pytest.raises(zs.ProblemError, match="payload_uncertainty needs a payload"):
        zs.Problem(bare, START, GOAL, LEFT, payload_uncertainty=0.1)

    class Level:
        def gravity(self, yaw: float = 0.0) -> Array:
            return np.array([0.0, 0.0, -9.81])

    with pytest.raises(zs.ProblemError, match="slope_uncertainty needs a Slope, not Level"):
        zs.Problem(bare, START, GOAL, Level(), slope_uncertainty=0.1)


REFUSED = r"the machine (tips over|misses the margin of 0\.1 m) at rest at the start"


@pytest.mark.parametrize("roll", [-11.0, -13.0, -16.0])
@pytest.mark.parametrize(
    "options", [{"slope_uncertainty": np.radians(2.0)}, {"tipping_fraction": 0.75}, {}]
)
def test_the_payload_and_the_slope_that_a_refusal_names_are_those_to_give(
    roll: float, options: dict[str, Any]
) -> None:
    """One per cent of payload, or 0.2 degrees, more than the refusal names is refused."""
    across = START + np.array([np.pi / 2, 0.0, 0.0, 0.0, 0.0])

    def pose(mass: float, degrees: float) -> zs.Problem:
        tree = zs.Payload(mass=mass, com=(0.0, 0.0, 3.323), frame="head")
        loaded = zs.load_machine("feller_buncher").with_payload(tree)
        ground = zs.Slope(roll=np.radians(degrees))
        return zs.Problem(
            loaded, across, across, ground, margin=0.1, payload_com_uncertainty=0.1, **options
        )

    with pytest.raises(zs.ProblemError, match=REFUSED) as refusal:
        pose(6000.0, roll)
    mass = float(re.search(r"the payload could be at most (\d+) kg", str(refusal.value))[1])
    pose(mass, roll)
    with pytest.raises(zs.ProblemError, match=REFUSED):
        pose(1.01 * mass + 1.0, roll)
    slope = re.search(r"the slope could be at most ([\d.]+) degrees", str(refusal.value))
    if slope is not None:
        pose(6000.0, -float(slope[1]))
        with pytest.raises(zs.ProblemError, match=REFUSED):
            pose(6000.0, -float(slope[1]) - 0.2)


def test_corners_are_made_once_and_anew_after_a_model_was_changed() -> None:
    first = problem(payload_uncertainty=0.1, payload_com_uncertainty=0.1, slope_uncertainty=0.02)
    corners = first.corners(every=True)
    again = problem(payload_uncertainty=0.1, payload_com_uncertainty=0.1, slope_uncertainty=0.02)
    assert all(a is b for a, b in zip(corners, first.corners(every=True), strict=True))
    assert all(a is b for a, b in zip(corners, again.corners(every=True), strict=True))
    other = problem(payload_uncertainty=0.1, payload_com_uncertainty=0.1, slope_uncertainty=0.03)
    assert not any(a is b for a, b in zip(corners, other.corners(every=True), strict=True))
    # a user who changes a model in place, which he is told not to do, gets no stale corners
    changed = corners[0].machine.model
    before, heavy = changed.inertias[2].copy(), changed.inertias[2].copy()
    heavy.mass *= 2.0
    changed.inertias[2] = heavy
    fresh = first.corners(every=True)
    assert fresh[0] is not corners[0]
    assert fresh[0].machine.model.inertias[2] == before
