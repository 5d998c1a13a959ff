"""Commands of studies: batch, envelope, tradeoff, and the keys that they vary."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import zmp_sqp as zs
from zmp_sqp.cli import main
from zmp_sqp.commands import executors, study_options
from zmp_sqp.commands.tradeoff import _not_slower_than_larger_margins
from zmp_sqp.errors import ScenarioError
from zmp_sqp.scenario import load_scenario, read_content, scenario_of
from zmp_sqp.scenario.variation import varied
from zmp_sqp.show.study_tables import envelope_tables
from zmp_sqp.studies.journal import Journal

JOINTS = ("slew", "boom", "stick", "tilt", "head")


def lines(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def test_a_batch_plans_what_it_can_and_goes_on_where_it_ended(tmp_path, capsys):
    broken = tmp_path / "broken.toml"
    broken.write_text("[machine\n", encoding="utf-8")
    out = tmp_path / "plans.jsonl"
    given = ["paper_1", str(broken), "paper_1_rigid"]
    assert main(["batch", *given, given[0], "--out", str(out), "--workers", "1"]) == 1
    assert "more than once are planned once" in capsys.readouterr().out
    rows = {row["scenario"]: row for row in lines(out)}
    assert set(rows) == set(given)
    assert rows[str(broken)]["status"] == "refused"
    assert "not a TOML file" in rows[str(broken)]["message"]
    plan = zs.plan(load_scenario("paper_1").problem)
    assert rows["paper_1"]["duration"] == plan.duration
    assert rows["paper_1"]["margin"] == plan.margin

    # without --resume nothing is overwritten
    assert main(["batch", *given, "--out", str(out)]) == 2
    assert "--resume" in capsys.readouterr().err

    # half a line of a killed run, a changed file and a new scenario are planned; the rest stays
    text = out.read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [line for line in text if '"paper_1"' in line or str(broken) in line]
    out.write_text("".join(kept) + '{"scenario": "paper_1_ri', encoding="utf-8")
    broken.write_text(
        (Path(zs.__file__).parent / "scenarios" / "paper_1.toml").read_text(), "utf-8"
    )
    assert main(["batch", *given, "--out", str(out), "--resume", "--workers", "1"]) == 0
    again = {row["scenario"]: row for row in lines(out)}
    assert set(again) == set(given)
    assert again["paper_1"] == rows["paper_1"]
    assert again[str(broken)]["duration"] == plan.duration
    assert "1 of 3 are there already" in capsys.readouterr().out


def test_a_resumed_batch_counts_only_what_it_was_asked(tmp_path, capsys):
    out = tmp_path / "plans.jsonl"
    assert main(["batch", "paper_1", "paper_1_rigid", "--out", str(out), "--workers", "1"]) == 0
    broken = tmp_path / "broken.toml"
    broken.write_text("[machine\n", encoding="utf-8")
    capsys.readouterr()
    assert main(["batch", str(broken), "--out", str(out), "--resume"]) == 1
    printed = capsys.readouterr().out
    assert "0 of 1 scenarios have a safe motion" in printed
    assert printed.count(str(broken)) == 1
    assert main(["batch", "paper_1", "--out", str(out), "--resume"]) == 0
    assert "1 of 1 scenarios have a safe motion\n" in capsys.readouterr().out
    assert len(lines(out)) == 3


@pytest.mark.parametrize("damage", [b"[1, 2]\n{}\n", b"null\n{}\n", b"\xff\xfe\n{}\n"])
def test_a_file_of_something_else_is_not_resumed(damage, tmp_path, capsys):
    out = tmp_path / "plans.jsonl"
    out.write_bytes(damage)
    assert main(["batch", "paper_1", "--out", str(out), "--resume"]) == 2
    assert "line 1 is no" in capsys.readouterr().err
    assert out.read_bytes() == damage


def test_parquet_has_the_rows_of_the_lines(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    out = tmp_path / "plans.parquet"
    assert main(["batch", "paper_1", "--out", str(out), "--workers", "1"]) == 0
    (row,) = parquet.read_table(out).to_pylist()
    assert row["scenario"] == "paper_1"
    assert row["success"] is True
    assert not list(tmp_path.glob("*.part*"))
    # resuming a finished file plans nothing
    assert main(["batch", "paper_1", "--out", str(out), "--resume"]) == 0
    assert parquet.read_table(out).to_pylist() == [row]


def test_a_refused_scenario_takes_no_columns_from_the_others(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    broken = tmp_path / "broken.toml"
    broken.write_text("[machine\n", encoding="utf-8")
    out = tmp_path / "plans.parquet"
    assert main(["batch", str(broken), "paper_1", "--out", str(out), "--workers", "1"]) == 1
    found = parquet.read_table(out)
    assert [str(found.schema.field(name).type) for name in ("duration", "margin")] == ["double"] * 2
    rows = {row["status"]: row for row in found.to_pylist()}
    assert rows["refused"]["duration"] is None
    assert rows["fastest_possible"]["duration"] > 0.0
    # a file of refused scenarios alone has the same columns
    alone = tmp_path / "refused.parquet"
    assert main(["batch", str(broken), "--out", str(alone), "--workers", "1"]) == 1
    assert parquet.read_schema(alone).names == found.schema.names


def test_a_batch_goes_on_only_where_nothing_has_changed(tmp_path, capsys):
    """Limits in a file beside the URDF, and options of planning, change what a result says."""
    package = Path(zs.__file__).parent
    shipped = package.parent / "urdf" / "feller_buncher.urdf"
    urdf = tmp_path / "machine.urdf"
    urdf.write_text(shipped.read_text("utf-8"), "utf-8")
    limits = shipped.with_name("feller_buncher.joint_limits.yaml").read_text("utf-8")
    (tmp_path / "machine.joint_limits.yaml").write_text(limits, "utf-8")
    scenario = tmp_path / "own.toml"
    text = (package / "scenarios" / "paper_1.toml").read_text("utf-8")
    scenario.write_text(text.replace('name = "feller_buncher"', 'urdf = "machine.urdf"'), "utf-8")
    assert scenario.read_text("utf-8") != text

    def durations(*options: str) -> list[float]:
        out = tmp_path / "plans.jsonl"
        main(["batch", str(scenario), "--out", str(out), "--resume", "--workers", "1", *options])
        return [row["duration"] for row in lines(out)]

    first = durations()
    assert durations() == first
    assert "1 of 1 are there already" in capsys.readouterr().out
    assert len(durations("--time-budget", "5")) == 1
    assert "already" not in capsys.readouterr().out
    slower = limits.replace("1.5707963267948966", "0.15707963267948966")
    (tmp_path / "machine.joint_limits.yaml").write_text(slower, "utf-8")
    (again,) = durations()
    assert again > 1.5 * first[0]


def test_a_journal_survives_a_kill_and_refuses_damage(tmp_path):
    out = tmp_path / "rows.jsonl"
    with Journal(out, resume=False) as journal:
        journal.add({"a": 1.5, "b": float("nan")})
        assert lines(out) == [{"a": 1.5, "b": None}]  # written at once
    out.write_text('{"a": 1.5}\nnonsense\n{"a": 2.0}\n', encoding="utf-8")
    with pytest.raises(zs.ProblemError, match="line 2 is no JSON"):
        Journal(out, resume=True)
    with pytest.raises(zs.ProblemError, match=r"\.jsonl or \.parquet"):
        Journal(tmp_path / "rows.csv", resume=False)


def test_an_envelope_is_that_of_single_plans(tmp_path, capsys):
    out = tmp_path / "envelope"
    arguments = ["--x", "ground.roll_deg", "-20", "40", "2", "--y", "machine.payload.mass"]
    arguments += ["1000", "4000", "2", "--workers", "1", "--out", str(out)]
    assert main(["envelope", "paper_1", *arguments]) == 0
    text = capsys.readouterr().out
    assert "pairs have a safe motion" in text
    with (out / "envelope.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4
    content, path = read_content("paper_1")
    for row in rows:
        values = {key: float(row[key]) for key in ("ground.roll_deg", "machine.payload.mass")}
        if row["status"] == "refused":
            with pytest.raises(ScenarioError, match=re.escape(row["message"])):
                scenario_of(varied(content, values, JOINTS), path)
            continue
        plan = zs.plan(scenario_of(varied(content, values, JOINTS), path).problem)
        assert row["success"] == str(plan.success)
        if plan.success:
            assert float(row["duration"]) == plan.duration
            assert float(row["margin"]) == plan.margin
    assert (out / "envelope.png").stat().st_size > 10_000


ENVELOPE = ["envelope", "paper_1", "--x", "ground.roll_deg", "-20", "40", "3"]
ENVELOPE += ["--y", "plan.margin", "0", "0.2", "2", "--no-figures"]


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "envelope.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_a_study_goes_on_where_it_was_interrupted(tmp_path, capsys, monkeypatch):
    out, asked, most = tmp_path / "cut", [], [2]

    def interruptible(problems, *arguments, **options):
        asked.append(len(problems))
        for count, one in enumerate(zs.plan_many(problems, *arguments, **options)):
            if count == most[0]:
                raise KeyboardInterrupt
            yield one

    monkeypatch.setattr(study_options, "plan_many", interruptible)
    arguments = [*ENVELOPE, "--workers", "1", "--out", str(out)]
    assert main(arguments) == 130
    assert "interrupted: --resume plans what is left" in capsys.readouterr().out
    part = out / "envelope.part.jsonl"
    assert len(lines(part)) == 2
    with part.open("a", encoding="utf-8") as file:  # half a line of a killed run
        file.write('{"content": "')
    most[0] = 100
    assert main([*arguments, "--resume", "--qp-solver", "piqp"]) == 0  # another study
    assert asked[1] == asked[0]
    assert not part.exists()
    most[0] = 1
    assert main(arguments) == 130
    most[0] = 100
    assert main([*arguments, "--resume"]) == 0
    assert asked[2:] == [asked[0], asked[0] - 1]
    assert not part.exists()
    whole = tmp_path / "whole"
    assert main([*arguments[:-1], str(whole)]) == 0
    assert rows_of(out) == rows_of(whole)
    capsys.readouterr()
    assert main([*ENVELOPE, "--resume"]) == 2
    assert "--resume needs --out DIR" in capsys.readouterr().err


def test_a_study_on_a_cluster_is_that_of_local_processes(tmp_path, capsys, monkeypatch):
    distributed = pytest.importorskip("dask.distributed")
    monkeypatch.setattr(executors, "PATIENCE", 0.5)
    assert main([*ENVELOPE, "--dask", "tcp://127.0.0.1:9"]) == 2
    assert "no Dask scheduler answers at 'tcp://127.0.0.1:9'" in capsys.readouterr().err
    monkeypatch.setattr(executors, "PATIENCE", 60.0)
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None, silence_logs=50
    )
    with cluster:
        there = [*ENVELOPE, "--dask", cluster.scheduler_address, "--out", str(tmp_path / "there")]
        assert main(there) == 0
        batch = ["batch", "paper_1", "--dask", cluster.scheduler_address]
        assert main([*batch, "--out", str(tmp_path / "plans.jsonl")]) == 0
    assert main([*ENVELOPE, "--workers", "1", "--out", str(tmp_path / "here")]) == 0
    assert rows_of(tmp_path / "there") == rows_of(tmp_path / "here")


@pytest.mark.parametrize("width", [40, 80, 200])
def test_tables_of_envelopes_split_no_number(width):
    xs, ys = np.linspace(-30.0, 40.0, 13), np.linspace(0.0, 9000.0, 3)
    rows = [
        {"x": x, "y": y, "success": x < 30.0, "status": "refused", "duration": 4.5 + 1e-4 * y}
        for x in xs
        for y in ys
    ]
    out = io.StringIO()
    console = Console(file=out, width=width)
    tables = envelope_tables(rows, "x", "y", width=width)
    for table in tables:
        console.print(table)
    words = out.getvalue().split()
    assert max(map(len, out.getvalue().splitlines())) <= width
    assert [word for word in words if word.startswith("4.5") or word in ("5.400", "x")]
    assert words.count("5.400") == sum(x < 30.0 for x in xs)
    assert words.count("x") == 3 * sum(x >= 30.0 for x in xs)
    for x in xs:
        assert f"{x:.4g}" in words
    assert (len(tables) == 1) is (width == 200)


def test_more_margin_never_takes_less_time(tmp_path, capsys):
    out = tmp_path / "tradeoff"
    arguments = ["--largest", "0.5", "--count", "3", "--workers", "1", "--out", str(out)]
    assert main(["tradeoff", "paper_1", *arguments, "--json", "-"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    np.testing.assert_allclose([row["plan.margin"] for row in rows], [0.0, 0.25, 0.5])
    durations = [row["duration"] for row in rows]
    assert durations == sorted(durations)
    for row in rows:
        assert row["margin"] >= row["plan.margin"]
    assert (out / "tradeoff.png").exists()


def test_a_faster_motion_of_a_larger_margin_serves_the_smaller_ones():
    def row(margin, duration):
        safe = duration is not None
        return {
            "plan.margin": margin,
            "success": safe,
            "duration": duration,
            "margin": margin + 1e-3 if safe else None,
            "message": "Solved.",
        }

    given = [row(0.0, 1.0), row(0.1, 3.0), row(0.2, None), row(0.3, 2.0), row(0.4, None)]
    found = _not_slower_than_larger_margins(given)
    assert [one["duration"] for one in found] == [1.0, 2.0, 2.0, 2.0, None]
    assert [one["plan.margin"] for one in found] == [0.0, 0.1, 0.2, 0.3, 0.4]
    assert "margin of 0.3 m" in found[1]["message"]


@pytest.mark.parametrize(
    ("key", "value", "where"),
    [
        ("ground.roll_deg", 3.0, lambda tables: tables["ground"]["roll_deg"]),
        ("plan.margin", 0.1, lambda tables: tables["plan"]["margin"]),
        ("motion.goal_deg[boom]", 7.0, lambda tables: tables["motion"]["goal_deg"][1]),
        ("motion.goal_deg[4]", 8.0, lambda tables: tables["motion"]["goal_deg"][4]),
    ],
)
def test_keys_name_numbers_of_a_file(key, value, where):
    content, _ = read_content("paper_1")
    name = next(iter(content["motion"]))
    key = key.replace("goal_deg", "goal_deg" if "goal_deg" in content["motion"] else "goal")
    before = json.dumps(content, default=str)
    tables = varied(content, {key: value}, JOINTS)
    assert where(tables) == value or name == "start"
    assert json.dumps(content, default=str) == before


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--x", "roll", "0", "1"], "no key of a scenario file"),
        (["--x", "ground.roll_deg", "1", "0"], "FROM < TO"),
        (["--x", "ground.roll_deg", "a", "b"], "takes KEY FROM TO"),
        (["--x", "ground.roll_deg"], "takes KEY FROM TO"),
        (["--x", "ground.pitch_deg", "0", "1"], "give two keys"),
        (["--x", "motion.goal_deg[elbow]", "0", "1"], "no joint 'elbow'"),
        (["--x", "motion.goal_deg[9]", "0", "1"], "entries"),
        (["--x", "ground.roll_deg", "0", "1", "99999"], "more than"),
        (["--x", "ground.roll", "0", "1"], "unknown key (did you mean roll_deg?)"),
        (["--x", "machine.payload.mas", "0", "1"], "unknown key (did you mean mass?)"),
        (["--x", "machine.name", "0", "1"], "must be"),
        (["--x", "motion.goal[slew]", "0", "1"], "the scenario has no list goal, but goal_deg;"),
    ],
)
def test_wrong_axes_are_refused_in_a_sentence(options, complaint, capsys):
    assert main(["envelope", "paper_1", *options]) == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert "Traceback" not in error


def test_a_payload_of_0_kg_is_none():
    content, path = read_content("paper_1")
    problem = scenario_of(varied(content, {"machine.payload.mass": 0.0}, JOINTS), path).problem
    assert problem.machine.payload_mass == 0.0
    loaded = load_scenario("paper_1").problem.machine
    assert problem.machine.mass == pytest.approx(loaded.mass - loaded.payload_mass)
