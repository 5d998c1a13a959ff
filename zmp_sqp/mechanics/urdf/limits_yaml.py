"""Reads joint limits from a joint_limits.yaml as MoveIt writes it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from zmp_sqp.arrays import finite_number
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.limits import JointLimits

__all__ = ["read_joint_limits"]

# (switch, {its value in the file: our limit}); a value counts only where its switch is true, as in
# MoveIt
SWITCHES = (
    ("has_position_limits", {"min_position": "position_lower", "max_position": "position_upper"}),
    ("has_velocity_limits", {"max_velocity": "velocity"}),
    ("has_acceleration_limits", {"max_acceleration": "acceleration"}),
    ("has_effort_limits", {"max_effort": "effort"}),
)
SCALINGS = {
    "default_velocity_scaling_factor": "velocity",
    "default_acceleration_scaling_factor": "acceleration",
}
# MoveIt knows these too; nothing of ours follows from them
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
    """Limits with those of a MoveIt joint_limits.yaml put over them.

    A value in the file holds only where its `has_..._limits` is true; what the file is silent
    about, or switches off, keeps what it has. `default_velocity_scaling_factor` and
    `default_acceleration_scaling_factor` scale, as they do in MoveIt's planning, the limits of all
    joints, those that come from the URDF included. Jerk, deceleration and soft limits are not used.

    Args:
        path: The file.
        limits: What holds where the file is silent.
        joint_names: Names of the n joints.

    Raises:
        MachineError: Not readable, not YAML, wrong types, unknown keys or joints, impossible
            limits; the message names the file and the key.
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
    import yaml  # only here: most callers have no such file

    try:
        content = yaml.safe_load(path.read_bytes())
    except OSError as cause:
        raise MachineError(f"cannot read joint limits {path}: {cause.strerror or cause}") from None
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError, ValueError) as cause:
        raise MachineError(f"{path} is not YAML: {' '.join(str(cause).split())}") from None
    return _mapping(content, str(path))


def _joint(entries: dict[Any, Any], where: str) -> dict[str, float]:
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
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise MachineError(f"{where} must be a mapping, not {value!r}")
    return value


def _number(value: Any, where: str) -> float:
    if isinstance(value, str):
        raise MachineError(
            f"{where} must be a number, not the text {value!r} (YAML reads 1e-3 as text: write 1.0e-3)"
        )
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise MachineError(f"{where} must be a number, not {value!r}")
    return finite_number(value, name=where, error=MachineError)
