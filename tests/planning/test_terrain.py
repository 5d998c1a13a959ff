"""Base and arm over terrain: planned, certified, and recomputed by other means."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import zmp_sqp as zs
from benchmarks.problems.driving_checks import Surface, zmp_from_poses
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_scene
from benchmarks.problems.terrain import BASE_LIMITS, rolling_map
from benchmarks.problems.terrain import unicycle_base as base
from tests.planning.driving import retreat, retreat_problem, terrain
from zmp_sqp.mechanics.uncertainty import corners
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.scenario import SHIPPED, load_scenario

SAME = 1e-6  # [s, m] a plane written down as heights
ARRIVED = 1e-3  # [m] the issue's
DIFFERENCES = 5e-3  # [m] the issue's, of a ZMP from finite differences
PATH = 1e-9  # [m] of a path integrated by other means
LOOSE = 1e-3  # [m] by which a guaranteed margin may fall short of samples
ROUGH = ((0.5, 9.0, 0.3, 0.5),)  # radius of curvature 4 m


@pytest.fixture(scope="module")
def plan() -> zs.Plan:
    return terrain()[1]


def test_the_retreat_over_rolling_ground_is_planned_and_certified(plan: zs.Plan) -> None:
    assert plan.success, plan.message
    assert plan.certificate.limits_ok
    assert plan.margin >= 0.0
    assert plan.duration == pytest.approx(4.5, rel=1e-3)
    assert plan.iterations <= 10


def test_a_planar_heightmap_gives_the_plan_of_the_slope() -> None:
    scene, plan = retreat()
    lean = pin.utils.rotate("y", scene.pitch) @ pin.utils.rotate("x", scene.roll)
    goal = np.array(plan.problem.base.goal)
    goal[:2] = lean[:2, :2] @ goal[:2]  # seen from above
    plane = rolling_map(waves=())
    mapped = zs.plan(replace(retreat_problem(scene), ground=plane, base=base(goal=goal)))
    assert mapped.success
    assert mapped.iterations == plan.iterations
    assert mapped.duration == pytest.approx(plan.duration, abs=SAME)
    # the two certificates look at different times
    assert mapped.certificate.sampled == pytest.approx(plan.certificate.sampled, abs=1e-5)
    t = np.linspace(0.0, min(mapped.duration, plan.duration), 500)
    here, there = (
        zs.trajectory_zmp(scene.load(), p.trajectory, t, p.problem.ground) for p in (plan, mapped)
    )
    np.testing.assert_allclose(there, here, atol=1e-5)
    seen = plan.trajectory.base(t)[0][:, :2] @ lean[:2, :2].T
    np.testing.assert_allclose(mapped.trajectory.base(t)[0][:, :2], seen, atol=1e-6)


def test_the_position_is_that_of_a_unicycle_integrated_independently(plan: zs.Plan) -> None:
    drive, surface = plan.trajectory.base, Surface(terrain()[0], plan.problem.ground)
    place = np.array(plan.problem.base.start[:2])
    for k in range(plan.trajectory.intervals):  # smooth pieces

        def rate(t: float, at: Any) -> Any:
            _, (speed, _), _ = drive(float(np.clip(t, 0.0, plan.duration)))
            yaw = drive(float(np.clip(t, 0.0, plan.duration)))[0][2]
            return speed * surface.root(np.array([*at, yaw])).rotation[:2, 0]

        place = solve_ivp(
            rate, drive.times[k : k + 2], place, method="DOP853", rtol=1e-11, atol=1e-12
        ).y[:, -1]
        np.testing.assert_allclose(drive.poses[k + 1, :2], place, atol=PATH)
    np.testing.assert_allclose(place, plan.problem.base.goal[:2], atol=ARRIVED)


def test_the_zmp_is_that_of_the_bodies_poses(plan: zs.Plan) -> None:
    scene, _ = terrain()
    times = np.arange(0.002, plan.duration - 0.002, 1e-3)
    # differences do not see jumps
    times = times[np.abs(times[:, None] - plan.trajectory.times).min(axis=1) > 1.1e-3]
    machine, ground = plan.problem.machine, plan.problem.ground
    ours = zs.trajectory_zmp(machine, plan.trajectory, times, ground)
    assert (
        np.abs(zmp_from_poses(scene, plan.trajectory, times, ground=ground) - ours).max()
        < DIFFERENCES
    )
    assert machine.support.signed_distance(ours).min() >= plan.margin


def test_an_uncertain_payload_is_planned_for_over_terrain(plan: zs.Plan) -> None:
    uncertain = zs.plan(replace(plan.problem, payload_uncertainty=0.1))
    assert uncertain.success
    machine, ground = plan.problem.machine, plan.problem.ground
    t = np.linspace(0.0, uncertain.duration, 500)
    for share in (0.9, 0.96, 1.04, 1.1):
        points = zs.trajectory_zmp(
            machine.with_payload_scaled(share), uncertain.trajectory, t, ground
        )
        assert machine.support.signed_distance(points).min() >= uncertain.margin
    with pytest.raises(zs.ProblemError, match="slope_uncertainty needs a Slope"):
        replace(plan.problem, slope_uncertainty=0.02)


def test_gravity_of_an_uncertain_slope_leans_for_a_base_that_drives() -> None:
    machine, yaw = paper_scene().load(), 0.7
    rest, extremes = (
        np.zeros((1, 2)),
        {"tipping_fraction": 1.0, "payload_uncertainty": 0.0, "slope_uncertainty": 0.05},
    )
    for corner in corners(machine, zs.Slope(-0.2, 0.1), **extremes):
        motion = corner.ground.base_motion(np.array([[0.0, 0.0, yaw]]), rest, rest)
        np.testing.assert_allclose(
            motion.acceleration[0, :3], -corner.ground.gravity(yaw), atol=1e-12
        )
        # 9.81 x 0.05
        assert np.linalg.norm(motion.acceleration[0, :3] + zs.Slope(-0.2, 0.1).gravity(yaw)) > 0.4


def random_drive(seed: int) -> tuple[zs.Machine, zs.Trajectory, zs.Heightmap]:
    """Random motions of joints and base over waves of any direction, on any grid."""
    rng, machine = np.random.default_rng([7, seed]), paper_scene(point_masses=False).load()
    waves = [
        (rng.uniform(0.0, 0.15), rng.uniform(16.0, 40.0), *rng.uniform(0.0, 6.0, 2))
        for _ in range(2)
    ]
    lean, resolution = rng.uniform(-12.0, 12.0, 2), rng.choice([0.5, 1.0, 2.0])
    ground = rolling_map(
        *lean, waves=waves, resolution=resolution, low=(-30.0, -30.0), high=(30.0, 30.0)
    )
    n, count, duration = machine.size, int(rng.integers(2, 25)), rng.uniform(0.5, 4.0)
    times = np.linspace(0.0, duration, count + 1)
    h = np.diff(times)[:, None]
    a = rng.uniform(-0.6, 0.6, (count, n + 2)) * np.append(np.ones(n), [3.0, 1.5])
    j = rng.uniform(-1.0, 1.0, (count, n + 2)) * rng.choice([0.0, 0.7])
    still = np.zeros((1, n + 2))
    v = np.append(np.zeros(n), rng.uniform(-2.0, 2.0, 2) * [1.0, 0.3])
    v = v + np.vstack([still, np.cumsum(h * a + h**2 * j / 2, axis=0)])
    q = np.append(np.array(PAPER_START) + rng.uniform(-0.3, 0.3, n), [0.0, rng.uniform(-3.0, 3.0)])
    q = q + np.vstack([still, np.cumsum(h * v[:-1] + h**2 * a / 2 + h**3 * j / 6, axis=0)])
    drive = UnicycleMotion.from_start(
        times, rng.uniform(-5.0, 5.0, 3), v[:, n:], q[:, -1], (a[:, n:], j[:, n:]), ground
    )
    return (
        machine,
        zs.Trajectory(machine.joint_names, times, q[:, :n], v[:, :n], a[:, :n], j[:, :n], drive),
        ground,
    )


def test_no_certificate_of_a_random_drive_is_above_samples_at_10_kHz() -> None:
    looseness = []
    for seed in range(25):
        machine, motion, ground = random_drive(seed)
        try:
            found = zs.certify(machine, motion, ground)
        except zs.ProblemError as refused:
            assert "too rough" in str(refused)  # noqa: PT017
            continue
        t = np.linspace(0.0, motion.duration, int(1e4 * motion.duration))
        try:
            least = float(
                machine.support.signed_distance(zs.trajectory_zmp(machine, motion, t, ground)).min()
            )
        except zs.ContactLost:
            assert found.margin == -np.inf
            continue
        assert found.margin <= min(least, found.sampled) + 1e-12, seed
        looseness.append(min(least, found.sampled) - found.margin)
    assert len(looseness) >= 15
    assert max(looseness) < LOOSE


def test_a_motion_over_terrain_survives_a_csv_file_with_its_ground(
    plan: zs.Plan, tmp_path: Path
) -> None:
    plan.trajectory.to_csv(tmp_path / "motion.csv")
    machine, ground = plan.problem.machine, plan.problem.ground
    read = zs.Trajectory.from_csv(tmp_path / "motion.csv", machine, ground)
    t = np.linspace(0.0, plan.duration, 333)
    for one, other in zip(read.base(t), plan.trajectory.base(t), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-11)
    assert zs.certify(machine, read, ground, base=plan.problem.base).safe
    with pytest.raises(zs.TrajectoryError, match="give that as its ground"):
        zs.Trajectory.from_csv(tmp_path / "motion.csv", machine)
    with pytest.raises(zs.TrajectoryError, match=r"base\..* does not follow"):
        zs.certify(machine, read, zs.Slope(-0.35))  # it did not drive there
    with pytest.raises(zs.TrajectoryError, match="does not follow"):
        zs.trajectory_zmp(machine, read, 1.0, rolling_map(-15.0))


# --- where no machine can drive -----------------------------------------------------------------


def problem(
    ground: Any, start: Any = (0.0, 0.0, 0.0), goal: Any = (-3.0, 0.0, 0.0), **options: Any
) -> zs.Problem:
    scene = paper_scene()
    return replace(
        scene.problem(PAPER_START, PAPER_START), ground=ground, base=base(start, goal, **options)
    )


@pytest.mark.parametrize(
    ("ground", "where", "message"),
    [
        (
            rolling_map(),
            {"goal": (20.0, 0.0, 0.0)},
            r"base goal: .*leaves the map at .*20.000, 0.000",
        ),
        (rolling_map(), {"start": (-16.0, 0.0, 0.0)}, r"base start: a track leaves the map"),
        (rolling_map(waves=ROUGH), {}, r"base start: terrain is too rough .* curves with a radius"),
        (
            zs.Heightmap(np.zeros((8, 8)), 1.0, (-4.0, -4.0)),
            {},
            r"base goal: a track leaves the map",
        ),
    ],
)
def test_starts_and_goals_that_no_tracks_can_stand_on_are_refused(
    ground: Any, where: Any, message: str
) -> None:
    with pytest.raises(zs.ProblemError, match=message):
        problem(ground, **where)


def test_tipping_over_at_rest_is_judged_by_the_slope_at_the_place() -> None:
    y = np.arange(-40.0, 41.0)
    valley = zs.Heightmap(np.tile(0.0095 * y[:, None] ** 2, (1, 21)), 1.0, (-10.0, -40.0))
    lean = problem(valley, goal=(0.0, 15.0, 0.0)).gravity_at("goal")
    assert np.arctan2(-lean[1], -lean[2]) == pytest.approx(np.arctan(2.0 * 0.0095 * 15.0), abs=1e-9)
    with pytest.raises(zs.ProblemError, match=r"misses the margin of 0\.5 m at rest at the goal"):
        # 34 degrees; at 16 there is half a metre left
        replace(problem(valley, goal=(0.0, 35.0, 0.0)), margin=0.5)
    replace(problem(valley, goal=(0.0, 15.0, 0.0)), margin=0.5)


def test_a_ridge_on_the_way_is_a_refusal_that_says_where() -> None:
    x, y = np.arange(-16.0, 17.0), np.arange(-8.0, 9.0)
    ridge = zs.Heightmap(np.tile(0.5 * np.exp(-((x / 1.5) ** 2)), (len(y), 1)), 1.0, (-16.0, -8.0))
    plan = zs.plan(problem(ridge, start=(-8.0, 0.0, 0.0), goal=(8.0, 0.0, 0.0)))
    assert not plan.success
    assert plan.status is zs.Status.TERRAIN
    assert "too rough for the tracks at (x, y) = (" in plan.message
    with pytest.raises(zs.NotSolved, match="too rough"):
        _ = plan.trajectory
    assert zs.diagnose(plan).message == plan.message  # less payload would not help


def test_the_base_keeps_its_tracks_on_the_map() -> None:
    narrow = zs.Heightmap(np.zeros((9, 40)), 1.0, (-30.0, -4.0))
    plan = zs.plan(problem(narrow, start=(0.0, -0.5, 0.0), goal=(-20.0, 0.5, 0.3)))
    assert plan.success, plan.message
    assert np.abs(plan.trajectory.base(np.linspace(0.0, plan.duration, 999))[0][:, 1]).max() <= 1.03


def test_a_motion_that_leaves_its_map_is_refused() -> None:
    times, speed = np.linspace(0.0, 2.0, 5), np.array([[4.0, 0.0]] * 5)
    still = np.zeros((4, 2))
    small = zs.Heightmap(np.zeros((12, 12)), 1.0, (-6.0, -6.0))
    with pytest.raises(zs.ProblemError, match=r"leaves the map at \(x, y\) = \(5"):
        UnicycleMotion.from_start(times, np.zeros(3), speed, np.zeros(5), (still, still), small)
    with pytest.raises(zs.TrajectoryError, match="drives on a Slope or a Heightmap"):
        UnicycleMotion.from_start(times, np.zeros(3), speed, np.zeros(5), (still, still), None)


def test_a_ground_that_only_has_gravity_carries_no_driving_base() -> None:
    class Odd:
        def gravity(self, yaw: float = 0.0) -> Any:
            return np.array([0.0, 0.0, -9.81])

    with pytest.raises(zs.ProblemError, match="drives on a Slope or a Heightmap, not on Odd"):
        problem(Odd())
    with pytest.raises(zs.ProblemError, match="drives on a Slope or a Heightmap, not on Odd"):
        zs.certify(paper_scene(point_masses=False).load(), retreat()[1].trajectory, Odd())


def test_the_papers_base_bound_is_for_planes() -> None:
    machine, arm = (
        paper_scene().load(),
        zs.phase_plane(paper_scene().load(), PAPER_START, PAPER_GOAL),
    )
    with pytest.raises(zs.ProblemError, match="in a plane, not over a Heightmap"):
        zs.base_acceleration_bound(machine, arm, rolling_map())


def test_the_simplified_model_does_not_drive() -> None:
    with pytest.raises(
        zs.ProblemError, match="a base that drives needs model=\"full\", not 'simplified'"
    ):
        replace(problem(rolling_map()), model="simplified")


# --- scenario -----------------------------------------------------------------------------------


def test_the_shipped_scenario_is_this_problem(plan: zs.Plan) -> None:
    asked, given = plan.problem, load_scenario("terrain").problem
    np.testing.assert_allclose(given.ground.heights, asked.ground.heights, atol=1e-5)
    np.testing.assert_array_equal(given.ground.extent, asked.ground.extent)
    np.testing.assert_allclose(given.base.goal, asked.base.goal, atol=SAME)
    assert zs.plan(given).duration == pytest.approx(plan.duration, abs=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'file = "terrain.csv"',
            'file = "no.csv"',
            r"\[ground\]: heights cannot be read from .*no.csv",
        ),
        ('file = "terrain.csv"', "", r"\[ground.heightmap\] file: missing"),
        (
            "resolution = 1.0",
            "resolution = 0.0",
            r"\[ground\]: heightmap resolution must be positive",
        ),
        ("resolution = 1.0", "spacing = 1.0", r"\[ground.heightmap\] spacing: unknown key"),
        ("origin = [-16.0, -14.0]", "origin = [-16.0]", "must be 2 finite numbers"),
        (
            "[ground.heightmap]",
            "[ground]\nroll_deg = 1.0\n[ground.heightmap]",
            "roll_deg and heightmap exclude",
        ),
    ],
)
def test_a_wrong_heightmap_in_a_scenario_is_refused_by_name(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    (tmp_path / "terrain.csv").write_text((SHIPPED / "terrain.csv").read_text())
    (tmp_path / "wrong.toml").write_text((SHIPPED / "terrain.toml").read_text().replace(old, new))
    with pytest.raises(zs.ScenarioError, match=message):
        load_scenario(tmp_path / "wrong.toml")


def test_heights_may_come_from_numpys_file_format(tmp_path: Path) -> None:
    np.save(tmp_path / "terrain.npy", np.loadtxt(SHIPPED / "terrain.csv", delimiter=","))
    text = (SHIPPED / "terrain.toml").read_text().replace("terrain.csv", "terrain.npy")
    (tmp_path / "numpy.toml").write_text(text)
    ours, shipped = (
        load_scenario(name).problem.ground for name in (tmp_path / "numpy.toml", "terrain")
    )
    np.testing.assert_array_equal(ours.heights, shipped.heights)


def test_limits_of_the_base_are_those_of_the_helper() -> None:
    assert BASE_LIMITS["max_speed"] == load_scenario("terrain").problem.base.max_speed
