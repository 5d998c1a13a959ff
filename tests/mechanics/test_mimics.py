"""Mimic joints: resolved, with limits of their leaders, and coupled in all of mechanics."""

from __future__ import annotations

import re
import warnings
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import zmp_sqp as zs
from tests.checks import central_differences
from tests.mechanics.test_effort_norms import complex_efforts, norms_of
from tests.mimics import MACHINES, Coupled, coupled, urdf
from zmp_sqp.mechanics.bounds.effort_bounds import effort_bounds
from zmp_sqp.mechanics.bounds.effort_norms import body_norms, effort_size
from zmp_sqp.mechanics.bounds.payload_spread import joint_shares, turning_bounds
from zmp_sqp.mechanics.stability_measures import center_of_mass
from zmp_sqp.mechanics.wrench import effort_derivatives, efforts
from zmp_sqp.planning.closed_forms.slew_circle import slew_insight
from zmp_sqp.show.inspection_tables import tree_lines

Array = np.ndarray
EVERY = sorted(MACHINES)


def random_states(machine: zs.Machine, count: int, seed: int) -> tuple[Array, ...]:
    """Random q, v, a (count, n), twist and acceleration of the root (count, 6)."""
    rng = np.random.default_rng(seed)
    joints = rng.uniform(-1.5, 1.5, (3, count, machine.size))
    return (*joints, *rng.uniform(-2.0, 2.0, (2, count, 6)))


def total_efforts(pair: Coupled, found: Array) -> Array:
    """Wrench and G^T tau from the efforts of the free machine, shape (K, 6 + n)."""
    return np.hstack([found[:, :6], found[:, 6:] @ pair.G])


def edited(old: str, new: str, *, machine: str = "gripper") -> str:
    text = urdf(machine)
    if old not in text:
        raise ValueError(f"{old} is not in the machine")
    return text.replace(old, new)


def load(tmp_path: Path, text: str, **settings: Any) -> zs.Machine:
    path = tmp_path / "machine.urdf"
    path.write_text(text)
    return zs.load_machine(path, **settings)


# --- what is read -------------------------------------------------------------------------------


def test_joints_that_mimic_are_not_planned_and_chains_are_resolved() -> None:
    gripper, linkage = coupled("gripper"), coupled("linkage")
    assert gripper.machine.joint_names == ("turn", "lift", "jaw")
    assert linkage.machine.joint_names == ("slew", "boom", "extend")
    assert gripper.machine.joint_units == ("rad", "rad", "m")
    assert gripper.machine.continuous == (True, False, False)
    for pair in (gripper, linkage):
        order = [pair.free.joint_names.index(name) for name in list(pair.machine.model.names)[2:]]
        assert order != sorted(order), "the file's order is not Pinocchio's"
        np.testing.assert_allclose(pair.machine.coupling.G, pair.G[order], atol=1e-15)
        np.testing.assert_allclose(pair.machine.coupling.offset, pair.offset[order], atol=1e-15)


def test_limits_of_a_mimic_joint_limit_its_leader() -> None:
    machine = coupled("gripper").machine
    turn, lift, jaw = range(3)
    limits = machine.limits
    # jaw in [-0.3, 0.6]; -jaw in [-0.5, 0.5]; 2.5 jaw + 0.3 in [-2, 2]; hook without limits
    assert limits.position_lower[jaw] == -0.3
    assert limits.position_upper[jaw] == 0.5
    assert limits.velocity.tolist() == [1.2, 0.9, min(0.8, 2.0, 3.0 / 2.5, 4.0 / 3.0)]
    assert limits.effort[jaw] == 5000.0, "the leader's own"
    assert (limits.position_lower[turn], limits.position_upper[turn]) == (-np.inf, np.inf)
    assert limits.position_upper[lift] == 1.2
    tight = coupled("linkage").machine.limits
    assert tight.velocity[0] == pytest.approx(0.8)
    # the head's limits through a multiplier of -1 do not bind; the weight's offset does not either
    assert (tight.position_lower[1], tight.position_upper[1]) == (-0.6, 1.2)
    assert tight.position_upper[2] == pytest.approx(min(0.9, (0.8 - 0.05) / 0.8))


def test_a_leader_without_limits_takes_those_of_its_mimics(tmp_path: Path) -> None:
    own = '<limit lower="-0.3" upper="0.6" velocity="0.8" effort="5000"/>'
    machine = load(tmp_path, edited(own, ""))
    jaw = {key: getattr(machine.limits, key)[2] for key in ("position_lower", "velocity", "effort")}
    assert jaw["position_lower"] == -0.5
    assert jaw["velocity"] == pytest.approx(3.0 / 2.5)
    assert jaw["effort"] == 5000.0, "the least of 1, 2.5 and 3 times 5000 N"


def test_files_may_limit_mimic_joints_and_the_argument_has_the_last_word(tmp_path: Path) -> None:
    yaml = tmp_path / "limits.yaml"
    yaml.write_text(
        "joint_limits:\n  thumb: {has_velocity_limits: true, max_velocity: 0.5, "
        "has_acceleration_limits: true, max_acceleration: 5.0}\n"
    )
    machine = load(tmp_path, urdf("gripper"), limits=yaml)
    assert machine.limits.velocity[2] == pytest.approx(0.5 / 2.5)
    assert machine.limits.acceleration[2] == pytest.approx(2.0)
    assert np.isnan(machine.limits.acceleration[:2]).all()
    with pytest.warns(
        zs.MachineWarning, match="pass the velocity limit of 'a_other', which mimics"
    ):
        machine = load(tmp_path, urdf("gripper"), limits={"velocity": {"jaw": 3.0}})
    assert machine.limits.velocity[2] == 3.0
    with pytest.raises(zs.MachineError, match="unknown joint 'thumb'; joints are turn, lift, jaw"):
        load(tmp_path, urdf("gripper"), limits={"velocity": {"thumb": 3.0}})


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('joint="jaw"', 'joint="hook"', "joint 'a_other' mimics itself: 'a_other' mimics 'hook'"),
        ('joint="jaw"', 'joint="a_other"', "joint 'a_other' mimics itself"),
        ('joint="jaw"', 'joint=""', "joint 'a_other': its <mimic> names no joint"),
        ('multiplier="-2.5"', 'multiplier="x"', "joint 'thumb': <mimic multiplier> must be"),
        ('offset="0.3"', 'offset="nan"', "joint 'thumb': <mimic offset> must be finite"),
        ('multiplier="-2.5"', 'multiplier="1e308"', None),
        (
            'lower="-0.5" upper="0.5"',
            'lower="0.7" upper="0.9"',
            "joint 'a_other' mimics 'jaw': its position limits 0.7 and 0.9 ask for -0.9 to -0.7",
        ),
    ],
)
def test_mimics_that_cannot_be_are_refused(
    tmp_path: Path, old: str, new: str, named: str | None
) -> None:
    text = edited(old, new)
    if named is None:  # 1.2 times 1e308, and once more
        text, named = text.replace('"1.2"', '"1e10"'), "'hook' mimics 'jaw' with factors"
    with pytest.raises(zs.MachineError, match=re.escape(named)) as refusal:
        load(tmp_path, text)
    assert "machine.urdf" in str(refusal.value)


def test_a_mimic_of_no_joint_is_planned_with_a_warning(tmp_path: Path) -> None:
    """As Pinocchio loads it; one of the hands of example-robot-data is such a file."""
    text = edited('joint="jaw"', 'joint="claw"')
    with pytest.warns(zs.MachineWarning, match=r"not there or do not move: 'a_other' \('claw'\)"):
        machine = load(tmp_path, text)
    assert machine.joint_names == ("turn", "lift", "a_other", "jaw")
    with pytest.raises(zs.MachineError, match="'claw'"):
        load(tmp_path, text, strict=True)


def test_a_fixed_joint_mimics_nothing(tmp_path: Path) -> None:
    machine = load(tmp_path, edited('name="hook" type="continuous"', 'name="hook" type="fixed"'))
    assert machine.joint_names == ("turn", "lift", "jaw")
    assert machine.model.njoints == 7


def test_a_leader_without_mass_moves_that_of_its_mimics(tmp_path: Path) -> None:
    """A knob that opens both jaws: no mass of its own, and no warning."""
    text = edited('mimic joint="jaw"', 'mimic joint="knob"').replace("</robot>", "")
    knob = (
        '<link name="knob"/><joint name="knob" type="revolute"><parent link="base"/>'
        '<child link="knob"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" '
        'effort="1"/></joint></robot>'
    )
    machine = load(tmp_path, text + knob)  # warnings are errors here
    assert machine.joint_names == ("turn", "lift", "jaw", "knob")
    assert machine.mimics_of("knob") == ("a_other", "hook", "thumb")
    with pytest.warns(zs.MachineWarning, match="nothing that these joints move has a mass: 'knob'"):
        load(tmp_path, urdf("gripper").replace("</robot>", "") + knob)


def test_a_multiplier_of_zero_holds_a_joint(tmp_path: Path) -> None:
    machine = load(tmp_path, edited('multiplier="-2.5" offset="0.3"', 'multiplier="0" offset="9"'))
    here, there = machine.configuration(np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.4]]))
    at = machine.model.joints[machine.model.getJointId("thumb")].idx_q
    assert here[at] == there[at] == 9.0
    assert machine.limits.position_upper[2] == 0.5


def test_the_mimics_of_other_robots_are_resolved() -> None:
    """All 13 URDFs of example-robot-data that have any."""
    try:
        listed = metadata.files("example-robot-data") or ()
    except metadata.PackageNotFoundError:
        pytest.skip("example-robot-data is not installed")
    files = [Path(str(one.locate())) for one in listed if one.suffix == ".urdf"]
    files = [path for path in files if "<mimic" in path.read_text()]
    assert len(files) == 13
    count = {}
    for path in files:
        with warnings.catch_warnings():  # of inertias and supports, which are not looked at here
            warnings.simplefilter("ignore", zs.MachineWarning)
            machine = zs.load_machine(path)
        assert machine.size + len(machine.mimics) == machine.model.njoints - 2
        count[path.name] = len(machine.mimics)
    assert count == {
        "alex_psyonic_hands.urdf": 0,  # they mimic joints that are not there
        "baxter.urdf": 2,
        "panda.urdf": 1,
        "panda_collision.urdf": 1,
        "pr2.urdf": 10,
        "romeo.urdf": 22,
        "talos_full_v2.urdf": 12,
        "talos_full_v2_box.urdf": 12,
        "talos_left_arm.urdf": 0,  # fixed joints
        "talos_reduced.urdf": 0,
        "talos_reduced_box.urdf": 0,
        "talos_reduced_corrected.urdf": 0,
        "tiago_pro.urdf": 10,
    }


# --- mechanics ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EVERY)
def test_every_link_is_where_the_free_machine_has_it(name: str) -> None:
    pair = coupled(name)
    q, v, a, *_ = random_states(pair.machine, 5, 0)
    free = pair.states(q, v, a)[0]
    both = [(machine.model, machine.model.createData()) for machine in (pair.machine, pair.free)]
    for one, other in zip(
        pair.machine.configuration(q), pair.free.configuration(free), strict=True
    ):
        for (model, data), state in zip(both, (one, other), strict=True):
            pin.framesForwardKinematics(model, data, state)
        for ours, theirs in zip(both[0][1].oMf, both[1][1].oMf, strict=True):
            np.testing.assert_allclose(ours.homogeneous, theirs.homogeneous, atol=1e-12)
    np.testing.assert_allclose(
        center_of_mass(pair.machine, q), center_of_mass(pair.free, free), atol=1e-12
    )


@pytest.mark.parametrize("name", EVERY)
def test_efforts_are_those_of_the_free_machine_by_virtual_work(name: str) -> None:
    pair = coupled(name)
    q, v, a, twist, push = random_states(pair.machine, 20, 1)
    root = {"root_acceleration": push, "root_velocity": twist}
    ours = efforts(pair.machine, q, v, a, **root)
    theirs = efforts(pair.free, *pair.states(q, v, a), **root)
    np.testing.assert_allclose(ours, total_efforts(pair, theirs), rtol=1e-12, atol=1e-8)
    alone = efforts(pair.machine, q, v, a, joints=False, **root)
    np.testing.assert_array_equal(alone, ours[:, :6])


@pytest.mark.parametrize("name", EVERY)
def test_joint_efforts_are_those_of_lagranges_equations(name: str) -> None:
    """d/dt dL/dy' - dL/dy by differences of the energies of the free machine at q = G y + g_0."""
    pair = coupled(name)
    model, data = pair.free.model, pair.free.model.createData()
    gravity = np.array([1.0, -2.0, -9.0])

    def lagrangian(y: Array, rate: Array) -> float:
        q, v, _ = pair.states(y[None], rate[None], rate[None])
        full = pair.free.configuration(q)[0]
        velocity = np.zeros(model.nv)
        velocity[pair.free.index_v] = v[0]
        kinetic = pin.computeKineticEnergy(model, data, full, velocity)
        return float(kinetic + pair.free.mass * gravity @ pin.centerOfMass(model, data, full))

    for y, v, a in zip(*random_states(pair.machine, 4, 2)[:3], strict=True):
        h = 1e-4

        def momentum(y: Array, v: Array) -> Array:
            return central_differences(lambda x: np.array([lagrangian(y, x)]), v, step=1e-3)[0]

        ahead = momentum(y + h * v + 0.5 * h**2 * a, v + h * a)
        behind = momentum(y - h * v + 0.5 * h**2 * a, v - h * a)
        by_position = central_differences(
            lambda x, v=v: np.array([lagrangian(x, v)]), y, step=1e-4
        )[0]
        expected = (ahead - behind) / (2.0 * h) - by_position
        root = np.append(-gravity, np.zeros(3))
        found = efforts(pair.machine, y[None], v[None], a[None], root_acceleration=root)[0, 6:]
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-2)


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("joints", [True, False])
def test_derivatives_are_those_of_differences(name: str, joints: bool) -> None:
    machine = coupled(name).machine
    n = machine.size
    q, v, a, twist, push = random_states(machine, 3, 3)
    found = effort_derivatives(
        machine, q, v, a, root_acceleration=push, root_velocity=twist, joints=joints
    )
    for k in range(len(q)):

        def at(x: Array, k: int = k) -> Array:
            state = (x[None, i * n : (i + 1) * n] for i in range(3))
            root = {"root_velocity": x[3 * n : 3 * n + 6], "root_acceleration": x[3 * n + 6 :]}
            return efforts(machine, *state, joints=joints, **root)[0]

        expected = central_differences(at, np.concatenate([q[k], v[k], a[k], twist[k], push[k]]))
        parts = (
            found.wrt_position[k],
            found.wrt_rate[k],
            found.wrt_joint_acceleration[k],
            found.wrt_velocity[k, :, :6],
            found.wrt_acceleration[k, :, :6],
        )
        ours = np.hstack(parts)
        np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=1e-4 * np.abs(expected).max())
        np.testing.assert_array_equal(found.wrt_velocity[k, :, 6:], found.wrt_rate[k])


def test_mimics_are_named() -> None:
    machine = coupled("linkage").machine
    assert machine.mimics["drum"] == ("slew", -3.0, 0.4)
    assert machine.mimics_of("boom") == ("head", "rod", "weight")
    assert machine.mimics_of("extend") == ("a_extend",)
    assert coupled("linkage").free.mimics == {}
    lines = "\n".join(tree_lines(zs.inspect(machine)))
    assert "drum (turns, -3 x slew + 0.4)" in lines
    assert "weight (turns, 0.5 x boom - 0.1)" in lines
    assert "rod (turns, 1 x boom)" in lines


def test_a_slew_that_another_joint_mimics_has_no_circle() -> None:
    machine = coupled("linkage").machine
    with pytest.raises(zs.MachineError, match="joint 'drum' mimics 'slew'"):
        slew_insight(machine, np.zeros(machine.size))


# --- bounds -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EVERY)
def test_bounds_hold_for_random_motions(name: str) -> None:
    """Efforts by both bounds, their second derivatives by differences in time."""
    pair = coupled(name)
    machine, h = pair.machine, 1e-3
    root = np.append([1.0, 2.0, 9.0], np.zeros(3))
    tightest = 0.0
    for q, v, a, *_ in zip(*random_states(machine, 60, 4), strict=True):
        j = np.random.default_rng(5).normal(size=machine.size)
        t = np.array([-h, 0.0, h])[:, None]
        states = q + t * v + t**2 / 2 * a + t**3 / 6 * j, v + t * a + t**2 / 2 * j, a + t * j
        found = efforts(machine, *states, root_acceleration=root)
        peaks = [np.abs(part).max(axis=0)[None] for part in states]
        size, second = effort_bounds(
            machine,
            *peaks[1:],
            np.abs(j)[None],
            reach=peaks[0],
            gravity=float(np.linalg.norm(root)),
            joints=True,
        )
        curvature = (found[0] - 2.0 * found[1] + found[2]) / h**2
        for value, bound in ((found[1], size), (curvature, second)):
            room = 1.0 + 1e-4
            assert np.linalg.norm(value[:3]) <= bound.force[0] * room
            assert np.linalg.norm(value[3:6]) <= bound.moment[0] * room
            assert (np.abs(value[6:]) <= bound.joints[0] * room).all()
            tightest = max(tightest, float((np.abs(value[6:]) / bound.joints[0]).max()))
    assert tightest > 0.2, "the bounds are no mere infinity"


@pytest.mark.parametrize("name", EVERY)
def test_the_size_of_efforts_is_bounded_at_complex_times(name: str) -> None:
    """Against inverse dynamics of the free machine with complex coordinates q = G y + g_0."""
    pair, rng, tightest = coupled(name), np.random.default_rng(7), 0.0
    bodies = body_norms([pair.machine])
    for scale in (0.0, 0.1, 0.5) * 20:
        real, imaginary = rng.uniform(-1.0, 1.0, (2, 3, pair.machine.size))
        q, v, a = real + 1j * scale * imaginary
        root = tuple(rng.normal(size=(3, 3)) + 1j * scale * rng.normal(size=(3, 3)))
        states = (part[0] for part in pair.states(q[None], v[None], a[None]))
        found = complex_efforts(pair.free, *states, root)
        bound = effort_size(bodies, norms_of(q, v, a, root), joints=True)
        assert np.linalg.norm(found[:3]) <= bound.force[0]
        assert np.linalg.norm(found[3:6]) <= bound.moment[0]
        joints = np.abs(found[6:] @ pair.G)
        assert (joints <= bound.joints[0]).all()
        tightest = max(tightest, float((joints / bound.joints[0]).max()))
    assert tightest > 0.1


@pytest.mark.parametrize("name", EVERY)
def test_bounds_are_at_most_those_of_the_free_machine(name: str) -> None:
    """With peaks |G| v the machine without mimics has the same bounds, summed by |G|^T."""
    pair = coupled(name)
    q, v, a, *_ = (np.abs(part) for part in random_states(pair.machine, 9, 6))
    G, shift = np.abs(pair.G), np.abs(pair.offset)
    ours = effort_bounds(pair.machine, v, a, a, reach=q, gravity=9.81, joints=True)
    theirs = effort_bounds(
        *(pair.free, v @ G.T, a @ G.T, a @ G.T), reach=q @ G.T + shift, gravity=9.81, joints=True
    )
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(one.moment, other.moment, rtol=1e-12)
        np.testing.assert_allclose(one.joints, other.joints @ G, rtol=1e-12)
    for one, other in zip(
        turning_bounds(pair.machine, v, a), turning_bounds(pair.free, v @ G.T, a @ G.T), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-12)
    np.testing.assert_allclose(joint_shares(pair.machine), joint_shares(pair.free) @ G, rtol=1e-12)
