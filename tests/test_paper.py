"""`zmp-sqp paper`: what it computes, prints and writes, and when its exit code is 1."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import zmp_sqp.cli as cli
import zmp_sqp.commands.paper as paper_command
import zmp_sqp.paper.runs as paper
from zmp_sqp.paper.driving import TOGETHER, driving_failures
from zmp_sqp.paper.ladder import ladder
from zmp_sqp.paper.tables import ladder_overview, ladder_sheet, markdown, sheets

pytest.importorskip("matplotlib")

ROOT = Path(__file__).resolve().parents[1]
PAPER = 4.5  # [s]
GRID = 1e-3  # relative: the tolerance on durations
SLEW = 2e-3  # relative: likewise, analytic slew against the SQP


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("paper") / "new"
    assert cli.main(["paper", "--out", str(folder), "--no-ladder", "--repeats", "1"]) == 0
    return folder


@pytest.fixture(scope="module")
def result(out: Path) -> dict[str, Any]:
    return json.loads((out / "paper.json").read_text())


def planner(result: dict[str, Any], test: str, name: str) -> dict[str, Any]:
    return next(entry for entry in result["tests"] if entry["name"] == test)["planners"][name]


# --- the paper's claims -------------------------------------------------------------------------


@pytest.mark.parametrize("test", ["test_1", "test_2"])
@pytest.mark.parametrize("name", ["phase plane", "full", "simplified"])
def test_every_planner_takes_the_papers_time(result: dict[str, Any], test: str, name: str) -> None:
    assert planner(result, test, name)["duration"] == pytest.approx(PAPER, rel=GRID)


def test_blind_motions_leave_the_polygon_and_ours_do_not(result: dict[str, Any]) -> None:
    assert {entry["name"] for entry in result["tests"]} == set(paper.TESTS)
    for entry in result["tests"]:
        assert entry["planners"]["phase plane"]["margin"] < -0.3  # [m]
        assert all(entry["planners"][model]["margin"] >= 0.0 for model in paper.MODELS)


def test_the_base_backs_up_beside_the_arm_with_the_zmp_inside(result: dict[str, Any]) -> None:
    blind, *ways = next(entry for entry in result["tests"] if entry["name"] == "test_2")["base"]
    assert blind["margin"] < -0.3
    assert [way["distance"] for way in ways] == list(paper.DISTANCES)
    for way in ways:
        assert way["margin"] >= -paper.MARGIN_TOLERANCE
        assert way["lower"] < 0.0 < way["upper"]
        assert 0.0 < way["factor"] <= 1.0
        assert way["peak_acceleration"] <= paper.BASE["max_acceleration"] + 1e-9


def test_base_and_arm_together_are_as_fast_as_two_steps_or_faster_and_as_safe(
    result: dict[str, Any],
) -> None:
    rows = result["driving"]
    assert len(rows) == 3 * len(paper.DISTANCES)
    assert all(row["success"] and 0.0 <= row["margin"] <= row["sampled"] for row in rows)
    for distance in paper.DISTANCES:
        *steps, together = (row for row in rows if row["distance"] == distance)
        assert together["planner"] == TOGETHER
        assert together["duration"] == pytest.approx(PAPER, rel=GRID)
        assert all(together["duration"] <= (1.0 + GRID) * row["duration"] for row in steps)
    simplified = next(row for row in rows if row["distance"] == -6.0)
    # the arm's motion leaves the base little room: it waits
    assert simplified["duration"] > 1.1 * PAPER


def test_the_analytic_slew_agrees_with_the_sqp(result: dict[str, Any]) -> None:
    assert len(result["slews"]) == len(paper.SLEWS)
    for row in result["slews"]:
        assert row["analytic"] == pytest.approx(row["sqp"], rel=SLEW)


def test_times_are_given_in_seconds_and_in_units_of_derivative_calls(
    result: dict[str, Any],
) -> None:
    for entry in result["tests"]:
        for model in paper.MODELS:
            assert entry["planners"][model]["time"] > 0.0
            assert entry["planners"][model]["time_in_F"] > 1.0


# --- what is written ----------------------------------------------------------------------------


def test_out_holds_tables_results_and_figures(out: Path, result: dict[str, Any]) -> None:
    assert {path.name for path in out.iterdir()} == set(paper_command.PAPER_FILES)
    for path in out.glob("*.png"):
        assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
        assert 10_000 < path.stat().st_size < 200_000
    written = (out / "paper.md").read_text()
    for sheet in sheets(result):
        assert markdown(sheet) in written
    assert "> 18000" in written
    assert result["failures"] == []


def test_json_holds_what_the_help_explains(result: dict[str, Any]) -> None:
    explained = [
        line.split()[0]
        for line in paper_command.PAPER_KEYS.splitlines()
        if line.startswith("  ") and line[2] != " "
    ]
    assert set(result) <= set(explained)


# --- the ladder ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def rungs() -> list[dict[str, Any]]:
    """Four rungs: costs nothing, costs the simplified model time, no motion, refused."""
    return list(ladder(((2000.0, -10.0), (3000.0, -50.0), (8000.0, -10.0), (10000.0, -50.0))))


def test_the_ladder_climbs_until_the_zmp_costs_time_and_then_until_there_is_no_motion(
    rungs: list[dict[str, Any]],
) -> None:
    full, simplified = rungs[::2], rungs[1::2]
    assert [rung["model"] for rung in rungs] == ["full", "simplified"] * 4
    assert [rung["success"] for rung in full] == [True, True, True, False]
    assert [rung["success"] for rung in simplified] == [True, True, False, False]
    assert simplified[0]["duration"] == pytest.approx(PAPER, rel=GRID)
    assert simplified[1]["duration"] > 1.05 * simplified[1]["lower_bound"]
    assert simplified[1]["duration"] > full[1]["duration"]
    assert "tips" in simplified[2]["message"]
    assert simplified[3]["status"] == "refused"
    assert "at rest at the start" in simplified[3]["message"]


def test_the_ladders_tables_say_why_not(rungs: list[dict[str, Any]]) -> None:
    reasons = [row[-1] for row in ladder_sheet(rungs).rows]
    assert reasons[:5] == [""] * 5
    assert reasons[5].startswith("left edge by ")
    assert reasons[6:] == ["tips over at rest at the start"] * 2
    overview = ladder_overview(rungs)
    assert overview.columns == ("payload", "reach 1.53 m", "reach 5.41 m")
    assert overview.rows[-1] == ("10 t", "tips over at rest", "tips over at rest")


# --- exit codes and the rest --------------------------------------------------------------------


def test_what_should_be_safe_and_is_not_is_exit_code_1(
    result: dict[str, Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    spoilt = json.loads(json.dumps(result))
    planner(spoilt, "test_1", "simplified")["margin"] = -0.2
    found = paper.failures(spoilt)
    assert len(found) == 1
    assert "leaves the polygon by 0.2 m" in found[0]
    monkeypatch.setattr(
        paper_command, "paper_result", lambda **_: (spoilt | {"failures": found}, {})
    )
    assert cli.main(["paper", "--no-figures"]) == 1
    assert found[0] in capsys.readouterr().out


def test_each_claim_can_fail(result: dict[str, Any]) -> None:
    for change in (
        lambda spoilt: planner(spoilt, "test_1", "full").update(duration=4.6),
        lambda spoilt: planner(spoilt, "test_2", "full").update(
            success=False, duration=None, margin=None
        ),
        lambda spoilt: spoilt["tests"][-1]["base"][1].update(margin=-0.1),
        lambda spoilt: spoilt["slews"][0].update(sqp=None),
        lambda spoilt: spoilt["slews"][1].update(analytic=5.0),
    ):
        spoilt = json.loads(json.dumps(result))
        change(spoilt)
        assert len(paper.failures(spoilt)) == 1


def test_each_claim_about_the_base_can_fail(result: dict[str, Any]) -> None:
    for row, change in ((2, {"margin": -0.1}), (0, {"success": False}), (3, {"duration": 4.0})):
        spoilt = json.loads(json.dumps(result["driving"]))
        spoilt[row].update(change)
        assert len(driving_failures(spoilt)) == 1


def test_json_on_standard_output_is_all_there_is(
    result: dict[str, Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(paper_command, "paper_result", lambda **_: (result, {}))
    assert cli.main(["paper", "--json", "-"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out) == result
    assert "computation, simplified" in captured.err


@pytest.mark.parametrize("count", ["0", "many"])
def test_repeats_must_be_a_count(count: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(["paper", "--repeats", count])
    assert caught.value.code == 2
    assert "at least 1" in capsys.readouterr().err


def test_a_folder_that_cannot_be_made_is_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["paper", "--out", "/dev/null/folder"]) == 2
    assert "/dev/null" in capsys.readouterr().err


# --- the page -----------------------------------------------------------------------------------


def test_the_pages_tables_are_those_of_the_benchmark() -> None:
    from benchmarks.paper import PAGE, RESULTS, page_tables

    assert page_tables(json.loads(RESULTS.read_text())) in PAGE.read_text(encoding="utf-8")


def test_a_ctrl_c_in_the_ladder_leaves_the_rest(
    result: dict[str, Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("run_test", "run_driving", "run_slews"):
        monkeypatch.setattr(paper_command, name, lambda *_, **__: None)
    monkeypatch.setattr(paper_command, "TESTS", {})
    monkeypatch.setattr(paper_command, "failures", lambda _: [])
    monkeypatch.setattr(paper_command, "driving_failures", lambda _: [])
    done: list[Any] = []

    def rung(rungs: Any) -> list[Any]:
        if done:
            raise KeyboardInterrupt
        done.extend(rungs)
        return [rungs[0]]

    monkeypatch.setattr(paper_command, "ladder", rung)
    found, _ = paper_command.paper_result(rungs=((0.0, -30.0), (1e3, -30.0)))
    assert found["interrupted"]
    assert found["ladder"] == [(0.0, -30.0)]
    partial = result | {"interrupted": True}
    monkeypatch.setattr(paper_command, "paper_result", lambda **_: (partial, {}))
    assert cli.main(["paper", "--no-figures"]) == 130
    assert "interrupted: the rest of the ladder is missing" in capsys.readouterr().out
