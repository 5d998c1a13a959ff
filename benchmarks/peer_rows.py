"""Rows of the table of benchmarks/peers.py: what each method answers to a problem."""

from __future__ import annotations

import importlib.util
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import zmp_sqp as zs
from benchmarks.harness import Row, console, measure_F, timed_plan
from benchmarks.peer_checks import (
    Motion,
    Violations,
    drive_of,
    drive_violations,
    motion_of,
    violations,
)
from benchmarks.peer_drive import DrivingPeer, driving_guess
from benchmarks.peer_fatrop import StagedPeer
from benchmarks.peer_ipopt import CONVERGED, first_guess, guesses
from benchmarks.peer_transcription import Peer
from benchmarks.problems.driving import random_driving_problem
from benchmarks.problems.scene import NamedProblem, Scene

__all__ = ["TOLERANCE", "Method", "drive_rows", "peers", "problem_rows", "shooting", "unavailable"]

TOLERANCE = 1e-6  # of the solvers
CELLS = (10, 20)  # per interval, of TOPP-RA's grids: the second answer is taken
Solve = Callable[[NamedProblem, zs.Plan], Row]  # a row without problem and method


@dataclass(frozen=True)
class Method:
    """A peer that is ready to solve."""

    name: str
    solve: Solve
    set_up: float | None  # [s] processor time; None if each problem has its own


def processor_time() -> float:
    """Processor time of this process and of its children that have ended, such as gcc [s]."""
    return sum(os.times()[:4])


def unavailable(name: str) -> str | None:
    """Why a method cannot be measured on this computer; None if it can."""
    module = name if name in ("drake", "toppra") else None
    if module and importlib.util.find_spec("pydrake" if module == "drake" else module) is None:
        return f"{module} is not installed"
    if name.endswith("_compiled") and shutil.which("gcc") is None:
        return "there is no gcc"
    return None


def peers(scene: Scene, names: Sequence[str]) -> Iterator[Method]:
    """Set up the peers of these names for the machine of a scene."""
    for name in names:
        before = processor_time()
        if name.startswith(("ipopt", "fatrop")):
            kind = Peer if name.startswith("ipopt") else StagedPeer
            peer = kind(scene, compiled=name.endswith("_compiled"), tolerance=TOLERANCE)
            yield Method(name, shooting(peer), processor_time() - before)
        elif name == "drake":
            yield Method(name, _by_drake, None)
        elif name == "toppra":
            yield Method(name, _by_toppra, 0.0)


def row_of(
    status: str,
    motion: Motion | None,
    found: Violations | None,
    *,
    seconds: float,
    iterations: int = 0,
    **more: Any,
) -> Row:
    """A row's columns of a method's answer."""
    return {
        "status": status,
        "duration": np.nan if motion is None else motion.duration,
        "zmp": np.nan if found is None else found.zmp,
        "limits": np.nan if found is None else found.rest,
        "iterations": iterations,
        "seconds": seconds,
        **more,
    }


def shooting(peer: Peer | StagedPeer) -> Solve:
    """Solve by a program of CasADi, from one guess after the other until it succeeds."""

    def solve(named: NamedProblem, plan: zs.Plan) -> Row:
        seconds, iterations = 0.0, 0
        for _, guess in guesses(named, first_guess(named.problem)):
            answer = peer.solve(named, guess)
            seconds, iterations = seconds + answer.seconds, iterations + answer.iterations
            if answer.status in CONVERGED:
                break
        else:
            return row_of(answer.status, None, None, seconds=seconds, iterations=iterations)
        motion = motion_of(answer.motion.trajectory(named.problem.machine))
        found = violations(named, motion)
        return row_of("solved", motion, found, seconds=seconds, iterations=iterations)

    return solve


def _by_drake(named: NamedProblem, plan: zs.Plan) -> Row:
    from benchmarks.peer_drake import solved_by_drake

    guess = first_guess(named.problem)
    answer = solved_by_drake(named, guess.q, guess.duration)
    found = None if answer.motion is None else violations(named, answer.motion)
    status = "solved" if answer.motion else answer.status
    return row_of(status, answer.motion, found, seconds=answer.seconds, set_up=answer.set_up)


def _by_toppra(named: NamedProblem, plan: zs.Plan) -> Row:
    from benchmarks.peer_toppra import retimed

    coarse, answer = (retimed(named, plan.trajectory, cells=cells) for cells in CELLS)
    if answer.motion is None or coarse.motion is None:
        return row_of(answer.status, None, None, seconds=answer.seconds)
    found = violations(named, answer.motion)
    change = answer.motion.duration / coarse.motion.duration - 1.0
    return row_of("solved", answer.motion, found, seconds=answer.seconds, discretisation=change)


def planned(named: NamedProblem) -> tuple[zs.Plan, Row]:
    """The planner's plan and row."""
    plan, row = timed_plan(named.problem)
    status = "certified" if plan.success else row["status"]
    motion = motion_of(plan.trajectory) if plan.success else None
    found = violations(named, motion) if motion else None
    numbers = {"seconds": row["seconds"], "iterations": row["iterations"]}
    return plan, row_of(status, motion, found, **numbers, lower_bound=plan.lower_bound)


def problem_rows(named: NamedProblem, methods: Sequence[Method]) -> list[Row]:
    """Rows of one problem, the planner's first."""
    machine = named.problem.machine
    before = measure_F(machine)
    plan, ours = planned(named)
    rows = [_completed(ours, named.name, "zmp_sqp", 0.0, (before, machine), ours)]
    for method in methods:
        before = measure_F(machine)
        row = method.solve(named, plan)
        rows.append(
            _completed(row, named.name, method.name, method.set_up, (before, machine), ours)
        )
    return rows


def drive_rows(seed: int) -> list[Row]:
    """Rows of one drive: the planner's, and IPOPT's."""
    drawn = random_driving_problem(seed)
    machine, name = drawn.problem.machine, f"drive_{seed} ({drawn.kind})"
    before = measure_F(machine)
    plan, row = timed_plan(drawn.problem)
    motion = drive_of(plan.trajectory) if plan.success else None
    ours = row_of(
        "certified" if plan.success else row["status"],
        motion,
        drive_violations(drawn, motion) if motion else None,
        seconds=row["seconds"],
        iterations=row["iterations"],
        lower_bound=plan.lower_bound,
    )
    rows = [_completed(ours, name, "zmp_sqp", 0.0, (before, machine), ours)]
    start = processor_time()
    peer = DrivingPeer(drawn, tolerance=TOLERANCE)
    set_up, before = processor_time() - start, measure_F(machine)
    answer = peer.solve(driving_guess(drawn, peer.N, 1.15 * plan.lower_bound))
    solved = answer.status in CONVERGED
    theirs = (
        motion_of(answer.motion.integrated((*machine.joint_names, "yaw", "length")))
        if solved
        else None
    )
    row = row_of(
        "solved" if solved else answer.status,
        theirs,
        drive_violations(drawn, theirs) if theirs else None,
        seconds=answer.seconds,
        iterations=answer.iterations,
    )
    return [*rows, _completed(row, name, "ipopt", set_up, (before, machine), ours)]


def _completed(
    row: Row,
    problem: str,
    method: str,
    set_up: float | None,
    F: tuple[float, zs.Machine],
    ours: Row,
) -> Row:
    """A row with its names, its time in F and its duration over the planner's.

    Args:
        row: From `row_of`.
        problem: Name.
        method: Name.
        set_up: [s]; None if the row has its own.
        F: Measured before the solve [s], and the machine on which it is measured again.
        ours: The planner's row.
    """
    unit = 0.5 * (F[0] + measure_F(F[1]))
    row = {"set_up": set_up} | row
    row |= {
        "problem": problem,
        "method": method,
        "in_F": row["seconds"] / unit,
        "ratio": row["duration"] / ours["duration"],
    }
    console.print(
        f"{problem}, {method}: {row['status']}, {row['duration']:.4f} s, {row['in_F']:.0f} F, "
        f"zmp {1e3 * row['zmp']:.3f} mm, limits {row['limits']:.1e}",
        style="dim",
    )
    return row
