"""Exceptions of this library.

Wrong input raises one of these at once. A well-posed problem for which no motion was found raises
nothing: the returned plan says so in its status.
"""

from __future__ import annotations

import sys
import warnings
from typing import Any, NamedTuple

__all__ = [
    "GIVE_EFFORT",
    "GIVE_LIMITS",
    "GIVE_SUPPORT",
    "HOLD",
    "ContactLost",
    "Interrupted",
    "MachineError",
    "MachineWarning",
    "MissingExtra",
    "NotSolved",
    "ProblemError",
    "ProblemWarning",
    "ScenarioError",
    "TrajectoryError",
    "UnboundedAcceleration",
    "ZmpSqpError",
    "in_keys",
    "warn_of_machine",
]


class ZmpSqpError(Exception):
    """Base class of all exceptions that this library raises on purpose."""


class MachineError(ZmpSqpError):
    """A machine, or part of its description, is invalid: URDF, limits, payload, support, ground."""


class MachineWarning(UserWarning):
    """A machine is taken as it is described, but its description is hardly meant so.

    Examples are an inertia that no body can have, and a support polygon as wide as a street.
    """


class ProblemWarning(UserWarning):
    """A planning problem is taken as it is posed, but a number in it looks like another unit."""


class ProblemError(ZmpSqpError):
    """A planning problem contradicts itself, its machine or its ground."""


class TrajectoryError(ZmpSqpError):
    """A trajectory, or the file that should contain one, is invalid."""


class UnboundedAcceleration(TrajectoryError):
    """A motion is given whose rates jump, so that no acceleration and no ZMP of it has a bound."""


class ScenarioError(ZmpSqpError):
    """A scenario file is invalid; the message names the key."""


class ContactLost(ZmpSqpError):
    """The ground would have to pull at the machine (n . f <= 0), so no zero moment point exists."""


class MissingExtra(ZmpSqpError):
    """An optional package is missing or does not work here; the message says what to install."""


class NotSolved(ZmpSqpError):
    """An unsuccessful plan was asked for its trajectory; the message is the plan's diagnosis."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C ended `plan_many`.

    Attributes:
        plans: Plans in the order of the problems; None for those that were not done.
    """

    def __init__(self, plans: list[Any]) -> None:
        done = sum(plan is not None for plan in plans)
        super().__init__(f"interrupted after {done} of {len(plans)} plans")
        self.plans = plans


class Advice(NamedTuple):
    """What to do about an error, which callers of a function do otherwise than users of a file.

    Attributes:
        arguments: Advice in terms of functions and their arguments, as in messages.
        keys: Advice in terms of keys of scenario files and options of the command line.
    """

    arguments: str
    keys: str


GIVE_SUPPORT = Advice(
    "give one as support= of load_machine, either a SupportPolygon or the names of the links that "
    "stand on the ground",
    "give one by support or contact_links in [machine] (zmp-sqp check: --contact-links)",
)
GIVE_LIMITS = Advice(
    "give limits= to load_machine, or fill in a joint_limits.yaml beside the URDF",
    "give [machine.limits], or fill in the joint_limits.yaml: that of the key joint_limits in "
    "[machine], else one beside the URDF",
)
GIVE_EFFORT = Advice(
    "give <limit effort=...> in the URDF, or limits={'effort': ...} to load_machine",
    "give <limit effort=...> in the URDF, or effort in [machine.limits]",
)
HOLD = Advice(
    "a joint that shall not move is left out of planning by hold= of load_machine",
    "a joint that shall not move is left out of planning by hold in [machine]",
)


def in_keys(message: str) -> str:
    """Message whose advice is given in keys of files and options instead of arguments."""
    for advice in (GIVE_SUPPORT, GIVE_LIMITS, GIVE_EFFORT, HOLD):
        message = message.replace(advice.arguments, advice.keys)
    return message


def warn_of_machine(text: str) -> None:
    """Warn the user with a `MachineWarning` that points to the line that calls this library."""
    package, level = __name__.partition(".")[0], 1
    frame = sys._getframe()
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] == package:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, MachineWarning, stacklevel=level)
