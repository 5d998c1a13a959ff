"""Derivatives, null-space basis and points of the transcription, against central differences."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import zmp_sqp as zs
from benchmarks.problems.checks import Oracle
from benchmarks.problems.paper import paper_scene
from benchmarks.problems.scene import FOOTPRINT, Scene, Tree
from tests.checks import central_differences
from tests.planning.conftest import pose
from tests.planning.programs import (
    CURVATURE,
    DERIVATIVE,
    ROUNDING,
    N,
    anywhere,
    check_curvature_along_closed_gaps,
    closed,
    lagrangian_gradient,
    path_bounds,
    stage_rows,
)
from tests.problems import slider
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.planning import simplified_coordinates
from zmp_sqp.planning.constraints.effort_rows import effort_curvature
from zmp_sqp.planning.constraints.protocol import StageSample
from zmp_sqp.planning.constraints.tip_over import LEAST_NORMAL_FORCE
from zmp_sqp.planning.program import null_space
from zmp_sqp.planning.program.hold import CONSTANT, LINEAR, Hold, slope_ties
from zmp_sqp.planning.program.model import ArmModel
from zmp_sqp.planning.program.null_space import NullSpace
from zmp_sqp.planning.program.transcription import Boundary, Transcription


@dataclass(frozen=True)
class Case:
    scene: Scene
    nlp: Transcription

    def point(self, seed: int = 0) -> np.ndarray:
        return closed(self.nlp, seed)

    def anywhere(self, seed: int = 0) -> np.ndarray:
        return anywhere(self.nlp, seed)


def make(machine: str, *, moving: bool, hold: Hold) -> Case:
    coordinates, distance = None, ()
    if machine == "slider":
        scene, start, goal = slider().scene, np.array([-0.3]), np.array([0.3])
    elif machine == "simplified":  # with bounds on the distance: the paper's way
        scene, start, goal = paper_scene(), np.array([0.1, -0.5]), np.array([1.4, -0.9])
        coordinates = simplified_coordinates(scene.load(), pose(*start))
        loaded = scene.load()
        distance = (zs.DistanceLimits(0.7, 1.3).rows(loaded, coordinates),)
    else:
        scene = Scene("feller_buncher", FOOTPRINT, Tree(3000.0), roll=-0.2, pitch=0.15)
        start, goal = np.array([0.1, -0.5, -2.0, 0.5, -1.5]), np.array([1.4, -0.2, -1.2, 1.0, 0.3])
    loaded, n = scene.load(), len(start)
    rng = np.random.default_rng(7)
    v0, v1 = rng.uniform(-0.5, 0.5, (2, n)) * moving
    bounds = path_bounds(n, lower=-2.9, upper=3.1)
    model = ArmModel(loaded, scene.ground.gravity(), coordinates or Coordinates.identity(n))
    ends = Boundary(start, v0), Boundary(goal, v1)
    rows = stage_rows(model, others=distance)
    return Case(scene, Transcription(rows, *ends, bounds, intervals=N, hold=hold))


@pytest.fixture(
    params=[
        (m, v, h)
        for m in ("feller_buncher", "slider", "simplified")
        for v in (False, True)
        for h in (CONSTANT, LINEAR)
    ],
    ids=lambda p: (
        f"{p[0]}-{'moving' if p[1] else 'rest'}-{'constant' if p[2] is CONSTANT else 'linear'}"
    ),
)
def case(request: pytest.FixtureRequest) -> Case:
    machine, moving, hold = request.param
    return make(machine, moving=moving, hold=hold)


def middle_rows(case: Case) -> slice:
    """Control points between interval ends: their Jacobian holds where gaps are closed."""
    third = case.nlp.layout.wrench_rows // 3
    return slice(2 * third, 3 * third)


def test_equality_jacobian(case: Case) -> None:
    x = case.anywhere()
    expected = central_differences(lambda at: case.nlp.evaluate(at).equalities, x)
    np.testing.assert_allclose(case.nlp.linearize(x).A.toarray(), expected, atol=DERIVATIVE)


def test_inequality_jacobian_but_for_the_middle_control_points(case: Case) -> None:
    x = case.anywhere()
    expected = central_differences(lambda at: case.nlp.evaluate(at).inequalities, x)
    rest = np.ones(len(expected), dtype=bool)
    rest[middle_rows(case)] = False
    np.testing.assert_allclose(
        case.nlp.linearize(x).C.toarray()[rest], expected[rest], atol=DERIVATIVE
    )


def test_inequality_jacobian_along_the_manifold_of_closed_gaps(case: Case) -> None:
    x = case.point()
    lin = case.nlp.linearize(x)
    Z = lin.basis.Z
    expected = central_differences(
        lambda y: case.nlp.evaluate(x + Z @ y).inequalities, np.zeros(Z.shape[1])
    )
    np.testing.assert_allclose(
        lin.C @ Z, expected, atol=DERIVATIVE * max(1.0, float(np.abs(Z).max()))
    )


def test_objective_gradients(case: Case) -> None:
    x = case.anywhere()
    lin = case.nlp.linearize(x)
    both = central_differences(
        lambda at: np.array([case.nlp.evaluate(at).objective, case.nlp.evaluate(at).tie_breaker]), x
    )
    np.testing.assert_allclose(np.vstack([lin.gradient, lin.tie_gradient]), both, atol=DERIVATIVE)


def test_linearize_and_evaluate_agree(case: Case) -> None:
    x = case.anywhere()
    one, other = case.nlp.evaluate(x), case.nlp.linearize(x).at
    np.testing.assert_allclose(one.inequalities, other.inequalities, atol=ROUNDING)
    np.testing.assert_array_equal(one.equalities, other.equalities)


def test_basis_spans_the_null_space_of_the_gaps_and_closes_them(case: Case) -> None:
    lin = case.nlp.linearize(case.anywhere())
    basis = lin.basis
    gaps = lin.A[: basis.eliminated]
    assert np.linalg.matrix_rank(basis.Z) == basis.Z.shape[1] == len(case.nlp.layout.free)
    assert basis.Z.shape[1] == basis.Z.shape[0] - basis.eliminated
    np.testing.assert_allclose(gaps @ basis.Z, 0.0, atol=ROUNDING)
    np.testing.assert_allclose(
        gaps @ basis.d, -lin.at.equalities[: basis.eliminated], atol=ROUNDING
    )
    np.testing.assert_array_equal(basis.Z[basis.free], np.eye(basis.Z.shape[1]))
    np.testing.assert_array_equal(basis.d[basis.free], 0.0)


def test_a_basis_that_is_only_its_products_is_the_dense_one(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    nlp, rng = case.nlp, np.random.default_rng(5)
    ties = slope_ties(np.ones((nlp.N, nlp.n))) if nlp.hold is LINEAR else None
    x = case.anywhere()
    for tied in (None, ties) if ties is not None else (None,):
        dense, implicit = (
            transcribed(nlp, tied, monkeypatch, most).linearize(x).basis.Z for most in (10**7, 0)
        )
        assert isinstance(implicit, NullSpace)
        assert implicit.shape == dense.shape
        move, moves = rng.normal(size=dense.shape[1]), rng.normal(size=(dense.shape[1], 3))
        rows = sp.random_array((7, len(dense)), density=0.3, rng=rng, format="csr")
        for left, right in (
            (implicit @ move, dense @ move),
            (implicit @ moves, dense @ moves),
            (rows @ implicit, rows @ dense),
            (rows.toarray() @ implicit, rows.toarray() @ dense),
            (implicit.T @ x, dense.T @ x),
            (implicit.T @ np.ones((len(dense), 2)), dense.T @ np.ones((len(dense), 2))),
            (implicit[[0, 3, -1]], dense[[0, 3, -1]]),
            (implicit[:-1], dense[:-1]),
        ):
            np.testing.assert_allclose(
                left, right, atol=1e-12 * max(1.0, float(np.abs(right).max()))
            )


def transcribed(
    nlp: Transcription, ties: Any, monkeypatch: pytest.MonkeyPatch, most: int
) -> Transcription:
    monkeypatch.setattr(null_space, "MOST_ENTRIES", most)
    return Transcription(
        nlp.rows,
        nlp.start,
        nlp.goal,
        nlp.bounds,
        intervals=nlp.N,
        hold=nlp.hold,
        ties=ties,
    )


def test_hessian_of_the_lagrangian(case: Case) -> None:
    """Multipliers on all rows but those of middle control points, which need closed gaps."""
    nlp, x, rng = case.nlp, case.point(3), np.random.default_rng(2)
    lin = nlp.linearize(x)
    z = rng.uniform(0.0, 1.0, len(lin.at.inequalities))
    z[middle_rows(case)] = 0.0
    y = rng.normal(0.0, 1.0, len(lin.at.equalities))
    y[: lin.basis.eliminated] = 0.0

    H = nlp.hessian(x, y[lin.basis.eliminated :], z, convex=False).toarray()
    expected = central_differences(lambda at: lagrangian_gradient(nlp, at, y, z), x)
    np.testing.assert_allclose(
        H, expected, atol=CURVATURE * max(1.0, float(np.abs(expected).max()))
    )
    np.testing.assert_allclose(H, H.T, atol=ROUNDING * float(np.abs(H).max()))


def test_hessian_along_closed_gaps_with_the_middle_control_points(case: Case) -> None:
    check_curvature_along_closed_gaps(case.nlp)


def test_convex_hessian_is_positive_semi_definite(case: Case) -> None:
    rng = np.random.default_rng(2)
    lin = case.nlp.linearize(case.point(3))
    z = rng.uniform(0.0, 1.0, len(lin.at.inequalities))
    H = case.nlp.hessian(case.point(3), np.zeros(2 * case.nlp.n), z, convex=True).toarray()
    assert np.linalg.eigvalsh(H).min() >= -1e-9 * np.abs(H).max()


def test_effort_curvature(case: Case) -> None:
    model, rng, S = case.nlp.rows.corners[0].model, np.random.default_rng(8), 4.0
    n = model.size
    q, w, alpha = rng.uniform(-1.0, 1.0, (3, 1, n))
    weights = rng.normal(0.0, 1e-5, (1, 6))

    def gradient(at: np.ndarray) -> Any:
        parts = at[:n], at[n : 2 * n], at[2 * n : 3 * n]
        return weights[0] @ model.effort_derivatives(*(part[None] for part in parts), at[-1])[1][0]

    expected = central_differences(gradient, np.concatenate([q[0], w[0], alpha[0], [S]]))
    found = effort_curvature(StageSample(model, q, w, alpha, S), weights)[0]
    np.testing.assert_allclose(found, expected, atol=CURVATURE * float(np.abs(expected).max()))


# --- points -------------------------------------------------------------------------------------


def test_pack_closes_the_gaps_and_unpack_undoes_it(case: Case) -> None:
    rng = np.random.default_rng(9)
    controls = rng.normal(0.0, 3.0, (N, case.nlp.hold.controls, case.nlp.n))
    x = case.nlp.pack(controls, 5.0)
    np.testing.assert_allclose(
        case.nlp.evaluate(x).equalities[: case.nlp.layout.eliminated], 0.0, atol=ROUNDING
    )
    _, _, back, S = case.nlp.unpack(x)
    np.testing.assert_allclose(back, controls, rtol=ROUNDING)
    assert pytest.approx(5.0, rel=ROUNDING) == S


def test_arrived_meets_the_goal_to_rounding_and_leaves_a_point_alone_that_does(case: Case) -> None:
    nlp = case.nlp
    q, w, controls, S = nlp.arrived(case.anywhere())
    np.testing.assert_allclose(q[0], nlp.start.q, atol=ROUNDING)
    np.testing.assert_allclose(q[-1], nlp.goal.q, atol=ROUNDING)
    np.testing.assert_allclose(w[0], nlp.start.v * np.sqrt(S), atol=ROUNDING)
    np.testing.assert_allclose(w[-1], nlp.goal.v * np.sqrt(S), atol=ROUNDING)
    again = nlp.arrived(nlp.pack(controls, S))
    np.testing.assert_allclose(again[2], controls, atol=1e-10)


def test_wrench_rows_are_the_distances_to_the_edges_times_the_normal_force(case: Case) -> None:
    """(e . p - b + margin) f_z over weight and reference squared, at both interval ends."""
    nlp, x = case.nlp, case.point(5)
    q, w, controls, S = nlp.unpack(x)
    T, oracle, arm = np.sqrt(S), Oracle(case.scene), nlp.rows.corners[0].model.coordinates
    rows = nlp.evaluate(x).inequalities[: nlp.layout.wrench_rows].reshape(3, N, -1)
    edges = len(oracle.offsets)  # then the normal force, then rows of the distance
    force = (LEAST_NORMAL_FORCE * x[-1] - rows[..., edges])[
        ..., None
    ]  # f_z S over the weight and the reference's square
    for rows_there, force_there, where, push in (
        (rows[0], force[0], slice(None, -1), controls[:, 0]),
        (rows[1], force[1], slice(1, None), controls[:, -1]),
    ):
        joints = arm.joints(q[where]), arm.rates(w[where] / T), arm.rates(push / S)
        over = oracle.offsets - oracle.zmp(*joints) @ oracle.inward.T
        assert (force_there > 0.0).all()
        np.testing.assert_allclose(rows_there[:, :edges], (over + 0.05) * force_there, atol=1e-9)
