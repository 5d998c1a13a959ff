"""Motions of any origin: formats, columns, units, rules, and errors that name file and row."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import zmp_sqp as zs
from zmp_sqp.motion.interpolation import spline_rates
from zmp_sqp.motion.sample_tables import rounding_of
from zmp_sqp.motion.trajectory_csv import write_csv_samples
from zmp_sqp.scenario import load_scenario

MACHINE = zs.load_machine("feller_buncher")
JOINTS = MACHINE.joint_names
START = np.array([0.0, -np.pi / 6, -2 * np.pi / 3, np.pi / 6, -np.pi / 2])
GOAL = START + np.array([1.0, 0.2, 0.1, 0.0, -0.3])
BLIND = zs.phase_plane(MACHINE, START, GOAL)
STATES = ("times", "positions", "velocities", "accelerations", "jerks")


def same_bits(one: zs.Trajectory, other: zs.Trajectory) -> bool:
    return all(getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in STATES)


def smooth(count: int = 40, *, duration: float = 4.0) -> tuple[np.ndarray, ...]:
    """Rest to rest by a cosine, with exact derivatives."""
    t = np.linspace(0.0, duration, count)
    w, size = np.pi / duration, GOAL - START
    q = START + 0.5 * size * (1.0 - np.cos(w * t))[:, None]
    v = 0.5 * size * (w * np.sin(w * t))[:, None]
    v[[0, -1]] = 0.0
    return t, q, v, 0.5 * size * (w**2 * np.cos(w * t))[:, None]


def write_table(path: Path, header: list[str], table: np.ndarray, *, separator: str = ",") -> Path:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, delimiter=separator)
        writer.writerow(header)
        writer.writerows([[repr(float(entry)) for entry in row] for row in table])
    return path


def sampled_file(path: Path, *, quantities: int = 2) -> Path:
    t, *rows = smooth()
    write_csv_samples(path, JOINTS, t, rows[:quantities], None)
    return path


# --- files of ours are exact --------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_an_export_that_holds_all_is_read_bit_by_bit(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"motion.{suffix}"
    assert zs.export_motion(BLIND, path) == "exact"
    read = zs.read_motion(path, MACHINE)
    assert read.rule == "exact"
    assert read.departure is None
    assert same_bits(read.trajectory, BLIND)


def test_to_json_is_read_bit_by_bit_in_spite_of_its_accelerations(tmp_path: Path) -> None:
    BLIND.to_json(tmp_path / "motion.json")
    read = zs.read_motion(tmp_path / "motion.json", MACHINE)
    assert (read.rule, same_bits(read.trajectory, BLIND)) == ("exact", True)
    played = zs.read_motion(tmp_path / "motion.json", MACHINE, interpolation="quintic")
    assert played.rule == "quintic"
    assert played.trajectory.snaps is not None


def test_motions_of_quintics_are_written_and_read_bit_by_bit(tmp_path: Path) -> None:
    read = zs.read_motion(sampled_file(tmp_path / "samples.csv", quantities=3), MACHINE)
    quintic = read.trajectory
    assert read.rule == "quintic"
    for name in ("motion.csv", "motion.npz"):
        zs.export_motion(quintic, tmp_path / name)
        again = zs.read_motion(tmp_path / name, MACHINE)
        assert again.rule == "exact"
        assert same_bits(again.trajectory, quintic)
        assert again.trajectory.snaps.tobytes() == quintic.snaps.tobytes()
    assert same_bits(zs.Trajectory.from_csv(tmp_path / "motion.csv", MACHINE), quintic)
    quintic.to_json(tmp_path / "motion.json")
    assert same_bits(zs.Trajectory.from_json(tmp_path / "motion.json", MACHINE), quintic)
    assert zs.export_motion(quintic, tmp_path / "ros.yaml") == "quintic"
    ros = zs.read_motion(tmp_path / "ros.yaml", MACHINE)
    t = np.linspace(0.0, 4.0, 333)
    np.testing.assert_allclose(ros.trajectory(t)[0], quintic(t)[0], atol=1e-10)


def test_a_drive_goes_through_csv_npz_and_json_and_no_message_has_a_place_for_it(
    tmp_path: Path,
) -> None:
    plan = zs.plan(load_scenario("retreat").problem)
    machine = plan.problem.machine
    for name in ("motion.csv", "motion.npz"):
        zs.export_motion(plan.trajectory, tmp_path / name)
        read = zs.read_motion(tmp_path / name, machine).trajectory
        assert same_bits(read, plan.trajectory)
        np.testing.assert_array_equal(read.base.poses, plan.trajectory.base.poses)
    plan.trajectory.to_json(tmp_path / "motion.json")
    assert same_bits(zs.read_motion(tmp_path / "motion.json", machine).trajectory, plan.trajectory)
    for suffix in ("yaml", "json", "mcap"):
        with pytest.raises(zs.TrajectoryError, match="no place for a base"):
            zs.export_motion(plan.trajectory, tmp_path / f"ros.{suffix}")
    with pytest.raises(zs.TrajectoryError, match="leave out the interpolation"):
        zs.read_motion(tmp_path / "motion.csv", machine, interpolation="cubic")
    plan.trajectory.to_csv(tmp_path / "rate.csv", rate=20.0)
    with pytest.raises(zs.TrajectoryError, match="base"):
        zs.read_motion(tmp_path / "rate.csv", machine)


# --- ROS ----------------------------------------------------------------------------------------


def test_yaml_and_json_are_messages_without_accelerations(tmp_path: Path) -> None:
    for suffix in ("yaml", "json"):
        zs.export_motion(BLIND, tmp_path / f"motion.{suffix}")
    text = (tmp_path / "motion.yaml").read_text()
    assert "made for cubic interpolation" in text
    message = yaml.safe_load(text)
    other = json.loads((tmp_path / "motion.json").read_text())
    assert other.pop("interpolation") == "cubic"
    assert message == other
    assert set(message) == {"header", "joint_names", "points"}
    assert message["joint_names"] == list(JOINTS)
    for point in message["points"]:
        assert set(point) == {"positions", "velocities", "time_from_start"}
        assert 0 <= point["time_from_start"]["nanosec"] < 10**9


def test_a_bag_is_read_back_by_its_own_reader_with_types_checked(tmp_path: Path) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel")
    path = tmp_path / "motion.mcap"
    assert zs.export_motion(BLIND, path) == "cubic"
    zs.export_motion(BLIND, path)  # replaces it
    with highlevel.AnyReader([path]) as reader:
        (connection,) = reader.connections
        assert connection.topic == "/joint_trajectory_controller/joint_trajectory"
        assert connection.msgtype == "trajectory_msgs/msg/JointTrajectory"
        ((_, _, data),) = reader.messages()
        message = reader.deserialize(data, connection.msgtype)
    assert message.joint_names == list(JOINTS)
    assert len(message.points) == len(BLIND.times)
    for point in message.points:
        assert point.positions.dtype == point.velocities.dtype == np.float64
        assert point.positions.shape == point.velocities.shape == (5,)
        assert point.accelerations.size == point.effort.size == 0
        assert isinstance(point.time_from_start.sec, int)
        assert isinstance(point.time_from_start.nanosec, int)
    np.testing.assert_allclose(message.points[-1].positions, GOAL, atol=1e-12)


def test_a_file_that_is_no_bag_is_refused_in_one_sentence(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    for content in (b"", b"\x89MCAP0\r\n", b"\x00" * 200, b"time,slew\n0,1\n"):
        (tmp_path / "no.mcap").write_bytes(content)
        with pytest.raises(zs.TrajectoryError, match=r"no\.mcap"):
            zs.read_motion(tmp_path / "no.mcap", MACHINE)


def test_messages_of_others_are_read(tmp_path: Path) -> None:
    """Other order of joints, one more joint, empty fields, a message within a message."""
    t, q, v, _ = smooth(10)
    names = ["gripper", *reversed(JOINTS)]
    points = [
        {
            "positions": [0.5, *reversed(q[k].tolist())],
            "velocities": [0.0, *reversed(v[k].tolist())],
            "accelerations": [],
            "effort": [],
            "time_from_start": {"sec": int(t[k]), "nanosec": round((t[k] % 1.0) * 1e9)},
        }
        for k in range(10)
    ]
    content = {"joint_trajectory": {"joint_names": names, "points": points}}
    (tmp_path / "moveit.json").write_text(json.dumps(content))
    (tmp_path / "moveit.yaml").write_text(yaml.safe_dump(content) + "---\nnothing: more\n")
    for name in ("moveit.json", "moveit.yaml"):
        read = zs.read_motion(tmp_path / name, MACHINE)
        assert read.rule == "cubic"
        assert read.samples.ignored == ("gripper",)
        np.testing.assert_allclose(read.trajectory.positions, q, atol=1e-15)


# --- tables of others ---------------------------------------------------------------------------


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_columns_may_be_named_and_ordered_as_loggers_do(separator: str, tmp_path: Path) -> None:
    t, q, v, _ = smooth()
    header = ["engine_rpm", *(f"vel_{joint}" for joint in reversed(JOINTS)), "t"]
    header += [*JOINTS[:2], *(f"{joint}/pos" for joint in JOINTS[2:])]
    table = np.column_stack([0.0 * t + 1800.0, v[:, ::-1], t + 37.5, q])
    read = zs.read_motion(
        write_table(tmp_path / "log.csv", header, table, separator=separator), MACHINE
    )
    assert read.rule == "cubic"
    assert read.samples.ignored == ("engine_rpm",)
    np.testing.assert_array_equal(read.trajectory.positions, q)
    np.testing.assert_array_equal(read.trajectory.velocities, v)
    np.testing.assert_allclose(read.trajectory.times, t, atol=1e-12)


def test_units_beside_columns_and_degrees_are_converted(tmp_path: Path) -> None:
    t, q, v, _ = smooth()
    header = ["time [ms]", *(f"{joint}.position [deg]" for joint in JOINTS)]
    header += [f"{joint}.velocity (deg/s)" for joint in JOINTS]
    table = np.column_stack([1e3 * t, np.degrees(q), np.degrees(v)])
    path = write_table(tmp_path / "log.csv", header, table)
    read = zs.read_motion(path, MACHINE).trajectory
    np.testing.assert_allclose(read.positions, q, atol=1e-14)
    np.testing.assert_allclose(read.velocities, v, atol=1e-14)
    np.testing.assert_allclose(read.times, t, atol=1e-12)
    with pytest.raises(zs.TrajectoryError, match="its header gives units already"):
        zs.read_motion(path, MACHINE, degrees=True)
    bare = [name.split(" ")[0] for name in header]
    table[:, 0] = t
    path = write_table(tmp_path / "bare.csv", bare, table)
    read = zs.read_motion(path, MACHINE, degrees=True).trajectory
    np.testing.assert_allclose(read.positions, q, atol=1e-14)


def test_units_of_a_base_are_converted_too(tmp_path: Path) -> None:
    problem = load_scenario("retreat").problem
    machine, plan = problem.machine, zs.plan(problem)
    zs.export_motion(plan.trajectory, tmp_path / "motion.csv")
    header, *rows = (line.split(",") for line in (tmp_path / "motion.csv").read_text().splitlines())
    table = np.array(rows, dtype=float)
    angles = [i for i, name in enumerate(header) if (i and "base." not in name) or "yaw" in name]
    table[:, angles] = np.degrees(table[:, angles])
    degrees = write_table(tmp_path / "degrees.csv", header, table)
    lengths = [i for i, name in enumerate(header) if "base." in name and "yaw" not in name]
    named = list(header)
    for i in angles:
        named[i] += " [deg]"
    for i in lengths:
        named[i] += " [mm]"
    table[:, lengths] *= 1e3
    units = write_table(tmp_path / "units.csv", named, table)
    for read in (zs.read_motion(degrees, machine, degrees=True), zs.read_motion(units, machine)):
        base = read.trajectory.base
        assert base is not None
        np.testing.assert_allclose(base.poses, plan.trajectory.base.poses, atol=1e-9)
        np.testing.assert_allclose(base.velocities, plan.trajectory.base.velocities, atol=1e-9)
    with pytest.raises(zs.TrajectoryError, match="gives units already"):
        zs.read_motion(units, machine, degrees=True)
    named[header.index("base.yaw")] = "base.yaw [mm]"
    with pytest.raises(zs.TrajectoryError, match=r"'base.yaw \[mm\]' must be in rad or deg"):
        zs.read_motion(write_table(tmp_path / "wrong.csv", named, table), machine)


def test_a_joint_that_slides_has_no_degrees(tmp_path: Path) -> None:
    slider = zs.load_machine("slider")
    for unit in ("deg", "rad"):
        path = write_table(
            tmp_path / f"{unit}.csv", ["time", f"{slider.joint_names[0]} [{unit}]"], np.eye(2)[::-1]
        )
        with pytest.raises(zs.TrajectoryError, match="must be in m or mm"):
            zs.read_motion(path, slider)


def test_degrees_leave_joints_that_slide_alone(tmp_path: Path) -> None:
    slider = zs.load_machine("slider")
    (name,) = slider.joint_names
    t = np.linspace(0.0, 2.0, 9)
    path = write_table(tmp_path / "a.csv", ["time", name], np.column_stack([t, 0.1 * t**2]))
    read = zs.read_motion(path, slider, degrees=True, interpolation="spline").trajectory
    np.testing.assert_allclose(read.positions[:, 0], 0.1 * t**2, atol=1e-15)


# --- rules --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("quantities", "rule"), [(1, "spline"), (2, "cubic"), (3, "quintic")])
def test_the_rule_follows_from_the_columns(quantities: int, rule: str, tmp_path: Path) -> None:
    read = zs.read_motion(sampled_file(tmp_path / "a.csv", quantities=quantities), MACHINE)
    t, q, v, a = smooth()
    assert read.rule == rule
    np.testing.assert_allclose(read.trajectory.positions, q, atol=1e-15)
    fine = np.linspace(0.0, t[-1], 1001)
    size, w = GOAL - START, np.pi / 4.0
    exact = START + 0.5 * size * (1.0 - np.cos(w * fine))[:, None]
    # errors of cubics grow with h^4, of quintics with h^6
    np.testing.assert_allclose(
        read.trajectory(fine)[0], exact, atol=[0, 2e-5, 2e-6, 1e-9][quantities]
    )
    assert read.departure is not None
    assert set(read.departure.at_samples) == {"position", "velocity", "acceleration"} & set(
        ("position", "velocity", "acceleration")[:quantities]
    )
    lines = np.array([np.interp(fine, t, column) for column in q.T]).T
    off = np.abs(read.trajectory(fine)[0] - lines).max(axis=0)
    assert (off <= read.departure.between + 1e-12).all()
    assert (read.departure.between <= 1.3 * off + 1e-9).all()
    assert np.isfinite(v).all()
    assert np.isfinite(a).all()


def test_departures_are_what_they_say(tmp_path: Path) -> None:
    path = sampled_file(tmp_path / "a.csv", quantities=3)
    _, _, v, a = smooth()
    read = zs.read_motion(path, MACHINE, interpolation="spline")
    off = read.departure.at_samples
    np.testing.assert_allclose(
        off["velocity"], np.abs(read.trajectory.velocities - v).max(axis=0), atol=1e-15
    )
    start, end = read.trajectory.node_rows()[2], read.trajectory.end_accelerations
    expected = np.maximum(np.abs(start - a).max(axis=0), np.abs(end - a[1:]).max(axis=0))
    np.testing.assert_allclose(off["acceleration"], expected, atol=1e-15)
    assert off["velocity"].max() > 1e-9


def test_straight_lines_have_no_bound_unless_they_are_one(tmp_path: Path) -> None:
    path = sampled_file(tmp_path / "a.csv", quantities=1)
    with pytest.raises(zs.UnboundedAcceleration, match=r"'slew' jump by .* rad/s at .*row \d+"):
        zs.read_motion(path, MACHINE, interpolation="linear")
    t = np.linspace(0.0, 1.0, 5)
    even = write_table(
        tmp_path / "b.csv", ["time", *JOINTS], np.column_stack([t, START + 0.1 * t[:, None]])
    )
    read = zs.read_motion(even, MACHINE, interpolation="linear")
    np.testing.assert_allclose(read.trajectory.velocities, 0.1, atol=1e-14)
    assert not read.trajectory.accelerations.any()


def test_a_spline_rests_at_its_ends_where_the_joints_can_and_only_there() -> None:
    t, q, v, _ = smooth(81)
    limit = np.full(5, 0.5)
    rates = spline_rates(t, q, limit)
    assert not rates[[0, -1]].any()
    np.testing.assert_allclose(rates, v, atol=2e-5)
    cut = spline_rates(t[:41], q[:41], limit)
    np.testing.assert_allclose(cut[-1], v[40], atol=1e-4)  # in the middle of the motion
    assert abs(cut[-1, 0]) > 0.3
    unknown = spline_rates(t, q, np.full(5, np.nan))
    np.testing.assert_allclose(unknown[[0, -1]], 0.0, atol=1e-3)


def test_a_rule_needs_its_quantities_and_a_file_a_known_ending(tmp_path: Path) -> None:
    path = sampled_file(tmp_path / "a.csv", quantities=1)
    with pytest.raises(
        zs.TrajectoryError, match=r"cubic interpolation needs the velocity .* spline"
    ):
        zs.read_motion(path, MACHINE, interpolation="cubic")
    with pytest.raises(zs.TrajectoryError, match="must be one of linear, spline"):
        zs.read_motion(path, MACHINE, interpolation="septic")
    with pytest.raises(zs.TrajectoryError, match=r"ends in \.csv, \.npz"):
        zs.read_motion(tmp_path / "a.txt", MACHINE)
    with pytest.raises(zs.TrajectoryError, match=r"ends in \.csv, \.npz"):
        zs.export_motion(BLIND, tmp_path / "a.txt")


def test_rounded_files_of_ours_are_played_as_cubics(tmp_path: Path) -> None:
    BLIND.to_csv(tmp_path / "full.csv")
    with (tmp_path / "full.csv").open() as file:
        header, *rows = list(csv.reader(file))
    rounded = np.array([[round(float(entry), 6) for entry in row] for row in rows])
    read = zs.read_motion(write_table(tmp_path / "r.csv", header, rounded), MACHINE)
    assert read.rule == "cubic"
    assert read.samples.error_of("position") == 5e-7
    t = np.linspace(0.0, min(read.trajectory.duration, BLIND.duration), 100)
    np.testing.assert_allclose(read.trajectory(t)[0], BLIND(t)[0], atol=2e-6)


@pytest.mark.parametrize("decimals", [3, 6, 9, 12])
def test_digits_tell_the_rounding_error(decimals: int) -> None:
    values = np.random.default_rng(decimals).uniform(-3.0, 3.0, 200)
    assert rounding_of(np.round(values, decimals)) == pytest.approx(0.5 * 10.0**-decimals)
    assert rounding_of(values) < 1e-15
    assert rounding_of(values.astype(np.float32).astype(float)) == pytest.approx(1.8e-7, rel=0.1)
    assert rounding_of(np.array([0.5, 1.0])) < 1e-15


# --- sampled and after --------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [100.0, 7.3, 1.0 / 0.3])
def test_samples_are_at_a_fixed_rate_and_at_the_end(rate: float) -> None:
    t, q, v, a = BLIND.sampled(rate)
    np.testing.assert_allclose(np.diff(t)[:-1], 1.0 / rate, atol=1e-12)
    assert 0.0 < np.diff(t)[-1] <= 1.0 / rate + 1e-12
    assert (t[0], t[-1]) == (0.0, BLIND.duration)
    for found, expected in zip((q, v, a), BLIND(t), strict=True):
        np.testing.assert_array_equal(found, expected)
    for bad in (0.0, -1.0, np.nan, 1e12):
        with pytest.raises(zs.TrajectoryError, match="rate must be"):
            BLIND.sampled(bad)


def test_a_file_at_a_rate_is_close_to_the_motion(tmp_path: Path) -> None:
    BLIND.to_csv(tmp_path / "a.csv", rate=100)
    read = zs.read_motion(tmp_path / "a.csv", MACHINE)
    assert read.rule == "cubic"
    t = np.linspace(0.0, BLIND.duration, 777)
    np.testing.assert_allclose(read.trajectory(t)[0], BLIND(t)[0], atol=1e-5)


@pytest.mark.parametrize("curved", [False, True])
def test_the_rest_of_a_motion_is_the_motion_later(curved: bool, tmp_path: Path) -> None:
    motion = BLIND
    if curved:
        path = sampled_file(tmp_path / "a.csv", quantities=3)
        motion = zs.read_motion(path, MACHINE).trajectory
    whole = zs.certify(MACHINE, motion, zs.Slope())
    for t in (0.0, 0.3, float(motion.times[2]), 0.9 * motion.duration, motion.duration):
        rest = motion.after(t)
        assert rest.duration == pytest.approx(motion.duration - t, abs=1e-12)
        times = np.linspace(0.0, rest.duration, 50)
        later = np.minimum(t + times, motion.duration)
        for found, expected in zip(rest(times)[:2], motion(later)[:2], strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-12)
        assert zs.certify(MACHINE, rest, zs.Slope()).margin >= whole.margin - 1e-6
    for name in STATES:
        np.testing.assert_array_equal(getattr(motion.after(0.0), name), getattr(motion, name))
    for bad in (-0.1, motion.duration + 0.1, np.nan):
        with pytest.raises(zs.TrajectoryError):
            motion.after(bad)


@pytest.mark.parametrize("scenario", ["retreat", "terrain"])
def test_the_rest_of_a_drive_is_certified(scenario: str) -> None:
    plan = zs.plan(load_scenario(scenario).problem)
    motion, problem = plan.trajectory, plan.problem
    for t in (0.4 * motion.duration, float(motion.times[7])):
        rest = motion.after(t)
        times = np.linspace(0.0, rest.duration, 40)
        # at a node, where accelerations jump, rounding decides which side is meant
        times = times[np.abs(motion.times[:, None] - (t + times)).min(axis=0) > 1e-9]
        for found, expected in zip(rest.base(times), motion.base(t + times), strict=True):
            np.testing.assert_allclose(found[:-1], expected[:-1], atol=1e-8)
        found = zs.certify(problem.machine, rest, problem.ground)
        assert found.margin >= plan.certificate.margin - 1e-4


# --- bad files ----------------------------------------------------------------------------------


def rows_of(path: Path) -> list[list[str]]:
    with path.open(newline="") as file:
        return list(csv.reader(file))


Edit = Callable[[list[list[str]]], Any]


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda rows: rows[6].__setitem__(0, rows[5][0]), r"row 7: time .* is that of row 6"),
        (lambda rows: rows[6].__setitem__(0, "0"), r"row 7: time 0 s is before that of row 6"),
        (lambda rows: rows[6].__setitem__(3, "abc"), r"row 7, column 'stick.position': 'abc'"),
        (lambda rows: rows[6].__setitem__(3, "1_0"), r"row 7, column 'stick.position': '1_0'"),
        (lambda rows: rows[6].__setitem__(3, "nan"), r"row 7: position of joint 'stick' .* nan"),
        (lambda rows: rows[6].__setitem__(0, "inf"), r"row 7: time must be a finite number"),
        (lambda rows: rows[6].pop(), r"row 7 has 10 entries, but the header names 11"),
        (lambda rows: rows[0].__setitem__(3, "stik.position"), r"no column 'stick.position'"),
        (lambda rows: rows[0].__setitem__(8, "stik.velocity"), r"no column 'stick.velocity'"),
        (lambda rows: rows[0].__setitem__(0, "zeit"), r"there is no column 'time'"),
        (lambda rows: rows[0].__setitem__(4, "stick"), r"'stick.position' and 'stick' both hold"),
        (lambda rows: rows[0].__setitem__(4, "tilt [furlong]"), r"must be in rad or deg"),
        (lambda rows: rows[0].__setitem__(4, "tilt [mm]"), r"must be in rad or deg"),
        (lambda rows: rows[0].__setitem__(8, "stick.velocity [rad/min]"), r"'rad/min'"),
        (lambda rows: rows[0].__setitem__(0, "time [h]"), r"must be in s, sec, ms"),
        (lambda rows: rows.__delitem__(slice(2, None)), r"at least 2 samples, not 1"),
        (lambda rows: rows.clear(), r"there is no column 'time'; the columns are none"),
    ],
)
def test_a_bad_table_is_refused_by_row_and_column(edit: Edit, message: str, tmp_path: Path) -> None:
    path = sampled_file(tmp_path / "a.csv")
    rows = rows_of(path)
    edit(rows)
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    with pytest.raises(zs.TrajectoryError, match=message) as caught:
        zs.read_motion(path, MACHINE)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"positions": None}, "no array 'positions'"),
        ({"joint_names": np.array(["slew"])}, "joint 'boom' must be there once"),
        ({"positions": np.zeros((40, 4))}, "positions must have shape"),
        ({"times": np.array(["a"] * 40)}, "times must be numbers"),
        ({"times": np.zeros(40)}, "sample 1: time 0 s is that of sample 0"),
    ],
)
def test_a_bad_npz_is_refused_by_array(
    arrays: dict[str, Any], message: str, tmp_path: Path
) -> None:
    t, q, v, _ = smooth()
    good = {"times": t, "joint_names": np.array(JOINTS), "positions": q, "velocities": v}
    given = {name: part for name, part in (good | arrays).items() if part is not None}
    np.savez(tmp_path / "a.npz", **given)
    with pytest.raises(zs.TrajectoryError, match=message):
        zs.read_motion(tmp_path / "a.npz", MACHINE)
    (tmp_path / "b.npz").write_bytes(b"PK\x03\x04 no archive")
    with pytest.raises(zs.TrajectoryError, match="cannot read"):
        zs.read_motion(tmp_path / "b.npz", MACHINE)
    np.savez(tmp_path / "c.npz", times=np.array([{}, {}], dtype=object))
    with pytest.raises(zs.TrajectoryError, match="cannot read"):
        zs.read_motion(tmp_path / "c.npz", MACHINE)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda message: message["points"][3].pop("positions"), "point 3: positions must be"),
        (lambda message: message["points"][3].update(velocities=[]), "point 3: velocities must be"),
        (lambda message: message["points"][3].update(velocities=[1.0]), "must have shape"),
        (lambda message: message["points"][3].update(time_from_start=1.0), "must be an object"),
        (lambda message: message.update(joint_names="slew"), "joint_names must be a list"),
        (lambda message: message["joint_names"].__setitem__(1, "slew"), "is there 2 times"),
        (lambda message: message.pop("points"), "a list of points"),
        (lambda message: message["points"].__setitem__(2, 7), "point 2 must be an object"),
    ],
)
@pytest.mark.parametrize("suffix", ["json", "yaml"])
def test_a_bad_message_is_refused_by_point_and_field(
    change: Callable[[dict[str, Any]], Any], message: str, suffix: str, tmp_path: Path
) -> None:
    path = tmp_path / f"a.{suffix}"
    zs.export_motion(BLIND, path)
    content = yaml.safe_load(path.read_text())  # JSON is YAML
    change(content)
    path.write_text(json.dumps(content) if suffix == "json" else yaml.safe_dump(content))
    with pytest.raises(zs.TrajectoryError, match=message) as caught:
        zs.read_motion(path, MACHINE)
    assert "\n" not in str(caught.value)


@settings(
    max_examples=150,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    suffix=st.sampled_from(["csv", "json", "yaml", "npz"]),
    at=st.floats(0.0, 1.0),
    replacement=st.binary(max_size=12),
    length=st.integers(0, 40),
)
def test_a_spoilt_file_gives_a_motion_or_one_sentence(
    suffix: str, at: float, replacement: bytes, length: int, tmp_path: Path
) -> None:
    path = tmp_path / f"a.{suffix}"
    zs.export_motion(BLIND, path)
    content = path.read_bytes()
    place = int(at * len(content))
    path.write_bytes(content[:place] + replacement + content[place + length :])
    complaint = ""
    try:
        positions = zs.read_motion(path, MACHINE).trajectory.positions
    except zs.TrajectoryError as cause:
        positions, complaint = np.zeros(1), str(cause)
    assert np.isfinite(positions).all()
    assert "\n" not in complaint
    assert not complaint or str(path) in complaint


def test_without_rosbags_a_bag_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags", None)
    (tmp_path / "a.mcap").write_bytes(b"")
    with pytest.raises(zs.MissingExtra, match=r"pip install zmp-sqp\[ros\]"):
        zs.export_motion(BLIND, tmp_path / "b.mcap")
    with pytest.raises(zs.MissingExtra, match=r"pip install zmp-sqp\[ros\]"):
        zs.read_motion(tmp_path / "a.mcap", MACHINE)


def test_tables_of_spreadsheets_may_have_decimal_commas(tmp_path: Path) -> None:
    machine = zs.load_machine("feller_buncher")
    joints = machine.joint_names
    rows = [
        [0.0, 0.0, -0.8, -2.0, 0.7, 0.25],
        [0.5, 0.125, -0.8, -2.0, 0.7, 0.25],
        [1.0, 0.25, -0.8, -2.0, 0.7, 0.25],
    ]
    lines = [";".join(["time", *joints])]
    lines += [";".join(f"{value:.4f}".replace(".", ",") for value in row) for row in rows]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    read = zs.read_motion(path, machine)
    np.testing.assert_array_equal(read.samples.times, [0.0, 0.5, 1.0])
    np.testing.assert_array_equal(read.samples.values["position"], np.array(rows)[:, 1:])
    # a point anywhere: a comma may then part thousands, which is no number here
    path.write_text("\n".join(lines).replace("0,2500", "0.2500"), encoding="utf-8")
    with pytest.raises(zs.TrajectoryError, match="'0,0000' is not a number"):
        zs.read_motion(path, machine)
