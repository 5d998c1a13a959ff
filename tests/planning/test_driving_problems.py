"""Seeded random drive-and-swing problems; all 100 are in benchmarks/driving_problems.py."""

from __future__ import annotations

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.driving import KINDS, random_driving_problem
from benchmarks.problems.driving_checks import TOLERANCES, driving_violation

# every kind, in motion and in corridors among them
SEEDS = (0, 2, 3, 5, 9, 10, 11, 18, 19, 22, 41, 44)
ITERATIONS = 60


@pytest.mark.parametrize("seed", SEEDS)
def test_random_drives_are_solved_and_an_independent_check_agrees(seed: int) -> None:
    drawn = random_driving_problem(seed)
    plan = zs.plan(drawn.problem)
    assert plan.success, plan.message
    assert plan.lower_bound <= plan.duration
    assert plan.iterations <= ITERATIONS
    violation = driving_violation(drawn, plan.trajectory)
    assert all(violation[name] <= tolerance for name, tolerance in TOLERANCES.items()), violation


def test_the_subset_has_every_kind() -> None:
    drawn = [random_driving_problem(seed) for seed in SEEDS]
    assert {problem.kind for problem in drawn} == set(KINDS)
    assert any(problem.moving for problem in drawn)
    assert any(problem.corridor for problem in drawn)


def test_a_seed_is_the_same_drive_for_ever() -> None:
    """Results under benchmarks/results name seeds."""
    drawn = random_driving_problem(3)
    np.testing.assert_allclose(
        drawn.problem.base.goal,
        [3.961445936969192, -0.4885157473880839, 2.427366921986571],
        rtol=1e-9,
    )
    assert drawn.scene.tree is not None
    assert drawn.scene.tree.mass == pytest.approx(1834.8277478534696, rel=1e-12)
