"""The active-set method: exact, insensitive to rounding of its guess, never a wrong answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.sqp.test_backends import AGREEMENT, infeasible_qp, random_qp
from zmp_sqp.sqp.backends import make_backend
from zmp_sqp.sqp.backends.active_set import ActiveSetMethod
from zmp_sqp.sqp.qp import QP, QPSolution

EXACT = 1e-9
PIVOTS = 500


def reference(qp: QP) -> QPSolution:
    return make_backend("piqp").solve(qp)


def empty_guess(qp: QP) -> QPSolution:
    return QPSolution(np.zeros(qp.size), np.zeros(len(qp.b)), np.zeros(len(qp.u)), False, 0, "")


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("diagonal", [True, False])
def test_it_finds_the_solution_from_a_rough_guess_and_from_none(seed: int, diagonal: bool) -> None:
    qp = random_qp(seed)
    if diagonal:
        qp = replace(qp, H=np.diag(qp.H.diagonal()))
    expected, rng = reference(qp), np.random.default_rng(seed)
    rough = replace(expected, x=expected.x + 1e-4 * rng.normal(size=qp.size))
    for guess in (expected, rough, empty_guess(qp)):
        found = ActiveSetMethod(qp).solve(guess, most_pivots=PIVOTS)
        assert found is not None
        assert max(found.residuals(qp)) <= EXACT * np.abs(qp.g).max()
        assert np.abs(found.x - expected.x).max() <= AGREEMENT


@pytest.mark.parametrize("seed", range(6))
def test_its_bits_do_not_depend_on_the_last_digits_of_the_guess(seed: int) -> None:
    qp, rng = random_qp(seed), np.random.default_rng(seed)
    guess = reference(qp)
    found = {
        ActiveSetMethod(qp)
        .solve(
            replace(
                guess,
                x=guess.x + 1e-12 * rng.normal(size=qp.size),
                z=guess.z * (1.0 + 1e-12 * rng.normal()),
            ),
            most_pivots=PIVOTS,
        )
        .x.tobytes()
        for _ in range(10)
    }
    assert len(found) == 1


def test_a_variable_pressed_hard_against_its_rows_keeps_its_digits() -> None:
    """Curvature of 1e-8 on the duration: without the proximal term the answer is off by 1e-8."""
    rng = np.random.default_rng(0)
    H = np.diag(np.append(np.full(30, 4e-5), 1e-8))
    C = np.hstack([rng.normal(size=(50, 30)), -np.ones((50, 1))])
    qp = QP(
        H,
        np.append(np.zeros(30), 1.0),
        np.zeros((0, 31)),
        np.zeros(0),
        C,
        np.full(50, -np.inf),
        -np.ones(50),
    )
    found = ActiveSetMethod(qp).solve(reference(qp), most_pivots=PIVOTS)
    assert found is not None
    assert max(found.residuals(qp)) <= 1e-9


def test_many_equalities_keep_their_multipliers() -> None:
    """DAQP eliminates many equalities and forgets their multipliers: that is switched off."""
    qp = random_qp(0, variables=8, equalities=8, rows=5)
    found = ActiveSetMethod(qp).solve(empty_guess(qp), most_pivots=PIVOTS)
    assert found is not None
    assert np.abs(qp.H @ found.x + qp.g + qp.A.T @ found.y + qp.C.T @ found.z).max() <= 1e-8


def test_what_it_cannot_solve_it_leaves() -> None:
    qp = random_qp(1)
    infeasible = infeasible_qp()
    assert ActiveSetMethod(infeasible).solve(empty_guess(infeasible), most_pivots=PIVOTS) is None
    assert ActiveSetMethod(qp).solve(empty_guess(qp), most_pivots=1) is None
    assert not ActiveSetMethod(replace(qp, H=np.zeros_like(qp.H))).is_ready
    assert not ActiveSetMethod(replace(qp, H=qp.H - 10.0 * np.eye(qp.size))).is_ready
    nothing = QPSolution.nothing(qp, "")
    assert ActiveSetMethod(qp).solve(nothing, most_pivots=PIVOTS) is None


def test_without_rows_it_is_a_linear_system() -> None:
    qp = random_qp(2, equalities=0, rows=0)
    found = ActiveSetMethod(qp).solve(empty_guess(qp), most_pivots=PIVOTS)
    assert found is not None
    np.testing.assert_allclose(qp.H @ found.x, -qp.g, atol=1e-9)


def test_no_random_program_gets_a_wrong_answer() -> None:
    """Duplicate, opposite, empty and dependent rows, no Hessian, no feasible point."""
    rng, solved = np.random.default_rng(3), 0
    backend = make_backend("proxqp")
    for _ in range(400):
        n, m, p = (int(rng.integers(low, high)) for low, high in ((1, 12), (3, 30), (0, 6)))
        A, C, inside = rng.normal(size=(p, n)), rng.normal(size=(m, n)), rng.normal(size=n)
        C[1], C[2] = C[0], -C[0]
        C[-1] *= rng.integers(0, 2)
        upper = C @ inside + rng.uniform(-0.2, 1.0, m)
        lower = np.where(rng.random(m) < 0.3, upper - rng.uniform(0.0, 2.0, m), -np.inf)
        H = np.diag(10.0 ** rng.uniform(-8.0, 2.0, n)) * rng.choice([0.0, 1.0], p=[0.1, 0.9])
        qp = QP(
            H, rng.normal(size=n) * 10.0 ** rng.uniform(-3.0, 4.0), A, A @ inside, C, lower, upper
        )
        found = backend.solve(qp)
        again = backend.solve(qp, warm=found) if np.isfinite(found.x).all() else found
        for solution in (found, again):
            primal, dual = solution.residuals(qp)
            solved += solution.solved
            assert not solution.solved or (
                primal <= 1e-6 and dual <= 1e-5 * max(1.0, np.abs(qp.g).max())
            )
    assert solved > 200
