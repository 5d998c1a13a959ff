"""Motions as JSON files: the fields of ROS's trajectory_msgs/JointTrajectory and some more."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array, shortened
from zmp_sqp.errors import TrajectoryError
from zmp_sqp.mechanics.ground import Terrain
from zmp_sqp.motion.unicycle_motion import BASE_COLUMNS, PLANE, UnicycleMotion

__all__ = ["json_content", "read_json", "write_json"]

# of a point; ROS has the first three, and only motions with curved accelerations have the last two
FIELDS = ("positions", "velocities", "accelerations", "jerks", "snaps", "crackles")
MADE_FOR = (
    "piecewise polynomials of zmp_sqp: with these accelerations a ROS joint_trajectory_controller "
    "plays quintics, which is another motion; zmp_sqp.export_motion writes what it plays as planned"
)
BASE_FIELDS = tuple(name.removeprefix("base.") for name in BASE_COLUMNS)
# largest difference between `time` and `time_from_start`, which is rounded to nanoseconds, relative
# to 1 s + |time|
STAMP_TOLERANCE = 2e-9
MAY_BE_ABSENT = (*FIELDS[3:], "jerk", "yaw_jerk")  # fields that may be left out and are zero then


def json_content(
    joint_names: Sequence[str], times: Array, rows: Sequence[Array], base: UnicycleMotion | None
) -> dict[str, Any]:
    """Motion as an object for JSON, one point per node.

    A point has `FIELDS`, `time_from_start` (sec and nanosec, as in ROS), `time` in full precision
    [s], and `base` if the base moves.

    Args:
        joint_names: Names of the n joints.
        times: Nodes, shape (N+1,) [s].
        rows: One array (N+1, n) for each of `FIELDS`, or for the first four of them.
        base: Motion of the base, written as an object with the keys `BASE_FIELDS`; None writes no
            such object.
    """
    points = []
    for time, *entries in zip(times.tolist(), *(row.tolist() for row in rows), strict=True):
        seconds, nanoseconds = divmod(round(time * 1e9), 1_000_000_000)
        point: dict[str, Any] = dict(zip(FIELDS, entries, strict=False))
        point["time_from_start"] = {"sec": seconds, "nanosec": nanoseconds}
        point["time"] = time
        points.append(point)
    if base is not None:
        for point, entries in zip(points, base.table().tolist(), strict=True):
            point["base"] = dict(zip(BASE_FIELDS, entries, strict=True))
    return {"joint_names": list(joint_names), "points": points, "made_for": MADE_FOR}


def write_json(
    path: str | Path,
    joint_names: Sequence[str],
    times: Array,
    rows: Sequence[Array],
    base: UnicycleMotion | None,
) -> None:
    """Write a motion as the object of `json_content`.

    Args:
        path: File to write.
        joint_names, times, rows, base: Arguments of `json_content`.
    """
    text = json.dumps(json_content(joint_names, times, rows, base), indent=1, allow_nan=False)
    Path(path).write_text(text + "\n", encoding="utf-8")


def read_json(
    path: str | Path, joint_names: Sequence[str], ground: Terrain = PLANE
) -> tuple[Array, list[Array], UnicycleMotion | None]:
    """Read a motion in the format of `write_json`, or a JointTrajectory message as JSON.

    Jerks may be left out and are zero then. `time` may be left out; `time_from_start` replaces it.
    Unknown fields are ignored.

    Args:
        path: File to read.
        joint_names: Names of the n joints that the file must have, in any order.
        ground: Ground on which the base drives.

    Returns:
        Times (N+1,) [s]; one array (N+1, n) for each of `FIELDS` (the first four if accelerations
        are linear), joints in the order of `joint_names`; the motion of the base, or None if the
        file has none.

    Raises:
        ProblemError: The base leaves the map.
        TrajectoryError: The file cannot be read, is not such an object, has other joints, has an
            entry that is not a finite number, or has an inconsistent motion of the base; the
            message names the point and the field.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    # ValueError: not JSON, not UTF-8, or an integer with more digits than Python converts
    except (OSError, ValueError, RecursionError) as cause:
        raise TrajectoryError(f"cannot read {path}: {' '.join(str(cause).split())}") from None
    if not isinstance(content, dict) or not isinstance(content.get("points"), list):
        raise TrajectoryError(f"{path}: must be an object with joint_names and a list of points")
    points, names = content["points"], content.get("joint_names")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise TrajectoryError(
            f"{path}: joint_names must be a list of names, not {shortened(names)}"
        )
    if sorted(names) != sorted(joint_names):
        raise TrajectoryError(
            f"{path}: joint_names are {', '.join(names)}, but the machine's joints are "
            f"{', '.join(joint_names)}"
        )
    order = [names.index(name) for name in joint_names]
    for number, point in enumerate(points):
        if not isinstance(point, dict):
            raise TrajectoryError(
                f"{path}: point {number} must be an object, not {shortened(point)}"
            )
    times = np.array(
        [_time(point, f"{path}: point {number}") for number, point in enumerate(points)]
    )
    curved = any(field in point for point in points for field in FIELDS[4:])
    fields = FIELDS if curved else FIELDS[:4]
    rows = [_column(points, field, len(names), str(path))[:, order] for field in fields]
    return times, rows, _base(points, times, str(path), ground)


def _base(
    points: Sequence[Mapping[str, Any]], times: Array, path: str, ground: Terrain
) -> UnicycleMotion | None:
    """Motion of the base, or None if no point has one."""
    with_base = ["base" in point for point in points]
    if not any(with_base):
        return None
    if not all(with_base) or not all(isinstance(point["base"], dict) for point in points):
        raise TrajectoryError(f"{path}: base must be an object at every point, or at none")
    table = [
        [_entry(point["base"], field, f"{path}: point {i}: base ") for field in BASE_FIELDS]
        for i, point in enumerate(points)
    ]
    return UnicycleMotion.from_table(times, np.array(table), ground)


def _time(point: Mapping[str, Any], where: str) -> float:
    """Time of a point from `time`, or else from `time_from_start` [s]; both must agree."""
    exact = None
    if "time" in point:
        exact = finite_number(point["time"], name=f"{where}: time", error=TrajectoryError)
    stamp = point.get("time_from_start")
    if exact is not None and stamp is None:
        return exact
    if not isinstance(stamp, dict):
        raise TrajectoryError(f"{where}: time_from_start must be an object with sec and nanosec")
    seconds, nanoseconds = (
        _entry(stamp, key, f"{where}: time_from_start ") for key in ("sec", "nanosec")
    )
    rounded = seconds + 1e-9 * nanoseconds
    if exact is not None and abs(exact - rounded) > STAMP_TOLERANCE * (1.0 + abs(exact)):
        raise TrajectoryError(f"{where}: time says {exact} s, but time_from_start {rounded} s")
    return rounded if exact is None else exact


def _column(points: Sequence[Mapping[str, Any]], field: str, size: int, path: str) -> Array:
    """Values of one field at all points, shape (N+1, size)."""
    if field in MAY_BE_ABSENT and not any(field in point for point in points):
        return np.zeros((len(points), size))
    rows = [
        frozen_array(
            point.get(field),
            name=f"{path}: point {number}: {field}",
            shape=(size,),
            error=TrajectoryError,
        )
        for number, point in enumerate(points)
    ]
    return np.array(rows).reshape(len(points), size)


def _entry(table: Mapping[str, Any], key: str, where: str) -> float:
    """Finite number under a key; zero if the key is absent and may be."""
    if key in MAY_BE_ABSENT and key not in table:
        return 0.0
    return finite_number(table.get(key), name=f"{where}{key}", error=TrajectoryError)
