"""Option of a command that writes its motion for other programs."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from zmp_sqp.motion.exporting import check_export, export_motion
from zmp_sqp.motion.reading import EXACT, SUFFIXES
from zmp_sqp.planning import Trajectory

__all__ = ["add_export_option", "check_exports", "write_exports"]


def add_export_option(command: argparse.ArgumentParser) -> None:
    """Add `--export FILE`, which may be given several times."""
    command.add_argument(
        "--export",
        dest="exports",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help=f"write the motion in the format of this ending: {', '.join(SUFFIXES)}; "
        ".csv and .npz hold all of it; .json, .yaml and .mcap are ROS 2 JointTrajectory messages "
        "with positions and velocities, which the joint_trajectory_controller plays as planned "
        "(.mcap needs rosbags); may be given several times",
    )


def check_exports(paths: Sequence[Path], *, drives: bool) -> None:
    """Refuse files that could not be written later; files of an earlier run are removed.

    Args:
        paths: Values of `--export`.
        drives: Whether the base drives.

    Raises:
        MissingExtra, TrajectoryError: See `export_motion`.
        OSError: A folder cannot be made, or a file in it cannot be removed.
    """
    for path in paths:
        check_export(path, drives=drives)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)


def write_exports(paths: Sequence[Path], trajectory: Trajectory) -> Iterator[str]:
    """Write the files one by one; yields a line about each."""
    for path in paths:
        rule = export_motion(trajectory, path)
        made_for = "" if rule == EXACT else f", made for {rule} interpolation"
        yield f"wrote {path}{made_for}"
