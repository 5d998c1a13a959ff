"""Machine, ground and uncertainties of a scenario, built from its tables.

The tables are those of a scenario file, checked by `schema`; `zmp-sqp check` makes them of its
options. Units are those of the keys: degrees where a key ends in _deg.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.errors import MachineError, ProblemError
from zmp_sqp.mechanics import Machine, Payload, Slope, SupportPolygon, load_machine
from zmp_sqp.mechanics.limits import without_unplanned
from zmp_sqp.mechanics.uncertainty import com_box
from zmp_sqp.planning.problem.checks import UNCERTAINTIES
from zmp_sqp.scenario.schema import PLAN

if TYPE_CHECKING:
    from zmp_sqp.mechanics.terrain.heightmap import Heightmap

__all__ = ["DEGREES", "build_ground", "build_machine", "build_slope", "build_uncertainties"]

DEGREES = "_deg"  # ending of keys whose values are degrees
RIGHT_ANGLE = 90.0  # [deg]
COM = "payload_com_uncertainty"


def build_machine(table: Mapping[str, Any], folder: Path) -> Machine:
    """Machine with its payload, limits and support.

    Args:
        table: The table [machine].
        folder: Folder to which its paths are relative.

    Raises:
        MachineError: URDF, limits, support or payload cannot be used.
    """
    options: dict[str, Any] = {}
    if "support" in table:
        options["support"] = SupportPolygon(**table["support"])
    elif "contact_links" in table:
        options["support"] = table["contact_links"]
    if "joint_limits" in table:
        options["limits"] = folder / table["joint_limits"]
    if "srdf" in table:
        options["srdf"] = folder / table["srdf"]
    if "package_dirs" in table:
        options["package_dirs"] = [folder / name for name in table["package_dirs"]]
    options |= {key: table[key] for key in ("joints", "group", "hold", "strict") if key in table}
    machine = load_machine(table["name"] if "name" in table else folder / table["urdf"], **options)
    if "limits" in table:
        changes = without_unplanned(table["limits"], machine.unplanned)
        machine = replace(machine, limits=machine.limits.updated(changes, machine.joint_names))
    if "payload" in table and table["payload"].get("mass") != 0.0:  # none, as in a study from 0 kg
        machine = machine.with_payload(Payload(**table["payload"]))
    return machine.with_point_masses() if table.get("point_masses", False) else machine


def build_ground(table: Mapping[str, Any], folder: Path) -> Slope | Heightmap:
    """Slope of the given roll and pitch, or heightmap.

    Args:
        table: The table [ground]; empty for level ground.
        folder: Folder to which the heightmap's path is relative.

    Raises:
        MachineError: An angle is out of range, or the heightmap cannot be used.
    """
    if "heightmap" not in table:
        return build_slope(table)
    options = dict(table["heightmap"])
    from zmp_sqp.mechanics.terrain.heightmap import Heightmap  # only needed here

    return Heightmap.from_file(folder / options.pop("file"), **options)


def build_slope(table: Mapping[str, Any]) -> Slope:
    """Slope of the given roll_deg and pitch_deg.

    Args:
        table: The table [ground] without a heightmap; empty for level ground.

    Raises:
        MachineError: An angle is out of range.
    """
    angles = {key.removesuffix(DEGREES): angle for key, angle in table.items()}
    for name, angle in angles.items():
        if not -RIGHT_ANGLE < angle < RIGHT_ANGLE:
            raise MachineError(
                f"slope {name} must lie within +-{RIGHT_ANGLE:g} degrees, not {angle:g} degrees"
            )
    return Slope(**{name: np.deg2rad(angle) for name, angle in angles.items()})


def build_uncertainties(
    table: Mapping[str, Any], *, spell: Callable[[str], str] = str
) -> dict[str, Any]:
    """Uncertainties as keyword arguments of `Problem`, in SI units; only those that are given.

    Args:
        table: The table [plan]; other keys in it are left out.
        spell: Gives the name of a key in messages.

    Raises:
        ProblemError: A value is out of range; the message gives the range in the key's unit.
    """
    found: dict[str, Any] = {}
    for name, least, most, _ in UNCERTAINTIES:
        in_degrees = name not in PLAN.keys
        key = f"{name}{DEGREES}" if in_degrees else name
        if key not in table:
            continue
        value = table[key]
        lower, upper = (
            float(np.rad2deg(bound)) if in_degrees else bound for bound in (least, most)
        )
        if not lower <= value <= upper:
            unit = " degrees" if in_degrees else ""
            raise ProblemError(
                f"{spell(key)} must lie within [{lower:.4g}, {upper:.4g}]{unit}, not {value:g}"
            )
        found[name] = float(np.deg2rad(value)) if in_degrees else value
    if COM in table:
        found[COM] = com_box(table[COM], name=spell(COM))
    return found
