"""Test 1 of Song & Sharf 2020, held to the paper and to a checker of its own."""

from __future__ import annotations

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.checks import Oracle, check_feasibility
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_scene
from benchmarks.problems.scene import Scene, Tree
from tests.planning.conftest import planned_paper_1

INSIDE = 1e-6  # [m] the tolerance on the ZMP
EXACT = 1e-9  # [rad, per second] of limits and boundary conditions, in closed form
GIVEN_AWAY = 1e-3  # [m] by which a proof for all t may fall short of samples
GRID = 4.505  # [s] 4.5 s is off the grid of 50 intervals by 4 ms
BOTH = pytest.mark.parametrize("point_masses", [True, False], ids=["point masses", "rigid"])


@BOTH
def test_paper_1_takes_4_5_seconds_and_never_tips(point_masses: bool) -> None:
    named, plan = planned_paper_1(point_masses)
    assert plan.success, plan.message
    assert plan.status is zs.Status.FASTEST_POSSIBLE
    assert 4.5 <= plan.duration <= GRID
    assert plan.lower_bound == pytest.approx(4.5, abs=EXACT)
    found = check_feasibility(named.scene, named.problem, plan.trajectory)
    assert found.zmp_at_ends <= INSIDE
    assert found.zmp_between <= INSIDE
    assert found.limits <= EXACT
    assert found.boundary <= EXACT
    assert found.dynamics <= EXACT
    assert plan.margin >= 0.0


@BOTH
def test_the_phase_plane_motion_of_paper_1_leaves_the_polygon_by_more_than_30_cm(
    point_masses: bool,
) -> None:
    named, _ = planned_paper_1(point_masses)
    blind = zs.phase_plane(named.problem.machine, PAPER_START, PAPER_GOAL)
    assert blind.duration == pytest.approx(4.5, abs=EXACT)
    q, v, a = blind(np.linspace(0.0, blind.duration, 500))
    assert Oracle(named.scene).excess(q, v, a) > 0.3
    assert zs.stability_margin(named.problem.machine, q, v, a, named.problem.ground).min() < -0.3


@BOTH
def test_the_margin_a_plan_guarantees_is_no_more_than_an_independent_check_finds(
    point_masses: bool,
) -> None:
    named, plan = planned_paper_1(point_masses)
    found = check_feasibility(named.scene, named.problem, plan.trajectory)
    sampled = -max(found.zmp_at_ends, found.zmp_between)
    assert 0.0 <= plan.margin <= sampled
    assert plan.margin >= sampled - GIVEN_AWAY
    assert plan.certificate.safe
    assert plan.certificate.gap == pytest.approx(plan.duration / 4.5 - 1.0, abs=EXACT)


def test_paper_1_holds_the_margin_it_is_asked_for() -> None:
    scene = paper_scene()
    problem = scene.problem(PAPER_START, PAPER_GOAL, margin=0.2)
    plan = zs.plan(problem)
    assert plan.success, plan.message
    assert check_feasibility(scene, problem, plan.trajectory).violation <= INSIDE
    assert plan.margin >= 0.2


def test_the_checkers_own_zmp_is_eq_5_by_differences() -> None:
    """The oracle's inverse dynamics against second differences, both without the library."""
    rng = np.random.default_rng(4)
    scene = Scene(
        "feller_buncher",
        paper_scene().vertices,
        Tree(3000.0),
        roll=0.3,
        pitch=-0.2,
        point_masses=True,
    )
    oracle = Oracle(scene)
    for _ in range(20):
        q, v, a = rng.uniform(-1.0, 1.0, (3, 5))
        one = oracle.zmp(q[None], v[None], a[None])[0]
        np.testing.assert_allclose(oracle.zmp_by_differences(q, v, a), one, atol=1e-6)


@BOTH
def test_the_checkers_zmp_is_the_librarys(point_masses: bool) -> None:
    rng = np.random.default_rng(5)
    scene = Scene("feller_buncher", paper_scene().vertices, Tree(3000.0), 0.3, -0.2, point_masses)
    q, v, a = rng.uniform(-1.0, 1.0, (3, 50, 5))
    np.testing.assert_allclose(
        zs.zmp(scene.load(), q, v, a, scene.ground), Oracle(scene).zmp(q, v, a), atol=1e-9
    )
