"""`zmp-sqp check`: the verdict on motions, ours and spoilt ones, and on bad input."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.paper import paper_scene
from benchmarks.problems.terrain import unicycle_base as base
from zmp_sqp.cli import main
from zmp_sqp.planning.proof.certificate import certify_for
from zmp_sqp.scenario import SHIPPED, load_scenario

TREE = (
    "--payload",
    "4000",
    "--payload-frame",
    "head",
    "--payload-com",
    "0",
    "0",
    "3.323",
    "--point-masses",
)
START = np.array([0.0, -np.pi / 6, -2 * np.pi / 3, np.pi / 6, -np.pi / 2])
GOAL = START + np.array([np.pi, 0.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def blind(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The motion of the phase plane, as a file: it tips the machine over on 20 degrees."""
    path = tmp_path_factory.mktemp("motions") / "blind.csv"
    zs.phase_plane(paper_scene().load(), START, GOAL).to_csv(path)
    return path


def checked(
    path: Path, *options: str, code: int, capsys: pytest.CaptureFixture[str]
) -> dict[str, Any]:
    assert main(["check", "feller_buncher", str(path), *TREE, *options, "--json", "-"]) == code
    result: dict[str, Any] = json.loads(capsys.readouterr().out)
    return result


def test_a_motion_that_tips_the_machine_is_called_unsafe(
    blind: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = checked(blind, "--roll", "-20", code=1, capsys=capsys)
    machine = paper_scene().load()
    expected = zs.certify(machine, zs.Trajectory.from_csv(blind, machine), paper_scene().ground)
    assert not result["safe"]
    assert result["margin"] == expected.margin
    assert result["edge"] == "left"
    assert result["margin"] < -0.3
    assert result["load_transfer_ratio"] > 1.0
    assert result["force_angle"] < 0.0
    assert result["tip_over_energy"] < 0.0


def test_the_same_motion_is_safe_on_level_ground_up_to_its_margin(
    blind: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    level = checked(blind, code=0, capsys=capsys)
    assert level["safe"]
    assert level["limits_ok"]
    assert 0.0 < level["margin"] < 1.615
    assert 0.0 < level["load_transfer_ratio"] < 1.0
    more = str(level["margin"] + 0.01)
    refused = checked(blind, "--margin", more, code=1, capsys=capsys)
    assert refused["required"] == float(more)
    assert main(["check", "feller_buncher", str(blind), *TREE, "--margin", more]) == 1
    assert f"short of the margin of {float(more):.10g} m" in capsys.readouterr().out


def test_a_motion_faster_than_its_joints_is_not_safe(
    blind: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    limits = tmp_path / "joint_limits.yaml"
    joints = "".join(
        f"  {name}: {{has_acceleration_limits: true, max_acceleration: 2.0, "
        f"has_velocity_limits: true, max_velocity: {0.5 if name == 'slew' else 1.0}}}\n"
        for name in ("slew", "boom", "stick", "tilt", "head")
    )
    limits.write_text(f"joint_limits:\n{joints}", encoding="utf-8")
    result = checked(blind, "--limits", str(limits), code=1, capsys=capsys)
    assert not result["limits_ok"]
    assert result["limit_excess"] == pytest.approx(np.pi / 4 - 0.5, abs=1e-3)


def test_a_drive_over_a_heightmap_is_checked_on_that_map(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = zs.plan(load_scenario("terrain").problem)
    plan.trajectory.to_csv(tmp_path / "motion.csv")
    machine, ground = paper_scene().load(), plan.problem.ground
    ground_options = (
        "--heightmap",
        str(SHIPPED / "terrain.csv"),
        "--resolution",
        "1",
        "--origin",
        "-16",
        "-14",
    )
    expected = zs.certify(
        machine, zs.Trajectory.from_csv(tmp_path / "motion.csv", machine, ground), ground
    )
    result = checked(
        tmp_path / "motion.csv", *ground_options, code=0 if expected.safe else 1, capsys=capsys
    )
    assert result["margin"] == pytest.approx(expected.margin, abs=1e-9)
    for options, message in (
        (ground_options[:2], "--heightmap needs --resolution"),
        ((*ground_options, "--roll", "3"), "leave out --roll and --pitch"),
        ((), "give that as its ground"),
    ):
        assert main(["check", "feller_buncher", str(tmp_path / "motion.csv"), *TREE, *options]) == 2
        assert message in capsys.readouterr().err


def test_a_motion_is_certified_at_all_corners_of_what_is_uncertain(
    blind: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = (
        "--tipping-fraction",
        "0.75",
        "--payload-uncertainty",
        "0.1",
        "--slope-uncertainty",
        "2",
    )
    options += ("--payload-com-uncertainty", "0.1", "0", "0.2")
    nominal, result = (
        checked(blind, code=0, capsys=capsys),
        checked(blind, *options, code=1, capsys=capsys),
    )
    machine = paper_scene().load()
    problem = zs.Problem(
        machine,
        START,
        GOAL,
        tipping_fraction=0.75,
        payload_uncertainty=0.1,
        slope_uncertainty=np.deg2rad(2.0),
        payload_com_uncertainty=(0.1, 0.0, 0.2),
    )
    expected = certify_for(problem, zs.Trajectory.from_csv(blind, machine))
    assert result["margin"] == pytest.approx(expected.margin, abs=1e-12)
    assert result["corner"] == expected.corner != ""
    assert result["margin"] < nominal["margin"] - 0.01
    assert nominal["corner"] == ""
    assert (
        f"lies {-expected.margin:.3f} m outside the left edge of the support polygon with "
        f"{expected.corner}" in result["fault"]
    )
    level = checked(blind, "--slope-uncertainty", "0.001", code=0, capsys=capsys)
    assert level["corner"]
    assert not level["fault"]
    for option, value, message in (
        (
            "--slope-uncertainty",
            "40",
            "--slope-uncertainty must lie within [0, 28.65] degrees, not 40",
        ),
        ("--tipping-fraction", "75", "--tipping-fraction must lie within [0.1, 1], not 75"),
        ("--base-limits", "1 1 1 1", "this motion has none"),
    ):
        assert main(["check", "feller_buncher", str(blind), *TREE, option, *value.split()]) == 2
        assert message in capsys.readouterr().err


def test_a_drive_is_compared_with_the_bound_of_its_base_or_with_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = zs.plan(
        paper_scene().problem(START, START, base=base(goal=(-3.0, 0.0, 0.0)), intervals=10)
    )
    plan.trajectory.to_csv(tmp_path / "drive.csv")
    assert checked(tmp_path / "drive.csv", "--roll", "-20", code=0, capsys=capsys)["gap"] is None
    options = ["--roll", "-20", "--base-limits", "10", "2", "0.5", "1"]
    kept = checked(tmp_path / "drive.csv", *options, code=0, capsys=capsys)
    assert kept["gap"] == pytest.approx(plan.duration / plan.lower_bound - 1.0, abs=1e-9)
    options[4] = "1"
    fast = checked(tmp_path / "drive.csv", *options, code=1, capsys=capsys)
    assert "exceeds the base's max_acceleration by 1 m/s^2" in fast["fault"]


def test_a_drive_that_begins_too_fast_is_said_to_be_too_fast(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    way = base(goal=(-3.0, 0.0, 0.0), start_velocity=(-0.5, 0.0))
    plan = zs.plan(paper_scene().problem(START, START, base=way, intervals=10))
    plan.trajectory.to_csv(tmp_path / "drive.csv")
    options = ["--roll", "-20", "--base-limits", "0.3", "9", "0.5", "1"]
    fast = checked(tmp_path / "drive.csv", *options, code=1, capsys=capsys)
    assert "exceeds the base's max_speed by" in fast["fault"]


def test_a_payload_beyond_all_reason_is_refused(
    blind: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    load = ["--payload-frame", "head", "--payload-com", "0", "0"]
    for numbers, message in (
        ("1e308 3", "payload mass must be at most"),
        ("4000 1e300", "payload com must lie within"),
    ):
        mass, height = numbers.split()
        assert main(["check", "feller_buncher", str(blind), "--payload", mass, *load, height]) == 2
        assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["check", "feller_buncher", "nowhere.csv"], "cannot read nowhere.csv"),
        (["check", "feller_bunche", "nowhere.csv"], "feller_bunche"),
        (["check", "feller_buncher", "nowhere.csv", "--payload", "4000"], "belong together"),
        (["check", "feller_buncher", "nowhere.csv", "--roll", "95"], "slope roll must lie within"),
        (["check", "feller_buncher", "nowhere.csv", "--roll", "nan"], "slope roll"),
        (["check", "feller_buncher", "nowhere.csv", "--contact-links", "tracks"], "tracks"),
    ],
)
def test_bad_input_gets_one_sentence(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    complaint = capsys.readouterr().err
    assert message in complaint
    assert complaint.count("\n") == 1


def test_a_file_that_is_no_motion_is_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "motion.csv"
    for text in ("", "time\n0\n", "time,slew.position\n0,a\n", "\x00\x01"):
        path.write_text(text, encoding="utf-8")
        assert main(["check", "feller_buncher", str(path)]) == 2
        assert capsys.readouterr().err.startswith("zmp-sqp: error: ")


def test_help_is_complete(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["check", "--help"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    for word in (
        "--roll",
        "--payload-com",
        "--slope-uncertainty",
        "exit codes",
        "tip_over_energy",
        "feller_buncher",
    ):
        assert word in text


def test_a_payload_has_the_inertia_that_is_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    problem = load_scenario("paper_1_rigid").problem
    motion = tmp_path / "motion.csv"
    zs.plan(problem).trajectory.to_csv(motion)
    tree = problem.machine.model.frames[-1].inertia
    inertia = [f"{value:.17g}" for value in np.diag(tree.inertia)]
    expected = zs.certify(
        problem.machine, zs.Trajectory.from_csv(motion, problem.machine), problem.ground
    )
    payload = (
        "--payload",
        "4000",
        "--payload-frame",
        "head",
        "--payload-com",
        "0",
        "0",
        "3.323",
        "--roll",
        "-20",
    )
    arguments = [
        "check",
        "feller_buncher",
        str(motion),
        *payload,
        "--payload-inertia",
        *inertia,
        "--json",
        "-",
    ]
    assert main(arguments) == 0
    assert json.loads(capsys.readouterr().out)["margin"] == pytest.approx(
        expected.margin, abs=1e-12
    )
    assert main(["check", "feller_buncher", str(motion), "--payload-inertia", "1", "1", "1"]) == 2
    assert "--payload-inertia belongs to a payload" in capsys.readouterr().err
