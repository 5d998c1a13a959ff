"""What a planner keeps from call to call: only what nothing has changed, and nothing stale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import HARD, random_problem
from zmp_sqp.control.memory import Memory
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.program.solution import trajectory
from zmp_sqp.planning.search.task import task_of
from zmp_sqp.scenario import load_scenario

SEED = 8


@pytest.fixture
def problem() -> zs.Problem:
    return random_problem(SEED, HARD).problem


def planner_of(problem: zs.Problem) -> zs.Planner:
    return zs.Planner(problem.machine, ground=problem.ground, margin=problem.margin)


@pytest.fixture
def checked(monkeypatch) -> list[str]:
    """Boundary states that were checked, by name."""
    names: list[str] = []
    check = Problem._check_boundary

    def noted(self, name: str) -> None:
        names.append(name)
        check(self, name)

    monkeypatch.setattr(Problem, "_check_boundary", noted)
    return names


def next_state(plan: zs.Plan):
    q, v, _ = plan.trajectory(0.1 * plan.duration)
    return q, v


@pytest.fixture
def made(monkeypatch) -> list[Problem]:
    """Problems that were made from arguments."""
    problems: list[Problem] = []
    make = Problem.__post_init__

    def noted(self) -> None:
        problems.append(self)
        make(self)

    monkeypatch.setattr(Problem, "__post_init__", noted)
    return problems


def test_a_problem_is_kept_but_for_its_start_where_nothing_else_has_changed(problem, checked, made):
    planner = planner_of(problem)
    q, v = next_state(planner.plan(problem.start, problem.goal))
    checked.clear()
    made.clear()
    kept = planner.plan(q, problem.goal.copy(), v)
    assert checked == ["start"]
    assert not made
    anew = zs.plan(Problem(problem.machine, q, problem.goal, problem.ground, v))
    assert kept.success
    assert kept.problem.start.tolist() == q.tolist()
    assert kept.problem.goal.tolist() == problem.goal.tolist()
    assert kept.duration == pytest.approx(anew.duration, rel=1e-3)


@pytest.mark.parametrize(
    "change",
    [
        {"margin": 0.01},
        {"ground": zs.Slope(0.01, 0.0)},
        {"intervals": 48},
        {"tipping_fraction": 0.98},
        {"payload_uncertainty": 0.01},
        {"payload_com_uncertainty": np.array([0.01, 0.0, 0.0])},
        {"slope_uncertainty": 0.001},
        {"constraints": (zs.TorqueLimits(),)},
        {"machine": None},
    ],
    ids=lambda change: next(iter(change)),
)
def test_everything_is_checked_anew_where_one_thing_has_changed(problem, made, change):
    limits = replace(problem.machine.limits, effort=np.full(5, 1e7))
    machine = replace(problem.machine, limits=limits)
    planner = zs.Planner(machine, ground=problem.ground)
    q, v = next_state(planner.plan(problem.start, problem.goal))
    if "machine" in change:
        change = {"machine": machine.with_payload_scaled(1.01)}
    for name, value in change.items():
        setattr(planner, name, value)
    made.clear()
    found = planner.plan(q, problem.goal, v)
    assert made
    for name, value in change.items():
        np.testing.assert_array_equal(getattr(found.problem, name), value)


@pytest.mark.parametrize(("seed", "factor"), [(304, 1.1), (346, 1.05), (382, 1.3)])
def test_a_load_that_grows_in_the_model_itself_is_seen_at_the_goal(seed: int, factor: float):
    """On the way to the goal its inertia may hold a machine that tips over once it rests there."""
    problem = random_problem(seed, HARD).problem
    heavy = problem.machine.with_payload_scaled(factor).model
    machine = replace(problem.machine, model=problem.machine.model.copy())
    planner = zs.Planner(machine, ground=problem.ground, margin=problem.margin)
    last = planner.plan(problem.start, problem.goal)
    q, v, _ = last.trajectory(0.6 * last.duration)
    for joint in range(machine.model.njoints):
        machine.model.inertias[joint] = heavy.inertias[joint]
    with pytest.raises(zs.ProblemError, match="tips over at rest at the goal"):
        planner.plan(q, problem.goal, v)


@pytest.mark.parametrize("kind", [np.array, list])
def test_a_goal_that_is_changed_in_place_is_a_new_goal(problem, kind):
    goal, planner = kind(problem.goal), planner_of(problem)
    q, v = next_state(planner.plan(problem.start, goal))
    goal[0] += 0.1
    assert planner.plan(q, goal, v).problem.goal[0] == goal[0]


def test_an_uncertainty_that_is_changed_in_place_is_seen(problem):
    planner = planner_of(problem)
    planner.payload_com_uncertainty = box = np.zeros(3)
    q, v = next_state(planner.plan(problem.start, problem.goal))
    box[0] = 0.01
    found = planner.plan(q, problem.goal, v)
    assert found.problem.payload_com_uncertainty.tolist() == [0.01, 0.0, 0.0]


class TiltingGround:
    """Ground whose gravity changes in place."""

    def __init__(self) -> None:
        self.roll = 0.0

    def gravity(self, yaw: float = 0.0) -> np.ndarray:
        return zs.Slope(self.roll, 0.0).gravity(yaw)


def test_a_ground_that_may_change_is_asked_again(problem):
    ground = TiltingGround()
    planner = zs.Planner(problem.machine, ground=ground)
    q, v = next_state(planner.plan(problem.start, problem.goal))
    ground.roll = np.radians(60.0)
    with pytest.raises(zs.ProblemError, match="tips over at rest at the goal"):
        planner.plan(q, problem.goal, v)


def test_a_refused_start_still_gets_a_stop(problem):
    planner = planner_of(problem)
    q, v = next_state(planner.plan(problem.start, problem.goal))
    outside = q.copy()
    outside[0] = problem.machine.limits.position_upper[0] + 0.1
    stop = planner.plan(outside, problem.goal, v)
    assert "The measured state is refused" in stop.message


def test_a_start_is_checked_like_that_of_a_new_problem(problem):
    with pytest.raises(zs.ProblemError, match="start must have shape"):
        problem.from_start(problem.start[:-1], problem.start_velocity)
    simplified = load_scenario("paper_1_simplified").problem
    other = simplified.from_start(simplified.start, simplified.start_velocity)
    assert other.coordinates is not simplified.coordinates


BASE = zs.UnicycleBase((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0, 0.3, 0.3, 0.3)


def test_motions_in_other_coordinates_are_no_guess(problem):
    """Those of a base that drives, and those of another machine, have other coordinates."""
    planner = planner_of(problem)
    q, v = next_state(planner.plan(problem.start, problem.goal))
    for base in (BASE, None, BASE):
        found = planner.plan(q, problem.goal, v, base=base)
        assert found.success
        assert (found.trajectory.base is None) == (base is None)
    planner.machine, planner.ground = zs.load_machine("excavator"), zs.Slope()
    limits = planner.machine.limits
    start = np.clip(np.zeros(4), limits.position_lower, limits.position_upper)
    assert planner.plan(start, start + np.array([0.2, 0.0, 0.0, 0.0])).success


def test_the_rest_of_a_stop_in_closed_form_holds_the_base_that_drives():
    moving = replace(BASE, start_velocity=(0.3, 0.1))
    start, rates = [0.0, -0.6, -1.9, -0.6, 0.0], [0.2, 0.1, -0.1, 0.05, 0.0]
    stop = zs.plan_stop(zs.load_machine("feller_buncher"), start, rates, base=moving)
    assert stop.status is zs.Status.FASTEST_POSSIBLE
    assert not stop.runs  # braking of every coordinate at once, from no program
    at = 0.3 * stop.duration
    memory = Memory(stop.problem, stop.trajectory, None)
    q, v, _ = stop.trajectory(at)
    pose, velocity, _ = stop.trajectory.base(at)
    rest = replace(stop.problem.base, start=pose, start_velocity=velocity)
    task = task_of(replace(stop.problem, start=q, start_velocity=v, base=rest))
    found = memory.remainder(at)
    program, point = found.on(task, found.grid, found.duration)
    motion = trajectory(task.problem, program, point)
    for t in np.linspace(0.0, found.duration, 9):
        np.testing.assert_allclose(motion(t)[0], stop.trajectory(at + t)[0], atol=1e-7)
        np.testing.assert_allclose(motion.base(t)[0], stop.trajectory.base(at + t)[0], atol=1e-6)
