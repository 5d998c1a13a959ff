"""Keys of a scenario file: which there are, what each may hold, and which exclude each other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

from zmp_sqp.errors import ScenarioError
from zmp_sqp.planning.problem.checks import AUTO

__all__ = ["HEIGHTMAP", "JOINT_KEYS", "PAYLOAD", "PLAN", "SCHEMA", "check_table", "did_you_mean"]


@dataclass(frozen=True, slots=True)
class Value:
    """Value of one key.

    Attributes:
        what: Values that the key may hold, in words for messages.
        accepts: Whether a value is one of them.
    """

    what: str
    accepts: Callable[[Any], bool]


@dataclass(frozen=True, slots=True)
class Table:
    """Keys of one table.

    Attributes:
        keys: What each key may hold.
        required: Keys that must be there.
        one_of: Groups of keys; exactly one key of each group must be there.
        at_most_one_of: Groups of keys that exclude each other.
    """

    keys: Mapping[str, Value | Table]
    required: tuple[str, ...] = ()
    one_of: tuple[tuple[str, ...], ...] = ()
    at_most_one_of: tuple[tuple[str, ...], ...] = ()


def _is_number(value: Any) -> bool:
    # bool is a subclass of int, so isinstance would accept True
    return type(value) in (int, float) and isfinite(value)


def _is_list(value: Any, accepts: Callable[[Any], bool], length: int | None = None) -> bool:
    return isinstance(value, list) and all(map(accepts, value)) and length in (None, len(value))


def _is_joints(value: Any) -> bool:
    return _is_list(list(value.values()) if isinstance(value, dict) else value, _is_number)


def _is_limit(value: Any) -> bool:
    values = list(value.values()) if isinstance(value, dict) else value
    return _is_number(value) or _is_list(values, _is_number)


NUMBER = Value("a finite number", _is_number)
RATES = Value(
    "a list of finite numbers, one per joint, or a table { joint = number }",
    lambda value: _is_joints(value),
)
JOINTS = Value(
    "a list of finite numbers, one per joint, a table { joint = number }, or the name of a pose",
    lambda value: isinstance(value, str) or _is_joints(value),
)
INTEGER = Value("a whole number", lambda value: type(value) is int)
INTERVALS = Value('a whole number or "auto"', lambda value: value == AUTO or type(value) is int)
TEXT = Value("a string in quotes", lambda value: isinstance(value, str))
TEXTS = Value("a list of strings", lambda value: _is_list(value, TEXT.accepts))
FLAG = Value("true or false", lambda value: isinstance(value, bool))
LIMIT = Value(
    "a finite number, a list of them with one per joint, or a table { joint = number }", _is_limit
)
COORDINATES = Value(
    "a table { joint = number }",
    lambda value: isinstance(value, dict) and all(map(_is_number, value.values())),
)
PAIR = Value("2 finite numbers", lambda value: _is_list(value, _is_number, 2))
POINT = Value("3 finite numbers [x, y, z]", lambda value: _is_list(value, _is_number, 3))
POSE = Value("3 finite numbers [x, y, yaw], in metres and radians", POINT.accepts)
HALF_SIDES = Value(
    "a finite number or 3 of them [x, y, z]",
    lambda value: _is_number(value) or POINT.accepts(value),
)
MATRIX = Value("3 rows of 3 finite numbers", lambda value: _is_list(value, POINT.accepts, 3))
TABLES = Value(
    "tables, one under each line [[constraints]]",
    lambda value: _is_list(value, lambda entry: isinstance(entry, dict)),
)
POINTS = Value(
    "a list of points [x, y] of finite numbers",
    lambda value: _is_list(value, PAIR.accepts),
)

SUPPORT = Table({"vertices": POINTS, "height": NUMBER}, required=("vertices",))
LIMITS = Table(
    dict.fromkeys(("position_lower", "position_upper", "velocity", "acceleration", "effort"), LIMIT)
)
PAYLOAD = Table(
    {"mass": NUMBER, "com": POINT, "frame": TEXT, "inertia": MATRIX},
    required=("mass", "com", "frame"),
)
MACHINE = Table(
    {
        "name": TEXT,  # of a shipped machine
        "urdf": TEXT,  # path of a file
        "point_masses": FLAG,
        "support": SUPPORT,
        "contact_links": TEXTS,
        "srdf": TEXT,  # path of a file
        "joints": TEXTS,  # that are planned
        "group": TEXT,  # of the SRDF, whose joints are planned
        "hold": COORDINATES,  # of joints that are not planned
        "package_dirs": TEXTS,
        "strict": FLAG,  # refuses what only causes a warning otherwise
        "joint_limits": TEXT,  # path of a joint_limits.yaml as MoveIt writes it
        "limits": LIMITS,
        "payload": PAYLOAD,
    },
    one_of=(("name", "urdf"),),
    at_most_one_of=(("support", "contact_links"), ("joints", "group")),
)
HEIGHTMAP = Table(
    {"file": TEXT, "resolution": NUMBER, "origin": PAIR}, required=("file", "resolution")
)
GROUND = Table(
    {"roll_deg": NUMBER, "pitch_deg": NUMBER, "heightmap": HEIGHTMAP},
    at_most_one_of=(("roll_deg", "heightmap"), ("pitch_deg", "heightmap")),
)
# keys of [motion], in radians; with _deg appended, in degrees
JOINT_KEYS = ("start", "goal", "start_velocity", "goal_velocity")
MOTION = Table(
    {
        f"{key}{unit}": RATES if unit or key.endswith("velocity") else JOINTS
        for key in JOINT_KEYS
        for unit in ("", "_deg")
    },
    one_of=(("start", "start_deg"), ("goal", "goal_deg")),
    at_most_one_of=(
        ("start_velocity", "start_velocity_deg"),
        ("goal_velocity", "goal_velocity_deg"),
    ),
)
BASE_LIMITS = ("max_speed", "max_acceleration", "max_yaw_rate", "max_yaw_acceleration")
BASE = Table(
    {"start": POSE, "goal": POSE}
    | dict.fromkeys(BASE_LIMITS, NUMBER)
    | dict.fromkeys(("start_velocity", "goal_velocity", "x_bounds", "y_bounds"), PAIR),
    required=("start", "goal", *BASE_LIMITS),
)
PLAN = Table(
    {
        "model": TEXT,
        "intervals": INTERVALS,
        "margin": NUMBER,
        "qp_solver": TEXT,
        "payload_com_uncertainty": HALF_SIDES,
        "tipping_fraction": NUMBER,
        "payload_uncertainty": NUMBER,
        "slope_uncertainty_deg": NUMBER,
    }
)
SCHEMA = Table(
    {
        "title": TEXT,
        "machine": MACHINE,
        "ground": GROUND,
        "motion": MOTION,
        "base": BASE,
        "constraints": TABLES,  # their keys depend on their types, see `path_constraints`
        "plan": PLAN,
    },
    required=("machine", "motion"),
)


def check_table(content: Mapping[str, Any], schema: Table, *, table: str = "") -> None:
    """Check the keys of a table and of all tables in it.

    Args:
        content: The table as TOML gives it.
        schema: Keys that it may hold.
        table: Name of the table, for messages; empty for the file itself.

    Raises:
        ScenarioError: The first key that is unknown, of the wrong type, missing or excluded by
            another one; the message names it.
    """
    where = f"[{table}] " if table else ""
    for key, value in content.items():
        if key not in schema.keys:
            hint = did_you_mean(key, schema.keys)
            raise ScenarioError(
                f"{where}{key}: unknown key{hint}; allowed are {', '.join(schema.keys)}"
            )
        allowed = schema.keys[key]
        if isinstance(allowed, Value):
            if not allowed.accepts(value):
                raise ScenarioError(f"{where}{key}: must be {allowed.what}, not {value!r}")
        elif isinstance(value, dict):
            check_table(value, allowed, table=f"{table}.{key}" if table else key)
        else:
            raise ScenarioError(f"{where}{key}: must be a table, not {value!r}")
    _check_presence(content, schema, where)


def _check_presence(content: Mapping[str, Any], schema: Table, where: str) -> None:
    """Refuse keys that are missing or exclude each other; `where` begins the message."""
    for key in schema.required:
        if key not in content:
            raise ScenarioError(f"{where}{key}: missing; it must be {_spell(schema.keys[key])}")
    for group in schema.one_of + schema.at_most_one_of:
        given = [key for key in group if key in content]
        if len(given) > 1:
            raise ScenarioError(
                f"{where}{' and '.join(given)} exclude each other: give one of them"
            )
        if not given and group in schema.one_of:
            raise ScenarioError(
                f"{where}{' or '.join(group)}: missing; it must be {_spell(schema.keys[group[0]])}"
            )


def _spell(allowed: Value | Table) -> str:
    if isinstance(allowed, Value):
        return allowed.what
    return f"a table with the keys {', '.join(allowed.keys)}"


def did_you_mean(key: str, names: Iterable[str]) -> str:
    """Question with the nearest of the names, to append to a message; empty if none is near."""
    from difflib import get_close_matches  # only needed here

    close = get_close_matches(key, list(names), n=1)
    return f" (did you mean {close[0]}?)" if close else ""
