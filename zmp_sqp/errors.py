"""Exceptions of this library.

Wrong input raises one of these at once. A well-posed problem for which no motion was found raises
nothing: the returned plan says so in its status.
"""

__all__ = [
    "ContactLost",
    "MachineError",
    "MachineWarning",
    "MissingExtra",
    "NotSolved",
    "ProblemError",
    "ScenarioError",
    "TrajectoryError",
    "ZmpSqpError",
]


class ZmpSqpError(Exception):
    """Base class of all exceptions that this library raises on purpose."""


class MachineError(ZmpSqpError):
    """A machine, or part of its description, is invalid: URDF, limits, payload, support, ground."""


class MachineWarning(UserWarning):
    """A machine is taken as it is described, but its description is hardly meant so.

    Examples are an inertia that no body can have, and a support polygon as wide as a street.
    """


class ProblemError(ZmpSqpError):
    """A planning problem contradicts itself, its machine or its ground."""


class TrajectoryError(ZmpSqpError):
    """A trajectory, or the file that should contain one, is invalid."""


class ScenarioError(ZmpSqpError):
    """A scenario file is invalid; the message names the key."""


class ContactLost(ZmpSqpError):
    """The ground would have to pull at the machine (n . f <= 0), so no zero moment point exists."""


class MissingExtra(ZmpSqpError):
    """An optional package is missing or does not work here; the message says what to install."""


class NotSolved(ZmpSqpError):
    """An unsuccessful plan was asked for its trajectory; the message is the plan's diagnosis."""
