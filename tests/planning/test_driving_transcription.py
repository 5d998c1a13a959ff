"""Derivatives and null-space basis of the driving program, against differences."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.problems.scene import FOOTPRINT, Scene, Tree
from benchmarks.problems.terrain import rolling_map
from benchmarks.problems.terrain import unicycle_base as base
from tests.checks import central_differences
from tests.planning.programs import (
    CURVATURE,
    DERIVATIVE,
    ROUNDING,
    N,
    anywhere,
    closed,
    lagrangian_gradient,
    path_bounds,
    stage_rows,
)
from zmp_sqp.planning.constraints.effort_rows import effort_curvature
from zmp_sqp.planning.constraints.protocol import StageSample
from zmp_sqp.planning.program.driving.model import DrivingModel
from zmp_sqp.planning.program.driving.transcription import DrivingTranscription
from zmp_sqp.planning.program.hold import CONSTANT, LINEAR, Hold, slope_ties
from zmp_sqp.planning.program.transcription import Boundary, Transcription

ROUGH = rolling_map(
    -10.0, 5.0, waves=((0.6, 9.0, 0.3, 0.5), (0.4, 7.0, 1.9, 2.0)), low=(-40, -40), high=(40, 40)
)
SCENE = Scene("feller_buncher", FOOTPRINT, Tree(3000.0), roll=-0.2, pitch=0.15)


def make(
    *, moving: bool, hold: Hold, tied: bool = False, terrain: Any = SCENE.ground
) -> DrivingTranscription:
    machine, rng = SCENE.load(), np.random.default_rng(7)
    v0, v1 = rng.uniform(-0.4, 0.4, (2, 7)) * moving
    given = base(
        (0.5, -0.2, 0.3),
        (-2.0, 1.0, -0.5),
        start_velocity=v0[5:],
        goal_velocity=v1[5:],
        y_bounds=(-1.0, 1.5),
    )
    start = np.array([0.1, -0.5, -2.0, 0.5, -1.5, 0.0, 0.3])
    goal = np.array([1.4, -0.2, -1.2, 1.0, 0.3, given.travel, -0.5])
    bounds = path_bounds(7, lower=-9.0, upper=9.1)
    ties = slope_ties(rng.normal(0.0, 1.0, (N, 7))) if tied else None
    ends = Boundary(start, v0), Boundary(goal, v1)
    model = DrivingModel(machine, terrain)
    return DrivingTranscription(
        Transcription(stage_rows(model), *ends, bounds, intervals=N, hold=hold, ties=ties),
        given,
        terrain,
    )


@pytest.fixture(
    params=[
        (v, h, t) for v in (False, True) for h in (CONSTANT, LINEAR) for t in (SCENE.ground, ROUGH)
    ],
    ids=lambda p: "-".join(
        (
            "moving" if p[0] else "rest",
            "constant" if p[1] is CONSTANT else "linear",
            type(p[2]).__name__.lower(),
        )
    ),
)
def nlp(request: pytest.FixtureRequest) -> DrivingTranscription:
    return make(moving=request.param[0], hold=request.param[1], terrain=request.param[2])


def test_a_packed_point_has_no_gaps(nlp: DrivingTranscription) -> None:
    np.testing.assert_allclose(
        nlp.evaluate(closed(nlp)).equalities[: nlp.eliminated], 0.0, atol=ROUNDING
    )


def test_equality_jacobian(nlp: DrivingTranscription) -> None:
    x = anywhere(nlp)
    expected = central_differences(lambda at: nlp.evaluate(at).equalities, x)
    np.testing.assert_allclose(nlp.linearize(x).A.toarray(), expected, atol=DERIVATIVE)


def test_inequality_jacobian_along_the_manifold_of_closed_gaps(nlp: DrivingTranscription) -> None:
    x = closed(nlp)
    lin = nlp.linearize(x)
    Z = lin.basis.Z
    expected = central_differences(
        lambda y: nlp.evaluate(x + Z @ y).inequalities, np.zeros(Z.shape[1])
    )
    np.testing.assert_allclose(
        lin.C @ Z, expected, atol=DERIVATIVE * max(1.0, float(np.abs(Z).max()))
    )


def test_linearize_and_evaluate_agree(nlp: DrivingTranscription) -> None:
    x = anywhere(nlp)
    one, other = nlp.evaluate(x), nlp.linearize(x).at
    np.testing.assert_allclose(one.inequalities, other.inequalities, atol=ROUNDING)
    np.testing.assert_array_equal(one.equalities, other.equalities)
    assert len(nlp.nonlinear_rows) == len(one.inequalities)


@pytest.mark.parametrize("tied", [False, True])
def test_basis_spans_the_null_space_of_the_gaps_and_closes_them(
    nlp: DrivingTranscription, tied: bool
) -> None:
    if tied:
        nlp = make(moving=True, hold=LINEAR, tied=True, terrain=nlp.terrain)
    lin = nlp.linearize(anywhere(nlp))
    basis = lin.basis
    gaps = lin.A[: basis.eliminated]
    assert np.linalg.matrix_rank(basis.Z) == basis.Z.shape[1]
    np.testing.assert_allclose(gaps @ basis.Z, 0.0, atol=ROUNDING)
    np.testing.assert_allclose(
        gaps @ basis.d, -lin.at.equalities[: basis.eliminated], atol=ROUNDING
    )
    if not tied:
        assert basis.Z.shape[1] == basis.Z.shape[0] - basis.eliminated == len(basis.free)
        np.testing.assert_array_equal(basis.Z[basis.free], np.eye(basis.Z.shape[1]))
        np.testing.assert_array_equal(basis.d[basis.free], 0.0)


def test_arriving_meets_the_goal_to_rounding(nlp: DrivingTranscription) -> None:
    x = closed(nlp)
    q, w, controls, S = nlp.arrived(x)
    goal, T = nlp.inner.goal, np.sqrt(S)
    kept = np.arange(nlp.n) != nlp.n - 2
    np.testing.assert_allclose(q[-1, kept], goal.q[kept], atol=1e-9)
    np.testing.assert_allclose(w[-1], goal.v * T, atol=1e-9)
    equalities = nlp.evaluate(nlp.pack(controls, S)).equalities
    np.testing.assert_allclose(equalities, 0.0, atol=1e-9)


@pytest.mark.parametrize("hold", [CONSTANT, LINEAR])
@pytest.mark.parametrize("moving", [False, True])
def test_hessian_of_the_lagrangian_with_the_gaps_multipliers_that_follow(
    hold: Hold, moving: bool
) -> None:
    nlp = make(moving=moving, hold=hold)
    x, rng = closed(nlp, 3), np.random.default_rng(2)
    lin = nlp.linearize(x)
    z = rng.uniform(0.0, 1.0, len(lin.at.inequalities))
    third = nlp.inner.layout.wrench_rows // 3
    z[2 * third : 3 * third] = 0.0  # middle control points: rows of closed gaps alone
    y = rng.normal(0.0, 1.0, len(lin.at.equalities))
    eliminated = lin.basis.eliminated
    y[:eliminated] = 0.0
    # of the bounds on y, at the nodes
    pull = (lin.C.T @ (z * ~nlp.nonlinear_rows))[nlp.positions].reshape(-1, 2)
    price = y[-2:] + np.cumsum(pull[:0:-1], axis=0)[::-1]
    # so that no position changes the Lagrangian
    y[eliminated - 2 * N : eliminated] = -price.ravel()

    H = nlp.hessian(x, y[eliminated:], z, convex=False).toarray()
    expected = central_differences(lambda at: lagrangian_gradient(nlp, at, y, z), x)
    np.testing.assert_allclose(
        H, expected, atol=CURVATURE * max(1.0, float(np.abs(expected).max()))
    )


def test_wrench_slopes_and_curvature() -> None:
    model, rng, S = (
        make(moving=False, hold=CONSTANT).inner.rows.corners[0].model,
        np.random.default_rng(8),
        4.0,
    )
    point, weights = rng.uniform(-1.0, 1.0, 22), rng.uniform(-1e-5, 1e-5, (1, 6))
    point[-1] = S

    def wrench(p: np.ndarray) -> Any:
        return 1e-5 * model.efforts(p[None, :7], p[None, 7:14], p[None, 14:21], p[21])[0]

    def slopes(p: np.ndarray) -> Any:
        return (
            weights[0]
            @ model.effort_derivatives(p[None, :7], p[None, 7:14], p[None, 14:21], p[21])[1][
                0, :, :22
            ]
        )

    at = point[None, :7], point[None, 7:14], point[None, 14:21], S
    found = 1e-5 * model.effort_derivatives(*at)[1][0]
    assert found.shape[1] == 22  # positions do not matter in a plane
    np.testing.assert_allclose(found, central_differences(wrench, point), atol=DERIVATIVE)
    H = effort_curvature(StageSample(model, *at), weights)[0]
    np.testing.assert_allclose(H, central_differences(slopes, point), atol=2.0 * CURVATURE)


def test_heading_and_travel_of_the_guess() -> None:
    ahead, behind = base(goal=(2.0, 0.5, 0.4)), base(goal=(-2.0, 0.5, 0.4))
    assert ahead.travel > 0.0 > behind.travel
    assert abs(behind.travel) == behind.distance
    assert replace(ahead, goal=(0.0, 1.0, 0.0)).travel == 1.0  # sideways: forwards
