"""`zmp-sqp check PLAN.json`: motion, scenario and margin of the file; the second opinion in it."""

from __future__ import annotations

import json
import random
import shutil
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

import zmp_sqp as zs
from zmp_sqp.cli import main
from zmp_sqp.report import make_page
from zmp_sqp.scenario import load_scenario

Capture = pytest.CaptureFixture[str]


def planned(folder: Path, scenario: str, *options: str) -> Path:
    """The plan.json of a scenario."""
    always = ["--intervals", "12", "--no-figures", "--no-diagnosis"]
    assert main(["plan", scenario, "--out", str(folder), *always, *options]) in (0, 1)
    return folder / "plan.json"


def checked(path: Path, *options: str, code: int = 0, capsys: Capture) -> dict[str, Any]:
    capsys.readouterr()
    assert main(["check", str(path), *options, "--json", "-"]) == code
    result: dict[str, Any] = json.loads(capsys.readouterr().out)
    return result


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return planned(tmp_path_factory.mktemp("plan"), "paper_1", "--margin", "0.1")


@pytest.mark.parametrize("name", ["paper_1", "torque", "retreat", "terrain"])
def test_a_plan_is_checked_from_its_file_alone(name: str, tmp_path: Path, capsys: Capture) -> None:
    path = planned(tmp_path, name)
    said = json.loads(path.read_text(encoding="utf-8"))
    result = checked(path, capsys=capsys)
    assert result["safe"]
    assert result["duration"] == said["duration"]
    assert result["motion"]["interpolation"] == "exact"
    for mine, other in zip(result["guarantees"], said["guarantees"], strict=True):
        assert mine["name"] == other["name"]
        assert mine["value"] == pytest.approx(other["value"], rel=1e-9, abs=1e-9)
    assert result["margin"] == pytest.approx(said["margin"], abs=1e-9)
    assert result["hints"] == []


def test_the_margin_of_the_command_line_is_asked_for_again(plan: Path, capsys: Capture) -> None:
    result = checked(plan, capsys=capsys)
    assert result["required"] == 0.1  # the scenario's own is zero
    assert result["margin"] >= 0.1
    more = checked(plan, "--margin", "0.3", code=1, capsys=capsys)
    assert more["required"] == 0.3


def test_a_scenario_or_a_machine_may_be_given_beside_the_file(plan: Path, capsys: Capture) -> None:
    result = checked(plan, "--scenario", "paper_1", capsys=capsys)
    assert result["required"] == 0.0
    assert checked(plan, "--scenario", "paper_1_upright", capsys=capsys)["safe"] in (True, False)
    assert main(["check", "feller_buncher", str(plan), "--json", "-"]) == 0  # level, no payload
    level = json.loads(capsys.readouterr().out)
    assert level["margin"] > result["margin"]


def test_a_motion_that_was_changed_is_not_what_the_file_says(
    plan: Path, tmp_path: Path, capsys: Capture
) -> None:
    content = json.loads(plan.read_text(encoding="utf-8"))
    problem = load_scenario("paper_1").problem
    blind = zs.phase_plane(problem.machine, problem.start, problem.goal)
    blind.to_json(tmp_path / "blind.json")
    content["trajectory"] = json.loads((tmp_path / "blind.json").read_text(encoding="utf-8"))
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    result = checked(path, code=1, capsys=capsys)
    assert not result["safe"]
    assert result["margin"] < -0.3
    [hint] = result["hints"]
    assert "says that the guaranteed margin is 0.100 m" in hint


def test_the_second_opinion_is_added_to_the_file_and_shown_in_its_report(
    plan: Path, tmp_path: Path, capsys: Capture
) -> None:
    pytest.importorskip("flint")
    path = tmp_path / "plan.json"
    shutil.copy(plan, path)
    before = json.loads(path.read_text(encoding="utf-8"))
    assert before["rigorous"] is None
    result = checked(path, "--rigorous", capsys=capsys)
    after = json.loads(path.read_text(encoding="utf-8"))
    assert after["rigorous"] == result["rigorous"]
    assert after["rigorous"]["confirmed"]
    tip = after["rigorous"]["guarantees"][0]
    assert tip["required"] == pytest.approx(before["margin"], abs=1e-12)
    assert {key: value for key, value in after.items() if key != "rigorous"} == {
        key: value for key, value in before.items() if key != "rigorous"
    }
    assert list(after) == list(before)
    assert "A second opinion in ball arithmetic confirms" in make_page([after])
    assert [file.name for file in tmp_path.iterdir()] == ["plan.json"]
    # and what the command writes of it is what `plan --rigorous` writes
    again = planned(tmp_path / "again", "paper_1", "--margin", "0.1", "--rigorous")
    assert json.loads(again.read_text(encoding="utf-8"))["rigorous"] == after["rigorous"]


def test_a_question_of_ones_own_is_not_added(plan: Path, tmp_path: Path, capsys: Capture) -> None:
    pytest.importorskip("flint")
    path = tmp_path / "plan.json"
    shutil.copy(plan, path)
    checked(path, "--rigorous", "--margin", "0.2", code=1, capsys=capsys)
    assert path.read_bytes() == plan.read_bytes()
    assert main(["check", str(path), "--rigorous", "--margin", "0.05"]) == 0
    assert "is left as it is" in capsys.readouterr().out
    main(["check", str(path), "--rigorous", "--noise", "1e-4"])
    assert "is left as it is" in capsys.readouterr().out
    checked(path, "--rigorous", "--scenario", "paper_1", capsys=capsys)
    assert path.read_bytes() == plan.read_bytes()


def own_scenario(folder: Path) -> Path:
    """A scenario with a URDF of its own beside it."""
    folder.mkdir()
    shipped = zs.shipped_machines()["feller_buncher"]
    shutil.copy(shipped, folder / "mine.urdf")
    limits = shipped.with_name("feller_buncher.joint_limits.yaml")
    shutil.copy(limits, folder / "mine.joint_limits.yaml")
    text = load_scenario("paper_1").path.read_text(encoding="utf-8")
    path = folder / "swing.toml"
    path.write_text(text.replace('name = "feller_buncher"', 'urdf = "mine.urdf"'), encoding="utf-8")
    return path


def test_files_of_a_scenario_are_found_where_it_is_or_beside_the_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    scenario = own_scenario(tmp_path / "scenarios")
    monkeypatch.chdir(scenario.parent)
    path = planned(tmp_path / "out", scenario.name)
    monkeypatch.chdir(tmp_path)
    said = json.loads(path.read_text(encoding="utf-8"))
    assert said["scenario_path"] == str(scenario.resolve())
    assert checked(path, capsys=capsys)["safe"]
    # the folder has gone: a sentence, until the files lie beside the plan
    scenario.parent.rename(tmp_path / "elsewhere")
    assert main(["check", str(path)]) == 2
    error = capsys.readouterr().err
    assert "mine.urdf" in error
    assert "--scenario" in error
    assert error.count("\n") == 1
    for name in ("mine.urdf", "mine.joint_limits.yaml"):
        shutil.copy(tmp_path / "elsewhere" / name, path.parent)
    assert checked(path, capsys=capsys)["safe"]
    given = str(tmp_path / "elsewhere" / "swing.toml")
    assert checked(path, "--scenario", given, capsys=capsys)["safe"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda content: content.clear(), "not a plan.json"),
        (lambda content: content.update(trajectory=None), "it holds no motion"),
        (lambda content: content.update(trajectory=[1]), "the file is damaged"),
        (lambda content: content["trajectory"].update(points="x"), "points"),
        (lambda content: content["trajectory"].update(joint_names=["a"]), "joint"),
        (lambda content: content.update(scenario_text="= ="), "no TOML"),
        (lambda content: content.update(scenario_text="[plan]"), "machine"),
        (lambda content: content.update(scenario_text=7), "the file is damaged"),
        (lambda content: content.update(margin_asked="x"), "the file is damaged"),
        (lambda content: content.update(margin_asked=-1.0), "margin"),
        (lambda content: content.pop("scenario_text"), "made by an earlier version"),
        (lambda content: content["trajectory"]["points"][3].update(positions=[None] * 5), "point"),
    ],
)
def test_damaged_files_get_one_sentence(
    plan: Path, tmp_path: Path, change: Any, words: str, capsys: Capture
) -> None:
    content = json.loads(plan.read_text(encoding="utf-8"))
    change(content)
    path = tmp_path / "damaged.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    assert main(["check", str(path)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("zmp-sqp: error: ")
    assert words in error
    assert str(path) in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["feller_buncher"], "alone says no machine or no motion"),
        (["motion.csv"], "alone says no machine or no motion"),
        (["nothing.json"], "No such file"),
        (["text.json"], "not a JSON file"),
        (["list.json"], "not a plan.json"),
        (["list.json", "--scenario", "paper_1"], "points"),
        (["PLAN", "--roll", "3"], "answers what --roll says"),
        (["PLAN", "--joints", "slew"], "answers what --joints says"),
        (["feller_buncher", "PLAN", "--scenario", "paper_1"], "leave out URDF"),
    ],
)
def test_wrong_arguments_get_one_sentence(
    plan: Path,
    arguments: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Capture,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("text.json").write_text("{", encoding="utf-8")
    Path("list.json").write_text("[1]", encoding="utf-8")
    given = [str(plan) if word == "PLAN" else word for word in arguments]
    assert main(["check", *given]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("seed", range(25))
def test_random_damage_is_refused_or_unsafe_and_never_a_traceback(
    plan: Path, tmp_path: Path, seed: int, capsys: Capture
) -> None:
    """One entry, at any depth, becomes something else."""
    content = json.loads(plan.read_text(encoding="utf-8"))
    before = deepcopy(content)
    choose = random.Random(seed)
    keys = ["trajectory", "scenario_text", "scenario", "margin_asked", "margin", "scenario_path"]
    at: Any = content
    key: Any = keys[seed % len(keys)]
    while isinstance(at[key], dict | list) and at[key] and choose.random() < 0.9:
        at = at[key]
        key = choose.choice(list(at) if isinstance(at, dict) else range(len(at)))
    at[key] = choose.choice([None, True, -1e300, 1e300, 3, "", "\0", "x", [], {}, [[1.0]]])
    path = tmp_path / "damaged.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    code = main(["check", str(path)])
    error = capsys.readouterr().err
    assert code in (0, 1, 2)
    assert (code == 2) == ("error:" in error)
    if code == 0:  # nothing that the verdict rests on was hit
        rests = ("scenario_text", "margin_asked")
        assert all(content[name] == before[name] for name in rests)


def test_a_plan_whose_motion_goes_elsewhere_is_told_of(
    plan: Path, tmp_path: Path, capsys: Capture
) -> None:
    """The margin does not show it: the paper's heads are point masses."""
    content = json.loads(plan.read_text(encoding="utf-8"))
    trajectory = content["trajectory"]
    for point in trajectory["points"]:
        point["positions"][4] += 1.0
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    assert checked(plan, capsys=capsys)["hints"] == []
    main(["check", str(path)])
    said = " ".join(capsys.readouterr().out.split())
    assert "begins elsewhere than at the start of the scenario: head is 1 rad away" in said
    assert "ends elsewhere than at the goal of the scenario: head is 1 rad away" in said
