"""Runs of the tests of Song & Sharf 2020, their variants, the moving base and the analytic slew."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import length_text
from zmp_sqp.errors import ContactLost, ProblemError
from zmp_sqp.mechanics import Machine, SupportPolygon, load_machine
from zmp_sqp.planning import Plan, Problem, Trajectory, phase_plane, plan
from zmp_sqp.planning.closed_forms.base_bound import moving_base_zmp, plan_base
from zmp_sqp.planning.closed_forms.base_motion import BaseMotion, asymmetric_profile
from zmp_sqp.planning.closed_forms.slew import analytic_slew
from zmp_sqp.planning.constraints.tip_over import edge_label
from zmp_sqp.scenario import load_scenario
from zmp_sqp.show.results import plan_fields

__all__ = [
    "BASE",
    "DISTANCES",
    "MODELS",
    "PAPER_DURATION",
    "PAPER_TIMES",
    "TESTS",
    "Motions",
    "derivative_time",
    "failures",
    "run_slews",
    "run_test",
    "time_plan",
]

# results of the paper, Section V: duration of every planner in both tests [s], and computation
# times [s] by test and model; for the full model the paper says "more than 5 hours"
PAPER_DURATION = 4.5
PAPER_TIMES = {
    "test_1": {"full": 5 * 3600.0, "simplified": 1.34},
    "test_2": {"simplified": 1.29},
}
TESTS = {  # by name: scenario, and title in tables
    "test_1": ("paper_1", "test 1"),
    "test_1_upright": ("paper_1_upright", "test 1, tree upright"),
    "test_1_rigid": ("paper_1_rigid", "test 1, rigid bodies"),
    "test_2": ("paper_2", "test 2, arm"),
}
MODELS = ("full", "simplified")
BASE = {"max_speed": 10.0, "max_acceleration": 2.0}  # Section V-B [m/s, m/s^2]
# [m] that the base drives, backward; the paper gives no distance
DISTANCES = (-2.0, -6.0)
# (radius of the support [m], whether the paper's joint limits are kept)
SLEWS = ((1.1, True), (1.3, True), (1.3, False))
# Corners of the polygon that approximates a round support, and intervals of the SQP's time grid.
# Durations of analytic slew and SQP then differ by 1.5e-4; with 40 to 200 corners and 50 or 80
# intervals, by up to 2e-3.
CORNERS, SLEW_INTERVALS = 80, 80
SLEW_SOLVER = "piqp"  # exploits sparsity: a round support has one row per corner and instant
DURATION_TOLERANCE = 1e-3  # relative difference of a test's duration from the paper's
SLEW_TOLERANCE = 2e-3  # relative difference of the analytic slew's duration from the SQP's
MARGIN_TOLERANCE = 1e-6  # [m] rounding of a margin of zero
EVALUATIONS = 100  # calls in one F: both ends of 50 intervals


@dataclass(frozen=True, slots=True, eq=False)
class Motions:
    """Motions of one test, for its figures.

    Attributes:
        problem: Gives machine, ground, start and goal.
        arms: Arm motions by name of the planner in figures.
        bases: Base motions by name of the planner in figures; empty if the base stands.
    """

    problem: Problem
    arms: Mapping[str, Trajectory]
    bases: Mapping[str, BaseMotion | Trajectory]


def derivative_time(machine: Machine, *, repeats: int = 15) -> float:
    """CPU time F of 100 calls of `pin.computeRNEADerivatives`, measured now [s].

    Args:
        machine: Machine on whose model they are called.
        repeats: Number of measurements, of which the median is returned.
    """
    model, data, rng = machine.model, machine.model.createData(), np.random.default_rng(0)
    q = machine.configuration(rng.uniform(-1.0, 1.0, (EVALUATIONS, machine.size)))
    v, a = rng.uniform(-1.0, 1.0, (2, EVALUATIONS, model.nv))
    rows, times = list(zip(q, v, a, strict=True)), []
    for _ in range(repeats):
        started = time.process_time()
        for row in rows:
            pin.computeRNEADerivatives(model, data, *row)
        times.append(time.process_time() - started)
    return float(np.median(times))


def time_plan(problem: Problem, *, qp_solver: str, repeats: int) -> tuple[Plan, dict[str, Any]]:
    """Plan several times, without warm starts, and measure the time.

    Args:
        problem: The planning problem.
        qp_solver: Name of the QP solver.
        repeats: Number of plans; times are medians over them.

    Returns:
        The last plan, and its numbers ready for JSON: those of `plan_fields`, reason (why there is
        no motion, for a table; empty with success), time (wall time [s]),
        F (`derivative_time`, measured before each plan [s]) and time_in_F (CPU time over F, which
        other programs on the computer disturb less than wall time).
    """
    seconds, units, bare = [], [], []
    for _ in range(repeats):
        unit = derivative_time(problem.machine)
        started, busy = time.perf_counter(), time.process_time()
        found = plan(problem, qp_solver=qp_solver)
        seconds.append(time.perf_counter() - started)
        units.append((time.process_time() - busy) / unit)
        bare.append(unit)
    return found, {
        **plan_fields(found),
        "reason": _reason(found),
        "time": float(np.median(seconds)),
        "time_in_F": float(np.median(units)),
        "F": float(np.median(bare)),
    }


def _reason(found: Plan) -> str:
    """What is wrong with the last motion, for a table; empty with success."""
    problem, checked = found.problem, found.certificate
    if found.success:
        return ""
    support = problem.machine.support
    if support is None or checked.margin >= problem.margin:
        return found.status.name.lower()
    if not np.isfinite(checked.margin):
        return "lifts off"
    return f"{edge_label(support, checked.edge)} by {length_text(problem.margin - checked.margin)}"


def run_test(
    name: str, *, qp_solver: str = "auto", repeats: int = 5
) -> tuple[dict[str, Any], Motions]:
    """Plan one of `TESTS` with both models and the phase-plane method, in test 2 with the base.

    Args:
        name: Key of `TESTS`.
        qp_solver: Name of the QP solver.
        repeats: Number of times that each plan is timed.

    Returns:
        Entry of `tests` in the result of `zmp-sqp paper`, and the motions for its figures.
    """
    scenario, title = TESTS[name]
    problem = load_scenario(scenario).problem
    baseline = phase_plane(problem.machine, problem.start, problem.goal)
    planners: dict[str, Any] = {
        "phase plane": {"duration": baseline.duration, "margin": _margin(problem, baseline)}
    }
    arms: dict[str, Trajectory] = {"phase plane": baseline}
    bases: dict[str, BaseMotion | Trajectory] = {}
    base_runs: list[dict[str, Any]] = []
    for model in MODELS:
        found, numbers = time_plan(
            replace(problem, model=model), qp_solver=qp_solver, repeats=repeats
        )
        planners[model] = numbers
        if found.success:
            arms["full model" if model == "full" else model] = found.trajectory
    if name == "test_2" and "simplified" in arms:
        base_runs, bases = _back_up(problem, arms["simplified"], baseline)
    numbers = {"name": name, "title": title, "planners": planners, "base": base_runs}
    return numbers, Motions(problem, arms, bases)


def _back_up(
    problem: Problem, arm: Trajectory, baseline: Trajectory
) -> tuple[list[dict[str, Any]], dict[str, BaseMotion | Trajectory]]:
    """Base motions beside arm motions: within eq. (21), and within the base's own limits alone.

    Args:
        problem: Problem of the arm.
        arm: Arm motion planned with the simplified model, for the base motions within eq. (21).
        baseline: Phase-plane motion of the arm, for the base motion that ignores the ZMP.

    Returns:
        Entry `base` of the test's result, and the base motions by name of the planner in figures.
    """
    limit, speed = BASE["max_acceleration"], BASE["max_speed"]
    blind = asymmetric_profile(
        DISTANCES[0], forward=limit, backward=limit, max_speed=speed, least_duration=0.0
    )
    bases: dict[str, BaseMotion | Trajectory] = {"phase plane": blind}
    margin = _margin(problem, baseline, blind)
    runs: list[dict[str, Any]] = [
        {"distance": DISTANCES[0], "blind": True, "duration": blind.duration, "margin": margin}
    ]
    for distance in DISTANCES:
        try:
            motion = plan_base(problem.machine, arm, problem.ground, distance=distance, **BASE)
        except ProblemError as refused:
            runs.append({"distance": distance, "success": False, "message": str(refused)})
            continue
        bases.setdefault("simplified", motion)
        numbers = {
            "duration": motion.duration,
            "lower": motion.lower,
            "upper": motion.upper,
            "factor": motion.factor,
            "margin": motion.margin,
            "peak_acceleration": np.abs(motion.accelerations).max(),
        }
        runs.append(
            {"distance": distance, "success": True}
            | {key: float(value) for key, value in numbers.items()}
        )
    return runs, bases


def _margin(problem: Problem, arm: Trajectory, base: Trajectory | None = None) -> float | None:
    """Least sampled margin, from the complete wrench of arm and base [m].

    It is None if the machine lifts off.
    """
    support = problem.machine.support
    if support is None:
        raise ProblemError(f"machine {problem.machine.name!r} has no support polygon")
    try:
        points = moving_base_zmp(problem.machine, arm, base, problem.ground)[1]
    except ContactLost:
        return None
    return float(support.signed_distance(points).min())


def run_slews() -> list[dict[str, Any]]:
    """Half a turn of the slewing crane on a round support: analytic slew and SQP side by side.

    Returns:
        One object per entry of `SLEWS`, ready for JSON, in SI units.
    """
    rows = []
    for radius, limited in SLEWS:
        turn = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
        limits = {"velocity": np.pi / 4, "acceleration": np.pi / 2} if limited else None
        support = SupportPolygon(radius * np.column_stack([np.cos(turn), np.sin(turn)]))
        machine = load_machine("slewing_crane", support=support, limits=limits)
        started = time.perf_counter()
        analytic = analytic_slew(machine, [0.0], [np.pi])
        elapsed = time.perf_counter() - started
        found = plan(
            Problem(machine, np.array([0.0]), np.array([np.pi]), intervals=SLEW_INTERVALS),
            qp_solver=SLEW_SOLVER,
        )
        rows.append(
            {
                "radius": radius,
                "paper_limits": limited,
                "analytic": analytic.duration,
                "analytic_time": elapsed,
                "sqp": found.duration if found.success else None,
                "sqp_time": found.solve_time,
                "sqp_iterations": found.iterations,
            }
        )
    return rows


def failures(result: Mapping[str, Any]) -> list[str]:
    """Sentences about plans that are unsafe or slower than the paper's, and slews that disagree.

    Args:
        result: With the entries `tests` and `slews` of the result of `zmp-sqp paper`.
    """
    found = []
    for test in result["tests"]:
        for model in MODELS:
            numbers, what = test["planners"][model], f"{test['title']}, {model}"
            if not numbers["success"]:
                found.append(f"{what}: {numbers['message']}")
                continue
            if numbers["margin"] < -MARGIN_TOLERANCE:
                found.append(f"{what}: the ZMP leaves the polygon by {-numbers['margin']:.3g} m")
            if abs(numbers["duration"] / PAPER_DURATION - 1.0) > DURATION_TOLERANCE:
                found.append(f"{what}: takes {numbers['duration']:.4f} s, not {PAPER_DURATION} s")
        for run in test["base"]:
            if not run.get("blind") and not (run["success"] and run["margin"] >= -MARGIN_TOLERANCE):
                reason = run.get("message", "leaves the polygon")
                found.append(f"{test['title']}, base {run['distance']} m: {reason}")
    for row in result["slews"]:
        if row["sqp"] is None or abs(row["analytic"] / row["sqp"] - 1.0) > SLEW_TOLERANCE:
            found.append(
                f"analytic slew, radius {row['radius']} m: {row['analytic']:.4f} s, "
                f"SQP {row['sqp']} s"
            )
    return found
