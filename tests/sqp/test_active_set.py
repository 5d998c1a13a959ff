"""The active-set method: exact, insensitive to rounding of its guess, never a wrong answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from tests.sqp.test_backends import AGREEMENT, infeasible_qp, random_qp, solve
from zmp_sqp.sqp.backends import active_set, make_backend
from zmp_sqp.sqp.backends.active_set import ActiveSetMethod
from zmp_sqp.sqp.qp import QP, QPSolution

EXACT = 1e-9
PIVOTS = 500


def from_guess(qp: QP, guess: QPSolution) -> QPSolution | None:
    return ActiveSetMethod(qp).solve(guess.x, guess.z > 1e-6, most_pivots=PIVOTS)


def empty_guess(qp: QP) -> QPSolution:
    return QPSolution(np.zeros(qp.size), np.zeros(len(qp.b)), np.zeros(len(qp.u)), False, 0, "")


@pytest.mark.parametrize("seed", range(6))
def test_it_finds_the_solution_from_a_rough_guess_and_from_none(seed: int) -> None:
    qp = random_qp(seed)
    expected, rng = solve("piqp", qp), np.random.default_rng(seed)
    rough = replace(expected, x=expected.x + 1e-4 * rng.normal(size=qp.size))
    for guess in (expected, rough, empty_guess(qp)):
        found = from_guess(qp, guess)
        assert found is not None
        assert max(found.residuals(qp)) <= EXACT * np.abs(qp.g).max()
        assert np.abs(found.x - expected.x).max() <= AGREEMENT


@pytest.mark.parametrize("seed", range(6))
def test_its_bits_do_not_depend_on_the_last_digits_of_the_guess(seed: int) -> None:
    qp, rng = random_qp(seed), np.random.default_rng(seed)
    guess, found = solve("piqp", qp), set()
    for _ in range(10):
        noisy = replace(guess, x=guess.x + 1e-12 * rng.normal(size=qp.size))
        solution = from_guess(qp, noisy)
        assert solution is not None
        found.add(solution.x.tobytes())
    assert len(found) == 1


def pressed_qp() -> QP:
    """A duration without curvature to speak of is pressed against its rows."""
    rng = np.random.default_rng(0)
    H = sp.csc_matrix(np.diag(np.append(np.full(30, 4e-5), 1e-8)))
    C = sp.csc_matrix(np.hstack([rng.normal(size=(50, 30)), -np.ones((50, 1))]))
    return QP(H, np.append(np.zeros(30), 1.0), None, np.zeros(0), C, -np.ones(50))


def test_a_variable_pressed_hard_against_its_rows_keeps_its_digits() -> None:
    """Curvature of 1e-8 on the duration: without the proximal term the answer is off by 1e-8."""
    qp = pressed_qp()
    found = from_guess(qp, solve("piqp", qp))
    assert found is not None
    assert max(found.residuals(qp)) <= 1e-9


def test_a_guess_far_from_the_solution_is_replaced_by_the_solution_about_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The proximal term about a guess 100 away would alone leave a residual of 1e-2."""
    qp = pressed_qp()
    exact = from_guess(qp, solve("piqp", qp))
    far = replace(empty_guess(qp), x=np.full(qp.size, 100.0))
    found = from_guess(qp, far)
    assert exact is not None
    assert found is not None
    assert found.x[-1] == pytest.approx(exact.x[-1], rel=1e-5)
    assert max(found.residuals(qp)) <= 1e-5
    monkeypatch.setattr(active_set, "CENTRES", 1)
    assert from_guess(qp, far) is None


def test_many_equalities_keep_their_multipliers() -> None:
    """DAQP eliminates many equalities and forgets their multipliers: that is switched off."""
    qp = random_qp(0, variables=8, equalities=8, rows=5)
    found = from_guess(qp, empty_guess(qp))
    assert found is not None
    assert max(found.residuals(qp)) <= 1e-8
    assert np.abs(found.y).min() > 1e-3


def test_variables_without_curvature_that_equalities_determine_are_no_obstacle() -> None:
    """As positions of a driving base."""
    qp = random_qp(1, variables=6, equalities=0, rows=8)
    H = sp.block_diag([qp.H, sp.csc_matrix((3, 3))], format="csc")
    A = sp.csc_matrix(np.hstack([np.ones((3, 6)), np.eye(3) - 0.5 * np.eye(3, k=-1)]))
    C = sp.hstack([qp.C, 0.1 * np.ones((8, 3))], format="csc")
    extended = QP(H, np.append(qp.g, np.zeros(3)), A, np.ones(3), C, qp.u)
    found = from_guess(extended, empty_guess(extended))
    assert found is not None
    assert max(found.residuals(extended)) <= 1e-8


def test_what_it_cannot_solve_it_leaves() -> None:
    qp, infeasible = random_qp(1), infeasible_qp()
    method = ActiveSetMethod(infeasible)
    assert method.solve(np.zeros(3), np.zeros(4, dtype=bool), most_pivots=PIVOTS) is None
    assert method.is_infeasible
    assert ActiveSetMethod(qp).solve(np.zeros(30), np.zeros(60, dtype=bool), most_pivots=1) is None
    indefinite = replace(qp, A=None, b=np.zeros(0), H=(qp.H - 10.0 * sp.eye(30)).tocsc())
    assert not ActiveSetMethod(indefinite).is_ready
    assert from_guess(qp, QPSolution.nothing(qp, "")) is None


def test_without_rows_it_is_a_linear_system() -> None:
    qp = random_qp(2, equalities=0, rows=0)
    found = from_guess(qp, empty_guess(qp))
    assert found is not None
    np.testing.assert_allclose(qp.dense()[0] @ found.x, -qp.g, atol=1e-9)


def test_other_right_hand_sides_cost_no_new_factorisation_and_give_the_same_answer() -> None:
    qp = random_qp(3)
    method, u = ActiveSetMethod(qp), qp.u + 0.1
    none = np.zeros(len(u), dtype=bool)
    again = method.solve_with(u, qp.b, np.zeros(qp.size), none, most_pivots=PIVOTS)
    fresh = from_guess(replace(qp, u=u), empty_guess(qp))
    assert again is not None
    assert fresh is not None
    np.testing.assert_array_equal(again.x, fresh.x)


def test_no_random_program_gets_a_wrong_answer() -> None:
    """Duplicate, opposite, empty and dependent rows, no Hessian, no feasible point."""
    rng, solved = np.random.default_rng(3), 0
    backend = make_backend("proxqp")
    for _ in range(400):
        n, m, p = (int(rng.integers(low, high)) for low, high in ((1, 12), (3, 30), (0, 6)))
        A, C, inside = rng.normal(size=(p, n)), rng.normal(size=(m, n)), rng.normal(size=n)
        C[1], C[2] = C[0], -C[0]
        C[-1] *= rng.integers(0, 2)
        u = C @ inside + rng.uniform(-0.2, 1.0, m)
        H = np.diag(10.0 ** rng.uniform(-8.0, 2.0, n)) * rng.choice([0.0, 1.0], p=[0.1, 0.9])
        g = rng.normal(size=n) * 10.0 ** rng.uniform(-3.0, 4.0)
        qp = QP(
            sp.csc_matrix(H), g, sp.csc_matrix(A) if p else None, A @ inside, sp.csc_matrix(C), u
        )
        found = solve(backend, qp)
        again = solve(backend, qp, found) if found.is_finite() else found
        for solution in (found, again):
            primal, dual = solution.residuals(qp)
            solved += solution.solved
            assert not solution.solved or (
                primal <= 1e-6 and dual <= 1e-5 * max(1.0, np.abs(qp.g).max())
            )
    assert solved > 200
