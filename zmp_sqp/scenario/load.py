"""Loading of scenario files as planning problems."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ScenarioError, ZmpSqpError, in_keys
from zmp_sqp.mechanics import Machine, shipped_machines
from zmp_sqp.mechanics.joint_values import by_joint
from zmp_sqp.planning import Problem, UnicycleBase
from zmp_sqp.scenario.path_constraints import build_constraints
from zmp_sqp.scenario.scene import DEGREES, build_ground, build_machine, build_uncertainties
from zmp_sqp.scenario.schema import JOINT_KEYS, SCHEMA, check_table, did_you_mean

__all__ = [
    "SHIPPED",
    "Scenario",
    "load_scenario",
    "read_content",
    "read_joints",
    "scenario_of",
    "shipped_scenarios",
    "sliding_joints",
]

SHIPPED = Path(__file__).parents[1] / "scenarios"
DEFAULT_QP_SOLVER = "auto"


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """A planning problem with a name.

    Attributes:
        name: Name of the file without its ending.
        title: Title given in the file, one line; the name if there is none.
        problem: The planning problem.
        qp_solver: Name of the QP solver given in the file.
        path: Path of the file.
    """

    name: str
    title: str
    problem: Problem = field(repr=False)
    qp_solver: str
    path: Path


def shipped_scenarios() -> tuple[str, ...]:
    """Names of the scenarios that come with this library, sorted."""
    return tuple(sorted(path.stem for path in SHIPPED.glob("*.toml")))


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Read a scenario file.

    Paths in the file are relative to it. `zmp_sqp/scenarios/paper_1.toml` shows the tables with
    their units.

    Args:
        name_or_path: Name of a shipped scenario (`shipped_scenarios`), or path of a TOML file.

    Returns:
        The scenario with its checked problem.

    Raises:
        ScenarioError: There is no such scenario; it is no TOML file; a key is unknown, missing or
            of the wrong type; or machine or problem are refused. The message names file, table, key
            and value.
    """
    return scenario_of(*read_content(name_or_path))


def read_content(name_or_path: str | Path) -> tuple[dict[str, Any], Path]:
    """Unchecked content of a scenario file, and its path.

    Raises:
        ScenarioError: There is no such scenario, or it is no TOML file.
    """
    path = _find(name_or_path)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8")), path
    except OSError as cause:
        raise ScenarioError(f"{path}: cannot be read: {cause.strerror}") from None
    except ValueError as cause:  # not TOML, or not UTF-8
        raise ScenarioError(f"{path}: not a TOML file: {cause}") from None


def scenario_of(
    content: Mapping[str, Any],
    path: Path,
    *,
    build: Callable[[Mapping[str, Any], Path], Machine] = build_machine,
) -> Scenario:
    """Scenario of a file's content.

    Args:
        content: Tables of the file.
        path: Path of the file: for messages, the name, and paths in the file.
        build: Makes the machine of the table [machine], whose paths are relative to a folder; a
            caller with many scenarios of one machine may keep it.

    Raises:
        ScenarioError: A key is unknown, missing or of the wrong type; or machine or problem are
            refused.
    """
    try:
        check_table(content, SCHEMA)
        problem = _build_problem(content, path.parent, build)
    except ZmpSqpError as cause:
        raise ScenarioError(f"{path}: {in_keys(str(cause))}") from cause
    qp_solver = content.get("plan", {}).get("qp_solver", DEFAULT_QP_SOLVER)
    return Scenario(path.stem, content.get("title", path.stem), problem, qp_solver, path)


def sliding_joints(machine: Machine) -> tuple[str, ...]:
    """Names of the joints whose coordinates are lengths, not angles."""
    return tuple(
        name
        for name, unit in zip(machine.joint_names, machine.joint_units, strict=True)
        if unit == "m"
    )


def _find(name_or_path: str | Path) -> Path:
    """Path of a scenario file, given by name or path."""
    names = shipped_scenarios()
    if str(name_or_path) in names:
        return SHIPPED / f"{name_or_path}.toml"
    path = Path(name_or_path)
    if not path.exists():
        hint = did_you_mean(path.name, names)
        raise ScenarioError(
            f"{path}: no such scenario{hint}; give the path of a file, or one of {', '.join(names)}"
        )
    return path


def _build_problem(
    content: Mapping[str, Any], folder: Path, build: Callable[[Mapping[str, Any], Path], Machine]
) -> Problem:
    """Problem of a checked file; its paths are relative to the folder."""
    with _blame("machine"):
        _check_name(content["machine"].get("name"))
        machine = build(content["machine"], folder)
    with _blame("ground"):
        ground = build_ground(content.get("ground", {}), folder)
    motion: dict[str, Any] = {
        key: read_joints(content["motion"], key, machine) for key in JOINT_KEYS
    }
    plan = content.get("plan", {})
    with _blame("plan"):
        uncertainties = build_uncertainties(plan)
    settings = {key: plan[key] for key in ("model", "intervals", "margin") if key in plan}
    with _blame("base"):
        base = UnicycleBase(**content["base"]) if "base" in content else None
    constraints = build_constraints(content.get("constraints", ()))
    # no _blame: Problem names the quantity at fault itself
    return Problem(
        machine,
        ground=ground,
        base=base,
        constraints=constraints,
        **motion,
        **settings,
        **uncertainties,
    )


def _check_name(name: str | None) -> None:
    """Refuse the name of a machine that is not shipped; load_machine would take it for a path."""
    shipped = shipped_machines()
    if name is not None and name not in shipped:
        raise ScenarioError(
            f"there is no machine {name!r}{did_you_mean(name, shipped)}; allowed are "
            f"{', '.join(shipped)}; for a file, give urdf"
        )


@contextmanager
def _blame(table: str) -> Iterator[None]:
    """Begin messages of errors with the name of the table at fault."""
    try:
        yield
    except ZmpSqpError as cause:
        raise ScenarioError(f"[{table}]: {cause}") from cause


def read_joints(motion: Mapping[str, Any], key: str, machine: Machine) -> Array | None:
    """One number per joint, shape (n,), in SI units; None if the key is not there.

    Args:
        motion: The table [motion].
        key: Name of the key for radians; with _deg appended, the key is in degrees.
        machine: Gives the joints.

    Raises:
        ScenarioError: Not one number per joint, an unknown joint or pose, or degrees for a joint
            that slides.
    """
    found = key if key in motion else f"{key}{DEGREES}"
    if found not in motion:
        return None
    values, names = motion[found], machine.joint_names
    where = f"[motion] {found}"
    if not isinstance(values, list):
        values = by_joint(values, machine, name=where, error=ScenarioError).tolist()
    if len(values) != len(names):
        raise ScenarioError(
            f"[motion] {found}: needs {len(names)} numbers ({', '.join(names)}), "
            f"not {len(values)}: {values}"
        )
    if found == key:
        return np.array(values, dtype=np.float64)
    for name in sliding_joints(machine):
        raise ScenarioError(
            f"[motion] {found}: joint {name!r} slides; give {key} in radians and metres"
        )
    return np.asarray(np.deg2rad(values))
