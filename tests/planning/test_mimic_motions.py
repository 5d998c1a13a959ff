"""Motions of machines with mimic joints: planned, proven and replayed as those of free machines."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import zmp_sqp as zs
from tests.mimics import MACHINES, Coupled, coupled
from tests.planning.conftest import pose
from tests.planning.test_certificate import integrated, is_below
from zmp_sqp.mechanics.uncertainty import corners
from zmp_sqp.mechanics.wrench import efforts
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning.proof.certificate import certify_at

Array = np.ndarray
EVERY = sorted(MACHINES)
SLOPE = zs.Slope(roll=0.06, pitch=-0.04)
LOAD = {
    "gripper": zs.Payload(280.0, (1.6, 0.0, 0.0), "arm"),
    "linkage": zs.Payload(240.0, (0.2, 0.0, -0.4), "head"),
}
ENDS = {
    "gripper": ((0.0, 0.2, 0.05), (2.2, -0.1, 0.4)),
    "linkage": ((0.7, 0.2, 0.8), (2.4, 0.1, 0.8)),
}


def dense(trajectory: zs.Trajectory, samples: int) -> tuple[Array, Array]:
    """Interval and time after its start, `samples` per interval."""
    k = np.repeat(np.arange(trajectory.intervals), samples)
    shares = np.linspace(0.0, 1.0, samples)
    return k, np.outer(np.diff(trajectory.times), shares).ravel()


def free_efforts(pair: Coupled, trajectory: zs.Trajectory, samples: int = 60) -> Array:
    """Wrench and G^T tau of the free machine along the motion of the other, shape (K, 6 + n)."""
    k, since = dense(trajectory, samples)
    states = pair.states(*trajectory.state_in(k, since))
    root = {"root_acceleration": np.append(-SLOPE.gravity(), np.zeros(3))}
    if trajectory.base is not None:
        pose, twist, push = trajectory.base.state_in(k, since)
        motion = SLOPE.base_motion(pose, twist, push, 1.0)
        root = {"root_acceleration": motion.acceleration, "root_velocity": motion.velocity}
    found = efforts(pair.free, *states, **root)
    return np.hstack([found[:, :6], found[:, 6:] @ pair.G])


def margin_of(pair: Coupled, wrench: Array) -> float:
    fz, tx, ty = wrench[:, 2], wrench[:, 3], wrench[:, 4]
    assert pair.machine.support is not None
    if (fz <= 0.0).any():
        return -np.inf
    points = np.column_stack([-ty, tx]) / fz[:, None]
    return float(pair.machine.support.signed_distance(points).min())


def wild(machine: zs.Machine, seed: int, *, drives: bool = False) -> zs.Trajectory:
    """A random motion with random jerks, from slow to violent, in intervals of any length."""
    rng = np.random.default_rng(seed)
    n, speed = machine.size, (0.1, 1.0, 4.0)[seed % 3]
    h = (rng.uniform(0.02, 0.3, 6), 10.0 ** rng.uniform(-3.5, -0.5, 6), np.array([1.5]))[
        seed // 3 % 3
    ]
    push = speed / max(float(h.max()), 0.05) / np.sqrt(len(h))
    a, j = push * rng.normal(size=(2, len(h), n))
    times = np.concatenate([[0.0], np.cumsum(h)])
    q, v = rng.uniform(-1.0, 1.0, n), speed * rng.normal(size=n)
    motion = integrated(machine, times, q, v, a, j / h[:, None])
    if not drives:
        return motion
    pushes = push * rng.normal(size=(2, len(h), 2))
    a, j = pushes[0], pushes[1] / h[:, None]
    rates, yaw = [speed * rng.normal(size=2)], [rng.uniform(-3.0, 3.0)]
    for step, by, jerk in zip(h, a, j, strict=True):
        rate = rates[-1][1]
        yaw.append(yaw[-1] + step * rate + step**2 * by[1] / 2.0 + step**3 * jerk[1] / 6.0)
        rates.append(rates[-1] + step * by + step**2 * jerk / 2.0)
    base = UnicycleMotion.from_start(times, np.zeros(3), np.array(rates), np.array(yaw), (a, j))
    return replace(motion, base=base)


# --- proof --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("drives", [False, True])
def test_the_certificate_of_a_wild_motion_is_below_its_samples(name: str, drives: bool) -> None:
    pair, informative = coupled(name), 0
    limits = zs.TorqueLimits()
    for seed in range(18):
        motion = wild(pair.machine, seed, drives=drives)
        found = zs.certify(pair.machine, motion, SLOPE, constraints=[limits])
        sampled = free_efforts(pair, motion)
        least = margin_of(pair, sampled[:, :6])
        assert is_below(found.margin, least), seed
        informative += np.isfinite(least) and found.margin > least - 1e-3
        room = float((pair.machine.limits.effort - np.abs(sampled[:, 6:])).min())
        own = next(one for one in found.guarantees if one.name == "torque_limits")
        assert own.value <= room + 1e-6 * abs(room), seed
        if room > -1e4:
            assert own.value >= room - 0.02 * abs(room) - 50.0, seed
    assert informative >= 6


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("drives", [False, True])
def test_uncertain_payloads_are_proven_for_all_between(name: str, drives: bool) -> None:
    pair = coupled(name)
    loaded = pair.machine.with_payload(LOAD[name])
    box = np.array([0.1, 0.15, 0.1])
    every = corners(
        loaded,
        SLOPE,
        tipping_fraction=0.8,
        payload_uncertainty=0.2,
        slope_uncertainty=0.0,
        payload_com_uncertainty=box,
        every=True,
    )
    rng = np.random.default_rng(8)
    for seed in range(6):
        motion = wild(loaded, seed, drives=drives)
        found = certify_at(every, motion, 0.0)
        for _ in range(6):
            factor = rng.uniform(0.8, 1.2 / 0.8)
            offset = rng.uniform(-box, box)
            given = LOAD[name]
            payload = zs.Payload(factor * given.mass, given.com + offset, given.frame)
            sampled = free_efforts(pair.loaded(payload), motion, samples=20)
            assert is_below(found.margin, margin_of(pair, sampled[:, :6])), seed


# --- plans --------------------------------------------------------------------------------------


@cache
def planned(name: str, *, torques: bool = False, driving: bool = False) -> tuple[Coupled, zs.Plan]:
    pair = coupled(name).loaded(LOAD[name])
    start, goal = map(np.array, ENDS[name])
    base = None
    if driving:
        limits = {"max_acceleration": 0.5, "max_yaw_rate": 0.4, "max_yaw_acceleration": 0.5}
        base = zs.UnicycleBase((0.0, 0.0, 0.3), (2.0, 0.8, 0.5), max_speed=0.8, **limits)
    problem = zs.Problem(
        pair.machine, start, goal, ground=SLOPE, margin=0.05, intervals=24, base=base
    )
    if torques:  # limits between what the poses at rest need and what the motion takes
        found = np.abs(free_efforts(pair, zs.plan(problem).trajectory)[:, 6:])
        limits = np.maximum(0.9 * found.max(axis=0), 1.1 * found[[0, -1]].max(axis=0))
        machine = replace(pair.machine, limits=replace(pair.machine.limits, effort=limits))
        problem = replace(problem, machine=machine, constraints=[zs.TorqueLimits()])
    return pair, zs.plan(problem)


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("driving", [False, True])
def test_a_plan_is_safe_for_the_free_machine(name: str, driving: bool) -> None:
    pair, plan = planned(name, driving=driving)
    assert plan.success, plan.message
    margin = margin_of(pair, free_efforts(pair, plan.trajectory)[:, :6])
    assert plan.certificate.margin <= margin + 1e-9
    assert plan.certificate.margin >= margin - 1e-4
    assert plan.certificate.margin >= 0.05
    if not driving:
        assert plan.duration > 1.001 * plan.lower_bound, "tip-over costs time"


@pytest.mark.parametrize("name", EVERY)
def test_torques_of_planned_joints_are_kept_by_virtual_work(name: str) -> None:
    pair, plan = planned(name, torques=True)
    assert plan.success, plan.message
    assert plan.duration > 1.0001 * planned(name)[1].duration
    torques = free_efforts(pair, plan.trajectory)[:, 6:]
    room = plan.problem.machine.limits.effort - np.abs(torques).max(axis=0)
    assert (room >= -1e-9).all()
    own = next(one for one in plan.certificate.guarantees if one.name == "torque_limits")
    assert own.proven
    assert own.value >= 0.0


@pytest.mark.parametrize("name", EVERY)
def test_all_joints_keep_their_limits(name: str) -> None:
    pair, plan = planned(name)
    k, since = dense(plan.trajectory, 50)
    q, v, _ = pair.states(*plan.trajectory.state_in(k, since))
    limits = pair.free.limits
    assert (q >= limits.position_lower - 1e-9).all()
    assert (q <= limits.position_upper + 1e-9).all()
    assert (np.abs(v) <= limits.velocity + 1e-9).all()


@pytest.mark.parametrize("name", EVERY)
def test_the_zmp_is_that_of_forward_kinematics(name: str) -> None:
    """The momentum's rate by differences of the free machine's forward kinematics."""
    pair, plan = planned(name)
    model, data, h = pair.free.model, pair.free.model.createData(), 1e-4
    gravity, trajectory = SLOPE.gravity(), plan.trajectory
    middles = 0.5 * (trajectory.times[1:] + trajectory.times[:-1])

    def bodies(t: float) -> tuple[Array, Array, Array]:
        q = pair.states(*(part[None] for part in trajectory(t)))[0]
        pin.forwardKinematics(model, data, pair.free.configuration(q)[0])
        every = [data.oMi[i] for i in range(1, model.njoints)]
        inertias = list(model.inertias)[1:]
        centres = [pose.act(body.lever) for pose, body in zip(every, inertias, strict=True)]
        turns = [pose.rotation for pose in every]
        tensors = [R @ body.inertia @ R.T for R, body in zip(turns, inertias, strict=True)]
        return np.array(centres), np.array(turns), np.array(tensors)

    def spin(t: float) -> Array:
        """Angular momentum of each body about its centre of mass."""
        turned = bodies(t + h)[1] @ bodies(t - h)[1].transpose(0, 2, 1)
        rates = np.array([pin.log3(R) for R in turned]) / (2.0 * h)
        return np.asarray(np.einsum("bij,bj->bi", bodies(t)[2], rates))

    masses = np.array([body.mass for body in list(model.inertias)[1:]])[:, None]
    for t in middles[::3]:
        ahead, here, behind = (bodies(at)[0] for at in (t + h, t, t - h))
        force = masses * ((ahead - 2.0 * here + behind) / h**2 - gravity)
        moment = np.cross(here, force) + (spin(t + h) - spin(t - h)) / (2.0 * h)
        f, tau = force.sum(axis=0), moment.sum(axis=0)
        ours = zs.zmp(pair.machine, *(part[None] for part in trajectory(t)), SLOPE)[0]
        np.testing.assert_allclose([-tau[1] / f[2], tau[0] / f[2]], ours, atol=2e-5)


def test_a_motion_over_terrain_is_planned_and_proven() -> None:
    ground = zs.Heightmap(
        np.fromfunction(lambda i, k: 0.05 * np.sin(0.2 * i) + 0.02 * k, (30, 30)), 0.5, (-4.0, -4.0)
    )
    pair = coupled("linkage")
    limits = {"max_acceleration": 0.5, "max_yaw_rate": 0.4, "max_yaw_acceleration": 0.5}
    base = zs.UnicycleBase((0.0, 0.0, 0.3), (1.5, 0.5, 0.3), max_speed=0.8, **limits)
    start, goal = map(np.array, ENDS["linkage"])
    plan = zs.plan(zs.Problem(pair.machine, start, goal, ground=ground, intervals=16, base=base))
    assert plan.success, plan.message
    assert plan.certificate.margin > 0.0


@pytest.mark.physics
@pytest.mark.parametrize("name", EVERY)
def test_a_plan_stands_in_the_physics_engine(name: str) -> None:
    pytest.importorskip("mujoco")
    pair, plan = planned(name)
    stands = zs.replay(pair.machine, plan.trajectory, SLOPE)
    assert not stands.tipped
    assert stands.tracking_error < 1e-6
    assert stands.lift < 1e-4
    free = pair.states(*(plan.trajectory(plan.trajectory.times)))
    explicit = zs.Trajectory(
        pair.free.joint_names,
        plan.trajectory.times,
        *free[:2],
        plan.trajectory.accelerations @ pair.G.T,
        plan.trajectory.jerks @ pair.G.T,
    )
    same = zs.replay(pair.free, explicit, SLOPE)
    np.testing.assert_allclose(same.zmp, stands.zmp, atol=1e-6)
    blind = zs.phase_plane(pair.machine, plan.problem.start, plan.problem.goal)
    assert zs.replay(pair.machine, blind, SLOPE).least_edge_load == 0.0


def test_the_simplified_model_carries_mimic_joints_along(tmp_path: Path) -> None:
    """A cylinder on the feller-buncher's cabin swings half as far as the boom."""
    source = zs.shipped_machines()["feller_buncher"]
    inertia = '<inertia ixx="9" iyy="9" izz="1" ixy="0" ixz="0" iyz="0"/>'
    cylinder = (
        '<link name="cylinder"><inertial><origin xyz="0 0.3 1.5"/><mass value="800"/>'
        f'{inertia}</inertial></link><joint name="cylinder" type="revolute"><parent link="slew"/>'
        '<child link="cylinder"/><origin xyz="0.5 0 1"/><axis xyz="0 -1 0"/>'
        '<mimic joint="boom" multiplier="0.5"/></joint></robot>'
    )
    path = tmp_path / "feller_buncher.urdf"
    path.write_text(source.read_text().replace("</robot>", cylinder))
    limits = source.with_name("feller_buncher.joint_limits.yaml")
    machine, plain = zs.load_machine(path, limits=limits), zs.load_machine(source)
    assert machine.joint_names == plain.joint_names
    assert machine.mass == pytest.approx(plain.mass + 800.0)
    ends = pose(0.0, -0.9), pose(2.0, -0.5)
    plan = zs.plan(zs.Problem(machine, *ends, ground=SLOPE, model="simplified", intervals=20))
    assert plan.success, plan.message
    # the cylinder alone, by hand: its wrench is what the two machines differ by
    trajectory = plan.trajectory
    t = np.linspace(0.0, plan.duration, 7)[1:-1]
    root = {"root_acceleration": np.append(-SLOPE.gravity(), np.zeros(3)), "joints": False}
    difference = efforts(machine, *trajectory(t), **root) - efforts(plain, *trajectory(t), **root)

    def centre(times: Array) -> Array:
        slew, boom = trajectory(times)[0][:, :2].T
        lean = -0.5 * boom  # positive forwards
        local = np.array([0.5 + 1.5 * np.sin(lean), 0.3 + 0.0 * lean, 1.0 + 1.5 * np.cos(lean)])
        x, y, z = local
        cos, sin = np.cos(slew), np.sin(slew)
        height = plain.model.jointPlacements[2].translation[2]
        return np.column_stack([cos * x - sin * y, sin * x + cos * y, z + height])

    h = 1e-4
    acceleration = (centre(t + h) - 2.0 * centre(t) + centre(t - h)) / h**2
    np.testing.assert_allclose(
        difference[:, :3], 800.0 * (acceleration - SLOPE.gravity()), atol=0.05
    )
    with pytest.raises(zs.ProblemError, match=r"is not A - B sin\(boom angle\)"):
        zs.plan(replace(plan.problem, distance_limits=zs.DistanceLimits(1.0, 1.0)))
