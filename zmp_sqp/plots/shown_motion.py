"""Motion that a figure is about: of a plan, safe or not, or of a problem and a trajectory."""

from __future__ import annotations

from dataclasses import dataclass

from zmp_sqp.arrays import shortened
from zmp_sqp.errors import NotSolved, ProblemError
from zmp_sqp.planning import Certificate, Plan, Problem, Trajectory
from zmp_sqp.planning.proof.certificate import certify_for

__all__ = ["ShownMotion"]

PLANNERS = {"full": "full model"}  # names of models in figures, where they differ


@dataclass(frozen=True, slots=True, eq=False)
class ShownMotion:
    """Motion with its problem and its certificate.

    Attributes:
        problem: Gives machine, ground, limits and constraints.
        trajectory: The motion.
        certificate: What is guaranteed of it.
        safe: Whether all of the constraints are kept.
    """

    problem: Problem
    trajectory: Trajectory
    certificate: Certificate
    safe: bool

    @classmethod
    def of(cls, source: Plan | Problem, trajectory: Trajectory | None) -> ShownMotion:
        """Motion of the arguments of a function that draws.

        Args:
            source: A plan, whose last motion is shown, safe or not; or a problem.
            trajectory: Motion of a problem, which is certified here; None for a plan.

        Raises:
            NotSolved: The plan has no motion at all.
            ProblemError: The arguments are neither a plan alone nor a problem with a trajectory.
        """
        if isinstance(source, Plan):
            if trajectory is not None:
                raise ProblemError("a plan has its motion: leave out the trajectory")
            if source.attempt is None:
                raise NotSolved(f"there is no motion to draw: {source.message}")
            return cls(source.problem, source.attempt, source.certificate, source.success)
        if not isinstance(source, Problem):
            raise ProblemError(f"give a Plan, or a Problem and a Trajectory: {shortened(source)}")
        if not isinstance(trajectory, Trajectory):
            raise ProblemError(f"with a Problem, give a Trajectory, not {shortened(trajectory)}")
        found = certify_for(source, trajectory)
        return cls(source, trajectory, found, found.safe)

    @property
    def planner(self) -> str:
        """Name of the model with which the problem is planned, as in figures."""
        return PLANNERS.get(self.problem.model, self.problem.model)
