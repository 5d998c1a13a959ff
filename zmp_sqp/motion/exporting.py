"""Motions as files for other programs."""

from __future__ import annotations

from pathlib import Path

from zmp_sqp.errors import TrajectoryError
from zmp_sqp.motion.bag import check_rosbags, write_bag
from zmp_sqp.motion.joint_trajectory import write_message
from zmp_sqp.motion.reading import EXACT, SUFFIXES
from zmp_sqp.motion.sample_tables import write_npz
from zmp_sqp.motion.trajectory import Trajectory

__all__ = ["check_export", "export_motion"]


def export_motion(trajectory: Trajectory, path: str | Path) -> str:
    """Write a motion in the format that the ending of a path names.

    - `.csv` and `.npz` hold all of it: `read_motion` restores every bit.
    - `.yaml`, `.json` and `.mcap` (a ROS 2 bag; needs rosbags) hold a trajectory_msgs/
      JointTrajectory with positions and velocities at all nodes and no accelerations. Between its
      points a ROS joint_trajectory_controller plays cubics, which are the pieces of this motion.
      Times are rounded to nanoseconds, positions and velocities are those at the rounded times.

    Before a bag or message is played, see `zmp_sqp.motion.joint_trajectory` on first points at time
    0 and on goal velocities.

    Args:
        trajectory: The motion.
        path: File to write; one that is there is replaced.

    Returns:
        Interpolation that the file is made for: "exact", "cubic", or "quintic" for motions that
        were read as quintics.

    Raises:
        MissingExtra: The file is a bag and rosbags is not there.
        TrajectoryError: Another ending, or the base drives and the format has no place for it.
        OSError: The file cannot be written.
    """
    file = Path(path)
    suffix = check_export(file, drives=trajectory.base is not None)
    if suffix == ".csv":
        trajectory.to_csv(file)
        return EXACT
    if suffix == ".npz":
        write_npz(file, trajectory)
        return EXACT
    return write_bag(file, trajectory) if suffix == ".mcap" else write_message(file, trajectory)


def check_export(path: Path, *, drives: bool) -> str:
    """Refuse a file to which `export_motion` cannot write; returns its ending in small letters.

    Args:
        path: File to write.
        drives: Whether the base drives.

    Raises:
        MissingExtra, TrajectoryError: See `export_motion`.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise TrajectoryError(
            f"{path}: a motion is exported to a file that ends in {', '.join(SUFFIXES)}, not in "
            f"{suffix or 'nothing'}"
        )
    if drives and suffix not in (".csv", ".npz"):
        raise TrajectoryError(
            f"{path}: a JointTrajectory has no place for a base that drives: export .csv or .npz"
        )
    if suffix == ".mcap":
        check_rosbags()
    return suffix
