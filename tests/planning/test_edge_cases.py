"""Problems at the edges: tiny and huge displacements, few intervals, little time, threads."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import random_problem
from benchmarks.problems.checks import check_feasibility
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_1, paper_scene
from benchmarks.problems.scene import NamedProblem
from tests.problems import double_integrator, slider
from zmp_sqp.planning.search.planner import searched
from zmp_sqp.planning.search.run import Runs
from zmp_sqp.planning.search.task import task_of

SAFE = 1e-6


def solved(named: NamedProblem) -> zs.Plan:
    plan = zs.plan(named.problem)
    assert plan.success, plan.message
    assert check_feasibility(named.scene, named.problem, plan.trajectory).violation <= SAFE
    assert plan.lower_bound <= plan.duration
    return plan


def displaced(displacement: np.ndarray, **options: int) -> NamedProblem:
    scene = paper_scene(point_masses=False)
    return NamedProblem(
        "displaced", scene, scene.problem(PAPER_START, PAPER_START + displacement, **options), None
    )


# --- ways ---------------------------------------------------------------------------------------


def test_from_a_pose_to_itself_takes_no_time() -> None:
    named = displaced(np.zeros(5))
    plan = solved(named)
    assert plan.duration == plan.lower_bound == 0.0
    assert plan.iterations == 0
    np.testing.assert_array_equal(plan.trajectory(0.0)[0], PAPER_START)
    # at rest; paper.md has 0.786 for point masses
    assert plan.margin == pytest.approx(1.615 - 0.786, abs=0.02)


@pytest.mark.parametrize("size", [1e-12, 1e-9, 1e-6, 1e-4, 1e-2])
def test_tiny_displacements(size: float) -> None:
    named = displaced(size * np.array([1.0, -0.5, 0.3, 0.1, -1.0]))
    plan = solved(named)
    assert plan.duration >= 2.0 * np.sqrt(size / (np.pi / 2)) * (1.0 - 1e-9)


@pytest.mark.parametrize("size", [1e-9, 1e-6, 1e-3])
def test_tiny_displacements_where_the_zmp_is_active(size: float) -> None:
    """From near the edge every displacement moves the ZMP: T grows with its square root."""
    named = slider(intervals=50)
    problem = named.scene.problem([0.5], [0.5 + size], intervals=50)
    plan = solved(NamedProblem("tiny", named.scene, problem, None))
    assert 0.0 < plan.duration < 1.0


def test_one_joint_moves_alone() -> None:
    plan = solved(displaced(np.array([0.0, 0.0, 0.5, 0.0, 0.0])))
    assert np.ptp(plan.trajectory.positions[:, 2]) == pytest.approx(0.5, abs=1e-6)


@pytest.mark.filterwarnings("ignore::zmp_sqp.MachineWarning")
def test_a_huge_displacement() -> None:
    """Most of a kilometre of the slider."""
    foot = zs.SupportPolygon([[-1e3, -1e3], [1e3, -1e3], [1e3, 1e3], [-1e3, 1e3]])
    room = {"position_lower": -1e4, "position_upper": 1e4}
    limits = room | {"velocity": 1.0, "acceleration": 2.0}
    machine = zs.load_machine("slider", support=foot, limits=limits)
    plan = zs.plan(zs.Problem(machine, [-400.0], [400.0]))
    assert plan.success, plan.message
    assert plan.lower_bound == pytest.approx(800.5, rel=1e-12)
    # the ramps fill one whole interval at either end
    assert 800.5 <= plan.duration <= 800.5 * (1.0 + 1.0 / 49.0)


def test_displacements_of_very_different_size() -> None:
    solved(displaced(np.array([0.3, 1e-9, -1e-6, 1e-3, 0.0])))


@pytest.mark.parametrize("intervals", [2, 3, 4, 7])
def test_few_intervals(intervals: int) -> None:
    named = double_integrator(
        distance=1.0, max_velocity=10.0, max_acceleration=4.0, intervals=intervals
    )
    plan = solved(named)
    assert plan.trajectory.intervals == intervals
    assert len(plan.trajectory.times) == intervals + 1


@pytest.mark.parametrize("intervals", [2, 3, 5])
def test_few_intervals_for_the_arm(intervals: int) -> None:
    solved(displaced(np.array([0.4, 0.1, -0.2, 0.1, 0.3]), intervals=intervals))


@pytest.mark.parametrize("intervals", [2, 3, 5])
def test_few_intervals_where_the_zmp_is_active(intervals: int) -> None:
    """Two accelerations and a duration suffice: bang-bang at the smaller of both ends' bounds."""
    named = slider(intervals=intervals)
    plan = solved(named)
    assert named.optimum is not None
    assert plan.duration >= named.optimum


def test_a_goal_on_a_position_limit_is_reached() -> None:
    machine = zs.load_machine("feller_buncher")
    lower = machine.limits.position_lower
    goal = np.array([0.3, -0.5, lower[2], 0.5, lower[4]])
    scene = paper_scene(point_masses=False)
    solved(NamedProblem("at the limit", scene, scene.problem(PAPER_START, goal), None))


def test_more_intervals_are_no_slower_beyond_the_grid() -> None:
    durations = [solved(paper_1(point_masses=False, intervals=N)).duration for N in (20, 40, 80)]
    assert durations[0] >= durations[1] * (1.0 - 1e-6)
    assert durations[1] >= durations[2] * (1.0 - 1e-6)
    assert durations[2] <= 4.503


# --- what cannot be solved ----------------------------------------------------------------------


def hopeless() -> zs.Problem:
    """A slew on whose path the machine tips over at rest, with all other joints locked."""
    scene = paper_scene(point_masses=False)
    machine = scene.load()
    limits = machine.limits.updated(
        {
            key: {
                name: PAPER_START[i] for i, name in enumerate(machine.joint_names) if name != "slew"
            }
            for key in ("position_lower", "position_upper")
        },
        machine.joint_names,
    )
    locked = replace(machine, limits=limits)
    goal = PAPER_START + np.pi * np.eye(5)[0]
    return zs.Problem(locked, PAPER_START, goal, scene.ground, intervals=20)


def test_a_problem_without_solution_is_a_status_with_a_diagnosis_and_never_a_trajectory() -> None:
    plan = zs.plan(hopeless())
    assert not plan.success
    assert plan.status is zs.Status.INFEASIBLE, plan.message
    assert "left edge" in plan.message
    with pytest.raises(zs.NotSolved, match="left edge"):
        _ = plan.trajectory


# --- time ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("budget", [1e-9, 0.02, 0.2])
def test_a_time_budget_is_kept_and_ends_in_a_safe_plan_or_in_its_status(budget: float) -> None:
    named = random_problem(121)  # several iterations
    zs.plan(named.problem, time_budget=budget)  # imports, caches
    started = time.perf_counter()
    plan = zs.plan(named.problem, time_budget=budget)
    elapsed = time.perf_counter() - started
    assert elapsed <= budget + 2.0  # one iteration and the verification, on a busy machine
    if plan.success:
        assert check_feasibility(named.scene, named.problem, plan.trajectory).violation <= SAFE
    else:
        assert plan.status is zs.Status.TIME_BUDGET
        assert "time budget" in plan.message


def test_time_that_runs_out_between_two_grids_is_no_failure_of_the_qp_solver() -> None:
    runs = Runs.start("auto", 1.0, None, clock=lambda: 0.0)
    # time stands still until a coarse grid is done
    runs.clock = lambda: 2.0 if any(run.status == "coarse" for run in runs.runs) else 0.0
    proven = searched(task_of(random_problem(121).problem), runs)
    assert runs.runs[-1].status == "coarse"
    assert proven.status in (zs.Status.TIME_BUDGET, zs.Status.SAFE)
    assert proven.status.success == proven.certificate.safe


def test_a_time_budget_is_kept_with_many_intervals() -> None:
    """Dense QPs of 4000 variables took half a minute each, and cannot be stopped."""
    problem = paper_scene().problem(PAPER_START, PAPER_GOAL, intervals=800)
    started = time.perf_counter()
    plan = zs.plan(problem, time_budget=0.3)
    assert time.perf_counter() - started <= 5.0  # measured: 0.8
    assert plan.success or plan.status is zs.Status.TIME_BUDGET
    assert all("proxqp" not in record.backend for record in plan.history)


def test_a_large_time_budget_changes_nothing() -> None:
    problem = random_problem(29).problem
    with_budget, without = zs.plan(problem, time_budget=1e6), zs.plan(problem)
    assert bits(with_budget) == bits(without)


def test_progress_is_told_every_iteration() -> None:
    told: list[object] = []
    plan = zs.plan(random_problem(29).problem, progress=told.append)
    assert tuple(told) == plan.history
    assert len(told) == plan.iterations > 0


# --- the same bits ------------------------------------------------------------------------------


def bits(plan: zs.Plan) -> bytes:
    trajectory = plan.trajectory
    arrays = (
        trajectory.times,
        trajectory.positions,
        trajectory.velocities,
        trajectory.accelerations,
        trajectory.jerks,
    )
    return b"".join(array.tobytes() for array in arrays)


@pytest.mark.parametrize("qp_solver", ["proxqp", "piqp"])
def test_the_same_call_twice_gives_the_same_bits(qp_solver: str) -> None:
    """Whatever lay in memory before: ProxQP's sums once gave two results, 1e-13 apart."""
    problem, rng = random_problem(29).problem, np.random.default_rng(0)
    first, litter = bits(zs.plan(problem, qp_solver)), []
    for _ in range(12):
        litter.append(np.empty(rng.integers(100_000, 3_000_000) // 16 * 16, dtype=np.uint8))
        if len(litter) > 3:
            del litter[rng.integers(3)]
        assert bits(zs.plan(problem, qp_solver)) == first


@pytest.mark.parametrize("qp_solver", ["proxqp", "piqp"])
def test_eight_threads_at_once_give_the_same_bits_as_one(qp_solver: str) -> None:
    """Different problems of one size at one time, so that shared state would show."""
    problems = [random_problem(seed).problem for seed in (29, 63, 109, 101)]
    problems.append(paper_1().problem)
    alone = [zs.plan(problem, qp_solver) for problem in problems]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda problem: zs.plan(problem, qp_solver), problems * 3))
    for one, other in zip(alone * 3, together, strict=True):
        assert bits(one) == bits(other)


def test_planning_leaves_the_problem_alone() -> None:
    problem = random_problem(63).problem
    before = [
        np.array(part) for part in (problem.start, problem.goal, problem.machine.limits.velocity)
    ]
    model = problem.machine.model.copy()
    zs.plan(problem)
    for part, now in zip(
        before, (problem.start, problem.goal, problem.machine.limits.velocity), strict=True
    ):
        np.testing.assert_array_equal(part, now)
    assert problem.machine.model == model


def test_a_machine_that_moves_where_it_would_tip_over_at_rest_is_no_plan_of_no_duration() -> None:
    foot = zs.SupportPolygon([[-0.5, -2.0], [0.5, -2.0], [0.5, 2.0], [-0.5, 2.0]])
    slider = zs.load_machine("slider").with_support(foot)
    plan = zs.plan(zs.Problem(slider, [0.9], [0.9], start_velocity=[0.2], goal_velocity=[0.2]))
    assert not plan.success
    assert plan.certificate.margin < -0.3


@pytest.mark.parametrize("rate", [-0.2, 0.2])
def test_the_lower_bound_of_going_nowhere_in_motion_is_zero(rate: float) -> None:
    slider = zs.load_machine("slider")
    plan = zs.plan(zs.Problem(slider, [0.1], [0.1], start_velocity=[rate], goal_velocity=[rate]))
    assert plan.lower_bound == 0.0
