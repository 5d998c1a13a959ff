"""Ladder of payloads and reaches, which the paper lacks.

Both grow from rung to rung until keeping the ZMP inside costs time, and on until no motion is
found.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics import Machine, Payload, Slope, load_machine, stability_margin
from zmp_sqp.paper.runs import MODELS, time_plan
from zmp_sqp.planning import Problem

__all__ = ["RUNGS", "ladder"]

BOOMS = (-10.0, -30.0, -50.0)  # [deg] boom angles at start and goal, which set the reach
PAYLOADS = (2000.0, 3000.0, 4000.0, 5000.0, 6000.0, 8000.0, 10000.0, 12000.0, 16000.0)  # [kg]
RUNGS = tuple((payload, boom) for payload in PAYLOADS for boom in BOOMS)
STEM = np.array([0.0, 0.0, 3.323])  # [m] centre of mass of the tree in the head's frame
ATTITUDE = -2.0 * np.pi / 3  # [rad] pitch of the head, as in eq. (22)
ROLL = np.deg2rad(-20.0)  # [rad] of the ground, as in test 1
QP_SOLVER = "auto"


def ladder(
    rungs: tuple[tuple[float, float], ...] = RUNGS, *, repeats: int = 1
) -> Iterator[dict[str, Any]]:
    """Plan the half turn of test 1 on every rung with both models.

    Args:
        rungs: (payload [kg], boom angle [deg]) of each rung.
        repeats: Number of times that each plan is timed.

    Yields:
        One object per rung and model, ready for JSON: payload, boom_deg, reach (horizontal distance
        of the head from the slew axis [m]), model, and the numbers of `time_plan`. If the problem
        is refused, `status` is "refused" and `message` says why.
    """
    for payload, boom in rungs:
        machine, start = rung_machine(payload), rung_pose(boom)
        where = {"payload": payload, "boom_deg": boom, "reach": reach(machine, start)}
        for model in MODELS:
            try:
                problem = replace(rung_problem(machine, start), model=model)
            except ProblemError as refused:
                nothing = dict.fromkeys(
                    ("duration", "lower_bound", "margin", "iterations", "time", "time_in_F", "F")
                )
                yield (
                    where
                    | {
                        "model": model,
                        "success": False,
                        "status": "refused",
                        "message": str(refused),
                        "reason": _refusal(machine, start),
                    }
                    | nothing
                )
                continue
            yield (
                where
                | {"model": model}
                | time_plan(problem, qp_solver=QP_SOLVER, repeats=repeats)[1]
            )


def rung_machine(payload: float) -> Machine:
    """Feller-buncher of test 1, of point masses, with a tree of the given mass [kg]."""
    return (
        load_machine("feller_buncher")
        .with_payload(Payload(payload, STEM, "head"))
        .with_point_masses()
    )


def rung_pose(boom: float) -> Array:
    """Pose of the form (7) of the paper, arm over the front, with the given boom angle [deg]."""
    angle = float(np.deg2rad(boom))
    return np.array([0.0, angle, -np.pi - 2.0 * angle, ATTITUDE + np.pi + angle, -np.pi / 2])


def rung_problem(machine: Machine, start: Array) -> Problem:
    """Half a turn of the slew alone, on ground that leans 20 degrees to the left."""
    return Problem(
        machine, start, start + np.array([np.pi, 0.0, 0.0, 0.0, 0.0]), ground=Slope(roll=ROLL)
    )


def _refusal(machine: Machine, start: Array) -> str:
    """Why the start of a rung is refused, for a table."""
    still = np.zeros((1, machine.size))
    margin = stability_margin(machine, start[None], still, still, Slope(roll=ROLL))
    return "tips over at rest at the start" if margin[0] < 0.0 else "refused"


def reach(machine: Machine, q: Array) -> float:
    """Horizontal distance of the head from the slew axis [m]."""
    data = machine.model.createData()
    pin.forwardKinematics(machine.model, data, machine.configuration(q[None])[0])
    head, slew = (data.oMi[machine.model.getJointId(name)].translation for name in ("head", "slew"))
    return float(np.linalg.norm((head - slew)[:2]))
