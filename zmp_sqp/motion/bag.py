"""Motions in ROS 2 bags: one trajectory_msgs/JointTrajectory in a MCAP file, through rosbags."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from zmp_sqp.errors import MissingExtra, TrajectoryError
from zmp_sqp.motion.joint_trajectory import message_of, samples_of_message
from zmp_sqp.motion.samples import Samples
from zmp_sqp.motion.trajectory import Trajectory

__all__ = ["TOPIC", "check_rosbags", "read_bag_samples", "write_bag"]

TYPE = "trajectory_msgs/msg/JointTrajectory"
TOPIC = "/joint_trajectory_controller/joint_trajectory"  # what the controller listens to
BAG_VERSION = 9
FIELDS = ("positions", "velocities", "accelerations")


def write_bag(path: Path, trajectory: Trajectory) -> str:
    """Write a motion as one message of the topic `TOPIC`; returns the interpolation.

    The bag's metadata hold the interpolation under the key "interpolation".

    Raises:
        MissingExtra: rosbags is not there.
        TrajectoryError: See `message_of`.
    """
    rosbag2, typesys = _rosbags()
    message, rule = message_of(trajectory)
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    ros = _to_ros(message, store.types)
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        writer = rosbag2.Writer(bag, version=BAG_VERSION, storage_plugin=rosbag2.StoragePlugin.MCAP)
        writer.set_custom_data("interpolation", rule)
        with writer:
            connection = writer.add_connection(TOPIC, TYPE, typestore=store)
            writer.write(connection, 0, store.serialize_cdr(ros, TYPE))
        shutil.move(next(bag.glob("*.mcap")), path)
    return rule


def read_bag_samples(path: Path, joint_names: Sequence[str]) -> Samples:
    """Samples of the only JointTrajectory in a MCAP file or the folder of a ROS 2 bag.

    Raises:
        MissingExtra: rosbags is not there.
        TrajectoryError: The file cannot be read, or has no such message, or several.
    """
    _rosbags()
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.serde import SerdeError

    found = []
    try:
        with AnyReader([path]) as reader:
            connections = [one for one in reader.connections if one.msgtype == TYPE]
            for connection, _, data in reader.messages(connections=connections):
                found.append(reader.deserialize(data, connection.msgtype))
    except (AnyReaderError, SerdeError, OSError, ValueError, KeyError, EOFError) as cause:
        raise TrajectoryError(f"cannot read {path}: {' '.join(str(cause).split())}") from None
    except Exception as cause:  # rosbags has no common base of its errors, and asserts on input
        raise TrajectoryError(
            f"cannot read {path}: it is no bag ({type(cause).__name__})"
        ) from None
    if len(found) != 1:
        raise TrajectoryError(
            f"{path}: must hold one message of the type {TYPE}, but holds {len(found)}"
        )
    return samples_of_message(str(path), _from_ros(found[0]), joint_names)


def check_rosbags() -> None:
    """Raise MissingExtra if rosbags is not there."""
    _rosbags()


def _rosbags() -> tuple[Any, Any]:
    """Modules of rosbags.

    Raises:
        MissingExtra: They are not there.
    """
    try:
        from rosbags import rosbag2, typesys
    except ImportError:
        raise MissingExtra("bags need rosbags, which `pip install zmp-sqp[ros]` brings") from None
    return rosbag2, typesys


def _to_ros(message: dict[str, Any], types: Any) -> Any:
    """Message of rosbags from a mapping."""
    import numpy as np

    def duration(stamp: dict[str, int]) -> Any:
        return types["builtin_interfaces/msg/Duration"](**stamp)

    points = [
        types["trajectory_msgs/msg/JointTrajectoryPoint"](
            *(np.array(point.get(field, []), dtype=np.float64) for field in FIELDS),
            effort=np.zeros(0),
            time_from_start=duration(point["time_from_start"]),
        )
        for point in message["points"]
    ]
    time = types["builtin_interfaces/msg/Time"](**message["header"]["stamp"])
    header = types["std_msgs/msg/Header"](stamp=time, frame_id="")
    return types[TYPE](header, message["joint_names"], points)


def _from_ros(message: Any) -> dict[str, Any]:
    """Mapping from a message of rosbags."""
    points = [
        {field: getattr(point, field).tolist() for field in FIELDS}
        | {
            "time_from_start": {
                "sec": int(point.time_from_start.sec),
                "nanosec": int(point.time_from_start.nanosec),
            }
        }
        for point in message.points
    ]
    return {"joint_names": list(message.joint_names), "points": points}
