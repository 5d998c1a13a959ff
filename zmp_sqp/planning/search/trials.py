"""Quick search for any safe motion of problems that differ little, for the diagnosis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ZmpSqpError
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.solution import trajectory
from zmp_sqp.planning.proof.boundary_states import meets_boundary_states
from zmp_sqp.planning.proof.certificate import certify_for
from zmp_sqp.planning.search.explore import COARSE
from zmp_sqp.planning.search.run import Runs
from zmp_sqp.planning.search.task import Task, Tightening, task_of
from zmp_sqp.sqp.least_distance import nearest_feasible
from zmp_sqp.sqp.result import SQPStatus

__all__ = ["Found", "Trials"]

# durations of first guesses per lower bound: slow, as any safe motion will do
PACES = (2.0, 5.0)
SIZE = 25  # intervals of the coarse grid at most
SPARE = 1.01  # longer than where a run of the SQP ended, which only comes near feasibility
INSIDE = 1e-3  # [m] by which the ZMP is kept further inside, so that the proof succeeds
MOST_ITERATIONS = 20  # of one run of the SQP
NEAR = (SQPStatus.COARSE, SQPStatus.OPTIMAL, SQPStatus.FEASIBLE, SQPStatus.BOUND_REACHED)


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Motion that satisfies the constraints of a program on a coarse grid.

    Attributes:
        task: Planning task.
        controls: Accelerations T^2 a at both ends of the intervals, shape (N, 2, n).
        duration: T [s].
    """

    task: Task
    controls: Array
    duration: float

    @property
    def is_safe(self) -> bool:
        """Whether the motion, on all intervals of the problem, is proven safe at all times."""
        problem = self.task.problem
        coarse = Grid.of(len(self.controls))
        fine = coarse.refined(problem.first_intervals)
        program = self.task.program(self.duration, coarse, least=0.0)
        point = program.pack(self.controls, self.duration**2)
        try:
            motion = trajectory(problem, program, point, fine)
            return certify_for(problem, motion).safe and meets_boundary_states(problem, motion)
        except ZmpSqpError:  # the path leaves the map, or the tracks cannot follow the ground
            return False


@dataclass(slots=True, eq=False)
class Trials:
    """Attempts at problems of one machine, start and goal; each starts at the last motion found.

    Attributes:
        qp_solver: Name of the QP solver.
        time_budget: Wall time of each attempt [s]; None for no limit.
        iterations: SQP iterations that all further attempts may take together.
        last: Motion that was found last; None at first.
    """

    qp_solver: str
    time_budget: float | None
    iterations: int
    last: Found | None = None

    def by_steps(self, problem: Problem) -> Found | None:
        """Motion near the last one by shortest steps onto the constraints; None if that fails."""
        task = task_of(problem)
        return self._feasible(task, *self._guess(task))

    def by_search(self, problem: Problem) -> Found | None:
        """Motion of `by_steps` or else of an SQP run on a coarse grid; None if both fail."""
        if (found := self.by_steps(problem)) is not None:
            return found
        task = task_of(problem)
        for pace in PACES if self.last is None else PACES[:1]:
            most = min(MOST_ITERATIONS, self.iterations)
            if most <= 0:
                break
            controls, duration = self._guess(task, pace)
            program = task.program(duration, Grid.of(len(controls)))
            settings = replace(COARSE, max_iterations=most)
            runs, point = self._runs(), program.pack(controls, duration**2)
            near = runs.minimize(program, point, settings)
            self.iterations -= len(near.result.history)
            if near.result.status in NEAR:
                return self._feasible(task, near.controls, SPARE * near.duration)
        return None

    def _feasible(self, task: Task, controls: Array, duration: float) -> Found | None:
        inside = Tightening().by("tip_over", INSIDE)
        grid = Grid.of(len(controls))
        program = task.program(duration, grid, least=0.0, tightening=inside)
        point = program.pack(controls, duration**2)
        nearest = nearest_feasible(program, point, self._runs().backend)
        if not nearest.feasible:
            return None
        self.last = Found(task, np.asarray(program.unpack(nearest.point)[2]), duration)
        return self.last

    def _guess(self, task: Task, pace: float = PACES[0]) -> tuple[Array, float]:
        """Accelerations T^2 a on a coarse grid, shape (N, 2, n), and duration T [s]."""
        if self.last is not None:
            return self.last.controls, self.last.duration
        size = min(task.problem.first_intervals, SIZE)
        return task.guess(pace * task.least, size, smooth=True)

    def _runs(self) -> Runs:
        return Runs.start(self.qp_solver, self.time_budget, None)
