"""Every backend solves the same QPs, admits it when it does not, and ends."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
import qpsolvers
import scipy.sparse as sp

from zmp_sqp.errors import ProblemError
from zmp_sqp.sqp.backends import make_backend
from zmp_sqp.sqp.backends.deadline import Punctual, TimeLimited
from zmp_sqp.sqp.qp import QP, QPSolution

# of minimisers whose Hessians have eigenvalues of at least 0.1: residuals of 1e-8, ten times over
AGREEMENT = 1e-6
RESIDUAL = 1e-6  # primal, and dual per unit gradient; default tolerances of daqp are the widest
PATIENCE = 10.0  # [s] for a QP with 30 variables; all need milliseconds

BACKENDS = ("proxqp", "piqp", *(f"qpsolvers:{name}" for name in qpsolvers.available_solvers))
# Through qpsolvers ProxQP's infeasibility test cannot be turned down: it gives up on feasible QPs,
# and says so.
RELIABLE = tuple(name for name in BACKENDS if name != "qpsolvers:proxqp")


def random_qp(seed: int, *, variables: int = 30, equalities: int = 4, rows: int = 60) -> QP:
    """Feasible by construction; rows are one-sided, two-sided, sideless, some active."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((variables, variables)) / np.sqrt(variables)
    A, C = rng.standard_normal((equalities, variables)), rng.standard_normal((rows, variables))
    inside = rng.standard_normal(variables)
    lower, upper = (
        C @ inside - rng.uniform(0.0, 1.0, rows),
        C @ inside + rng.uniform(0.0, 1.0, rows),
    )
    kind = rng.integers(0, 3, rows)
    lower[kind == 0], upper[kind == 1] = -np.inf, np.inf
    H = root @ root.T + 0.1 * np.eye(variables)
    return QP(H, 3.0 * rng.standard_normal(variables), A, A @ inside, C, lower, upper)


def infeasible_qp() -> QP:
    """x_0 >= 1 and x_0 <= -1."""
    C = np.vstack([np.eye(3), np.eye(1, 3)])
    return QP(
        np.eye(3),
        np.ones(3),
        np.zeros((0, 3)),
        np.zeros(0),
        C,
        np.array([1.0, -9.0, -9.0, -9.0]),
        np.array([9.0, 9.0, 9.0, -1.0]),
    )


@pytest.mark.parametrize("seed", range(8))
def test_all_backends_agree_and_their_multipliers_satisfy_the_optimality_conditions(
    seed: int,
) -> None:
    qp = random_qp(seed)
    found = []
    for name in RELIABLE:
        solution = make_backend(name).solve(qp)
        primal, dual = solution.residuals(qp)
        assert solution.solved, name
        assert primal <= RESIDUAL, name
        assert dual <= RESIDUAL * np.abs(qp.g).max(), name
        assert solution.backend == name
        found.append(solution.x)
    assert np.ptp(found, axis=0).max() <= AGREEMENT


@pytest.mark.parametrize("name", BACKENDS)
def test_what_is_called_solved_is_solved(name: str) -> None:
    solved = 0
    for seed in range(20):
        qp = random_qp(seed)
        solution = make_backend(name).solve(qp)
        if solution.solved:
            solved += 1
            assert max(solution.residuals(qp)) <= RESIDUAL * np.abs(qp.g).max()
    assert solved >= 10


@pytest.mark.parametrize("name", BACKENDS)
def test_sparse_matrices_give_the_same_answer_as_dense_ones(name: str) -> None:
    qp = random_qp(3)
    sparse = replace(qp, H=sp.csc_matrix(qp.H), A=sp.csc_matrix(qp.A), C=sp.csc_matrix(qp.C))
    dense_x, sparse_x = (make_backend(name).solve(program).x for program in (qp, sparse))
    assert np.abs(dense_x - sparse_x).max() <= AGREEMENT


@pytest.mark.parametrize("name", BACKENDS)
def test_rows_without_equalities_and_equalities_without_rows_are_solved(name: str) -> None:
    qp = random_qp(4)
    no_equalities = replace(qp, A=qp.A[:0], b=qp.b[:0])
    no_rows = replace(qp, C=qp.C[:0], l=qp.l[:0], u=qp.u[:0])
    for program in (no_equalities, no_rows):
        solution = make_backend(name).solve(program)
        assert max(solution.residuals(program)) <= RESIDUAL * np.abs(qp.g).max()


@pytest.mark.parametrize("name", BACKENDS)
def test_the_answer_to_an_infeasible_qp_is_never_believed(name: str) -> None:
    qp = infeasible_qp()
    started = time.perf_counter()
    primal, _ = make_backend(name).solve(qp).residuals(qp)
    assert primal > 0.5
    assert time.perf_counter() - started < PATIENCE


@pytest.mark.parametrize("name", BACKENDS)
def test_the_answer_to_an_unbounded_qp_is_never_believed(name: str) -> None:
    qp = random_qp(5, rows=0, equalities=0)
    flat = replace(qp, H=np.zeros_like(qp.H))
    started = time.perf_counter()
    assert max(make_backend(name).solve(flat).residuals(flat)) > RESIDUAL
    assert time.perf_counter() - started < PATIENCE


@pytest.mark.parametrize("part", ["H", "g", "A", "b", "C", "l", "u"])
@pytest.mark.parametrize("name", BACKENDS)
def test_nan_in_the_data_is_neither_an_exception_nor_a_hang_nor_a_solution(
    name: str, part: str
) -> None:
    qp = random_qp(6)
    entries = getattr(qp, part).copy()
    entries.flat[1] = np.nan
    broken = replace(qp, **{part: entries})
    solution = make_backend(name).solve(broken)
    assert not solution.solved
    assert np.inf in solution.residuals(broken)
    assert solution.x.shape == (qp.size,)
    assert solution.z.shape == qp.u.shape


@pytest.mark.parametrize("name", ["proxqp", "piqp"])
def test_iteration_caps_are_respected(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    import zmp_sqp.sqp.backends.piqp
    import zmp_sqp.sqp.backends.proxqp

    module = getattr(zmp_sqp.sqp.backends, name)
    monkeypatch.setattr(module, "MAX_ITER", 2)
    if name == "proxqp":
        monkeypatch.setattr(module, "MAX_ITER_IN", 3)
        monkeypatch.setattr(module, "PIVOTS", 1)
    qp = random_qp(7)
    solution = make_backend(name).solve(qp)
    assert not solution.solved
    assert solution.iterations <= (2 * (3 + 1) + 1 if name == "proxqp" else 2)
    assert max(solution.residuals(qp)) > RESIDUAL


def test_a_warm_start_saves_iterations() -> None:
    qp = random_qp(8)
    cold = make_backend("proxqp").solve(qp)
    warm = make_backend("proxqp").solve(qp, warm=cold)
    assert warm.iterations < cold.iterations
    assert np.abs(warm.x - cold.x).max() <= AGREEMENT


def test_a_warm_start_that_is_far_off_does_no_harm() -> None:
    qp = random_qp(9)
    rng = np.random.default_rng(0)
    off = QPSolution(
        *(100.0 * rng.standard_normal(len(part)) for part in (qp.g, qp.b, qp.u)), True, 0, "guess"
    )
    for name in RELIABLE:
        solution = make_backend(name).solve(qp, warm=off)
        assert max(solution.residuals(qp)) <= RESIDUAL * np.abs(qp.g).max(), name


def test_a_multiplier_far_from_its_bound_is_not_called_solved() -> None:
    """Without its duality-gap check ProxQP once stopped 4e-5 before a bound that is active."""
    qp = QP(
        np.eye(2),
        np.array([-0.02, -2.0]),
        np.zeros((0, 2)),
        np.zeros(0),
        np.array([[-10.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0]]),
        np.full(5, -np.inf),
        np.array([-19.0, -3.0, 49.0, 51.0, 51.0]),
    )
    for name in BACKENDS:
        assert max(make_backend(name).solve(qp).residuals(qp)) <= RESIDUAL, name


@pytest.mark.parametrize("name", ["", "PROXQP", "osqp", "qpsolvers:", "qpsolvers:none", None, 3])
def test_unknown_names_are_refused_with_a_list_of_what_there_is(name: object) -> None:
    with pytest.raises(ProblemError, match="proxqp"):
        make_backend(name)  # type: ignore[arg-type]


def test_no_qp_starts_after_the_deadline_and_solvers_that_can_stop_know_what_remains() -> None:
    qp = random_qp(2)
    inner = make_backend("qpsolvers:clarabel")
    early, late = Punctual(inner, time.perf_counter() + 60.0), Punctual(inner, time.perf_counter())
    assert (early.name, early.wants_sparse) == (inner.name, inner.wants_sparse)
    assert early.solve(qp).solved
    assert isinstance(inner, TimeLimited)
    assert 50.0 < inner.time_limit <= 60.0
    nothing = late.solve(qp)
    assert not nothing.solved
    assert nothing.residuals(qp) == (np.inf, np.inf)
