"""Every backend solves the same QPs, admits it when it does not, and ends."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import qpsolvers
import scipy.sparse as sp

import zmp_sqp.sqp.backends.proxqp as proxqp_module
from zmp_sqp.errors import ProblemError
from zmp_sqp.sqp.backends import QPBackend, make_backend
from zmp_sqp.sqp.backends.auto import CROSSOVER
from zmp_sqp.sqp.backends.deadline import Punctual, TimeLimited
from zmp_sqp.sqp.qp import QP, QPSolution

# of minimisers whose Hessians have eigenvalues of at least 0.1: residuals of 1e-8, ten times over
AGREEMENT = 1e-6
RESIDUAL = 1e-6  # primal; default tolerances of daqp are the widest
# dual, per unit gradient: of a row that is all but active an interior point knows only the product
# of slack and multiplier, 1e-9, to whose square root both may be off
DUAL_RESIDUAL = 4e-5
PATIENCE = 10.0  # [s] for a QP with 30 variables; all need milliseconds
TOLERANCE, ITERATIONS = 1e-9, 100

BACKENDS = (
    "auto",
    "proxqp",
    "piqp",
    *(f"qpsolvers:{name}" for name in qpsolvers.available_solvers),
)
# Through qpsolvers ProxQP's infeasibility test cannot be turned down: it gives up on feasible QPs,
# and says so.
RELIABLE = tuple(name for name in BACKENDS if name != "qpsolvers:proxqp")


def random_qp(seed: int, *, variables: int = 30, equalities: int = 4, rows: int = 60) -> QP:
    """Feasible by construction; a third of the rows are upper bounds of twice as many rows."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((variables, variables)) / np.sqrt(variables)
    A, C = rng.standard_normal((equalities, variables)), rng.standard_normal((rows, variables))
    inside = rng.standard_normal(variables)
    C[1::3] = -C[0::3][: len(C[1::3])]  # pairs of rows that bound a value from both sides
    H = root @ root.T + 0.1 * np.eye(variables)
    return QP(
        sp.csc_matrix(np.triu(H)),
        3.0 * rng.standard_normal(variables),
        sp.csc_matrix(A) if equalities else None,
        A @ inside,
        sp.csc_matrix(C),
        C @ inside + rng.uniform(0.0, 1.0, rows),
    )


def infeasible_qp() -> QP:
    """x_0 >= 1 and x_0 <= -1."""
    C = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    sides = np.array([-1.0, -1.0, 9.0, 9.0])
    return QP(sp.csc_matrix(np.eye(3)), np.ones(3), None, np.zeros(0), sp.csc_matrix(C), sides)


def solve(backend: str | QPBackend, qp: QP, warm: QPSolution | None = None) -> QPSolution:
    solver = make_backend(backend) if isinstance(backend, str) else backend
    return solver.solve(qp, tolerance=TOLERANCE, iterations=ITERATIONS, warm=warm)


def is_answer(solution: QPSolution, qp: QP) -> bool:
    primal, dual = solution.residuals(qp)
    return primal <= RESIDUAL and dual <= DUAL_RESIDUAL * max(1.0, float(np.abs(qp.g).max()))


@pytest.mark.parametrize("seed", range(8))
def test_all_backends_agree_and_their_multipliers_satisfy_the_optimality_conditions(
    seed: int,
) -> None:
    qp = random_qp(seed)
    found = []
    for name in RELIABLE:
        solution = solve(name, qp)
        assert solution.solved, name
        assert is_answer(solution, qp), name
        assert solution.backend == ("piqp" if name == "auto" else name)
        found.append(solution.x)
    assert np.ptp(found, axis=0).max() <= AGREEMENT
    assert (solution.z > 1e-3).any(), "no row is active"


@pytest.mark.parametrize("name", BACKENDS)
def test_what_is_called_solved_is_solved(name: str) -> None:
    solved = 0
    for seed in range(20):
        qp = random_qp(seed)
        solution = solve(name, qp)
        solved += solution.solved
        assert not solution.solved or is_answer(solution, qp)
    assert solved >= 10


@pytest.mark.parametrize("name", BACKENDS)
def test_rows_without_equalities_and_equalities_without_rows_are_solved(name: str) -> None:
    qp = random_qp(4)
    no_equalities = replace(qp, A=None, b=np.zeros(0))
    no_rows = replace(qp, C=sp.csc_matrix((0, qp.size)), u=np.zeros(0))
    for program in (no_equalities, no_rows):
        assert is_answer(solve(name, program), program)


@pytest.mark.parametrize("name", RELIABLE)
def test_a_program_is_solved_again_with_other_right_hand_sides(name: str) -> None:
    qp, backend = random_qp(5), make_backend(name)
    solve(backend, qp)
    rng = np.random.default_rng(0)
    for _ in range(3):
        step = 0.1 * rng.standard_normal(qp.size)
        u = qp.u + qp.C @ step + 0.05 * rng.random(len(qp.u))
        b = qp.b + qp.A @ step
        again, fresh = backend.solve_again(u, b), solve(name, replace(qp, u=u, b=b))
        assert again.solved
        assert is_answer(again, replace(qp, u=u, b=b))
        assert np.abs(again.x - fresh.x).max() <= AGREEMENT


@pytest.mark.parametrize("name", BACKENDS)
def test_right_hand_sides_that_are_not_finite_are_not_solved_again(name: str) -> None:
    qp, backend = random_qp(5), make_backend(name)
    solve(backend, qp)
    assert not backend.solve_again(qp.u * np.nan, qp.b).solved


@pytest.mark.parametrize("name", BACKENDS)
def test_the_answer_to_an_infeasible_qp_is_never_believed(name: str) -> None:
    qp = infeasible_qp()
    started = time.perf_counter()
    solution = solve(name, qp)
    assert not solution.solved or solution.residuals(qp)[0] > 0.5
    assert time.perf_counter() - started < PATIENCE


@pytest.mark.parametrize("name", BACKENDS)
def test_the_answer_to_an_unbounded_qp_is_never_believed(name: str) -> None:
    qp = random_qp(5, rows=0, equalities=0)
    flat = replace(qp, H=0.0 * qp.H)
    started = time.perf_counter()
    assert max(solve(name, flat).residuals(flat)) > RESIDUAL
    assert time.perf_counter() - started < PATIENCE


@pytest.mark.parametrize("part", ["H", "g", "A", "b", "C", "u"])
@pytest.mark.parametrize("name", BACKENDS)
def test_nan_in_the_data_is_neither_an_exception_nor_a_hang_nor_a_solution(
    name: str, part: str
) -> None:
    qp = random_qp(6)
    entries = getattr(qp, part).copy()
    (entries.data if sp.issparse(entries) else entries)[1] = np.nan
    solution = solve(name, replace(qp, **{part: entries}))
    assert not solution.solved
    assert not solution.is_finite()
    assert solution.x.shape == (qp.size,)
    assert solution.z.shape == qp.u.shape


def test_piqp_keeps_to_its_iterations() -> None:
    qp = random_qp(7)
    few = make_backend("piqp").solve(qp, tolerance=TOLERANCE, iterations=2)
    assert not few.solved
    assert few.iterations <= 2
    assert solve("piqp", qp).solved


def test_proxqp_keeps_to_its_caps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(proxqp_module, "MAX_ITER", 2)
    monkeypatch.setattr(proxqp_module, "MAX_ITER_IN", 3)
    monkeypatch.setattr(proxqp_module, "PIVOTS", 1)
    monkeypatch.setattr(proxqp_module, "PIVOTS_WARM", 1)
    qp = random_qp(7)
    solution = solve("proxqp", qp)
    assert not solution.solved
    assert solution.iterations <= 2 * (3 + 1) + 1
    assert max(solution.residuals(qp)) > RESIDUAL


@pytest.mark.parametrize("size", [proxqp_module.SMALL, proxqp_module.SMALL + 1])
def test_proxqp_solves_small_programs_dense_and_others_sparse_without_help(
    size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    qp = random_qp(1, variables=size)
    exact = solve("piqp", qp)
    rough = proxqp_module._proxqp(qp, None, 1e-8, np.arange(len(qp.u)))
    assert rough.solved
    assert np.abs(rough.x - exact.x).max() <= AGREEMENT
    again = proxqp_module._proxqp(qp, rough, 1e-8, np.arange(len(qp.u)))
    assert again.iterations < rough.iterations


def test_many_rows_reach_proxqp_only_in_part_and_the_answer_is_that_of_all() -> None:
    qp = random_qp(2, variables=10, rows=3000, equalities=0)
    assert len(proxqp_module._nearest(qp)) < 1000
    solution = solve("proxqp", qp)
    assert is_answer(solution, qp)
    assert np.abs(solution.x - solve("piqp", qp).x).max() <= AGREEMENT


def test_known_active_rows_save_iterations() -> None:
    qp = random_qp(8)
    cold = solve("proxqp", qp)
    warm = solve("proxqp", qp, cold)
    assert warm.iterations < cold.iterations
    assert np.abs(warm.x - cold.x).max() <= AGREEMENT


@pytest.mark.parametrize("name", RELIABLE)
def test_a_warm_start_that_is_far_off_does_no_harm(name: str) -> None:
    qp, rng = random_qp(9), np.random.default_rng(0)
    x, y, z = (100.0 * rng.standard_normal(len(part)) for part in (qp.g, qp.b, qp.u))
    off = QPSolution(x, y, np.maximum(z, 0.0), True, 0, "guess")
    assert is_answer(solve(name, qp, off), qp)


def test_auto_asks_proxsuite_where_a_small_program_has_known_rows_and_piqp_elsewhere() -> None:
    small, large = random_qp(3), random_qp(3, variables=CROSSOVER + 1)
    for qp, expected in ((small, "daqp"), (large, "piqp")):
        cold = solve("auto", qp)
        warm = solve("auto", qp, cold)
        assert cold.backend == "piqp"
        assert warm.backend == expected
        assert np.abs(warm.x - cold.x).max() <= AGREEMENT


def test_auto_leaves_what_is_not_convex_to_piqp() -> None:
    qp = random_qp(3)
    convex = solve("piqp", qp)
    bent = replace(qp, H=(qp.H - 0.11 * sp.eye(qp.size)).tocsc())  # one eigenvalue below zero
    assert np.linalg.eigvalsh(bent.dense()[0]).min() < 0.0
    assert not solve("proxqp", bent, convex).solved
    assert solve("auto", bent, convex).backend == "piqp"


@pytest.mark.parametrize("name", BACKENDS)
def test_backends_say_whether_they_need_convex_programs(name: str) -> None:
    assert make_backend(name).needs_convex == (name not in ("auto", "piqp"))


def test_a_multiplier_far_from_its_bound_is_not_called_solved() -> None:
    """Without its duality-gap check ProxQP once stopped 4e-5 before a bound that is active."""
    C = np.array([[-10.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    sides = np.array([-19.0, -3.0, 49.0, 51.0, 51.0])
    g = np.array([-0.02, -2.0])
    qp = QP(sp.csc_matrix(np.eye(2)), g, None, np.zeros(0), sp.csc_matrix(C), sides)
    for name in BACKENDS:
        assert max(solve(name, qp).residuals(qp)) <= RESIDUAL, name


@pytest.mark.parametrize("name", ["", "PROXQP", "osqp", "qpsolvers:", "qpsolvers:none", None, 3])
def test_unknown_names_are_refused_with_a_list_of_what_there_is(name: Any) -> None:
    with pytest.raises(ProblemError, match="proxqp"):
        make_backend(name)


def test_no_qp_starts_after_the_deadline_and_solvers_that_can_stop_know_what_remains() -> None:
    qp = random_qp(2)
    inner = make_backend("qpsolvers:clarabel")
    early, late = Punctual(inner, time.perf_counter() + 60.0), Punctual(inner, time.perf_counter())
    assert (early.name, early.needs_convex) == (inner.name, inner.needs_convex)
    assert solve(early, qp).solved
    assert early.solve_again(qp.u, qp.b).solved
    assert isinstance(inner, TimeLimited)
    assert 50.0 < inner.time_limit <= 60.0
    for nothing in (solve(late, qp), late.solve_again(qp.u, qp.b)):
        assert not nothing.solved
        assert nothing.residuals(qp) == (np.inf, np.inf)


@pytest.mark.parametrize("name", ["auto", "piqp", "proxqp", "qpsolvers:clarabel"])
def test_solving_again_before_anything_was_solved_is_an_error_that_names_the_solver(
    name: str,
) -> None:
    with pytest.raises(RuntimeError, match=r"solve_again\(\) before any solve\(\)"):
        make_backend(name).solve_again(np.zeros(0), np.zeros(0))
