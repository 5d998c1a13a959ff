"""The command line: exit codes, what goes where, and what a result holds."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import zmp_sqp.cli as cli
import zmp_sqp.commands.plan as plan_command
from zmp_sqp.planning import certify, phase_plane
from zmp_sqp.report import RECORD_KEYS
from zmp_sqp.scenario import SCHEMA, load_scenario, shipped_scenarios
from zmp_sqp.show.results import RESULT_KEYS

TIPPING = """
[machine]
name = "feller_buncher"
point_masses = true
payload = { frame = "head", mass = 4000, com = [0, 0, 3.323] }
[ground]
roll_deg = -20
[motion]
start_deg = [0, -30, -120, 30, -90]
goal_deg = [90, -30, -120, 30, -90]
"""
STRETCHED = """
title = "both ends are safe, but an arm that cannot be drawn in tips the machine over on the way"
[machine]
name = "feller_buncher"
point_masses = true
payload = { frame = "head", mass = 4000, com = [0, 0, 3.323] }
[machine.limits]
position_lower = { boom = -0.53, stick = -2.10, tilt = 0.52 }
position_upper = { boom = -0.52, stick = -2.09, tilt = 0.53 }
[ground]
roll_deg = -20
[motion]
start_deg = [0, -30, -120, 30, -90]
goal_deg = [180, -30, -120, 30, -90]
[plan]
intervals = 20
"""
MOVING = """
[machine]
name = "feller_buncher"
[motion]
start_deg = [0, -30, -120, 30, -90]
start_velocity_deg = [10, 0, 0, 0, 0]
goal_deg = [90, -30, -120, 30, -90]
[plan]
intervals = 20
"""


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder that `zmp-sqp plan paper_1 --out` wrote, two levels below one that existed."""
    folder = tmp_path_factory.mktemp("cli") / "new" / "folder"
    assert cli.main(["plan", "paper_1", "--out", str(folder)]) == 0
    return folder


def failing(monkeypatch: pytest.MonkeyPatch, fault: BaseException) -> None:
    def plan(*_: object, **__: object) -> None:
        raise fault

    monkeypatch.setattr(plan_command, "plan", plan)


# --- 0: done and safe ---------------------------------------------------------------------------


def test_out_holds_trajectory_results_and_figures(out: Path) -> None:
    assert {path.name for path in out.iterdir()} == set(plan_command.PLAN_FILES)
    assert all(path.stat().st_size > 500 for path in out.iterdir())
    result = json.loads((out / "plan.json").read_text())
    assert result["success"] is True
    assert 4.5 <= result["duration"] <= 4.505  # [s], issue: paper_1, full, N = 50


def test_the_table_fits_a_pipe_and_names_what_matters(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["plan", "paper_1", "--verbose"]) == 0
    printed = capsys.readouterr().out
    for words in (
        "Song & Sharf",
        "duration [s]",
        "lower bound [s]",
        "guaranteed stability margin [m]",
        "phase plane",
        "auto",
    ):
        assert words in printed
    for joint in load_scenario("paper_1").problem.machine.joint_names:
        assert joint in printed
    assert "violation" in printed  # the history of --verbose
    assert "bound reached" in printed  # the runs of the search
    tables = [line for line in printed.splitlines() if not line.startswith("paper_1:")]
    assert "\x1b" not in printed
    assert max(len(line) for line in tables[:-1]) <= 80


def test_the_worst_corner_is_named_where_something_is_uncertain(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "uncertain.toml"
    path.write_text(MOVING + "slope_uncertainty_deg = 1.0\n", encoding="utf-8")
    assert cli.main(["plan", str(path), "--json", str(tmp_path / "result.json")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    corner = json.loads((tmp_path / "result.json").read_text())["corner"]
    assert "the same, nothing uncertain [m]" in printed
    assert corner.startswith("the slope off by roll ")
    assert corner[:16] in printed
    assert cli.main(["plan", "paper_1"]) == 0
    assert "nothing uncertain" not in capsys.readouterr().out


def test_the_margins_of_plan_and_baseline_are_the_same_quantity(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "uncertain.toml"
    text = TIPPING.replace("mass = 4000", "mass = 2000").replace("90, -30, -120", "180, -30, -120")
    path.write_text(text + "[plan]\ntipping_fraction = 0.75\n", encoding="utf-8")
    assert cli.main(["plan", str(path), "--json", "-"]) == 0
    result = json.loads(capsys.readouterr().out)
    problem = load_scenario(path).problem
    heavier = problem.machine.with_payload_scaled(1.0 / 0.75)
    blind = phase_plane(problem.machine, problem.start, problem.goal)
    for key, machine in (("margin", heavier), ("nominal_margin", problem.machine)):
        expected = certify(machine, blind, problem.ground).margin
        assert result["phase_plane"][key] == pytest.approx(expected, abs=1e-5)
    assert result["phase_plane"]["margin"] < result["phase_plane"]["nominal_margin"] - 0.1
    assert result["nominal_margin"] > result["margin"]
    assert result["margin_asked"] == 0.0


def test_json_on_standard_output_is_all_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["plan", "paper_1", "--json", "-"]) == 0
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    assert list(result) == [
        line.strip() for row in (RESULT_KEYS + RECORD_KEYS).splitlines()[1:] for line in names(row)
    ]
    assert result["lower_bound"] == pytest.approx(4.5)
    assert result["margin"] > -1e-4  # [m]
    assert result["phase_plane"]["duration"] == pytest.approx(4.5)
    assert result["phase_plane"]["margin"] < -0.3  # [m], the blind motion tips over
    assert result["qp_solver"] == "auto"
    assert result["iterations"] >= 1
    assert result["solve_time"] > 0.0
    slew = result["joints"]["slew"]
    assert slew["peak_rate"] <= slew["rate_limit"] + 1e-9
    assert slew["peak_acceleration"] <= slew["acceleration_limit"] + 1e-9
    assert {"python", "zmp-sqp", "pin", "proxsuite"} <= set(result["versions"])
    assert result["rests_on"]["ground"] == "slope with a roll of -20 and a pitch of 0 degrees"
    assert "joint torques and forces" in result["rests_on"]["not_looked_at"]
    assert "duration [s]" in captured.err  # people still see the table
    assert "The verdict rests on" in captured.err


def names(row: str) -> list[str]:
    """Keys that a row of the help text describes; rows that go on from the one above have none."""
    return row[2:26].split(",") if row[2:3] != " " else []


def test_json_goes_to_a_file_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "result.json"
    assert cli.main(["plan", "paper_1", "--json", str(path), "--no-figures"]) == 0
    assert json.loads(path.read_text())["scenario"] == "paper_1"
    assert str(path) in capsys.readouterr().out


def test_options_overrule_the_scenario(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--intervals", "30", "--margin", "0.2", "--qp-solver", "piqp", "--json", "-"]
    assert cli.main(["plan", "paper_1", *arguments]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["margin"] > 0.2 - 1e-3
    assert result["qp_solver"] == "piqp"


def test_a_time_budget_ends_the_search(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "stretched.toml"
    path.write_text(STRETCHED, encoding="utf-8")
    arguments = ["plan", str(path), "--no-diagnosis", "--json", "-", "--time-budget"]
    assert cli.main([*arguments, "1e-3"]) == 1
    assert json.loads(capsys.readouterr().out)["status"] == "time_budget"
    # nor does a search that ran out of time say what a lighter payload would make possible
    arguments.remove("--no-diagnosis")
    assert cli.main([*arguments, "1e-3"]) == 1
    assert not json.loads(capsys.readouterr().out)["diagnosis"]
    assert cli.main([*arguments, "-1"]) == 2
    assert "time_budget must be positive, not -1.0 s" in capsys.readouterr().err


def test_no_figures_writes_none(tmp_path: Path) -> None:
    assert cli.main(["plan", "paper_1", "--out", str(tmp_path), "--no-figures"]) == 0
    assert {path.suffix for path in tmp_path.iterdir()} == {".csv", ".json"}


def test_without_matplotlib_one_line_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert cli.main(["plan", "paper_1", "--out", str(tmp_path)]) == 0
    assert "zmp-sqp[plots]" in capsys.readouterr().out
    assert (tmp_path / "trajectory.csv").exists()


def test_a_start_in_motion_has_no_phase_plane_to_compare_with(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "moving.toml").write_text(MOVING)
    assert (
        cli.main(["plan", str(tmp_path / "moving.toml"), "--json", "-", "--out", str(tmp_path)])
        == 0
    )
    assert json.loads(capsys.readouterr().out)["phase_plane"] is None


# --- 1: no safe motion --------------------------------------------------------------------------


def test_no_motion_is_a_diagnosis_and_exit_code_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "stretched.toml").write_text(STRETCHED)
    (tmp_path / "trajectory.csv").write_text("of an earlier run")
    options = ["--out", str(tmp_path), "--json", "-", "--intervals", "6"]
    assert cli.main(["plan", str(tmp_path / "stretched.toml"), *options]) == 1
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    assert result["success"] is False
    assert (result["duration"], result["margin"], result["joints"]) == (None, None, None)
    assert result["message"] in captured.err
    assert 0.0 < result["diagnosis"]["largest_payload"] < 4000.0
    assert 0.0 < result["diagnosis"]["steepest_slope"] < 0.35
    assert "For this goal the payload could be" in result["message"]
    assert result == json.loads((tmp_path / "plan.json").read_text())
    # no motion lies about
    assert {path.name for path in tmp_path.iterdir()} == {"stretched.toml", "plan.json"}


# --- 2: bad input -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["paper_1000"], "did you mean paper_1?"),
        (["paper_1", "--intervals", "1"], "intervals"),
        (["paper_1", "--margin", "nan"], "margin"),
        (["paper_1", "--margin", "5"], "margin"),
        (["paper_1", "--qp-solver", "abacus"], "abacus"),
        (["paper_1", "--json", "/no/such/folder/result.json"], "/no/such/folder/result.json"),
        (["paper_1", "--out", "/dev/null/folder"], "/dev/null"),
    ],
)
def test_bad_input_is_one_sentence_on_standard_error(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["plan", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("zmp-sqp: error: ")
    assert words in error
    assert error.count("\n") == 1


def test_a_goal_that_tips_over_at_rest_is_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "tipping.toml").write_text(TIPPING)
    assert cli.main(["plan", str(tmp_path / "tipping.toml")]) == 2
    assert "goal" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments", [[], ["dance"], ["plan"], ["plan", "paper_1", "--intervals", "many"]]
)
def test_argparse_exits_with_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(arguments)
    assert caught.value.code == 2
    assert "usage:" in capsys.readouterr().err


# --- the rest -----------------------------------------------------------------------------------


def test_an_interrupt_is_quiet(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    failing(monkeypatch, KeyboardInterrupt())
    assert cli.main(["plan", "paper_1"]) == 130
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("arguments", [["--json", "-"], ["--verbose"]])
def test_a_reader_that_leaves_early_is_no_error(arguments: list[str]) -> None:
    command = [sys.executable, "-m", "zmp_sqp.cli", "plan", "paper_1", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        error = process.stderr.read()
    assert process.returncode == 141
    assert b"Traceback" not in error


def test_words_outside_the_terminals_alphabet_are_no_error(tmp_path: Path) -> None:
    path = tmp_path / "hang.toml"
    path.write_text('title = "am Böschungsfuß [m]"\n' + MOVING, encoding="utf-8")
    command = [sys.executable, "-m", "zmp_sqp.cli", "plan", str(path)]
    ascii_only = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, env=ascii_only, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "hang: am B\\xf6schungsfu\\xdf [m]" in done.stdout


@pytest.mark.parametrize("arguments", [["--help"], ["plan", "--help"]])
def test_help_lists_scenarios_examples_and_exit_codes(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(arguments)
    assert caught.value.code == 0
    printed = capsys.readouterr().out
    for words in (*shipped_scenarios(), "examples:", "exit codes:"):
        assert words in printed
    assert max(len(line) for line in printed.splitlines()) <= 100


def test_help_of_plan_names_every_key_of_a_scenario(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(["plan", "--help"])
    words = set(re.findall(r"\w+", capsys.readouterr().out))

    def missing(keys: Mapping[str, Any]) -> set[str]:
        inner = [missing(value.keys) for value in keys.values() if hasattr(value, "keys")]
        named = {key for key in keys if key.removesuffix("_deg") in words or key in words}
        return set(keys).difference(named).union(*inner)

    assert not missing(SCHEMA.keys)


def test_help_of_paper_explains_files_keys_and_exit_codes(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(["paper", "--help"])
    assert caught.value.code == 0
    printed = capsys.readouterr().out
    for words in ("examples:", "exit codes:", "time_in_F", "ladder", "paper.json"):
        assert words in printed
    assert max(len(line) for line in printed.splitlines()) <= 110


def test_the_simplified_model_is_a_scenario_like_any_other(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.main(["plan", "paper_1_simplified", "--json", "-"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert 4.5 <= result["duration"] <= 4.505  # [s]
    assert result["joints"]["head"]["peak_rate"] < 1e-12  # [rad/s]


def test_the_package_runs_as_a_module() -> None:
    command = [sys.executable, "-m", "zmp_sqp", "--version"]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    assert found.stdout.startswith("zmp-sqp ")


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(["--version"])
    assert caught.value.code == 0
    assert capsys.readouterr().out.startswith("zmp-sqp ")
