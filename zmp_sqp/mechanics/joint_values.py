"""Joint coordinates as users give them: one number per joint, by joint name, or a named pose."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, shortened
from zmp_sqp.errors import MachineError, ZmpSqpError
from zmp_sqp.mechanics.machine import Machine

__all__ = ["by_joint"]


def by_joint(given: Any, machine: Machine, *, name: str, error: type[ZmpSqpError]) -> Any:
    """Numbers in the order of the planned joints, where they are given by name.

    Args:
        given: Mapping from the names of all planned joints to numbers, or the name of a pose.
            Anything else is returned as it is.
        machine: The machine.
        name: Name of the value in error messages.
        error: Exception class to raise.

    Returns:
        Array of shape (n,), or `given`.

    Raises:
        error: An unknown or held joint, planned joints without a number, not a number, or no pose
            that names all planned joints; the message names the joints.
    """
    if isinstance(given, str):
        try:
            return machine.pose(given)
        except MachineError as fault:
            raise error(f"{name}: {fault}") from None
    return _in_order(given, machine, name, error) if isinstance(given, Mapping) else given


def _in_order(
    given: Mapping[Any, Any], machine: Machine, name: str, error: type[ZmpSqpError]
) -> Array:
    """Numbers of a mapping in the order of the planned joints, shape (n,)."""
    for joint in given:
        if joint in machine.held:
            raise error(f"{name}: joint {joint!r} is held at {machine.held[joint]:g}: leave it out")
        if joint not in machine.joint_names:
            raise error(
                f"{name}: there is no joint {shortened(joint)}; joints are "
                f"{', '.join(machine.joint_names)}"
            )
    missing = [joint for joint in machine.joint_names if joint not in given]
    if missing:
        raise error(f"{name}: joint {', '.join(map(repr, missing))} is missing")
    return np.array(
        [
            finite_number(given[joint], name=f"{name} of joint {joint!r}", error=error)
            for joint in machine.joint_names
        ]
    )
