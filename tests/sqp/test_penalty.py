"""The penalty function is exact, and its weights are above the multipliers' dual norms."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sqp.problems import HOCK_SCHITTKOWSKI, named
from zmp_sqp.sqp.backends import make_backend
from zmp_sqp.sqp.direction import Subproblem
from zmp_sqp.sqp.iterate import CurvatureModel, Penalty
from zmp_sqp.sqp.nlp import Evaluation
from zmp_sqp.sqp.solver import SQP, SQPSettings


def test_nonlinear_rows_count_by_their_largest_violation_and_linear_ones_by_their_sum() -> None:
    penalty = Penalty(nonlinear=10.0, linear=100.0, equality=1000.0)
    at = Evaluation(1.0, 0.5, np.array([0.25, -0.25]), np.array([3.0, 2.0, 0.5, 0.25]))
    expected = 1.5 + 10.0 * 3.0 + 100.0 * (0.5 + 0.25) + 1000.0 * 0.5
    assert penalty.merit(at, 2) == pytest.approx(expected)
    kept = Evaluation(1.0, 0.5, np.zeros(2), np.array([-3.0, 0.0, -0.5, 0.0]))
    assert penalty.merit(kept, 2) == 1.5


def test_the_penalty_is_infinite_where_the_program_cannot_be_evaluated() -> None:
    for bad in (np.nan, np.inf):
        for at in (
            Evaluation(bad, 0.0, np.zeros(1), np.zeros(1)),
            Evaluation(0.0, 0.0, np.full(1, bad), np.zeros(1)),
            Evaluation(0.0, 0.0, np.zeros(1), np.full(1, bad)),
        ):
            assert Penalty().merit(at, 1) == np.inf


def test_weights_rise_above_the_dual_norms_and_fall_slowly() -> None:
    raised = Penalty().raised(np.array([-7.0]), np.array([2.0, 3.0, 4.0]), 2)
    assert raised.nonlinear > 5.0
    assert raised.linear > 4.0
    assert raised.equality > 7.0
    fallen = raised.raised(np.zeros(1), np.zeros(3), 2)
    assert 0.5 * raised.nonlinear < fallen.nonlinear < raised.nonlinear
    for _ in range(50):
        fallen = fallen.raised(np.zeros(1), np.zeros(3), 2)
    assert min(fallen.nonlinear, fallen.linear, fallen.equality) > 0.0


@pytest.mark.parametrize("name", ["HS43", "HS71", "HS100"])
def test_a_solution_minimises_the_penalty_function(name: str) -> None:
    """With weights above the multipliers' dual norms, near the solution no point is better."""
    problem = named(name)
    settings = SQPSettings(converged=1e-9)
    result = SQP(make_backend("piqp"), settings=settings).minimize(problem, problem.x0)
    penalty = Penalty().raised(result.y, result.z, problem.nonlinear)
    least = penalty.merit(result.at, problem.nonlinear)
    rng = np.random.default_rng(0)
    for radius in (1e-3, 1e-2):
        for _ in range(100):
            step = rng.normal(size=problem.size)
            near = problem.evaluate(result.point + radius * step / np.linalg.norm(step))
            assert penalty.merit(near, problem.nonlinear) >= least - 1e-5
    too_low = Penalty(0.1 * penalty.nonlinear, 0.1 * penalty.linear, 0.1 * penalty.equality)
    downhill = result.point - 1e-2 * problem.linearize(result.point).gradient
    lower = too_low.merit(problem.evaluate(downhill), problem.nonlinear)
    assert lower < too_low.merit(result.at, problem.nonlinear)


def test_a_qp_step_lowers_the_penalty_to_first_order() -> None:
    for problem in HOCK_SCHITTKOWSKI:
        lin = problem.linearize(problem.x0)
        y, z = np.zeros(problem.equalities), np.zeros(problem.inequalities)
        everything = np.ones(problem.inequalities, dtype=bool)
        subproblem = Subproblem(lin, problem.metric(), everything, make_backend("piqp"), 1e-9)
        direction = subproblem.solve(iterations=100, y=y, z=z)
        assert direction is not None, problem.name
        penalty = Penalty().raised(direction.y, direction.z, problem.nonlinear)
        after = penalty.of(direction.predicted, np.zeros(0), problem.nonlinear)
        before = penalty.of(lin.at.inequalities, lin.at.equalities, problem.nonlinear)
        # the QP's Hessian is the identity
        promised = before - after - float(lin.gradient @ direction.step)
        assert promised >= float(direction.step @ direction.step) - 1e-6


def test_damping_comes_with_short_steps_and_fades_with_full_ones() -> None:
    model = CurvatureModel()
    for _ in range(3):
        model = model.after_step(0.1)
    assert model.damping == pytest.approx(0.1)
    assert model.after_step(0.5) == model
    for _ in range(20):
        model = model.after_step(1.0)
    assert model.damping == 0.0
