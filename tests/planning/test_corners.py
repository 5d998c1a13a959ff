"""Rows of many corners from few inverse dynamics, against one stage model per corner."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_scene
from benchmarks.problems.terrain import rolling_map, unicycle_base
from benchmarks.robust_problems import uncertain
from tests.planning.driving import retreat_problem
from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import WRENCH
from zmp_sqp.planning.constraints.effort_rows import EffortRows
from zmp_sqp.planning.program.formulation import bound_constraints
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.rows import BoundConstraints, StageRows
from zmp_sqp.planning.program.staged import Motion, StagedProgram
from zmp_sqp.planning.search.task import task_of

EXACT = 1e-9  # relative to the largest entry
K = 7
REFERENCE = 3.0  # [s]
UNCERTAIN: dict[str, Any] = {
    "payload_uncertainty": 0.1,
    "tipping_fraction": 0.9,
    "payload_com_uncertainty": (0.1, 0.2, 0.05),
    "slope_uncertainty": 0.02,
}
GENTLE = zs.Slope(roll=np.radians(-8.0), pitch=np.radians(3.0))


@dataclass(frozen=True)
class AllEfforts:
    """Bounds on every effort of a joint, and so on wrench and joints together."""

    name = "all_efforts"

    def rows(self, machine: Machine, coordinates: Coordinates) -> EffortRows:
        n = machine.size
        C = np.random.default_rng(3).normal(size=(n, WRENCH + n))
        label = tuple("effort" for _ in range(n))
        return EffortRows(
            C=C,
            c=np.linspace(-2.0, -1.5, n),
            divisor=np.full(n, 2e6),
            labels=label,
            units=label,
            resolution=np.ones(n),
        )


def of_payload(machine: Machine, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """A row per corner that is not affine in the efforts."""
    mass, n = machine.payload_mass / 1e4, machine.size
    jacobian = np.zeros((len(q), 1, 3 * n))
    jacobian[:, 0, 1], jacobian[:, 0, n] = mass * np.cos(q[:, 1]), 2.0 * mass * v[:, 0]
    return (mass * (np.sin(q[:, 1]) + v[:, 0] ** 2) - 5.0)[:, None], jacobian


USER = zs.PathRows("payload", of_payload)


def problem(case: str) -> zs.Problem:
    scene = paper_scene(point_masses=False)
    if case == "terrain":  # its slope is known
        known = {key: value for key, value in UNCERTAIN.items() if key != "slope_uncertainty"}
        return replace(retreat_problem(scene), ground=rolling_map(), margin=0.0, **known)
    standing = zs.Problem(scene.load(), PAPER_START, PAPER_GOAL, GENTLE, intervals=4, **UNCERTAIN)
    if case == "drive":
        base = unicycle_base(goal=(-2.0, 0.5, 0.4))
        return replace(standing, base=base)
    if case == "efforts":
        return replace(standing, constraints=[AllEfforts()])
    if case == "drive with efforts":
        base = unicycle_base(goal=(-2.0, 0.5, 0.4))
        return replace(standing, base=base, constraints=[AllEfforts(), USER])
    if case == "user rows":
        return replace(standing, constraints=[USER])
    if case == "moving":
        return replace(standing, start_velocity=[0.1, 0.05, 0.0, 0.0, 0.0])
    if case == "payload":
        return replace(standing, payload_com_uncertainty=0.0, slope_uncertainty=0.0)
    assert case == "slope"
    return replace(
        standing, payload_com_uncertainty=0.0, payload_uncertainty=0.0, tipping_fraction=1.0
    )


# inverse dynamics that all corners need: one, and kinematics of differences, while the base stands;
# else one for each of eight independent parameters of payloads, with joint efforts of 3 gravities
BASIS = {"drive": 8, "efforts": 24, "drive with efforts": 24, "user rows": 1}
BASIS |= {"terrain": 8, "payload": 1, "slope": 1, "moving": 1}
DIFFERENCES = {"user rows": 7, "payload": 1, "slope": 0, "moving": 7}


def states(n: int, positions: bool) -> tuple[Any, ...]:
    rng = np.random.default_rng(5)
    q, w, alpha = rng.uniform(-1.0, 1.0, (K, n)), *rng.normal(0.0, 2.0, (2, K, n))
    return q, w, alpha, 11.0, rng.uniform(-3.0, 0.0, (K, 2)) if positions else None


def check_equal(found: Array, expected: Array) -> None:
    np.testing.assert_allclose(found, expected, atol=EXACT * np.abs(expected).max())


@pytest.mark.parametrize("case", BASIS)
def test_rows_of_all_corners_are_those_of_one_model_per_corner(case: str) -> None:
    bound = bound_constraints(problem(case))
    rows = StageRows(bound, REFERENCE)
    assert bound.models is not None
    assert len(bound.models.basis) == BASIS[case]
    assert bound.models.weights.shape[1] == BASIS[case] + DIFFERENCES.get(case, 0)
    at = states(rows.size, case == "terrain")
    every = BoundConstraints(bound.corners, ())
    alone = [StageRows(every.at([i]), REFERENCE) for i in range(len(bound.corners))]
    check_equal(rows.evaluate(*at), np.hstack([one.evaluate(*at) for one in alone]))
    values, jacobian = rows.linearize(*at)
    parts = [one.linearize(*at) for one in alone]
    check_equal(values, np.hstack([part for part, _ in parts]))
    check_equal(jacobian, np.concatenate([part for _, part in parts], axis=1))
    step = np.random.default_rng(6).normal(size=jacobian.shape[::2])
    check_equal(rows.expand(*at).change(step), np.einsum("kej,kj->ke", jacobian, step))


def program_and_point(case: str, corners: list[int] | None = None) -> tuple[StagedProgram, Motion]:
    task = task_of(problem(case))
    if corners is not None:
        task = replace(task, constraints=task.constraints.at(corners))
    program = task.program(REFERENCE, Grid.of(4))
    rng = np.random.default_rng(1)
    controls = rng.normal(0.0, 3.0, (4, 2, program.n)) + np.linspace(0.0, 1.0, 4)[:, None, None]
    return program, program.pack(controls, 1.3 * REFERENCE**2)


@pytest.mark.parametrize("case", ["drive", "terrain", "user rows", "moving"])
def test_derivatives_on_demand_are_those_of_programs_with_one_corner_each(case: str) -> None:
    program, point = program_and_point(case)
    lin = program.linearize(point)
    corners = len(program.rows.corners)
    every = lin.C.selected(np.ones(program.inequalities, dtype=bool)).toarray()
    of_rows = every[: program.nonlinear].reshape(4, 3, corners, -1, program.size)
    z = np.random.default_rng(2).uniform(0.0, 1.0, program.inequalities)
    for corner in (0, corners // 2, corners - 1):
        alone, same = program_and_point(case, [corner])
        expected = alone.linearize(same)
        by_row = expected.C.selected(np.ones(alone.inequalities, dtype=bool)).toarray()
        check_equal(of_rows[:, :, corner].reshape(-1, program.size), by_row[: alone.nonlinear])
        check_equal(every[program.nonlinear :], by_row[alone.nonlinear :])
    step = np.random.default_rng(4).normal(size=program.size)
    check_equal(lin.C @ step, every @ step)
    some = z > 0.9
    check_equal(lin.C.selected(some).toarray(), every[some])


def test_of_many_corners_those_with_the_largest_values_lead() -> None:
    program, point = program_and_point("user rows")
    lin = program.linearize(point)
    values = lin.at.inequalities
    leading = lin.C.leading(values)
    assert leading[program.nonlinear :].all()
    by_corner = values[: program.nonlinear].reshape(4, 3, 64, -1)
    leads = leading[: program.nonlinear].reshape(by_corner.shape)
    assert leads.any(axis=2).all()
    assert (
        by_corner[leads]
        == np.broadcast_to(by_corner.max(axis=2, keepdims=True), leads.shape)[leads]
    ).all()


@pytest.mark.parametrize("case", ["drive", "efforts", "user rows"])
def test_curvature_of_one_corner_is_that_of_its_own_model(case: str) -> None:
    bound = bound_constraints(problem(case))
    rows, corner = StageRows(bound, REFERENCE), 11
    at = states(rows.size, positions=False)[:4]
    weights = np.zeros((K, len(bound.corners), rows.per_corner))
    weights[:, corner] = np.random.default_rng(7).uniform(0.0, 1.0, (K, rows.per_corner))
    weights[2] = 0.0
    alone = StageRows(BoundConstraints(bound.corners, ()).at([corner]), REFERENCE)
    expected = alone.curvature(*at, weights[:, corner])
    common = np.zeros((K, rows.count - rows.of_corners))
    every = np.hstack([weights.reshape(K, -1), common])
    check_equal(rows.curvature(*at, every), expected)


def test_models_that_are_not_of_one_machine_are_all_evaluated() -> None:
    bound = bound_constraints(problem("terrain"))
    other = replace(bound.corners[1].model, terrain=rolling_map())
    mixed = BoundConstraints((bound.corners[0], replace(bound.corners[1], model=other)), ())
    assert mixed.models is not None
    assert len(mixed.models.basis) == 2
    rows = StageRows(mixed, REFERENCE)
    at = states(rows.size, positions=True)
    alone = [StageRows(mixed.at([i]), REFERENCE).evaluate(*at) for i in range(2)]
    check_equal(rows.evaluate(*at), np.hstack(alone))


@pytest.mark.parametrize("seed", [5003, 5030])
def test_what_a_box_misses_at_its_corners_is_kept_inside_before_anything_is_proven(
    seed: int,
) -> None:
    asked = uncertain(seed)
    assert asked is not None
    plan = zs.plan(asked)
    assert plan.success
    assert not any(run.purpose == "tightened" for run in plan.runs)
