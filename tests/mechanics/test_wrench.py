from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.mechanics.conftest import random_motion
from zmp_sqp.mechanics.ground import GRAVITY
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import ground_reaction, ground_reaction_derivatives

STATES = 20
STEP = 1e-5
# of the largest entry: central differences lose half of the digits, STEP^2 and eps / STEP
RELATIVE = 1e-7


def state(machine: Machine) -> dict[str, np.ndarray]:
    q, v, a = random_motion(machine, STATES, seed=7)
    random = np.random.default_rng(8)
    root = random.uniform(-1.0, 1.0, (2, STATES, 6))
    return {
        "q": q,
        "v": v,
        "a": a,
        "root_velocity": root[0],
        "root_acceleration": root[1] + [0, 0, GRAVITY, 0, 0, 0],
    }


def differences(machine: Machine, at: dict[str, np.ndarray], key: str) -> np.ndarray:
    """Central differences of the wrench by one argument, shape (STATES, 6, columns)."""
    columns = []
    for column in np.eye(at[key].shape[1]):
        ahead, behind = ({**at, key: at[key] + sign * STEP * column} for sign in (1, -1))
        columns.append(
            (ground_reaction(machine, **ahead) - ground_reaction(machine, **behind)) / (2 * STEP)
        )
    return np.stack(columns, axis=2)


@pytest.mark.parametrize("fixture", ["loaded", "paper", "permuted"])
@pytest.mark.parametrize(
    ("key", "pick"),
    [
        ("q", lambda d: d.wrt_position),
        ("root_velocity", lambda d: d.wrt_velocity[:, :, :6]),
        ("v", lambda d: d.wrt_velocity[:, :, 6:]),
        ("root_acceleration", lambda d: d.wrt_acceleration[:, :, :6]),
        ("a", lambda d: d.wrt_acceleration[:, :, 6:]),
    ],
)
def test_wrench_derivatives_are_the_central_differences(
    fixture: str, key: str, pick: Callable[[object], np.ndarray], request: pytest.FixtureRequest
) -> None:
    machine: Machine = request.getfixturevalue(fixture)
    at = state(machine)
    analytic = pick(ground_reaction_derivatives(machine, **at))
    np.testing.assert_allclose(
        analytic, differences(machine, at, key), atol=RELATIVE * np.abs(analytic).max(), rtol=0
    )


@pytest.mark.parametrize("fixture", ["loaded", "permuted"])
def test_derivatives_come_with_the_wrench_itself(
    fixture: str, request: pytest.FixtureRequest
) -> None:
    machine: Machine = request.getfixturevalue(fixture)
    at = state(machine)
    wrench = ground_reaction(machine, **at)
    np.testing.assert_allclose(
        ground_reaction_derivatives(machine, **at).wrench, wrench, rtol=1e-12, atol=1e-6
    )


def test_at_rest_the_ground_carries_the_weight(loaded: Machine) -> None:
    rest = np.zeros((1, 5))
    wrench = ground_reaction(
        loaded, rest, rest, rest, root_acceleration=np.array([0, 0, GRAVITY, 0, 0, 0.0])
    )
    np.testing.assert_allclose(wrench[0, :3], [0.0, 0.0, 27650.0 * GRAVITY], atol=1e-6)
