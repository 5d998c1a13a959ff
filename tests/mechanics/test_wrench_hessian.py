"""Hessian of the wrench in closed form, against differences of Pinocchio's first derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from benchmarks.problems.paper import paper_scene
from tests.mimics import MACHINES, coupled
from zmp_sqp.mechanics.body_poses import dynamic_parameters
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench_hessian import wrench_hessian
from zmp_sqp.planning.program.model import ArmModel

STEP = 1e-3
S, K = 5.0, 4  # squared duration [s^2], number of states
GRAVITY = np.array([1.5, -0.5, -9.6])  # [m/s^2]


def machine(name: str) -> Machine:
    return paper_scene().load() if name == "feller_buncher" else coupled(name).machine


def gradients(model: ArmModel, at: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Gradients of weights . efforts at states (K, 3n + 1) whose last entry is S."""
    n, parts = model.size, []
    for state, weight in zip(at, weights, strict=True):
        q, w, alpha = state[None, : 3 * n].reshape(3, 1, n)
        parts.append(weight @ model.effort_derivatives(q, w, alpha, state[-1])[1][0])
    return np.array(parts)


def differences(model: ArmModel, at: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Hessians from central differences of fourth order."""
    columns = []
    for i in range(at.shape[1]):
        step = STEP * np.eye(at.shape[1])[i]
        one, two = (
            gradients(model, at + k * step, weights) - gradients(model, at - k * step, weights)
            for k in (1, 2)
        )
        columns.append((8.0 * one - two) / (12.0 * STEP))
    return np.stack(columns, axis=2)


@pytest.mark.parametrize("kind", ["joints", "fewer"])
@pytest.mark.parametrize("name", ["feller_buncher", *MACHINES])
def test_hessian_is_that_of_differences(name: str, kind: str) -> None:
    of = machine(name)
    coordinates = Coordinates.identity(of.size)
    if kind == "fewer":  # the first joint alone, the others together
        G = np.zeros((of.size, 2))
        G[0, 0], G[1:, 1] = 1.0, np.linspace(-1.0, 0.5, of.size - 1)
        coordinates = Coordinates(np.linspace(0.1, 0.4, of.size), G)
    model = ArmModel(of, GRAVITY, coordinates)
    rng = np.random.default_rng(3)
    at = np.hstack([rng.uniform(-1.5, 1.5, (K, 3 * model.size)), np.full((K, 1), S)])
    weights = rng.normal(size=(K, 6))
    q, w, alpha = at[:, :-1].reshape(K, 3, -1).transpose(1, 0, 2)
    found = model.wrench_hessian(q, w, alpha, S, weights)
    expected = differences(model, at, weights)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_array_equal(found, found.transpose(0, 2, 1))


@pytest.mark.parametrize("name", ["feller_buncher", *MACHINES])
def test_each_state_may_have_bodies_and_gravity_of_its_own(name: str) -> None:
    of, rng = machine(name), np.random.default_rng(4)
    pin.seed(4)
    others, gravities = [], rng.uniform(-9.0, 9.0, (K, 3))
    for _ in range(K):
        model = of.model.copy()
        for joint in range(1, model.njoints):
            model.inertias[joint] = model.inertias[joint] + pin.Inertia.Random()
        others.append(replace(of, model=model))
    m = len(of.coupling.leader)
    q, weights = rng.uniform(-1.5, 1.5, (K, of.size)), rng.normal(size=(K, 6))
    w, alpha = rng.uniform(-1.5, 1.5, (2, K, m))
    parameters = np.array([dynamic_parameters(other) for other in others])
    at_once = wrench_hessian(
        of, q, w, alpha, S, gravity=gravities, weights=weights, parameters=parameters
    )
    for k, other in enumerate(others):
        part = slice(k, k + 1)
        alone = wrench_hessian(
            other, q[part], w[part], alpha[part], S, gravity=gravities[k], weights=weights[part]
        )
        np.testing.assert_allclose(at_once[part], alone, rtol=1e-12, atol=1e-12)


def test_the_hessian_of_a_pendulum_is_known() -> None:
    """A link that swings: f = m r (alpha t - w^2 n) about the root, and its weight."""
    of = machine("feller_buncher")
    zero = np.zeros((1, of.size))
    w, weights = zero.copy(), np.zeros((1, 6))
    w[0, 0], weights[0, :2] = 1.0, (0.6, -0.8)
    found = wrench_hessian(of, zero, w, zero, S, gravity=GRAVITY, weights=weights)[0]
    model, data, n = of.model, of.model.createData(), of.size
    pin.centerOfMass(model, data, of.configuration(zero)[0])
    slewing = 2  # the joint of the slew
    mass = data.mass[slewing]
    arm = mass * (data.oMi[slewing].act(data.com[slewing]) - data.oMi[slewing].translation)
    centripetal = -arm[:2]  # times the squared rate
    assert found[n, n] == pytest.approx(2.0 * weights[0, :2] @ centripetal)
    turned = np.array([-centripetal[1], centripetal[0]])
    assert found[0, n] == pytest.approx(2.0 * weights[0, :2] @ turned)
    assert found[0, 0] == pytest.approx(-weights[0, :2] @ centripetal)
