"""Stops: closed forms, the free end, the state at the end, and what cannot stop."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import HARD, random_problem
from benchmarks.problems.checks import joint_limit_excess
from benchmarks.problems.scene import GRAVITY
from benchmarks.problems.terrain import unicycle_base
from tests.problems import SLIDER_HEIGHT, SLIDER_SHARE, slider
from zmp_sqp.control.stop import StopProblem, plan_stop
from zmp_sqp.planning.problem.statics import stands_at_rest

START = np.array([0.0, -0.8, -2.0, 0.7, 0.0])  # of the feller-buncher, slew to head [rad]


def check(stop: zs.Plan, q: Any, v: Any) -> None:
    """Certified, from the state to rest, where the machine can stand."""
    assert stop.success, stop.message
    assert stop.certificate.safe
    assert stop.certificate.limits_ok
    motion = stop.trajectory
    np.testing.assert_allclose(motion.positions[0], q, atol=1e-9)
    np.testing.assert_allclose(motion.velocities[0], v, atol=1e-9)
    np.testing.assert_allclose(motion.velocities[-1], 0.0, atol=1e-9)
    end = motion.positions[-1][None]
    problem = stop.problem
    standing = zs.stability_margin(problem.machine, end, 0.0 * end, 0.0 * end, problem.ground)
    assert standing[0] >= problem.margin - 1e-6


def slider_stop(x: float, v: float, half_length: float = 0.5) -> float:
    r"""Fastest stop of the slider from position x at rate v > 0 [s].

    The ZMP (m/M)(x - (h/g) x'') stays behind the front edge a M/m where x'' >= (g/h)(x - a). On the
    edge, y = x - a obeys y'' = omega^2 y with omega^2 = g/h, so that y' = 0 at
    tanh(omega t) = v / (omega (a - x)).
    """
    omega, a = np.sqrt(GRAVITY / SLIDER_HEIGHT), half_length * SLIDER_SHARE
    return float(np.arctanh(v / (omega * (a - x))) / omega)


@pytest.mark.parametrize(("x", "v"), [(-0.2, 0.8), (0.0, 0.5), (0.2, 0.6), (-0.4, 1.5)])
def test_a_slider_stops_in_the_time_of_the_closed_form(x, v):
    scene = slider().problem
    stop = plan_stop(scene.machine, [x], [v], intervals=40)
    check(stop, [x], [v])
    assert stop.duration == pytest.approx(slider_stop(x, v), rel=2e-3)
    assert stop.duration >= slider_stop(x, v) * (1.0 - 1e-9)


def test_a_slider_too_fast_for_the_foot_is_told_so():
    scene = slider().problem
    x, omega = 0.2, np.sqrt(GRAVITY / SLIDER_HEIGHT)
    fast = 1.05 * omega * (0.5 * SLIDER_SHARE - x)
    stop = plan_stop(scene.machine, [x], [fast], intervals=20)
    assert not stop.success
    assert stop.attempt is not None
    with pytest.raises(zs.NotSolved):
        _ = stop.trajectory


def test_braking_every_joint_with_its_largest_acceleration_where_that_is_safe():
    machine = zs.load_machine("feller_buncher")
    v = np.array([0.2, 0.1, -0.1, 0.05, 0.0])
    stop = plan_stop(machine, START, v)
    check(stop, START, v)
    times = np.abs(v) / machine.limits.acceleration
    assert stop.duration == pytest.approx(times.max(), rel=1e-7)  # limits have a guard of 1e-8
    assert stop.status is zs.Status.FASTEST_POSSIBLE
    way = START + 0.5 * v * np.abs(v) / machine.limits.acceleration
    np.testing.assert_allclose(stop.trajectory.positions[-1], way, atol=1e-9)
    np.testing.assert_allclose(stop.problem.goal, way, atol=1e-9)


def test_a_machine_at_rest_stays_where_it_is():
    machine = zs.load_machine("feller_buncher")
    stop = plan_stop(machine, START, np.zeros(5))
    check(stop, START, np.zeros(5))
    assert stop.duration == 0.0


@pytest.mark.parametrize("seed", [5, 13, 17, 30, 204])
def test_stops_from_hard_motions_are_certified_and_faster_than_their_rest(seed):
    problem = random_problem(seed, HARD).problem
    plan = zs.plan(problem)
    for share in (0.25, 0.6):
        at = share * plan.duration
        q, v, _ = plan.trajectory(at)
        stop = plan_stop(problem.machine, q, v, problem.ground)
        check(stop, q, v)
        assert stop.lower_bound <= stop.duration <= (plan.duration - at) * (1.0 + 1e-6)
        assert joint_limit_excess(problem.machine.limits, stop.trajectory) <= 1e-9


def test_a_margin_is_kept_and_costs_time():
    machine = slider().problem.machine
    near, far = (plan_stop(machine, [-0.2], [0.6], margin=margin) for margin in (0.0, 0.1))
    check(near, [-0.2], [0.6])
    check(far, [-0.2], [0.6])
    assert far.margin >= 0.1
    assert far.duration == pytest.approx(slider_stop(-0.2, 0.6, half_length=0.4), rel=5e-3)
    assert far.duration > near.duration


def test_limits_are_widened_where_the_state_is_outside_of_them():
    machine = zs.load_machine("feller_buncher")
    v = np.array([1.3 * machine.limits.velocity[0], 0.0, 0.0, 0.0, 0.0])
    q = START.copy()
    q[1] = machine.limits.position_upper[1] + 0.05
    stop = plan_stop(machine, q, v)
    check(stop, q, v)
    assert stop.problem.machine.limits.velocity[0] == v[0]


@pytest.mark.parametrize("slope", [0.0, 0.15])
def test_a_driving_base_stops_with_its_arm(slope):
    machine = zs.load_machine("feller_buncher")
    ground = zs.Slope(pitch=slope)
    base = unicycle_base((1.0, 2.0, 0.5), (9.0, 9.0, 0.0), start_velocity=(0.8, 0.1))
    v = np.array([0.5, 0.0, 0.2, 0.0, 0.0])
    stop = plan_stop(machine, START, v, ground, base=base)
    check(stop, START, v)
    moved = stop.trajectory.base
    np.testing.assert_allclose(moved.poses[0], [1.0, 2.0, 0.5], atol=1e-9)
    np.testing.assert_allclose(moved.velocities[0], [0.8, 0.1], atol=1e-9)
    np.testing.assert_allclose(moved.velocities[-1], 0.0, atol=1e-9)
    assert stop.duration >= 0.8 / base.max_acceleration - 1e-9
    np.testing.assert_allclose(stop.problem.base.goal, moved.poses[-1])


def test_a_driving_base_that_must_not_brake_at_once_takes_longer():
    problem = random_problem(5, HARD).problem
    machine = problem.machine
    base = unicycle_base(start_velocity=(1.0, 0.0), max_acceleration=15.0)
    stop = plan_stop(machine, problem.start, np.zeros(5), problem.ground, base=base)
    check(stop, problem.start, np.zeros(5))
    assert stop.duration > 1.0 / 15.0 * 1.1


@pytest.mark.parametrize("payload_uncertainty", [0.0, 0.1])
def test_an_end_stands_where_a_problem_would_accept_it_as_goal(payload_uncertainty: float):
    problem = random_problem(5, HARD).problem
    limits, rng = problem.machine.limits, np.random.default_rng(0)
    answers = []
    for q in rng.uniform(np.maximum(limits.position_lower, -3.0), limits.position_upper, (60, 5)):
        fields = {"margin": problem.margin, "payload_uncertainty": payload_uncertainty}
        there = StopProblem(problem.machine, q, q, problem.ground, **fields)
        stands = stands_at_rest(there.corners(), q, pose=None, margin=there.margin)
        if stands:
            zs.Problem(problem.machine, q, q, problem.ground, **fields)
        else:
            with pytest.raises(zs.ProblemError, match="at rest"):
                zs.Problem(problem.machine, q, q, problem.ground, **fields)
        answers.append(stands)
    assert 5 < sum(answers) < 55


def test_wrong_arguments_are_refused():
    machine = zs.load_machine("feller_buncher")
    for q, v, complaint in (
        (START[:4], np.zeros(5), "start"),
        (START, np.full(5, np.nan), "velocity"),
    ):
        with pytest.raises(zs.ProblemError, match=complaint):
            plan_stop(machine, q, v)
    with pytest.raises(zs.ProblemError, match="margin"):
        plan_stop(machine, START, np.zeros(5), margin=-1.0)


@pytest.mark.parametrize("margin", [0.0, 0.3])
def test_a_machine_at_rest_that_misses_its_margin_gets_no_motion(margin: float) -> None:
    """It stands still already, so that there is nothing to search for."""
    problem = random_problem(3, HARD).problem
    machine, start = problem.machine, problem.start
    steep = zs.Slope(roll=1.0)
    stop = zs.plan_stop(machine, start, np.zeros(5), steep, margin=margin)
    assert stop.status is zs.Status.INFEASIBLE
    assert stop.attempt is not None
    assert stop.attempt.duration == 0.0
    assert stop.certificate.margin < margin
    assert "tips the machine over" in stop.message
    planner = zs.Planner(machine, ground=steep, margin=margin)
    refused = planner.plan(start, problem.goal)
    assert not refused.success
    assert refused.message.startswith("The measured state is refused: the machine ")


def test_a_stop_says_which_limits_it_passes() -> None:
    machine = zs.load_machine("feller_buncher")
    upper, rates = machine.limits.position_upper, machine.limits.velocity
    beyond = START.copy()
    beyond[2] = upper[2] + 0.05
    stop = zs.plan_stop(machine, beyond, [0.0, 0.0, 0.1, 0.0, 0.0])
    check(stop, beyond, [0.0, 0.0, 0.1, 0.0, 0.0])
    there = float(stop.trajectory.positions[-1, 2])
    named = f"the upper position limit of joint 'stick' ({upper[2]:.4g} rad, here {there:.4g} rad)."
    assert named in stop.message
    assert stop.message.startswith(str(zs.Status.STOP))  # not "no motion is faster"
    # from there a plan leads back inside as soon as the limits hold the state
    advised = re.search(
        r"machine\.with_limits\(position_upper={'stick': ([-.0-9]+)}\)", stop.message
    )
    at = stop.trajectory.positions[-1]
    wider = machine.with_limits(position_upper={"stick": float(advised[1])})
    assert zs.plan(zs.Problem(wider, at, START)).success
    fast = np.array([1.5 * rates[0], 0.0, 0.0, 0.0, 0.0])
    assert "passes the velocity limit of joint 'slew'" in zs.plan_stop(machine, START, fast).message
    kept = zs.plan_stop(machine, START, 0.5 * fast)
    assert "passes" not in kept.message
    planner = zs.Planner(machine)
    assert named in planner.plan(beyond, START, [0.0, 0.0, 0.1, 0.0, 0.0]).message


@pytest.mark.parametrize(
    ("options", "error", "complaint"),
    [
        ({"time_budget": -1.0}, zs.ProblemError, "time_budget must be positive, not -1.0 s"),
        ({"time_budget": np.nan}, zs.ProblemError, "time_budget"),
        ({"time_budget": "soon"}, zs.ProblemError, "time_budget must be a number, not 'soon'"),
        ({"time_budget": 10**400}, zs.ProblemError, "time_budget"),
        ({"margn": 0.1}, TypeError, "plan_stop.*'margn'"),
        ({"goal": START}, TypeError, "plan_stop.*'goal'"),
    ],
)
def test_wrong_options_of_a_stop_are_refused(options: Any, error: Any, complaint: str) -> None:
    machine = zs.load_machine("feller_buncher")
    with pytest.raises(error, match=complaint):
        zs.plan_stop(machine, START, np.full(5, 0.1), **options)


def test_a_measured_state_beyond_all_measure_is_refused() -> None:
    machine = zs.load_machine("feller_buncher")
    with pytest.raises(zs.ProblemError, match=r"position of joint 'slew' is 1e\+200"):
        zs.plan_stop(machine, np.full(5, 1e200), np.full(5, 0.1))
    with pytest.raises(zs.ProblemError, match=r"rate of joint 'slew' is 1e\+200"):
        zs.plan_stop(machine, START, np.full(5, 1e200))
    with pytest.raises(zs.ProblemError, match="no machine is there"):
        zs.Planner(machine).plan(np.full(5, 1e200), START)
