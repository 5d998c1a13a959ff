"""`zmp-sqp chart`: tables, files, exit codes, and what is refused."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp.cli as cli
import zmp_sqp.commands.chart as chart_command
from zmp_sqp.charts import Swing
from zmp_sqp.show.chart_tables import CHART_KEYS

URDF = ["chart", "feller_buncher", "--payload-frame", "head", "--radii", "4", "6"]
HERE = [*URDF, "--heights", "2", "5"]
SWING = ["--swing", "90", "--margin", "0.1"]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("chart") / "new" / "folder"
    assert cli.main([*HERE, *SWING, "--out", str(folder)]) == 0
    return folder


def test_out_holds_tables_figures_and_results(out: Path) -> None:
    pytest.importorskip("matplotlib")
    assert {path.name for path in out.iterdir()} == set(chart_command.CHART_FILES)
    for name in ("chart.png", "swing.png"):
        content = (out / name).read_bytes()
        assert content.startswith(b"\x89PNG\r\n\x1a\n")
        assert 10_000 < len(content) < 400_000


def test_csv_and_json_hold_the_same_loads(out: Path) -> None:
    result = json.loads((out / "chart.json").read_text())
    keys = [
        key.strip()
        for line in CHART_KEYS.splitlines()[1:]
        if line[2:3] != " "
        for key in line.strip().split("  ")[0].split(",")
        if key.strip()
    ]
    assert list(result) == keys
    with (out / "chart.csv").open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == len(result["points"]) == 3 * (4 + 2)
    for line, point in zip(lines, result["points"], strict=True):
        assert float(line["rated"]) == point["rated"]
        assert line["limit"] == point["limit"]
    with (out / "swing.csv").open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    swings = result["swing"]["points"]
    assert [float(line["load"]) for line in lines] == [point["load"] for point in swings]
    assert len(lines) == 4
    assert result["swing"]["complete"] is True
    assert all(0.0 < point["load"] <= point["static_bound"] for point in swings)
    assert result["attachment"] == ["head"]
    assert result["attachment_mass"] == pytest.approx(2600.0)


def test_the_tables_have_heights_down_radii_across_and_a_letter(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.main(HERE) == 0
    printed = capsys.readouterr().out
    for words in (
        "front: rated load [t]",
        "side: rated load [t]",
        "all round: rated load [t]",
        "4 m",
        "max. radius",
        "t tipping",
        "head, 2600 kg",
        "ISO 10567",
        "Level ground",
        "Not a substitute for the maker's load chart.",
    ):
        assert words in printed
    rows = [line.split() for line in printed.splitlines() if line.startswith((" 5 m", " 2 m"))]
    assert [row[0] for row in rows] == ["5", "2"] * 3  # the highest on top
    assert all(len(row) == 2 + 2 * 2 + 2 + 2 for row in rows)
    front, side = rows[0], rows[2]
    assert float(side[5]) < float(front[5])


def test_a_scenario_gives_payload_frame_ground_and_attitude(
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = ["chart", "paper_1", "--radii", "4", "--heights", "7", "--json", "-"]
    assert cli.main(given) == 0
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    assert result["frame"] == "head"
    assert result["com"] == [0.0, 0.0, 3.323]
    assert result["attitude"] == "held"
    assert np.degrees(np.arctan2(result["gravity"][1], -result["gravity"][2])) == pytest.approx(
        20.0
    )
    assert "roll -20" in captured.err
    assert cli.main([*given, "--roll", "-5", "--attitude", "free"]) == 0
    gentler = json.loads(capsys.readouterr().out)
    assert gentler["attitude"] == "free"
    least = [min(p["rated"] for p in found["points"]) for found in (result, gentler)]
    assert least[1] > least[0]


def test_a_load_at_the_nose_of_the_stick_leaves_the_attitude_free(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The scenario's payload is fixed to the stick, which has no joint left to hold it level."""
    assert cli.main(["chart", "excavator_lower", "--heights", "0", "2", "--json", "-"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["frame"] == "stick"
    assert result["attitude"] == "free"
    assert result["attachment"] == ["bucket"]
    assert max(point["radius"] for point in result["points"]) > 8.0  # [m]


def test_control_c_leaves_what_was_done(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = Swing.loads

    def interrupted(self: Swing):
        yield next(whole(self))
        raise KeyboardInterrupt

    monkeypatch.setattr(Swing, "loads", interrupted)
    code = cli.main([*HERE, *SWING, "--out", str(tmp_path), "--no-figures"])
    assert code == 130
    assert "Interrupted: 1 points are done; ?: not computed." in capsys.readouterr().out
    result = json.loads((tmp_path / "chart.json").read_text())
    assert result["swing"]["complete"] is False
    assert len(result["swing"]["points"]) == 1
    assert len((tmp_path / "swing.csv").read_text().splitlines()) == 2
    assert len(result["points"]) == 18


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["chart", "feller_buncher"], "say which frame lifts the load"),
        (["chart", "feller_buncher", "--payload-frame", "hand"], "there is no frame 'hand'"),
        (["chart", "no_such_machine"], "no_such_machine"),
        (["chart", "no_such.toml"], "no such scenario"),
        (["chart", "retreat"], "its base drives"),
        (["chart", "paper_1", "--limits", "limits.yaml"], "--limits is for a URDF"),
        ([*HERE, "--duration", "5"], "--duration is for a swing"),
        ([*HERE, "--swing", "180", "--duration", "1"], "takes at least 4.5 s"),
        ([*HERE, "--swing", "0"], "swing angle must not be zero"),
        ([*HERE, "--attitude", "held"], "give a scenario"),
        ([*HERE, "--roll", "60"], "tips over on this slope without a load"),
        ([*HERE, "--tipping-fraction", "2"], "tipping_fraction must lie within"),
        ([*URDF, "--heights", "5", "2"], "heights must increase"),
        ([*URDF, "--heights", "40"], "reaches none of the points"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(arguments) == 2
    complaint = capsys.readouterr().err
    assert complaint.startswith("zmp-sqp: error: ")
    assert words in complaint
    assert "Traceback" not in complaint
