"""What a session keeps from one request to the next: the machine, and the last motion."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.control import Planner
from zmp_sqp.mechanics import Machine
from zmp_sqp.planning import Plan, Problem
from zmp_sqp.planning.search.answer import Status
from zmp_sqp.scenario import Scenario
from zmp_sqp.scenario.scene import build_machine

__all__ = ["KeptMachine", "QuickPlanner"]

# attributes of a Planner that a problem has, too
PLANNER_FIELDS = (
    "machine",
    "ground",
    "margin",
    "intervals",
    "model",
    "constraints",
    "tipping_fraction",
    "payload_uncertainty",
    "slope_uncertainty",
    "payload_com_uncertainty",
)
MOST_TIMES = 4.0  # the budget may grow to so many times what was asked for
SPENT = 0.8  # share of the budget from which on a search has run out of time


class KeptMachine:
    """Machine of the last request, which most requests have in common.

    Attributes:
        said: Warnings that were given when it was built.
    """

    def __init__(self) -> None:
        self._table: dict[str, Any] = {}
        self._machine: Machine | None = None
        self.said: tuple[warnings.WarningMessage, ...] = ()

    def build(self, table: Mapping[str, Any], folder: Path) -> Machine:
        """Machine of the table [machine], whose paths are relative to a folder.

        Raises:
            MachineError: URDF, limits, support or payload cannot be used.
        """
        if self._machine is None or table != self._table:
            self._machine, self.said = None, ()
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                self._machine = build_machine(table, folder)
            self.said = tuple(caught)
            self._table = deepcopy(dict(table))
        return self._machine


class QuickPlanner:
    """Planner for what is dragged: from the last motion, within a budget.

    A search that runs out of time is given twice as much the next time, up to `MOST_TIMES` the
    budget: over terrain, the first motion takes longer than those that start from it.

    Attributes:
        budget: Time of a plan that is asked for [s].
        allowed: Time that the next plan has [s].
    """

    def __init__(self, budget: float) -> None:
        self.budget = budget
        self.allowed = budget
        self._planner: Planner | None = None

    def plan(self, scenario: Scenario) -> Plan | None:
        """Certified motion from start to goal of a scenario; None if none is found in time.

        What a `Planner` may return beside it, a stop or a motion to the goal of an earlier call,
        answers another question.
        """
        problem, solver = scenario.problem, scenario.qp_solver
        if self._planner is None or self._planner.qp_solver != solver:
            self._planner = Planner(problem.machine, qp_solver=solver)
        for name in PLANNER_FIELDS:
            setattr(self._planner, name, getattr(problem, name))
        began = time.perf_counter()
        found = self._planner.plan(
            problem.start,
            problem.goal,
            problem.start_velocity,
            time_budget=self.allowed,
            goal_velocity=problem.goal_velocity,
            base=problem.base,
        )
        if found.success and _answers(found, problem):
            self.allowed = self.budget
            return found
        spent = time.perf_counter() - began > SPENT * self.allowed
        if spent or str(Status.TIME_BUDGET) in found.message:  # it may end early, with a stop
            self.allowed = min(2.0 * self.allowed, MOST_TIMES * self.budget)
        return None


def _answers(found: Plan, problem: Problem) -> bool:
    """Whether a plan leads from start to goal of a problem."""
    asked = found.problem
    return (
        found.status is not Status.STOP
        and asked.base is problem.base
        and all(
            np.array_equal(getattr(asked, key), getattr(problem, key))
            for key in ("start", "goal", "start_velocity", "goal_velocity")
        )
    )
