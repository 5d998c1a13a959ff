"""Random calls of a planner: whatever changes between them, it answers or refuses in words."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import HARD, random_problem
from benchmarks.problems.driving import random_driving_problem
from benchmarks.problems.terrain import random_drive_problem
from zmp_sqp.planning.proof.certificate import certify_for

CALLS = 6  # of one planner
PROBLEMS = {
    "arm": lambda seed: random_problem(seed, HARD).problem,
    "drive": lambda seed: random_driving_problem(seed).problem,
    "terrain": lambda seed: random_drive_problem(seed, over_terrain=True),
}


class Calls:
    """State of a machine that follows what a planner returns, between changes at random."""

    def __init__(self, problem: zs.Problem, rng: np.random.Generator) -> None:
        self.rng = rng
        self.planner = zs.Planner(problem.machine, ground=problem.ground, margin=problem.margin)
        self.q, self.v, self.base = problem.start, problem.start_velocity, problem.base
        self.goal: Any = problem.goal

    def change(self) -> None:
        """Change one thing, or nothing."""
        rng, planner, n = self.rng, self.planner, len(self.q)
        kind = rng.integers(8)
        if kind == 1:
            planner.machine = planner.machine.with_payload_scaled(rng.uniform(0.5, 1.6))
        elif kind == 2:
            planner.margin = float(rng.choice([0.0, 0.1, 0.3]))
        elif kind == 3:
            self.q, self.v = self.q + rng.normal(0.0, 0.02, n), self.v + rng.normal(0.0, 0.05, n)
        elif kind == 4:
            self.goal = self.goal + rng.normal(0.0, 0.1, n)
        elif kind == 5 and isinstance(planner.ground, zs.Slope):
            planner.ground = zs.Slope(*rng.uniform(-0.3, 0.3, 2))
        elif kind == 6:
            self.v = self.v * rng.uniform(0.0, 1.5)
        elif kind == 7:
            planner.intervals = int(rng.choice([10, 25]))

    def call(self) -> zs.Plan:
        """Plan, and follow the plan for a while."""
        budget = None if self.rng.random() < 0.4 else float(10.0 ** self.rng.uniform(-3.0, -0.7))
        plan = self.planner.plan(self.q, self.goal, self.v, budget, base=self.base)
        if plan.success:
            t = self.rng.uniform(0.02, 0.5) * plan.duration
            self.q, self.v, _ = plan.trajectory(t)
            if self.base is not None and plan.trajectory.base is not None:
                pose, rates, _ = plan.trajectory.base(t)
                self.base = replace(self.base, start=pose, start_velocity=rates)
        return plan


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("kind", PROBLEMS)
@pytest.mark.parametrize("seed", range(4))
def test_a_planner_answers_or_refuses_whatever_changes(kind: str, seed: int) -> None:
    rng = np.random.default_rng([seed, len(kind)])
    calls = Calls(PROBLEMS[kind](int(rng.integers(100_000))), rng)
    for _ in range(CALLS):
        calls.change()
        try:
            plan = calls.call()
        except zs.ProblemError:
            continue
        if plan.success:
            stops = plan.status is zs.Status.STOP
            assert certify_for(plan.problem, plan.trajectory, anywhere=stops).safe
        else:
            assert not {"inf", "nan"} & set(plan.message.split())
