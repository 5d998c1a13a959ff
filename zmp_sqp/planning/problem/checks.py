"""Checks of the arguments of a `Problem`; each raises a `ProblemError` that says what is wrong."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from zmp_sqp.arrays import Array, distinct_texts, finite_number, shortened
from zmp_sqp.errors import GIVE_LIMITS, MachineError, ProblemError, ProblemWarning
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.limits import (
    FULL_TURN,
    LIMIT_TOLERANCE,
    JointLimits,
    position_fault,
)
from zmp_sqp.mechanics.lumped_mass import FORM_TOLERANCE
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.planning.constraints.tip_over import supported
from zmp_sqp.planning.problem.statics import largest_share

__all__ = [
    "AUTO",
    "MOST_ACCELERATIONS",
    "UNCERTAINTIES",
    "Range",
    "check_boundary_state",
    "check_limits",
    "check_plannable",
    "check_simplified",
    "checked_in_range",
    "checked_intervals",
    "checked_margin",
]


class Range(NamedTuple):
    """Closed range of a number that a problem takes.

    Attributes:
        name: Name of the argument.
        lower: Least value.
        upper: Largest value.
        unit: Unit of the values; empty for a share.
    """

    name: str
    lower: float
    upper: float
    unit: str


class _Limits(NamedTuple):
    """Limits of one joint [rad or m, s]."""

    lower: float
    upper: float
    velocity: float
    acceleration: float


# intervals times joints: the dense form of the QPs needs memory in its square, here 2 GB
AUTO = "auto"  # number of intervals that the planner chooses
MOST_ACCELERATIONS = 10_000
UNCERTAINTIES = (
    Range("tipping_fraction", 0.1, 1.0, ""),
    Range("payload_uncertainty", 0.0, 0.9, ""),
    Range("slope_uncertainty", 0.0, 0.5, "rad"),
)
FARTHEST = 1e5  # [rad or m] largest coordinate: beyond it, float64 leaves too few digits
# [rad/s or m/s; rad/s^2 or m/s^2] range of velocity and acceleration limits: outside it, squared
# durations overflow
MANY_TURNS = 4.0 * FULL_TURN  # [rad] angles beyond it may be meant in degrees
LIMIT_RANGE = (1e-12, 1e12)


def checked_intervals(given: object, joints: int) -> int | str:
    """Number of intervals as a Python integer, or "auto".

    Args:
        given: Number of intervals as the user gave it.
        joints: Number of joints.

    Raises:
        ProblemError: Neither "auto" nor a whole number, below 2, or more than
            `MOST_ACCELERATIONS / joints`.
    """
    if isinstance(given, str) and given == AUTO:
        return AUTO
    if isinstance(given, bool) or not isinstance(given, (int, np.integer)) or given < 2:
        raise ProblemError(
            f'intervals must be a whole number of at least 2 or "auto", not {shortened(given)}'
        )
    if given * joints > MOST_ACCELERATIONS:
        raise ProblemError(
            f"intervals must be at most {MOST_ACCELERATIONS // joints} for {joints} joints, "
            f"not {shortened(given)}"
        )
    return int(given)


def check_plannable(machine: Machine) -> None:
    """Refuse a machine that has no planned joint, or no mass.

    Raises:
        ProblemError: The message names the machine.
    """
    if not machine.size:
        raise ProblemError(
            f"machine {machine.name!r} has no movable joint: there is nothing to plan"
        )
    if machine.mass <= 0.0:
        raise ProblemError(
            f"machine {machine.name!r} has no mass, and so no zero moment point: "
            "give its links an <inertial>"
        )


def check_limits(machine: Machine) -> None:
    """Refuse velocity and acceleration limits that are missing or outside `LIMIT_RANGE`.

    Raises:
        ProblemError: The message names the limit and the joint.
    """
    missing = machine.limits.missing(machine.joint_names)
    if missing:
        parts = [
            f"{key.replace('_', ' ')} limit for joint {', '.join(map(repr, joints))}"
            for key, joints in missing.items()
        ]
        raise ProblemError(f"no {'; no '.join(parts)}: {GIVE_LIMITS.arguments}")
    least, most = LIMIT_RANGE
    for key in ("velocity", "acceleration"):
        for joint, value in zip(machine.joint_names, getattr(machine.limits, key), strict=True):
            if not least <= value <= most:
                raise ProblemError(
                    f"{key} limit of joint {joint!r} is {value:.6g}: "
                    f"planning needs a value from {least:g} to {most:g}"
                )


def checked_margin(given: object, machine: Machine) -> float:
    """Required distance from the ZMP to every edge of the support polygon [m].

    Raises:
        ProblemError: The machine has no support polygon, or the margin is no number, negative, or
            so large that no point of the polygon has this distance from every edge.
    """
    support = supported(machine)
    margin = finite_number(given, name="margin", error=ProblemError)
    if margin < 0.0:
        raise ProblemError(f"margin must be at least 0 m, not {margin} m")
    if not _leaves_room(support, margin):
        most = largest_share(lambda share: _leaves_room(support, share * margin)) or 0.0
        raise ProblemError(
            f"margin {margin} m leaves nothing of the support polygon; the largest that leaves "
            f"something is {np.floor(1e3 * most * margin) / 1e3:g} m"
        )
    return margin


@lru_cache(maxsize=64)
def _leaves_room(support: SupportPolygon, margin: float) -> bool:
    """Whether some point of a support polygon keeps a margin [m] from every edge."""
    try:
        support.inset(margin)
    except MachineError:
        return False
    return True


def checked_in_range(allowed: Range, given: object) -> float:
    """Number that lies within a range.

    Raises:
        ProblemError: Not a finite number, or outside the range; the message gives the range.
    """
    value = finite_number(given, name=allowed.name, error=ProblemError)
    if not allowed.lower <= value <= allowed.upper:
        shown, lower, upper = distinct_texts(value, allowed.lower, allowed.upper)
        unit = f" {allowed.unit}" if allowed.unit else ""
        raise ProblemError(
            f"{allowed.name} must lie within [{lower}, {upper}]{unit}, not {shown}{unit}"
        )
    return value


def check_simplified(
    machine: Machine, coordinates: Coordinates, *, goal: Array, rates: tuple[Array, Array]
) -> None:
    """Refuse a goal, or boundary rates, that no coordinates of the simplified model give.

    Args:
        machine: The machine.
        coordinates: Map from the simplified model's coordinates to the joints.
        goal: Joint coordinates at the goal, shape (n,) [rad].
        rates: Joint rates at the start and at the goal, shape (n,) each [rad/s].

    Raises:
        ProblemError: The message names the joint that is furthest off, and its possible value.
    """

    def on_rates(v: Array) -> Array:
        return coordinates.rates(coordinates.rates_of(v))

    def on_joints(q: Array) -> Array:
        return coordinates.joints(coordinates.coordinates_of(q))

    asked: tuple[tuple[str, str, Array, Callable[[Array], Array]], ...] = (
        ("goal", "rad", goal, on_joints),
        ("start velocity", "rad/s", rates[0], on_rates),
        ("goal velocity", "rad/s", rates[1], on_rates),
    )
    for name, unit, values, fit in asked:
        fitted = fit(values)
        worst = int(np.argmax(np.abs(values - fitted)))
        if abs(values[worst] - fitted[worst]) > FORM_TOLERANCE:
            possible, wanted = distinct_texts(float(fitted[worst]), float(values[worst]))
            raise ProblemError(
                f"the simplified model cannot reach the {name}: its joint "
                f"{machine.joint_names[worst]!r} would have {possible} {unit}, not {wanted} {unit}"
                " (Song & Sharf 2020, eq. (7), ties stick and levelling joint to the boom; "
                "joints beyond keep their start angles)"
            )


def check_boundary_state(name: str, machine: Machine, q: Array, v: Array) -> None:
    """Refuse a start or goal outside the joint limits, or with rates that lead out of them.

    Args:
        name: "start" or "goal", for the message.
        machine: The machine.
        q: Joint coordinates, shape (n,) [rad or m].
        v: Joint rates, shape (n,) [rad/s or m/s].

    Raises:
        ProblemError: The message names the joint, and gives value and limits.
    """
    for i, (joint, unit) in enumerate(zip(machine.joint_names, machine.joint_units, strict=True)):
        one = _one_joint(machine.limits, i)
        _check_joint(name, joint, unit, one, q=float(q[i]), v=float(v[i]))


def _one_joint(limits: JointLimits, i: int) -> _Limits:
    return _Limits(
        lower=float(limits.position_lower[i]),
        upper=float(limits.position_upper[i]),
        velocity=float(limits.velocity[i]),
        acceleration=float(limits.acceleration[i]),
    )


def _check_joint(name: str, joint: str, unit: str, limits: _Limits, *, q: float, v: float) -> None:
    """Refuse a coordinate or rate of one joint; arguments as in `check_boundary_state`."""
    if fault := position_fault(joint, q, lower=limits.lower, upper=limits.upper, unit=unit):
        raise ProblemError(f"{name} {fault}")
    if abs(v) > limits.velocity * (1.0 + LIMIT_TOLERANCE):
        shown, _, largest = distinct_texts(v, abs(v), limits.velocity)
        raise ProblemError(
            f"{name} velocity of joint {joint!r} is {shown}, "
            f"outside its limits +-{largest} {unit}/s"
        )
    if abs(q) > FARTHEST:
        raise ProblemError(
            f"{name} of joint {joint!r} is {q:.6g} {unit}: "
            f"planning needs it within +-{FARTHEST:g} {unit}"
        )
    if unit == "rad" and abs(q) > MANY_TURNS:
        warnings.warn(
            f"{name} of joint {joint!r} is {q:.6g} rad, {abs(q) / FULL_TURN:.3g} full turns; if it "
            f"is meant in degrees, it is {np.radians(q):.4g} rad",
            ProblemWarning,
            stacklevel=6,  # the line that poses the Problem
        )
    # the joint must be able to stop after the start, or to speed up before the goal
    onward = v if name == "start" else -v
    room = limits.upper - q if onward > 0.0 else q - limits.lower
    needed = onward**2 / (2.0 * limits.acceleration)
    if needed > room + LIMIT_TOLERANCE:
        change = "stop before" if name == "start" else "speed up from"
        side, limit = ("upper", limits.upper) if onward > 0.0 else ("lower", limits.lower)
        least, available = distinct_texts(needed, room, digits=4)
        raise ProblemError(
            f"{name} velocity {v:.6g} {unit}/s of joint {joint!r} leaves no room to {change} its "
            f"{side} limit {limit:.6g} {unit}: {least} {unit} needed, {available} {unit} available"
        )
