"""Variations of a scenario: the same file with other numbers under some keys."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

from zmp_sqp.errors import ScenarioError
from zmp_sqp.scenario.scene import DEGREES
from zmp_sqp.scenario.schema import SCHEMA, check_table

__all__ = ["check_key", "varied"]

# table.key, table.table.key, or table.key[2]
KEY = re.compile(r"(?P<path>[a-z_]+(\.[a-z_]+)+)(\[(?P<entry>\w+)\])?")
ADVICE = (
    "write a key as in ground.roll_deg, machine.payload.mass or plan.margin, and an entry of a "
    "list as in motion.goal_deg[1] or motion.goal_deg[boom]"
)


def check_key(content: Mapping[str, Any], key: str, joints: Sequence[str]) -> None:
    """Refuse a key that cannot be varied.

    Args:
        content: Tables of a scenario file.
        key: Dotted key, such as `ground.roll_deg` or `motion.goal_deg[boom]`.
        joints: Names of the machine's joints.

    Raises:
        ScenarioError: The key is misspelt or unknown, takes no number, or names an entry that a
            list does not have.
    """
    check_table(varied(content, {key: 0.0}, joints), SCHEMA)


def varied(
    content: Mapping[str, Any], values: Mapping[str, float], joints: Sequence[str]
) -> dict[str, Any]:
    """Tables of a scenario file with numbers replaced or added.

    Args:
        content: Tables of the file, which stay as they are.
        values: Numbers by dotted key; an entry of a list has its index, or the name of its joint,
            in brackets.
        joints: Names of the machine's joints.

    Raises:
        ScenarioError: A key is misspelt, or names an entry that a list does not have.
    """
    tables = deepcopy(dict(content))
    for key, value in values.items():
        match = KEY.fullmatch(key)
        if match is None:
            raise ScenarioError(f"{key!r} is no key of a scenario file: {ADVICE}")
        *folders, name = match["path"].split(".")
        table: Any = tables
        for folder in folders:
            table = table.setdefault(folder, {})
            if not isinstance(table, dict):
                raise ScenarioError(f"{key!r}: {folder} is no table; {ADVICE}")
        if match["entry"] is None:
            table[name] = value
        else:
            _set_entry(table, name, match["entry"], value, key, joints)
    return tables


def _set_entry(
    table: dict[str, Any], name: str, entry: str, value: float, key: str, joints: Sequence[str]
) -> None:
    """Replace one entry of a list, or of a mapping from joints to numbers."""
    found = table.get(name)
    if isinstance(found, dict) and entry in found:
        found[entry] = value
        return
    if not isinstance(found, list):
        other = name.removesuffix(DEGREES) if name.endswith(DEGREES) else f"{name}{DEGREES}"
        there = f", but {other}" if other in table else ""
        raise ScenarioError(f"{key!r}: the scenario has no list {name}{there}; {ADVICE}")
    if entry not in joints and not entry.isdigit():
        raise ScenarioError(f"{key!r}: there is no joint {entry!r}; joints are {', '.join(joints)}")
    index = list(joints).index(entry) if entry in joints else int(entry)
    if index >= len(found):
        raise ScenarioError(f"{key!r}: {name} has {len(found)} entries, from 0 on")
    found[index] = value
