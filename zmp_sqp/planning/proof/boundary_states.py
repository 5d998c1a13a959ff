"""Check that a motion starts and ends in the states that a problem requires."""

from __future__ import annotations

import numpy as np

from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.proof.base_check import ARRIVAL as BASE_ARRIVAL

__all__ = ["ARRIVAL", "meets_boundary_states"]

# [rad or m, and per second, relative above one] largest difference that counts as met
ARRIVAL = 1e-6


def meets_boundary_states(
    problem: Problem, trajectory: Trajectory, *, anywhere: bool = False
) -> bool:
    """Whether joints and base start and end in the states that the problem requires.

    Args:
        problem: The problem.
        trajectory: The motion.
        anywhere: Whether the motion may end at any place, with the rates of the goal.
    """
    placed = slice(0, 1) if anywhere else slice(None)
    for required, found in (
        (np.stack([problem.start, problem.goal])[placed], trajectory.positions[[0, -1]][placed]),
        (
            np.stack([problem.start_velocity, problem.goal_velocity]),
            trajectory.velocities[[0, -1]],
        ),
    ):
        if not (np.abs(found - required) <= ARRIVAL * (1.0 + np.abs(required))).all():
            return False
    base = problem.base
    if base is None or trajectory.base is None:
        return base is None and trajectory.base is None
    off = np.abs(trajectory.base.poses[[0, -1]] - np.vstack([base.start, base.goal]))
    return bool((off[placed] <= BASE_ARRIVAL).all())
