"""Bounds on the size of inverse dynamics against an own recursion with complex numbers."""

from __future__ import annotations

import warnings
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from tests.mechanics.conftest import PERMUTED, TREE_COM
from zmp_sqp.mechanics.bounds.effort_norms import Norms, body_norms, effort_size
from zmp_sqp.mechanics.wrench import efforts

Array = np.ndarray
OURS = ("excavator", "forwarder_crane", "mobile_manipulator")
MACHINES = ("feller_buncher", "tree", "slider", "slewing_crane", "permuted", "indefinite", *OURS)
ROUNDING = 1e-9  # relative
AXES = {"X": 0, "Y": 1, "Z": 2}


@cache
def machine_of(name: str) -> zs.Machine:
    if name == "tree":
        payload = zs.Payload(4000.0, TREE_COM, "head", np.diag([9e3, 8e3, 1e3]))
        return zs.load_machine("feller_buncher").with_payload(payload)
    if name not in ("permuted", "indefinite"):
        return zs.load_machine(name)
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        path = Path(folder) / "permuted.urdf"
        path.write_text(PERMUTED)
        if name == "indefinite":  # as large as what the hand's mass and levers add
            path.write_text(PERMUTED.replace('ixx="0.5"', 'ixx="-90"').replace('"0.7"', '"-60"'))
            warnings.simplefilter("ignore", zs.MachineWarning)
        return zs.load_machine(path)


def axis_of(joint: Any) -> Array:
    """Axis of a joint, shape (3,)."""
    name = joint.shortname()
    if name.endswith("Unaligned"):
        data = joint.createData()
        joint.calc(data, np.zeros(1) if joint.nq == 1 else np.array([1.0, 0.0]))
        motion = np.asarray(data.S).reshape(6)
        return motion[3:] if np.abs(motion[3:]).max() > 0.0 else motion[:3]
    return np.eye(3)[AXES[name[-1]]]


def rotation(axis: Array, q: complex) -> Array:
    """Rotation by a complex angle (Rodrigues)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(q) * K + (1.0 - np.cos(q)) * K @ K


def complex_efforts(
    machine: zs.Machine, q: Array, v: Array, a: Array, root: tuple[Array, Array, Array]
) -> Array:
    """Newton-Euler recursion for complex coordinates: wrench, then joint efforts, shape (6 + n,).

    Args:
        machine: The machine.
        q, v, a: Of the joints, shape (n,).
        root: Angular velocity, angular acceleration and acceleration minus gravity, shape (3,)
            each.
    """
    model, count = machine.model, machine.model.njoints
    column = {int(index): i for i, index in enumerate(machine.index_v)}
    w, turn, push = ([None] * count for _ in range(3))
    turned, offset = [np.eye(3)] * count, [np.zeros(3)] * count
    w[1], turn[1], push[1] = root
    axes = [np.zeros(3)] * count
    for joint in range(2, count):
        parent, i = model.parents[joint], column[model.joints[joint].idx_v]
        placement, axis = model.jointPlacements[joint], axis_of(model.joints[joint])
        axes[joint] = axis
        slides = "JointModelP" in model.joints[joint].shortname()
        R = placement.rotation @ (np.eye(3) if slides else rotation(axis, q[i]))
        r = placement.translation + (placement.rotation @ axis * q[i] if slides else 0.0)
        turned[joint], offset[joint] = R, r
        spin, change = R.T @ w[parent], R.T @ turn[parent]
        at = R.T @ (
            push[parent] + np.cross(turn[parent], r) + np.cross(w[parent], np.cross(w[parent], r))
        )
        if slides:
            w[joint], turn[joint] = spin, change
            push[joint] = at + 2.0 * np.cross(spin, axis * v[i]) + axis * a[i]
        else:
            w[joint] = spin + axis * v[i]
            turn[joint] = change + np.cross(spin, axis * v[i]) + axis * a[i]
            push[joint] = at
    force, moment = [np.zeros(3, complex)] * count, [np.zeros(3, complex)] * count
    found = np.zeros(6 + machine.size, complex)
    for joint in range(count - 1, 0, -1):
        body = model.inertias[joint]
        c = body.lever
        f = body.mass * (
            push[joint] + np.cross(turn[joint], c) + np.cross(w[joint], np.cross(w[joint], c))
        )
        n = np.cross(c, f) + body.inertia @ turn[joint]
        n = n + np.cross(w[joint], body.inertia @ w[joint])
        force[joint], moment[joint] = force[joint] + f, moment[joint] + n
        if joint == 1:
            found[:3], found[3:6] = force[1], moment[1]
            break
        parent, i = model.parents[joint], column[model.joints[joint].idx_v]
        slides = "JointModelP" in model.joints[joint].shortname()
        found[6 + i] = axes[joint] @ (force[joint] if slides else moment[joint])
        carried = turned[joint] @ force[joint]
        force[parent] = force[parent] + carried
        lever = np.cross(offset[joint], carried)
        moment[parent] = moment[parent] + turned[joint] @ moment[joint] + lever
    return found


def random_state(machine: zs.Machine, rng: np.random.Generator, imaginary: float) -> Any:
    """Joint states and root motion, complex where `imaginary` is not zero."""

    def draw(*shape: int) -> Array:
        real, other = rng.normal(size=(2, *shape))
        return real + imaginary * 1j * other

    n, size = machine.size, 10.0 ** rng.uniform(-1.0, 1.0)
    moving = rng.integers(0, 2, (2, n))
    q, v, a = draw(n), size * moving[0] * draw(n), size**2 * moving[1] * draw(n)
    root = size * draw(3), size**2 * draw(3), draw(3) + 9.81 * rng.normal(size=3)
    return q, v, a, root


def norms_of(q: Array, v: Array, a: Array, root: Any) -> Norms:
    columns = (np.abs(q.imag), np.abs(q), np.abs(v), np.abs(a))
    joints = (part[:, None] for part in columns)
    return Norms(*joints, *(np.array([np.linalg.norm(part)]) for part in root))


@pytest.mark.parametrize("name", MACHINES)
def test_the_recursion_of_this_test_is_inverse_dynamics_at_real_times(name: str) -> None:
    machine, rng = machine_of(name), np.random.default_rng(0)
    for _ in range(10):
        q, v, a, (w, turn, push) = random_state(machine, rng, 0.0)
        own = complex_efforts(machine, q, v, a, (w, turn, push))
        # the root moves without a velocity of its own, so that both kinds of acceleration agree
        expected = efforts(
            machine,
            *(part.real[None] for part in (q, v, a)),
            root_acceleration=np.concatenate([push.real, turn.real]),
            root_velocity=np.concatenate([np.zeros(3), w.real]),
        )[0]
        np.testing.assert_allclose(own.real, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(("imaginary", "least"), [(0.0, 0.5), (0.3, 0.2), (1.0, 0.05)])
@pytest.mark.parametrize("name", MACHINES)
def test_efforts_at_complex_times_stay_below_their_bound(
    name: str, imaginary: float, least: float
) -> None:
    machine, rng, closest = machine_of(name), np.random.default_rng(1), 0.0
    bodies = body_norms([machine])
    for _ in range(200):
        q, v, a, root = random_state(machine, rng, imaginary)
        found = complex_efforts(machine, q, v, a, root)
        bound = effort_size(bodies, norms_of(q, v, a, root), joints=True)
        for part, most in (
            (np.linalg.norm(found[:3]), bound.force[0]),
            (np.linalg.norm(found[3:6]), bound.moment[0]),
            *zip(np.abs(found[6:]), bound.joints[0], strict=True),
        ):
            assert part <= most * (1.0 + ROUNDING)
            closest = max(closest, part / most)
    assert closest > least  # otherwise the bound would be loose, and this test blind


def test_norms_of_several_machines_are_the_largest_of_each() -> None:
    light, heavy = machine_of("feller_buncher"), machine_of("tree")
    alone = zip(body_norms([light]), body_norms([heavy]), body_norms([light, heavy]), strict=True)
    for one, other, both in alone:
        for name in ("mass", "first_moment", "inertia"):
            assert getattr(both, name) == max(getattr(one, name), getattr(other, name))
