"""Scenario files: one planning problem, written down in TOML."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ScenarioError, ZmpSqpError
from zmp_sqp.mechanics import (
    Heightmap,
    Machine,
    Payload,
    Slope,
    SupportPolygon,
    load_machine,
    shipped_machines,
)
from zmp_sqp.planning import Problem, UnicycleBase

__all__ = ["Scenario", "load_scenario", "shipped_scenarios", "sliding_joints"]

SHIPPED = Path(__file__).parent / "scenarios"
MOTIONS = ("start", "goal", "start_velocity", "goal_velocity")


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """A planning problem with a name.

    Attributes:
        name: The file's name without its ending.
        title: What the file calls itself, one line.
        problem: What to plan.
        qp_solver: The QP backend that the file asks for.
        path: Where it was read.
    """

    name: str
    title: str
    problem: Problem = field(repr=False)
    qp_solver: str
    path: Path


def shipped_scenarios() -> tuple[str, ...]:
    """Names of the scenarios that travel with the library, sorted."""
    return tuple(sorted(path.stem for path in SHIPPED.glob("*.toml")))


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Read a scenario: the name of a shipped one, or the path of a TOML file.

    Files named in it are relative to it. `zmp_sqp/scenarios/paper_1.toml` shows the tables with
    their units.

    Args:
        name_or_path: A name of `shipped_scenarios`, or a path.

    Returns:
        The scenario with its checked problem.

    Raises:
        ScenarioError: No such scenario, no TOML, a key that is unknown, missing or of the wrong
            type, or a machine or problem that the library refuses. The message names file, table,
            key and value.
    """
    path = _find(name_or_path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as cause:
        raise ScenarioError(f"{path}: cannot be read: {cause.strerror}") from None
    except ValueError as cause:  # not TOML, or not UTF-8
        raise ScenarioError(f"{path}: not a TOML file: {cause}") from None
    try:
        _check(content, SCHEMA, table="")
        problem = _read_problem(content, path.parent)
    except ZmpSqpError as cause:
        raise ScenarioError(f"{path}: {cause}") from cause
    qp_solver = content.get("plan", {}).get("qp_solver", "proxqp")
    return Scenario(path.stem, content.get("title", path.stem), problem, qp_solver, path)


def sliding_joints(machine: Machine) -> tuple[str, ...]:
    """The joints whose coordinates are lengths, not angles."""
    return tuple(
        name
        for name, unit in zip(machine.joint_names, machine.joint_units, strict=True)
        if unit == "m"
    )


def _find(name_or_path: str | Path) -> Path:
    names = shipped_scenarios()
    if str(name_or_path) in names:
        return SHIPPED / f"{name_or_path}.toml"
    path = Path(name_or_path)
    if not path.exists():
        hint = _did_you_mean(path.name, names)
        raise ScenarioError(
            f"{path}: no such scenario{hint}; it is the path of a file, or one of {', '.join(names)}"
        )
    return path


def _read_problem(content: Mapping[str, Any], folder: Path) -> Problem:
    with _blame("machine"):
        if (name := content["machine"].get("name")) not in (None, *shipped_machines()):
            hint = _did_you_mean(name, shipped_machines())
            raise ScenarioError(
                f"there is no machine {name!r}{hint}; allowed are {', '.join(shipped_machines())}; a file is urdf"
            )
        machine = _read_machine(content["machine"], folder)
    with _blame("ground"):
        ground = _read_ground(content.get("ground", {}), folder)
    motion: dict[str, Any] = {key: _read_joints(content["motion"], key, machine) for key in MOTIONS}
    settings = {key: value for key, value in content.get("plan", {}).items() if key != "qp_solver"}
    if "slope_uncertainty_deg" in settings:
        settings["slope_uncertainty"] = np.deg2rad(settings.pop("slope_uncertainty_deg"))
    with _blame("base"):
        base = UnicycleBase(**content["base"]) if "base" in content else None
    return Problem(
        machine, ground=ground, base=base, **motion, **settings
    )  # its complaints name the quantity themselves


def _read_ground(table: Mapping[str, Any], folder: Path) -> Slope | Heightmap:
    if "heightmap" not in table:
        return Slope(
            **{key.removesuffix("_deg"): np.deg2rad(angle) for key, angle in table.items()}
        )
    options = dict(table["heightmap"])
    return Heightmap.from_file(folder / options.pop("file"), **options)


def _read_machine(table: Mapping[str, Any], folder: Path) -> Machine:
    options: dict[str, Any] = {}
    if "support" in table:
        options["support"] = SupportPolygon(**table["support"])
    elif "contact_links" in table:
        options["support"] = table["contact_links"]
    if "joint_limits" in table:
        options["limits"] = folder / table["joint_limits"]
    machine = load_machine(table["name"] if "name" in table else folder / table["urdf"], **options)
    if "limits" in table:
        machine = replace(
            machine, limits=machine.limits.updated(table["limits"], machine.joint_names)
        )
    if "payload" in table:
        machine = machine.with_payload(Payload(**table["payload"]))
    return machine.with_point_masses() if table.get("point_masses", False) else machine


@contextmanager
def _blame(table: str) -> Iterator[None]:
    """Say in which table of the file the library found fault."""
    try:
        yield
    except ZmpSqpError as cause:
        raise ScenarioError(f"[{table}]: {cause}") from cause


def _read_joints(motion: Mapping[str, Any], key: str, machine: Machine) -> Array | None:
    """One number per joint from `key` (radians) or `key`_deg (degrees); None if neither is there."""
    found = key if key in motion else f"{key}_deg"
    if found not in motion:
        return None
    values, names = motion[found], machine.joint_names
    if len(values) != len(names):
        raise ScenarioError(
            f"[motion] {found}: needs {len(names)} numbers ({', '.join(names)}), not {len(values)}: {values}"
        )
    if found == key:
        return np.array(values, dtype=np.float64)
    for name in sliding_joints(machine):
        raise ScenarioError(
            f"[motion] {found}: joint {name!r} slides; give {key} in radians and metres"
        )
    return np.asarray(np.deg2rad(values))


# --- what a file may hold
# ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Value:
    """What one key may hold: in words, and as a test."""

    what: str
    accepts: Callable[[Any], bool]


@dataclass(frozen=True, slots=True)
class _Schema:
    """What one table may hold; of each group in `one_of` exactly one key must stand there."""

    keys: Mapping[str, _Value | _Schema]
    required: tuple[str, ...] = ()
    one_of: tuple[tuple[str, ...], ...] = ()
    at_most_one_of: tuple[tuple[str, ...], ...] = ()


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and isfinite(value)  # True is no number here


def _is_list(value: Any, accepts: Callable[[Any], bool], length: int | None = None) -> bool:
    return isinstance(value, list) and all(map(accepts, value)) and length in (None, len(value))


def _is_limit(value: Any) -> bool:
    values = list(value.values()) if isinstance(value, dict) else value
    return _is_number(value) or _is_list(values, _is_number)


NUMBER = _Value("a finite number", _is_number)
NUMBERS = _Value(
    "a list of finite numbers, one per joint", lambda value: _is_list(value, _is_number)
)
INTEGER = _Value("a whole number", lambda value: type(value) is int)
TEXT = _Value("a string in quotes", lambda value: isinstance(value, str))
TEXTS = _Value("a list of strings", lambda value: _is_list(value, TEXT.accepts))
FLAG = _Value("true or false", lambda value: isinstance(value, bool))
LIMIT = _Value(
    "a finite number, a list of them with one per joint, or a table { joint = number }", _is_limit
)
POINT = _Value("3 finite numbers [x, y, z]", lambda value: _is_list(value, _is_number, 3))
MATRIX = _Value("3 rows of 3 finite numbers", lambda value: _is_list(value, POINT.accepts, 3))
POINTS = _Value(
    "a list of points [x, y] of finite numbers",
    lambda value: _is_list(value, lambda point: _is_list(point, _is_number, 2)),
)

SUPPORT = _Schema({"vertices": POINTS, "height": NUMBER}, required=("vertices",))
LIMITS = _Schema(
    dict.fromkeys(("position_lower", "position_upper", "velocity", "acceleration", "effort"), LIMIT)
)
PAYLOAD = _Schema(
    {"mass": NUMBER, "com": POINT, "frame": TEXT, "inertia": MATRIX},
    required=("mass", "com", "frame"),
)
MACHINE = _Schema(
    {
        "name": TEXT,  # of a machine that travels with the library
        "urdf": TEXT,  # or a file
        "point_masses": FLAG,
        "support": SUPPORT,
        "contact_links": TEXTS,
        "joint_limits": TEXT,  # MoveIt's joint_limits.yaml
        "limits": LIMITS,
        "payload": PAYLOAD,
    },
    one_of=(("name", "urdf"),),
    at_most_one_of=(("support", "contact_links"),),
)
PAIR = _Value("2 finite numbers", lambda value: _is_list(value, _is_number, 2))
HEIGHTMAP = _Schema(
    {"file": TEXT, "resolution": NUMBER, "origin": PAIR}, required=("file", "resolution")
)
GROUND = _Schema(
    {"roll_deg": NUMBER, "pitch_deg": NUMBER, "heightmap": HEIGHTMAP},
    at_most_one_of=(("roll_deg", "heightmap"), ("pitch_deg", "heightmap")),
)
MOTION = _Schema(
    {f"{key}{unit}": NUMBERS for key in MOTIONS for unit in ("", "_deg")},
    one_of=(("start", "start_deg"), ("goal", "goal_deg")),
    at_most_one_of=(
        ("start_velocity", "start_velocity_deg"),
        ("goal_velocity", "goal_velocity_deg"),
    ),
)
POSE = _Value("3 finite numbers [x, y, yaw], in metres and radians", POINT.accepts)
BASE_LIMITS = ("max_speed", "max_acceleration", "max_yaw_rate", "max_yaw_acceleration")
BASE = _Schema(
    {"start": POSE, "goal": POSE}
    | dict.fromkeys(BASE_LIMITS, NUMBER)
    | dict.fromkeys(("start_velocity", "goal_velocity", "x_bounds", "y_bounds"), PAIR),
    required=("start", "goal", *BASE_LIMITS),
)
UNCERTAINTIES = ("tipping_fraction", "payload_uncertainty", "slope_uncertainty_deg")
SIDES = _Value(
    "a finite number or 3 of them [x, y, z]",
    lambda value: _is_number(value) or POINT.accepts(value),
)
PLAN = _Schema(
    {
        "model": TEXT,
        "intervals": INTEGER,
        "margin": NUMBER,
        "qp_solver": TEXT,
        "payload_com_uncertainty": SIDES,
    }
    | dict.fromkeys(UNCERTAINTIES, NUMBER)
)
SCHEMA = _Schema(
    {
        "title": TEXT,
        "machine": MACHINE,
        "ground": GROUND,
        "motion": MOTION,
        "base": BASE,
        "plan": PLAN,
    },
    required=("machine", "motion"),
)


def _check(content: Mapping[str, Any], schema: _Schema, *, table: str) -> None:
    """Refuse the first key that is unknown, missing, ambiguous or of the wrong type, down through all tables."""
    where = f"[{table}] " if table else ""
    for key, value in content.items():
        if key not in schema.keys:
            hint = _did_you_mean(key, schema.keys)
            raise ScenarioError(
                f"{where}{key}: unknown key{hint}; allowed are {', '.join(schema.keys)}"
            )
        allowed = schema.keys[key]
        if isinstance(allowed, _Value):
            if not allowed.accepts(value):
                raise ScenarioError(f"{where}{key}: must be {allowed.what}, not {value!r}")
        elif isinstance(value, dict):
            _check(value, allowed, table=f"{table}.{key}" if table else key)
        else:
            raise ScenarioError(f"{where}{key}: must be a table, not {value!r}")
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


def _spell(allowed: _Value | _Schema) -> str:
    return (
        allowed.what
        if isinstance(allowed, _Value)
        else f"a table with the keys {', '.join(allowed.keys)}"
    )


def _did_you_mean(key: str, names: Iterable[str]) -> str:
    close = get_close_matches(key, list(names), n=1)
    return f" (did you mean {close[0]}?)" if close else ""
