"""`zmp-sqp check` of motions that were not planned here, and what its verdict says."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from zmp_sqp.cli import main
from zmp_sqp.motion.trajectory_csv import write_csv_samples
from zmp_sqp.scenario import load_scenario

START = np.array([0.0, -np.pi / 6, -2 * np.pi / 3, np.pi / 6, -np.pi / 2])
JOINTS = ("slew", "boom", "stick", "tilt", "head")
Capture = pytest.CaptureFixture[str]


def trapezoid(rate: float, *, speed: float = 0.4, gain: float = 0.3) -> tuple[np.ndarray, ...]:
    """The slew turns by a right angle: a trapezoid of rates, sampled; corners between samples."""
    ramp, turn = speed / gain, 0.5 * np.pi
    duration = turn / speed + ramp
    t = np.append(np.arange(0.0, duration, 1.0 / rate), duration)
    up, down = np.minimum(t, ramp), np.maximum(t - (duration - ramp), 0.0)
    v = np.minimum(gain * up, speed) - gain * down
    q = 0.5 * gain * up**2 + speed * np.maximum(t - ramp, 0.0) - 0.5 * gain * down**2
    a = np.where(t < ramp, gain, np.where(t > duration - ramp, -gain, 0.0))
    columns = np.zeros((3, len(t), 5))
    columns[:, :, 0] = q, v, a
    columns[0] += START
    return t, *columns


def write_trapezoid(path: Path, quantities: int, *, start: float = 0.0, **options: Any) -> Path:
    t, *rows = trapezoid(50.0, **options)
    write_csv_samples(path, JOINTS, t + start, rows[:quantities], None)
    return path


def run(*arguments: object, capsys: Capture) -> tuple[int, dict[str, Any]]:
    code = main(["check", *map(str, arguments), "--json", "-"])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(("quantities", "rule"), [(1, "spline"), (2, "cubic"), (3, "quintic")])
def test_a_trapezoid_sampled_at_50_hz_is_certified(
    quantities: int, rule: str, tmp_path: Path, capsys: Capture
) -> None:
    path = write_trapezoid(tmp_path / "user.csv", quantities, start=1234.5)
    code, result = run("feller_buncher", path, capsys=capsys)
    assert (code, result["safe"], result["fault"]) == (0, True, "")
    assert result["motion"]["interpolation"] == rule
    assert result["motion"]["samples"] == len(trapezoid(50.0)[0])
    machine = zs.load_machine("feller_buncher")
    t, q, v, a = trapezoid(2000.0)
    sampled = zs.stability_margin(machine, q, v, a, zs.Slope()).min()
    assert result["margin"] == pytest.approx(sampled, abs=2e-2)
    assert result["duration"] == pytest.approx(t[-1], abs=1e-9)
    assert result["motion"]["departure"]["slew"]["between"] < 1e-3
    slew = next(row for row in result["limits"] if row["limit"] == "velocity")
    assert slew["value"] == pytest.approx(0.4, abs=2e-3)
    assert slew["allowed"] == pytest.approx(np.pi / 4)


def test_straight_lines_are_not_safe_and_no_error(tmp_path: Path, capsys: Capture) -> None:
    path = write_trapezoid(tmp_path / "user.csv", 1)
    code, result = run("feller_buncher", path, "--interpolation", "linear", capsys=capsys)
    assert (code, result["safe"], result["margin"]) == (1, False, None)
    assert "let the rate of joint 'slew' jump by" in result["fault"]
    assert main(["check", "feller_buncher", str(path), "--interpolation", "linear"]) == 1
    assert "Not safe: straight lines" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(("rate", "noise"), [(100.0, 1e-4), (250.0, 1e-4), (50.0, 3e-4)])
def test_a_log_with_noise_is_checked_through_smoothing_splines(
    rate: float, noise: float, tmp_path: Path, capsys: Capture
) -> None:
    t, q, _, _ = trapezoid(rate, speed=0.3, gain=0.2)
    still = np.arange(1.0, 0.5 * rate) / rate  # the log begins before and ends after the motion
    times = np.concatenate([still, t + 0.5, t[-1] + 0.5 + still])
    rest = np.repeat(q[[0, -1]], len(still), axis=0).reshape(2, len(still), 5)
    true = np.concatenate([rest[0], q, rest[1]])
    measured = true + noise * np.random.default_rng(5).normal(size=true.shape)
    path = tmp_path / "log.csv"
    write_csv_samples(path, JOINTS, times, [measured], None)
    code, through = run("feller_buncher", path, capsys=capsys)
    assert code == 1
    (hint,) = (text for text in through["hints"] if "look noisy" in text)
    estimate = float(hint.split("--noise ")[1].split()[0])
    assert 0.6 * noise < estimate < 1.6 * noise
    code, smooth = run("feller_buncher", path, "--noise", noise, capsys=capsys)
    assert (code, smooth["safe"], smooth["fault"]) == (0, True, "")
    assert smooth["motion"]["interpolation"] == "smoothed"
    assert not any("noisy" in text for text in smooth["hints"])
    machine = zs.load_machine("feller_buncher")
    fine = trapezoid(2000.0, speed=0.3, gain=0.2)[1:]
    sampled = zs.stability_margin(machine, *fine, zs.Slope()).min()
    assert smooth["margin"] == pytest.approx(sampled, abs=2e-2)
    assert smooth["motion"]["departure"]["slew"]["position"] < 5.0 * noise
    of_each = zs.read_motion(path, machine, noise=dict.fromkeys(JOINTS, noise)).trajectory
    np.testing.assert_array_equal(
        of_each.positions, zs.read_motion(path, machine, noise=noise).trajectory.positions
    )
    off = np.abs(of_each.positions[len(still) :][: len(t)] - q)
    assert np.sqrt((off**2).mean()) < 0.6 * noise  # nearer to the truth than the samples


@pytest.mark.parametrize(("rate", "noise"), [(100.0, 1e-4), (500.0, 5e-4), (1000.0, 1e-3)])
def test_a_noisy_log_that_is_cut_off_in_motion_does_not_end_at_rest(
    rate: float, noise: float, tmp_path: Path, capsys: Capture
) -> None:
    """Not even if neighbouring samples are as far apart by noise as by the motion."""
    t, q, v, _ = trapezoid(rate, speed=0.3, gain=0.2)
    still = np.arange(1.0, 0.5 * rate) / rate
    cut = t < 0.5 * t[-1]
    assert np.abs(v[cut][-1, 0]) == pytest.approx(0.3, abs=1e-3)
    true = np.concatenate([np.repeat(q[:1], len(still), axis=0), q[cut]])
    measured = true + noise * np.random.default_rng(7).normal(size=true.shape)
    path = tmp_path / "cut.csv"
    write_csv_samples(path, JOINTS, np.append(still, t[cut] + 0.5), [measured], None)
    code, found = run("feller_buncher", path, "--noise", noise, capsys=capsys)
    assert (code, found["safe"]) == (1, False)
    assert "ends in motion" in found["fault"]
    assert "slew turns at 0.3 rad/s" in found["fault"]
    assert "begins in motion" not in found["fault"]


@pytest.mark.parametrize(("beyond", "kept"), [(0.3, True), (3.5, False)])
def test_noise_explains_little_of_what_is_beyond_a_position_limit(
    beyond: float, kept: bool, tmp_path: Path, capsys: Capture
) -> None:
    machine, noise, rate = zs.load_machine("feller_buncher"), 2e-3, 50.0
    top = machine.limits.position_upper[1] + beyond * noise
    t = np.arange(0.0, 9.0, 1.0 / rate)
    s = np.clip((t - 1.5) / 6.0, 0.0, 1.0)
    start = np.array([0.0, -0.3, -2.0, 0.5, -1.5])
    goal = np.array([0.0, top, -2.0, 0.5, -1.5])
    true = start + np.outer(10 * s**3 - 15 * s**4 + 6 * s**5, goal - start)
    measured = true + noise * np.random.default_rng(3).normal(size=true.shape)
    path = tmp_path / "log.csv"
    write_csv_samples(path, JOINTS, t, [measured], None)
    _, found = run("feller_buncher", path, "--noise", noise, capsys=capsys)
    (limit,) = (
        row for row in found["limits"] if row["joint"] == "boom" and "upper" in row["limit"]
    )
    assert limit["kept"] is kept
    main(["check", "feller_buncher", str(path), "--noise", str(noise)])
    said = " ".join(capsys.readouterr().out.split())
    assert "at most 0.004 over position limits" in said


def test_a_gap_in_a_log_is_told_of(tmp_path: Path, capsys: Capture) -> None:
    t, q, _, _ = trapezoid(50.0)
    kept = (t < 1.0) | (t > 1.7)
    path = tmp_path / "gap.csv"
    write_csv_samples(path, JOINTS, t[kept], [q[kept]], None)
    _, found = run("feller_buncher", path, capsys=capsys)
    (hint,) = (text for text in found["hints"] if "no sample" in text)
    assert re.search(r"between (0.98|1.00) and 1.7\d s there is no sample", hint)
    write_csv_samples(path, JOINTS, t, [q], None)
    assert not any(
        "no sample" in text for text in run("feller_buncher", path, capsys=capsys)[1]["hints"]
    )


def test_smoothing_follows_a_motion_without_noise_as_closely_as_it_is_told(tmp_path: Path) -> None:
    t, q, v, _ = trapezoid(200.0)
    write_csv_samples(tmp_path / "log.csv", JOINTS, t, [q], None)
    machine = zs.load_machine("feller_buncher")
    read = zs.read_motion(tmp_path / "log.csv", machine, noise=1e-6)
    assert np.abs(read.trajectory.positions - q).max() < 1e-5
    assert np.abs(read.trajectory.velocities - v).max() < 5e-3


@pytest.mark.parametrize("given", [4e-4, 1e-2, 0.5])
def test_smoothing_that_takes_more_than_noise_is_refused(given: float, tmp_path: Path) -> None:
    """A motion that tips the machine over must not be smoothed into one that does not."""
    t, q, _, _ = trapezoid(100.0)
    measured = q + 1e-4 * np.random.default_rng(1).normal(size=q.shape)
    machine = zs.load_machine("feller_buncher")
    for log in (measured, q):
        write_csv_samples(tmp_path / "log.csv", JOINTS, t, [log], None)
        with pytest.raises(zs.TrajectoryError, match=r"would smooth away what joint '\w+' does"):
            zs.read_motion(tmp_path / "log.csv", machine, noise=given)


@pytest.mark.parametrize(
    ("noise", "complaint"),
    [
        (0.0, "noise must be positive, not 0"),
        (-1e-4, "noise must be positive"),
        (np.nan, "noise"),
        ("much", "noise"),
        ([1e-4, 1e-4], "noise"),
        ({"slew": 1e-4}, "noise"),
    ],
)
def test_a_wrong_noise_is_refused(noise: Any, complaint: str, tmp_path: Path) -> None:
    path = write_trapezoid(tmp_path / "log.csv", 1)
    with pytest.raises(zs.ZmpSqpError, match=complaint):
        zs.read_motion(path, zs.load_machine("feller_buncher"), noise=noise)


def test_noise_and_a_rule_exclude_each_other_and_few_samples_are_refused(tmp_path: Path) -> None:
    machine = zs.load_machine("feller_buncher")
    path = write_trapezoid(tmp_path / "log.csv", 1)
    with pytest.raises(zs.TrajectoryError, match="leave out the interpolation"):
        zs.read_motion(path, machine, noise=1e-4, interpolation="spline")
    t, q, _, _ = trapezoid(1.0)
    write_csv_samples(tmp_path / "few.csv", JOINTS, t[:5], [q[:5]], None)
    with pytest.raises(zs.TrajectoryError, match="at least 8 samples"):
        zs.read_motion(tmp_path / "few.csv", machine, noise=1e-4)


@pytest.mark.parametrize("quantities", [1, 2, 3])
def test_a_truncated_motion_is_not_safe_unless_asked_for(
    quantities: int, tmp_path: Path, capsys: Capture
) -> None:
    t, *rows = trapezoid(50.0)
    write_csv_samples(
        tmp_path / "cut.csv", JOINTS, t[:150], [row[:150] for row in rows][:quantities], None
    )
    code, result = run("feller_buncher", tmp_path / "cut.csv", capsys=capsys)
    assert code == 1
    assert "ends in motion: at 2.98 s slew turns at 0.4 rad/s" in result["fault"]
    assert "--ends-in-motion" in result["fault"]
    code, result = run("feller_buncher", tmp_path / "cut.csv", "--ends-in-motion", capsys=capsys)
    assert (code, result["fault"]) == (0, "")
    assert (
        "ends in motion: at 2.98 s slew turns at 0.4 rad/s, as allowed"
        in result["rests_on"]["motion"]
    )
    late = [row[100:] for row in rows][:quantities]
    write_csv_samples(tmp_path / "late.csv", JOINTS, t[100:], late, None)
    code, result = run("feller_buncher", tmp_path / "late.csv", capsys=capsys)
    assert code == 1
    assert "begins in motion: at 0.00 s slew turns" in result["fault"]
    code, _ = run("feller_buncher", tmp_path / "late.csv", "--starts-in-motion", capsys=capsys)
    assert code == 0


def test_a_plan_of_ours_cut_short_is_not_safe(tmp_path: Path, capsys: Capture) -> None:
    """The file stays exact; only its end is at fault."""
    plan = zs.plan(load_scenario("paper_1").problem)
    plan.trajectory.to_csv(tmp_path / "whole.csv")
    with (tmp_path / "whole.csv").open() as file:
        rows = list(csv.reader(file))
    with (tmp_path / "cut.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows[:40])
    code, whole = run(tmp_path / "whole.csv", "--scenario", "paper_1", capsys=capsys)
    assert (code, whole["motion"]["interpolation"]) == (0, "exact")
    assert whole["margin"] == pytest.approx(plan.certificate.margin, abs=1e-12)
    code, cut = run(tmp_path / "cut.csv", "--scenario", "paper_1", capsys=capsys)
    assert (code, cut["motion"]["interpolation"]) == (1, "exact")
    assert cut["fault"].startswith("the motion ends in motion: ")


def test_a_plan_at_100_hz_and_one_with_six_decimals_are_checked(
    tmp_path: Path, capsys: Capture
) -> None:
    plan = zs.plan(load_scenario("paper_1").problem)
    plan.trajectory.to_csv(tmp_path / "rate.csv", rate=100.0)
    code, result = run(tmp_path / "rate.csv", "--scenario", "paper_1", capsys=capsys)
    # cubics through samples exceed limits that the plan rides, where it switches between samples
    assert code == 1
    assert "exceeds the acceleration limit of joint 'slew' by" in result["fault"]
    assert any("--limit-tolerance" in hint for hint in result["hints"])
    code, allowed = run(
        tmp_path / "rate.csv", "--scenario", "paper_1", "--limit-tolerance", "0.3", capsys=capsys
    )
    assert allowed["limits_ok"]
    assert allowed["margin"] == result["margin"] == pytest.approx(plan.margin, abs=0.01)
    plan.trajectory.to_csv(tmp_path / "full.csv")
    with (tmp_path / "full.csv").open() as file:
        header, *rows = list(csv.reader(file))
    with (tmp_path / "six.csv").open("w", newline="") as file:
        csv.writer(file).writerows([header, *([f"{float(x):.6f}" for x in row] for row in rows)])
    code, six = run(tmp_path / "six.csv", "--scenario", "paper_1", capsys=capsys)
    assert six["limits_ok"]
    assert six["margin"] == pytest.approx(plan.margin, abs=2e-4)
    slew = next(row for row in six["limits"] if row["limit"] == "acceleration")
    assert 0.0 < slew["excess"] < slew["allowance"] < 0.01 * slew["allowed"]


def test_a_limit_that_is_not_kept_is_named_with_value_time_and_unit(
    tmp_path: Path, capsys: Capture
) -> None:
    path = write_trapezoid(tmp_path / "fast.csv", 2, speed=1.35, gain=1.5)
    code, result = run("feller_buncher", path, capsys=capsys)
    assert code == 1
    assert (
        "exceeds the velocity limit of joint 'slew' by 0.564 rad/s at" in result["fault"]
        or "exceeds the velocity limit of joint 'slew' by 0.565 rad/s at" in result["fault"]
    )
    assert "(1.35 where 0.785 is allowed)" in result["fault"]
    row = next(row for row in result["limits"] if not row["kept"] and row["limit"] == "velocity")
    assert (row["joint"], row["unit"]) == ("slew", "rad/s")
    assert row["excess"] == pytest.approx(1.35 - np.pi / 4, abs=1e-3)
    assert 0.8 < row["time"] < 1.3
    assert len(result["limits"]) == 4 * len(JOINTS)


def test_the_verdict_says_what_it_rests_on(tmp_path: Path, capsys: Capture) -> None:
    path = write_trapezoid(tmp_path / "user.csv", 2)
    _, bare = run("feller_buncher", path, capsys=capsys)
    assert bare["rests_on"]["ground"] == "level"
    assert bare["rests_on"]["payload"] == "none"
    assert bare["rests_on"]["motion"][0].startswith("cubics through positions and velocities")
    _, scene = run(path, "--scenario", "paper_1", "--margin", "0.05", capsys=capsys)
    assert scene["rests_on"]["ground"].startswith("slope with a roll of -20")
    assert scene["rests_on"]["payload"].startswith("4,000 kg")
    assert scene["required"] == scene["rests_on"]["margin"] == 0.05
    main(["check", "feller_buncher", str(path)])
    text = " ".join(capsys.readouterr().out.split())
    assert "The verdict rests on" in text
    assert "payload none" in text
    assert "ground level" in text


def test_a_scenario_gives_what_options_give(tmp_path: Path, capsys: Capture) -> None:
    path = write_trapezoid(tmp_path / "user.csv", 2)
    tree = ["--payload", "4000", "--payload-frame", "head", "--payload-com", "0", "0", "3.323"]
    options = [*tree, "--point-masses", "--roll", "-20"]
    _, given = run("feller_buncher", path, *options, capsys=capsys)
    for order in ((path, "--scenario", "paper_1"), ("--scenario", "paper_1", path)):
        _, scene = run(*order, capsys=capsys)
        for key in ("margin", "fault", "guarantees", "limits", "load_transfer_ratio"):
            assert scene[key] == given[key]
    for extra, message in (
        (["--roll", "3"], "leave out --roll"),
        (["--payload", "3"], "leave out --payload"),
        (["--base-limits", "1", "1", "1", "1"], "leave out --base-limits"),
    ):
        assert main(["check", str(path), "--scenario", "paper_1", *extra]) == 2
        assert message in capsys.readouterr().err
    assert main(["check", "feller_buncher", str(path), "--scenario", "paper_1"]) == 2
    assert "leave out URDF" in capsys.readouterr().err
    assert main(["check", str(path), "--scenario", "torque", "--json", "-"]) in (0, 1)
    names = [row["name"] for row in json.loads(capsys.readouterr().out)["guarantees"]]
    assert "torque_limits" in names


def test_a_scenarios_own_goal_in_motion_is_allowed(tmp_path: Path, capsys: Capture) -> None:
    scenario = tmp_path / "moving.toml"
    q = ", ".join(f"{x!r}" for x in START.tolist())
    scenario.write_text(
        f'[machine]\nname = "feller_buncher"\n[motion]\nstart = [{q}]\n'
        f"goal = [0.5, {q.split(', ', 1)[1]}]\ngoal_velocity = [0.3, 0, 0, 0, 0]\n"
    )
    plan = zs.plan(load_scenario(scenario).problem)
    plan.trajectory.to_csv(tmp_path / "motion.csv")
    code, result = run(tmp_path / "motion.csv", "--scenario", scenario, capsys=capsys)
    assert (code, result["fault"]) == (0, "")
    assert any(line.startswith("ends in motion") for line in result["rests_on"]["motion"])


def test_a_drive_is_checked_with_its_scenario(tmp_path: Path, capsys: Capture) -> None:
    plan = zs.plan(load_scenario("retreat").problem)
    plan.trajectory.to_csv(tmp_path / "drive.csv")
    code, result = run(tmp_path / "drive.csv", "--scenario", "retreat", capsys=capsys)
    assert code == 0
    assert result["margin"] == pytest.approx(plan.certificate.margin, abs=1e-9)
    assert result["gap"] == pytest.approx(plan.certificate.gap, abs=1e-9)
    short = plan.trajectory.after(0.5)
    short.to_csv(tmp_path / "rest.csv")
    code, result = run(tmp_path / "rest.csv", "--scenario", "retreat", capsys=capsys)
    assert code == 1
    assert "begins" in result["fault"]


@pytest.mark.parametrize("wrong", ["degrees", "milliseconds", "velocities"])
def test_units_that_look_wrong_are_named(wrong: str, tmp_path: Path, capsys: Capture) -> None:
    t, q, v, _ = trapezoid(50.0)
    rows = {
        "degrees": (t, [np.degrees(q), np.degrees(v)]),
        "milliseconds": (1e3 * t, [q]),
        "velocities": (t, [q, np.degrees(60.0 * v)]),
    }[wrong]
    write_csv_samples(tmp_path / "user.csv", JOINTS, rows[0], rows[1], None)
    _, result = run("feller_buncher", tmp_path / "user.csv", capsys=capsys)
    words = {"degrees": "--degrees", "milliseconds": "'time [ms]'", "velocities": "same units"}
    assert any(words[wrong] in hint for hint in result["hints"])
    if wrong == "degrees":
        assert result["safe"] is False
        code, result = run("feller_buncher", tmp_path / "user.csv", "--degrees", capsys=capsys)
        assert (code, result["hints"]) == (0, [])


@pytest.mark.parametrize("suffix", ["csv", "npz", "json", "yaml", "mcap"])
def test_exports_of_plan_are_checked_by_their_ending(
    suffix: str, tmp_path: Path, capsys: Capture
) -> None:
    if suffix == "mcap":
        pytest.importorskip("rosbags")
    path = tmp_path / "new" / f"motion.{suffix}"
    command = ["plan", "paper_1", "--margin", "0.1", "--export", str(path), "--json", "-"]
    assert main(command) == 0
    captured = capsys.readouterr()
    plan = json.loads(captured.out)
    assert f"motion.{suffix}" in captured.err
    assert ("cubic" in captured.err) == (suffix in ("json", "yaml", "mcap"))
    code, result = run(path, "--scenario", "paper_1", "--margin", "0.1", capsys=capsys)
    assert (code, result["fault"]) == (0, "")
    assert result["margin"] >= 0.1
    assert result["duration"] == pytest.approx(plan["duration"], abs=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["plan", "paper_1", "--export", "a.txt"], "ends in .csv, .npz"),
        (["plan", "retreat", "--export", "a.yaml"], "no place for a base"),
        (["check", "feller_buncher", "a.txt"], "ends in .csv, .npz"),
        (["check", "feller_buncher", "a.csv", "--scenario", "paper_1"], "leave out URDF"),
        (["check", "a.csv", "--scenario", "nowhere.toml"], "no such scenario"),
    ],
)
def test_bad_files_and_options_get_one_sentence(
    arguments: list[str], message: str, capsys: Capture
) -> None:
    assert main(arguments) == 2
    complaint = capsys.readouterr().err
    assert message in complaint
    assert complaint.count("\n") == 1


def test_a_tolerance_out_of_range_is_refused(tmp_path: Path, capsys: Capture) -> None:
    path = write_trapezoid(tmp_path / "user.csv", 2)
    for value in ("-0.1", "2", "nan"):
        assert main(["check", "feller_buncher", str(path), "--limit-tolerance", value]) == 2
        assert "--limit-tolerance" in capsys.readouterr().err


@pytest.mark.parametrize("rule", ["spline", "linear", "cubic", "quintic", None])
def test_numbers_beyond_all_reason_are_refused_or_unsafe(
    rule: str | None, tmp_path: Path, capsys: Capture
) -> None:
    rng = np.random.default_rng(3)
    options = [] if rule is None else ["--interpolation", rule]
    path = tmp_path / "user.csv"
    for step, size, rate in ((1e-300, 1.0, 1.0), (1e300, 1e-9, 0.0), (1.0, 1e300, 1e200)):
        t, q = np.arange(3) * step, START + size * rng.normal(size=(3, 5))
        v = rate * rng.normal(size=(3, 5))
        write_csv_samples(path, JOINTS, t, [q, v, v], None)
        code = main(["check", "feller_buncher", str(path), *options, "--json", "-"])
        captured = capsys.readouterr()
        assert code in (1, 2)
        if code == 2:
            assert captured.err.count("\n") == 1
            assert str(path) in captured.err
        else:
            assert json.loads(captured.out)["safe"] is False
