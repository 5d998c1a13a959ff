"""Names of the columns of tables of samples: which joint, which quantity, which unit."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from zmp_sqp.errors import TrajectoryError
from zmp_sqp.motion.samples import QUANTITIES
from zmp_sqp.motion.unicycle_motion import BASE_COLUMNS

__all__ = ["Columns", "read_header"]

TIME_NAMES = ("time", "t", "timestamp", "stamp", "seconds", "sec", "secs", "time_from_start")
TIME_UNITS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ALIASES = {
    "position": ("position", "positions", "pos", "q", "angle"),
    "velocity": ("velocity", "velocities", "vel", "rate", "v", "qd", "dq", "qdot"),
    "acceleration": ("acceleration", "accelerations", "acc", "accel", "a", "qdd", "ddq"),
    "jerk": ("jerk", "jerks"),
    "snap": ("snap",),
    "crackle": ("crackle",),
}
QUANTITY_OF = {alias: quantity for quantity, names in ALIASES.items() for alias in names}
SEPARATORS = "._/: "
UNIT = re.compile(r"\s*[\[(]\s*([^\])]*?)\s*[\])]$")  # "slew.position [deg]"


class Columns(NamedTuple):
    """What the columns of a table hold.

    Attributes:
        time: Index of the column of times.
        time_unit: Its unit [s].
        joints: Index of the column of each quantity of each joint, in the order of the joints; -1
            where there is none.
        factors: Factors that turn these columns to SI units.
        base: Index of each of `BASE_COLUMNS`, -1 where there is none; empty without a base.
        ignored: Names of all other columns.
    """

    time: int
    time_unit: float
    joints: dict[str, list[int]]
    factors: dict[str, list[float]]
    base: list[int]
    ignored: tuple[str, ...]


def read_header(source: str, header: Sequence[str], joint_names: Sequence[str]) -> Columns:
    """Find time, joints and base among the names of columns.

    Args:
        source: Path of the file, for messages.
        header: Names of the columns.
        joint_names: Names of the n joints that must be there.

    Raises:
        TrajectoryError: No time, a column twice, a joint without position, or a quantity that is
            given for some joints only; the message names file and column.
    """
    found: dict[tuple[str, str], int] = {}
    units: dict[tuple[str, str], str] = {}
    ignored = []
    for index, name in enumerate(header):
        bare, unit = _without_unit(name)
        key = _meaning(bare, joint_names)
        if key is None:
            ignored.append(name)
            continue
        if key in found:
            raise TrajectoryError(
                f"{source}: columns {header[found[key]]!r} and {name!r} both hold "
                f"{' '.join(filter(None, key))}; only one of them may"
            )
        found[key], units[key] = index, unit
    if ("time", "") not in found:
        raise TrajectoryError(
            f"{source}: there is no column 'time'; the columns are {_listed(header)}"
        )
    _check_joints(source, header, found, joint_names)
    given = [name for name in QUANTITIES if (joint_names[0], name) in found]
    keys = {quantity: [(joint, quantity) for joint in joint_names] for quantity in given}
    joints = {quantity: [found[key] for key in of] for quantity, of in keys.items()}
    factors = {
        quantity: [_factor(source, header[found[key]], units[key]) for key in of]
        for quantity, of in keys.items()
    }
    base = [found.get(("base", name), -1) for name in BASE_COLUMNS]
    if max(base) < 0:
        base = []
    time_unit = TIME_UNITS.get(units["time", ""] or "s")
    if time_unit is None:
        raise TrajectoryError(
            f"{source}: column {header[found['time', '']]!r} must be in {', '.join(TIME_UNITS)}"
        )
    return Columns(found["time", ""], time_unit, joints, factors, base, tuple(ignored))


def _check_joints(
    source: str,
    header: Sequence[str],
    found: dict[tuple[str, str], int],
    joint_names: Sequence[str],
) -> None:
    """Raise TrajectoryError unless every quantity that is there is there for all joints."""
    for quantity in QUANTITIES:
        lacking = [joint for joint in joint_names if (joint, quantity) not in found]
        if len(lacking) == len(joint_names) and quantity != "position":
            continue
        for joint in lacking:
            raise TrajectoryError(
                f"{source}: there is no column '{joint}.{quantity}'; every joint needs one "
                f"({', '.join(joint_names)}), and the columns are {_listed(header)}; joints that "
                "are not logged are held: load the machine with the others alone (joints)"
            )


def _without_unit(name: str) -> tuple[str, str]:
    """Name of a column without its unit, and the unit."""
    bare = name.strip().strip("\"'").lstrip("#").strip()
    match = UNIT.search(bare)
    return (bare, "") if match is None else (bare[: match.start()], match.group(1))


def _meaning(name: str, joint_names: Sequence[str]) -> tuple[str, str] | None:
    """Joint and quantity of a column, ("time", ""), ("base", name), or None."""
    if name in joint_names:
        return name, "position"
    for joint in joint_names:
        for rest in (name.removeprefix(joint), name.removesuffix(joint)):
            if rest != name and (rest[0] in SEPARATORS or rest[-1] in SEPARATORS):
                quantity = QUANTITY_OF.get(rest.strip(SEPARATORS).lower())
                if quantity is not None:
                    return joint, quantity
    if name in BASE_COLUMNS:
        return "base", name
    return ("time", "") if name.lower() in TIME_NAMES else None


def _factor(source: str, column: str, unit: str) -> float:
    """Factor from the unit of a column to SI units."""
    base = unit.partition("/")[0].strip()
    factors = {"": 1.0, "rad": 1.0, "m": 1.0, "deg": np.pi / 180.0, "°": np.pi / 180.0, "mm": 1e-3}
    if base not in factors:
        raise TrajectoryError(
            f"{source}: column {column!r} must be in rad, deg, m or mm (per s, s^2, ...), not "
            f"{unit!r}"
        )
    return float(factors[base])


def _listed(header: Sequence[str]) -> str:
    """The first columns of a header."""
    shown = ", ".join(repr(name) for name in header[:12])
    return f"{shown}, ..." if len(header) > 12 else shown or "none"
