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
PER_TIME = re.compile(r"s(ec)?[\^*]*[2-5²³]?")  # "s", "s^2", "s²"
# units of angles and of lengths, with their factors to SI units
UNITS = {
    "rad": {"rad": 1.0, "deg": np.pi / 180.0, "°": np.pi / 180.0},
    "m": {"m": 1.0, "mm": 1e-3},
}


class Columns(NamedTuple):
    """What the columns of a table hold.

    Attributes:
        time: Index of the column of times.
        time_unit: Its unit [s].
        joints: Index of the column of each quantity of each joint, in the order of the joints; -1
            where there is none.
        factors: Factors that turn these columns to SI units.
        base: Index of each of `BASE_COLUMNS`, -1 where there is none; empty without a base.
        base_factors: Factors that turn these columns to SI units; 1 where there is none.
        ignored: Names of all other columns.
    """

    time: int
    time_unit: float
    joints: dict[str, list[int]]
    factors: dict[str, list[float]]
    base: list[int]
    base_factors: list[float]
    ignored: tuple[str, ...]

    @property
    def converts(self) -> bool:
        """Whether any factor differs from 1."""
        every = (*self.factors.values(), self.base_factors)
        return any(factor != 1.0 for of in every for factor in of)


def read_header(
    source: str, header: Sequence[str], joint_names: Sequence[str], joint_units: Sequence[str]
) -> Columns:
    """Find time, joints and base among the names of columns.

    Args:
        source: Path of the file, for messages.
        header: Names of the columns.
        joint_names: Names of the n joints that must be there.
        joint_units: Units of their coordinates, "rad" or "m".

    Raises:
        TrajectoryError: No time, a column twice, a joint without position, a quantity that is given
            for some joints only, or an angle in a unit of length; the message names file and
            column.
    """
    found, units, ignored = _known_columns(source, header, joint_names)
    if ("time", "") not in found:
        raise TrajectoryError(
            f"{source}: there is no column 'time'; the columns are {_listed(header)}"
        )
    _check_joints(source, header, found, joint_names)
    given = [name for name in QUANTITIES if (joint_names[0], name) in found]
    keys = {quantity: [(joint, quantity) for joint in joint_names] for quantity in given}
    joints = {quantity: [found[key] for key in of] for quantity, of in keys.items()}
    factors = {
        quantity: [
            _factor(source, header[found[key]], units[key], kind)
            for key, kind in zip(of, joint_units, strict=True)
        ]
        for quantity, of in keys.items()
    }
    base = [found.get(("base", name), -1) for name in BASE_COLUMNS]
    if max(base) < 0:
        base = []
    base_factors = [
        _factor(source, header[i], units["base", name], "rad" if "yaw" in name else "m")
        if i >= 0
        else 1.0
        for name, i in zip(BASE_COLUMNS, base, strict=False)
    ]
    time_unit = TIME_UNITS.get(units["time", ""] or "s")
    if time_unit is None:
        raise TrajectoryError(
            f"{source}: column {header[found['time', '']]!r} must be in {', '.join(TIME_UNITS)}"
        )
    return Columns(
        found["time", ""], time_unit, joints, factors, base, base_factors, tuple(ignored)
    )


def _known_columns(
    source: str, header: Sequence[str], joint_names: Sequence[str]
) -> tuple[dict[tuple[str, str], int], dict[tuple[str, str], str], list[str]]:
    """Index and unit of each column with a meaning (`_meaning`), and the names of all others."""
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
    return found, units, ignored


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


def _factor(source: str, column: str, unit: str, kind: str) -> float:
    """Factor from the unit of a column to SI units.

    Args:
        source, column, unit: Of the column; an empty unit is the SI unit.
        kind: "rad" for angles and their derivatives, "m" for lengths.
    """
    base, _, per = unit.partition("/")
    known = UNITS[kind]
    if unit and (base.strip() not in known or (per and not PER_TIME.fullmatch(per.strip()))):
        raise TrajectoryError(
            f"{source}: column {column!r} must be in {' or '.join(list(known)[:2])} (per s, s^2, "
            f"...), not {unit!r}"
        )
    return known[base.strip()] if unit else 1.0


def _listed(header: Sequence[str]) -> str:
    """The first columns of a header."""
    shown = ", ".join(repr(name) for name in header[:12])
    return f"{shown}, ..." if len(header) > 12 else shown or "none"
