"""Results of a plan as one JSON object."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from zmp_sqp.planning import Plan, Problem, Trajectory, certify
from zmp_sqp.planning.proof.certificate import certify_for
from zmp_sqp.scenario import SHIPPED, Scenario
from zmp_sqp.show.basis import BASIS_KEYS, Basis, basis_fields
from zmp_sqp.show.guarantees import GUARANTEE_KEYS, guarantee_fields
from zmp_sqp.show.rigorous import RIGOROUS_KEYS
from zmp_sqp.versions import installed_versions

__all__ = ["RESULT_KEYS", "make_result", "margin_fields", "plan_fields"]

RESULT_KEYS = f"""\
--json writes one object; SI units, null where there is no value:
  scenario, title           name and title of the scenario
  scenario_path             its file; null for a shipped one
  success, status, message  whether a motion was found, and how planning ended
  duration                  [s] of the motion
  lower_bound               [s] no motion within the joint limits takes less time
  margin                    [m] guaranteed least distance from the ZMP to an edge, under all
                            uncertainties; negative outside
  iterations                number of SQP iterations
  qp_solver                 name of the QP solver, as given
  runs                      list, one entry per run of the search: purpose, intervals, backend (QP
                            solver), iterations, status, duration [s], reference [s] (duration that
                            scales the objective)
  nominal_margin            [m] guaranteed distance with payload and slope exactly as given
  margin_asked              [m] margin that the scenario asks for
  corner                    payload and slope for which the margin is least, or empty
{GUARANTEE_KEYS}  solve_time                [s] planning time
  phase_plane               duration, margin and nominal_margin of the phase-plane baseline, which
                            ignores the ZMP; null if start or goal is in motion, or if the base
                            drives; its margins are null if it lifts off
  diagnosis                 if no motion was found: largest_payload [kg] and steepest_slope [rad]
                            with which one was found instead; otherwise null
  joints                    by name: peak_rate, rate_limit, peak_acceleration, acceleration_limit
{RIGOROUS_KEYS}{BASIS_KEYS}  versions                  of zmp-sqp, Python and the packages used
"""


def plan_fields(found: Plan) -> dict[str, Any]:
    """Outcome of a plan, ready for JSON: SI units, None where there is no value."""
    return {
        "success": found.success,
        "status": found.status.name.lower(),
        "message": found.message,
        "duration": found.duration if found.success else None,
        "lower_bound": found.lower_bound,
        "margin": found.margin if found.success else None,
        "iterations": found.iterations,
        "qp_solver": found.qp_solver,
        "runs": [asdict(run) for run in found.runs],
    }


def make_result(scenario: Scenario, found: Plan, baseline: Trajectory | None) -> dict[str, Any]:
    """Object that `zmp-sqp plan --json` writes; `RESULT_KEYS` explains its keys.

    Args:
        scenario: Gives name and title.
        found: The plan.
        baseline: Phase-plane motion between the plan's start and goal; None if there is none.
    """
    problem, shipped = found.problem, scenario.path.parent == SHIPPED
    nominal = margin_fields(problem, found.trajectory)["nominal_margin"] if found.success else None
    blind = baseline and {"duration": baseline.duration, **margin_fields(problem, baseline)}
    return {
        "scenario": scenario.name,
        "title": scenario.title,
        "scenario_path": None if shipped else str(scenario.path.resolve()),
        **plan_fields(found),
        "nominal_margin": nominal,
        "margin_asked": problem.margin,
        "corner": found.certificate.corner,
        "guarantees": guarantee_fields(found.certificate.guarantees),
        "solve_time": found.solve_time,
        "phase_plane": blind,
        "diagnosis": None,
        "joints": _joint_peaks(problem, found.trajectory) if found.success else None,
        "rigorous": None,
        "rests_on": basis_fields(Basis.of_problem(problem)),
        "versions": installed_versions(),
    }


def margin_fields(problem: Problem, motion: Trajectory) -> dict[str, float | None]:
    """Guaranteed margins of a motion, ready for JSON; None where the machine may lift off.

    Args:
        problem: Gives machine, ground, margin and what is uncertain.
        motion: The motion.

    Returns:
        `margin` under all uncertainties, and `nominal_margin` with payload and slope exactly as
        given [m].
    """
    guaranteed = certify_for(problem, motion).margin
    nominal = guaranteed
    if len(problem.corners(every=True)) > 1:
        nominal = certify(problem.machine, motion, problem.ground, problem.margin).margin
    return {
        key: value if np.isfinite(value) else None
        for key, value in (("margin", guaranteed), ("nominal_margin", nominal))
    }


def _joint_peaks(problem: Problem, trajectory: Trajectory) -> dict[str, dict[str, float]]:
    """Largest rate and acceleration of every joint, beside its limits.

    Accelerations are constant between nodes, so that rates peak at nodes.
    """
    limits = problem.machine.limits
    columns = {
        "peak_rate": np.abs(trajectory.velocities).max(axis=0),
        "rate_limit": limits.velocity,
        "peak_acceleration": np.abs(trajectory.accelerations).max(axis=0),
        "acceleration_limit": limits.acceleration,
    }
    names = trajectory.joint_names
    return {
        name: {key: float(column[i]) for key, column in columns.items()}
        for i, name in enumerate(names)
    }
