"""Which joints are planned, where the others are held, and what else describes a machine: options
of the command line and keys of [machine] do the same as the arguments of `load_machine`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
import zmp_sqp.cli as cli
from tests.test_inspect import BARE
from zmp_sqp.commands.machine_options import add_machine_options, add_payload_options, machine_of
from zmp_sqp.scenario import load_scenario

SRDF = """
<robot name="bare_crane">
  <group name="carriage"><joint name="travel"/></group>
  <group name="all"><joint name="slew"/><joint name="travel"/></group>
  <group_state name="parked" group="all">
    <joint name="slew" value="0.5"/><joint name="travel" value="0.3"/>
  </group_state>
</robot>
"""
SCENARIO = """
[machine]
urdf = "bare_crane.urdf"
srdf = "poses.srdf"
group = "carriage"
hold = { slew = 1.0 }
package_dirs = ["."]
strict = true
limits = { acceleration = 0.3 }
[motion]
start = [0.3]
goal = [0.9]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "bare_crane.urdf").write_text(BARE, encoding="utf-8")
    (tmp_path / "poses.srdf").write_text(SRDF, encoding="utf-8")
    return tmp_path


def loaded(*options: str) -> zs.Machine:
    parser = argparse.ArgumentParser()
    parser.add_argument("urdf")
    add_machine_options(parser)
    add_payload_options(parser)
    return machine_of(parser.parse_args(options))


def test_joints_group_and_hold_choose_what_is_planned(folder: Path) -> None:
    urdf = str(folder / "bare_crane.urdf")
    assert loaded(urdf).joint_names == ("slew", "travel")
    chosen = loaded(urdf, "--joints", "travel")
    assert chosen.joint_names == ("travel",)
    assert chosen.held == {"slew": 0.0}
    held = loaded(urdf, "--hold", "slew=-1.5")
    assert (held.joint_names, held.held) == (("travel",), {"slew": -1.5})
    group = loaded(urdf, "--srdf", str(folder / "poses.srdf"), "--group", "carriage")
    assert (group.joint_names, group.held) == (("travel",), {"slew": 0.5})
    assert group.mass == loaded(urdf).mass


def test_a_held_joint_stays_where_it_is_in_numbers_and_in_the_tree(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    urdf = str(folder / "bare_crane.urdf")
    assert cli.main(["inspect", urdf, "--hold", "slew=1.5708", "--json", "-"]) == 0
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    assert result["held"] == {"slew": 1.5708}
    assert list(result["joints"]) == ["travel"]
    com = np.array(result["poses"]["middle"]["com"])
    assert com[1] > 0.05  # the arm points to the left
    assert "held at 1.571" in captured.err


def test_states_of_the_srdf_are_poses(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = [str(folder / "bare_crane.urdf"), "--srdf", str(folder / "poses.srdf")]
    assert cli.main(["inspect", *options, "--json", "-"]) == 0
    poses = json.loads(capsys.readouterr().out)["poses"]
    assert list(poses) == ["parked", "zero", "middle"]
    assert poses["parked"]["q"] == [0.5, 0.3]
    assert cli.main(["init", *options, "--out", str(folder / "study")]) == 0
    text = (folder / "study" / "bare_crane.toml").read_text()
    assert 'srdf = "../poses.srdf"' in text
    assert "pose 'parked'" in text


def test_keys_of_a_scenario_do_the_same(folder: Path) -> None:
    path = folder / "scenario.toml"
    path.write_text(SCENARIO, encoding="utf-8")
    machine = load_scenario(path).problem.machine
    assert (machine.joint_names, machine.held) == (("travel",), {"slew": 1.0})


def test_init_writes_the_keys_of_its_options(folder: Path) -> None:
    urdf = str(folder / "bare_crane.urdf")
    out = folder / "study"
    options = ["--hold", "slew=1.0", "--package-dirs", str(folder), "--strict"]
    assert cli.main(["init", urdf, *options, "--out", str(out)]) == 0
    text = (out / "bare_crane.toml").read_text()
    for line in ("[machine.hold]\nslew = 1.0", 'package_dirs = [".."]', "strict = true"):
        assert line in text
    limits = (out / "joint_limits.yaml").read_text()
    (out / "joint_limits.yaml").write_text(
        limits.replace("has_acceleration_limits: false", "has_acceleration_limits: true").replace(
            "max_acceleration:  #", "max_acceleration: 0.3  #"
        )
    )
    machine = load_scenario(out / "bare_crane.toml").problem.machine
    assert (machine.joint_names, machine.held) == (("travel",), {"slew": 1.0})


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('joints = ["travel"]\ngroup = "all"', "joints and group exclude each other"),
        ("hold = 1.0", "hold: must be a table { joint = number }"),
        ('hold = { slew = "up" }', "hold: must be a table { joint = number }"),
        ("hold = { mast = 1.0 }", "there is no joint 'mast'"),
        ('joints = ["mast"]', "there is no joint 'mast'"),
        ('package_dirs = ["nowhere"]', "nowhere"),
        ('srdf = "nowhere.srdf"', "nowhere.srdf"),
    ],
)
def test_bad_keys_are_one_sentence(line: str, words: str, folder: Path) -> None:
    path = folder / "scenario.toml"
    path.write_text(f'[machine]\nurdf = "bare_crane.urdf"\n{line}\n[motion]\nstart=[0]\ngoal=[0]')
    with pytest.raises(zs.ScenarioError) as caught:
        load_scenario(path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("given", ["slew", "slew=", "=1.0", "slew=up"])
def test_hold_wants_joint_and_value(
    given: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(["inspect", str(folder / "bare_crane.urdf"), "--hold", given])
    assert caught.value.code == 2
    assert "JOINT=VALUE" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        cli.main(["inspect", "slider", "--joints", "slider", "--group", "arm"])
