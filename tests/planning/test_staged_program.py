"""Derivatives and points of the staged program of a standing machine, against differences."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from benchmarks.problems.checks import Oracle
from tests.checks import central_differences, second_differences, symmetric
from tests.planning.programs import (
    CURVATURE,
    DERIVATIVE,
    GRIDS,
    MARGIN,
    REFERENCE,
    ROUNDING,
    Case,
    along,
    arm_case,
    somewhere,
)
from zmp_sqp.planning.constraints.effort_rows import effort_curvature
from zmp_sqp.planning.constraints.protocol import StageSample
from zmp_sqp.planning.constraints.tip_over import LEAST_NORMAL_FORCE
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.staged import INSIDE, POINTS, Motion, StagedProgram

MACHINES = ("feller_buncher", "slider", "simplified")


@pytest.fixture(
    params=[
        *itertools.product(MACHINES, ("rest", "moving"), GRIDS, [1]),
        ("feller_buncher", "moving", "uneven", 3),
    ],
    ids=lambda p: f"{p[0]}-{p[1]}-{p[2]}-{p[3]}",
)
def case(request: pytest.FixtureRequest) -> Case:
    machine, state, grid, corners = request.param
    return arm_case(machine, moving=state == "moving", grid=GRIDS[grid], corners=corners)


def mapped(program: StagedProgram, point: Motion) -> Any:
    """Motion after a step of the quadratic program's variables, as the SQP takes it."""
    lin = program.linearize(point)
    return lambda step: program.moved(lin, point, step)


# --- first derivatives --------------------------------------------------------------------------


def test_the_jacobian_of_all_inequalities(case: Case) -> None:
    program = case.program
    point = somewhere(program)
    after = mapped(program, point)
    expected = central_differences(
        lambda step: program.evaluate(after(step)).inequalities, np.zeros(program.size)
    )
    lin = program.linearize(point)
    found = lin.C.selected(np.ones(program.inequalities, dtype=bool)).toarray()
    step = np.random.default_rng(1).normal(size=program.size)
    np.testing.assert_allclose(lin.C @ step, found @ step, atol=1e-10)
    scale = np.maximum(1.0, np.abs(expected).max(axis=1, keepdims=True))
    np.testing.assert_allclose(found / scale, expected / scale, atol=DERIVATIVE)
    assert lin.A is None
    assert len(lin.at.equalities) == program.equalities == 0


def test_the_gradient_of_objective_and_tie_breaker(case: Case) -> None:
    program = case.program
    point = somewhere(program)
    after = mapped(program, point)

    def both(step: np.ndarray) -> np.ndarray:
        at = program.evaluate(after(step))
        return np.array([at.objective + at.tie_breaker])

    expected = central_differences(both, np.zeros(program.size))[0]
    np.testing.assert_allclose(program.linearize(point).gradient, expected, atol=DERIVATIVE)


def test_linearize_and_evaluate_agree(case: Case) -> None:
    point = somewhere(case.program)
    one, other = case.program.evaluate(point), case.program.linearize(point).at
    np.testing.assert_allclose(one.inequalities, other.inequalities, atol=ROUNDING)
    assert (one.objective, one.tie_breaker) == (other.objective, other.tie_breaker)


# --- second derivatives -------------------------------------------------------------------------


def multipliers(program: StagedProgram, seed: int = 2) -> np.ndarray:
    """Multipliers of all limits, and of the rows of the last corner.

    The curvature of many corners is taken at the one whose multipliers are largest.
    """
    z = np.random.default_rng(seed).uniform(0.0, 1.0, program.inequalities)
    rows = program.rows
    others = (len(rows.corners) - 1) * (rows.count // len(rows.corners))
    z[: program.nonlinear].reshape(-1, rows.count)[:, :others] = 0.0
    return z


def model_of_the_lagrangian(program: StagedProgram, point: Motion, z: np.ndarray) -> Any:
    """The function whose Hessian the program computes, of a step of the variables.

    Nonlinear rows count in the middles of the intervals only, with the sum of an interval's three
    multipliers.
    """
    after, nonlinear = along(program, point), program.nonlinear
    weights = z[:nonlinear].reshape(program.grid.size, POINTS, -1).sum(axis=1)

    def lagrangian(step: np.ndarray) -> float:
        motion = after(step)
        at = program.evaluate(motion)
        q, w, controls, S = program.unpack(motion)
        middle = program.grid.within(0.5, q[:-1], w[:-1], controls)
        curved = float((weights * program.rows.evaluate(*middle, S)).sum())
        return (
            curved
            + at.objective
            + at.tie_breaker
            + float(z[nonlinear:] @ at.inequalities[nonlinear:])
        )

    return lagrangian


def test_the_hessian_is_exact_for_rows_in_the_middles_of_the_intervals(case: Case) -> None:
    """But for what rates at the ends owe to the square root of sigma."""
    program = case.program
    point, z = somewhere(program, 3), multipliers(program)
    lin = program.linearize(point)
    found = symmetric(program.hessian(lin, np.zeros(0), z, clipped=0.0, damping=0.0))
    expected = second_differences(
        model_of_the_lagrangian(program, point, z), np.zeros(program.size)
    )
    if program.limits.moving:
        found[-1, -1] = expected[-1, -1]
    accuracy = 10.0 * CURVATURE * max(1.0, float(np.abs(expected).max()))
    np.testing.assert_allclose(found, expected, atol=accuracy)


@pytest.mark.parametrize("seed", range(4))
def test_of_the_curvature_of_given_rates_by_sigma_the_convex_part_is_kept(
    case: Case, seed: int
) -> None:
    """With multipliers on the limits alone, whose curvature is exact."""
    program, point = case.program, somewhere(case.program, 3)
    z = multipliers(program, seed)
    z[: program.nonlinear] = 0.0
    lin = program.linearize(point)
    found = symmetric(program.hessian(lin, np.zeros(0), z, clipped=0.0, damping=0.0))[-1, -1]
    lagrangian, along_sigma = model_of_the_lagrangian(program, point, z), np.zeros(program.size)
    along_sigma[-1] = 1.0
    exact = second_differences(lambda t: lagrangian(t[0] * along_sigma), np.zeros(1))[0, 0]
    bend = (
        -0.5
        / point.sigma
        * float(z[program.nonlinear :] @ lin.memory.by_ends[-program.limits.count :])
    )
    assert found == pytest.approx(exact - min(bend, 0.0), abs=1e-4 * max(1.0, abs(exact)))


@pytest.mark.parametrize("machine", MACHINES)
def test_taking_the_curvature_in_the_middles_costs_less_on_finer_grids(machine: str) -> None:
    """Along one smooth direction the error of d'Hd halves at least from grid to finer grid."""
    errors = []
    for N in (8, 16, 32):
        program = arm_case(machine, moving=False, grid=Grid.of(N)).program
        s = Grid.of(N).nodes[:, None] * np.ones(program.n)
        bump = 3.0 * np.sin(np.pi * (s + 0.2 * np.arange(program.n)))
        point = program.pack(np.stack([bump[:-1], bump[1:]], axis=1), 1.3 * REFERENCE**2)
        x = np.hstack(
            [np.sin(np.pi * s) ** 2, np.pi * np.sin(2.0 * np.pi * s) / program.rate_scale]
        )
        step = np.append(x[1:-1].ravel(), 0.3)
        share = np.outer(1.0 + s[:-1, 0], np.linspace(0.5, 2.0, POINTS * program.rows.count)) / N
        z = np.concatenate([share.ravel(), np.zeros(program.limits.count)])
        after = along(program, point)

        def lagrangian(
            t: np.ndarray, program: Any = program, z: Any = z, step: Any = step, after: Any = after
        ) -> float:
            at = program.evaluate(after(t[0] * step))
            return float(at.objective + at.tie_breaker + z @ at.inequalities)

        exact = second_differences(lagrangian, np.zeros(1), step=1e-3)[0, 0]
        lin = program.linearize(point)
        H = symmetric(program.hessian(lin, np.zeros(0), z, clipped=0.0, damping=0.0))
        errors.append(abs(step @ H @ step - exact) / abs(exact))
    rounding = 1e-6  # of second differences; the slider's rows are bilinear
    assert errors[1] <= 0.5 * errors[0] + rounding
    assert errors[2] <= 0.5 * errors[1] + rounding


def test_the_wholly_clipped_hessian_is_positive_semi_definite(case: Case) -> None:
    program = case.program
    lin = program.linearize(somewhere(program, 3))
    H = symmetric(program.hessian(lin, np.zeros(0), multipliers(program), clipped=1.0, damping=0.0))
    assert np.linalg.eigvalsh(H).min() >= -1e-9 * np.abs(H).max()


def test_damping_adds_curvature_to_all_variables_but_sigma(case: Case) -> None:
    program = case.program
    lin, z = program.linearize(somewhere(program, 3)), multipliers(program)
    plain, damped = (
        symmetric(program.hessian(lin, np.zeros(0), z, clipped=0.5, damping=damping))
        for damping in (0.0, 2.0)
    )
    added = damped - plain
    assert np.linalg.eigvalsh(added[:-1, :-1]).min() > 0.0
    if not program.limits.moving:
        np.testing.assert_allclose(added[-1], 0.0, atol=ROUNDING)


def test_the_metric_is_the_squared_length_of_the_change_of_the_accelerations() -> None:
    program = arm_case("feller_buncher", moving=False, grid=GRIDS["uneven"]).program
    point = somewhere(program)
    step = np.random.default_rng(4).normal(size=program.size)
    change = program.moved(program.linearize(point), point, step).controls - point.controls
    found = step @ symmetric(program.metric()) @ step
    assert found == pytest.approx(float((change**2).sum()), rel=1e-9)


def test_the_curvature_of_the_corner_that_weighs_most() -> None:
    """Exact where no other corner of three has multipliers, near it where others weigh less."""
    rows = arm_case("feller_buncher", moving=False, grid=Grid.of(2), corners=3).program.rows
    rng, n, per_corner = np.random.default_rng(2), rows.size, rows.count // 3
    at, weights = rng.normal(size=3 * n + 1), np.zeros(rows.count)
    at[-1] = 6.0

    def parts(y: np.ndarray) -> tuple[Any, ...]:
        return y[None, :n], y[None, n : 2 * n], y[None, 2 * n : -1], float(y[-1])

    def error() -> float:
        found = rows.curvature(*parts(at), weights[None])[0]
        expected = central_differences(lambda y: weights @ rows.linearize(*parts(y))[1][0], at)
        return float(np.abs(found - expected).max() / np.abs(expected).max())

    weights[per_corner : 2 * per_corner] = rng.uniform(0.5, 1.0, per_corner)
    assert error() < CURVATURE
    weights[2 * per_corner :] = 0.2 * weights[per_corner : 2 * per_corner]
    assert error() < 0.1  # payloads differ by a tenth


@pytest.mark.parametrize("machine", MACHINES)
def test_effort_curvature(machine: str) -> None:
    model = arm_case(machine, moving=False, grid=Grid.of(2)).program.rows.corners[0].model
    rng, S, n = np.random.default_rng(8), 4.0, model.size
    q, w, alpha = rng.uniform(-1.0, 1.0, (3, 1, n))
    weights = rng.normal(0.0, 1e-5, (1, 6))

    def gradient(at: np.ndarray) -> Any:
        parts = at[None, :n], at[None, n : 2 * n], at[None, 2 * n : -1]
        return weights[0] @ model.effort_derivatives(*parts, at[-1])[1][0]

    expected = central_differences(gradient, np.concatenate([q[0], w[0], alpha[0], [S]]))
    found = effort_curvature(StageSample(model, q, w, alpha, S), weights)[0]
    np.testing.assert_allclose(found, expected, atol=CURVATURE * float(np.abs(expected).max()))


# --- points -------------------------------------------------------------------------------------


def test_a_motion_starts_and_ends_exactly_as_asked(case: Case) -> None:
    program = case.program
    q, w, controls, S = program.unpack(somewhere(program, 1))
    T = np.sqrt(S)
    np.testing.assert_allclose(q[0], program.start.q, atol=ROUNDING)
    np.testing.assert_allclose(q[-1], program.goal.q, atol=ROUNDING)
    np.testing.assert_allclose(w[0], program.start.v * T, atol=ROUNDING)
    np.testing.assert_allclose(w[-1], program.goal.v * T, atol=ROUNDING)
    ends = program.grid.within(1.0, q[:-1], w[:-1], controls)
    np.testing.assert_allclose(ends[0], q[1:], atol=ROUNDING)
    np.testing.assert_allclose(ends[1], w[1:], atol=ROUNDING)


def test_a_motion_that_ends_as_asked_is_left_alone(case: Case) -> None:
    """Packing it, or a step of zero, changes nothing but rounding."""
    program = case.program
    point = somewhere(program, 1)
    _, _, controls, S = program.unpack(point)
    still = program.moved(program.linearize(point), point, np.zeros(program.size))
    for again in (program.pack(controls, S), still):
        np.testing.assert_allclose(again.controls, point.controls, atol=1e-11)
        np.testing.assert_allclose(again.states, point.states, atol=1e-11)
        assert again.sigma == pytest.approx(point.sigma, rel=ROUNDING)


def test_a_full_step_at_one_duration_changes_the_states_by_just_that_step(case: Case) -> None:
    """The joints' motion is linear in the variables: no gap opens, nothing has to be corrected."""
    program = case.program
    point = somewhere(program)
    step = np.random.default_rng(6).normal(size=program.size)
    step[-1] = 0.0
    after = program.moved(program.linearize(point), point, step)
    expected = along(program, point)(step)
    np.testing.assert_allclose(after.states, expected.states, atol=1e-11)
    columns = program.stages.columns
    change = np.where(columns >= 0, 0.1 * step[columns], 0.0)
    np.testing.assert_allclose(after.states - point.states, change, atol=1e-11)


def test_no_step_leads_below_a_quarter_of_the_duration_squared_or_its_bound() -> None:
    """The last row: sigma stays above both."""
    program = arm_case("slider", moving=False, grid=Grid.of(3)).program
    for S in (0.5, 1.0, 40.0):
        sigma = S * program.limits.least
        point = program.motion(somewhere(program).controls, sigma)
        lin = program.linearize(point)
        step = np.zeros(program.size)
        step[-1] = max(0.25 * sigma, program.limits.least) - sigma
        assert lin.at.inequalities[-1] + (lin.C @ step)[-1] == pytest.approx(0.0, abs=ROUNDING)


def test_a_step_towards_no_duration_at_all_leaves_some() -> None:
    """A screened program may miss the row that keeps sigma up."""
    program = arm_case("slider", moving=True, grid=Grid.of(3)).program
    point = somewhere(program)
    step = np.zeros(program.size)
    step[-1] = -2.0 * point.sigma
    after = program.moved(program.linearize(point), point, step)
    assert 0.0 < after.sigma < 0.25 * point.sigma
    assert program.evaluate(after).is_finite()
    assert not program.evaluate(program.motion(point.controls, 0.0)).is_finite()


def test_tip_over_rows_are_the_distances_to_the_edges_times_the_normal_force(case: Case) -> None:
    """(e . p - b + margin) f_z over weight and reference squared, at both ends of the intervals."""
    program, point = case.program, somewhere(case.program, 5)
    q, w, controls, S = program.unpack(point)
    T, oracle, arm = np.sqrt(S), Oracle(case.scene), program.rows.corners[0].model.coordinates
    N, edges = program.grid.size, len(oracle.offsets)
    rows = program.evaluate(point).inequalities[: program.nonlinear].reshape(N, POINTS, -1)
    # the normal force's row follows the edges: f_z S over the weight and the reference's square
    force = (LEAST_NORMAL_FORCE * point.sigma - rows[..., edges])[..., None]
    sides = ((0, slice(None, -1), controls[:, 0]), (1, slice(1, None), controls[:, 1]))
    for at, nodes, alpha in sides:
        joints = arm.joints(q[nodes]), arm.rates(w[nodes] / T), arm.rates(alpha / S)
        over = oracle.offsets - oracle.zmp(*joints) @ oracle.inward.T
        assert (force[:, at] > 0.0).all()
        expected = (over + MARGIN) * force[:, at]
        np.testing.assert_allclose(rows[:, at, :edges], expected, atol=1e-9)


# --- between the points -------------------------------------------------------------------------


def test_the_control_points_bound_the_parabola_through_start_middle_and_end(case: Case) -> None:
    program = case.program
    at = program.evaluate(somewhere(program)).inequalities[: program.nonlinear]
    start, end, control = at.reshape(program.grid.size, POINTS, -1).transpose(1, 0, 2)
    s = np.linspace(0.0, 1.0, 41)[:, None, None]
    parabola = (1.0 - s) ** 2 * start + 2.0 * s * (1.0 - s) * control + s**2 * end
    assert (parabola.max(axis=0) <= np.maximum(np.maximum(start, end), control) + ROUNDING).all()
    middle = 0.25 * start + 0.5 * control + 0.25 * end
    q, w, controls, S = program.unpack(somewhere(program))
    states = program.grid.within(0.5, q[:-1], w[:-1], controls)
    np.testing.assert_allclose(middle, program.rows.evaluate(*states, S), atol=1e-10)


def test_excess_bounds_what_rows_exceed_their_parabola_by(case: Case) -> None:
    """On dense samples of a smooth motion; close looks miss less than far ones."""
    program = case.program
    N = program.grid.size
    point = program.pack(np.zeros((N, 2, program.n)), 1.3 * REFERENCE**2)
    at = program.evaluate(point)
    start, end, control = (
        at.inequalities[: program.nonlinear].reshape(N, POINTS, -1).transpose(1, 0, 2)
    )
    q, w, controls, S = program.unpack(point)
    most = np.zeros_like(start)
    for s in (*np.linspace(0.0, 1.0, 101), *INSIDE):
        parabola = (1.0 - s) ** 2 * start + 2.0 * s * (1.0 - s) * control + s**2 * end
        rows = program.rows.evaluate(*program.grid.within(s, q[:-1], w[:-1], controls), S)
        most = np.maximum(most, rows - parabola)
    missed = []
    for fine in (False, True):
        found = program.excess(point, at, fine=fine)
        assert found is not None
        found = found.reshape(N, POINTS, -1)
        assert (found >= 0.0).all()
        np.testing.assert_array_equal(found[:, 0], found[:, 1])
        np.testing.assert_array_equal(found[:, 0], found[:, 2])
        assert (found[:, 0] <= most + ROUNDING).all()
        missed.append(float((most - found[:, 0]).max()))
    largest = float(most.max())
    assert missed[1] <= 0.05 * largest + ROUNDING
    assert missed[0] <= 0.25 * largest + ROUNDING
