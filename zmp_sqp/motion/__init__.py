"""Motions of arm and base as functions of time, and their file formats."""

from zmp_sqp.motion.exporting import export_motion
from zmp_sqp.motion.reading import RecordedMotion, read_motion
from zmp_sqp.motion.root_motion import trajectory_zmp
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.motion.unicycle_motion import UnicycleMotion

__all__ = [
    "RecordedMotion",
    "Trajectory",
    "UnicycleMotion",
    "export_motion",
    "read_motion",
    "trajectory_zmp",
]
