"""Stability-blind motion of a machine whose base drives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from zmp_sqp.errors import ZmpSqpError
from zmp_sqp.mechanics import Heightmap, Slope, SupportPolygon
from zmp_sqp.mechanics.likely_units import machine_size
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning import Problem, Trajectory, plan

__all__ = ["blind_drive"]

WIDE = 20.0  # times the machine's size: half the width of a polygon that no motion leaves
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def blind_drive(
    problem: Problem,
    *,
    qp_solver: str = "auto",
    time_budget: float | None = None,
    announce: Callable[[str], None] | None = None,
) -> Trajectory | None:
    """Fastest motion within the limits of joints and base, whether it tips the machine over or not.

    It is planned as if the machine stood on a plate that is far too wide to tip over, on the plane
    of its slope. Over a heightmap it is planned on level ground, and the base then drives over the
    map with the same speeds and yaws, so that it misses the goal by what the hills are longer than
    their map.

    Args:
        problem: A problem with a base; its margin, constraints and uncertainties are left out.
        qp_solver, time_budget, announce: As for `plan`.

    Returns:
        The motion, on the problem's own ground; None if there is none.
    """
    machine = problem.machine
    height = 0.0 if machine.support is None else machine.support.height
    plate = SupportPolygon(WIDE * machine_size(machine.model) * SQUARE, height)
    uneven = isinstance(problem.ground, Heightmap)
    try:
        wide = replace(
            problem,
            machine=machine.with_support(plate),
            ground=Slope() if uneven else problem.ground,
            margin=0.0,
            constraints=(),
            tipping_fraction=1.0,
            payload_uncertainty=0.0,
            payload_com_uncertainty=0.0,
            slope_uncertainty=0.0,
        )
        found = plan(wide, qp_solver=qp_solver, time_budget=time_budget, announce=announce)
        if not found.success:
            return None
        motion = found.trajectory
        if motion.base is None or not isinstance(problem.ground, Heightmap):
            return motion
        return replace(motion, base=_over(motion.base, problem.ground))
    except ZmpSqpError:  # the problem has no such motion, or it leaves the map
        return None


def _over(base: UnicycleMotion, ground: Heightmap) -> UnicycleMotion:
    """Motion with the same speeds and yaws over a heightmap."""
    return UnicycleMotion.from_start(
        base.times,
        base.poses[0],
        base.velocities,
        base.poses[:, 2],
        (base.accelerations, base.jerks),
        ground,
    )
