"""The walk of a first user with an excavator: plan, tail, re-plan, files of his own, faults."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from zmp_sqp.cli import main
from zmp_sqp.motion.trajectory_csv import write_csv_samples
from zmp_sqp.scenario import load_scenario

SCENARIO = "excavator_swing"
Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def plan() -> zs.Plan:
    found = zs.plan(load_scenario(SCENARIO).problem)
    assert found.success
    return found


def checked(path: Path, *options: str, capsys: Capture) -> tuple[int, dict[str, Any]]:
    code = main(["check", str(path), "--scenario", SCENARIO, *options, "--json", "-"])
    return code, json.loads(capsys.readouterr().out)


def test_the_plan_and_its_tail_are_certified(plan: zs.Plan) -> None:
    problem, motion = plan.problem, plan.trajectory
    rest = motion.after(0.5 * motion.duration)
    found = zs.certify(
        problem.machine, rest, problem.ground, problem.margin, constraints=problem.constraints
    )
    assert found.safe
    assert found.margin >= plan.certificate.margin - 1e-6


def test_a_new_plan_from_half_way_is_no_slower_than_the_rest(plan: zs.Plan) -> None:
    motion = plan.trajectory
    q, v, _ = motion(0.5 * motion.duration)
    again = zs.plan(replace(plan.problem, start=q, start_velocity=v))
    assert again.success
    assert again.duration <= 1.01 * motion.after(0.5 * motion.duration).duration


def test_its_files_are_checked(plan: zs.Plan, tmp_path: Path, capsys: Capture) -> None:
    for suffix in ("csv", "npz", "yaml", "json"):
        zs.export_motion(plan.trajectory, tmp_path / f"motion.{suffix}")
        code, result = checked(tmp_path / f"motion.{suffix}", capsys=capsys)
        assert (code, result["fault"]) == (0, "")
        assert result["margin"] == pytest.approx(plan.certificate.margin, abs=1e-5)


def test_at_100_hz_it_is_close_to_the_plan_and_every_excess_is_named(
    plan: zs.Plan, tmp_path: Path, capsys: Capture
) -> None:
    plan.trajectory.to_csv(tmp_path / "rate.csv", rate=100.0)
    code, result = checked(tmp_path / "rate.csv", capsys=capsys)
    assert result["margin"] == pytest.approx(plan.certificate.margin, abs=0.02)
    assert code == (0 if result["safe"] else 1)
    assert result["safe"] or result["fault"]
    for row in result["limits"]:
        if not row["kept"]:
            assert f"the {row['limit']} limit of joint {row['joint']!r}" in result["fault"]


def test_a_trapezoid_of_the_users_own_is_safe(
    plan: zs.Plan, tmp_path: Path, capsys: Capture
) -> None:
    machine, start = plan.problem.machine, plan.problem.start
    slow = machine.with_limits(
        velocity=0.3 * machine.limits.velocity, acceleration=0.2 * machine.limits.acceleration
    )
    motion = zs.phase_plane(slow, start, plan.problem.goal)
    t, q, v, _ = motion.sampled(50.0)
    for name, rows in (("positions", [q]), ("velocities", [q, v])):
        path = tmp_path / f"{name}.csv"
        write_csv_samples(path, machine.joint_names, t, rows, None)
        code, result = checked(path, "--margin", "0", capsys=capsys)
        assert (code, result["fault"]) == (0, "")


def test_truncated_it_is_unsafe(plan: zs.Plan, tmp_path: Path, capsys: Capture) -> None:
    plan.trajectory.to_csv(tmp_path / "whole.csv")
    with (tmp_path / "whole.csv").open() as file:
        rows = list(csv.reader(file))
    with (tmp_path / "cut.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows[: len(rows) // 2])
    code, result = checked(tmp_path / "cut.csv", capsys=capsys)
    assert code == 1
    assert "ends in motion: at " in result["fault"]
    assert "--ends-in-motion" in result["fault"]


def test_in_degrees_or_at_another_pace_it_is_noticed(
    plan: zs.Plan, tmp_path: Path, capsys: Capture
) -> None:
    names = plan.problem.machine.joint_names
    t, q, v, _ = plan.trajectory.sampled(50.0)
    write_csv_samples(tmp_path / "degrees.csv", names, t, [np.degrees(q)], None)
    code, result = checked(tmp_path / "degrees.csv", capsys=capsys)
    assert code == 1
    assert any("--degrees" in hint for hint in result["hints"])
    write_csv_samples(tmp_path / "ms.csv", names, 1e3 * t, [q, v], None)
    _, result = checked(tmp_path / "ms.csv", capsys=capsys)
    assert any("same units" in hint for hint in result["hints"])
    write_csv_samples(tmp_path / "fast.csv", names, 0.5 * t, [q, 2.0 * v], None)
    code, result = checked(tmp_path / "fast.csv", capsys=capsys)
    assert code == 1
    assert "limit of joint" in result["fault"]
