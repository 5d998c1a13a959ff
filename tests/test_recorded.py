"""Comparing results with recorded ones, in benchmarks/recorded.py."""

import math

import pytest

import zmp_sqp as zs
from benchmarks.harness import save_json
from benchmarks.recorded import (
    COLUMNS,
    EQUAL,
    MORE,
    WITHIN,
    compare,
    failed,
    problems,
    read,
    report,
    result,
)


def row(**changes):
    return {
        "status": "OPTIMAL",
        "duration": 4.5,
        "margin": 1e-5,
        "iterations": 3,
        "seconds": 0.1,
        **changes,
    }


@pytest.mark.parametrize(
    ("changes", "verdict", "fails"),
    [
        ({}, EQUAL, False),
        ({"seconds": 9.0}, EQUAL, False),
        ({"margin": 1.1e-5}, WITHIN, False),
        ({"duration": 4.5 * (1.0 + 1e-12)}, WITHIN, False),
        ({"duration": 4.5 * (1.0 + 1e-8)}, MORE, True),
        ({"duration": math.nan}, MORE, True),
        ({"status": "INFEASIBLE"}, MORE, True),
    ],
)
def test_a_change_is_told(changes, verdict, fails):
    recorded, now = {"p": row()}, {"p": row(**changes)}
    assert [pair.verdict for pair in compare(recorded, now)] == [verdict]
    assert failed(recorded, now, 1e-9) == (["p"] if fails else [])


def test_neither_has_a_duration():
    assert not failed({"p": row(duration=math.nan)}, {"p": row(duration=math.nan)}, 1e-9)


def test_a_missing_problem_fails_and_a_new_one_does_not():
    assert failed({"p": row(), "gone": row()}, {"p": row(), "new": row()}, 1e-9) == ["gone"]


def test_the_tolerance_is_for_durations():
    now = {"p": row(duration=4.6)}
    assert failed({"p": row()}, now, 1e-2) == ["p"]
    assert not failed({"p": row()}, now, 0.1)


def test_the_report_names_what_differs(capsys):
    recorded = {"p": row(), "q": row(), "gone": row()}
    report(recorded, {"p": row(), "q": row(duration=4.6)}, (1e-3, 1e-3))
    printed = capsys.readouterr().out
    assert "missing: gone" in printed
    assert "1 exactly equal, 0 within 1e-09, 1 more" in printed
    assert "recorded 9.000000000 s, now 9.100000000 s" in printed
    assert "ratio 1.000" in printed


def test_a_refused_problem_is_a_result():
    def make():
        raise zs.ProblemError("tips over at rest")

    assert result("p", make, "proxqp")["status"] == "ProblemError"


def test_problems_have_names_of_their_own():
    names = [name for name, _ in problems()]
    assert len(set(names)) == len(names) >= 110
    assert {"scenario paper_1", "ordinary 0", "hard 39", "driving 19", "terrain 9"} <= set(names)


def test_a_record_is_read_to_the_last_digit(tmp_path):
    one = {"name": "p", **row(duration=0.1 + 0.2)}
    save_json(tmp_path / "record.json", {"F_seconds": 1e-3}, rows=[one], columns=COLUMNS)
    rows, content = read(tmp_path / "record.json")
    assert rows == {"p": one}
    assert content["F_seconds"] == 1e-3
