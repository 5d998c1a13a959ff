"""Exceptions: misuse raises one at once; a well-posed problem without a solution is a status."""

__all__ = [
    "ContactLost",
    "MachineError",
    "MissingExtra",
    "NotSolved",
    "ProblemError",
    "ScenarioError",
    "TrajectoryError",
    "ZmpSqpError",
]


class ZmpSqpError(Exception):
    """Base class of every error that this library raises on purpose."""


class MachineError(ZmpSqpError):
    """The machine's description cannot be used: URDF, limits, payload or support polygon."""


class ProblemError(ZmpSqpError):
    """The planning problem contradicts itself or its machine."""


class TrajectoryError(ZmpSqpError):
    """A trajectory, or a file of one, cannot be used."""


class ScenarioError(ZmpSqpError):
    """A scenario file cannot be read; the message names the key."""


class ContactLost(ZmpSqpError):
    """The ground would have to pull (n . f <= 0): there is no zero moment point."""


class MissingExtra(ZmpSqpError):
    """An optional package is not installed; the message says how to install it."""


class NotSolved(ZmpSqpError):
    """The trajectory of an unsuccessful plan was asked for; the message is the plan's diagnosis."""
