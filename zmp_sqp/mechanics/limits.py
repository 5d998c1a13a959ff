"""Joint limits: position, velocity, acceleration and effort; NaN marks a limit not given."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, distinct_texts, finite_number, frozen_array, set_frozen_state
from zmp_sqp.errors import HOLD, MachineError, warn_of_machine

__all__ = [
    "FULL_TURN",
    "LIMIT_TOLERANCE",
    "JointLimits",
    "ignored_limits",
    "position_fault",
    "without_unplanned",
]

POSITIONS = ("position_lower", "position_upper")
RATES = ("velocity", "acceleration", "effort")
KEYS = POSITIONS + RATES
LIMIT_TOLERANCE = 1e-9  # [rad or m] distance outside a limit that counts as rounding
MOST_IN_DEGREES = 1e6  # [rad] larger angles are not given in degrees, too
FULL_TURN = 2.0 * np.pi  # [rad] larger angles may be meant in degrees
NEEDED = (*POSITIONS, "velocity", "acceleration")  # limits that planning cannot do without


@dataclass(frozen=True, slots=True, eq=False)
class JointLimits:
    """Limits of n joints; NaN marks a limit that is not given.

    Attributes:
        position_lower: Lowest joint coordinates, -inf where there is no limit (continuous joints),
            shape (n,) [rad or m].
        position_upper: Highest joint coordinates, +inf where there is no limit, shape (n,) [rad or
            m].
        velocity: Largest rates in either direction, shape (n,) [rad/s or m/s].
        acceleration: Largest accelerations in either direction, shape (n,) [rad/s^2 or m/s^2].
        effort: Largest torques or forces in either direction, shape (n,) [N m or N].

    Raises:
        MachineError: Shapes differ; a velocity, acceleration or effort limit is not positive and
            finite; or a lower limit is above the upper one.
    """

    position_lower: Array
    position_upper: Array
    velocity: Array
    acceleration: Array
    effort: Array

    __setstate__ = set_frozen_state

    def __post_init__(self) -> None:
        lengths = {}
        for key in KEYS:
            values = frozen_array(
                getattr(self, key), name=key, shape=(None,), error=MachineError, finite=False
            )
            object.__setattr__(self, key, values)
            lengths[key] = len(values)
        if len(set(lengths.values())) > 1:
            raise MachineError(f"all limits must have the same number of joints, not {lengths}")
        _check({key: getattr(self, key) for key in KEYS}, range(lengths["velocity"]))

    def followed_by(self, more: JointLimits) -> JointLimits:
        """Limits of these n joints, followed by those of `more` joints."""
        if not len(more.velocity):
            return self
        return JointLimits(
            *(np.concatenate([getattr(self, key), getattr(more, key)]) for key in KEYS)
        )

    def updated(self, changes: Mapping[str, Any], joint_names: Sequence[str]) -> JointLimits:
        """Copy of these limits in which some are replaced.

        Args:
            changes: Mapping from names of limits (the attributes of this class) to a scalar for all
                joints, an array of shape (n,), or a mapping from joint names to numbers. Joints
                that such a mapping does not name keep their limits.
            joint_names: Names of the n joints.

        Raises:
            MachineError: Unknown limit or joint (the message lists the known ones), not a number,
                not positive and finite, or lower above upper.
        """
        if not isinstance(changes, Mapping):
            raise MachineError(
                f"limits must be a mapping such as {{'velocity': 0.4}}, not {changes!r}"
            )
        if len(joint_names) != len(self.velocity):
            raise MachineError(
                f"limits of {len(self.velocity)} joints cannot be updated by names of "
                f"{len(joint_names)}"
            )
        values = {key: np.array(getattr(self, key)) for key in KEYS}
        for key, change in changes.items():
            if key not in values:
                raise MachineError(
                    f"unknown limit {key!r}; limits are {', '.join(KEYS)}"
                    f"{_hint_on_order(key, joint_names)}"
                )
            columns, numbers = _spread(key, change, joint_names)
            if np.isnan(numbers).any():
                name = joint_names[columns[np.flatnonzero(np.isnan(numbers)).tolist()[0]]]
                raise MachineError(
                    f"{_spell(key)} limit of joint {name!r} must be a number, not nan"
                )
            values[key][columns] = numbers
        _check(values, joint_names)
        return JointLimits(**values)

    def missing(self, joint_names: Sequence[str]) -> dict[str, tuple[str, ...]]:
        """Limits that planning needs but that are not given.

        Args:
            joint_names: Names of the n joints.

        Returns:
            Mapping from names of limits ('position_lower', 'position_upper', 'velocity',
            'acceleration') to the names of the joints that lack this limit; empty if none is
            missing.
        """
        lacking = {key: np.flatnonzero(np.isnan(getattr(self, key))).tolist() for key in NEEDED}
        return {
            key: tuple(joint_names[i] for i in where) for key, where in lacking.items() if where
        }


def position_fault(joint: str, value: float, *, lower: float, upper: float, unit: str) -> str:
    """Words about a coordinate outside its limits, to follow "start" or "goal"; empty if inside.

    Args:
        joint: Name of the joint.
        value: Coordinate of the joint [rad or m].
        lower, upper: Position limits; a limit that is NaN is not given and does not count.
        unit: Unit of the coordinate.
    """
    if not (value < lower - LIMIT_TOLERANCE or value > upper + LIMIT_TOLERANCE):
        return ""
    shown, least, most = distinct_texts(value, lower, upper)
    words = f"of joint {joint!r} is {shown}, outside its limits [{least}, {most}] {unit}"
    if unit != "rad":
        return words
    radians = np.radians(value)
    if abs(value) > FULL_TURN and lower <= radians <= upper:
        return f"{words}; if it is meant in degrees, it is {radians:.4g} rad"
    if abs(value) > MOST_IN_DEGREES:
        return words
    degrees = distinct_texts(*(float(np.degrees(angle)) for angle in (value, lower, upper)))
    return f"{words}; in degrees: {degrees[0]}, outside [{degrees[1]}, {degrees[2]}]"


def ignored_limits(joints: Sequence[str]) -> str:
    """Sentence about limits for joints that are not planned."""
    one = len(joints) == 1
    return (
        f"limits of joint{'' if one else 's'} {', '.join(map(repr, joints))} are ignored: "
        f"{'the joint is' if one else 'these joints are'} not planned"
    )


def without_unplanned(changes: Any, unplanned: Collection[str]) -> Any:
    """Changes as `JointLimits.updated` takes them, without joints that are not planned.

    What is left out is said in a `MachineWarning`. Anything but a mapping is returned as it is.

    Args:
        changes: Mapping from names of limits to a number, an array, or a mapping from joints.
        unplanned: Names of the joints that are held or fixed.
    """
    if not isinstance(changes, Mapping):
        return changes
    found: dict[Any, Any] = {}
    idle: dict[str, None] = {}
    for key, change in changes.items():
        found[key] = change
        if isinstance(change, Mapping):
            found[key] = {name: limit for name, limit in change.items() if name not in unplanned}
            idle |= dict.fromkeys(name for name in change if name in unplanned)
    if idle:
        warn_of_machine(ignored_limits(list(idle)))
    return found


def _hint_on_order(key: str, joint_names: Sequence[str]) -> str:
    """Hint for users who wrote {joint: {limit: ...}}; empty if `key` is not the name of a joint."""
    if key not in joint_names:
        return ""
    return f"; {key!r} is a joint: the limit comes first, as in {{'velocity': {{{key!r}: 0.8}}}}"


def _spread(key: str, change: Any, joint_names: Sequence[str]) -> tuple[list[int], Array]:
    """Indices of the joints that a change concerns, and the new limit of each of them."""
    everyone = list(range(len(joint_names)))
    if isinstance(change, Mapping):
        for name in change:
            if name not in joint_names:
                raise MachineError(
                    f"{_spell(key)} limit of unknown joint {name!r}; joints are "
                    f"{', '.join(joint_names)}"
                )
        numbers = [_number(key, name, value) for name, value in change.items()]
        return [list(joint_names).index(name) for name in change], np.array(
            numbers, dtype=np.float64
        )
    if np.asarray(change, dtype=object).ndim == 0:
        return everyone, np.full(len(everyone), _number(key, None, change))
    return everyone, frozen_array(
        change,
        name=f"{_spell(key)} limits",
        shape=(len(everyone),),
        error=MachineError,
        finite=False,
    )


def _number(key: str, joint: str | None, value: Any) -> float:
    name = f"{_spell(key)} limit" + ("" if joint is None else f" of joint {joint!r}")
    if isinstance(value, bool | np.bool_):
        raise MachineError(f"{name} must be a number, not {value!r}")
    if key in POSITIONS and isinstance(value, float | np.floating) and np.isinf(value):
        return float(value)  # a joint without position limit
    return finite_number(value, name=name, error=MachineError)


def _check(values: Mapping[str, Array], joints: Sequence[str] | range) -> None:
    """Raise MachineError for limits that no joint can have.

    NaN (not given) passes, because every comparison with NaN is false.
    """
    for key in RATES:
        for i in np.flatnonzero((values[key] <= 0.0) | np.isinf(values[key])).tolist():
            advice = f": {HOLD.arguments}" if values[key][i] == 0.0 else ""
            raise MachineError(
                f"{_spell(key)} limit of joint {joints[i]!r} must be positive and finite, "
                f"not {values[key][i]}{advice}"
            )
    lower, upper = values["position_lower"], values["position_upper"]
    for i in np.flatnonzero((lower > upper) | (lower == np.inf) | (upper == -np.inf)).tolist():
        raise MachineError(
            f"joint {joints[i]!r}: no position lies between its lower limit, {lower[i]}, and its "
            f"upper limit, {upper[i]}"
        )


def _spell(key: str) -> str:
    return {"position_lower": "lower position", "position_upper": "upper position"}.get(key, key)
