"""`zmp-sqp init`: a scenario and a joint_limits.yaml to start from."""

from __future__ import annotations

import os
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import zmp_sqp as zs
import zmp_sqp.cli as cli
from tests.mechanics.test_contacts import on_wheels
from tests.problems import stack_of_slides
from tests.test_inspect import BARE
from zmp_sqp.scenario import load_scenario
from zmp_sqp.scenario.starter import find_starter

COMPLETE = """
joint_limits:
  slew: {has_acceleration_limits: true, max_acceleration: 0.4}
  travel: {has_acceleration_limits: true, max_acceleration: 0.3}
"""


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    path = tmp_path / "bare_crane.urdf"
    path.write_text(BARE, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", sorted(zs.shipped_machines()))
def test_what_is_written_plans_as_it_is(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "folder"
    assert cli.main(["init", name, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert f"now: zmp-sqp plan {out / name}.toml" in printed
    assert {path.name for path in out.iterdir()} == {f"{name}.toml", "joint_limits.yaml"}
    scenario = load_scenario(out / f"{name}.toml")
    problem, machine = scenario.problem, zs.load_machine(name)
    assert problem.machine.joint_names == machine.joint_names
    for key in ("position_lower", "position_upper", "velocity", "acceleration", "effort"):
        written, given = getattr(problem.machine.limits, key), getattr(machine.limits, key)
        np.testing.assert_array_equal(written, given)
    assert np.count_nonzero(problem.goal - problem.start) == 1
    plan = zs.plan(problem)
    assert plan.success
    assert plan.certificate.margin >= problem.margin > 0.0


def test_limits_that_are_missing_are_marked_and_named(
    bare: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "study"
    assert cli.main(["init", str(bare), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    limits, scenario = out / "joint_limits.yaml", out / "bare_crane.toml"
    assert f"fill in, in {limits}: acceleration limits of slew, travel" in printed
    assert limits.read_text().count("# MISSING [") == 2
    written = yaml.safe_load(limits.read_text())["joint_limits"]
    assert written["travel"]["max_position"] == 1.2
    assert written["slew"]["has_acceleration_limits"] is False
    # as written, planning names what is missing; filled in, it plans
    assert cli.main(["plan", str(scenario)]) == 2
    assert "acceleration limit" in capsys.readouterr().err
    limits.write_text(COMPLETE)
    assert cli.main(["plan", str(scenario), "--no-figures"]) == 0


def test_paths_are_relative_to_the_scenario(bare: Path, tmp_path: Path) -> None:
    out = tmp_path / "deep" / "down"
    assert cli.main(["init", str(bare), "--out", str(out)]) == 0
    table = tomllib.loads((out / "bare_crane.toml").read_text())["machine"]
    assert table == {"urdf": "../../bare_crane.urdf", "joint_limits": "joint_limits.yaml"}


def test_options_become_keys(tmp_path: Path) -> None:
    load = ["--payload", "2000", "--payload-frame", "head", "--payload-com", "0", "0", "1"]
    options = [*load, "--roll", "-10", "--point-masses", "--contact-links"]
    options += ["left_track", "right_track"]
    assert cli.main(["init", "feller_buncher", "--out", str(tmp_path), *options]) == 0
    content = tomllib.loads((tmp_path / "feller_buncher.toml").read_text())
    assert content["ground"] == {"roll_deg": -10.0, "pitch_deg": 0.0}
    assert content["machine"]["payload"] == {"frame": "head", "mass": 2e3, "com": [0.0, 0.0, 1.0]}
    assert content["machine"]["contact_links"] == ["left_track", "right_track"]
    assert content["machine"]["point_masses"] is True
    problem = load_scenario(tmp_path / "feller_buncher.toml").problem
    assert problem.machine.payload_mass == pytest.approx(2000.0)
    assert problem.ground.roll == pytest.approx(np.radians(-10.0))


def test_nothing_is_replaced_without_force(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    edited = tmp_path / "joint_limits.yaml"
    edited.write_text("# edited by hand")
    assert cli.main(["init", "slider", "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "is there already" in error
    assert "--force" in error
    assert edited.read_text() == "# edited by hand"
    assert not (tmp_path / "slider.toml").exists()
    assert cli.main(["init", "slider", "--out", str(tmp_path), "--force"]) == 0
    assert "max_velocity" in edited.read_text()


def test_a_machine_without_support_gets_a_place_to_fill_it_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "floating.urdf"
    path.write_text(BARE.replace("<collision>", "<!--").replace("</collision>", "-->"))
    assert cli.main(["init", str(path), "--out", str(tmp_path)]) == 0
    assert "the support polygon" in capsys.readouterr().out
    scenario = tmp_path / "floating.toml"
    text = scenario.read_text()
    assert "# FILL IN the support polygon" in text
    (tmp_path / "joint_limits.yaml").write_text(COMPLETE)
    for commented in ("[machine.support]", "vertices =", "height ="):
        text = text.replace(f"# {commented}", commented)
    scenario.write_text(text)
    assert load_scenario(scenario).problem.machine.support is not None


def test_a_machine_that_stands_nowhere_gets_a_place_for_its_real_polygon(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An arm that is bolted to a table has a foot that is too small to stand on."""
    path = tmp_path / "bolted.urdf"
    path.write_text(BARE.replace('<box size="2 1.6 0.2"/>', '<box size="0.1 0.1 0.2"/>'))
    assert cli.main(["init", str(path), "--roll", "-30", "--out", str(tmp_path)]) == 1
    assert "tips over at rest in all poses that were tried" in capsys.readouterr().out
    scenario = tmp_path / "bolted.toml"
    text = scenario.read_text()
    assert "# FILL IN the support polygon" in text
    (tmp_path / "joint_limits.yaml").write_text(COMPLETE)
    with pytest.raises(zs.ScenarioError, match="tips over at rest"):
        load_scenario(scenario)
    text = text.replace("-1.0", "-3.0").replace("1.0]", "3.0]")
    for commented in ("[machine.support]", "vertices =", "height ="):
        text = text.replace(f"# {commented}", commented)
    scenario.write_text(text)
    assert zs.plan(load_scenario(scenario).problem).success


def test_a_machine_without_room_to_move_is_refused(bare: Path) -> None:
    machine = zs.load_machine(bare)
    stuck = replace(
        machine.limits, position_lower=np.array([0.0, 0.5]), position_upper=np.array([0.0, 0.5])
    )
    with pytest.raises(zs.ProblemError, match="has room to move"):
        find_starter(replace(machine, limits=stuck), zs.Slope())


def test_the_whole_way_stands_at_rest_and_keeps_the_limits() -> None:
    machine = zs.load_machine("feller_buncher")
    tree = zs.Payload(4000.0, (0.0, 0.0, 3.3), "head")
    for roll in (0.0, -10.0, -20.0):
        ground = zs.Slope(roll=np.radians(roll))
        found = find_starter(machine.with_payload(tree), ground)
        shares = np.linspace(0.0, 1.0, 200)[:, None]
        way = found.start + shares * (found.goal - found.start)
        still = np.zeros_like(way)
        margins = zs.stability_margin(machine.with_payload(tree), way, still, still, ground)
        assert margins.min() > found.margin > 0.0
        assert (way >= machine.limits.position_lower).all()
        assert (way <= machine.limits.position_upper).all()


def test_where_no_pose_with_a_name_stands_one_is_searched_for() -> None:
    machine = zs.load_machine("feller_buncher")
    behind = [[-2.5, -1.6], [0.05, -1.6], [0.05, 1.6], [-2.5, 1.6]]
    moved = machine.with_support(zs.SupportPolygon(behind))
    assert all(pose.margin < 0.0 for pose in zs.inspect(moved).poses)
    found = find_starter(moved, zs.Slope())
    assert found.pose == "found at random"
    same = find_starter(moved, zs.Slope())  # from a fixed seed
    np.testing.assert_array_equal(found.start, same.start)


def test_joints_without_limits_swing_about_zero(bare: Path) -> None:
    machine = zs.load_machine(bare)
    limits = replace(
        machine.limits,
        position_lower=np.array([-np.inf, np.nan]),
        position_upper=np.array([np.inf, np.nan]),
    )
    found = find_starter(replace(machine, limits=limits), zs.Slope())
    assert found.joint == "slew"
    np.testing.assert_allclose(found.start, 0.0)


@pytest.mark.parametrize("arguments", [["nobody"], ["slider", "--out", "/dev/null/folder"]])
def test_bad_input_is_one_sentence(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["init", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("zmp-sqp: error: ")
    assert error.count("\n") == 1


def test_the_working_folder_is_the_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["init", "slewing_crane"]) == 0
    assert sorted(os.listdir(tmp_path)) == ["joint_limits.yaml", "slewing_crane.toml"]


@pytest.mark.parametrize(("joints", "few"), [(12, False), (13, True)])
def test_many_joints_get_few_intervals(joints: int, few: bool, tmp_path: Path) -> None:
    path, out = stack_of_slides(tmp_path, joints), tmp_path / "study"
    cli.main(["init", str(path), "--out", str(out)])
    scenario = tomllib.loads((out / f"{path.stem}.toml").read_text())
    assert scenario["plan"].get("intervals") == (24 if few else None)


def test_wheels_on_which_the_machine_stands_are_held_unless_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rolling.urdf"
    path.write_text(on_wheels('<cylinder radius="0.3" length="0.2"/>'), encoding="utf-8")
    assert cli.main(["init", str(path), "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "held, because the machine stands on them: axle0, axle1, axle2, axle3" in out
    tables = tomllib.loads((tmp_path / "rolling.toml").read_text(encoding="utf-8"))
    assert tables["machine"]["hold"] == {f"axle{i}": 0.0 for i in range(4)}
    assert "'turn'" in tables["title"] or "turn swings" in tables["title"]
    asked = ["init", str(path), "--out", str(tmp_path), "--force", "--joints", "turn"]
    assert cli.main(asked) == 0
    assert "held" not in capsys.readouterr().out
