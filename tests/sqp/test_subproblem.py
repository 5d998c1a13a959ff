"""Condensed or whole, screened or not: the same step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import zmp_sqp.sqp.subproblem
from tests.sqp.chain import Chain
from zmp_sqp.sqp.backends import QPBackend, make_backend
from zmp_sqp.sqp.qp import QP, QPSolution
from zmp_sqp.sqp.result import SQPResult
from zmp_sqp.sqp.solver import SQP
from zmp_sqp.sqp.subproblem import Model, Step, Subproblem

STEP_TOLERANCE = 1e-6  # QPs are solved to 1e-9, and the chain's least curvature is 1/N
OBJECTIVE_TOLERANCE = 1e-7  # relative; the SQP stops at a predicted decrease of 2e-7

BACKENDS = ("proxqp", "piqp", "qpsolvers:clarabel")


@pytest.fixture
def exact(monkeypatch: pytest.MonkeyPatch) -> None:
    """No violated row waits for the next linearisation."""
    monkeypatch.setattr(zmp_sqp.sqp.subproblem, "MISSED", 0.0)


def solve(chain: Chain, seed: int, backend: str, *, bend: bool = True) -> tuple[Step, Chain]:
    """One QP about a random point with open gaps, with multipliers as if some rows were active."""
    x = chain.start(seed)
    lin = chain.linearize(x)
    rng = np.random.default_rng(seed)
    z = np.where(
        rng.random(len(lin.at.inequalities)) < 0.2, rng.random(len(lin.at.inequalities)), 0.0
    )
    H = chain.hessian(x, np.zeros(2), z if bend else 0.0 * z, convex=True)
    subproblem = Subproblem(lin, chain.nonlinear_rows, make_backend(backend), None)
    condensed, g = subproblem.condensed_model(H, lin.gradient)
    model = Model(lin.gradient, g, None if subproblem.prefers_whole else condensed, H)
    y = np.zeros(2 if chain.condenses else len(lin.at.equalities))
    return subproblem.solve(model, previous=(y, 0.0 * z)), chain


def run(chain: Chain, backend: str, seed: int = 0) -> SQPResult:
    return SQP(make_backend(backend), make_backend("piqp")).minimize(chain, chain.start(seed))


@pytest.mark.usefixtures("exact")
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("seed", range(4))
def test_condensed_and_uncondensed_steps_are_the_same_with_open_gaps(
    seed: int, backend: str
) -> None:
    """The gaps' particular solution d belongs into the gradient, too: Z'(g + H d)."""
    steps = [solve(Chain(condenses=condenses), seed, backend)[0] for condenses in (True, False)]
    assert all(step.solved for step in steps)
    assert np.abs(steps[0].dx - steps[1].dx).max() <= STEP_TOLERANCE
    assert np.abs(steps[0].z - steps[1].z).max() <= STEP_TOLERANCE
    assert np.abs(steps[0].y - steps[1].y[-2:]).max() <= STEP_TOLERANCE


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_condensed_step_closes_the_gaps(backend: str) -> None:
    chain = Chain()
    step, _ = solve(chain, 1, backend)
    x = chain.start(1)
    assert np.abs(chain.evaluate(x + step.dx).equalities).max() <= 1e-9  # they are linear


@pytest.mark.usefixtures("exact")
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("seed", range(4))
def test_screened_and_unscreened_qps_have_the_same_solution(
    seed: int, backend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zmp_sqp.sqp.subproblem, "SCREEN", -0.5)
    screened, chain = solve(Chain(), seed, backend)
    monkeypatch.setattr(zmp_sqp.sqp.subproblem, "SCREEN", np.inf)
    full, _ = solve(Chain(), seed, backend)
    assert full.rows == len(chain.nonlinear_rows)
    if backend != "piqp":  # which solves the whole QP in any case
        assert screened.rows < full.rows
    assert np.abs(screened.dx - full.dx).max() <= STEP_TOLERANCE
    assert np.abs(screened.z - full.z).max() <= STEP_TOLERANCE


@pytest.mark.parametrize("seed", range(8))
def test_rows_that_wait_are_nonlinear_and_missed_by_little(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zmp_sqp.sqp.subproblem, "SCREEN", -np.inf)
    step, chain = solve(Chain(), seed, "proxqp")
    lin = chain.linearize(chain.start(seed))
    missed = lin.at.inequalities + lin.C @ step.dx
    assert step.solved
    assert missed[~chain.nonlinear_rows].max() <= STEP_TOLERANCE
    assert missed.max() <= zmp_sqp.sqp.subproblem.MISSED * lin.at.violation + STEP_TOLERANCE


@pytest.mark.parametrize("condenses", [True, False])
@pytest.mark.parametrize("backend", BACKENDS)
def test_the_chain_has_one_optimum_however_it_is_found(backend: str, condenses: bool) -> None:
    reference = run(Chain(), "proxqp")
    result = run(Chain(condenses=condenses), backend, seed=3)
    assert reference.status.name == result.status.name == "OPTIMAL"
    assert result.at.objective == pytest.approx(reference.at.objective, rel=OBJECTIVE_TOLERANCE)
    assert reference.at.inequalities.max() > -1e-6, "no row is active"
    assert any(record.curvature for record in result.history)


def test_multipliers_belong_to_the_equalities_that_no_basis_eliminates() -> None:
    condensed, plain = run(Chain(), "proxqp"), run(Chain(condenses=False), "proxqp")
    assert condensed.y.shape == (2,)
    assert plain.y.shape == plain.at.equalities.shape
    # as exact as the square root of the decrease allows
    assert np.abs(condensed.y - plain.y[-2:]).max() <= 1e-3


def test_a_goal_that_cannot_be_met_is_reported_infeasible_by_relaxation() -> None:
    """The goal lies above the ceiling: only the ceiling, a nonlinear row, may give."""
    result = run(Chain(goal=0.8), "proxqp")
    assert result.status.name == "INFEASIBLE"
    assert any(record.relaxed for record in result.history)
    assert np.abs(result.at.equalities).max() <= 1e-6
    assert result.at.violation == pytest.approx(0.8 + 0.3 * 0.8**2 - 0.6, abs=1e-4)


@dataclass(frozen=True)
class Stubborn:
    """Never solves anything."""

    name: str = "stubborn"
    wants_sparse: bool = False

    def solve(self, qp: QP, *, warm: QPSolution | None = None) -> QPSolution:
        return QPSolution.nothing(qp, self.name)


@dataclass(frozen=True)
class Liar:
    """Claims to have solved what it has not."""

    name: str = "liar"
    wants_sparse: bool = False

    def solve(self, qp: QP, *, warm: QPSolution | None = None) -> QPSolution:
        return QPSolution(
            np.zeros(qp.size), np.zeros(len(qp.b)), np.zeros(len(qp.u)), True, 1, self.name
        )


@pytest.mark.parametrize("first", [Stubborn(), Liar()])
def test_the_fallback_solves_what_the_first_backend_does_not_and_the_history_says_so(
    first: QPBackend,
) -> None:
    reference = run(Chain(), "proxqp")
    for fallback in ("piqp", "qpsolvers:clarabel"):  # whole and sparse; condensed
        result = SQP(first, make_backend(fallback)).minimize(Chain(), Chain().start(0))
        assert result.status.name == "OPTIMAL"
        assert {record.backend for record in result.history} == {fallback}
        assert result.at.objective == pytest.approx(reference.at.objective, rel=OBJECTIVE_TOLERANCE)


def test_without_a_backend_that_solves_anything_the_run_ends() -> None:
    result = SQP(Stubborn(), Liar()).minimize(Chain(), Chain().start(0))
    assert result.status.name == "QP_FAILED"
    assert result.history == ()


def test_a_large_working_set_goes_to_the_fallback(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zmp_sqp.sqp.subproblem, "LARGE", 0)
    monkeypatch.setattr(zmp_sqp.sqp.subproblem, "LARGE_SHARE", 0.0)
    monkeypatch.setattr(zmp_sqp.sqp.subproblem, "SCREEN", np.inf)
    result = run(Chain(), "proxqp")
    assert result.status.name == "OPTIMAL"
    assert {record.backend for record in result.history} == {"piqp"}


@pytest.mark.usefixtures("exact")
def test_rounds_that_end_before_all_rows_are_met_are_not_a_solution(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(zmp_sqp.sqp.subproblem, "SCREEN", -np.inf)
    assert solve(Chain(), 0, "proxqp")[0].solved
    monkeypatch.setattr(zmp_sqp.sqp.subproblem, "MAX_ROUNDS", 1)
    assert not solve(Chain(), 0, "proxqp")[0].solved


def test_a_basis_with_fewer_directions_than_the_gaps_leave_is_never_solved_whole() -> None:
    """Ties between controls are in the basis alone: the sparse QP would be another one."""
    from dataclasses import replace

    chain = Chain()
    lin = chain.linearize(chain.start(0))
    assert lin.basis is not None
    tied = replace(
        lin,
        basis=replace(
            lin.basis, Z=lin.basis.Z[:, ::2] + lin.basis.Z[:, 1::2], free=lin.basis.free[:0]
        ),
    )
    assert Subproblem(lin, chain.nonlinear_rows, make_backend("piqp"), None).prefers_whole
    assert not Subproblem(tied, chain.nonlinear_rows, make_backend("piqp"), None).prefers_whole
