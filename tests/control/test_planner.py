"""Planner for control code: warm starts, changed questions, budgets, stops, refusals."""

from __future__ import annotations

import copy
import itertools
import multiprocessing
import os
import pickle
import threading
import traceback
from dataclasses import replace

import numpy as np
import pytest

import zmp_sqp as zs
import zmp_sqp.control.planner as planner_module
from benchmarks.problems.arm import HARD, random_problem
from benchmarks.problems.paper import paper_scene
from benchmarks.problems.scene import GRAVITY
from benchmarks.problems.terrain import random_drive_problem, unicycle_base
from tests.problems import CRANE_HEIGHT, slew
from zmp_sqp.planning.search.explore import explore
from zmp_sqp.planning.search.messages import failure_message
from zmp_sqp.planning.search.prove import prove
from zmp_sqp.planning.search.run import Runs
from zmp_sqp.planning.search.task import task_of
from zmp_sqp.scenario import load_scenario
from zmp_sqp.sqp.backends.piqp import PIQP

SAME = 1e-4  # relative difference of durations, the issue's
ACTIVE = (5, 25, 30, 204)  # seeds of hard problems whose tip-over limit costs time
AT_BOUND = (1, 8, 21)


def planner_of(problem: zs.Problem, **options) -> zs.Planner:
    return zs.Planner(problem.machine, ground=problem.ground, margin=problem.margin, **options)


def from_state(problem: zs.Problem, q, v) -> zs.Problem:
    return replace(problem, start=q, start_velocity=v)


def check(plan: zs.Plan, q, v) -> None:
    assert plan.success, plan.message
    assert plan.certificate.safe
    np.testing.assert_allclose(plan.trajectory.positions[0], q, atol=2e-6)
    np.testing.assert_allclose(plan.trajectory.velocities[0], v, atol=2e-6)


def test_new_plans_along_the_last_one_are_those_of_cold_starts():
    slower = []
    for seed in (*ACTIVE, *AT_BOUND):
        problem = random_problem(seed, HARD).problem
        for share in (0.05, 0.4):
            planner = planner_of(problem)
            first = planner.plan(problem.start, problem.goal)
            q, v, _ = first.trajectory(share * first.duration)
            warm = planner.plan(q, problem.goal, v)
            cold = zs.plan(from_state(problem, q, v))
            check(warm, q, v)
            assert warm.duration <= (1.0 - share) * first.duration * (1.0 + 1e-9)
            assert warm.certificate.margin >= problem.margin
            slower.append(warm.duration / cold.duration - 1.0)
    assert np.median(slower) <= SAME
    # now and then one of the two ends in a slightly better local minimum
    assert max(slower) <= 1e-3
    assert np.sum(np.array(slower) > SAME) <= 2


@pytest.mark.parametrize("seed", ACTIVE)
def test_a_new_plan_takes_fewer_iterations_than_a_cold_start(seed):
    problem = random_problem(seed, HARD).problem
    planner = planner_of(problem)
    first = planner.plan(problem.start, problem.goal)
    q, v, _ = first.trajectory(0.1 * first.duration)
    warm, cold = planner.plan(q, problem.goal, v), zs.plan(from_state(problem, q, v))
    assert warm.iterations <= 0.6 * cold.iterations
    assert [run.purpose for run in warm.runs] == ["from the remainder of the last motion"]


def test_within_a_budget_the_rest_of_an_optimal_motion_is_the_plan_for_a_short_time():
    problem = random_problem(5, HARD).problem
    planner = planner_of(problem)
    long = {"time_budget": 60.0}  # [s]: no reason to stop searching
    first = planner.plan(problem.start, problem.goal, **long)
    for at in (0.01, 0.02):  # shares of the first plan
        q, v, _ = first.trajectory(at * first.duration)
        rest = planner.plan(q, problem.goal, v, elapsed=0.01 * first.duration, **long)
        check(rest, q, v)
        assert rest.status is first.status
        assert rest.iterations == 0
        assert rest.duration == pytest.approx((1.0 - at) * first.duration, abs=1e-9)
        searched = zs.plan(from_state(problem, q, v))
        assert rest.duration <= searched.duration * (1.0 + 5e-4)
    # later it is searched again, and so it is with another payload
    q, v, _ = first.trajectory(0.05 * first.duration)
    assert planner.plan(q, problem.goal, v, elapsed=0.03 * first.duration, **long).iterations > 0
    planner.machine = problem.machine.with_payload_scaled(0.9)
    lighter = planner.plan(q, problem.goal, v, elapsed=0.0, **long)
    assert lighter.iterations > 0
    assert lighter.duration < (1.0 - 0.05) * first.duration


def test_where_a_search_promises_nothing_the_certified_rest_is_the_plan():
    problem = random_problem(4, HARD).problem
    planner = planner_of(problem)
    first = planner.plan(problem.start, problem.goal)
    at = 0.05  # [s]
    q, v, _ = first.trajectory(at)
    rest = planner.plan(q, problem.goal, v, elapsed=at)
    check(rest, q, v)
    assert rest.status is zs.Status.OPTIMAL
    assert [run.status for run in rest.runs] == ["no_gain"]
    assert rest.duration == pytest.approx(first.duration - at, abs=1e-9)
    assert rest.duration <= zs.plan(from_state(problem, q, v)).duration * (1.0 + SAME)
    # for another goal there is no rest to fall back on
    goal = problem.goal + np.array([0.05, 0.0, 0.0, 0.0, 0.0])
    moved = planner.plan(q, goal, v, elapsed=0.0)
    check(moved, q, v)
    assert "no_gain" not in [run.status for run in moved.runs]


def test_a_plan_from_nothing_leaves_no_search_unfinished():
    """After it the next call, too, probes at the bound, where tip-over shapes nothing."""
    problem = load_scenario("paper_1").problem
    planner = planner_of(problem)
    first = planner.plan(problem.start, problem.goal)
    at = 0.1 * first.duration
    q, v, _ = first.trajectory(at)
    moved = planner.plan(q, problem.goal + 0.01, v, elapsed=at)
    check(moved, q, v)
    assert moved.runs[0].purpose == "probe at the bound"


@pytest.mark.parametrize("seed", [5, 12, 8])
def test_disturbed_states_changed_goals_and_payloads_are_planned_anew(seed):
    problem = random_problem(seed, HARD).problem
    rng = np.random.default_rng(seed)
    planner = planner_of(problem)
    first = planner.plan(problem.start, problem.goal)
    q, v, _ = first.trajectory(0.2 * first.duration)
    limits = problem.machine.limits
    q = np.clip(q + rng.normal(0.0, 1e-3, 5), limits.position_lower, limits.position_upper)
    v = np.clip(v + rng.normal(0.0, 1e-3, 5), -limits.velocity, limits.velocity)
    disturbed = planner.plan(q, problem.goal, v)
    check(disturbed, q, v)

    goal = problem.goal + np.array([0.1, 0.0, 0.0, -0.05, 0.0])
    moved = planner.plan(q, goal, v)
    check(moved, q, v)
    np.testing.assert_allclose(moved.trajectory.positions[-1], goal, atol=1e-6)

    planner.machine = problem.machine.with_payload_scaled(0.9)
    lighter = planner.plan(q, goal, v)
    check(lighter, q, v)
    again = zs.certify(planner.machine, lighter.trajectory, problem.ground)
    assert again.margin == pytest.approx(lighter.margin, abs=1e-12)
    cold = zs.plan(replace(problem, machine=planner.machine, goal=goal, start=q, start_velocity=v))
    assert lighter.duration <= cold.duration * 1.005


def test_without_time_the_rest_of_the_last_motion_is_kept():
    problem = random_problem(5, HARD).problem
    planner = planner_of(problem)
    first = planner.plan(problem.start, problem.goal)
    for share in (0.1, 0.3, 0.5):
        at = share * first.duration
        q, v, _ = first.trajectory(at)
        kept = planner.plan(q, problem.goal, v, time_budget=1e-6)
        check(kept, q, v)
        assert kept.status is zs.Status.KEPT
        assert kept.duration == pytest.approx(first.duration - at, abs=1e-9)
        np.testing.assert_allclose(kept.trajectory.positions[-1], problem.goal, atol=1e-9)


def test_without_time_and_off_the_last_motion_the_machine_stops():
    problem = random_problem(8, HARD).problem
    planner = planner_of(problem)
    first = planner.plan(problem.start, problem.goal)
    q, v, _ = first.trajectory(0.4 * first.duration)
    q = q + 0.02
    stop = planner.plan(q, problem.goal, 0.9 * v, time_budget=1e-6)
    check(stop, q, 0.9 * v)
    assert stop.status is zs.Status.STOP
    assert "does not reach the goal" in stop.message
    np.testing.assert_allclose(stop.trajectory.velocities[-1], 0.0, atol=1e-9)
    # with time, the goal is reached from there
    t = 0.5 * stop.duration
    q, v, _ = stop.trajectory(t)
    check(planner.plan(q, problem.goal, v), q, v)


def test_a_first_call_without_time_stays_where_the_machine_stands():
    problem = random_problem(5, HARD).problem
    planner = planner_of(problem)
    plan = planner.plan(problem.start, problem.goal, time_budget=1e-6)
    check(plan, problem.start, 0.0)
    assert plan.status is zs.Status.STOP
    assert plan.duration == 0.0


def test_within_a_budget_a_motion_at_the_bound_is_probed_for_first():
    """It needs no motion to join beside it, and from rest no stop."""
    problem = random_problem(28, HARD).problem
    planner = planner_of(problem)
    long = {"time_budget": 60.0}  # [s]
    first = planner.plan(problem.start, problem.goal, **long)
    cold = zs.plan(problem)
    assert [run.purpose for run in first.runs] == [run.purpose for run in cold.runs]
    at = 0.1 * first.duration
    q, v, _ = first.trajectory(at)
    goal = problem.goal + np.array([0.05, 0.0, 0.0, 0.0, 0.0])
    moved = planner.plan(q, goal, v, elapsed=at, **long)
    check(moved, q, v)
    assert moved.status is zs.Status.FASTEST_POSSIBLE
    assert [run.purpose for run in moved.runs] == ["probe at the bound"]


def test_where_the_answer_is_due_no_certificate_is_begun():
    problem = random_problem(28, HARD).problem
    task = task_of(problem)
    runs = Runs.start("piqp", None, None)
    found = explore(task, runs)
    assert prove(task, found, runs).status.success
    runs.ends = runs.clock() + 60.0  # [s]
    assert prove(task, found, runs).status.success
    runs.ends = runs.clock()
    late = prove(task, found, runs)
    assert late.status is zs.Status.TIME_BUDGET
    assert failure_message(problem, late.status, late.certificate) == str(zs.Status.TIME_BUDGET)
    assert not late.certificate.safe
    assert late.attempt is not None


def test_a_first_call_over_terrain_without_time_for_a_proof_stays():
    problem = random_drive_problem(9, over_terrain=True)
    planner = planner_of(problem)
    ticks = itertools.count()
    planner.clock = lambda: 1e-3 * next(ticks)  # [s] a millisecond for every look
    stays = planner.plan(problem.start, problem.goal, time_budget=0.005, base=problem.base)
    assert stays.status is zs.Status.STOP
    assert stays.certificate.safe
    np.testing.assert_array_equal(stays.trajectory.positions[-1], problem.start)
    # no motion was looked at, so that there is nothing to say about one
    assert stays.message == f"{zs.Status.TIME_BUDGET} {zs.Status.STOP}"
    assert [run.purpose for run in stays.runs] in ([], ["probe at the bound"])


def test_a_search_that_found_nothing_in_time_goes_on_at_the_next_call():
    ticks = itertools.count()
    # a clock that goes on by a millisecond whenever it is read, so that every run is the same
    problem = random_problem(5, HARD).problem
    planner, statuses = planner_of(problem, clock=lambda: 1e-3 * next(ticks)), []
    for _ in range(20):
        plan = planner.plan(problem.start, problem.goal, time_budget=0.03)
        check(plan, problem.start, 0.0)
        statuses.append(plan.status)
        if plan.status is not zs.Status.STOP:
            break
    assert statuses[0] is zs.Status.STOP
    assert statuses[-1] is not zs.Status.STOP
    assert plan.duration <= 1.05 * zs.plan(problem).duration


def test_measurement_noise_beyond_a_limit_is_taken_to_be_at_the_limit():
    problem = random_problem(5, HARD).problem
    limits = problem.machine.limits
    planner = planner_of(problem)
    q = problem.start.copy()
    v = np.zeros(5)
    v[0] = 1.02 * limits.velocity[0]
    plan = planner.plan(q, problem.goal, v)
    v[0] = limits.velocity[0]
    check(plan, q, v)


def test_a_state_far_outside_the_limits_is_refused_with_the_stop_that_is_possible():
    problem = random_problem(5, HARD).problem
    v = np.zeros(5)
    v[0] = 1.5 * problem.machine.limits.velocity[0]
    plan = planner_of(problem).plan(problem.start, problem.goal, v)
    assert plan.status is zs.Status.STOP
    assert "refused" in plan.message
    assert "'slew'" in plan.message
    check(plan, problem.start, v)
    np.testing.assert_allclose(plan.trajectory.velocities[-1], 0.0, atol=1e-9)


def test_a_state_that_tips_over_whatever_the_joints_do_is_told_with_the_least_violating_stop():
    # the turning mass of a crane on a foot of 1.2 m pulls the ZMP out by (h / g) w^2 > 0.2 m
    machine = slew(radius=1.2, angle=1.0).problem.machine
    fast = 1.2 * np.sqrt(0.2 * GRAVITY / CRANE_HEIGHT)
    plan = zs.Planner(machine.with_limits(velocity=10.0, acceleration=1.0)).plan(
        [0.0], [1.0], [fast]
    )
    assert not plan.success
    assert "refused" in plan.message
    assert plan.attempt is not None
    with pytest.raises(zs.NotSolved):
        _ = plan.trajectory


def test_a_goal_that_is_refused_raises_and_keeps_the_last_motion():
    problem = random_problem(5, HARD).problem
    planner = planner_of(problem)
    first = planner.plan(problem.start, problem.goal)
    beyond = problem.machine.limits.position_upper + 1.0
    with pytest.raises(zs.ProblemError, match="goal"):
        planner.plan(problem.start, beyond)
    q, v, _ = first.trajectory(0.2)
    check(planner.plan(q, problem.goal, v, time_budget=1e-6), q, v)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"start": np.zeros(4)}, "start"),
        ({"start_velocity": np.full(5, np.inf)}, "start_velocity"),
        ({"time_budget": 0.0}, "time_budget"),
        ({"time_budget": np.nan}, "time_budget"),
        ({"goal": "home"}, "goal"),
        ({"elapsed": "soon"}, "elapsed must be a number"),
        ({"progress": 5}, "progress must be a function"),
    ],
)
def test_wrong_arguments_are_refused(arguments, complaint):
    problem = random_problem(5, HARD).problem
    given = {"start": problem.start, "goal": problem.goal, **arguments}
    with pytest.raises(zs.ProblemError, match=complaint):
        planner_of(problem).plan(**given)


def test_a_planner_in_use_refuses_another_thread():
    problem = random_problem(5, HARD).problem
    planner, inside, done = planner_of(problem), threading.Event(), threading.Event()

    def report(_):
        inside.set()
        done.wait(10.0)

    def work():
        planner.plan(problem.start, problem.goal, progress=report)

    thread = threading.Thread(target=work)
    thread.start()
    assert inside.wait(10.0)
    with pytest.raises(zs.ProblemError, match="thread"):
        planner.plan(problem.start, problem.goal)
    done.set()
    thread.join()
    check(planner.plan(problem.start, problem.goal), problem.start, 0.0)


def test_a_planner_does_not_wait_for_another_one():
    """While the constraint of one planner is evaluated, the other one plans."""
    problem = random_problem(0, HARD).problem
    waits, inside, last = (threading.Event() for _ in range(3))

    def rate(machine, q, v, a):
        if waits.is_set() and any(call.name == "proven" for call in traceback.extract_stack()):
            inside.set()
            assert last.wait(30.0), "the other planner waits for this one"
        jacobian = np.zeros((len(q), 1, 3 * machine.size))
        jacobian[:, 0, machine.size] = 1.0
        return v[:, :1] - 10.0, jacobian

    one, other = planner_of(problem), planner_of(problem)
    one.constraints = [zs.PathRows("rate", rate)]
    plans = [planner.plan(problem.start, problem.goal) for planner in (one, other)]
    states = [plan.trajectory(0.1)[:2] for plan in plans]
    found = []

    def work():
        q, v = states[0]
        found.append(one.plan(q, problem.goal, v, elapsed=0.1))

    thread = threading.Thread(target=work)
    waits.set()
    thread.start()
    assert inside.wait(30.0)
    q, v = states[1]
    assert other.plan(q, problem.goal, v, elapsed=0.1).success
    last.set()
    thread.join()
    assert found[0].success


def test_a_time_that_is_negative_by_rounding_is_now():
    problem = random_problem(5, HARD).problem
    planner = planner_of(problem)
    first = planner.plan(problem.start, problem.goal)
    again = planner.plan(problem.start, problem.goal, elapsed=0.3 - (0.1 + 0.2))
    assert again.duration == first.duration


def test_a_progress_function_cannot_plan_with_its_planner():
    problem = random_problem(5, HARD).problem
    planner, said = planner_of(problem), []

    def report(record):
        with pytest.raises(zs.ProblemError, match="planning already: its progress function"):
            planner.plan(problem.start, problem.goal)
        said.append(record)

    plan = planner.plan(problem.start, problem.goal, progress=report)
    assert plan.success
    assert said


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_process_forked_while_another_thread_plans_can_plan():
    problem = random_problem(5, HARD).problem
    planner, inside, done = planner_of(problem), threading.Event(), threading.Event()

    def report(record):
        inside.set()
        done.wait(60.0)

    def work():
        planner.plan(problem.start, problem.goal, progress=report)

    def child(pipe):
        own = zs.plan(problem).duration
        pipe.send((own, planner.plan(problem.start, problem.goal).duration))

    thread = threading.Thread(target=work)
    thread.start()
    assert inside.wait(10.0)
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe()
    process = context.Process(target=child, args=(theirs,))
    process.start()
    try:
        assert ours.poll(60.0), "the forked process waits for a thread that it does not have"
        durations = ours.recv()
    finally:
        done.set()
        process.kill()
        thread.join()
    assert durations == (zs.plan(problem).duration,) * 2


def test_the_same_calls_give_the_same_bits():
    problem = random_problem(12, HARD).problem

    def walk() -> list[np.ndarray]:
        planner, found = planner_of(problem), []
        q, v = problem.start, np.zeros(5)
        for _ in range(3):
            plan = planner.plan(q, problem.goal, v)
            q, v, _ = plan.trajectory(0.3)
            found += [plan.trajectory.positions, plan.trajectory.times]
        return found

    for one, other in zip(walk(), walk(), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_driving_base_is_planned_anew_on_its_way():
    scene = paper_scene()
    machine, q = scene.load(), np.array([0.0, -0.8, -2.0, 0.7, 0.0])
    planner = zs.Planner(machine)
    base = unicycle_base((0.0, 0.0, 0.0), (5.0, 1.0, 0.0))
    first = planner.plan(q, q, base=base)
    assert first.success
    at = 0.3 * first.duration
    pose, rates, _ = first.trajectory.base(at)
    joints, v, _ = first.trajectory(at)
    now = unicycle_base(pose, (5.0, 1.0, 0.0), start_velocity=rates)
    again = planner.plan(joints, q, v, base=now)
    check(again, joints, v)
    assert again.duration <= (first.duration - at) * (1.0 + 1e-3)
    stop = planner.plan(joints, q, v, base=now, time_budget=1e-6)
    assert stop.success


@pytest.mark.parametrize("off", [0.0, 2e-16, 1e-9, 1e-7])
@pytest.mark.parametrize("budget", [None, 0.02])
def test_at_its_goal_a_machine_is_there_whatever_was_rounded(off: float, budget: float | None):
    problem = load_scenario("paper_1").problem
    planner = planner_of(problem, constraints=[zs.TorqueLimits()])
    for k in range(3):
        q, v = problem.start + off, np.full(5, 0.1 * off)
        plan = planner.plan(q, problem.start, v, time_budget=budget, elapsed=0.05 if k else None)
        check(plan, q, v)
        assert plan.status is zs.Status.FASTEST_POSSIBLE
        assert plan.duration == plan.lower_bound == 0.0


def test_what_is_no_machine_is_refused_by_name():
    problem = load_scenario("paper_1").problem
    planner = planner_of(problem)
    planner.plan(problem.start, problem.goal)
    planner.machine = "feller_buncher"
    with pytest.raises(zs.ProblemError, match="machine must be a Machine, not 'feller_buncher'"):
        planner.plan(problem.start, problem.goal)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"machine": None}, "machine must be a Machine"),
        ({"qp_solver": "best"}, "unknown QP solver 'best'"),
        ({"clock": 3.0}, "clock must be a function"),
        ({"intervals": -3}, "intervals"),
        ({"model": "foo"}, "unknown model 'foo'"),
        ({"constraints": 5}, "constraints must be a list"),
        ({"payload_uncertainty": 1.5}, "payload_uncertainty must lie within"),
        ({"payload_com_uncertainty": -1.0}, "payload_com_uncertainty"),
        ({"ground": "level"}, "ground"),
    ],
)
def test_a_planner_that_cannot_plan_is_refused_at_once(options, complaint):
    given = {"machine": load_scenario("paper_1").problem.machine, **options}
    with pytest.raises(zs.ProblemError, match=complaint):
        zs.Planner(**given)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copy_of_a_planner_goes_on_with_the_same_bits(copied):
    problem = random_problem(5, HARD).problem
    planner = planner_of(problem)
    first = planner.plan(problem.start, problem.goal)
    other = copied(planner)
    q, v, _ = first.trajectory(0.5)
    own, same = (one.plan(q, problem.goal, v, elapsed=0.5) for one in (planner, other))
    check(own, q, v)
    assert own.iterations == same.iterations
    for name in ("times", "positions", "accelerations", "jerks"):
        np.testing.assert_array_equal(getattr(own.trajectory, name), getattr(same.trajectory, name))


@pytest.mark.parametrize("intervals", [12, 20])
def test_a_new_goal_is_planned_for_although_a_budget_has_no_room_for_two_certificates(intervals):
    """By a clock that counts looks at it: what a step and a certificate take does not depend on
    the computer."""
    problem = load_scenario("paper_1").problem
    planner = planner_of(problem, constraints=[zs.TorqueLimits()], intervals=intervals)
    planner.plan(problem.start, problem.goal)
    ticks = itertools.count()
    planner.clock = lambda: 1e-3 * next(ticks)  # [s] a millisecond for every look
    planner._step_time, planner._proof_time = 1e-3, 8e-3
    q, v, goal = problem.start, 0.0 * problem.start, problem.goal - [0.3, 0.0, 0.0, 0.0, 0.0]
    reached = []
    for _ in range(60):
        plan = planner.plan(q, goal, v, time_budget=0.02, elapsed=0.05)
        assert plan.success
        assert plan.certificate.safe
        reached.append(bool(np.allclose(plan.trajectory.positions[-1], goal, atol=1e-5)))
        q, v, _ = plan.trajectory(min(0.05, plan.duration))
    assert any(reached)


def test_one_slow_certificate_does_not_leave_a_planner_without_time_for_ever():
    problem = load_scenario("paper_1").problem
    planner = planner_of(problem, constraints=[zs.TorqueLimits()], intervals=20)
    plan = planner.plan(problem.start, problem.goal)
    planner._step_time, planner._proof_time = 1e-3, 0.2  # [s] as if the computer had been busy
    planner._measured = 1e-3, 0.2
    goal = problem.goal - [0.3, 0.0, 0.0, 0.0, 0.0]
    q, v, _ = plan.trajectory(0.05)
    said = planner.plan(q, goal, v, time_budget=0.1, elapsed=0.05).message
    expected = "a step takes about 10 ms, and a certificate, of which there may be two, 200"
    assert "No step of the search fits into the 100 ms" in said
    assert expected in said
    for _ in range(40):
        plan = planner.plan(q, goal, v, time_budget=0.1)
        if plan.status is zs.Status.KEPT and "No step" in plan.message:  # not what is hoped for
            assert "about 0 ms" not in plan.message
        if np.allclose(plan.trajectory.positions[-1], goal, atol=1e-5):
            return
    pytest.fail("no motion to the new goal")


@pytest.mark.parametrize(("step", "finds"), [(7e-4, True), (4e-3, False)])
def test_a_machine_at_rest_leaves_it_by_a_motion_on_few_intervals_or_says_why_not(
    step: float, finds: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With 10 ms, of which a QP takes `step` times the intervals, by a clock of this test alone."""
    problem, now = load_scenario("paper_1").problem, [0.0]
    solve = PIQP.solve

    def slow(self, qp, **options):
        now[0] += step * qp.size / 10.0  # about ten variables per interval
        return solve(self, qp, **options)

    monkeypatch.setattr(PIQP, "solve", slow)
    planner = planner_of(problem, clock=lambda: now[0])
    said = []
    for _ in range(20):
        plan = planner.plan(problem.start, problem.goal, time_budget=0.01)
        assert plan.success  # a stop where there is nothing else
        said.append(plan.message)
        if plan.status is not zs.Status.STOP:
            break
    assert (plan.status is not zs.Status.STOP) is finds
    if not finds:
        assert any("No step of the search fits into the 10 ms" in text for text in said)


def test_a_machine_that_still_stands_is_not_certified_again(monkeypatch: pytest.MonkeyPatch):
    """Stops within a budget cost no time where nothing has changed."""
    problem, made = load_scenario("paper_1").problem, []
    stop = planner_module.stop_plan

    def counted(*given, **options):
        made.append(given)
        return stop(*given, **options)

    monkeypatch.setattr(planner_module, "stop_plan", counted)
    planner = planner_of(problem)
    tall = problem.machine.with_payload(zs.Payload(mass=3000.0, com=(0.0, 0.0, 1.0), frame="head"))
    start, rest = problem.start, np.zeros(5)

    def stopped(q=start, v=rest):
        fields = planner._fields(np.array(q), np.array(v), None)
        return planner._stop(fields, planner._runs(None, None))

    first = stopped()
    assert first.success
    assert stopped() is first
    assert len(made) == 1
    planner.margin = 0.05
    assert stopped().certificate.required == 0.05
    planner.ground = zs.Slope(roll=0.1)
    assert stopped().problem.ground.roll == 0.1
    planner.machine = tall
    assert stopped().problem.machine is tall
    assert stopped(q=start + 0.01).trajectory.positions[0][0] == start[0] + 0.01
    for _ in range(2):
        assert stopped(v=rest + 0.01).duration > 0.0
    assert len(made) == 7
