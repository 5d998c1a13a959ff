"""What the SQP does where Newton's method would fail."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from tests.sqp.problems import MARATOS, TOLERANCE, Textbook, named
from zmp_sqp.arrays import Array
from zmp_sqp.sqp.backends import make_backend
from zmp_sqp.sqp.nlp import Evaluation, Linearization
from zmp_sqp.sqp.result import SQPResult
from zmp_sqp.sqp.rows import Rows
from zmp_sqp.sqp.solver import SQP, SQPSettings

OBJECTIVE_TOLERANCE = 1e-6
FEW = 25  # iterations within which an infeasible program is given up
BACKENDS = ("auto", "proxqp", "piqp", "qpsolvers:clarabel")

# x^2 >= 4 from x = 0.1 with x <= 3: the linearised row asks for x >= 20.
INCONSISTENT = Textbook(
    "inconsistent", (0.1,), 2.0, lambda x: x[0], curved=lambda x: [4.0 - x[0] ** 2], upper=3.0
)
# Two discs four apart with radius one: the violation is least between them.
DISCS = Textbook(
    "discs",
    (1.5, 2.0),
    np.inf,
    lambda x: 1.0 + x[1] ** 2,
    curved=lambda x: [
        (x[0] + 2.0) ** 2 + x[1] ** 2 - 1.0,
        (x[0] - 2.0) ** 2 + x[1] ** 2 - 1.0,
    ],
)
NO_ROOT = Textbook(
    "no root", (2.0,), np.inf, lambda x: 1.0 + x[0] ** 2, curved=lambda x: [x[0] ** 2 + 1.0]
)


def solve(problem: Textbook, backend: str = "piqp", **settings: Any) -> SQPResult:
    settings = {"converged": 1e-9, **settings}
    return SQP(make_backend(backend), settings=SQPSettings(**settings)).minimize(
        problem, problem.x0
    )


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_maratos_effect_is_undone_by_a_second_order_correction(backend: str) -> None:
    """The full step near the minimum raises objective and violation: only corrected it passes."""
    theta = 0.1
    start = replace(MARATOS, start=(np.cos(theta), np.sin(theta)))
    result = solve(start, backend)
    assert result.status.name == "OPTIMAL"
    assert result.at.objective == pytest.approx(MARATOS.optimum, abs=OBJECTIVE_TOLERANCE)
    corrected = [record for record in result.history if record.corrected]
    assert corrected, "no correction was needed"
    assert all(record.step == 1.0 for record in corrected)
    assert len(result.history) <= 8


@pytest.mark.parametrize("theta", [0.1, 0.5, 1.0, 1.5, 2.5])
def test_the_maratos_example_is_solved_from_anywhere_on_the_circle(theta: float) -> None:
    result = solve(replace(MARATOS, start=(np.cos(theta), np.sin(theta))))
    assert result.at.objective == pytest.approx(MARATOS.optimum, abs=OBJECTIVE_TOLERANCE)
    assert len(result.history) <= 15


@pytest.mark.parametrize("backend", BACKENDS)
def test_inconsistent_linearised_constraints_are_relaxed_and_then_met(backend: str) -> None:
    result = solve(INCONSISTENT, backend)
    assert result.history[0].relaxed
    assert not result.history[-1].relaxed
    assert result.status.name == "OPTIMAL"
    assert result.at.objective == pytest.approx(INCONSISTENT.optimum, abs=OBJECTIVE_TOLERANCE)


@pytest.mark.parametrize("problem", [DISCS, NO_ROOT], ids=lambda problem: problem.name)
@pytest.mark.parametrize("backend", BACKENDS)
def test_an_infeasible_program_is_called_infeasible_at_the_least_violation(
    problem: Textbook, backend: str
) -> None:
    result = solve(problem, backend)
    assert result.status.name == "INFEASIBLE"
    assert not result.status.is_feasible
    assert len(result.history) <= FEW
    least = {"discs": 3.0, "no root": 1.0}[problem.name]
    assert result.at.violation == pytest.approx(least, rel=1e-2)  # the violation is flat there


@dataclass(frozen=True, eq=False)
class Broken:
    """Another program that cannot be evaluated beyond a wall."""

    inner: Textbook
    wall: float

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def evaluate(self, x: Array) -> Evaluation:
        return self._spoiled(self.inner.evaluate(x), x)

    def linearize(self, x: Array) -> Linearization:
        lin = self.inner.linearize(x)
        return replace(lin, at=self._spoiled(lin.at, x))

    def _spoiled(self, at: Evaluation, x: Array) -> Evaluation:
        return replace(at, objective=np.nan) if x[0] > self.wall else at


def test_a_trial_point_that_cannot_be_evaluated_only_shortens_the_step() -> None:
    problem = replace(named("HS35"), start=(0.0, 0.0, 2.0))
    wall = 1.34  # the minimiser is (4/3, 7/9, 4/9)
    bowl = replace(
        problem,
        objective=lambda x: (x[0] - 1.3) ** 4 + (x[1] - 0.5) ** 2 + (x[2] - 0.1) ** 2 - 3.0 * x[0],
        evaluations=[],
    )
    unspoiled = solve(bowl)
    assert unspoiled.status.name == "OPTIMAL"
    assert max(x[0] for x in bowl.evaluations) > wall
    result = SQP(make_backend("piqp"), settings=SQPSettings(max_iterations=30)).minimize(
        Broken(bowl, wall), bowl.x0
    )
    assert np.isfinite(result.at.objective)
    assert result.point[0] <= wall
    assert min(record.step for record in result.history) < 1.0
    assert result.status.is_feasible


def test_a_start_that_cannot_be_evaluated_is_refused_at_once() -> None:
    problem = named("HS35")
    result = SQP(make_backend("piqp")).minimize(Broken(problem, -1.0), problem.x0)
    assert result.status.name == "NOT_FINITE"
    assert not result.status.is_feasible
    assert result.history == ()
    assert np.array_equal(result.point, problem.x0)


@pytest.mark.parametrize("backend", ["proxqp", "piqp"])
@pytest.mark.parametrize("part", ["gradient", "A", "C", "hessian"])
def test_derivatives_that_are_not_finite_end_the_run_without_an_exception(
    part: str, backend: str
) -> None:
    problem = named("HS71")

    class Spoiled(Broken):
        def linearize(self, x: Array) -> Linearization:
            lin = self.inner.linearize(x)
            spoiled = {
                "gradient": lin.gradient * np.nan,
                "A": lin.A * np.nan,
                "C": Rows(lin.C.matrix * np.nan),
            }
            return lin if part == "hessian" else replace(lin, **{part: spoiled[part]})

        def hessian(self, lin: Linearization, y: Array, z: Array, **options: float) -> Any:
            H = self.inner.hessian(lin, y, z, **options)
            return H * np.nan if part == "hessian" else H

    result = SQP(make_backend(backend)).minimize(Spoiled(problem, np.inf), problem.x0)
    assert result.status.name == "QP_FAILED"
    assert np.array_equal(result.point, problem.x0)


@pytest.mark.parametrize("backend", ["proxqp", "piqp", "qpsolvers:daqp"])
def test_a_linear_objective_without_curvature_is_no_obstacle(backend: str) -> None:
    """HS39's first QP is unbounded but for damping."""
    result = solve(named("HS39"), backend)
    assert result.status.name == "OPTIMAL"
    assert result.at.violation <= TOLERANCE


def test_a_backend_that_needs_convexity_never_sees_negative_curvature() -> None:
    """HS71's Lagrangian is curved the wrong way; PIQP is given some of that, ProxQP none."""
    problem, seen = named("HS71"), []

    class Watched(Broken):
        def hessian(self, lin: Linearization, y: Array, z: Array, **options: float) -> Any:
            seen.append(options["clipped"])
            return self.inner.hessian(lin, y, z, **options)

    watched = Watched(problem, np.inf)
    SQP(make_backend("piqp"), settings=SQPSettings(resumed=True)).minimize(watched, problem.x0)
    assert min(seen) < 1.0
    seen.clear()
    SQP(make_backend("proxqp"), settings=SQPSettings(resumed=True)).minimize(watched, problem.x0)
    assert set(seen) == {1.0}
