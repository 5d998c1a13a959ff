"""Ways in which a motion was once called safe although it was not what was asked for."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
from tests.planning.driving import base, retreat
from tests.problems import PAPER_GOAL, PAPER_START, paper_scene

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
def test_a_machine_that_stands_on_ground_its_tracks_cannot_follow_is_refused(x: float, y: float, width: float) -> None:
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
        assert np.isfinite(zs.trajectory_zmp(machine, plan.trajectory, plan.duration / 2, ground)).all()
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
    found = zs.certify(machine, zs.phase_plane(machine, PAPER_START, PAPER_GOAL), paper_scene().ground, margin=-5.0)
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
        plan = zs.plan(zs.Problem(machine, PAPER_START, PAPER_START, base=base(goal=goal), intervals=20))
        if plan.success:
            assert np.abs(plan.trajectory.base(plan.duration)[0] - goal).max() <= 1e-5
