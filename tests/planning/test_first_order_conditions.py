"""An answer of the sparse road satisfies the first-order conditions of the dense program.

The dense program has the accelerations at both ends of the intervals and the squared duration as
variables, and the goal as its only equalities, which a basis of their null space eliminates. Its
derivatives are differences of values: no derivative, no Hessian and no QP of the road takes part.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.linalg as sla
from scipy.optimize import nnls

from benchmarks.problems.arm import HARD, random_problem
from tests.problems import slider
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.search.explore import explore
from zmp_sqp.planning.search.run import Candidate, Runs
from zmp_sqp.planning.search.task import task_of

INTERVALS = 24
STEP = 1e-5  # of variables of order one, for central differences
ACTIVE = 1e-4  # rows nearer to their bound than this may have multipliers
# What is left of the objective's gradient, whose norm is one: measured up to 4e-3, because the
# practical stop leaves 5e-5 of the duration. Without the rows of the zero moment point 0.02 to 1
# are left, of which 8 % at most remain with them (hard 0, which tip-over slows by 0.35 % only).
STATIONARY, SHARE = 5e-3, 0.1
FEASIBLE = 1e-6


@cache
def answer(name: str, qp_solver: str) -> Candidate:
    problem = problem_of(name)
    found = explore(task_of(problem), Runs.start(qp_solver, None, None))
    assert found.result.status.name == "OPTIMAL"
    return found


def problem_of(name: str) -> Problem:
    if name == "slider":
        return slider(intervals=INTERVALS).problem
    hard = random_problem(int(name.removeprefix("hard ")), HARD).problem
    return replace(hard, intervals=INTERVALS)


class Dense:
    """The dense program of an answer, about that answer."""

    def __init__(self, found: Candidate) -> None:
        self.program, self.excess = found.program, found.result.excess
        N, n = found.program.grid.size, found.program.n
        self.controls, self.S = found.controls, found.S
        h = found.program.grid.steps
        after = 1.0 - np.cumsum(h)  # from the end of each interval to the goal
        # what the accelerations of one joint add to its coordinate and rate at the goal
        of_start = np.stack([h**2 / 3.0 + after * h / 2.0, h / 2.0])
        of_end = np.stack([h**2 / 6.0 + after * h / 2.0, h / 2.0])
        at_goal = np.stack([of_start, of_end], axis=-1).reshape(2, 2 * N)
        per_joint = sla.null_space(at_goal)  # (2N, 2N - 2)
        self.basis = np.einsum("ka,ij->kiaj", per_joint, np.eye(n)).reshape(2 * N * n, -1)
        self.size = self.basis.shape[1] + 1

    def values(self, d: np.ndarray) -> tuple[float, np.ndarray]:
        """Objective, and all inequalities, after a change of the scaled variables."""
        program = self.program
        change = (self.basis @ d[:-1]).reshape(self.controls.shape) * program.control_scale
        S = self.S + d[-1] * program.reference**2
        at = program.evaluate(program.pack(self.controls + change, S))
        rows = at.inequalities.copy()
        if self.excess is not None:
            rows[: len(self.excess)] += self.excess
        return at.objective + at.tie_breaker, rows

    def derivatives(self) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (n,) and Jacobian (m, n) by central differences."""
        gradient, columns = np.zeros(self.size), []
        for i in range(self.size):
            d = np.zeros(self.size)
            d[i] = STEP
            (f_up, up), (f_down, down) = self.values(d), self.values(-d)
            gradient[i] = (f_up - f_down) / (2.0 * STEP)
            columns.append((up - down) / (2.0 * STEP))
        return gradient, np.stack(columns, axis=1)


def residual(gradient: np.ndarray, rows: np.ndarray) -> float:
    """Norm of what no combination of rows with multipliers >= 0 takes away from the gradient."""
    if not len(rows):  # scipy 1.17's nnls aborts the process
        return float(np.linalg.norm(gradient))
    return float(nnls(rows.T, -gradient, maxiter=50 * len(rows))[1])


@pytest.mark.parametrize("qp_solver", ["auto", "proxqp"])
@pytest.mark.parametrize("name", ["slider", "hard 0", "hard 4", "hard 5", "hard 13"])
def test_no_step_of_the_dense_program_promises_a_shorter_motion(name: str, qp_solver: str) -> None:
    dense = Dense(answer(name, qp_solver))
    _, rows = dense.values(np.zeros(dense.size))
    assert rows.max() <= FEASIBLE
    gradient, jacobian = dense.derivatives()
    assert np.linalg.norm(gradient) == pytest.approx(1.0, abs=0.05)
    active = rows > -ACTIVE
    tip_over = active[: dense.program.nonlinear]
    assert tip_over.any(), "the zero moment point costs no time"
    left = residual(gradient, jacobian[active])
    linear = active & (np.arange(len(rows)) >= len(tip_over))
    assert left <= STATIONARY
    # the rows that keep the machine from tipping over are what makes it stationary
    assert left <= SHARE * residual(gradient, jacobian[linear])
