"""Torque limits: closed forms, independent models, and what is refused."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import zmp_sqp as zs
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_scene
from benchmarks.problems.scene import Scene
from tests.planning.driving import retreat_problem
from tests.problems import BIG_FOOT
from zmp_sqp.mechanics.ground import GRAVITY
from zmp_sqp.planning.proof.certificate import certify_for
from zmp_sqp.scenario import load_scenario

GUARD = 1e-5  # of the limits, kept inside them: durations are longer by half of it
SAMPLING = 2000.0  # [1/s]


def with_efforts(machine: zs.Machine, effort: Any) -> zs.Machine:
    limits = machine.limits.updated({"effort": effort}, machine.joint_names)
    return replace(machine, limits=limits)


def of_torque(certificate: zs.Certificate) -> zs.Guarantee:
    return next(found for found in certificate.guarantees if found.name == "torque_limits")


# --- independent torques ------------------------------------------------------------------------


class Oracle:
    """Inverse dynamics of the URDF on a base that is bolted down, or that drives in its plane."""

    def __init__(self, machine: str, bodies: Sequence[zs.Payload], ground: zs.Slope) -> None:
        drive = pin.JointModelComposite()
        for joint in (pin.JointModelPX(), pin.JointModelPY(), pin.JointModelRZ()):
            drive.addJoint(joint)
        self.model = pin.buildModelFromUrdf(str(zs.shipped_machines()[machine]), drive)
        self.model.gravity = pin.Motion(ground.gravity(), np.zeros(3))
        for body in bodies:
            inertia = np.zeros((3, 3)) if body.inertia is None else np.array(body.inertia)
            self.model.appendBodyToJoint(
                self.model.getJointId(body.frame),
                pin.Inertia(body.mass, np.array(body.com), inertia),
                pin.SE3.Identity(),
            )
        self.data = self.model.createData()

    def torques(self, trajectory: zs.Trajectory, t: np.ndarray) -> np.ndarray:
        """Torques of the arm's joints, shape (K, n)."""
        states = [
            np.hstack(pair) for pair in zip(self._base(trajectory, t), trajectory(t), strict=True)
        ]
        found = [pin.rnea(self.model, self.data, *one) for one in zip(*states, strict=True)]
        return np.array(found)[:, 3:]

    def _base(self, trajectory: zs.Trajectory, t: np.ndarray) -> tuple[np.ndarray, ...]:
        """x, y, yaw and their derivatives, from speed along the heading."""
        if trajectory.base is None:
            return (np.zeros((len(t), 3)),) * 3
        pose, velocity, acceleration = trajectory.base(t)
        (speed, turning), (push, _), yaw = velocity.T, acceleration.T, pose[:, 2]
        ahead = np.column_stack([np.cos(yaw), np.sin(yaw)])
        left = np.column_stack([-np.sin(yaw), np.cos(yaw)])
        rates = np.column_stack([speed[:, None] * ahead, turning])
        bent = push[:, None] * ahead + (speed * turning)[:, None] * left
        return pose, rates, np.column_stack([bent, acceleration[:, 1]])

    def energy(self, q: np.ndarray, v: np.ndarray) -> float:
        """Kinetic and potential energy of a machine that stands [J]."""
        full = np.concatenate([np.zeros(3), q]), np.concatenate([np.zeros(3), v])
        kinetic = pin.computeKineticEnergy(self.model, self.data, *full)
        return float(kinetic + pin.computePotentialEnergy(self.model, self.data, full[0]))


def samples(trajectory: zs.Trajectory) -> np.ndarray:
    """Times at 2 kHz, both sides of every node among them [s]."""
    dense = np.linspace(0.0, trajectory.duration, int(SAMPLING * trajectory.duration) + 1)
    return np.concatenate([dense, trajectory.times, np.nextafter(trajectory.times[1:], 0.0)])


def at_rest(problem: zs.Problem, q: np.ndarray) -> zs.Trajectory:
    """A second in one pose."""
    still = np.zeros((2, len(q)))
    names = problem.machine.joint_names
    return zs.Trajectory(names, np.array([0.0, 1.0]), np.vstack([q, q]), still, still[:1])


def static_torques(problem: zs.Problem, q: np.ndarray) -> np.ndarray:
    oracle = Oracle("feller_buncher", [tree()], problem.ground)
    return oracle.torques(at_rest(problem, q), np.zeros(1))[0]


def tree(share: float = 1.0) -> zs.Payload:
    """The tree of the paper, its mass and inertia off by a share."""
    stem = paper_scene().tree
    return zs.Payload(share * stem.mass, stem.com, stem.frame, share * stem.inertia)


@cache
def limited() -> zs.Problem:
    """Half a turn on a slope of 5 degrees with a weak slew drive: the scenario `torque`."""
    scene = replace(paper_scene(point_masses=False), roll=np.deg2rad(-5.0))
    machine = with_efforts(scene.load(), {"slew": 40e3, "boom": 350e3})
    options = {"margin": 0.1, "constraints": [zs.TorqueLimits()]}
    return zs.Problem(machine, PAPER_START, PAPER_GOAL, scene.ground, **options)


@cache
def planned(share: float | None = 1.0, uncertain: float = 0.0) -> zs.Plan:
    problem = limited()
    constraints = () if share is None else (zs.TorqueLimits(share),)
    changed = {"constraints": constraints, "payload_uncertainty": uncertain, "intervals": 25}
    return zs.plan(replace(problem, **changed))


# --- closed forms -------------------------------------------------------------------------------

FORCE, MASS, DISTANCE = 3000.0, 1000.0, 1.2  # [N], urdf/slider.urdf [kg], [m]


def slider(constrained: bool, *, pitch: float = 0.0, acceleration: float = 1e3) -> zs.Plan:
    room = {"position_lower": -10.0, "position_upper": 10.0}
    scene = Scene("slider", BIG_FOOT, pitch=pitch, limits={"acceleration": acceleration, **room})
    machine = with_efforts(scene.load(), FORCE)
    return zs.plan(
        zs.Problem(
            machine,
            [-0.5 * DISTANCE],
            [0.5 * DISTANCE],
            scene.ground,
            intervals=50,
            constraints=[zs.TorqueLimits()] if constrained else (),
        )
    )


def test_on_level_ground_a_force_limit_is_an_acceleration_limit() -> None:
    """From rest to rest in 2 sqrt(D m / F)."""
    by_force, by_acceleration = slider(True), slider(False, acceleration=FORCE / MASS)
    assert by_force.success
    assert by_force.duration == pytest.approx(2.0 * np.sqrt(DISTANCE * MASS / FORCE), rel=GUARD)
    assert by_force.duration == pytest.approx(by_acceleration.duration, rel=GUARD)


@pytest.mark.parametrize("share", [0.2, -0.2])
def test_on_a_slope_gravity_helps_one_way_and_not_the_other(share: float) -> None:
    """Accelerations (F +- m g sin(pitch)) / m forwards and backwards.

    With share = m g sin(pitch) / F, the switch is after (1 - share) / 2 of the time, at a node.
    """
    pitch = float(np.arcsin(share * FORCE / (MASS * GRAVITY)))
    plan = slider(True, pitch=pitch)
    up, down = (FORCE * (1.0 + sign * share) / MASS for sign in (1, -1))
    assert plan.duration == pytest.approx(
        np.sqrt(2.0 * DISTANCE * (1.0 / up + 1.0 / down)), rel=2.0 * GUARD
    )
    assert of_torque(plan.certificate).label == "slider force"
    assert of_torque(plan.certificate).unit == "N"


def test_on_level_ground_a_torque_limit_is_an_acceleration_limit_times_the_inertia() -> None:
    inertia, torque, angle = 1000.0 * 2.0**2 + 16.0, 2000.0, 2.0  # urdf/slewing_crane.urdf
    scene = Scene("slewing_crane", BIG_FOOT)
    machine = with_efforts(scene.load(), {"slew": torque})
    problem = zs.Problem(machine, [0.0], [angle], intervals=50, constraints=[zs.TorqueLimits()])
    plan = zs.plan(problem)
    expected = 2.0 * np.sqrt(angle * inertia / torque)
    assert plan.duration == pytest.approx(expected, rel=GUARD)
    half = zs.plan(replace(problem, constraints=[zs.TorqueLimits(share=0.5)]))
    assert half.duration == pytest.approx(np.sqrt(2.0) * expected, rel=GUARD)
    assert of_torque(plan.certificate).label == "slew torque"
    assert of_torque(plan.certificate).unit == "N m"


# --- independent models -------------------------------------------------------------------------


def test_torques_of_an_independent_model_stay_within_the_limits() -> None:
    plan = planned()
    assert plan.success
    problem, t = plan.problem, samples(plan.trajectory)
    found = Oracle("feller_buncher", [tree()], problem.ground).torques(plan.trajectory, t)
    limits = problem.machine.limits.effort
    assert (np.abs(found) <= limits).all()
    assert (np.abs(found).max(axis=0)[:2] > 0.99 * limits[:2]).all()  # slew and boom are active
    free = planned(None)
    broken = Oracle("feller_buncher", [tree()], problem.ground).torques(
        free.trajectory, samples(free.trajectory)
    )
    assert np.abs(broken[:, 0]).max() > 2.0 * limits[0]
    assert plan.duration > 1.1 * free.duration


def test_torques_do_the_work_that_changes_the_energy() -> None:
    """Energy by kinematics alone, its rate by central differences."""
    plan, step = planned(), 1e-5
    oracle = Oracle("feller_buncher", [tree()], plan.problem.ground)
    t = np.linspace(0.01, plan.duration - 0.01, 173)
    power = (oracle.torques(plan.trajectory, t) * plan.trajectory(t)[1]).sum(axis=1)
    before, after = (
        np.array(
            [oracle.energy(*state) for state in zip(*plan.trajectory(t + off)[:2], strict=True)]
        )
        for off in (-step, step)
    )
    away = np.abs(t[:, None] - plan.trajectory.times).min(axis=1) > 2.0 * step
    gained = (after - before) / (2.0 * step)
    np.testing.assert_allclose(gained[away], power[away], atol=1e-4 * np.abs(power).max(), rtol=0.0)


def test_a_machine_that_drives_keeps_its_torques_too() -> None:
    scene = replace(paper_scene(point_masses=False), roll=np.deg2rad(-5.0))
    problem = replace(retreat_problem(scene), intervals=25)
    load = zs.Payload(4000.0, (0.0, 0.0, 3.323), "head", scene.tree.inertia)
    oracle = Oracle("feller_buncher", [load], scene.ground)
    free = zs.plan(problem).trajectory
    most = np.abs(oracle.torques(free, samples(free))).max(axis=0)
    machine = with_efforts(problem.machine, {"slew": 0.7 * most[0]})
    plan = zs.plan(replace(problem, machine=machine, constraints=[zs.TorqueLimits()]))
    assert plan.success, plan.message
    found = oracle.torques(plan.trajectory, samples(plan.trajectory))
    room = float((machine.limits.effort[0] - np.abs(found[:, 0])).min())
    assert room >= 0.0
    own = of_torque(plan.certificate)
    assert own.label == "slew torque"
    assert room - 1e-3 * machine.limits.effort[0] <= own.value <= room + 1e-6 * most[0]


def test_with_an_uncertain_payload_torques_hold_for_both_extremes() -> None:
    problem = limited()
    machine = with_efforts(problem.machine, {"slew": 50e3, "boom": 380e3})
    uncertain = zs.plan(replace(problem, machine=machine, payload_uncertainty=0.1, intervals=25))
    exact = zs.plan(replace(problem, machine=machine, intervals=25))
    assert uncertain.success, uncertain.message
    assert uncertain.duration > exact.duration * 1.001
    limits, worst = machine.limits.effort, {}
    for share in (0.9, 1.0, 1.1):
        oracle = Oracle("feller_buncher", [tree(share)], problem.ground)
        for name, plan in (("uncertain", uncertain), ("exact", exact)):
            found = oracle.torques(plan.trajectory, samples(plan.trajectory))
            worst[name, share] = float((np.abs(found) / limits).max())
    assert max(worst["uncertain", share] for share in (0.9, 1.0, 1.1)) <= 1.0
    assert worst["exact", 1.0] <= 1.0 < worst["exact", 1.1]
    assert "payload" in of_torque(uncertain.certificate).corner


def test_the_simplified_model_keeps_the_torques_of_all_its_joints() -> None:
    problem = load_scenario("paper_1_simplified").problem
    machine = with_efforts(problem.machine, {"slew": 60e3, "boom": 345e3})
    changed = replace(
        problem, machine=machine, ground=zs.Slope(np.deg2rad(-5.0)), constraints=[zs.TorqueLimits()]
    )
    plan = zs.plan(changed)
    assert plan.success, plan.message
    assert plan.duration > 1.01 * zs.plan(replace(changed, constraints=())).duration
    own = of_torque(plan.certificate)
    assert 0.0 <= own.value <= 1e-3 * 345e3


# --- the certificate ----------------------------------------------------------------------------


def test_the_guaranteed_room_is_below_dense_samples_and_close_to_them() -> None:
    plan = planned()
    own = of_torque(plan.certificate)
    oracle = Oracle("feller_buncher", [tree()], plan.problem.ground)
    found = oracle.torques(plan.trajectory, samples(plan.trajectory))
    limits, names = plan.problem.machine.limits.effort, plan.problem.machine.joint_names
    rooms = dict(
        zip((f"{name} torque" for name in names), limits - np.abs(found).max(axis=0), strict=True)
    )
    assert own.proven
    # the worst row is the one with the least share of its limit left
    share = min(room / limit for room, limit in zip(rooms.values(), limits, strict=True))
    limit = limits[list(rooms).index(own.label)]
    assert own.value <= rooms[own.label] + 1e-9 * limit
    assert own.value / limit <= share + 1e-9
    assert own.value / limit >= share - 1e-3


def test_the_room_of_a_machine_at_rest_is_limit_less_torque() -> None:
    """The guard that the planner keeps is not taken off what is guaranteed."""
    problem = limited()
    own = of_torque(certify_for(problem, at_rest(problem, problem.start)))
    torque = static_torques(problem, problem.start)[1]
    assert own.label == "boom torque"
    assert own.value == pytest.approx(350e3 - abs(torque), abs=1e-3)  # [N m]; rounding is less


def test_a_motion_that_breaks_a_limit_is_not_safe_and_says_by_how_much() -> None:
    problem, free = limited(), planned(None)
    found = certify_for(problem, free.trajectory)
    own = of_torque(found)
    assert not found.safe
    assert found.margin > 0.0
    assert "torque_limits (slew torque)" in found.fault
    torques = Oracle("feller_buncher", [tree()], problem.ground).torques(
        free.trajectory, samples(free.trajectory)
    )
    assert own.shortfall == pytest.approx(np.abs(torques[:, 0]).max() - 40e3, rel=1e-3)
    assert certify_for(replace(problem, constraints=()), free.trajectory).safe


# --- what a share does --------------------------------------------------------------------------


def test_a_smaller_share_never_shortens_the_motion() -> None:
    durations = [planned(share).duration for share in (3.0, 2.0, 1.5, 1.2, 1.0)]
    assert durations == sorted(durations)
    assert durations[0] < 0.95 * durations[-1]
    assert planned(None).duration <= durations[0] + 1e-6


def test_a_limit_that_does_not_bind_changes_nothing() -> None:
    loose, none = planned(100.0), planned(None)
    assert loose.duration == pytest.approx(none.duration, rel=1e-7)


# --- what is refused ----------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.0, -1.0, np.nan, np.inf, "1", None, True])
def test_a_share_that_is_no_positive_number_is_refused(share: Any) -> None:
    with pytest.raises(zs.ProblemError, match="share of torque_limits must be"):
        zs.TorqueLimits(share=share)


def test_missing_effort_limits_are_named() -> None:
    machine = paper_scene().load()
    effort = np.array([4e5, np.nan, 6e5, np.nan, 6e4])
    limits = replace(machine.limits, effort=effort)
    goal = PAPER_START + 0.1
    with pytest.raises(zs.ProblemError, match="no effort limit for joint 'boom', 'tilt': give"):
        zs.Problem(
            replace(machine, limits=limits), PAPER_START, goal, constraints=[zs.TorqueLimits()]
        )


@pytest.mark.parametrize("side", ["start", "goal"])
def test_a_pose_whose_static_torque_exceeds_the_limit_is_refused(side: str) -> None:
    problem = limited()
    reaching = getattr(problem, side) - np.array([0.0, 0.3, 0.0, 0.0, 0.0])  # boom forwards
    torque = static_torques(problem, reaching)[1]
    assert abs(torque) > 351e3
    expected = (
        rf"torque_limits \(boom torque\) is violated by {1e-3 * (abs(torque) - 350e3):.1f} kN m "
        f"at rest at the {side}"
    )
    with pytest.raises(zs.ProblemError, match=expected):
        replace(problem, **{side: reaching})


def test_a_base_that_drives_is_refused_likewise() -> None:
    problem = retreat_problem(paper_scene())
    machine = with_efforts(problem.machine, {"slew": 50e3})
    violated = r"\(slew torque\) is violated by .* at rest at the start"
    with pytest.raises(zs.ProblemError, match=violated):
        replace(problem, machine=machine, constraints=[zs.TorqueLimits()])


def test_a_search_that_ends_above_a_torque_limit_says_which_when_and_by_how_much() -> None:
    """Across the slope gravity does not turn the machine; on the way it does, beyond the limit."""
    held = {"boom": -0.5, "stick": -2.1, "tilt": 0.5, "head": -1.5}  # [rad] arm that cannot fold
    scene = Scene(
        "feller_buncher",
        BIG_FOOT,
        paper_scene().tree,
        roll=np.deg2rad(-20.0),
        limits={
            "position_lower": {joint: angle - 0.01 for joint, angle in held.items()},
            "position_upper": {joint: angle + 0.01 for joint, angle in held.items()},
            "effort": {"slew": 5e3},
        },
    )
    start, goal = ([slew, *held.values()] for slew in (np.pi / 2, -np.pi / 2))
    plan = zs.plan(scene.problem(start, goal, intervals=20, constraints=[zs.TorqueLimits()]))
    assert plan.status is zs.Status.INFEASIBLE
    assert "still breaks torque_limits" in plan.message
    assert re.search(r"breaks torque_limits \(slew torque\) by \d+\.\d kN m at ", plan.message)
    assert "ZMP" not in plan.message


# --- the shipped scenario -----------------------------------------------------------------------


def test_in_the_shipped_scenario_torque_limits_cost_time() -> None:
    problem = load_scenario("torque").problem
    plan, free = zs.plan(problem), zs.plan(replace(problem, constraints=()))
    assert plan.success
    assert free.duration == pytest.approx(4.501, abs=1e-3)
    assert 5.19 < plan.duration < 5.21  # [s]; 5.198, and 5.192 with 80 intervals
    assert 0.0 <= of_torque(plan.certificate).value < 100.0  # [N m]
