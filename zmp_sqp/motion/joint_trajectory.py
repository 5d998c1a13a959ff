"""Motions as ROS messages trajectory_msgs/JointTrajectory, in YAML, JSON and NumPy.

The ROS 2 joint_trajectory_controller plays a cubic between two points with positions and
velocities, and a quintic if they have accelerations too. The pieces of a planned motion are cubics,
so that points with positions and velocities at its nodes are played as planned.

What the controller does beyond that: it adds a piece from the current state to the first point, so
that a first point at time 0 must be where the machine stands (some drivers refuse it: drop it
then); it compares the velocity at the goal with a tolerance; and a new trajectory replaces the old
one without blending.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array, shortened
from zmp_sqp.errors import TrajectoryError
from zmp_sqp.motion.sample_tables import joint_order, rounding_of
from zmp_sqp.motion.samples import Samples
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.motion.unicycle_motion import BASE_COLUMNS

__all__ = ["message_of", "read_message_samples", "samples_of_message", "write_message"]

FIELDS = {
    "position": "positions",
    "velocity": "velocities",
    "acceleration": "accelerations",
    "jerk": "jerks",
    "snap": "snaps",
    "crackle": "crackles",
}
BASE_FIELDS = tuple(name.removeprefix("base.") for name in BASE_COLUMNS)
NESTED = ("joint_trajectory", "trajectory")  # keys of messages that hold the trajectory
NANO = 1e-9
STAMP_TOLERANCE = 2e-9  # [relative to 1 s + |time|] between `time` and `time_from_start`


def message_of(trajectory: Trajectory) -> tuple[dict[str, Any], str]:
    """Message for a controller, and the interpolation it is made for, "cubic" or "quintic".

    Points are at the nodes, their times rounded to nanoseconds; positions and velocities are those
    of the motion at the rounded times. Accelerations are given only for motions of quintics.

    Raises:
        TrajectoryError: The base moves, or two nodes fall on one nanosecond.
    """
    if trajectory.base is not None:
        raise TrajectoryError(
            "a JointTrajectory has no place for a base that drives: export CSV or NPZ"
        )
    stamps = np.round(trajectory.times / NANO).astype(np.int64)
    if (np.diff(stamps) <= 0).any():
        raise TrajectoryError("nodes are less than a nanosecond apart: ROS cannot tell them apart")
    # [s] as they will be read; the last one may lie beyond the end by rounding
    states = trajectory(np.minimum(stamps * NANO, trajectory.duration))
    curved = trajectory.snaps is not None
    names = list(FIELDS.values())[: 3 if curved else 2]
    columns = [part.tolist() for part in states[: len(names)]]
    points = [
        dict(zip(names, row, strict=True))
        | {"time_from_start": dict(zip(("sec", "nanosec"), divmod(stamp, 10**9), strict=True))}
        for stamp, *row in zip(stamps.tolist(), *columns, strict=True)
    ]
    message = {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": list(trajectory.joint_names),
        "points": points,
    }
    return message, "quintic" if curved else "cubic"


def write_message(path: Path, trajectory: Trajectory) -> str:
    """Write a motion as YAML or JSON by the ending of the path; returns the interpolation.

    YAML says in a comment which interpolation the file is made for, JSON under the key
    "interpolation", which a strict reader of messages may want removed.
    """
    import yaml

    message, rule = message_of(trajectory)
    if path.suffix.lower() == ".json":
        text = json.dumps(message | {"interpolation": rule}, indent=1, allow_nan=False) + "\n"
    else:
        note = (
            f"# trajectory_msgs/JointTrajectory, made for {rule} interpolation: what a ROS 2\n"
            f"# joint_trajectory_controller plays between these points is the planned motion.\n"
        )
        text = note + yaml.safe_dump(message, sort_keys=False, default_flow_style=None, width=1000)
    path.write_text(text, encoding="utf-8")
    return rule


def read_message_samples(path: Path, joint_names: Sequence[str]) -> tuple[Samples, str | None]:
    """Samples of a JointTrajectory in a YAML or JSON file, and the interpolation it names, or None.

    A message inside another one (`joint_trajectory` of a RobotTrajectory) is found too.

    Raises:
        TrajectoryError: The file cannot be read, or is no such message.
    """
    import yaml

    try:
        text = path.read_text(encoding="utf-8")
        if path.suffix.lower() == ".json":
            content = json.loads(text)
        else:
            loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
            content = next(iter(yaml.load_all(text, Loader=loader)), None)
    # ValueError: not JSON, not UTF-8, or an integer with more digits than Python converts
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as cause:
        raise TrajectoryError(f"cannot read {path}: {' '.join(str(cause).split())}") from None
    for key in NESTED:
        if isinstance(content, dict) and isinstance(content.get(key), dict):
            content = content[key]
    if not isinstance(content, dict) or not isinstance(content.get("points"), list):
        raise TrajectoryError(f"{path}: must be an object with joint_names and a list of points")
    rule = content.get("interpolation")
    samples = samples_of_message(str(path), content, joint_names)
    return samples, rule if rule in ("cubic", "quintic") else None


def samples_of_message(
    source: str, message: Mapping[str, Any], joint_names: Sequence[str]
) -> Samples:
    """Samples of a JointTrajectory message.

    Args:
        source: Path of the file, for messages.
        message: With `joint_names` and `points`.
        joint_names: Names of the joints that must be there.

    Raises:
        TrajectoryError: A joint is missing, or a field is missing or wrong at a point.
    """
    names, points = message.get("joint_names"), message["points"]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise TrajectoryError(
            f"{source}: joint_names must be a list of names, not {shortened(names)}"
        )
    order = joint_order(source, names, joint_names)
    for number, point in enumerate(points):
        if not isinstance(point, dict):
            raise TrajectoryError(
                f"{source}: point {number} must be an object, not {shortened(point)}"
            )
    rows = tuple(f"point {number}" for number in range(len(points)))
    times = np.array(
        [_time(point, f"{source}: {row}") for row, point in zip(rows, points, strict=True)]
    )
    values = {}
    for quantity, field in FIELDS.items():
        if any(_given(point, field) for point in points) or quantity == "position":
            values[quantity] = _column(points, field, len(names), source)[:, order]
    rounding = {quantity: rounding_of(part) for quantity, part in values.items()}
    rounding["time"] = rounding_of(times)
    ignored = tuple(name for name in names if name not in joint_names)
    base = _base(points, source)
    return Samples(source, tuple(joint_names), rows, times, values, base, ignored, rounding)


def _given(point: Mapping[str, Any], field: str) -> bool:
    """Whether a point has a field; ROS leaves it empty where it has none."""
    return point.get(field) not in (None, [])


def _column(points: Sequence[Mapping[str, Any]], field: str, size: int, source: str) -> Array:
    """Values of one field at all points, shape (K, size)."""
    rows = []
    for number, point in enumerate(points):
        where = f"{source}: point {number}: {field}"
        if not _given(point, field):
            raise TrajectoryError(
                f"{where} must be {size} numbers; {field} must be there at all points or at none"
            )
        rows.append(frozen_array(point[field], name=where, shape=(size,), error=TrajectoryError))
    return np.array(rows).reshape(len(points), size)


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
        finite_number(
            stamp.get(key, stamp.get(old)),
            name=f"{where}: time_from_start {key}",
            error=TrajectoryError,
        )
        for key, old in (("sec", "secs"), ("nanosec", "nsecs"))
    )
    rounded = seconds + NANO * nanoseconds
    if exact is not None and abs(exact - rounded) > STAMP_TOLERANCE * (1.0 + abs(exact)):
        raise TrajectoryError(f"{where}: time says {exact} s, but time_from_start {rounded} s")
    return rounded if exact is None else exact


def _base(points: Sequence[Mapping[str, Any]], source: str) -> Array | None:
    """Base motion of a file that `Trajectory.to_json` wrote, shape (K, 9); None without one."""
    having = [isinstance(point.get("base"), dict) for point in points]
    if not any("base" in point for point in points):
        return None
    if not all(having):
        raise TrajectoryError(f"{source}: base must be an object at every point, or at none")
    return np.array(
        [
            [
                finite_number(
                    point["base"].get(field, 0.0 if field.endswith("jerk") else None),
                    name=f"{source}: point {number}: base {field}",
                    error=TrajectoryError,
                )
                for field in BASE_FIELDS
            ]
            for number, point in enumerate(points)
        ]
    )
