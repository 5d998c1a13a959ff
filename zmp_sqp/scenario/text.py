"""Scenario files as text: values, tables and lists of joints in TOML."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from zmp_sqp.mechanics import Machine
from zmp_sqp.scenario.scene import DEGREES

__all__ = ["joint_lines", "one_line", "scenario_text", "table_lines", "toml_value"]

# in the order in which they are written
TABLES = ("machine", "ground", "motion", "base", "constraints", "plan")


def scenario_text(content: Mapping[str, Any], machine: Machine, heading: str) -> str:
    """Scenario file (TOML) with given content.

    Numbers are written so that they are read back with the same bits.

    Args:
        content: Tables of the file.
        machine: Gives the names and units of the joints, for comments.
        heading: Comment at the top, without the leading number signs.
    """
    lines = [f"# {line}".rstrip() for line in heading.splitlines()]
    if "title" in content:
        lines += ["", f"title = {toml_value(content['title'])}"]
    for name in TABLES:
        if name == "motion":
            lines += ["", "[motion]", *_motion_lines(content[name], machine)]
        elif name == "constraints":
            for table in content.get(name, ()):
                lines += ["", "[[constraints]]", *_entries(table)]
        elif name in content:
            lines += ["", *table_lines(name, content[name])]
    return "\n".join([*lines, ""])


def table_lines(name: str, table: Mapping[str, Any]) -> list[str]:
    """A table of a scenario; tables in it come last, as TOML wants."""
    inner = {key: value for key, value in table.items() if isinstance(value, Mapping)}
    lines = [f"[{name}]"]
    lines += _entries({key: value for key, value in table.items() if key not in inner})
    for key, content in inner.items():
        lines += ["", f"[{name}.{_key(key)}]", *_entries(content)]
    return lines


def joint_lines(
    key: str, values: Sequence[float], machine: Machine, what: str, *, degrees: bool = False
) -> list[str]:
    """One number per joint, with the name and unit of the joint beside each.

    Args:
        key: Key of the list.
        values: Numbers, one per joint.
        machine: Gives the joints.
        what: Comment beside the key; empty for none.
        degrees: Whether angles are in degrees.
    """
    numbers = [f"{toml_value(float(value))}," for value in values]
    width = max(map(len, numbers))
    units = ["deg" if degrees and unit == "rad" else unit for unit in machine.joint_units]
    joints = zip(numbers, machine.joint_names, units, strict=True)
    return [
        f"{key} = [  # {what}" if what else f"{key} = [",
        *(f"    {text.ljust(width)}  # {one_line(name)} [{unit}]" for text, name, unit in joints),
        "]",
    ]


def toml_value(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float | np.floating):
        return repr(float(value) + 0.0)
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{_key(k)} = {toml_value(v)}' for k, v in value.items())} }}"
    return f"[{', '.join(toml_value(entry) for entry in value)}]"


def one_line(text: str) -> str:
    """Text with all white space as single spaces, so that it fits a comment."""
    return " ".join(text.split())


def _entries(table: Mapping[str, Any]) -> list[str]:
    return [f"{_key(key)} = {toml_value(value)}" for key, value in table.items()]


def _motion_lines(table: Mapping[str, Any], machine: Machine) -> Iterator[str]:
    """The keys of [motion]; lists with one number per joint say which is which."""
    for key, value in table.items():
        if isinstance(value, list) and len(value) == machine.size:
            rate = "velocity" in key
            degrees = key.endswith(DEGREES)
            yield from joint_lines(
                key, value, machine, "per second" if rate else "", degrees=degrees
            )
        else:
            yield f"{_key(key)} = {toml_value(value)}"


def _key(key: str) -> str:
    """Key as TOML writes it: bare where it may be."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else toml_value(key)
