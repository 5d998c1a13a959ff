"""What a planner was asked last, so that its next call keeps what has not changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.ground import Slope
from zmp_sqp.mechanics.workspace import workspace_of
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.program.rows import BoundConstraints
from zmp_sqp.planning.search.answer import Plan

__all__ = ["Question", "Standing"]

STATE = ("start", "start_velocity")  # arguments that every call changes


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """A problem with its constraints, and the arguments that it was made of.

    Attributes:
        given: Arguments of the problem as they were given, but the `STATE`; arrays and lists are
            copied, because they may be changed in place.
        problem: The problem.
        constraints: Its path constraints, bound to the machine.
        version: Version of the machine's model, whose numbers can be changed in place.
    """

    given: Mapping[str, Any]
    problem: Problem
    constraints: BoundConstraints
    version: int

    @classmethod
    def of(
        cls, arguments: Mapping[str, Any], problem: Problem, constraints: BoundConstraints
    ) -> Question:
        """Question of a problem that was made of some arguments."""
        given = {name: _copied(value) for name, value in arguments.items() if name not in STATE}
        return cls(given, problem, constraints, workspace_of(problem.machine.model).version)

    def from_start(self, arguments: Mapping[str, Any]) -> Problem | None:
        """The same problem from another start (`Problem.from_start`); None if more has changed.

        Args:
            arguments: All arguments of the new problem.

        Raises:
            ProblemError: The start is refused.
        """
        # other grounds may change in place, and bases begin elsewhere at every call
        if self.problem.base is not None or not isinstance(self.problem.ground, Slope):
            return None
        if workspace_of(self.problem.machine.model).version != self.version:
            return None
        others = (name for name in arguments if name not in STATE)
        if not all(_is_same(self.given[name], arguments[name]) for name in others):
            return None
        return self.problem.from_start(*(arguments[name] for name in STATE))


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """Certified plan to stay where the machine stands, for the next call that asks for it.

    Attributes:
        given: Arguments of the problem, copied as in `Question`.
        version: Version of the machine's model.
        plan: The plan.
    """

    given: Mapping[str, Any]
    version: int
    plan: Plan

    @classmethod
    def of(cls, arguments: Mapping[str, Any], plan: Plan) -> Standing | None:
        """Plan of a machine at rest on a slope, whose base does not drive; None for any other."""
        moves = np.any(arguments["start_velocity"]) or arguments["base"] is not None
        if moves or not plan.success or not isinstance(arguments["ground"], Slope):
            return None
        given = {name: _copied(value) for name, value in arguments.items()}
        return cls(given, workspace_of(arguments["machine"].model).version, plan)

    def answers(self, arguments: Mapping[str, Any]) -> bool:
        """Whether it is the answer to a problem with these arguments, too."""
        same = all(_is_same(self.given[name], value) for name, value in arguments.items())
        return same and workspace_of(arguments["machine"].model).version == self.version


def _copied(value: Any) -> Any:
    """A value that does not change with the one that was given."""
    if isinstance(value, list | tuple):
        return tuple(map(_copied, value))
    return value.copy() if isinstance(value, np.ndarray | dict) else value


def _is_same(old: Any, new: Any) -> bool:
    """Whether two arguments are surely the same: one object, or equal numbers of one type."""
    if isinstance(old, np.ndarray):
        return isinstance(new, np.ndarray) and _equal(old, new)
    if isinstance(old, tuple):
        return (
            isinstance(new, tuple | list) and len(old) == len(new) and all(map(_is_same, old, new))
        )
    if isinstance(old, float | int | str):
        return type(old) is type(new) and bool(old == new)
    return old is new and not isinstance(old, dict)


def _equal(old: Array, new: Array) -> bool:
    return old.dtype == new.dtype and np.array_equal(old, new)
