"""Wrenches of differences of inertia, against inverse dynamics of two machines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from benchmarks.problems.paper import paper_scene
from tests.mimics import MACHINES, coupled
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.planning.program.body_differences import BodyDifferences
from zmp_sqp.planning.program.model import ArmModel

EXACT = 1e-12  # relative to the largest entry
GRAVITY = np.array([1.0, -2.0, -9.5])  # [m/s^2]
S, K = 7.0, 6  # squared duration [s^2], number of states


def machine(name: str) -> Machine:
    return paper_scene().load() if name == "feller_buncher" else coupled(name).machine


def with_changed_bodies(of: Machine, joints: list[int], seed: int) -> Machine:
    pin.seed(seed)
    model = of.model.copy()
    for joint in joints:
        model.inertias[joint] = model.inertias[joint] + pin.Inertia.Random()
    return replace(of, model=model)


def parameters(of: Machine) -> np.ndarray:
    inertias = of.model.inertias
    return np.array([inertias[i].toDynamicParameters() for i in range(1, of.model.njoints)])


def coordinates(of: Machine, kind: str) -> Coordinates:
    if kind == "joints":
        return Coordinates.identity(of.size)
    G = np.zeros((of.size, 2))  # the first joint alone, the others together
    G[0, 0], G[1:, 1] = 1.0, np.linspace(-1.0, 0.5, of.size - 1)
    return Coordinates(np.linspace(0.1, 0.4, of.size), G)


@pytest.mark.parametrize("kind", ["joints", "fewer"])
@pytest.mark.parametrize("name", ["feller_buncher", *MACHINES])
def test_differences_are_those_of_inverse_dynamics(name: str, kind: str) -> None:
    first = machine(name)
    last = first.model.njoints - 1
    bodies = [[last], [1], [3, last], list(range(1, last + 1))]  # 1 is the root's
    others = [with_changed_bodies(first, some, seed) for seed, some in enumerate(bodies)]
    model = ArmModel(first, GRAVITY, coordinates(first, kind))
    change = np.array([parameters(other) for other in others]) - parameters(first)
    differences = BodyDifferences.of(model, change)
    rng = np.random.default_rng(8)
    q, w, alpha = rng.uniform(-1.5, 1.5, (3, K, model.size))
    at = differences.poses(q)
    efforts, jacobian = differences.derivatives(at, w, alpha, S)
    np.testing.assert_array_equal(differences.efforts(at, w, alpha, S), efforts)
    here = model.effort_derivatives(q, w, alpha, S)
    expected = [
        replace(model, machine=other).effort_derivatives(q, w, alpha, S) for other in others
    ]
    for d, there in enumerate(expected):
        for found, wanted in zip(
            (efforts[d], jacobian[:, d]),
            (two - one for one, two in zip(here, there, strict=True)),
            strict=True,
        ):
            np.testing.assert_allclose(found, wanted, atol=EXACT * np.abs(there[1]).max())
    for d, other in enumerate(others):
        centres = [
            pin.centerOfMass(other.model, other.model.createData(), one).copy()
            for one in other.configuration(model.coordinates.joints(q))
        ]
        moment = at.first_moment + differences.first_moments(at)[d]
        np.testing.assert_allclose(moment, other.mass * np.array(centres), atol=1e-9 * other.mass)


def test_no_differences_have_no_efforts_but_a_first_moment() -> None:
    first = machine("feller_buncher")
    model = ArmModel(first, GRAVITY, Coordinates.identity(first.size))
    none = BodyDifferences.of(model, np.zeros((0, first.model.njoints - 1, 10)))
    zero = np.zeros((K, first.size))
    at = none.poses(zero)
    efforts, jacobian = none.derivatives(at, zero, zero, S)
    assert efforts.shape == (0, K, 6)
    assert jacobian.shape == (K, 0, 6, 3 * first.size + 1)
    assert at.first_moment[:, 2].min() > 0.0
