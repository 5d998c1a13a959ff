"""Checks of a motion before it is certified, and the reason why it cannot be."""

from __future__ import annotations

import numpy as np

from zmp_sqp.errors import GIVE_SUPPORT, MachineError, ProblemError, TrajectoryError
from zmp_sqp.mechanics.ground import Ground, check_ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.consistency import drift_fault
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.proof.corner_motion import CornerMotion

__all__ = ["check_arguments", "check_drift", "reason_of_doubt"]


def check_arguments(machine: Machine, trajectory: Trajectory, ground: Ground) -> None:
    """Raise if an argument of `certify` has the wrong type, or other joints than the machine."""
    if not isinstance(machine, Machine):
        raise MachineError(
            f"machine must be a Machine (see load_machine), not {type(machine).__name__}"
        )
    if not isinstance(trajectory, Trajectory):
        raise TrajectoryError(f"trajectory must be a Trajectory, not {type(trajectory).__name__}")
    check_ground(ground)
    if machine.support is None:
        raise MachineError(
            f"machine {machine.name!r} has no support polygon: {GIVE_SUPPORT.arguments}"
        )
    if trajectory.joint_names != machine.joint_names:
        raise ProblemError(
            f"the trajectory moves the joints {', '.join(trajectory.joint_names)}; the machine has "
            f"{', '.join(machine.joint_names)}"
        )


def check_drift(trajectory: Trajectory) -> None:
    """Raise TrajectoryError if the nodes drift away from the integrated accelerations."""
    if fault := drift_fault(trajectory):
        raise TrajectoryError(fault)


def reason_of_doubt(motion: CornerMotion, *, exhausted: bool) -> str:
    """Why no margin can be proven although every sample has one, in words.

    Args:
        motion: The motion with its constraints.
        exhausted: Whether more stretches would have been needed than there is time for.
    """
    efforts, trajectory = motion.efforts, motion.trajectory
    if efforts.is_vague.any():
        first = int(np.argmax(efforts.is_vague))
        when = float(trajectory.times[efforts.interval[first]])
        base = trajectory.base
        if base is not None and not base.ground.uniform:
            return (
                f"from {when:.2f} s on it is not known to 1 mm where the base drives; "
                "give more nodes, or less turn"
            )
        return (
            f"from {when:.2f} s on the bounds overflow; "
            "the motion is too fast, or its machine too large"
        )
    if exhausted:
        return "the motion is so fast, or so long, that bounds between its samples stay too loose"
    return "between samples, or by rounding, the ground may have to hold the machine down"
