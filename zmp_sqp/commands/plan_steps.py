"""What `zmp-sqp plan` does after its search: baseline, record, diagnosis, second opinion."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from zmp_sqp.commands.live import LiveLine, Steps
from zmp_sqp.commands.rigorous_option import margin_to_confirm
from zmp_sqp.planning import Plan, Problem, Trajectory, diagnose, phase_plane
from zmp_sqp.report.blind_drive import blind_drive
from zmp_sqp.report.record import bare_record, make_record
from zmp_sqp.rigorous import RigorousCheck, check_rigorously
from zmp_sqp.scenario import Scenario

__all__ = ["diagnosis_of_plan", "opinion_of_plan", "phase_plane_of", "record_of_plan"]


def record_of_plan(
    steps: Steps,
    scenario: Scenario,
    found: Plan,
    baseline: Trajectory | None,
    arguments: argparse.Namespace,
) -> dict[str, Any]:
    """Entries `RECORD_KEYS` of the result."""
    blind, simulate = baseline, arguments.html is not None
    if found.problem.base is not None and (arguments.html or arguments.out or arguments.json):
        blind = steps.run(
            "stability-blind motion",
            lambda line: _blind_drive(found, arguments, line),
            lambda: None,
        )
    return steps.run(
        "record for reports",
        lambda _: make_record(scenario, found, blind, simulate=simulate),
        lambda: bare_record(scenario, found),
    )


def opinion_of_plan(found: Plan, line: LiveLine) -> RigorousCheck:
    """Second opinion on a plan's guarantees, its guaranteed margin among them."""
    problem = found.problem
    return check_rigorously(
        problem.machine,
        found.trajectory,
        problem.ground,
        margin_to_confirm(found.certificate.margin, problem.margin),
        base=problem.base,
        constraints=problem.own_constraints,
        corners=problem.corners(every=True),
        progress=lambda count: line.say(f"second opinion: stretch {count}"),
    )


def phase_plane_of(problem: Problem) -> Trajectory | None:
    """Phase-plane baseline, which ignores the ZMP; None if base, start or goal is in motion."""
    if problem.base is not None or np.any(problem.start_velocity) or np.any(problem.goal_velocity):
        return None
    return phase_plane(problem.machine, problem.start, problem.goal)


def _blind_drive(found: Plan, arguments: argparse.Namespace, line: LiveLine) -> Trajectory | None:
    """Stability-blind motion of a base that drives; None without a motion to compare it with."""
    if found.attempt is None:
        return None
    return blind_drive(
        found.problem,
        qp_solver=found.qp_solver,
        time_budget=arguments.time_budget,
        announce=lambda words: line.say(f"stability-blind motion, {words}"),
    )


def diagnosis_of_plan(found: Plan, line: LiveLine) -> dict[str, Any]:
    """Entries `diagnosis` and `message` of the result, for a plan without a motion."""
    diagnosis = diagnose(found, progress=lambda words: line.say(f"diagnose: trying {words}"))
    return {
        "diagnosis": {
            "largest_payload": diagnosis.largest_payload,
            "steepest_slope": diagnosis.steepest_slope,
        },
        "message": diagnosis.message,
    }
