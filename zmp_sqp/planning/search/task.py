"""A problem as the search sees it: boundary states, limits, bound constraints, proven bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from zmp_sqp.arrays import Array
from zmp_sqp.motion.double_integrator import slowest_minimum_time
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.undercarriage import Driving
from zmp_sqp.planning.program.driving.transcription import DrivingTranscription
from zmp_sqp.planning.program.formulation import (
    bound_constraints,
    boundaries,
    grid_bound,
    path_bounds,
)
from zmp_sqp.planning.program.hold import Hold
from zmp_sqp.planning.program.rows import BoundConstraints, StageRows
from zmp_sqp.planning.program.solution import MotionProgram
from zmp_sqp.planning.program.transcription import Boundary, PathBounds, Transcription
from zmp_sqp.planning.search.guess import initial_guess

__all__ = ["Task", "Tightening", "task_of"]


@dataclass(frozen=True, slots=True)
class Tightening:
    """By how much the program keeps inside constraints, so that these hold between its nodes.

    Attributes:
        constraints: By constraint name, in the constraint's unit.
        base_bounds: For x and y bounds of a base [m].
    """

    constraints: Mapping[str, float] = field(default_factory=dict)
    base_bounds: float = 0.0

    def by(self, name: str, amount: float) -> Tightening:
        """Tightened further for one constraint."""
        changed = {**self.constraints, name: self.constraints.get(name, 0.0) + amount}
        return replace(self, constraints=changed)


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What search, refinement and proof work on.

    Attributes:
        problem: The question.
        start, goal: Boundary states in planning coordinates.
        bounds: Limits of the coordinates; their least duration is a proven bound on this grid.
        constraints: The path constraints, bound to the machine at every corner.
        lower_bound: No motion within the limits of joints and base is shorter [s].
    """

    problem: Problem
    start: Boundary
    goal: Boundary
    bounds: PathBounds
    constraints: BoundConstraints
    lower_bound: float

    @property
    def least(self) -> float:
        """Proven lower bound of the duration on this grid [s]."""
        return self.bounds.least_duration

    def program(
        self,
        reference: float,
        hold: Hold,
        *,
        least: float,
        ties: Any = None,
        tightening: Tightening | None = None,
    ) -> MotionProgram:
        """The nonlinear program.

        Args:
            reference: Duration that scales time [s].
            hold: How accelerations run within an interval.
            least: Lower bound that is put on the duration [s].
            ties: Map from fewer free variables to the controls; None leaves each free.
            tightening: How far inside the constraints it keeps; None not at all.
        """
        drawn_in = tightening or Tightening()
        problem = self.problem
        of_coordinates = Transcription(
            StageRows(self.constraints.tightened(drawn_in.constraints), reference),
            self.start,
            self.goal,
            replace(self.bounds, least_duration=least),
            intervals=problem.intervals,
            hold=hold,
            ties=ties,
        )
        undercarriage = problem.undercarriage
        if not isinstance(undercarriage, Driving):
            return of_coordinates
        support = problem.machine.support
        return DrivingTranscription(
            of_coordinates,
            undercarriage.base,
            undercarriage.terrain,
            reach=0.0 if support is None else support.reach,
            drawn_in=drawn_in.base_bounds,
        )

    def guess(self, duration: float, *, smooth: bool) -> tuple[Array, float]:
        """Accelerations T^2 a, shape (N, n), and duration of a motion to start from [s].

        Args:
            duration: Least duration of it [s].
            smooth: Whether it is a cubic from rest to rest, too.
        """
        return initial_guess(
            self.constraints,
            self.start,
            self.goal,
            self.bounds,
            intervals=self.problem.intervals,
            least_duration=duration,
            smooth=smooth,
            route=self.problem.undercarriage.route,
        )


def task_of(problem: Problem) -> Task:
    """Formulate a problem."""
    start, goal = boundaries(problem)
    bounds = path_bounds(problem)
    limits = problem.machine.limits
    lower_bound = max(
        problem.undercarriage.least_duration,
        slowest_minimum_time(
            problem.goal - problem.start,
            max_velocity=limits.velocity,
            max_acceleration=limits.acceleration,
            start_velocity=problem.start_velocity,
            goal_velocity=problem.goal_velocity,
        ),
    )
    least = max(lower_bound, grid_bound(start, goal, bounds, problem.intervals))
    constraints = bound_constraints(problem)
    bounds = replace(bounds, least_duration=least)
    return Task(problem, start, goal, bounds, constraints, lower_bound)
