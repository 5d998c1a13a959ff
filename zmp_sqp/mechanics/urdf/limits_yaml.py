"""Reads and drafts joint_limits.yaml files in the format of MoveIt."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import finite_number
from zmp_sqp.errors import MachineError, warn_of_machine
from zmp_sqp.mechanics.limits import JointLimits, ignored_limits
from zmp_sqp.mechanics.machine import Machine

__all__ = ["read_joint_limits", "template"]

# (switch, {key in the file: attribute of JointLimits}); as in MoveIt, a value counts only if its
# switch is true
SWITCHES = (
    ("has_position_limits", {"min_position": "position_lower", "max_position": "position_upper"}),
    ("has_velocity_limits", {"max_velocity": "velocity"}),
    ("has_acceleration_limits", {"max_acceleration": "acceleration"}),
    ("has_effort_limits", {"max_effort": "effort"}),
)
YAML_WORDS = {"y", "n", "yes", "no", "on", "off", "true", "false", "null"}  # not texts in YAML 1.1
# {key of a factor in the file: attribute of JointLimits that it scales}
SCALINGS = {
    "default_velocity_scaling_factor": "velocity",
    "default_acceleration_scaling_factor": "acceleration",
}
# valid keys of MoveIt that have no counterpart in JointLimits
JERK = ("has_jerk_limits", "max_jerk")
IGNORED = {
    *JERK,
    *(
        "has_deceleration_limits",
        "max_deceleration",
        "angle_wraparound",
    ),
    *("has_soft_limits", "k_position", "k_velocity", "soft_lower_limit", "soft_upper_limit"),
}
JOINT_KEYS = IGNORED | {key for switch, values in SWITCHES for key in (switch, *values)}


def read_joint_limits(
    path: Path,
    limits: JointLimits,
    joint_names: Sequence[str],
    unplanned: Collection[str] = (),
) -> JointLimits:
    """Joint limits in which the values of a MoveIt joint_limits.yaml replace given ones.

    A value in the file counts only if its `has_..._limits` is true; all other limits stay as given.
    As in MoveIt, `default_velocity_scaling_factor` and `default_acceleration_scaling_factor` scale
    the limits of all joints, including those that come from the URDF. Deceleration and soft limits
    are ignored. Jerk limits and limits of joints that are not planned are ignored with a
    `MachineWarning`.

    Args:
        path: File to read.
        limits: Limits that hold where the file has none.
        joint_names: Names of the n joints.
        unplanned: Names of the machine's other joints, which are held or fixed.

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
    changes, idle, jerky, off = _entries(content, path, joint_names, unplanned)
    if idle:
        warn_of_machine(f"{path}: {ignored_limits(idle)}")
    if jerky:
        warn_of_machine(
            f"{path}: jerk limits are not planned with yet, and those of joint "
            f"{', '.join(map(repr, jerky))} are ignored"
        )
    try:
        merged = limits.updated(changes, joint_names)
    except MachineError as fault:
        raise MachineError(f"{path}: joint_limits: {fault}") from None
    if missed := _missed(off, merged, joint_names):
        warn_of_machine(f"{path}: values count only if their switch is true: {', '.join(missed)}")
    return _scaled(merged, content, joint_names, path)


def _entries(
    content: dict[Any, Any], path: Path, joint_names: Sequence[str], unplanned: Collection[str]
) -> tuple[dict[str, dict[str, float]], list[str], list[str], list[tuple[str, str, str, str]]]:
    """What a file says of the joints.

    Returns:
        Limits of planned joints, by limit and joint; joints that are not planned; joints with jerk
        limits; joint, switch, key and limit of each value that does not count.
    """
    changes: dict[str, dict[str, float]] = {}
    idle, jerky, off = [], [], []
    for joint, entries in _mapping(content.get("joint_limits"), f"{path}: joint_limits").items():
        where = f"{path}: joint_limits.{joint}"
        if joint in unplanned:
            idle.append(joint)
            continue
        if joint not in joint_names:
            raise MachineError(
                f"{where}: unknown joint {joint!r}; joints are {', '.join(joint_names)}"
            )
        entries = _mapping(entries, where)
        for limit, value in _joint(entries, where).items():
            changes.setdefault(limit, {})[joint] = value
        if entries.get("has_jerk_limits", "max_jerk" in entries):
            jerky.append(joint)
        off += [(joint, *idle_value) for idle_value in _without_switch(entries)]
    return changes, idle, jerky, off


def _scaled(
    limits: JointLimits, content: dict[Any, Any], joint_names: Sequence[str], path: Path
) -> JointLimits:
    """Limits times the factors that a file gives for all joints."""
    scaled = {}
    for key, limit in SCALINGS.items():
        factor = _number(content.get(key, 1.0), f"{path}: {key}")
        if not 0.0 < factor <= 1.0:
            raise MachineError(f"{path}: {key} must be above 0 and at most 1, not {factor}")
        known = {
            joint: value
            for joint, value in zip(joint_names, getattr(limits, limit), strict=True)
            if value == value
        }
        scaled[limit] = {joint: factor * value for joint, value in known.items()}
    return limits.updated(scaled, joint_names)


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


def _without_switch(entries: dict[Any, Any]) -> Iterator[tuple[str, str, str]]:
    """Switch, key and attribute of JointLimits of each value that does not count, but for zeros."""
    for switch, values in SWITCHES:
        if not entries.get(switch, False):
            yield from ((switch, key, limit) for key, limit in values.items() if entries.get(key))


def _missed(
    off: Sequence[tuple[str, str, str, str]], limits: JointLimits, joint_names: Sequence[str]
) -> list[str]:
    """Values that do not count, in words, where the limit is given nowhere else.

    Args:
        off: Joint, switch, key and attribute of JointLimits of each value that does not count.
        limits: Limits without these values.
        joint_names: Names of the n joints.
    """
    return [
        f"{key} of joint {joint!r} ({switch})"
        for joint, switch, key, limit in off
        if np.isnan(getattr(limits, limit)[joint_names.index(joint)])
    ]


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


def template(machine: Machine) -> str:
    """Text of a joint_limits.yaml for a machine: known limits filled in, missing ones marked.

    Saved beside the URDF and read again, it changes no limit until it is edited.

    Args:
        machine: Machine whose planned joints the file is about.
    """
    head = f"""\
# Limits of the planned joints of {json.dumps(machine.name)}, in MoveIt's format. It is read by
# itself beside the URDF, as joint_limits.yaml or <name of the URDF>.joint_limits.yaml.
# Joints that turn: rad, rad/s, rad/s^2, N m. Joints that slide: m, m/s, m/s^2, N.
# A value counts only where its switch (has_..._limits) is true. Values that planning lacks are
# marked with MISSING: fill them in, and set their switches to true.
joint_limits:
"""
    return head + "".join(f"{line}\n" for line in _drafted(machine))


def _drafted(machine: Machine) -> Iterator[str]:
    """Lines of the joints in a drafted file."""
    for i, joint in enumerate(machine.joint_names):
        plain = re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", joint) and joint.lower() not in YAML_WORDS
        unit = machine.joint_units[i]
        motion = "slides" if unit == "m" else "turns"
        yield f"  {joint if plain else json.dumps(joint)}:  # {motion}"
        for switch, values in SWITCHES:
            known = {key: float(getattr(machine.limits, limit)[i]) for key, limit in values.items()}
            given = all(np.isfinite(value) for value in known.values())
            if not given and all(np.isinf(value) for value in known.values()):
                yield "    has_position_limits: false  # turns without end"
                continue
            yield f"    {switch}: {'true' if given else 'false'}"
            for key, value in known.items():
                yield f"    {key}: {_yaml_number(value)}" if given else _gap(key, unit)


def _gap(key: str, unit: str) -> str:
    """Line of a drafted file for a value that is not known."""
    force = "N" if unit == "m" else "N m"
    units = {"max_velocity": f"{unit}/s", "max_acceleration": f"{unit}/s^2", "max_effort": force}
    need = "only for limits on torques" if key == "max_effort" else "MISSING"
    return f"    {key}:  # {need} [{units.get(key, unit)}]"


def _yaml_number(value: float) -> str:
    """Number as YAML 1.1 reads it: with a point before the exponent."""
    mantissa, e, exponent = repr(value).partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}{e}{exponent}"
