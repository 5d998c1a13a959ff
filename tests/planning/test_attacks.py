"""Ways in which a motion was once called safe although it was not what was asked for."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

import zmp_sqp as zs
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_scene
from benchmarks.problems.terrain import rolling_map
from benchmarks.problems.terrain import unicycle_base as base
from tests.planning.driving import retreat
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning.proof import position_errors
from zmp_sqp.planning.proof.base_check import ARRIVAL, BOUNDS_TOLERANCE, position_room
from zmp_sqp.planning.search.messages import failure_message

GRID = np.arange(-6.0, 6.01, 0.1)
X, Y = np.meshgrid(GRID, GRID, indexing="ij")


def bump(x: float, y: float, *, height: float, width: float) -> zs.Heightmap:
    heights = height * np.exp(-((X - x) ** 2 + (Y - y) ** 2) / (2.0 * width**2))
    return zs.Heightmap(heights, 0.1, (-6.0, -6.0))


def test_a_base_that_arrives_at_another_speed_has_not_arrived() -> None:
    scene, plan = retreat()
    asked = plan.problem.base
    assert asked is not None
    machine, motion = plan.problem.machine, plan.trajectory
    assert zs.certify(machine, motion, scene.ground, base=asked).safe
    for rates in ({"start_velocity": (0.01, 0.0)}, {"goal_velocity": (0.0, -0.01)}):
        other = base(start=asked.start, goal=asked.goal, **rates)
        found = zs.certify(machine, motion, scene.ground, base=other)
        assert not found.limits_ok
        assert not found.safe


@pytest.mark.parametrize(("x", "y", "width"), [(1.2, 1.0, 0.5), (1.7, 0.65, 0.3)])
def test_a_machine_that_stands_on_ground_its_tracks_cannot_follow_is_refused(
    x: float, y: float, width: float
) -> None:
    """The second bump stands between the ways to the corners and to the middles of the edges."""
    ground, machine = bump(x, y, height=0.8, width=width), paper_scene().load()
    with pytest.raises(zs.ProblemError, match="too rough for the tracks"):
        zs.Problem(machine, PAPER_START, PAPER_GOAL, ground)
    with pytest.raises(zs.ProblemError, match="too rough for the tracks"):
        zs.Problem(machine, PAPER_START, PAPER_GOAL, ground, base=base(goal=(0.1, 0.0, 0.0)))
    zs.Problem(machine, PAPER_START, PAPER_GOAL, bump(x, y, height=0.0, width=width))


def test_a_map_need_not_hold_its_origin() -> None:
    heights = 0.3 * np.sin(np.arange(-15.0, 16.0) / 12.0)[:, None] + np.zeros(31)
    machine, durations = paper_scene().load(), []
    for shift in (0.0, 5000.0):
        ground = zs.Heightmap(heights, 1.0, (shift - 15.0, shift - 15.0))
        way = base(start=(shift, shift, 0.0), goal=(shift + 2.0, shift + 0.2, 0.2))
        plan = zs.plan(zs.Problem(machine, PAPER_START, PAPER_GOAL, ground, base=way, intervals=20))
        assert plan.success, plan.message
        assert np.isfinite(
            zs.trajectory_zmp(machine, plan.trajectory, plan.duration / 2, ground)
        ).all()
        durations.append(plan.duration)
    assert durations[0] == pytest.approx(durations[1], rel=1e-6)


def test_stamps_that_contradict_the_times_are_refused(tmp_path: Path) -> None:
    machine, path = paper_scene().load(), tmp_path / "motion.json"
    zs.phase_plane(machine, PAPER_START, PAPER_GOAL).to_json(path)
    content = json.loads(path.read_text(encoding="utf-8"))
    for point in content["points"]:
        stamp = 0.3 * point["time"]
        point["time_from_start"] = {"sec": int(stamp), "nanosec": round(1e9 * (stamp % 1.0))}
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(zs.TrajectoryError, match=r"time says .* s, but time_from_start"):
        zs.Trajectory.from_json(path, machine)


def test_a_motion_that_tips_the_machine_is_not_safe_whatever_margin_is_asked_for() -> None:
    machine = paper_scene().load()
    found = zs.certify(
        machine, zs.phase_plane(machine, PAPER_START, PAPER_GOAL), paper_scene().ground, margin=-5.0
    )
    assert -5.0 < found.margin < -0.3
    assert not found.safe


def test_rows_of_the_wrong_length_are_refused_and_a_byte_order_mark_is_not(tmp_path: Path) -> None:
    machine, path = paper_scene().load(), tmp_path / "motion.csv"
    motion = zs.phase_plane(machine, PAPER_START, PAPER_GOAL)
    motion.to_csv(path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text, encoding="utf-8-sig")  # as spreadsheets do
    np.testing.assert_array_equal(zs.Trajectory.from_csv(path, machine).positions, motion.positions)
    lines = text.splitlines()
    for row in ("0", lines[1] + ",0"):
        path.write_text("\n".join([lines[0], row, *lines[2:]]), encoding="utf-8")
        with pytest.raises(zs.TrajectoryError, match="row 2 is not"):
            zs.Trajectory.from_csv(path, machine)


def test_a_base_arrives_at_goals_nearer_than_a_millimetre_or_the_plan_fails() -> None:
    machine = paper_scene().load()
    for goal in ((0.0, 0.0009, 0.0), (0.0009, 0.0, 0.0), (0.0, 0.002, 0.0)):
        plan = zs.plan(
            zs.Problem(machine, PAPER_START, PAPER_START, base=base(goal=goal), intervals=20)
        )
        if plan.success:
            assert np.abs(plan.trajectory.base(plan.duration)[0] - goal).max() <= 1e-5


def arc(intervals: int, ground: Any = None, **options: Any) -> zs.Plan:
    """Drive 4 m on an arc that bulges by 0.2 m, the arm at rest."""
    moving, scene = base(start=(0.0, 0.0, 0.4), goal=(4.0, 0.0, -0.4), **options), paper_scene()
    machine, ground = scene.load(), scene.ground if ground is None else ground
    return zs.plan(
        zs.Problem(machine, PAPER_START, PAPER_START, ground, base=moving, intervals=intervals)
    )


def furthest(motion: zs.Trajectory) -> float:
    return float(motion.base(np.linspace(0.0, motion.duration, 20_000))[0][:, 1].max())


@pytest.mark.parametrize("intervals", [6, 50])
def test_bounds_of_a_base_hold_between_the_nodes_too(intervals: int) -> None:
    plan = arc(intervals)
    machine, ground, motion = plan.problem.machine, plan.problem.ground, plan.trajectory
    top, truly = float(motion.base.poses[:, 1].max()), furthest(motion)
    assert truly > top + 5.0 * BOUNDS_TOLERANCE  # between the nodes, which keep the bound
    asked = replace(plan.problem.base, y_bounds=(-1.0, top))
    found = zs.certify(machine, motion, ground, base=asked)
    assert not found.limits_ok
    assert not found.safe
    assert truly - top <= found.limit_excess <= truly - top + 1e-6
    assert "out of its y_bounds" in found.fault
    roomy = replace(plan.problem.base, y_bounds=(-1.0, truly + 1e-6))
    assert zs.certify(machine, motion, ground, base=roomy).limits_ok
    planned = arc(intervals, y_bounds=(-1.0, 0.7 * top))
    assert planned.success, planned.message
    assert furthest(planned.trajectory) <= 0.7 * top + BOUNDS_TOLERANCE


@pytest.mark.parametrize("seed", range(5))
def test_the_excess_over_a_bound_is_that_of_the_unicycle_integrated_by_other_means(
    seed: int,
) -> None:
    # three long intervals, turning by radians
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 3.0, 4)
    push, jerk = rng.uniform(-2.0, 2.0, (2, 3, 2))
    rates = np.vstack([np.zeros(2), np.cumsum(push + 0.5 * jerk, axis=0)])
    turned = np.cumsum(rates[:-1, 1] + 0.5 * push[:, 1] + jerk[:, 1] / 6.0)
    motion = UnicycleMotion.from_start(t, np.zeros(3), rates, np.append(0.0, turned), (push, jerk))
    fine = np.linspace(0.0, 3.0, 300_001)
    pose, velocity, _ = motion(fine)
    y = cumulative_simpson(velocity[:, 0] * np.sin(pose[:, 2]), x=fine, initial=0.0)
    high, low = float(y.max()), float(y.min())
    for side, bounds in ((high, (-100.0, high - 1e-3)), (-low, (low + 1e-3, 100.0))):
        if side > 1e-2:  # the start lies within
            least = position_room(base(goal=(0.0, 0.0, 0.0), y_bounds=bounds), motion)
            assert least.row % 2 == 1
            assert 1e-3 - 1e-8 <= -least.guaranteed <= 1e-3 + 1e-6


def test_bounds_of_a_base_hold_over_terrain_too() -> None:
    plan = arc(10, rolling_map(-10.0))
    assert plan.success, plan.message
    machine, ground, motion = plan.problem.machine, plan.problem.ground, plan.trajectory
    truly = furthest(motion)
    for room, kept in ((-1e-4, False), (1e-4, True)):
        asked = replace(plan.problem.base, y_bounds=(-1.0, truly + room))
        found = zs.certify(machine, motion, ground, base=asked)
        assert found.limits_ok is kept, found.fault
        assert kept or 1e-4 <= found.limit_excess <= 1.5e-4
    planned = arc(10, rolling_map(-10.0), y_bounds=(-1.0, 0.7 * truly))
    assert planned.success, planned.message
    assert furthest(planned.trajectory) <= 0.7 * truly + BOUNDS_TOLERANCE


def test_a_motion_from_elsewhere_arrives_where_a_plan_has_to() -> None:
    plan = arc(10)
    machine, motion, ground = plan.problem.machine, plan.trajectory, plan.problem.ground
    for miss, arrived in ((0.5 * ARRIVAL, True), (1e-4, False)):
        asked = replace(plan.problem.base, goal=np.add(plan.problem.base.goal, [0.0, miss, 0.0]))
        found = zs.certify(machine, motion, ground, base=asked)
        assert found.limits_ok is arrived
        assert found.safe is arrived
    assert "ends 0.0001 m beside the goal of the base (1e-05 m or rad are allowed)" in found.fault


def test_a_plan_arrives_on_a_coarse_grid_to_a_nanometre() -> None:
    """Simpson's rule of the program misses the true path by micrometres there."""
    plan = arc(6)
    assert np.abs(plan.trajectory.base(plan.duration)[0] - plan.problem.base.goal).max() <= 2e-9


def test_a_goal_across_the_heading_is_reached_or_said_to_be_out_of_reach() -> None:
    scene, across = paper_scene(), (0.0, 0.0009, 0.0)
    found = zs.plan(scene.problem(PAPER_START, PAPER_START, base=base(goal=across), intervals=10))
    assert found.success, found.message
    np.testing.assert_allclose(found.trajectory.base(found.duration)[0], across, atol=ARRIVAL)
    few = zs.plan(scene.problem(PAPER_START, PAPER_START, base=base(goal=across), intervals=3))
    assert few.status is zs.Status.BASE
    assert "m beside the goal of the base" in few.message
    assert (
        "the goal lies 0.9 mm to the side of the heading, and tracks do not slip sideways: "
        "plan by way of" in few.message
    )


def test_a_violation_below_a_millimetre_is_not_called_zero() -> None:
    _, plan = retreat()
    certificate, margin = plan.certificate, plan.problem.margin
    short = replace(certificate.tip_over, value=margin - 2e-5)
    others = tuple(found for found in certificate.guarantees if found.name != "tip_over")
    near = replace(certificate, guarantees=(short, *others), sampled=margin - 1e-5)
    message = failure_message(plan.problem, zs.Status.TIME_BUDGET, near)
    assert "0.02 mm" in message
    assert "0.000" not in message
    fast = zs.Guarantee("joint_limits", "slew velocity", -0.3, "rad/s", 1.2, "", proven=True)
    others = tuple(found for found in certificate.guarantees if found.name != "joint_limits")
    over = replace(certificate, guarantees=(*others, fast))
    message = failure_message(plan.problem, zs.Status.TIME_BUDGET, over)
    assert message.endswith(
        "The last motion looked at "
        "exceeds the velocity limit of joint 'slew' by 0.3 rad/s at 1.20 s."
    )


def spin(yaw_rate: float, speed: float, *, steps: int = 10) -> zs.Trajectory:
    """Turn over rolling ground at a constant rate for two seconds, the arm at rest."""
    t, still = np.linspace(0.0, 2.0, steps + 1), np.zeros((steps, 2))
    rates = np.tile([speed, yaw_rate], (steps + 1, 1))
    drive = UnicycleMotion.from_start(
        t, np.zeros(3), rates, yaw_rate * t, (still, still), rolling_map(0.0)
    )
    q, v = np.tile(PAPER_START, (steps + 1, 1)), np.zeros((steps + 1, 5))
    return zs.Trajectory(paper_scene().load().joint_names, t, q, v, v[:-1], base=drive)


def test_a_base_that_turns_fast_over_terrain_has_a_margin_or_a_reason_why_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine = paper_scene().load()
    motion = spin(6.0, 5.0)
    found = zs.certify(machine, motion, motion.base.ground)
    assert np.isfinite(found.margin)
    assert found.margin == pytest.approx(found.sampled, abs=0.05)
    assert not found.doubt
    monkeypatch.setattr(position_errors, "STRAY", 1e-9)  # [m] as if its path were known that badly
    found = zs.certify(machine, motion, motion.base.ground)
    assert found.margin == -np.inf
    assert np.isfinite(found.sampled)
    assert not found.safe
    assert "not known to 1 mm where the base drives; give more nodes" in found.doubt


def test_to_ask_for_a_negative_margin_asks_for_no_less_proof_than_to_ask_for_none() -> None:
    """Without a margin this motion stays 0.01 mm inside, and also if less is asked for."""
    scene = paper_scene()
    plan = zs.plan(scene.problem(PAPER_START, PAPER_GOAL))
    assert plan.success, plan.message
    for margin in (0.0, -1e-6, -1.0):
        assert zs.certify(scene.load(), plan.trajectory, scene.ground, margin).safe
