"""Motions of arm and base as functions of time, and their file formats."""

from typing import TYPE_CHECKING

from zmp_sqp.lazy import at_first_use
from zmp_sqp.motion.root_motion import trajectory_zmp
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.motion.unicycle_motion import UnicycleMotion

if TYPE_CHECKING:
    from zmp_sqp.motion.exporting import export_motion
    from zmp_sqp.motion.reading import RecordedMotion, read_motion
else:
    __getattr__, __dir__ = at_first_use(
        __name__,
        {
            "zmp_sqp.motion.exporting": "export_motion",
            "zmp_sqp.motion.reading": "RecordedMotion read_motion",
        },
    )

__all__ = [
    "RecordedMotion",
    "Trajectory",
    "UnicycleMotion",
    "export_motion",
    "read_motion",
    "trajectory_zmp",
]
