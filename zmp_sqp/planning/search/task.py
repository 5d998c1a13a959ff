"""Planning task: a problem with its boundary states, limits, constraints and lower bound."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.cached import cached_property
from zmp_sqp.motion.double_integrator import slowest_minimum_time
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.undercarriage import Driving
from zmp_sqp.planning.program.driving.positions import Positions, position_bounds
from zmp_sqp.planning.program.formulation import (
    bound_constraints,
    boundaries,
    grid_bound,
    path_bounds,
)
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.limits import Boundary, PathBounds, PositionBound
from zmp_sqp.planning.program.rows import BoundConstraints, StageRows
from zmp_sqp.planning.program.staged import StagedProgram
from zmp_sqp.planning.search.guess import initial_guess, swung_aside

__all__ = ["Task", "Tightening", "lower_bound_of", "task_of"]


POSES = 9  # poses on the straight line in joint space at which corners are compared at rest


@dataclass(frozen=True, slots=True)
class Tightening:
    """Amounts by which constraints are tightened in the program, to hold between its nodes.

    Attributes:
        constraints: Amount by constraint name, in the constraint's unit.
        base_bounds: Amount for x and y bounds of a base [m].
    """

    constraints: Mapping[str, float] = field(default_factory=dict)
    base_bounds: float = 0.0

    def by(self, name: str, amount: float) -> Tightening:
        """This tightening, increased by an amount for one constraint."""
        changed = {**self.constraints, name: self.constraints.get(name, 0.0) + amount}
        return replace(self, constraints=changed)


@dataclass(frozen=True, eq=False)
class Task:
    """Planning task, derived from a problem once: what explore, refine and prove share.

    Attributes:
        problem: Problem to plan.
        start, goal: Boundary states in the coordinates of joints and undercarriage.
        bounds: Limits of the coordinates.
        constraints: Path constraints, bound to the machine at every corner.
        lower_bound: Proven lower bound of the duration within the limits of joints and base [s].
    """

    problem: Problem
    start: Boundary
    goal: Boundary
    bounds: PathBounds
    constraints: BoundConstraints
    lower_bound: float

    @property
    def least(self) -> float:
        """Lower bound of the duration with one acceleration per interval of the first grid [s].

        Equals `lower_bound` unless the motion is from rest to rest.
        """
        return max(self.lower_bound, self.bound_on(self.problem.first_intervals))

    def bound_on(self, intervals: int) -> float:
        """Least duration with one acceleration per interval [s]; 0 unless from rest to rest."""
        return grid_bound(self.start, self.goal, self.bounds, intervals)

    def program(
        self,
        reference: float,
        grid: Grid,
        *,
        least: float | None = None,
        tightening: Tightening | None = None,
    ) -> StagedProgram:
        """Nonlinear program of the task on a grid.

        Args:
            reference: Duration that scales time [s].
            grid: Grid of normalised time.
            least: Lower bound on the duration [s]; None for `lower_bound`.
            tightening: Amounts by which constraints are tightened; None for none.
        """
        amounts = tightening or Tightening()
        constraints = self.constraints.tightened(amounts.constraints)
        duration = self.lower_bound if least is None else least
        undercarriage = self.problem.undercarriage
        drive: Positions | None = None
        position_limits: tuple[PositionBound, ...] = ()
        if isinstance(undercarriage, Driving):
            drive = Positions(undercarriage.base, undercarriage.terrain)
            support = self.problem.machine.support
            position_limits = position_bounds(
                undercarriage.base,
                undercarriage.terrain,
                reach=0.0 if support is None else support.reach,
                drawn_in=amounts.base_bounds,
            )
        return StagedProgram(
            StageRows(constraints, reference),
            self.start,
            self.goal,
            replace(self.bounds, least_duration=duration),
            grid,
            drive=drive,
            position_bounds=position_limits,
        )

    def guess(self, duration: float, intervals: int, *, smooth: bool) -> tuple[Array, float]:
        """Initial guess: accelerations T^2 a, shape (N, 2, n), and duration T [s].

        Args:
            duration: Least duration of the guess [s].
            intervals: Number N of equal intervals.
            smooth: Whether to use a cubic also from rest to rest, see `initial_guess`.
        """
        alpha, found = initial_guess(
            self.constraints.at([self.worst_corner]),
            self.start,
            self.goal,
            self.bounds,
            intervals=intervals,
            least_duration=duration,
            smooth=smooth,
            route=self.problem.undercarriage.route,
        )
        controls = np.repeat(alpha[:, None], 2, axis=1)
        undercarriage = self.problem.undercarriage
        if isinstance(undercarriage, Driving):
            ahead, across = undercarriage.base.offset
            if abs(across) > abs(ahead):
                grid = Grid.of(intervals)
                aside, found = swung_aside(across, found, self.bounds, grid)
                controls[..., -2:] += aside
        return controls, found

    @cached_property
    def worst_corner(self) -> int:
        """Index of the corner whose ZMP is furthest out at rest on the line from start to goal."""
        if len(self.constraints.corners) == 1:
            return 0
        share = np.linspace(0.0, 1.0, POSES)[:, None]
        q = self.start.q + share * (self.goal.q - self.start.q)
        route = self.problem.undercarriage.route
        base_positions = None if route is None else route[0] + share * (route[1] - route[0])
        outside = self.constraints.outside_by_corner(q, 0.0 * q, 0.0 * q, 1.0, base_positions)
        return int(np.argmax(outside))


def lower_bound_of(problem: Problem) -> float:
    """Duration that no motion within the limits of joints and base can undercut [s]."""
    limits = problem.machine.limits
    of_joints = slowest_minimum_time(
        problem.goal - problem.start,
        max_velocity=limits.velocity,
        max_acceleration=limits.acceleration,
        start_velocity=problem.start_velocity,
        goal_velocity=problem.goal_velocity,
    )
    return max(problem.undercarriage.least_duration, of_joints)


def task_of(problem: Problem, constraints: BoundConstraints | None = None) -> Task:
    """Planning task of a problem.

    Args:
        problem: The problem.
        constraints: Its path constraints, bound to the machine; None if they are not known yet.
    """
    start, goal = boundaries(problem)
    bounds = path_bounds(problem, start, goal)
    bound = bound_constraints(problem) if constraints is None else constraints
    return Task(problem, start, goal, bounds, bound, lower_bound_of(problem))
