"""Tables of plans: columns that agree with the plans, failures included; plans in a few lines."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from tests.test_cli import STRETCHED
from zmp_sqp.scenario import load_scenario


@pytest.fixture(scope="module")
def plans(tmp_path_factory: pytest.TempPathFactory) -> dict[str, zs.Plan]:
    path: Path = tmp_path_factory.mktemp("plans") / "stretched.toml"
    path.write_text(STRETCHED, encoding="utf-8")
    problem = load_scenario("paper_1").problem
    still = replace(problem, goal=problem.start)
    return {
        "paper": zs.plan(replace(problem, margin=0.1, intervals=20)),
        "stretched": zs.plan(load_scenario(path).problem),
        "still": zs.plan(still),
    }


def test_columns_agree_with_the_plans(plans: dict[str, zs.Plan]) -> None:
    columns = zs.table(plans)
    assert {len(column) for column in columns.values()} == {3}
    assert columns["name"] == ["paper", "stretched", "still"]
    assert columns["success"].tolist() == [True, False, True]
    assert columns["status"] == [plan.status.name.lower() for plan in plans.values()]
    paper = plans["paper"]
    expected = {
        "duration": [paper.duration, np.nan, 0.0],
        "lower_bound": [plan.lower_bound for plan in plans.values()],
        "above_bound": [paper.duration / 4.5 - 1.0, np.nan, np.nan],
        "margin": [paper.margin, np.nan, plans["still"].margin],
        "margin_asked": [0.1, 0.0, 0.0],
        "intervals": [len(paper.trajectory.times) - 1, np.nan, 1],
        "payload": [4000.0] * 3,
    }
    for name, values in expected.items():
        np.testing.assert_allclose(columns[name], values, rtol=1e-12, err_msg=name)
    assert columns["message"][1] == plans["stretched"].message


def test_columns_are_rows_of_a_csv_file(plans: dict[str, zs.Plan]) -> None:
    columns = zs.table(plans.values())
    assert columns["name"] == ["0", "1", "2"]
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    rows = list(csv.DictReader(io.StringIO(text.getvalue())))
    assert [float(row["duration"]) for row in rows][::2] == [plans["paper"].duration, 0.0]


def test_no_plans_are_an_empty_table() -> None:
    assert {len(column) for column in zs.table([]).values()} == {0}


@pytest.mark.parametrize("given", [None, 3, [None], {"one": "plan"}])
def test_what_is_no_plan_is_refused(given: Any) -> None:
    with pytest.raises(zs.ProblemError, match=r"(Plan|several plans), "):
        zs.table(given)


def test_a_single_plan_is_refused(plans: dict[str, zs.Plan]) -> None:
    single: Any = plans["paper"]
    with pytest.raises(zs.ProblemError, match="several plans"):
        zs.table(single)


def test_a_plan_is_printed_in_a_few_lines(plans: dict[str, zs.Plan]) -> None:
    text = str(plans["paper"])
    assert text.startswith(plans["paper"].message)
    assert f"duration   {plans['paper'].duration:.4f} s (lower bound 4.5000 s" in text
    assert "m guaranteed, 0.1 m asked for (" in text
    failed = str(plans["stretched"])
    assert failed.startswith("Not solved")
    assert "guaranteed" not in failed
    assert len(text.splitlines()) == 4
    assert "above" not in str(plans["still"])
