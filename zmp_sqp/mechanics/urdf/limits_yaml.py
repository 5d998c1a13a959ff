"""Reads joint limits from a joint_limits.yaml file in the format of MoveIt."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from zmp_sqp.arrays import finite_number
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.limits import JointLimits

__all__ = ["read_joint_limits"]

# (switch, {key in the file: attribute of JointLimits}); as in MoveIt, a value counts only if its
# switch is true
SWITCHES = (
    ("has_position_limits", {"min_position": "position_lower", "max_position": "position_upper"}),
    ("has_velocity_limits", {"max_velocity": "velocity"}),
    ("has_acceleration_limits", {"max_acceleration": "acceleration"}),
    ("has_effort_limits", {"max_effort": "effort"}),
)
# {key of a factor in the file: attribute of JointLimits that it scales}
SCALINGS = {
    "default_velocity_scaling_factor": "velocity",
    "default_acceleration_scaling_factor": "acceleration",
}
# valid keys of MoveIt that have no counterpart in JointLimits
IGNORED = {
    *(
        "has_jerk_limits",
        "max_jerk",
        "has_deceleration_limits",
        "max_deceleration",
        "angle_wraparound",
    ),
    *("has_soft_limits", "k_position", "k_velocity", "soft_lower_limit", "soft_upper_limit"),
}
JOINT_KEYS = IGNORED | {key for switch, values in SWITCHES for key in (switch, *values)}


def read_joint_limits(path: Path, limits: JointLimits, joint_names: Sequence[str]) -> JointLimits:
    """Joint limits in which the values of a MoveIt joint_limits.yaml replace given ones.

    A value in the file counts only if its `has_..._limits` is true; all other limits stay as given.
    As in MoveIt, `default_velocity_scaling_factor` and `default_acceleration_scaling_factor` scale
    the limits of all joints, including those that come from the URDF. Jerk, deceleration and soft
    limits are ignored.

    Args:
        path: File to read.
        limits: Limits that hold where the file has none.
        joint_names: Names of the n joints.

    Raises:
        MachineError: The file is not readable, not YAML, or has wrong types, unknown keys or
            joints, or impossible limits; the message names the file and the key.
    """
    content = _load(path)
    for key in content:
        if key not in ("joint_limits", "cartesian_limits", *SCALINGS):
            raise MachineError(
                f"{path}: unknown key {key!r}; expected joint_limits or {', '.join(SCALINGS)}"
            )
    changes: dict[str, dict[str, float]] = {}
    for joint, entries in _mapping(content.get("joint_limits"), f"{path}: joint_limits").items():
        where = f"{path}: joint_limits.{joint}"
        if joint not in joint_names:
            raise MachineError(
                f"{where}: unknown joint {joint!r}; joints are {', '.join(joint_names)}"
            )
        for limit, value in _joint(_mapping(entries, where), where).items():
            changes.setdefault(limit, {})[joint] = value
    try:
        merged = limits.updated(changes, joint_names)
    except MachineError as fault:
        raise MachineError(f"{path}: joint_limits: {fault}") from None
    scaled = {}
    for key, limit in SCALINGS.items():
        factor = _number(content.get(key, 1.0), f"{path}: {key}")
        if not 0.0 < factor <= 1.0:
            raise MachineError(f"{path}: {key} must be above 0 and at most 1, not {factor}")
        known = {
            joint: value
            for joint, value in zip(joint_names, getattr(merged, limit), strict=True)
            if value == value
        }
        scaled[limit] = {joint: factor * value for joint, value in known.items()}
    return merged.updated(scaled, joint_names)


def _load(path: Path) -> dict[Any, Any]:
    """Top-level mapping of a YAML file."""
    import yaml  # imported here, because most callers have no such file

    try:
        content = yaml.safe_load(path.read_bytes())
    except OSError as cause:
        raise MachineError(f"cannot read joint limits {path}: {cause.strerror or cause}") from None
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError, ValueError) as cause:
        raise MachineError(f"{path} is not YAML: {' '.join(str(cause).split())}") from None
    return _mapping(content, str(path))


def _joint(entries: dict[Any, Any], where: str) -> dict[str, float]:
    """Limits of one joint, by attribute of JointLimits."""
    for key in entries:
        if key not in JOINT_KEYS:
            raise MachineError(f"{where}: unknown key {key!r}")
    found = {}
    for switch, values in SWITCHES:
        on = entries.get(switch, False)
        if not isinstance(on, bool):
            raise MachineError(f"{where}.{switch} must be true or false, not {on!r}")
        for key, limit in values.items():
            if on and key not in entries:
                raise MachineError(f"{where}.{switch} is true, but {key} is missing")
            if on:
                found[limit] = _number(entries[key], f"{where}.{key}")
    return found


def _mapping(value: Any, where: str) -> dict[Any, Any]:
    """Check that a YAML value is a mapping; an empty value is an empty mapping."""
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise MachineError(f"{where} must be a mapping, not {value!r}")
    return value


def _number(value: Any, where: str) -> float:
    """Check that a YAML value is a finite number."""
    if isinstance(value, str):
        raise MachineError(
            f"{where} must be a number, not the text {value!r} "
            "(YAML reads 1e-3 as text: write 1.0e-3)"
        )
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise MachineError(f"{where} must be a number, not {value!r}")
    return finite_number(value, name=where, error=MachineError)
