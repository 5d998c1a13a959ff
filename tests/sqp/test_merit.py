"""The penalty function and its first-order model."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from tests.sqp.problems import HOCK_SCHITTKOWSKI, Textbook
from zmp_sqp.sqp.merit import Merit
from zmp_sqp.sqp.nlp import Evaluation
from zmp_sqp.sqp.subproblem import Step

STEP = 1e-5  # the model errs by its square times curvatures, at most some thousands here
MODEL_TOLERANCE = 1e-4  # of the predicted change per unit step, relative


@pytest.mark.parametrize("problem", HOCK_SCHITTKOWSKI, ids=lambda problem: problem.name)
def test_small_steps_change_the_penalty_as_predicted(problem: Textbook) -> None:
    rng = np.random.default_rng(1)
    merit = Merit(problem.nonlinear_rows, nu=3.0, mu=2.0)
    x = problem.x0 + rng.uniform(0.0, 0.01, len(problem.x0))  # off the kinks
    lin = problem.linearize(x)
    for _ in range(5):
        dx = STEP * rng.standard_normal(len(x))
        actual = merit.value(lin.at) - merit.value(problem.evaluate(x + dx))
        scale = STEP * (np.abs(lin.gradient).sum() + abs(lin.A).sum() + abs(lin.C).sum())
        assert merit.predicted_decrease(lin, dx) == pytest.approx(
            actual, abs=MODEL_TOLERANCE * scale
        )


def test_the_penalty_is_infinite_where_the_program_cannot_be_evaluated() -> None:
    merit = Merit(np.array([True]))
    for bad in (np.nan, np.inf):
        assert merit.value(Evaluation(bad, 0.0, np.zeros(1), np.zeros(1))) == np.inf
        assert merit.value(Evaluation(0.0, 0.0, np.full(1, bad), np.zeros(1))) == np.inf
        assert merit.value(Evaluation(0.0, 0.0, np.zeros(1), np.full(1, bad))) == np.inf


def test_nonlinear_rows_count_by_their_largest_violation_and_linear_ones_by_their_sum() -> None:
    merit = Merit(np.array([True, True, False, False]), nu=10.0, mu=100.0)
    at = Evaluation(1.0, 0.5, np.array([0.25, -0.25]), np.array([3.0, 2.0, 0.5, 0.25]))
    assert merit.value(at) == pytest.approx(1.5 + 10.0 * 3.0 + 100.0 * (0.5 + 0.75))
    merit.breaks_ties = False
    assert merit.value(at) == pytest.approx(1.0 + 10.0 * 3.0 + 100.0 * (0.5 + 0.75))


def test_weights_rise_above_the_dual_norms_and_never_fall() -> None:
    merit = Merit(np.array([True, True, False]))
    merit.raise_weights(
        Step(np.zeros(1), np.array([-7.0]), np.array([2.0, 3.0, 4.0]), 0.0, True, "none", 1, 3)
    )
    assert merit.nu > 5.0
    assert merit.mu > 7.0
    before = merit.nu, merit.mu
    merit.raise_weights(Step(np.zeros(1), np.zeros(1), np.zeros(3), 0.0, True, "none", 1, 3))
    assert (merit.nu, merit.mu) == before


def test_a_qp_step_lowers_the_penalty_to_first_order() -> None:
    from zmp_sqp.sqp.backends import make_backend
    from zmp_sqp.sqp.subproblem import Model, Subproblem

    for problem in HOCK_SCHITTKOWSKI:
        lin = problem.linearize(problem.x0)
        H = sp.eye_array(len(problem.x0), format="csr")
        zeros = np.zeros(lin.A.shape[0]), np.zeros(lin.C.shape[0])
        step = Subproblem(lin, problem.nonlinear_rows, make_backend("proxqp"), None).solve(
            Model(lin.gradient, lin.gradient, H.toarray(), H), previous=zeros
        )
        assert step.solved, problem.name
        merit = Merit(problem.nonlinear_rows)
        merit.raise_weights(step)
        # dx' H dx and H = I
        assert merit.predicted_decrease(lin, step.dx) >= float(step.dx @ step.dx) - 1e-6
