"""Screened or not: the same step. Rows that a step violates join; who fails is replaced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import zmp_sqp.sqp.direction as direction_module
from tests.sqp.chain import Chain
from zmp_sqp.arrays import Array
from zmp_sqp.sqp.backends import QPBackend, make_backend
from zmp_sqp.sqp.direction import MISSED, Direction, Subproblem
from zmp_sqp.sqp.qp import QP, QPSolution
from zmp_sqp.sqp.solver import SQP, SQPSettings

STEP_TOLERANCE = 1e-5  # QPs are solved to 1e-9, and the chain's least curvature is 0.1/N
BACKENDS = ("auto", "proxqp", "piqp", "qpsolvers:clarabel")


def subproblem(chain: Chain, seed: int, keep: np.ndarray, backend: str = "piqp") -> Subproblem:
    lin = chain.linearize(chain.start(seed))
    z = np.zeros(chain.inequalities)
    H = chain.hessian(lin, np.zeros(chain.equalities), z, clipped=1.0, damping=1e-3)
    return Subproblem(lin, H, keep, make_backend(backend), 1e-9)


def step(chain: Chain, seed: int, keep: np.ndarray, backend: str = "piqp") -> Direction:
    y, z = np.zeros(chain.equalities), np.zeros(chain.inequalities)
    found = subproblem(chain, seed, keep, backend).solve(iterations=100, y=y, z=z)
    assert found is not None
    return found


EVERY, NONE = np.ones(Chain().inequalities, dtype=bool), np.zeros(Chain().inequalities, dtype=bool)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("seed", range(4))
def test_screened_and_unscreened_programs_have_the_same_solution(
    seed: int, backend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(direction_module, "MISSED", 0.0)
    screened, full = step(Chain(), seed, NONE, backend), step(Chain(), seed, EVERY, backend)
    assert full.rows == Chain().inequalities
    assert screened.rows < full.rows
    assert np.abs(screened.step - full.step).max() <= STEP_TOLERANCE
    assert np.abs(screened.z - full.z).max() <= STEP_TOLERANCE * max(1.0, full.z.max())
    assert (full.z > 1e-3).any(), "no row is active"


@pytest.mark.parametrize("seed", range(8))
def test_rows_that_wait_are_missed_by_little(seed: int) -> None:
    chain = Chain()
    found = step(chain, seed, NONE)
    lin = chain.linearize(chain.start(seed))
    np.testing.assert_allclose(found.predicted, lin.at.inequalities + lin.C @ found.step)
    assert found.predicted.max() <= MISSED * lin.at.violation + STEP_TOLERANCE


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_step_closes_linear_equalities(backend: str) -> None:
    chain = Chain()
    found = step(chain, 1, EVERY, backend)
    after = chain.evaluate(chain.start(1) + found.step)
    assert np.abs(after.equalities).max() <= 1e-7


@pytest.mark.parametrize("backend", BACKENDS)
def test_known_multipliers_lead_to_the_same_step(backend: str) -> None:
    chain = Chain()
    cold = step(chain, 2, EVERY, backend)
    warm = subproblem(chain, 2, EVERY, backend).solve(iterations=100, y=cold.y, z=cold.z)
    assert warm is not None
    assert np.abs(warm.step - cold.step).max() <= STEP_TOLERANCE


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_program_without_solution_is_relaxed_by_the_least_violation_at_a_high_price(
    backend: str,
) -> None:
    chain = Chain(goal=0.8)  # above the ceiling
    program = subproblem(chain, 0, EVERY, backend)
    zeros = np.zeros(chain.equalities), np.zeros(chain.inequalities)
    assert program.solve(iterations=60, y=zeros[0], z=zeros[1]) is None
    relaxed = program.solve_relaxed(chain.nonlinear, 1e3)
    assert relaxed is not None
    assert relaxed.slack > 0.1
    assert relaxed.predicted[: chain.nonlinear].max() == pytest.approx(relaxed.slack, abs=1e-5)
    assert relaxed.predicted[chain.nonlinear :].max() <= 1e-5
    assert relaxed.z[: chain.nonlinear].sum() == pytest.approx(1e3, rel=1e-3)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_corrected_step_meets_the_constraints_values_at_its_end(backend: str) -> None:
    chain = Chain()
    program = subproblem(chain, 3, EVERY, backend)
    zeros = np.zeros(chain.equalities), np.zeros(chain.inequalities)
    first = program.solve(iterations=100, y=zeros[0], z=zeros[1])
    assert first is not None
    end = chain.evaluate(chain.start(3) + first.step)
    corrected = program.corrected(first.step, end.inequalities, end.equalities)
    assert corrected is not None
    after = chain.evaluate(chain.start(3) + corrected)
    assert after.violation < max(1e-7, 0.5 * end.violation)


@dataclass
class Stubborn:
    """Never solves anything."""

    name: str = "stubborn"
    needs_convex: bool = False

    def solve(
        self, qp: QP, *, tolerance: float, iterations: int, warm: QPSolution | None = None
    ) -> QPSolution:
        return QPSolution.nothing(qp, self.name)

    def solve_again(self, u: Array, b: Array) -> QPSolution:
        raise AssertionError("there is nothing to solve again")


class Liar(Stubborn):
    """Claims to have solved what it has not."""

    def solve(
        self, qp: QP, *, tolerance: float, iterations: int, warm: QPSolution | None = None
    ) -> QPSolution:
        x, y, z = (np.zeros(count) for count in (qp.size, len(qp.b), len(qp.u)))
        return QPSolution(x + 10.0, y, z, True, 1, self.name)


@pytest.mark.parametrize("backend", [Stubborn(), Liar()])
def test_with_a_backend_that_solves_nothing_the_run_ends(backend: QPBackend) -> None:
    result = SQP(backend).minimize(Chain(), Chain().start(0))
    assert result.status.name == "QP_FAILED"
    assert len(result.history) <= SQPSettings().max_iterations
    np.testing.assert_array_equal(result.point, Chain().start(0))
