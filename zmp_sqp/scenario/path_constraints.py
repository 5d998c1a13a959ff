"""Path constraints of a scenario, built from its [[constraints]] tables.

The tables name the classes that `zmp_sqp.planning.constraints.registry` knows. Keys of a table are
the fields of the class, so that a constraint needs no code here.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields
from typing import Any, get_type_hints

from zmp_sqp.errors import ScenarioError, ZmpSqpError
from zmp_sqp.planning.constraints.binding import checked_constraints
from zmp_sqp.planning.constraints.protocol import PathConstraint
from zmp_sqp.planning.constraints.registry import kinds
from zmp_sqp.scenario.schema import (
    FLAG,
    INTEGER,
    NUMBER,
    TEXT,
    Table,
    Value,
    check_table,
    did_you_mean,
)

__all__ = ["CONSTRAINTS", "build_constraints", "constraint_table", "kinds_in_words"]

CONSTRAINTS = "[constraints]"  # with the brackets that messages put around it: [[constraints]]
# what a key may hold, by the type of the field of that name; fields of other types take any value,
# and the class checks it
BY_TYPE = {float: NUMBER, int: INTEGER, str: TEXT, bool: FLAG}
ANYTHING = Value("a value of TOML", lambda value: True)


def build_constraints(tables: Sequence[Mapping[str, Any]]) -> tuple[PathConstraint, ...]:
    """Path constraints of the tables, in their order.

    Args:
        tables: Each with the key `type`, the name of a constraint, and the fields of its class.

    Raises:
        ScenarioError: A type is unknown, a key is unknown, missing or of the wrong type, or the
            class refuses a value.
        ProblemError: Two constraints have one name.
    """
    return checked_constraints([_constraint(table) for table in tables])


def constraint_table(text: str) -> dict[str, Any]:
    """The table that an option such as `--constraint torque_limits:share=0.8` stands for.

    Args:
        text: NAME, or NAME:key=value,key=value with the values as in TOML.

    Raises:
        ScenarioError: What follows the name is no list of keys and values.
    """
    name, _, keys = text.partition(":")
    try:
        found = tomllib.loads(f"keys = {{{keys}}}")
        if set(found) != {"keys"}:
            raise ValueError("more than one line")
    except ValueError as cause:
        raise ScenarioError(
            f"{text!r}: give a constraint as NAME or NAME:key=value,key=value, its values as in "
            f'TOML (numbers, "texts", [lists]): {cause}'
        ) from None
    return {"type": name.strip(), **found["keys"]}


def kinds_in_words() -> str:
    """Lines of a help text: each known constraint, its keys, and what it limits."""
    lines = ["known constraints, each with its keys (defaults in brackets):"]
    for name, kind in sorted(kinds().items()):
        keys = ", ".join(_key_in_words(field) for field in _fields(kind)) or "no keys"
        what = (kind.__doc__ or "").strip().splitlines()
        lines += [f"  {name}: {keys}", *(f"      {line}" for line in what[:1])]
    if len(lines) == 1:
        lines.append("  none")
    return "\n".join(lines) + "\n"


def _constraint(table: Mapping[str, Any]) -> PathConstraint:
    known = kinds()
    name = table.get("type")
    if not isinstance(name, str) or name not in known:
        what = "type: missing" if "type" not in table else f"there is no constraint {name!r}"
        hint = did_you_mean(name, known) if isinstance(name, str) else ""
        there = ", ".join(sorted(known)) or "none"
        raise ScenarioError(f"[{CONSTRAINTS}] {what}{hint}; known constraints are {there}")
    kind = known[name]
    check_table(table, _schema(kind), table=CONSTRAINTS)
    options = {key: value for key, value in table.items() if key != "type"}
    try:
        found: PathConstraint = kind(**options)
    except ZmpSqpError as cause:
        raise ScenarioError(f"[{CONSTRAINTS}] {name}: {cause}") from cause
    return found


def _schema(kind: type) -> Table:
    """Keys of a constraint's table: `type`, and the fields of its class."""
    types = get_type_hints(kind)
    keys = {field.name: BY_TYPE.get(types[field.name], ANYTHING) for field in _fields(kind)}
    needed = tuple(field.name for field in _fields(kind) if _is_required(field))
    return Table({"type": TEXT, **keys}, required=("type", *needed))


def _fields(kind: type) -> tuple[Field[Any], ...]:
    return tuple(field for field in fields(kind) if field.init)


def _is_required(field: Field[Any]) -> bool:
    return field.default is MISSING and field.default_factory is MISSING


def _key_in_words(field: Field[Any]) -> str:
    if _is_required(field):
        return field.name
    default = field.default if field.default_factory is MISSING else field.default_factory()
    return f"{field.name} [{default}]"
