"""The machine drives while the arm swings: one problem, one program, one certificate."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import zmp_sqp as zs
from benchmarks.problems.checks import joint_limit_excess
from benchmarks.problems.driving_checks import zmp_from_poses
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_scene
from benchmarks.problems.terrain import unicycle_base as base
from tests.planning.driving import paper_2_joint, retreat, retreat_problem
from zmp_sqp.mechanics.bounds.effort_bounds import effort_bounds
from zmp_sqp.mechanics.bounds.root_bounds import root_bounds
from zmp_sqp.mechanics.wrench import ground_reaction
from zmp_sqp.motion.root_motion import root_motion
from zmp_sqp.scenario import SHIPPED, load_scenario

EXACT = 1e-6  # [s] of a duration that must not change
ARRIVED = 1e-3  # [m] the issue's
DIFFERENCES = 5e-3  # [m] the issue's, of a ZMP from finite differences
SAME = 1e-12
FAST = 2.0  # [s] of planning, in case the test machine is busy; the figure in F is printed


def check(plan: zs.Plan) -> None:
    assert plan.success, plan.message
    assert plan.certificate.limits_ok
    assert plan.margin >= 0.0
    assert plan.duration >= plan.lower_bound


def drive(start: Any, goal: Any, *, arm: bool, **options: Any) -> zs.Plan:
    problem = paper_scene().problem(
        PAPER_START, PAPER_GOAL if arm else PAPER_START, base=base(start, goal, **options)
    )
    return zs.plan(problem)


def test_an_arm_on_a_base_that_stays_takes_as_long_as_on_a_standing_one() -> None:
    moving = drive((1.0, 2.0, 0.0), (1.0, 2.0, 0.0), arm=True)
    standing = zs.plan(paper_scene().problem(PAPER_START, PAPER_GOAL))
    check(moving)
    assert moving.duration == pytest.approx(standing.duration, abs=EXACT)
    # in between it may sway a little where that helps the ZMP
    np.testing.assert_allclose(
        moving.trajectory.base.poses[[0, -1]], [[1.0, 2.0, 0.0]] * 2, atol=EXACT
    )


def test_driving_straight_without_the_arm_takes_the_time_of_a_double_integrator() -> None:
    plan = drive((0.0, 0.0, 0.0), (-3.0, 0.0, 0.0), arm=False)
    check(plan)
    assert plan.duration == pytest.approx(2.0 * np.sqrt(3.0 / 2.0), rel=1e-6)
    assert plan.trajectory.base.velocities[:, 0].max() <= EXACT  # it backs up
    np.testing.assert_allclose(plan.trajectory.positions, [PAPER_START] * 51, atol=EXACT)


def test_turning_on_the_spot_takes_the_time_of_the_yaw() -> None:
    plan = drive((0.0, 0.0, 0.3), (0.0, 0.0, -0.4), arm=False)
    check(plan)
    assert plan.duration == pytest.approx(0.7 / 0.5 + 0.5 / 1.0, rel=1e-3)
    np.testing.assert_allclose(plan.trajectory.base.poses[:, :2], 0.0, atol=ARRIVED)


def test_a_base_already_at_its_goal_needs_no_time() -> None:
    plan = drive((1.0, 2.0, 0.3), (1.0, 2.0, 0.3), arm=False)
    check(plan)
    assert plan.duration == 0.0
    np.testing.assert_array_equal(plan.trajectory.base(0.0)[0], [1.0, 2.0, 0.3])


def test_a_lateral_goal_is_reached_by_an_s() -> None:
    plan = drive((0.0, 0.0, 0.0), (-3.0, 0.5, 0.0), arm=False)
    check(plan)
    np.testing.assert_allclose(plan.trajectory.base.poses[-1], [-3.0, 0.5, 0.0], atol=ARRIVED)


def test_boundaries_in_motion() -> None:
    plan = drive(
        (0.0, 0.0, 0.2),
        (4.0, 1.5, 0.5),
        arm=True,
        start_velocity=(0.8, 0.1),
        goal_velocity=(0.5, -0.1),
    )
    check(plan)
    _, velocity, _ = plan.trajectory.base(np.array([0.0, plan.duration]))
    np.testing.assert_allclose(velocity, [[0.8, 0.1], [0.5, -0.1]], atol=1e-9)


def test_a_retreat_that_begins_and_ends_in_motion_keeps_the_limits_of_its_base() -> None:
    """Arriving to the last digit once cost 1e-6 of the acceleration limit, and the proof."""
    problem = retreat_problem(paper_scene(point_masses=False))
    moving = replace(problem.base, start_velocity=(0.8, 0.0), goal_velocity=(0.0, 0.0))
    plan = zs.plan(replace(problem, base=moving))
    check(plan)
    assert plan.duration == pytest.approx(4.502, abs=1e-3)


def test_the_bounds_of_a_corridor_hold_at_the_nodes() -> None:
    free = drive((0.0, 0.0, 0.0), (-5.0, -2.0, 0.5), arm=True)
    side = float(free.trajectory.base.poses[:, 1].max())
    bound = max(0.5 * side, 1e-3)
    plan = drive((0.0, 0.0, 0.0), (-5.0, -2.0, 0.5), arm=True, y_bounds=(-2.0, bound))
    check(plan)
    y = plan.trajectory.base.poses[:, 1]
    assert y.min() >= -2.0 - EXACT
    assert y.max() <= bound + EXACT


def test_paper_2_planned_together_takes_4_5_seconds() -> None:
    _, plan = paper_2_joint()
    check(plan)
    assert plan.duration == pytest.approx(4.5, rel=1e-3)
    assert plan.status is zs.Status.FASTEST_POSSIBLE
    np.testing.assert_allclose(plan.trajectory.base.poses[-1], [-2.0, 0.0, 0.0], atol=ARRIVED)


def test_the_retreat_is_planned_in_few_iterations(capsys: pytest.CaptureFixture[str]) -> None:
    scene, plan = retreat()
    check(plan)
    assert plan.iterations <= 10
    problem, model = retreat_problem(scene), scene.load().model
    begun = time.perf_counter()
    zs.plan(problem)
    spent = time.perf_counter() - begun
    data, q, v = model.createData(), pin.neutral(model), np.zeros(model.nv)
    begun = time.perf_counter()
    for _ in range(1000):
        pin.computeRNEADerivatives(model, data, q, v, v)
    unit = (time.perf_counter() - begun) / 10.0
    with capsys.disabled():
        print(
            f"\nretreat: {plan.iterations} iterations, {1e3 * spent:.0f} ms = {spent / unit:.0f} F"
        )
    assert spent < FAST


@pytest.mark.parametrize("planned", [paper_2_joint, retreat])
def test_the_position_is_that_of_a_unicycle_integrated_independently(planned: Any) -> None:
    _, plan = planned()
    drive = plan.trajectory.base
    place = np.array(plan.problem.base.start[:2])
    for k in range(plan.trajectory.intervals):  # smooth pieces
        span = drive.times[k : k + 2]

        def rate(t: float, _: Any) -> list[float]:
            (_, _, yaw), (speed, _), _ = drive(float(np.clip(t, 0.0, plan.duration)))
            return [speed * np.cos(yaw), speed * np.sin(yaw)]

        place = solve_ivp(rate, span, place, method="RK45", rtol=1e-8, atol=1e-10).y[:, -1]
        np.testing.assert_allclose(drive.poses[k + 1, :2], place, atol=EXACT)
    np.testing.assert_allclose(place, plan.problem.base.goal[:2], atol=ARRIVED)


@pytest.mark.parametrize("planned", [paper_2_joint, retreat])
def test_the_zmp_is_that_of_the_bodies_poses(planned: Any) -> None:
    scene, plan = planned()
    times = np.arange(0.002, plan.duration - 0.002, 1e-3)
    nodes = plan.trajectory.times
    # differences do not see jumps
    times = times[np.abs(times[:, None] - nodes).min(axis=1) > 1.1e-3]
    ours = zs.trajectory_zmp(plan.problem.machine, plan.trajectory, times, plan.problem.ground)
    assert np.abs(zmp_from_poses(scene, plan.trajectory, times) - ours).max() < DIFFERENCES
    support = plan.problem.machine.support
    assert (support.offsets - ours @ support.normals.T).min() >= 0.0


@pytest.mark.parametrize("planned", [paper_2_joint, retreat])
def test_the_certificate_is_not_above_dense_samples_and_close_to_them(planned: Any) -> None:
    _, plan = planned()
    machine, motion = plan.problem.machine, plan.trajectory
    t, q, v, a = motion.within(np.linspace(0.0, 1.0, 200))
    k = np.repeat(np.arange(motion.intervals), 200)
    twist, root = root_motion(motion, plan.problem.ground.gravity(), k, t - motion.times[k])
    wrench = ground_reaction(machine, q, v, a, root_acceleration=root, root_velocity=twist)
    least = float((-(wrench @ machine.support.wrench_rows().T) / wrench[:, 2:3]).min())
    assert least - 5e-4 <= plan.margin <= least + SAME
    assert joint_limit_excess(machine.limits, motion) <= 1e-9


def test_the_bound_on_the_wrenchs_curvature_holds_for_a_base_that_drives_and_turns() -> None:
    machine, rng, h = paper_scene(point_masses=False).load(), np.random.default_rng(3), 1e-3
    ground = zs.Slope(roll=-0.3, pitch=0.2)
    for case in range(20):
        q, v, a, j = rng.uniform(-1.0, 1.0, (4, 1, machine.size))
        yaw, speeds, pushes, jerks = rng.uniform(-1.0, 1.0), *rng.uniform(-2.0, 2.0, (3, 1, 2))
        if case == 0:  # the turn alone
            v, a, j = 0.0 * v, 0.0 * a, 0.0 * j
        wrenches = []
        for t in (-h, 0.0, h):
            turned = yaw + t * speeds[0, 1] + t**2 * pushes[0, 1] / 2 + t**3 * jerks[0, 1] / 6
            twist, root = np.zeros((2, 1, 6))
            twist[:, [0, 5]] = speeds + t * pushes + t**2 * jerks / 2
            root[:, [0, 5]] = pushes + t * jerks
            root[:, :3] -= ground.gravity(turned)
            at = q + t * v + t**2 * a / 2 + t**3 * j / 6, v + t * a + t**2 * j / 2, a + t * j
            wrenches.append(
                ground_reaction(machine, *at, root_acceleration=root, root_velocity=twist)[0]
            )
        change = (wrenches[2] - 2.0 * wrenches[1] + wrenches[0]) / h**2
        peaks = np.abs(np.stack([speeds, pushes, jerks])).transpose(2, 0, 1)
        _, bound = effort_bounds(
            machine,
            np.abs(v),
            np.abs(a),
            np.abs(j),
            reach=np.abs(q),
            gravity=9.81,
            base=root_bounds(peaks),
        )
        assert np.linalg.norm(change[:3]) <= 1.01 * bound.force[0]
        assert np.linalg.norm(change[3:]) <= 1.01 * bound.moment[0]


def test_a_certificate_looks_at_the_bases_limits_and_goal() -> None:
    scene, plan = retreat()
    machine, goal = plan.problem.machine, plan.problem.base.goal
    for changed in (
        {"max_speed": 1.0},
        {"max_yaw_acceleration": 0.01},
        {"goal": goal + np.array([0.002, 0.0, 0.0])},
    ):
        held = base(**({"goal": goal} | changed))
        assert not zs.certify(machine, plan.trajectory, scene.ground, base=held).limits_ok
    assert zs.certify(machine, plan.trajectory, scene.ground, base=plan.problem.base).safe


def test_a_trajectory_with_a_base_survives_a_file(tmp_path: Path) -> None:
    _, plan = retreat()
    plan.trajectory.to_csv(tmp_path / "motion.csv")
    read = zs.Trajectory.from_csv(tmp_path / "motion.csv", plan.problem.machine)
    t = np.linspace(0.0, plan.duration, 333)
    for one, other in zip(read.base(t), plan.trajectory.base(t), strict=True):
        np.testing.assert_allclose(one, other, atol=SAME)
    assert read.base(1.0)[0].shape == (3,)
    plan.trajectory.to_json(tmp_path / "motion.json")
    again = zs.Trajectory.from_json(tmp_path / "motion.json", plan.problem.machine)
    np.testing.assert_array_equal(again.base.table(), plan.trajectory.base.table())
    assert zs.certify(plan.problem.machine, again, plan.problem.ground, base=plan.problem.base).safe


def test_a_trajectory_without_a_base_has_none() -> None:
    assert zs.plan(paper_scene().problem(PAPER_START, PAPER_GOAL)).trajectory.base is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"goal": (1.0, 2.0)}, "base goal must have shape"),
        ({"start": (0.0, np.nan, 0.0)}, "base start must be finite"),
        ({"max_speed": 0.0}, "base max_speed must be positive"),
        ({"max_yaw_rate": "fast"}, "base max_yaw_rate must be a number"),
        (
            {"start_velocity": (11.0, 0.0)},
            r"base start_velocity: speed 11 is outside its limits \+-10",
        ),
        ({"goal_velocity": (0.0, -0.6)}, "base goal_velocity: yaw rate -0.6"),
        ({"x_bounds": (1.0, -1.0)}, "base x_bounds: the lower bound"),
        (
            {"y_bounds": (-1.0, 1.0), "goal": (0.0, 2.0, 0.0)},
            "base goal: y = 2 m is outside y_bounds",
        ),
    ],
)
def test_bad_bases_are_refused_by_name(options: dict[str, Any], message: str) -> None:
    with pytest.raises(zs.ProblemError, match=message):
        base(**options)


def test_bad_problems_with_a_base_are_refused() -> None:
    scene = paper_scene()
    with pytest.raises(zs.ProblemError, match="base must be a UnicycleBase"):
        scene.problem(PAPER_START, PAPER_GOAL, base=(0.0, 0.0, 0.0))
    with pytest.raises(zs.ProblemError, match='needs model="full"'):
        scene.problem(PAPER_START, PAPER_GOAL, base=base(), model="simplified")
    over_the_left_side = np.append(np.pi / 2, PAPER_START[1:])
    with pytest.raises(zs.ProblemError, match="tips over at rest at the goal"):
        scene.problem(PAPER_START, over_the_left_side, base=base())
    turned = base(goal=(0.0, 0.0, -np.pi / 2))  # the arm then points uphill or downhill instead
    scene.problem(PAPER_START, over_the_left_side, base=turned)


def test_a_path_on_another_base_is_refused() -> None:
    _, plan = retreat()
    standing = zs.phase_plane(plan.problem.machine, PAPER_START, PAPER_GOAL)
    with pytest.raises(zs.ProblemError, match="that of the trajectory stands"):
        zs.certify(plan.problem.machine, standing, plan.problem.ground, base=plan.problem.base)


@pytest.mark.parametrize(
    ("name", "planned"), [("paper_2_joint", paper_2_joint), ("retreat", retreat)]
)
def test_the_shipped_scenarios_are_these_problems(name: str, planned: Any) -> None:
    asked, problem = planned()[1].problem, load_scenario(name).problem
    for side in ("start", "goal"):
        np.testing.assert_allclose(
            getattr(problem.base, side), getattr(asked.base, side), atol=EXACT
        )
        np.testing.assert_allclose(getattr(problem, side), getattr(asked, side), atol=EXACT)
    assert problem.ground.gravity() == pytest.approx(asked.ground.gravity())
    plan = zs.plan(problem)
    check(plan)
    assert plan.duration == pytest.approx(4.5, rel=1e-3)


def test_a_wrong_base_in_a_scenario_is_refused_by_name(tmp_path: Path) -> None:
    text = (SHIPPED / "retreat.toml").read_text()
    for old, new, message in (
        ("max_speed = 10.0", "max_sped = 10.0", "max_sped: unknown key .did you mean max_speed"),
        ("max_speed = 10.0", "max_speed = -1.0", "base max_speed must be positive"),
        ("start = [0.0, 0.0, 0.0]", "start = [0.0, 0.0]", "start: must be 3 finite numbers"),
    ):
        (tmp_path / "wrong.toml").write_text(text.replace(old, new))
        with pytest.raises(zs.ScenarioError, match=message):
            load_scenario(tmp_path / "wrong.toml")
