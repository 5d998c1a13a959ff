"""Motions as JSON: the fields of ROS's trajectory_msgs/JointTrajectory, and what it lacks beside them."""

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

__all__ = ["read_json", "write_json"]

FIELDS = ("positions", "velocities", "accelerations", "jerks")  # the last is ours
BASE_FIELDS = tuple(name.removeprefix("base.") for name in BASE_COLUMNS)
STAMP = 2e-9  # [s, relative above one] by which nanoseconds may be off
MAY_BE_ABSENT = ("jerks", "jerk", "yaw_jerk")  # zero then


def write_json(
    path: str | Path,
    joint_names: Sequence[str],
    times: Array,
    rows: Sequence[Array],
    base: UnicycleMotion | None,
) -> None:
    """One point per node: `FIELDS`, time_from_start as sec and nanosec, time [s] to the last digit, and `base`.

    Args:
        path: File to write.
        joint_names: The n joints.
        times: Nodes, shape (N+1,) [s].
        rows: One array (N+1, n) for each of `FIELDS`.
        base: Its columns by name at every point; None leaves them out.
    """
    points = []
    for time, *entries in zip(times.tolist(), *(row.tolist() for row in rows), strict=True):
        seconds, nanoseconds = divmod(round(time * 1e9), 1_000_000_000)
        point: dict[str, Any] = dict(zip(FIELDS, entries, strict=True))
        point["time_from_start"] = {"sec": seconds, "nanosec": nanoseconds}
        point["time"] = time
        points.append(point)
    if base is not None:
        for point, entries in zip(points, base.table().tolist(), strict=True):
            point["base"] = dict(zip(BASE_FIELDS, entries, strict=True))
    text = json.dumps(
        {"joint_names": list(joint_names), "points": points}, indent=1, allow_nan=False
    )
    Path(path).write_text(text + "\n", encoding="utf-8")


def read_json(
    path: str | Path, joint_names: Sequence[str], ground: Terrain = PLANE
) -> tuple[Array, list[Array], UnicycleMotion | None]:
    """Times (N+1,), one array (N+1, n) for each of `FIELDS` in the order of the joints, and the base's motion.

    Args:
        path: A file as `write_json` writes it, or a JointTrajectory as JSON; jerks may be left out
            (zero), and `time`, in whose place time_from_start is taken. Fields that are not known
            are passed over.
        joint_names: The joints that the file must have, in any order.
        ground: What the base drives on.

    Raises:
        TrajectoryError: The file cannot be read, is no such object, has other joints, or an entry
            is no finite number; the message names the point and the field.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    # ValueError: no JSON, no UTF-8, numbers of 5000 digits
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
            f"{path}: joint_names are {', '.join(names)}, but the machine's joints are {', '.join(joint_names)}"
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
    rows = [_column(points, field, len(names), str(path))[:, order] for field in FIELDS]
    with_base = ["base" in point for point in points]
    if not any(with_base):
        return times, rows, None
    if not all(with_base) or not all(isinstance(point["base"], dict) for point in points):
        raise TrajectoryError(f"{path}: base must be an object at every point, or at none")
    table = [
        [_entry(point["base"], field, f"{path}: point {i}: base ") for field in BASE_FIELDS]
        for i, point in enumerate(points)
    ]
    return times, rows, UnicycleMotion.from_table(times, np.array(table), ground)


def _time(point: Mapping[str, Any], where: str) -> float:
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
    if exact is not None and abs(exact - rounded) > STAMP * (1.0 + abs(exact)):
        raise TrajectoryError(f"{where}: time says {exact} s, but time_from_start {rounded} s")
    return rounded if exact is None else exact


def _column(points: Sequence[Mapping[str, Any]], field: str, size: int, path: str) -> Array:
    """One field of all points, shape (N+1, size)."""
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
    if key in MAY_BE_ABSENT and key not in table:
        return 0.0
    return finite_number(table.get(key), name=f"{where}{key}", error=TrajectoryError)
