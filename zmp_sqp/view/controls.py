"""What can be set on the page: sliders with their ranges, and what they stand for in a scenario.

A control shows degrees where the scenario has radians. Its key is that of the requests: a group
and, for joints, the joint's name, as in `goal.boom`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from math import ceil, floor, isfinite, log10
from typing import Any

import numpy as np

from zmp_sqp.arrays import shortened
from zmp_sqp.errors import ScenarioError
from zmp_sqp.mechanics import Heightmap, Machine
from zmp_sqp.mechanics.ground import Ground

__all__ = ["DIGITS", "Control", "checked_values", "controls_of"]

STEPS = {"rad": 0.5, "m": 0.01}  # [deg, m] of a slider of a joint
TURN, WAY = 360.0, 2.0  # [deg, m] to either side of zero for joints without limits
STEEP = 30.0  # [deg] of roll and pitch to either side
FAR = 10.0  # [m] beyond start and goal of a base
NOTCHES = 200  # steps of a slider of mass or margin, about
MOST_MASS = 2.5  # times the payload of the scenario
MOST_SHARE = 0.3  # of the machine's mass, for a machine without payload
FACTORS = (10.0, 200.0)  # [%] of limits
MISSING = (0.0, 10.0)  # [rad/s, m/s and per second] in place of limits that are missing; 0 is none
DIGITS = 9  # decimals of what is shown
SLACK = 1e-9  # relative: rounding of ranges


@dataclass(frozen=True, slots=True)
class Control:
    """A number that can be set.

    Attributes:
        key: Name in requests.
        group: Where it is shown: goal, ground, load, limits, missing (limits), base, start or pose.
        label: What it is, for people.
        unit: Unit of all numbers here.
        low, high: Range.
        step: Step of the slider.
        value: Value at the beginning.
    """

    key: str
    group: str
    label: str
    unit: str
    low: float
    high: float
    step: float
    value: float

    def fields(self) -> dict[str, Any]:
        """The control, ready for JSON."""
        return asdict(self)


def controls_of(
    content: Mapping[str, Any],
    machine: Machine,
    ground: Ground,
    poses: Mapping[str, Any],
    tip: str,
) -> tuple[Control, ...]:
    """Controls of a scenario.

    Args:
        content: Tables of the scenario; start and goal are lists.
        machine: Its machine.
        ground: Its ground.
        poses: Joint coordinates (n,) [rad or m] of the groups goal, start and pose.
        tip: Frame that carries a payload if the scenario has none.
    """
    return tuple(
        [
            *_joints("goal", poses["goal"], machine),
            *_ground(content, ground),
            *_load(content, machine, tip),
            *_limits(content, machine),
            *_base(content, ground),
            *_joints("start", poses["start"], machine),
            *_joints("pose", poses["pose"], machine),
        ]
    )


def checked_values(given: object, controls: Mapping[str, Control]) -> dict[str, float]:
    """Values of a request, all of them numbers within the range of a control.

    Args:
        given: Table from keys of controls to numbers.
        controls: Controls by key.

    Raises:
        ScenarioError: It is no table, a key is unknown, or a value is no number in range.
    """
    if not isinstance(given, dict):
        raise ScenarioError(f"values must be a table from controls to numbers, not {_brief(given)}")
    found: dict[str, float] = {}
    for key, value in given.items():
        control = controls.get(key)
        if control is None:
            known = ", ".join(controls)
            raise ScenarioError(f"there is no control {_brief(key)}; controls are {known}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ScenarioError(f"{key} must be a number, not {_brief(value)}")
        slack = SLACK * max(abs(control.low), abs(control.high))
        # compared before it is converted: whole numbers in JSON may be larger than any float
        if not (control.low - slack <= value <= control.high + slack):
            raise ScenarioError(
                f"{key} must lie within {control.low:g} to {control.high:g} {control.unit}, "
                f"not {_brief(value)}"
            )
        found[key] = float(value)
    return found


def _brief(value: object) -> str:
    """A value in a message; numbers with hundreds of digits are not spelt out."""
    return "a huge number" if isinstance(value, int) and abs(value) > 1e18 else shortened(value)


def _joints(group: str, pose: Any, machine: Machine) -> Iterator[Control]:
    """One control per joint, in the range of its limits."""
    limits = machine.limits
    for i, (name, unit) in enumerate(zip(machine.joint_names, machine.joint_units, strict=True)):
        turns = unit == "rad"
        value, low, high = (
            float(np.rad2deg(entry) if turns else entry)
            for entry in (pose[i], limits.position_lower[i], limits.position_upper[i])
        )
        wide = TURN if turns else WAY
        low = low if isfinite(low) else -wide
        high = high if isfinite(high) else wide
        yield _control(
            f"{group}.{name}", group, name, "deg" if turns else "m", (low, high), STEPS[unit], value
        )


def _ground(content: Mapping[str, Any], ground: Ground) -> Iterator[Control]:
    if isinstance(ground, Heightmap):
        return
    table = content.get("ground", {})
    for name in ("roll", "pitch"):
        value = float(table.get(f"{name}_deg", 0.0))
        yield _control(f"ground.{name}", "ground", name, "deg", (-STEEP, STEEP), 0.5, value)


def _load(content: Mapping[str, Any], machine: Machine, tip: str) -> Iterator[Control]:
    payload = content["machine"].get("payload")
    if payload is None:
        label, mass, most = f"payload at {tip}", 0.0, MOST_SHARE * machine.mass
    else:
        mass = float(payload["mass"])
        label, most = f"payload at {payload['frame']}", MOST_MASS * mass
    step = _notch(most)
    yield _control("payload", "load", label, "kg", (0.0, ceil(most / step) * step), step, mass)
    if machine.support is not None:
        corners = machine.support.vertices
        step = _notch(0.5 * float(np.ptp(corners, axis=0).min()))
        most = floor(0.5 * float(np.ptp(corners, axis=0).min()) / step) * step
        asked = float(content.get("plan", {}).get("margin", 0.0))
        yield _control("margin", "load", "margin asked for", "m", (0.0, most), step, asked)


def _limits(content: Mapping[str, Any], machine: Machine) -> Iterator[Control]:
    for key, label in (("velocity", "rates"), ("acceleration", "accelerations")):
        if not np.isnan(getattr(machine.limits, key)).any():
            yield _control(f"limits.{key}", "limits", label, "%", FACTORS, 1.0, 100.0)
        else:
            unit = {"velocity": "rad/s, m/s", "acceleration": "rad/s\u00b2, m/s\u00b2"}[key]
            yield _control(f"missing.{key}", "missing", label, unit, MISSING, 0.05, 0.0)
    for table in content.get("constraints", ()):
        if table.get("type") == "torque_limits":
            share = 100.0 * float(table.get("share", 1.0))
            yield _control("limits.effort", "limits", "torques", "%", FACTORS, 1.0, share)


def _base(content: Mapping[str, Any], ground: Ground) -> Iterator[Control]:
    if "base" not in content:
        return
    start, goal = content["base"]["start"], content["base"]["goal"]
    for i, axis in enumerate(("x", "y")):
        ends = float(start[i]), float(goal[i])
        low, high = floor(min(ends) - FAR), ceil(max(ends) + FAR)
        if isinstance(ground, Heightmap):
            low, high = max(low, ground.extent[0, i]), min(high, ground.extent[1, i])
        yield _control(f"base.{axis}", "base", axis, "m", (low, high), 0.05, ends[1])
    yaw = float(np.rad2deg(goal[2]))
    yield _control("base.yaw", "base", "yaw", "deg", (-180.0, 180.0), 1.0, yaw)


def _control(
    key: str,
    group: str,
    label: str,
    unit: str,
    span: tuple[float, float],
    step: float,
    value: float,
) -> Control:
    """Control whose range holds its value."""
    value = round(value, DIGITS)
    low, high = (round(float(end), DIGITS) for end in span)
    return Control(key, group, label, unit, min(low, value), max(high, value), step, value)


def _notch(span: float) -> float:
    """Step of 1, 2 or 5 times a power of ten that divides a range into `NOTCHES`, about."""
    raw = max(span, 1e-6) / NOTCHES
    power = 10.0 ** floor(log10(raw))
    return float(min((1.0, 2.0, 5.0, 10.0), key=lambda share: abs(share * power - raw)) * power)
