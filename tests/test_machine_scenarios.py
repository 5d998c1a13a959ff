"""Scenarios of excavator, forwarder crane and mobile manipulator: certified, and costly."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.machines import KINDS, WIDE, random_move
from tests.planning.test_certificate import margins
from tests.test_machines import PAGE, STICK, effort, machine_of, tipping_load
from zmp_sqp.cli import main
from zmp_sqp.mechanics.wrench import WRENCH, efforts
from zmp_sqp.scenario import load_scenario

SCENARIOS = (
    "excavator_lower",
    "excavator_swing",
    "forwarder_downhill",
    "mobile_manipulator_shelf",
)
MOVES = Path(__file__).resolve().parents[1] / "benchmarks" / "results" / "machine_moves.json"
ROUNDING = 1e-9  # [m]
SAME = 2e-3  # share by which two local optima on 50 intervals may differ


@cache
def planned(name: str) -> zs.Plan:
    return zs.plan(load_scenario(name).problem)


@cache
def without_tip_over(name: str) -> zs.Plan:
    problem = load_scenario(name).problem
    return zs.plan(replace(problem, machine=problem.machine.with_support(WIDE), margin=0.0))


def figures_of(name: str) -> list[float]:
    """Numbers of the page's table in the row of a scenario."""
    row = re.search(rf"^\| `{name}` \|.*$", PAGE, re.MULTILINE)
    assert row is not None
    return [float(cell.strip(" %")) for cell in row.group().strip("|").split("|")[2:]]


@pytest.mark.parametrize("name", SCENARIOS)
def test_scenarios_are_certified_where_tip_over_costs_more_than_five_per_cent(name: str) -> None:
    plan, free, problem = planned(name), without_tip_over(name), load_scenario(name).problem
    assert plan.success
    assert free.success
    assert all(found.proven for found in plan.certificate.guarantees)
    assert plan.certificate.margin >= problem.margin
    assert {found.name for found in plan.certificate.guarantees} >= {"tip_over", "torque_limits"}
    cost = plan.duration / free.duration - 1.0
    assert cost > 0.05
    assert plan.duration > 1.05 * plan.lower_bound
    blind = zs.phase_plane(problem.machine, problem.start, problem.goal)
    leaves = -zs.certify(problem.machine, blind, problem.ground).margin
    assert blind.duration == pytest.approx(plan.lower_bound)
    listed = figures_of(name)
    found = [blind.duration, free.duration, plan.duration]
    np.testing.assert_allclose(found, listed[:3], rtol=2e-3)
    assert 100.0 * cost == pytest.approx(listed[3], abs=0.6)
    assert leaves == pytest.approx(listed[4], abs=0.01)


@pytest.mark.parametrize("name", SCENARIOS)
def test_scenarios_keep_the_margin_by_inverse_dynamics_of_another_model(name: str) -> None:
    plan, problem = planned(name), load_scenario(name).problem
    q, v, a = plan.trajectory(np.linspace(0.0, plan.duration, 2000))
    least = margins(problem.machine, q, v, a, problem.ground.gravity()).min()
    assert least >= problem.margin
    assert least == pytest.approx(plan.certificate.margin, abs=2e-3)


@pytest.mark.parametrize(
    ("name", "frame", "com"),
    [
        ("excavator_lower", "stick", (STICK, 0.0, 0.0)),
        ("excavator_swing", "stick", (STICK, 0.0, 0.0)),
        ("forwarder_downhill", "grapple", (0.0, 0.0, 0.0)),
    ],
)
def test_loads_of_scenarios_are_three_quarters_of_what_tips_the_machine_over(
    name: str, frame: str, com: tuple[float, float, float]
) -> None:
    problem = load_scenario(name).problem
    machine = machine_of(problem.machine.name)
    poses = [problem.start, problem.goal]
    if name == "excavator_swing":  # over its lower side, half-way
        poses = [0.5 * (problem.start + problem.goal)]
    least = min(tipping_load(machine, q, frame, com, problem.ground) for q in poses)
    assert problem.machine.payload_mass == pytest.approx(0.75 * least, rel=0.01)


def test_the_boom_pushes_down_with_less_than_its_rod_side_can() -> None:
    """Its effort limit is that of the cap side, which lifts; the rod side has half of it."""
    for name in SCENARIOS[:2]:
        problem, plan = load_scenario(name).problem, planned(name)
        states = plan.trajectory(np.linspace(0.0, plan.duration, 500))
        root = np.concatenate([-problem.ground.gravity(), np.zeros(3)])
        boom = efforts(problem.machine, *states, root_acceleration=root)[:, WRENCH + 1]
        assert boom.min() > -0.5 * effort("excavator", "boom")
        assert boom.max() > 0.1 * effort("excavator", "boom")


@pytest.mark.physics
@pytest.mark.parametrize("name", SCENARIOS)
def test_physics_agrees_with_the_certificates(name: str) -> None:
    pytest.importorskip("mujoco")
    problem, plan = load_scenario(name).problem, planned(name)
    machine, ground = problem.machine, problem.ground
    stands = zs.replay(machine, plan.trajectory, ground)
    assert not stands.tipped
    assert stands.lift < 5e-5
    falls = zs.replay(machine, zs.phase_plane(machine, problem.start, problem.goal), ground)
    assert falls.tipped


@pytest.mark.parametrize("name", SCENARIOS)
def test_scenarios_plan_from_the_command_line(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plan", name]) == 0
    assert f"{name}:" in capsys.readouterr().out


def test_the_pages_table_of_random_moves_is_the_recorded_one() -> None:
    recorded = json.loads(MOVES.read_text(encoding="utf-8"))
    for name in KINDS:
        found = recorded[name]
        cells = (
            f"| `{name}` | {found['solved']} of {found['count']} | {found['tip-over costs > 5 %']} "
            f"| {found['largest cost [%]']} | {found['torques cost > 5 %']} "
            f"| {found['time, median [F]']:.0f}, {found['time, max [F]']:.0f} |"
        )
        assert cells in PAGE


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", sorted(KINDS))
def test_random_moves_are_certified_and_stand_by_another_model(name: str, seed: int) -> None:
    problem = random_move(name, seed)
    plan = zs.plan(problem)
    assert plan.success
    assert all(found.proven for found in plan.certificate.guarantees)
    q, v, a = plan.trajectory(np.linspace(0.0, plan.duration, 500))
    least = margins(problem.machine, q, v, a, problem.ground.gravity()).min()
    assert least >= plan.certificate.margin - ROUNDING
    free = zs.plan(replace(problem, machine=problem.machine.with_support(WIDE)))
    assert plan.duration > free.duration * (1.0 - SAME)  # tip-over does not make it faster
