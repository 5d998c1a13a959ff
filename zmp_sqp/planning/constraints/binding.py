"""Constraints bound to a machine, with what is wrong with them said before anything is planned."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from zmp_sqp.arrays import shortened
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.planning.constraints.protocol import ConstraintRows, PathConstraint

__all__ = ["bound_rows", "checked_constraints"]

RESERVED = ("base", "contact", "distance_limits", "joint_limits", "tip_over")


def bound_rows(
    constraints: Sequence[PathConstraint], machine: Machine, coordinates: Coordinates
) -> tuple[ConstraintRows, ...]:
    """Rows of each constraint for a machine.

    Raises:
        ProblemError: The machine lacks what a constraint needs.
    """
    return tuple(constraint.rows(machine, coordinates) for constraint in constraints)


def checked_constraints(given: Any) -> tuple[PathConstraint, ...]:
    """The user's constraints as a tuple.

    Raises:
        ProblemError: An entry is no constraint, or two have the same name, or a name is one that the
            planner uses itself.
    """
    try:
        constraints = tuple(given)
    except TypeError:
        raise ProblemError(
            f"constraints must be a list of path constraints, not {shortened(given)}"
        ) from None
    for constraint in constraints:
        if isinstance(constraint, type) or not isinstance(constraint, PathConstraint):
            raise ProblemError(
                "constraints must be path constraints such as TorqueLimits() or PathRows(...), "
                f"not {shortened(constraint)}"
            )
    names = [constraint.name for constraint in constraints]
    for i, name in enumerate(names):
        if name in RESERVED:
            raise ProblemError(f"a constraint cannot be named {name!r}: the planner has its own")
        if name in names[:i]:
            raise ProblemError(f"two constraints are named {name!r}; give each a name of its own")
    return constraints
