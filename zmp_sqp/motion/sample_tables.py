"""Samples from tables: CSV files of loggers, planners and spreadsheets, and NPZ files."""

from __future__ import annotations

import csv
import struct
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, shortened
from zmp_sqp.errors import TrajectoryError
from zmp_sqp.motion.sample_columns import Columns, read_header
from zmp_sqp.motion.samples import QUANTITIES, Samples
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.motion.unicycle_motion import BASE_COLUMNS

__all__ = ["read_csv_samples", "read_npz_samples", "write_npz"]

SEPARATORS = (",", ";", "\t")
LEAST_DECIMALS, MOST_DECIMALS = 3, 12  # of numbers that count as rounded
# names of arrays in NPZ files, by quantity
ARRAYS = {
    "position": "positions",
    "velocity": "velocities",
    "acceleration": "accelerations",
    "jerk": "jerks",
    "snap": "snaps",
    "crackle": "crackles",
}


def read_csv_samples(path: Path, joint_names: Sequence[str], joint_units: Sequence[str]) -> Samples:
    """Samples of a CSV file with one row per time.

    The first row names the columns: `time` (or t, timestamp, ...), and `JOINT.position`,
    `JOINT.velocity`, `JOINT.acceleration` (or JOINT alone, JOINT_pos, vel_JOINT, ...), in any
    order, in SI units unless a unit follows the name: `slew.position [deg]`, `time [ms]`. Other
    columns are ignored. Entries are separated by commas, semicolons or tabs. Where they are not
    separated by commas, and no entry has a point, numbers may have a decimal comma.

    Raises:
        TrajectoryError: The file cannot be read or is no such table; the message names file, row
            and column.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as cause:
        raise TrajectoryError(f"cannot read {path}: {cause}") from None
    first = next((line for line in text.splitlines() if line.strip()), "")
    separator = max(SEPARATORS, key=first.count)
    try:
        reader = csv.reader(text.splitlines(), delimiter=separator)
        rows = [(reader.line_num, row) for row in reader if any(entry.strip() for entry in row)]
    except csv.Error as cause:
        raise TrajectoryError(f"cannot read {path}: {cause}") from None
    header = [name.strip() for name in rows[0][1]] if rows else []
    columns = read_header(str(path), header, joint_names, joint_units)
    has_point = any("." in entry for _, row in rows[1:] for entry in row)
    comma = "," if has_point or separator == "," else "."  # what a comma in a number becomes
    used = [columns.time, *(i for of in columns.joints.values() for i in of), *columns.base]
    table = np.zeros((len(rows) - 1, len(header)))
    for number, (line, row) in enumerate(rows[1:]):
        if len(row) != len(header):
            raise TrajectoryError(
                f"{path}: row {line} has {len(row)} entries, but the header names {len(header)} "
                "columns"
            )
        for index in used:
            if index >= 0:
                entry = row[index].replace(",", comma)
                table[number, index] = _number(entry, f"{path}: row {line}", header[index])
    names = tuple(f"row {line}" for line, _ in rows[1:])
    return _samples(str(path), tuple(joint_names), names, table, columns)


def _number(entry: str, where: str, column: str) -> float:
    """Entry of a table as a number; NaN and infinity are refused where all samples are checked."""
    try:
        if "_" in entry:  # float() would take 1_0 for 10
            raise ValueError
        return float(entry)
    except ValueError:
        raise TrajectoryError(
            f"{where}, column {column!r}: {shortened(entry.strip())} is not a number"
        ) from None


def _samples(
    source: str, joint_names: tuple[str, ...], rows: tuple[str, ...], table: Array, columns: Columns
) -> Samples:
    """Samples from the numbers of a table, its units converted."""
    values = {
        quantity: table[:, of] * np.array(columns.factors[quantity])
        for quantity, of in columns.joints.items()
    }
    rounding = {
        quantity: rounding_of(table[:, of]) * max(columns.factors[quantity])
        for quantity, of in columns.joints.items()
    }
    times = table[:, columns.time]
    rounding["time"] = rounding_of(times) * columns.time_unit
    base = None
    if columns.base:
        if lacking := [
            name
            for name, index in zip(BASE_COLUMNS, columns.base, strict=True)
            if index < 0 and not name.endswith("jerk")
        ]:
            raise TrajectoryError(
                f"{source}: there is no column {lacking[0]!r}; a base that moves needs "
                f"{', '.join(BASE_COLUMNS[:7])}"
            )
        base = np.column_stack(
            [table[:, i] if i >= 0 else np.zeros(len(table)) for i in columns.base]
        ) * np.array(columns.base_factors)
    return Samples(
        source,
        joint_names,
        rows,
        times * columns.time_unit,
        values,
        base,
        columns.ignored,
        rounding,
        any(
            factor != 1.0
            for of in (*columns.factors.values(), columns.base_factors)
            for factor in of
        ),
    )


def rounding_of(values: Array) -> float:
    """Largest rounding error of numbers, by the digits with which they can be written.

    It is half a unit of the last decimal place that any of them needs, from the third to the
    twelfth, or else the rounding error of a float of single or double precision: numbers with fewer
    digits are taken for exact.
    """
    flat = values.ravel()
    flat = flat[np.isfinite(flat)]
    largest = float(np.abs(flat).max(initial=0.0))
    full = 0.5 * float(np.finfo(np.float64).eps) * largest
    for decimals in range(MOST_DECIMALS + 1):
        if (np.abs(flat - np.round(flat, decimals)) <= 4.0 * full).all():
            return full if decimals < LEAST_DECIMALS else max(0.5 * 10.0**-decimals, full)
    with np.errstate(over="ignore"):
        single = (flat.astype(np.float32) == flat).all()
    return 0.5 * float(np.finfo(np.float32).eps) * largest if single else full


def read_npz_samples(path: Path, joint_names: Sequence[str]) -> Samples:
    """Samples of a NPZ file: `times`, `positions`, `velocities`, ..., and `joint_names`.

    Raises:
        TrajectoryError: The file cannot be read, lacks an array, or has one of the wrong shape.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            arrays: dict[str, Any] = {name: file[name] for name in file.files}
    except (
        OSError,
        ValueError,
        EOFError,
        zipfile.BadZipFile,
        AttributeError,
        TypeError,
        KeyError,
        NotImplementedError,  # raised by zipfile for a compression that it does not know
        zlib.error,
        struct.error,
    ) as cause:
        raise TrajectoryError(f"cannot read {path}: {' '.join(str(cause).split())}") from None
    for name in ("times", "joint_names", "positions"):
        if name not in arrays:
            known = ", ".join(sorted(arrays)) or "none"
            raise TrajectoryError(f"{path}: there is no array {name!r}; arrays are {known}")
    names = [str(name) for name in np.atleast_1d(arrays["joint_names"]).ravel()]
    order = joint_order(str(path), names, joint_names)
    count = len(_numeric(path, "times", arrays["times"], (None,)))
    times = _numeric(path, "times", arrays["times"], (count,))
    values = {
        quantity: _numeric(path, name, arrays[name], (count, len(names)))[:, order]
        for quantity, name in ARRAYS.items()
        if name in arrays
    }
    base = None
    if "base" in arrays:
        base = _numeric(path, "base", arrays["base"], (count, len(BASE_COLUMNS)))
    rounding = {quantity: rounding_of(of) for quantity, of in values.items()}
    rounding["time"] = rounding_of(times)
    known_arrays = {"times", "joint_names", "base", "interpolation", *ARRAYS.values()}
    extra = tuple(name for name in arrays if name not in known_arrays)
    ignored = (*extra, *(name for name in names if name not in joint_names))
    rows = tuple(f"sample {i}" for i in range(count))
    return Samples(str(path), tuple(joint_names), rows, times, values, base, ignored, rounding)


def write_npz(path: Path, trajectory: Trajectory) -> None:
    """Write a motion as NPZ, every bit of it, with the names of `ARRAYS`."""
    rows = dict(zip(QUANTITIES, trajectory.node_rows(), strict=False))
    arrays: dict[str, Any] = {ARRAYS[quantity]: part for quantity, part in rows.items()}
    if trajectory.base is not None:
        arrays["base"] = trajectory.base.table()
    names = np.array(trajectory.joint_names)
    with path.open("wb") as file:  # a path would get the ending .npz
        np.savez(file, joint_names=names, times=trajectory.times, **arrays)


def joint_order(source: str, names: Sequence[str], joint_names: Sequence[str]) -> list[int]:
    """Index of each joint of the machine among the names of a file.

    Raises:
        TrajectoryError: A joint is missing, or named twice.
    """
    for joint in joint_names:
        if names.count(joint) != 1:
            raise TrajectoryError(
                f"{source}: joint {joint!r} must be there once, but is there {names.count(joint)} "
                f"times; joint_names are {', '.join(names)}"
            )
    return [names.index(joint) for joint in joint_names]


def _numeric(path: Path, name: str, array: Any, shape: tuple[int | None, ...]) -> Array:
    """Array of a file as floats, after a check of kind and shape."""
    if array.dtype.kind not in "iuf" or array.ndim != len(shape):
        raise TrajectoryError(
            f"{path}: {name} must be numbers in {len(shape)} dimensions, not {array.dtype} in "
            f"{array.ndim}"
        )
    for want, have in zip(shape, array.shape, strict=True):
        if want not in (None, have):
            raise TrajectoryError(f"{path}: {name} must have shape {shape}, not {array.shape}")
    return np.array(array, dtype=np.float64)
