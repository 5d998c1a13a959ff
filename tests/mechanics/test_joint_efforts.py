"""Joint efforts against an independent model; their derivatives and bounds against differences."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.mechanics.conftest import random_motion
from tests.mechanics.test_wrench import RELATIVE, STATES, STEP, state
from zmp_sqp.mechanics.bounds.effort_bounds import effort_bounds
from zmp_sqp.mechanics.bounds.root_bounds import root_bounds
from zmp_sqp.mechanics.ground import GRAVITY, Slope
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.payload import Payload
from zmp_sqp.mechanics.urdf.loader import load_machine
from zmp_sqp.mechanics.wrench import WRENCH, effort_derivatives, efforts

URDF = Path(__file__).resolve().parents[2] / "urdf"
OURS = ("excavator", "forwarder_crane", "mobile_manipulator")
MACHINES = ("feller_buncher", "slewing_crane", "slider", *OURS)
# eighth-order second difference
WEIGHTS = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])


@pytest.mark.parametrize("name", MACHINES)
def test_joint_efforts_are_those_of_a_machine_bolted_to_its_slope(name: str) -> None:
    machine, slope = load_machine(name), Slope(roll=-0.3, pitch=0.2)
    oracle = pin.buildModelFromUrdf(str(URDF / f"{name}.urdf"))  # its base does not move
    oracle.gravity = pin.Motion(slope.gravity(), np.zeros(3))
    data = oracle.createData()
    q, v, a = random_motion(machine, STATES, seed=5)
    root = np.concatenate([-slope.gravity(), np.zeros(3)])
    found = efforts(machine, q, v, a, root_acceleration=root)[:, WRENCH:]
    expected = [pin.rnea(oracle, data, *one) for one in zip(q, v, a, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-6)


# --- derivatives --------------------------------------------------------------------------------


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
def test_effort_derivatives_are_the_central_differences(
    fixture: str, key: str, pick: Callable[[object], np.ndarray], request: pytest.FixtureRequest
) -> None:
    machine: Machine = request.getfixturevalue(fixture)
    at = state(machine)
    analytic = effort_derivatives(machine, **at, joints=True)
    columns = []
    for column in np.eye(at[key].shape[1]):
        ahead, behind = (
            efforts(machine, **{**at, key: at[key] + sign * STEP * column}) for sign in (1, -1)
        )
        columns.append((ahead - behind) / (2.0 * STEP))
    differences, found = np.stack(columns, axis=2), pick(analytic)
    for row in range(WRENCH, WRENCH + machine.size):  # a joint's efforts may be small beside others
        scale = max(float(np.abs(found[:, row]).max()), 1e-3 * float(np.abs(found).max()))
        np.testing.assert_allclose(
            found[:, row], differences[:, row], atol=10.0 * RELATIVE * scale, rtol=0.0
        )
    np.testing.assert_allclose(analytic.effort, efforts(machine, **at), rtol=1e-12, atol=1e-6)


# --- bounds -------------------------------------------------------------------------------------


def cubic(
    rng: np.random.Generator, size: int, speed: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rates, accelerations and jerks of which some vanish, shape (size,) each."""
    moving = rng.integers(0, 2, (3, size))
    scale = np.array([[speed], [speed**2], [speed**3]])
    v, a, j = moving * rng.normal(size=(3, size)) * scale
    return v, a, j


def states_of(q: np.ndarray, v: np.ndarray, a: np.ndarray, j: np.ndarray, t: np.ndarray) -> tuple:
    return q + t * v + t**2 * a / 2.0 + t**3 * j / 6.0, v + t * a + t**2 * j / 2.0, a + t * j


def loaded_machine(name: str) -> Machine:
    machine = load_machine(name)
    if name == "mobile_manipulator":  # beside its last axis, which would have no load otherwise
        return machine.with_payload(Payload(10.0, (0.1, 0.0, 0.2), "tool"))
    if name != "feller_buncher":
        return machine
    return machine.with_payload(Payload(4000.0, (0.0, 0.3, 3.3), "head", np.diag([2e4, 2e4, 1e2])))


@pytest.mark.parametrize("drives", [False, True], ids=["stands", "drives"])
@pytest.mark.parametrize("name", MACHINES)
def test_second_derivatives_of_joint_efforts_stay_below_their_bound(
    name: str, drives: bool
) -> None:
    machine = loaded_machine(name)
    reached = np.zeros(machine.size)
    for seed in range(150):
        rng = np.random.default_rng(seed)
        speed = 10.0 ** rng.uniform(-1.0, 1.3)
        v, a, j = cubic(rng, machine.size, speed)
        q, step = rng.uniform(-3.0, 3.0, machine.size), 0.02 / max(speed, 1.0)
        t = step * np.arange(-4, 5)[:, None]
        slope, base = Slope(*rng.uniform(-1.0, 1.0, 2)), None
        twist, root, yaws = np.zeros((9, 6)), np.zeros((9, 6)), np.zeros(9)
        if drives:
            rates = cubic(rng, 2, speed)  # of path length and yaw
            driven, twist[:, [0, 5]], root[:, [0, 5]] = states_of(np.zeros(2), *rates, t)
            yaws = driven[:, 1]
            base = root_bounds(np.abs(np.stack(rates)).T[:, :, None])
        root[:, :3] -= [slope.gravity(yaw) for yaw in yaws]
        found = efforts(
            machine, *states_of(q, v, a, j, t), root_acceleration=root, root_velocity=twist
        )[:, WRENCH:]
        second, noise = WEIGHTS @ found / step**2, 1e-10 * np.abs(found).max() / step**2
        most = (np.abs(v)[None], np.abs(a)[None], np.abs(j)[None])
        size, bound = effort_bounds(
            machine, *most, reach=np.abs(q)[None], gravity=GRAVITY, base=base, joints=True
        )
        assert (np.abs(second) <= bound.joints[0] * (1.0 + 1e-6) + noise).all(), seed
        assert (np.abs(found[4]) <= size.joints[0] * (1.0 + 1e-9) + 1e-9).all(), seed
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(bound.joints[0] > 1e3 * noise, np.abs(second) / bound.joints[0], 0.0)
        reached = np.maximum(reached, share)
    # bounds that no motion comes near would prove little; a slider's force is linear in time
    if drives or name != "slider":
        assert reached.max() > 0.2
        assert reached.min() > 0.01


def test_the_bound_on_a_slewing_cranes_torque_is_its_inertia_times_its_acceleration() -> None:
    machine, one = load_machine("slewing_crane"), np.ones((1, 1))
    size, _ = effort_bounds(
        machine, 0.0 * one, 0.5 * one, 0.0 * one, reach=one, gravity=0.0, joints=True
    )
    assert size.joints[0, 0] == pytest.approx((1000.0 * 2.0**2 + 16.0) * 0.5)
