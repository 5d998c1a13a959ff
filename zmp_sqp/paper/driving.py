"""Test 2 of the paper with a base that backs up while the arm swings.

Base and arm are planned together in one program, and in the paper's two steps: first the arm, then
the base under eq. (21).
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from zmp_sqp.errors import ProblemError
from zmp_sqp.paper.runs import BASE, DISTANCES, MARGIN_TOLERANCE, MODELS
from zmp_sqp.planning import (
    Plan,
    Problem,
    Trajectory,
    UnicycleBase,
    certify,
    plan,
    plan_base,
    trajectory_zmp,
)
from zmp_sqp.planning.closed_forms.base_motion import driven_trajectory
from zmp_sqp.scenario import load_scenario
from zmp_sqp.show.results import plan_fields

__all__ = ["TOGETHER", "driving_failures", "run_driving"]

SCENARIO = "paper_2_joint"
TOGETHER = "base and arm together"
# Shares of each interval at which margins are sampled. The ends are left out, because accelerations
# jump there.
SHARES = np.linspace(1e-9, 1.0 - 1e-9, 10)
NO_SLOWER = 1e-3  # relative difference of durations that different time grids explain


def run_driving(*, qp_solver: str = "auto") -> list[dict[str, Any]]:
    """Plan test 2 with the base backing up by each of `DISTANCES`, in two steps and in one program.

    In two steps, the arm is planned first, with the full and with the simplified model.

    Args:
        qp_solver: QP solver of all plans.

    Returns:
        For each distance and planner an object in SI units, ready for JSON: distance, planner, the
        fields of `plan_fields` (margin is proven for all t), sampled (least margin on a fine grid,
        from the complete wrench of arm and base) and time (wall time).
    """
    scenario = load_scenario(SCENARIO).problem
    asked = scenario.base
    if asked is None:
        raise ProblemError(f"scenario {SCENARIO!r} has no base")
    arms = {
        model: _timed(replace(scenario, base=None, model=model), qp_solver)
        for model in MODELS[::-1]
    }
    rows = []
    for distance in DISTANCES:
        base = replace(asked, goal=asked.start + np.array([distance, 0.0, 0.0]))
        problem = replace(scenario, base=base)
        rows += [
            _two_steps(problem, base, distance, *arm, model=model) for model, arm in arms.items()
        ]
        found, elapsed = _timed(problem, qp_solver)
        sampled = _sampled(problem, found.trajectory) if found.success else None
        row = {"distance": distance, "planner": TOGETHER} | plan_fields(found)
        rows.append(row | {"sampled": sampled, "time": elapsed})
    return rows


def _timed(problem: Problem, qp_solver: str) -> tuple[Plan, float]:
    """Plan and its wall time [s]."""
    started = time.perf_counter()
    return plan(problem, qp_solver=qp_solver), time.perf_counter() - started


def _two_steps(
    problem: Problem, base: UnicycleBase, distance: float, arm: Plan, elapsed: float, *, model: str
) -> dict[str, Any]:
    """Result of the paper's two steps: the base under eq. (21) beside a planned arm motion.

    Args:
        problem: Problem with the base, for the certificate.
        base: Base with its goal at the distance.
        distance: Distance that the base drives, negative backward [m].
        arm: Arm plan for a base that stands.
        elapsed: Wall time of the arm plan [s].
        model: Model of the arm plan.
    """
    row = {
        "distance": distance,
        "planner": f"arm first ({model}), base under eq. (21)",
    } | plan_fields(arm)
    row |= {
        "lower_bound": max(arm.lower_bound, base.least_duration),
        "sampled": None,
        "time": elapsed,
    }
    if not arm.success:
        return row
    started = time.perf_counter()
    try:
        motion = plan_base(
            problem.machine, arm.trajectory, problem.ground, distance=distance, **BASE
        )
    except ProblemError as refused:
        return row | {"success": False, "message": str(refused), "duration": None, "margin": None}
    whole = driven_trajectory(arm.trajectory, motion.trajectory, base.start)
    proven = certify(problem.machine, whole, problem.ground, base=base)
    found = {"success": proven.safe, "duration": whole.duration, "margin": proven.margin}
    found |= {"sampled": _sampled(problem, whole), "time": elapsed + time.perf_counter() - started}
    return row | found


def _sampled(problem: Problem, trajectory: Trajectory) -> float:
    """Least sampled margin, from the complete wrench of arm and base [m]."""
    support = problem.machine.support
    if support is None:
        raise ProblemError(f"machine {problem.machine.name!r} has no support polygon")
    times = trajectory.within(SHARES)[0]
    return float(
        support.signed_distance(
            trajectory_zmp(problem.machine, trajectory, times, problem.ground)
        ).min()
    )


def driving_failures(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Sentences about motions that are unsafe, or slower planned together than in two steps.

    Args:
        rows: Made by `run_driving`.
    """
    found = []
    for row in rows:
        what = f"test 2, base {row['distance']:g} m, {row['planner']}"
        if not row["success"]:
            found.append(f"{what}: {row['message']}")
        elif row["margin"] < -MARGIN_TOLERANCE:
            found.append(f"{what}: the ZMP leaves the polygon by {-row['margin']:.3g} m")
        elif row["planner"] != TOGETHER:
            together = [
                r["duration"]
                for r in rows
                if (r["distance"], r["planner"]) == (row["distance"], TOGETHER)
            ]
            if together[0] is not None and together[0] > (1.0 + NO_SLOWER) * row["duration"]:
                found.append(
                    f"{what}: takes {row['duration']:.4f} s, and together {together[0]:.4f} s"
                )
    return found
