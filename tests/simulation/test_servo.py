"""Simulated machine for control loops: lag in closed form, loads, payload changes, refusals."""

from __future__ import annotations

import numpy as np
import pytest

import zmp_sqp as zs
from zmp_sqp.simulation import ServoMachine

pytestmark = pytest.mark.physics

POSE = np.array([0.3, -0.8, -2.0, 0.7, 0.0])  # slew, boom, stick, tilt, head [rad]
TREE = zs.Payload(mass=2000.0, com=(0.0, 0.0, 3.323), frame="head")


def machine() -> zs.Machine:
    return zs.load_machine("feller_buncher").with_payload(TREE)


def test_joints_follow_constant_rates_with_a_first_order_lag():
    lag, rates, t = np.array([0.06, 0.05, 0.04, 0.03, 0.03]), 0.1 * np.array([1, -1, 1, 1, -1]), 0.2
    plant = ServoMachine(machine(), POSE, zs.Slope(), lag=lag, time_step=1e-3)
    plant.drive(rates, t)
    q, v, a = plant.state
    decay = np.exp(-t / lag)
    np.testing.assert_allclose(v, rates * (1.0 - decay), atol=2e-4)
    np.testing.assert_allclose(q - POSE, rates * (t - lag * (1.0 - decay)), atol=2e-4)
    np.testing.assert_allclose(a, rates / lag * decay, atol=5e-3)


def test_contact_forces_have_the_margin_of_inverse_dynamics():
    ground = zs.Slope(roll=np.radians(5.0))
    plant = ServoMachine(machine(), POSE, ground, lag=0.3)
    for rate in (0.0, 0.3, 0.3, -0.1):
        plant.drive([rate, 0.1, 0.0, 0.0, 0.0], 0.05)
        expected = float(zs.stability_margin(plant.machine, *plant.state, ground))
        assert plant.contact_margin == pytest.approx(expected, abs=0.01)
    assert plant.tilt < 1e-4


def test_a_dropped_payload_changes_the_loads_and_not_the_state():
    loaded, ground = machine(), zs.Slope(pitch=0.1)
    plant = ServoMachine(loaded, POSE, ground)
    plant.drive(np.full(5, 0.1), 0.1)
    before = plant.state
    plant.change_machine(loaded.with_payload_scaled(0.0))
    for one, other in zip(before[:2], plant.state[:2], strict=True):
        np.testing.assert_array_equal(one, other)
    plant.drive(np.zeros(5), 1.0)
    weight = 9.81 * np.cos(0.1) * (loaded.mass - TREE.mass)
    assert plant.foot_loads.sum() == pytest.approx(weight, rel=1e-3)


def test_a_blow_tips_the_machine_over():
    plant = ServoMachine(machine(), POSE, zs.Slope(roll=np.radians(20.0)), lag=0.03)
    plant.drive([0.0, 0.6, 0.6, 0.0, 0.0], 0.5)
    plant.drive([0.0, -0.6, -0.6, 0.0, 0.0], 0.5)
    assert plant.tilt > 1e-3


def test_noise_is_that_of_the_seed():
    first, second, other = (
        ServoMachine(machine(), POSE, zs.Slope(), noise=(1e-3, 1e-2), seed=seed).measured
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, second)
    assert np.abs(first[0] - other[0]).max() > 0.0
    assert np.abs(first[0] - POSE).max() < 6e-3


@pytest.mark.parametrize(
    ("options", "complaint"),
    [({"lag": 1e-3}, "lag"), ({"lag": np.nan}, "lag"), ({"time_step": 0.1}, "time_step")],
)
def test_settings_out_of_range_are_refused(options, complaint):
    with pytest.raises(zs.ProblemError, match=complaint):
        ServoMachine(machine(), POSE, zs.Slope(), **options)
