"""Checks of the parts of a problem, each with one sentence that says what is wrong."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from zmp_sqp.arrays import Array, finite_number, shortened
from zmp_sqp.errors import MachineError, ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.limits import JointLimits
from zmp_sqp.mechanics.lumped_mass import FORM_TOLERANCE
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.planning.constraints.tip_over import supported

__all__ = [
    "UNCERTAINTIES",
    "check_boundary_state",
    "check_limits",
    "check_simplified",
    "checked_intervals",
    "checked_margin",
    "checked_share",
]

# memory grows with their square in the dense form of the program, here to 2 GB
MOST_ACCELERATIONS = 10_000  # intervals times joints
# what may be uncertain by a single number, with the range of that number
UNCERTAINTIES = (
    ("tipping_fraction", 0.1, 1.0),
    ("payload_uncertainty", 0.0, 0.9),
    ("slope_uncertainty", 0.0, 0.5),
)
FARTHEST = 1e5  # [rad or m] coordinates beyond it leave too few digits
LIMIT_TOLERANCE = 1e-9  # [rad or m] by which rounding may put a start or goal outside its limits
# [rad or m, per second, per second squared] beyond, squares of durations overflow
LIMIT_RANGE = (1e-12, 1e12)


def checked_intervals(given: object, joints: int) -> int:
    """A whole number of intervals.

    Raises:
        ProblemError: No whole number, below 2, or too many for so many joints.
    """
    if isinstance(given, bool) or not isinstance(given, (int, np.integer)) or given < 2:
        raise ProblemError(
            f"intervals must be a whole number of at least 2, not {shortened(given)}"
        )
    if given * joints > MOST_ACCELERATIONS:
        raise ProblemError(
            f"intervals must be at most {MOST_ACCELERATIONS // joints} for {joints} joints, "
            f"not {shortened(given)}"
        )
    return int(given)


def check_limits(machine: Machine) -> None:
    """Refuse limits that are missing or out of the range that planning can count with."""
    missing = machine.limits.missing(machine.joint_names)
    if missing:
        parts = [
            f"{key.replace('_', ' ')} limit for joint {', '.join(map(repr, joints))}"
            for key, joints in missing.items()
        ]
        raise ProblemError(
            f"no {'; no '.join(parts)}: give limits= to load_machine, "
            "or a joint_limits.yaml beside the URDF"
        )
    least, most = LIMIT_RANGE
    for key in ("velocity", "acceleration"):
        for joint, value in zip(machine.joint_names, getattr(machine.limits, key), strict=True):
            if not least <= value <= most:
                raise ProblemError(
                    f"{key} limit of joint {joint!r} is {value:.6g}: "
                    f"planning needs {least:g} to {most:g}"
                )


def checked_margin(given: object, machine: Machine) -> float:
    """A margin that leaves something of the machine's support polygon [m]."""
    support = supported(machine)
    margin = finite_number(given, name="margin", error=ProblemError)
    if margin < 0.0:
        raise ProblemError(f"margin must not be negative, not {margin} m")
    try:
        support.inset(margin)
    except MachineError:
        raise ProblemError(f"margin {margin} m leaves nothing of the support polygon") from None
    return margin


def checked_share(name: str, given: object, lower: float, upper: float) -> float:
    """A number within a range."""
    value = finite_number(given, name=name, error=ProblemError)
    if not lower <= value <= upper:
        raise ProblemError(f"{name} must lie within [{lower:g}, {upper:g}], not {value:g}")
    return value


def check_simplified(
    machine: Machine, coordinates: Coordinates, *, goal: Array, rates: tuple[Array, Array]
) -> None:
    """Refuse a goal, or rates at start and goal, that the simplified model cannot have.

    Args:
        machine: The machine.
        coordinates: Of the simplified model.
        goal: Joint coordinates, shape (n,).
        rates: Joint rates at start and goal, shape (n,) each.
    """

    def on_rates(v: Array) -> Array:
        return coordinates.rates(coordinates.rates_of(v))

    def on_joints(q: Array) -> Array:
        return coordinates.joints(coordinates.coordinates_of(q))

    asked: tuple[tuple[str, Array, Callable[[Array], Array]], ...] = (
        ("goal", goal, on_joints),
        ("start velocity", rates[0], on_rates),
        ("goal velocity", rates[1], on_rates),
    )
    for name, values, fit in asked:
        fitted = fit(values)
        worst = int(np.argmax(np.abs(values - fitted)))
        if abs(values[worst] - fitted[worst]) > FORM_TOLERANCE:
            raise ProblemError(
                f"the simplified model cannot reach the {name}: its joint "
                f"{machine.joint_names[worst]!r} would be at {fitted[worst]:.6g}, "
                f"not {values[worst]:.6g} (eq. 7; the head keeps its attitude at the start)"
            )


def check_boundary_state(name: str, machine: Machine, q: Array, v: Array) -> None:
    """Refuse a start or goal outside the joints' limits, or with rates that lead out of them.

    Args:
        name: "start" or "goal".
        machine: The machine.
        q, v: Joint coordinates and rates there, shape (n,) each.
    """
    for i, joint in enumerate(machine.joint_names):
        _check_joint(
            name, joint, machine.joint_units[i], machine.limits, i, float(q[i]), float(v[i])
        )


def _check_joint(
    name: str, joint: str, unit: str, limits: JointLimits, i: int, q: float, v: float
) -> None:
    lower, upper = limits.position_lower[i], limits.position_upper[i]
    if not lower - LIMIT_TOLERANCE <= q <= upper + LIMIT_TOLERANCE:
        raise ProblemError(
            f"{name} of joint {joint!r} is {q:.6g}, "
            f"outside its limits [{lower:.6g}, {upper:.6g}] {unit}"
        )
    if abs(v) > limits.velocity[i] * (1.0 + LIMIT_TOLERANCE):
        raise ProblemError(
            f"{name} velocity of joint {joint!r} is {v:.6g}, "
            f"outside its limits +-{limits.velocity[i]:.6g}"
        )
    if abs(q) > FARTHEST:
        raise ProblemError(
            f"{name} of joint {joint!r} is {q:.6g}: planning needs it within +-{FARTHEST:g}"
        )
    onward = v if name == "start" else -v  # at the goal, the way it must have come from
    room = upper - q if onward > 0.0 else q - lower
    needed = onward**2 / (2.0 * limits.acceleration[i])
    if needed > room + LIMIT_TOLERANCE:
        what = "stop before" if name == "start" else "reach that rate from"
        side = f"upper limit {upper:.6g}" if onward > 0.0 else f"lower limit {lower:.6g}"
        raise ProblemError(
            f"{name} velocity {v:.6g} of joint {joint!r} leaves no room to {what} its {side}: "
            f"{needed:.4g} needed, {room:.4g} there"
        )
