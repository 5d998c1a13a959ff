"""A constraint that is registered is known to scenario files, the command line and its tables."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from tests.planning.path_rows import RateLimit
from zmp_sqp.cli import main
from zmp_sqp.errors import ScenarioError
from zmp_sqp.planning.constraints import registry
from zmp_sqp.scenario import load_scenario
from zmp_sqp.scenario.path_constraints import constraint_table

SCENARIO = """
[machine]
name = "slewing_crane"
support = { vertices = [[-9, -9], [9, -9], [9, 9], [-9, 9]] }
limits = { velocity = 1.0, acceleration = 0.5 }
[motion]
start = [0.0]
goal = [2.0]
[plan]
intervals = 20
"""
LIMIT = 0.5  # [rad/s]
DURATION = 2.0 / LIMIT + LIMIT / 0.5  # [s] distance over rate, and one ramp


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "RateLimit", RateLimit, raising=False)


def scenario(folder: Path, constraint: str) -> Path:
    path = folder / "my.toml"
    path.write_text(f"{SCENARIO}\n{constraint}", encoding="utf-8")
    return path


# --- scenario files -----------------------------------------------------------------------------


def test_a_table_becomes_the_constraint_of_that_type(tmp_path: Path) -> None:
    text = '[[constraints]]\ntype = "rate_limit"\nlimit = 0.5\nproven = false\n'
    found = load_scenario(scenario(tmp_path, text)).problem.constraints
    assert found == (RateLimit(0.5, proven=False),)
    assert load_scenario(scenario(tmp_path, "")).problem.constraints == ()


MISTAKES = {
    "unknown type": (
        'type = "rate_limt"\nlimit = 1',
        r"\[\[constraints\]\] there is no constraint 'rate_limt' \(did you mean rate_limit\?\); "
        r"known constraints are .*rate_limit",
    ),
    "no type": ("limit = 1", r"\[\[constraints\]\] type: missing; known constraints are "),
    "type is no text": ("type = 3", r"\[\[constraints\]\] there is no constraint 3"),
    "unknown key": (
        'type = "rate_limit"\nlimt = 1',
        r"\[\[constraints\]\] limt: unknown key \(did you mean limit\?\); allowed are type, limit, "
        "joint, proven",
    ),
    "missing key": (
        'type = "rate_limit"',
        r"\[\[constraints\]\] limit: missing; it must be a finite number",
    ),
    "text for number": (
        'type = "rate_limit"\nlimit = "1"',
        r"\[\[constraints\]\] limit: must be a finite number, not '1'",
    ),
    "number for flag": (
        'type = "rate_limit"\nlimit = 1\nproven = 1',
        r"\[\[constraints\]\] proven: must be true or false, not 1",
    ),
    "float for index": (
        'type = "rate_limit"\nlimit = 1\njoint = 0.5',
        r"\[\[constraints\]\] joint: must be a whole number, not 0.5",
    ),
    "refused value": (
        'type = "rate_limit"\nlimit = -1',
        r"\[\[constraints\]\] rate_limit: limit must be positive, not -1",
    ),
    "twice": (
        'type = "rate_limit"\nlimit = 1\n[[constraints]]\ntype = "rate_limit"\nlimit = 2',
        "two constraints are named 'rate_limit'",
    ),
}


@pytest.mark.parametrize(("text", "message"), MISTAKES.values(), ids=MISTAKES.keys())
def test_a_mistake_is_named_with_key_and_value(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message) as caught:
        load_scenario(scenario(tmp_path, f"[[constraints]]\n{text}\n"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["constraints = 3\n", 'constraints = ["rate_limit"]\n'])
def test_anything_but_tables_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "my.toml"
    path.write_text(text + SCENARIO, encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"constraints: must be tables, one under each line"):
        load_scenario(path)


# --- zmp-sqp plan -------------------------------------------------------------------------------


def planned(
    folder: Path, constraint: str, capsys: pytest.CaptureFixture[str]
) -> tuple[dict[str, Any], str]:
    path = scenario(folder, f'[[constraints]]\ntype = "rate_limit"\n{constraint}')
    main(["plan", str(path), "--out", str(folder / "out"), "--no-figures"])
    return json.loads((folder / "out" / "plan.json").read_text()), capsys.readouterr().out


def test_a_plan_keeps_the_constraint_and_says_what_it_guarantees(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result, printed = planned(tmp_path, f"limit = {LIMIT}", capsys)
    assert result["duration"] == pytest.approx(DURATION, rel=1e-4)
    entries = {found["name"]: found for found in result["guarantees"]}
    assert list(entries) == ["tip_over", "contact", "rate_limit", "joint_limits"]
    own = entries["rate_limit"]
    assert own["label"] == "forwards"
    assert own["unit"] == "rad/s"
    assert own["proven"] is True
    assert own["required"] == 0.0
    assert 0.0 <= own["value"] <= 1e-5
    assert own["corner"] == ""
    assert "rate_limit: forwards" in printed
    assert "sampled only" not in printed


def test_what_is_only_sampled_is_named_so_in_table_and_message(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result, printed = planned(tmp_path, f"limit = {LIMIT}\nproven = false", capsys)
    row = next(line for line in printed.splitlines() if "rate_limit: forwards" in line)
    assert "sampled only" in row
    assert "not proven: rate_limit (forwards)." in result["message"]


# --- zmp-sqp check ------------------------------------------------------------------------------


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    """A motion that runs at 1 rad/s."""
    path = tmp_path / "motion.csv"
    machine = zs.load_machine("slewing_crane").with_limits(velocity=1.0, acceleration=0.5)
    zs.phase_plane(machine, np.array([0.0]), np.array([4.0])).to_csv(path)
    return path


def checked(motion: Path, *options: str) -> int:
    urdf = "slewing_crane"
    return main(["check", urdf, str(motion), *options])


def test_check_proves_the_constraints_of_the_command_line(
    motion: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ("--constraint", "rate_limit:limit=1.25,joint=0", "--json", "-")
    checked(motion, *given)
    entries = {found["name"]: found for found in json.loads(capsys.readouterr().out)["guarantees"]}
    assert entries["rate_limit"]["value"] == pytest.approx(0.25, abs=1e-3)
    checked(motion, "--json", "-")
    assert "rate_limit" not in capsys.readouterr().out


def test_check_names_the_broken_constraint_by_how_much_and_when(
    motion: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert checked(motion, "--constraint", "rate_limit:limit=0.75") == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert "the motion breaks rate_limit (forwards) by 0.25 rad/s at" in printed
    assert "rate_limit: forwards" in printed


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("rate_limit", "--constraint: limit: missing; it must be a finite number"),
        ("rate_limt:limit=1", "--constraint: there is no constraint 'rate_limt' (did you mean"),
        ("rate_limit:limit=fast", "give a constraint as NAME or NAME:key=value,key=value"),
        ("rate_limit:limit=1,limit=2", "give a constraint as NAME or NAME:key=value,key=value"),
        ("rate_limit:limit=1}\nb={", "more than one line"),
        ("rate_limit:limit=-1", "--constraint: rate_limit: limit must be positive, not -1"),
        ("", "--constraint: there is no constraint ''"),
    ],
)
def test_an_option_that_cannot_be_used_gets_one_sentence(
    motion: Path, option: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert checked(motion, "--constraint", option) == 2
    complaint = capsys.readouterr().err
    assert message in complaint
    assert complaint.count("\n") == 1


def test_values_of_an_option_are_those_of_toml() -> None:
    assert constraint_table('attitude:frame="head",axis=[0, 0, 1],tolerance=0.02') == {
        "type": "attitude",
        "frame": "head",
        "axis": [0, 0, 1],
        "tolerance": 0.02,
    }


@pytest.mark.parametrize("command", ["plan", "check"])
def test_help_lists_the_registered_constraints(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([command, "--help"])
    printed = capsys.readouterr().out
    assert "rate_limit: limit, joint [0], proven [True]" in printed
    assert "The rate of one joint stays below a limit." in printed
