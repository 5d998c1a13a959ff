"""Shortest steps where nothing is left to optimise, by a second solver; None if none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from tests.sqp.problems import named
from zmp_sqp.sqp.backends import make_backend
from zmp_sqp.sqp.nlp import Evaluation, Linearization
from zmp_sqp.sqp.qp import QP
from zmp_sqp.sqp.restoration import DEAR, SCREEN, _shortest_step, restored

SAME = 1e-7


def random_linearization(
    seed: int, *, size: int = 12, equalities: int = 3, rows: int = 40
) -> Linearization:
    """Random constraints that some step meets, with an objective that no variable moves."""
    rng = np.random.default_rng(seed)
    A, C, step = (
        rng.normal(size=(equalities, size)),
        rng.normal(size=(rows, size)),
        rng.normal(size=size),
    )
    at = Evaluation(1.0, 0.0, -A @ step, -C @ step - rng.exponential(0.3, rows))
    return Linearization(at, np.zeros(size), np.zeros(size), sp.csr_array(A), sp.csr_array(C), None)


@pytest.mark.parametrize("seed", range(20))
def test_the_step_is_the_shortest_by_a_qp_solver_too(seed: int) -> None:
    lin = random_linearization(seed)
    dx, _ = _shortest_step(lin, np.ones(len(lin.at.inequalities), dtype=bool), SAME)
    assert dx is not None
    A, C, free = lin.A.toarray(), lin.C.toarray(), np.full(len(lin.at.inequalities), -np.inf)
    qp = QP(
        np.eye(len(dx)), np.zeros(len(dx)), A, -lin.at.equalities, C, free, -lin.at.inequalities
    )
    np.testing.assert_allclose(dx, make_backend("proxqp").solve(qp).x, atol=SAME)


def test_the_variable_of_the_objective_stays_where_others_can_move() -> None:
    A, C = sp.csr_array([[1.0, 1.0]]), sp.csr_array([[0.0, 1.0]])
    at = Evaluation(1.0, 0.0, np.array([-1.0]), np.array([-5.0]))
    dx, _ = _shortest_step(
        Linearization(at, np.array([0.0, 1.0]), np.zeros(2), A, C, None),
        np.ones(1, dtype=bool),
        SAME,
    )
    assert dx is not None
    np.testing.assert_allclose(dx, [1.0, 0.0], atol=2.0 / DEAR**2)


def test_without_inequalities_the_step_is_that_of_least_squares() -> None:
    lin = random_linearization(1)
    dx, _ = _shortest_step(
        replace(lin, at=replace(lin.at, inequalities=lin.at.inequalities - 100.0)),
        np.zeros(len(lin.at.inequalities), dtype=bool),
        SAME,
    )
    assert dx is not None
    np.testing.assert_allclose(dx, -np.linalg.pinv(lin.A.toarray()) @ lin.at.equalities, atol=SAME)


def test_rows_that_were_not_looked_at_join_when_the_step_violates_them() -> None:
    grown = 0
    for seed in range(20):
        lin = random_linearization(seed)
        near = lin.at.inequalities > -SCREEN
        dx, working = _shortest_step(lin, near, SAME)
        if dx is None:  # three rounds were not enough: a QP takes over
            continue
        grown += int(working.sum() > near.sum())
        assert (lin.at.inequalities + lin.C @ dx).max() <= 0.1 * lin.at.violation + SAME
        np.testing.assert_allclose(lin.A @ dx, -lin.at.equalities, atol=SAME)
    assert grown > 5


def test_constraints_without_a_common_point_give_no_step() -> None:
    lin = random_linearization(0)
    C = sp.csr_array(np.vstack([lin.C.toarray(), -lin.C.toarray()[:1]]))
    value = lin.at.inequalities[0]
    contradicted = replace(lin.at, inequalities=np.append(lin.at.inequalities, 1.0 - value))
    dx, _ = _shortest_step(
        replace(lin, at=contradicted, C=C), np.ones(C.shape[0], dtype=bool), SAME
    )
    assert dx is None
    twice = sp.csr_array(np.vstack([lin.A.toarray(), lin.A.toarray()[:1]]))
    dependent = replace(
        lin, A=twice, at=replace(lin.at, equalities=np.append(lin.at.equalities, 3.0))
    )
    dx, _ = _shortest_step(dependent, np.ones(len(lin.at.inequalities), dtype=bool), SAME)
    assert dx is None


def test_an_objective_that_would_leave_its_bound_is_left_to_the_qp() -> None:
    """A textbook program knows no bound: every step leaves it by an unknown amount."""
    problem = named("HS39")
    lin = problem.linearize(problem.x0)
    none = np.zeros(len(lin.at.inequalities))
    assert restored(problem, problem.x0, lin, none, feasibility=SAME, optimality=SAME) is None
