"""`zmp-sqp replay`: exit codes, files, what goes where, and what is refused."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

import zmp_sqp.cli as cli
from tests.test_cli import STRETCHED
from zmp_sqp.commands.replay import REPLAY_FILES, REPLAY_KEYS
from zmp_sqp.scenario import load_scenario

pytestmark = pytest.mark.physics
MOTION_KEYS = {
    "duration",
    "margin",
    "nominal_margin",
    "max_tilt",
    "lift",
    "lift_at",
    "lifted_at",
    "tipped",
    "pivot",
    "least_edge_load",
    "least_loaded_edge",
    "least_loads",
    "slide",
    "tracking_error",
    "fell",
}


@pytest.fixture(autouse=True)
def _engine() -> None:
    pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("planned")
    assert cli.main(["plan", "paper_1", "--no-figures", "--out", str(folder)]) == 0
    return folder


def test_a_scenario_is_replayed_beside_the_phase_plane(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["replay", "paper_1", "--out", str(tmp_path / "new" / "folder")]) == 0
    printed = capsys.readouterr().out
    for words in (
        "stands",
        "tips over left at 1.14 s",
        "maximal tilt",
        "least load of a track",
        "(right)",
    ):
        assert words in printed
    result = json.loads((tmp_path / "new" / "folder" / "replay.json").read_text())
    assert list(result["motions"]) == ["planned", "phase plane"]
    assert set(result["motions"]["planned"]) == MOTION_KEYS
    assert result["motions"]["planned"]["tipped"] is False
    assert result["motions"]["phase plane"]["tipped"] is True
    assert "mujoco" in result["versions"]
    assert result["rests_on"]["payload"] == "4,000 kg at (0, 0, 3.323) m of head"
    assert "The verdict rests on" in printed
    assert "time step 0.001 s" in " ".join(printed.split())
    strip = tmp_path / "new" / "folder" / "replay.png"
    assert strip.stat().st_size > 5000 if strip.exists() else "no pictures" in printed
    assert not (tmp_path / "new" / "folder" / REPLAY_FILES[-1]).exists()


def test_every_key_is_explained() -> None:
    assert all(key in REPLAY_KEYS for key in MOTION_KEYS)


def test_the_file_of_a_plan_is_replayed_on_its_scenario(
    planned: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["replay", str(planned / "trajectory.csv"), "--json", "-"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["scenario"] == "paper_1"
    assert list(result["motions"]) == ["file"]


def test_a_file_that_tips_the_machine_over_exits_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import zmp_sqp as zs

    problem = load_scenario("paper_1").problem
    path = tmp_path / "fast.csv"
    zs.phase_plane(problem.machine, problem.start, problem.goal).to_csv(path)
    assert (
        cli.main(
            ["replay", str(path), "--scenario", "paper_1", "--no-pictures", "--out", str(tmp_path)]
        )
        == 1
    )
    assert "tips over left" in capsys.readouterr().out
    assert not (tmp_path / "replay.png").exists()


def test_without_a_plan_the_baseline_is_replayed_and_the_exit_code_is_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = tmp_path / "stretched.toml"
    scenario.write_text(STRETCHED, encoding="utf-8")
    assert cli.main(["replay", str(scenario), "--json", str(tmp_path / "result.json")]) == 1
    result = json.loads((tmp_path / "result.json").read_text())
    assert list(result["motions"]) == ["phase plane"]
    assert result["message"] in capsys.readouterr().out.replace("\n", " ")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["retreat"], "base drives"),
        (["no_such_scenario"], "no such scenario"),
        (["motion.csv"], "--scenario"),
        (["motion.csv", "--scenario", "paper_1"], "cannot read motion.csv"),
        (["motion.csv", "--scenario", "paper_1", "--margin", "0.1"], "--margin is for planning"),
        (["paper_1", "--scenario", "paper_2"], "--scenario"),
        (["paper_1", "--time-step", "0.1"], "time_step must be"),
    ],
)
def test_bad_input_exits_2_with_one_line(
    arguments: list[str],
    complaint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["replay", *arguments]) == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert error.count("\n") == 1


def test_a_missing_engine_exits_2_before_the_work(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert cli.main(["replay", "paper_1"]) == 2
    assert "pip install zmp-sqp[sim]" in capsys.readouterr().err


def test_a_motion_that_cannot_be_drawn_is_still_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "PIL.Image", None)
    assert cli.main(["replay", "paper_1", "--out", str(tmp_path)]) == 0
    assert "no pictures: a picture of a replay needs Pillow" in capsys.readouterr().out.replace(
        "\n", " "
    )
    assert (tmp_path / "replay.json").exists()


def test_help_says_that_a_base_has_to_stand(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(["replay", "--help"])
    assert "plans whose base drives cannot be replayed" in " ".join(capsys.readouterr().out.split())


def test_a_ctrl_c_leaves_the_simulations_that_are_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import zmp_sqp.commands.replay as command

    simulate, calls = command.replay, []

    def once(*arguments: Any, **options: Any) -> Any:
        calls.append(arguments)
        if len(calls) > 1:
            raise KeyboardInterrupt
        return simulate(*arguments, **options)

    monkeypatch.setattr(command, "replay", once)
    out = tmp_path / "out"
    assert cli.main(["replay", "paper_1", "--out", str(out)]) == 130
    assert "interrupted, without: simulation: phase plane, pictures" in capsys.readouterr().out
    found = json.loads((out / "replay.json").read_text(encoding="utf-8"))
    assert list(found["motions"]) == ["planned"]
    assert not found["motions"]["planned"]["tipped"]
