"""Song & Sharf 2020 beside our own numbers: both tests, their variants, the moving base and the analytic slew."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.errors import ContactLost, ProblemError
from zmp_sqp.mechanics import Machine, SupportPolygon, load_machine
from zmp_sqp.planning import Plan, Problem, Trajectory, phase_plane, plan
from zmp_sqp.planning.closed_forms.base_bound import moving_base_zmp, plan_base
from zmp_sqp.planning.closed_forms.base_motion import BaseMotion, asymmetric_profile
from zmp_sqp.planning.closed_forms.slew import analytic_slew
from zmp_sqp.scenario import load_scenario
from zmp_sqp.show.results import plan_fields

__all__ = [
    "BASE",
    "MODELS",
    "PAPER",
    "TESTS",
    "Motions",
    "derivative_time",
    "failures",
    "run_slews",
    "run_test",
    "time_plan",
]

PAPER = {  # what Section V prints
    "duration": 4.5,  # [s], every planner, both tests
    # computation [s]; full: "more than 5 hours"
    "test_1": {"full": 5 * 3600.0, "simplified": 1.34},
    "test_2": {"simplified": 1.29},
}
TESTS = {  # by name: the scenario, and what it is called in tables
    "test_1": ("paper_1", "test 1"),
    "test_1_upright": ("paper_1_upright", "test 1, tree upright"),
    "test_1_rigid": ("paper_1_rigid", "test 1, rigid bodies"),
    "test_2": ("paper_2", "test 2, arm"),
}
MODELS = ("full", "simplified")
BASE = {"max_speed": 10.0, "max_acceleration": 2.0}  # Section V-B [m/s, m/s^2]
WAYS = (-2.0, -6.0)  # [m] how far the base backs up; the paper does not say, 2 m is our choice
# radius of the support [m], whether the paper's joint limits count
SLEWS = ((1.1, True), (1.3, True), (1.3, False))
# The two differ by 1.5e-4 on this polygon and grid, by up to 2e-3 on others (40 to 200 corners, 50
# and 80 intervals). of the polygon that stands for a circle, same for both; of the SQP's grid
CORNERS, SLEW_INTERVALS = 80, 80
SLEW_SOLVER = "piqp"  # sparse: a round polygon has many rows
DURATION_TOLERANCE = 1e-3  # relative: test durations against the paper's
SLEW_TOLERANCE = 2e-3  # relative: analytic slew against the SQP
MARGIN_TOLERANCE = 1e-6  # [m]
EVALUATIONS = 100  # one F: both ends of 50 intervals


@dataclass(frozen=True, slots=True, eq=False)
class Motions:
    """What the figures of one test show.

    Attributes:
        problem: Machine, ground, start and goal.
        arms: Arm motions by planner, as figures call them.
        bases: Base motions beside them; empty where the base stands.
    """

    problem: Problem
    arms: Mapping[str, Trajectory]
    bases: Mapping[str, BaseMotion | Trajectory]


def derivative_time(machine: Machine, *, repeats: int = 15) -> float:
    """F [s] of CPU time: 100 calls of `pin.computeRNEADerivatives` on this machine's model here and now, a median."""
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
    """Plan several times from cold, nothing carried over; times are medians, F is measured beside each.

    Returns:
        The last plan, and its numbers ready for JSON: SI units, `time_in_F` in units of
            `derivative_time`,
        CPU time both, which other programs on the computer disturb less.
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
        "time": float(np.median(seconds)),
        "time_in_F": float(np.median(units)),
        "F": float(np.median(bare)),
    }


def run_test(
    name: str, *, qp_solver: str = "proxqp", repeats: int = 5
) -> tuple[dict[str, Any], Motions]:
    """Plan one of `TESTS` with both models and the phase-plane method; in test 2 the base backs up beside the arm."""
    scenario, title = TESTS[name]
    problem = load_scenario(scenario).problem
    baseline = phase_plane(problem.machine, problem.start, problem.goal)
    planners: dict[str, Any] = {
        "phase plane": {"duration": baseline.duration, "margin": _margin(problem, baseline)}
    }
    arms: dict[str, Trajectory] = {"phase plane": baseline}
    bases: dict[str, BaseMotion | Trajectory] = {}
    ways: list[dict[str, Any]] = []
    for model in MODELS:
        found, numbers = time_plan(
            replace(problem, model=model), qp_solver=qp_solver, repeats=repeats
        )
        planners[model] = numbers
        if found.success:
            arms["full model" if model == "full" else model] = found.trajectory
    if name == "test_2" and "simplified" in arms:
        ways, bases = _back_up(problem, arms["simplified"], baseline)
    return {"name": name, "title": title, "planners": planners, "base": ways}, Motions(
        problem, arms, bases
    )


def _back_up(
    problem: Problem, arm: Trajectory, baseline: Trajectory
) -> tuple[list[dict[str, Any]], dict[str, BaseMotion | Trajectory]]:
    """Base motions under eq. (21) beside the simplified arm motion, and the blind one that knows its limits alone."""
    push, speed = BASE["max_acceleration"], BASE["max_speed"]
    blind = asymmetric_profile(
        WAYS[0], forward=push, backward=push, max_speed=speed, least_duration=0.0
    )
    bases: dict[str, BaseMotion | Trajectory] = {"phase plane": blind}
    margin = _margin(problem, baseline, blind)
    ways: list[dict[str, Any]] = [
        {"distance": WAYS[0], "blind": True, "duration": blind.duration, "margin": margin}
    ]
    for distance in WAYS:
        try:
            motion = plan_base(problem.machine, arm, problem.ground, distance=distance, **BASE)
        except ProblemError as refused:
            ways.append({"distance": distance, "success": False, "message": str(refused)})
            continue
        bases.setdefault("simplified", motion)
        numbers = {
            "duration": motion.duration,
            "lower": motion.lower,
            "upper": motion.upper,
            "factor": motion.factor,
        }
        numbers |= {
            "margin": motion.margin,
            "peak_acceleration": np.abs(motion.accelerations).max(),
        }
        ways.append(
            {"distance": distance, "success": True}
            | {key: float(value) for key, value in numbers.items()}
        )
    return ways, bases


def _margin(problem: Problem, arm: Trajectory, base: Trajectory | None = None) -> float | None:
    """Least sampled margin of arm and base together, by the complete wrench [m]; None if the machine lifts off."""
    support = problem.machine.support
    if support is None:
        raise ProblemError(f"machine {problem.machine.name!r} has no support polygon")
    try:
        return float(
            support.signed_distance(
                moving_base_zmp(problem.machine, arm, base, problem.ground)[1]
            ).min()
        )
    except ContactLost:
        return None


def run_slews() -> list[dict[str, Any]]:
    """The analytic slew against the SQP on the same machine: half a turn of the slewing crane on a round foot."""
    rows = []
    for radius, limited in SLEWS:
        turn = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
        limits = {"velocity": np.pi / 4, "acceleration": np.pi / 2} if limited else None
        foot = SupportPolygon(radius * np.column_stack([np.cos(turn), np.sin(turn)]))
        machine = load_machine("slewing_crane", support=foot, limits=limits)
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
    """Which of the claims do not hold, as sentences: safe where it should be safe, as fast as the paper, consistent."""
    found = []
    for test in result["tests"]:
        for model in MODELS:
            numbers, what = test["planners"][model], f"{test['title']}, {model}"
            if not numbers["success"]:
                found.append(f"{what}: {numbers['message']}")
                continue
            if numbers["margin"] < -MARGIN_TOLERANCE:
                found.append(f"{what}: the ZMP leaves the polygon by {-numbers['margin']:.3g} m")
            if abs(numbers["duration"] / PAPER["duration"] - 1.0) > DURATION_TOLERANCE:
                found.append(
                    f"{what}: takes {numbers['duration']:.4f} s, not {PAPER['duration']} s"
                )
        for way in test["base"]:
            if not way.get("blind") and not (way["success"] and way["margin"] >= -MARGIN_TOLERANCE):
                found.append(
                    f"{test['title']}, base {way['distance']} m: {way.get('message', 'leaves the polygon')}"
                )
    for row in result["slews"]:
        if row["sqp"] is None or abs(row["analytic"] / row["sqp"] - 1.0) > SLEW_TOLERANCE:
            found.append(
                f"analytic slew, radius {row['radius']} m: {row['analytic']:.4f} s, SQP {row['sqp']} s"
            )
    return found
