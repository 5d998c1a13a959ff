"""Different QP solvers, one answer; the same problem, the same bits."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import HARD, random_problem
from benchmarks.problems.checks import check_feasibility
from benchmarks.problems.driving import random_driving_problem
from benchmarks.problems.paper import paper_1
from benchmarks.problems.scene import NamedProblem
from tests.planning.conftest import planned_paper_1, planned_random
from tests.problems import slider

# Relative. The practical stop leaves up to 5e-5 of the duration, and the tolerance of QPs decides
# on which side of it a run ends.
SAME = 1e-4
SAFE = 1e-6  # [m, rad, rad/s, rad/s^2]
OTHERS = ("proxqp", "piqp", "qpsolvers:clarabel", "qpsolvers:daqp", "qpsolvers:piqp")
ROOT = Path(__file__).parents[2]


@cache
def planned(name: str) -> tuple[NamedProblem, zs.Plan]:
    if name.startswith("paper_1"):
        return planned_paper_1(point_masses=name == "paper_1")
    if name == "slider":
        named = slider(intervals=50)
        return named, zs.plan(named.problem)
    if name.startswith("hard"):
        named = random_problem(int(name.removeprefix("hard ")), HARD)
        return named, zs.plan(named.problem)
    return planned_random(int(name.removeprefix("seed ")))


def agrees(name: str, qp_solver: str) -> None:
    named, plan = planned(name)
    other = zs.plan(named.problem, qp_solver=qp_solver)
    assert other.success, other.message
    assert other.qp_solver == qp_solver
    assert check_feasibility(named.scene, named.problem, other.trajectory).violation <= SAFE
    assert other.duration == pytest.approx(plan.duration, rel=SAME)


@pytest.mark.parametrize("qp_solver", OTHERS)
@pytest.mark.parametrize("name", ["paper_1", "paper_1_rigid"])
def test_every_solver_gives_the_same_duration_on_paper_1(name: str, qp_solver: str) -> None:
    agrees(name, qp_solver)


@pytest.mark.parametrize("qp_solver", OTHERS)
@pytest.mark.parametrize("name", ["slider", "hard 5"])
def test_every_solver_gives_the_same_duration_where_the_zmp_costs_time(
    name: str, qp_solver: str
) -> None:
    _, plan = planned(name)
    assert plan.duration > 1.005 * plan.lower_bound
    agrees(name, qp_solver)


@pytest.mark.parametrize("qp_solver", ["proxqp", "qpsolvers:clarabel"])
@pytest.mark.parametrize("seed", [3, 9, 21])  # at rest, in motion, in a corridor
def test_drives_take_the_same_time_by_every_solver(seed: int, qp_solver: str) -> None:
    problem = random_driving_problem(seed).problem
    plan, other = zs.plan(problem), zs.plan(problem, qp_solver=qp_solver)
    assert plan.success
    assert other.success, other.message
    assert other.duration == pytest.approx(plan.duration, rel=SAME)


def test_proxqp_alone_solves_what_it_is_asked_for() -> None:
    """No other solver but the active-set method that takes its answers to the last digit."""
    for named in (paper_1(), slider(intervals=25), random_problem(0, HARD)):
        plan = zs.plan(named.problem, qp_solver="proxqp")
        assert plan.success
        backends = {record.backend.removesuffix(", shortest steps") for record in plan.history}
        assert backends <= {"proxqp", "daqp"}
        assert "proxqp" in backends


@pytest.mark.parametrize("name", ["", "PROXQP", "osqp", "qpsolvers:", "qpsolvers:none", None, 3])
def test_unknown_solvers_are_refused_with_a_list_of_what_there_is(name: object) -> None:
    with pytest.raises(zs.ProblemError, match="proxqp"):
        zs.plan(paper_1().problem, qp_solver=name)


def test_the_history_says_what_every_iteration_did() -> None:
    _, plan = planned("hard 5")
    assert [record.iteration for record in plan.history][:1] == [1]
    for record in plan.history:
        assert record.inner_iterations > 0
        assert record.rows > 0 or record.step == 0.0
        name = record.backend.removesuffix(", shortest steps")
        assert name in ("auto", "daqp", "piqp", "proxqp")
        assert 0.0 <= record.step <= 1.0
        assert record.violation >= 0.0
        assert record.time > 0.0
    runs = [run for run in plan.runs if not run.purpose.startswith("glance")]
    of_runs = sum(run.iterations for run in runs)
    assert plan.history[of_runs - 1].violation <= 1e-6  # glances follow


# --- bits -----------------------------------------------------------------------------------------

SCRIPT = """
import sys
from tests.planning.test_backends import bits
print(bits(sys.argv[1]))
"""
# what moves memory about: arenas, padding, thresholds, hashes, the environment's own size
SETTINGS = (
    {"MALLOC_ARENA_MAX": "1"},
    {"MALLOC_TOP_PAD_": "1000008", "PYTHONHASHSEED": "1"},
    {"MALLOC_MMAP_THRESHOLD_": "4096", "FILLER": "x" * 3001},
    {"MALLOC_PERTURB_": "85", "PYTHONHASHSEED": "7", "FILLER": "x" * 17},
)


def bits(qp_solver: str) -> str:
    """Hash of three plans: at the bound, with the ZMP at its edge, and of one joint."""
    digest = hashlib.sha256()
    for named in (paper_1(), random_problem(0, HARD), slider(intervals=25)):
        motion = zs.plan(named.problem, qp_solver=qp_solver).trajectory
        for part in (motion.times, motion.positions, motion.velocities, motion.accelerations):
            digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()


@pytest.mark.slow
@pytest.mark.parametrize("qp_solver", ["auto", "piqp", "proxqp"])
def test_a_problem_has_the_same_bits_in_every_process_and_thread(qp_solver: str) -> None:
    expected = bits(qp_solver)
    for setting in SETTINGS:
        environment = {**os.environ, "PYTHONPATH": str(ROOT), **setting}
        command = [sys.executable, "-c", SCRIPT, qp_solver]
        found = subprocess.run(
            command, env=environment, cwd=ROOT, capture_output=True, text=True, check=True
        )
        assert found.stdout.strip() == expected, setting
    with ThreadPoolExecutor(2) as pool:
        assert set(pool.map(bits, [qp_solver] * 2)) == {expected}
