"""Derivatives of the driving program, and positions of a base, against differences."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import BarycentricInterpolator
from scipy.linalg import null_space

from benchmarks.problems.terrain import unicycle_base as base
from tests.checks import central_differences, second_differences, symmetric
from tests.planning.programs import (
    CURVATURE,
    DERIVATIVE,
    GRIDS,
    ROUGH,
    ROUNDING,
    TILTED,
    UNEVEN,
    driving_case,
    somewhere,
)
from zmp_sqp.planning.constraints.effort_rows import effort_curvature
from zmp_sqp.planning.constraints.protocol import StageSample
from zmp_sqp.planning.program.driving.displacements import runge_kutta
from zmp_sqp.planning.program.driving.model import DrivingModel
from zmp_sqp.planning.program.driving.positions import propagated
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.staged import INSIDE_FINE, POINTS, StagedProgram
from zmp_sqp.planning.program.stages import STATE

TERRAINS = {"plane": TILTED.ground, "map": ROUGH}


@pytest.fixture(
    params=itertools.product(("rest", "moving"), GRIDS, TERRAINS), ids=lambda p: "-".join(p)
)
def program(request: pytest.FixtureRequest) -> StagedProgram:
    state, grid, terrain = request.param
    return driving_case(moving=state == "moving", grid=GRIDS[grid], terrain=TERRAINS[terrain])


# --- first derivatives --------------------------------------------------------------------------


def closing(program: StagedProgram, lin: Any) -> np.ndarray:
    """Basis of the steps that keep the positions' gaps closed; the last one is at the goal."""
    return np.asarray(null_space(lin.A.toarray()[:-2]))


def test_the_jacobian_of_all_inequalities_along_closed_gaps(program: StagedProgram) -> None:
    point = somewhere(program)
    lin = program.linearize(point)
    Z = closing(program, lin)
    expected = central_differences(
        lambda y: program.evaluate(program.moved(lin, point, Z @ y)).inequalities,
        np.zeros(Z.shape[1]),
    )
    found = lin.C @ Z
    scale = np.maximum(1.0, np.abs(expected).max(axis=1, keepdims=True))
    np.testing.assert_allclose(found / scale, expected / scale, atol=DERIVATIVE)


def test_the_jacobian_of_what_is_missed_at_the_goal_along_closed_gaps(
    program: StagedProgram,
) -> None:
    point = somewhere(program)
    lin = program.linearize(point)
    Z = closing(program, lin)
    expected = central_differences(
        lambda y: program.evaluate(program.moved(lin, point, Z @ y)).equalities,
        np.zeros(Z.shape[1]),
    )
    np.testing.assert_array_equal(expected[:-2], 0.0)  # gaps are closed
    scale = max(1.0, float(np.abs(expected).max()))
    np.testing.assert_allclose((lin.A @ Z)[-2:] / scale, expected[-2:] / scale, atol=DERIVATIVE)


def test_a_step_along_closed_gaps_moves_the_positions_as_its_variables_say(
    program: StagedProgram,
) -> None:
    point = somewhere(program)
    lin = program.linearize(point)
    Z = closing(program, lin)
    columns = program.stages.columns[1:-1, program.stages.places].ravel()
    places = program.stages.places

    def positions(y: np.ndarray) -> np.ndarray:
        return np.asarray(program.moved(lin, point, Z @ y).states[1:-1, places].ravel())

    expected = central_differences(positions, np.zeros(Z.shape[1]))
    scale = max(1.0, float(np.abs(expected).max()))
    np.testing.assert_allclose(STATE * Z[columns] / scale, expected / scale, atol=DERIVATIVE)


def test_the_gradient_along_closed_gaps(program: StagedProgram) -> None:
    point = somewhere(program)
    lin = program.linearize(point)
    Z = closing(program, lin)

    def both(y: np.ndarray) -> np.ndarray:
        at = program.evaluate(program.moved(lin, point, Z @ y))
        return np.array([at.objective + at.tie_breaker])

    expected = central_differences(both, np.zeros(Z.shape[1]))[0]
    np.testing.assert_allclose(lin.gradient @ Z, expected, atol=DERIVATIVE)


def test_linearize_and_evaluate_agree(program: StagedProgram) -> None:
    point = somewhere(program)
    one, other = program.evaluate(point), program.linearize(point).at
    np.testing.assert_allclose(one.inequalities, other.inequalities, atol=ROUNDING)
    np.testing.assert_array_equal(one.equalities, other.equalities)


# --- second derivatives -------------------------------------------------------------------------


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("moving", [False, True])
def test_the_hessian_on_a_plane_is_exact_for_rows_in_the_middles_of_the_intervals(
    moving: bool, grid: str
) -> None:
    """With open gaps, whose second derivatives are Simpson's rule: exact for the displacements."""
    program = driving_case(moving=moving, grid=GRIDS[grid])
    point, stages, rng = somewhere(program, 3), program.stages, np.random.default_rng(2)
    N, n, count = program.grid.size, program.n, program.nonlinear
    z = rng.uniform(0.0, 1.0, program.inequalities)
    y = rng.normal(size=2 * N)
    weights = z[:count].reshape(N, POINTS, -1).sum(axis=1)
    M = np.broadcast_to(stages.hermite, (N, stages.m, stages.m))

    def lagrangian(step: np.ndarray) -> float:
        sigma = point.sigma + step[-1]
        moved = STATE * np.where(stages.columns >= 0, step[stages.columns], 0.0)
        x = point.states + moved
        x[0, stages.rates], x[-1, stages.rates] = (
            np.sqrt(sigma) * part for part in (program.first, program.last)
        )
        variables = np.hstack([x[:-1] / STATE, x[1:, : 2 * n] / STATE, np.full((N, 1), sigma)])
        scaled = np.einsum("kuj,kj->ku", M[:, stages.controls], variables)
        q, w = x[:, :n], x[:, n : 2 * n] * program.rate_scale
        controls = scaled.reshape(N, 2, n) * program.control_scale
        S, p = sigma * program.reference**2, x[:, stages.places]
        middle = program.grid.within(0.5, q[:-1], w[:-1], controls)
        assert program.drive is not None
        moves = program.drive.displacements(program.grid, p, q, w, controls)
        gaps = p[:-1] + moves.whole - p[1:]
        limits = program.limits.values(x, scaled, sigma)
        return float(
            sigma
            + 0.5 * program.tie * (scaled**2).sum()
            + (weights * program.rows.evaluate(*middle, S)).sum()
            + z[count:] @ limits
            + y @ gaps.ravel()
        )

    lin = program.linearize(point)
    found = symmetric(program.hessian(lin, y, z, clipped=0.0, damping=0.0))
    expected = second_differences(lagrangian, np.zeros(program.size))
    accuracy = 10.0 * CURVATURE * max(1.0, float(np.abs(expected).max()))
    if moving:  # of the square root of sigma only the convex part is taken
        found[-1, -1] = expected[-1, -1]
    np.testing.assert_allclose(found, expected, atol=accuracy)


def test_the_wholly_clipped_hessian_is_positive_semi_definite(program: StagedProgram) -> None:
    rng = np.random.default_rng(2)
    lin = program.linearize(somewhere(program, 3))
    z, y = rng.uniform(0.0, 1.0, program.inequalities), rng.normal(size=program.equalities)
    H = symmetric(program.hessian(lin, y, z, clipped=1.0, damping=0.0))
    assert np.linalg.eigvalsh(H).min() >= -1e-9 * np.abs(H).max()


@pytest.mark.parametrize("terrain", TERRAINS)
def test_efforts_of_a_driving_base_and_their_curvature_at_one_state(terrain: str) -> None:
    """On a map the position is given; its own derivatives are in the Jacobian."""
    model, rng, S = DrivingModel(TILTED.load(), TERRAINS[terrain]), np.random.default_rng(8), 4.0
    point, weights = rng.uniform(-1.0, 1.0, 24), rng.uniform(-1e-5, 1e-5, (1, 6))
    point[21] = S
    flat = terrain == "plane"

    def parts(p: np.ndarray) -> tuple[Any, ...]:
        place = None if flat else p[None, 22:]
        return p[None, :7], p[None, 7:14], p[None, 14:21], float(p[21]), place

    found = 1e-5 * model.effort_derivatives(*parts(point))[1][0]
    expected = central_differences(lambda p: 1e-5 * model.efforts(*parts(p))[0], point)
    columns = 22 if flat else 24  # positions do not matter in a plane
    assert found.shape[1] == columns
    np.testing.assert_allclose(found, expected[:, :columns], atol=DERIVATIVE)

    def gradient(p: np.ndarray) -> Any:
        return weights[0] @ model.effort_derivatives(*parts(p))[1][0, :, :22]

    q, w, alpha, _, place = parts(point)
    H = effort_curvature(StageSample(model, q, w, alpha, S, place), weights)[0]
    np.testing.assert_allclose(
        H, central_differences(gradient, point)[:, :22], atol=2.0 * CURVATURE
    )


# --- positions ----------------------------------------------------------------------------------


@pytest.mark.parametrize("terrain", TERRAINS)
def test_displacements_are_the_integral_of_the_base_velocity(terrain: str) -> None:
    """The error of one Runge-Kutta step falls with the fifth power of its length."""
    rng, ground = np.random.default_rng(3), TERRAINS[terrain]
    start, yaw0, w0 = np.array([1.0, -2.0]), 0.4, 2.0
    turn, push = rng.uniform(-1.0, 1.0, 2)

    def yaw(s: Any) -> Any:
        return yaw0 + turn * s + 0.5 * s**2

    def rate(s: Any) -> Any:
        return w0 + push * s

    def velocity(s: float, p: np.ndarray) -> np.ndarray:
        pose, rates = np.array([[*p, yaw(s)]]), np.array([[rate(s), 0.0]])
        return np.asarray(ground.ground_rates(pose, rates).rates[0])

    errors, halves = [], []
    for h in (0.4, 0.2):
        s = np.array([[0.0], [0.5 * h], [h]])
        moves = runge_kutta(ground, start[None], yaw(s), rate(s), np.array([h]))
        exact = solve_ivp(velocity, (0.0, h), start, rtol=1e-11, atol=1e-12, dense_output=True)
        errors.append(np.abs(start + moves.whole[0] - exact.y[:, -1]).max())
        halves.append(np.abs(start + moves.half[0] - exact.sol(0.5 * h)).max())
    assert errors[0] < 1e-4
    assert errors[1] < errors[0] / 2.0**4
    assert halves[1] < halves[0] / 2.0**3


def test_displacements_have_the_jacobian_that_differences_have() -> None:
    rng = np.random.default_rng(4)
    steps = np.array([0.2, 0.3])
    point = rng.uniform(-1.0, 1.0, 16)

    def moves(x: np.ndarray) -> Any:
        of = x.reshape(8, 2)
        return runge_kutta(ROUGH, of[:2].T, of[2:5], of[5:], steps)

    whole = central_differences(lambda x: moves(x).whole.ravel(), point).reshape(2, 2, 8, 2)
    half = central_differences(lambda x: moves(x).half.ravel(), point).reshape(2, 2, 8, 2)
    here = moves(point)
    for k in range(2):
        np.testing.assert_allclose(here.whole_jacobian[k], whole[k, :, :, k], atol=DERIVATIVE)
        np.testing.assert_allclose(here.half_jacobian[k], half[k, :, :, k], atol=DERIVATIVE)


def test_a_motion_closes_the_positions_gaps(program: StagedProgram) -> None:
    q, w, controls, _ = program.unpack(point := somewhere(program))
    p = point.states[:, program.stages.places]
    assert program.drive is not None
    moves = program.drive.displacements(program.grid, p, q, w, controls)
    np.testing.assert_allclose(p[:-1] + moves.whole, p[1:], atol=ROUNDING * 10.0)
    np.testing.assert_array_equal(p[0], program.drive.base.start[:2])


def test_joints_and_yaw_end_as_asked_and_the_path_length_is_free(program: StagedProgram) -> None:
    q, w, controls, S = program.unpack(somewhere(program))
    kept = np.arange(program.n) != program.n - 2
    np.testing.assert_allclose(q[-1, kept], program.goal.q[kept], atol=1e-11)
    np.testing.assert_allclose(w[-1], program.goal.v * np.sqrt(S), atol=1e-11)
    assert abs(q[-1, -2] - program.goal.q[-2]) > 1e-3
    again = program.pack(controls, S)
    np.testing.assert_allclose(again.controls, somewhere(program).controls, atol=1e-11)


def test_arriving_hits_the_aim_by_the_accelerations_of_the_path_alone(
    program: StagedProgram,
) -> None:
    """On a turning path both coordinates can be reached; other coordinates keep their motion."""
    q, w, controls, _ = program.unpack(point := somewhere(program))
    grid, drive, places = program.grid, program.drive, program.stages.places
    assert drive is not None
    aim = point.states[-1, places] + [0.03, -0.02]
    found = drive.arrived(grid, q[0], w[0], controls, aim)
    q_after, w_after = grid.rolled(q[0], w[0], found)
    p, _ = drive.path(grid, q_after, w_after, found)
    np.testing.assert_allclose(p[-1], aim, atol=1e-11)
    assert w_after[-1, -2] == pytest.approx(w[-1, -2], abs=1e-10)
    others = np.arange(program.n) != program.n - 2
    np.testing.assert_array_equal(found[:, :, others], controls[:, :, others])


def test_arriving_leaves_alone_what_cannot_be_reached_sideways() -> None:
    program = driving_case(moving=False, grid=Grid.of(4))
    start, w = np.append(program.start.q[:-1], 0.0), np.zeros(7)
    controls = np.zeros((4, 2, 7))
    controls[:, :, -2] = np.array([[4.0, 4.0], [4.0, 4.0], [-4.0, -4.0], [-4.0, -4.0]])
    assert program.drive is not None
    aim = program.drive.base.start[:2] + np.array([1.0, 0.5])
    found = program.drive.arrived(program.grid, start, w, controls, aim)
    np.testing.assert_allclose(found, controls, atol=1e-9)  # it is 1 m ahead at x already


@pytest.mark.parametrize("terrain", TERRAINS)
def test_a_path_found_from_one_nearby_is_the_same(terrain: str) -> None:
    program = driving_case(moving=True, grid=GRIDS["uneven"], terrain=TERRAINS[terrain])
    q, w, controls, _ = program.unpack(somewhere(program))
    drive, grid = program.drive, program.grid
    assert drive is not None
    p, moves = drive.path(grid, q, w, controls)
    off = np.linspace(0.0, 0.2, grid.size + 1)[:, None] * [1.0, -0.5]
    again, same = drive.path(grid, q, w, controls, p + off)
    np.testing.assert_allclose(again, p, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(same.whole, moves.whole, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("terrain", TERRAINS)
def test_changes_of_displacements_propagate_to_the_nodes(terrain: str) -> None:
    program = driving_case(moving=True, grid=GRIDS["uneven"], terrain=TERRAINS[terrain])
    q, w, controls, _ = program.unpack(point := somewhere(program))
    p = point.states[:, program.stages.places]
    drive, grid = program.drive, program.grid
    assert drive is not None
    moves = drive.displacements(grid, p, q, w, controls)
    step = 1e-6
    changed = w.copy()
    changed[:, -2] *= 1.0 + step
    pushed = controls.copy()
    pushed[:, :, -2] *= 1.0 + step
    after, _ = drive.path(grid, q, changed, pushed)
    alone = drive.displacements(grid, p, q, changed, pushed).whole - moves.whole
    np.testing.assert_allclose(propagated(moves, alone), after - p, atol=1e-9)


def test_positions_beyond_a_maps_rim_go_on_as_on_the_rim() -> None:
    low, high = ROUGH.extent
    outside = np.array([[high[0] + 1.0, 0.0]])
    yaw, rate = np.zeros((3, 1)), np.ones((3, 1))
    moves = runge_kutta(ROUGH, outside, yaw, rate, np.array([0.1]))
    on_rim = runge_kutta(ROUGH, np.array([[high[0], 0.0]]), yaw, rate, np.array([0.1]))
    np.testing.assert_allclose(moves.whole, on_rim.whole, atol=ROUNDING)
    np.testing.assert_array_equal(moves.whole_jacobian[:, :, 0], 0.0)
    assert (low < high).all()


def test_heading_and_travel_of_the_guess() -> None:
    ahead, behind = base(goal=(2.0, 0.5, 0.4)), base(goal=(-2.0, 0.5, 0.4))
    assert ahead.travel > 0.0 > behind.travel
    assert abs(behind.travel) == behind.distance
    assert replace(ahead, goal=(0.0, 1.0, 0.0)).travel == 1.0  # sideways: forwards


def test_excess_on_a_map_knows_where_the_base_is() -> None:
    """Samples inside lie on the parabola through the positions at start, middle and end."""
    program = driving_case(moving=False, grid=Grid.of(UNEVEN), terrain=ROUGH)
    point = program.pack(np.zeros((4, 2, 7)), 1.3 * program.reference**2)
    at, (q, w, controls, S) = program.evaluate(point), program.unpack(point)
    p = point.states[:, program.stages.places]
    three = np.stack([p[:-1], p[:-1] + point.moves.half, p[1:]])  # at start, middle and end

    def values(share: float) -> np.ndarray:
        states = program.grid.within(share, q[:-1], w[:-1], controls)
        positions = BarycentricInterpolator([0.0, 0.5, 1.0], three)(share)
        return np.asarray(program.rows.evaluate(*states, S, positions))

    parabola = BarycentricInterpolator([0.0, 0.5, 1.0], [values(s) for s in (0.0, 0.5, 1.0)])
    expected = np.max([values(s) - parabola(s) for s in INSIDE_FINE], axis=0).clip(min=0.0)
    found = program.excess(point, at, fine=True)
    assert found is not None
    assert expected.max() > 1e-6
    per_point = found.reshape(program.grid.size, POINTS, -1)
    np.testing.assert_allclose(per_point, np.stack([expected] * POINTS, axis=1), atol=ROUNDING)
