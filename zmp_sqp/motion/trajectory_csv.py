"""Motions as CSV files: one row per node, one column per joint and quantity."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import TrajectoryError
from zmp_sqp.mechanics.ground import Terrain
from zmp_sqp.motion.samples import QUANTITIES
from zmp_sqp.motion.unicycle_motion import BASE_COLUMNS, PLANE, UnicycleMotion

__all__ = ["read_csv", "write_csv", "write_csv_samples"]

CURVED = QUANTITIES[4:]  # quantities that only motions with curved accelerations have


def write_csv(
    path: str | Path,
    joint_names: Sequence[str],
    times: Array,
    rows: Sequence[Array],
    base: UnicycleMotion | None,
) -> None:
    """Write a motion: time, then quantities for all joints, then the base's columns.

    Numbers are in SI units and have 17 significant digits, so that reading restores every bit.

    Args:
        path: File to write.
        joint_names: Names of the n joints.
        times: Nodes, shape (N+1,) [s].
        rows: One array (N+1, n) for each of `QUANTITIES`, or for the first four of them.
        base: Motion of the base, written to the columns `BASE_COLUMNS`; None writes none of them.
    """
    write_csv_samples(path, joint_names, times, rows, None if base is None else base.table())


def write_csv_samples(
    path: str | Path,
    joint_names: Sequence[str],
    times: Array,
    rows: Sequence[Array],
    base: Array | None,
) -> None:
    """Write states as CSV: time, then quantities for all joints, then the base's columns.

    Args:
        path: File to write.
        joint_names: Names of the n joints.
        times: Shape (K,) [s].
        rows: One array (K, n) for each of the first of `QUANTITIES`.
        base: The first columns of `BASE_COLUMNS`; None for none.
    """
    header = ["time", *_joint_columns(joint_names, QUANTITIES[: len(rows)])]
    table = np.column_stack([times, *rows])
    if base is not None:
        header, table = [*header, *BASE_COLUMNS[: base.shape[1]]], np.hstack([table, base])
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows([format(entry, ".17g") for entry in row] for row in table)


def read_csv(
    path: str | Path, joint_names: Sequence[str], ground: Terrain = PLANE
) -> tuple[Array, list[Array], UnicycleMotion | None]:
    """Read a motion in the format of `write_csv`.

    Columns may be in any order. Jerks may be left out and are zero then.

    Args:
        path: File to read.
        joint_names: Names of the n joints that the file must have, in any order.
        ground: Ground on which the base drives.

    Returns:
        Times (N+1,) [s]; one array (N+1, n) for each of `QUANTITIES` (the first four if
        accelerations are linear), joints in the order of `joint_names`; the motion of the base, or
        None if the file has none.

    Raises:
        ProblemError: The base leaves the map.
        TrajectoryError: The file cannot be read, lacks a column, has one twice or an unknown one,
            has an entry that is not a number, or has an inconsistent motion of the base.
    """
    header, entries = _read_rows(path)
    optional = [
        name for name in QUANTITIES[3:] if any(entry.endswith(f".{name}") for entry in header)
    ]
    joint_columns = _joint_columns(joint_names, (*QUANTITIES[:3], *optional))
    base_columns: list[str] = []
    if BASE_COLUMNS[0] in header:
        base_columns = [
            name for name in BASE_COLUMNS if name in header or not name.endswith("jerk")
        ]
    wanted = ["time", *joint_columns, *base_columns]
    _check_columns(path, header, wanted, joint_names)
    table = _numbers(path, entries, len(header))
    column_of = {name: table[:, header.index(name)] for name in wanted}
    absent = np.zeros(len(table))
    times = column_of["time"]
    rows = [
        np.column_stack([column_of.get(f"{joint}.{quantity}", absent) for joint in joint_names])
        for quantity in (QUANTITIES if set(CURVED) & set(optional) else QUANTITIES[:4])
    ]
    if not base_columns:
        return times, rows, None
    base_table = np.column_stack([column_of.get(name, absent) for name in BASE_COLUMNS])
    return times, rows, UnicycleMotion.from_table(times, base_table, ground)


def _joint_columns(joint_names: Sequence[str], quantities: Sequence[str]) -> list[str]:
    """Names of the columns of all joints."""
    return [f"{joint}.{quantity}" for quantity in quantities for joint in joint_names]


def _read_rows(path: str | Path) -> tuple[list[str], list[list[str]]]:
    """Header of a CSV file and its other rows as text, without empty lines."""
    try:
        with Path(path).open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as cause:
        raise TrajectoryError(f"cannot read {path}: {cause}") from None
    return ([name.strip() for name in rows[0]], rows[1:]) if rows else ([], [])


def _check_columns(
    path: str | Path, header: list[str], wanted: Sequence[str], joint_names: Sequence[str]
) -> None:
    """Raise TrajectoryError unless the header has each wanted column once and no other column."""
    for column in wanted:
        if header.count(column) != 1:
            raise TrajectoryError(
                f"{path}: column {column!r} must be there once, "
                f"but is there {header.count(column)} times"
            )
    for column in header:
        if column not in wanted:
            raise TrajectoryError(
                f"{path}: unknown column {column!r}; "
                f"the machine's joints are {', '.join(joint_names)}"
            )


def _numbers(path: str | Path, rows: list[list[str]], width: int) -> Array:
    """Rows of a CSV file as numbers, shape (len(rows), width)."""
    table = np.empty((len(rows), width))
    for number, row in enumerate(rows):
        try:
            if len(row) != width:
                raise ValueError(f"it has {len(row)} entries")
            table[number] = [float(entry) for entry in row]
        except ValueError as cause:
            raise TrajectoryError(
                f"{path}: row {number + 2} is not {width} numbers: {cause}"
            ) from None
    return table
