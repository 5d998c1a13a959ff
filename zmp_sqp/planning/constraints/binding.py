"""Check of the constraints that a user gives, and their rows for a machine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from zmp_sqp.arrays import shortened
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.planning.constraints.protocol import ConstraintRows, PathConstraint

__all__ = ["bound_rows", "checked_constraints"]

# names of the guarantees and constraints that the planner adds itself
RESERVED = ("base", "contact", "distance_limits", "joint_limits", "tip_over")


def bound_rows(
    constraints: Sequence[PathConstraint], machine: Machine, coordinates: Coordinates
) -> tuple[ConstraintRows, ...]:
    """Rows of each constraint for a machine.

    Args:
        constraints: The path constraints.
        machine: Machine with a corner's payload.
        coordinates: Map from planning coordinates to joint coordinates.

    Raises:
        ProblemError: The machine lacks what a constraint needs.
    """
    return tuple(constraint.rows(machine, coordinates) for constraint in constraints)


def checked_constraints(given: Any) -> tuple[PathConstraint, ...]:
    """Constraints that the user gave, as a tuple.

    Raises:
        ProblemError: An entry is no path constraint, two entries have one name, or a name is in
            `RESERVED`.
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
            raise ProblemError(
                f"a constraint cannot be named {name!r}: the planner uses that name itself"
            )
        if name in names[:i]:
            raise ProblemError(f"two constraints are named {name!r}; give them different names")
    return constraints
