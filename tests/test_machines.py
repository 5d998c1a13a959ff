"""Excavator, forwarder crane and mobile manipulator: docs/machines.md against hand calculations."""

from __future__ import annotations

from functools import cache, reduce
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import zmp_sqp as zs
from zmp_sqp.mechanics.wrench import WRENCH, efforts

Array = np.ndarray

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "machines.md").read_text(encoding="utf-8")
MACHINES = ("excavator", "forwarder_crane", "mobile_manipulator")
LEVEL = zs.Slope()
FLAT = 1e-9  # [m]
# excavator: levers of the parts, x ahead and z above the foot pin [m], and their masses [kg]
FOOT, BOOM, STICK, TIP = 1.90, 5.70, 2.925, 1.47
SLEWING = ((5900.0, -0.60), (4200.0, -2.40))  # upper structure, counterweight
UNDERCARRIAGE = 8300.0


@cache
def machine_of(name: str) -> zs.Machine:
    return zs.load_machine(name)


def margin(machine: zs.Machine, q: Array, ground: zs.Slope = LEVEL) -> float:
    """Static stability margin of a pose [m]."""
    rest = np.zeros(machine.size)
    return float(zs.stability_margin(machine, np.asarray(q, dtype=float), rest, rest, ground))


def tipping_load(
    machine: zs.Machine, q: Array, frame: str, com: Array, ground: zs.Slope = LEVEL
) -> float:
    """Mass of a payload with which a pose has no static margin left, by bisection [kg]."""
    low, high = 0.0, 30e3
    for _ in range(60):
        mass = 0.5 * (low + high)
        stands = margin(machine.with_payload(zs.Payload(mass, com, frame)), q, ground) > 0.0
        low, high = (mass, high) if stands else (low, mass)
    return low


def effort(name: str, joint: str) -> float:
    machine = machine_of(name)
    return float(machine.limits.effort[machine.joint_names.index(joint)])


def velocity(name: str, joint: str) -> float:
    machine = machine_of(name)
    return float(machine.limits.velocity[machine.joint_names.index(joint)])


def area(bore: float, rod: float = 0.0) -> float:
    return float(np.pi / 4.0 * (bore**2 - rod**2))


# --- numbers ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("joint", "count", "bore", "rod", "stroke"),
    [
        ("boom", 2, 0.120, 0.0, 1.260),
        ("stick", 1, 0.140, 0.100, 1.504),
        ("bucket", 1, 0.120, 0.080, 1.104),
    ],
)
def test_excavator_cylinders_make_the_efforts_and_rates(
    joint: str, count: int, bore: float, rod: float, stroke: float
) -> None:
    machine = machine_of("excavator")
    at = machine.joint_names.index(joint)
    turn = machine.limits.position_upper[at] - machine.limits.position_lower[at]
    pressure, flow = 35.0e6, 0.429 / 60.0  # [Pa], [m^3/s] Cat 320
    torque = pressure * count * area(bore, rod) * stroke / turn
    assert 0.99 * torque < effort("excavator", joint) <= torque  # rounded down
    rate = flow * turn / (count * area(bore) * stroke)
    assert velocity("excavator", joint) == pytest.approx(rate, rel=2e-3)
    assert machine.limits.acceleration[at] == pytest.approx(velocity("excavator", joint) / 0.5)


def test_excavator_slew_is_the_makers_and_as_quick_as_standard_times() -> None:
    machine = machine_of("excavator")
    assert velocity("excavator", "slew") == pytest.approx(11.3 * 2.0 * np.pi / 60.0, rel=1e-3)
    assert effort("excavator", "slew") == 74e3
    # an acceleration at which a turn by 90 and by 180 degrees takes 2.9 and 4.3 s, at 1.15 rad/s
    a = machine.limits.acceleration[0]
    half, whole = np.sqrt(2.0 * np.pi / 2.0 / a), np.pi / 1.15 + 1.15 / (2.0 * a)
    assert half == pytest.approx(2.9, abs=0.3)
    assert whole == pytest.approx(4.3, abs=0.4)


def slew_inertia(q: Array, load: float) -> float:
    """Inertia of the excavator about its slew axis with a payload at the bucket pin [kg m^2]."""
    payload = zs.Payload(load, (STICK, 0.0, 0.0), "stick")
    machine = machine_of("excavator").with_payload(payload)
    rest, push = np.zeros((1, 4)), np.array([[1.0, 0.0, 0.0, 0.0]])
    # without gravity
    found = efforts(machine, np.array([q]), rest, push, root_acceleration=np.zeros(6))
    return float(found[0, WRENCH])


@pytest.mark.filterwarnings("ignore::zmp_sqp.MachineWarning")
def test_excavator_slew_torque_allows_the_accelerations_that_are_measured_on_real_machines() -> (
    None
):
    reaching = np.array([0.0, 0.1, -0.7, -1.0])
    assert 0.3 < 74e3 / slew_inertia(reaching, 1.0) < 0.5  # 0.37 empty
    assert 0.15 < 74e3 / slew_inertia(reaching, 2000.0) < 0.3  # 0.24 to 0.27 loaded


def test_forwarder_rates_are_a_flow_at_a_pressure() -> None:
    power = 0.120 / 60.0 * 21e6
    for joint in ("lift", "jib"):
        rate = power / effort("forwarder_crane", joint)
        assert velocity("forwarder_crane", joint) == pytest.approx(rate, rel=1e-3)
    limits = machine_of("forwarder_crane").limits
    times = limits.velocity / limits.acceleration
    np.testing.assert_allclose(times, [1.0, 0.5, 0.5, 0.5], rtol=1e-12)


def test_forwarder_crane_weighs_as_much_as_its_lifting_moment_asks_for() -> None:
    inertias = machine_of("forwarder_crane").model.inertias[2:]
    crane = sum(float(body.mass) for body in inertias) - 300.0  # grapple
    assert crane == pytest.approx(1100.0 * effort("forwarder_crane", "lift") / 68e3, rel=1e-2)


def test_forwarder_wheels_are_as_large_as_their_tyres_name_says() -> None:
    machine = machine_of("forwarder_crane")
    radius = 26.5 * 0.0254 / 2.0 + 0.45 * 0.71
    at = machine.model.getFrameId("front_left_fore_wheel")
    assert machine.model.frames[at].placement.translation[2] == pytest.approx(radius, abs=1e-3)


def test_supports_are_the_bands_that_carry() -> None:
    expected = {
        "excavator": ((-1.825, 1.825), 1.29),
        "forwarder_crane": ((-2.90 - 0.75, 2.30 + 0.75), 1.145),
        "mobile_manipulator": ((-0.25, 0.25), 0.279),
    }
    for name, ((rear, front), side) in expected.items():
        support = machine_of(name).support
        assert support is not None
        assert support.height == pytest.approx(0.0, abs=FLAT)
        corners = {(round(float(x), 9), round(float(y), 9)) for x, y in support.vertices}
        assert corners == {(x, y) for x in (rear, front) for y in (-side, side)}


# --- kinematics ---------------------------------------------------------------------------------


def point(machine: zs.Machine, q: Array, frame: str, at: tuple[float, float, float]) -> Array:
    """Place of a point of a frame in the root frame, shape (3,) [m]."""
    model, data = machine.model, machine.model.createData()
    pin.framesForwardKinematics(model, data, machine.configuration(np.array([q]))[0])
    placement = data.oMf[model.getFrameId(frame, pin.FrameType.BODY)]
    return np.asarray(placement.act(np.array(at, dtype=float)))


def test_the_excavators_pins_are_where_two_links_put_them() -> None:
    machine, rng = machine_of("excavator"), np.random.default_rng(0)
    for _ in range(5):
        q = rng.uniform(machine.limits.position_lower, machine.limits.position_upper)
        slew, boom, stick, bucket = q
        radius = BOOM * np.cos(boom) + STICK * np.cos(boom + stick)
        height = FOOT + BOOM * np.sin(boom) + STICK * np.sin(boom + stick)
        radius += TIP * np.cos(boom + stick + bucket)
        height += TIP * np.sin(boom + stick + bucket)
        expected = [radius * np.cos(slew), radius * np.sin(slew), height]
        np.testing.assert_allclose(
            point(machine, q, "bucket", (TIP, 0.0, 0.0)), expected, atol=1e-8
        )


def test_the_forwarders_tip_reaches_as_far_as_its_links() -> None:
    machine, rng = machine_of("forwarder_crane"), np.random.default_rng(0)
    for _ in range(5):
        q = rng.uniform(machine.limits.position_lower, machine.limits.position_upper)
        slew, lift, jib, out = q
        radius = 3.60 * np.cos(lift) + (2.90 + out) * np.cos(lift + jib)
        height = 2.70 + 3.60 * np.sin(lift) + (2.90 + out) * np.sin(lift + jib)
        expected = [radius * np.cos(slew), radius * np.sin(slew), height]
        np.testing.assert_allclose(point(machine, q, "grapple", (0, 0, 0)), expected, atol=1e-8)


D = (0.1807, 0.0, 0.0, 0.17415, 0.11985, 0.11655)
A = (0.0, -0.6127, -0.57155, 0.0, 0.0, 0.0)
ALPHA = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
LINKS = (7.369, 13.051, 3.989, 2.1, 1.98, 0.615)
CENTRES = (
    (0.021, 0.0, 0.027),
    (0.38, 0.0, 0.158),
    (0.24, 0.0, 0.068),
    (0.0, 0.007, 0.018),
    (0.0, 0.007, 0.018),
    (0.0, 0.0, -0.026),
)


def denavit_hartenberg(theta: float, d: float, a: float, alpha: float) -> Array:
    """Rz(theta) Tz(d) Tx(a) Rx(alpha) as one matrix, shape (4, 4)."""
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array(
        [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [0.0, sa, ca, d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def arm_frames(q: Array) -> list[Array]:
    """The maker's frames of all links, in the root frame, shape (4, 4) each."""
    foot = np.eye(4)
    foot[2, 3] = 0.386
    steps = [denavit_hartenberg(*row) for row in zip(q, D, A, ALPHA, strict=True)]
    return [reduce(np.matmul, steps[: i + 1], foot) for i in range(6)]


def test_the_manipulators_flange_is_where_the_makers_parameters_put_it() -> None:
    machine, rng = machine_of("mobile_manipulator"), np.random.default_rng(0)
    zero = [A[1] + A[2], -D[3] - D[5], 0.386 + D[0] - D[4]]
    found = point(machine, np.zeros(6), "tool", (0.0, 0.0, 0.0))
    np.testing.assert_allclose(found, zero, atol=1e-8)
    for _ in range(5):
        q = rng.uniform(-3.0, 3.0, 6)
        found = point(machine, q, "tool", (0.0, 0.0, 0.0))
        np.testing.assert_allclose(found, arm_frames(q)[-1][:3, 3], atol=1e-8)


# --- standing still -----------------------------------------------------------------------------


def excavator_levers(q: Array) -> list[tuple[float, float]]:
    """Mass [kg] and horizontal distance from the slew axis [m] of all that slews."""
    _, boom, stick, bucket = q

    def along(angle: float, x: float, z: float) -> float:
        return float(x * np.cos(angle) - z * np.sin(angle))

    elbow, pin = BOOM * np.cos(boom), BOOM * np.cos(boom) + STICK * np.cos(boom + stick)
    return [
        *SLEWING,
        (2030.0, along(boom, 2.76, 0.52)),
        (1100.0, elbow + along(boom + stick, 0.94, 0.24)),
        (970.0, pin + along(boom + stick + bucket, 0.60, 0.30)),
    ]


def test_what_tips_the_excavator_over_is_a_lever_and_a_sum() -> None:
    machine = machine_of("excavator")
    found = {}
    for azimuth, edge in ((0.0, 1.825), (np.pi / 2.0, 1.29), (-np.pi / 2.0, 1.29)):
        q = np.array([azimuth, 0.2988, -1.0921, -0.7775])
        radius = BOOM * np.cos(q[1]) + STICK * np.cos(q[1] + q[2])
        holding = UNDERCARRIAGE * edge + sum(m * (edge - x) for m, x in excavator_levers(q))
        load = tipping_load(machine, q, "stick", (STICK, 0.0, 0.0))
        assert load == pytest.approx(holding / (radius - edge), rel=1e-6)
        found[azimuth] = load
    assert found[np.pi / 2.0] == pytest.approx(found[-np.pi / 2.0], rel=1e-9)
    for over in (0.0, np.pi / 2.0):  # the page's figures, in tonnes
        assert f"{found[over] / 1e3:.2f} t" in PAGE


def test_the_excavator_carries_what_a_maker_allows_for_such_a_machine() -> None:
    """Cat 320E L, counterweight 5.4 t, full reach on the ground line: 3410 kg with its bucket."""
    reach = np.sqrt((BOOM + STICK) ** 2 - FOOT**2)
    q = np.array([np.pi / 2.0, -np.arcsin(FOOT / (BOOM + STICK)), 0.0, -2.0])
    machine = machine_of("excavator").with_payload(
        zs.Payload(1200.0, (0.0, 0.0, 0.0), "counterweight")
    )
    rated = 0.75 * (970.0 + tipping_load(machine, q, "stick", (STICK, 0.0, 0.0)))
    assert reach == pytest.approx(8.41, abs=0.01)
    assert rated == pytest.approx(3410.0, rel=0.05)
    assert f"{round(rated, -1):.0f}" in PAGE.replace(" ", "")


def test_the_forwarder_stands_across_a_slope_as_its_centre_of_mass_says() -> None:
    machine, slope = machine_of("forwarder_crane"), zs.Slope(roll=-0.3)
    q = np.array([np.pi / 2.0, 0.4, -0.9, 1.2])
    reach, along = 3.60 * np.cos(0.4), 2.90 + 1.2
    rise, lean = 2.70 + 3.60 * np.sin(0.4), -0.5  # height of the jib's pin, angle of the jib
    parts = [  # mass [kg], distance to the left and height [m]
        (3400.0, 0.0, 1.15),
        (7600.0, 0.0, 1.40),
        (8 * 580.0, 0.0, 0.656),
        (560.0, 0.0, 1.50 + 0.55),
        (700.0, 1.70 * np.cos(0.4), 2.70 + 1.70 * np.sin(0.4)),
        (430.0, reach + 1.20 * np.cos(lean), rise + 1.20 * np.sin(lean)),
        (250.0, reach + (along - 1.20) * np.cos(lean), rise + (along - 1.20) * np.sin(lean)),
        (300.0, reach + along * np.cos(lean), rise + along * np.sin(lean)),
    ]
    total = sum(m for m, _, _ in parts)
    left, height = (sum(part[0] * part[i] for part in parts) / total for i in (1, 2))
    assert total == pytest.approx(machine.mass)
    expected = 1.145 - (left + height * np.tan(0.3))
    assert margin(machine, q, slope) == pytest.approx(expected, abs=1e-9)


def test_the_manipulator_stands_as_its_links_centres_of_mass_say() -> None:
    machine, rng = machine_of("mobile_manipulator"), np.random.default_rng(1)
    for _ in range(5):
        q = rng.uniform(-3.0, 3.0, 6)
        frames = arm_frames(q)
        centre = sum(
            m * (T @ [*c, 1.0])[:2] for m, T, c in zip(LINKS, frames, CENTRES, strict=True)
        )
        centre = (centre + 1.0 * (frames[-1] @ [0.0, 0.0, 0.06, 1.0])[:2]) / machine.mass
        x, y = np.abs(centre)
        assert margin(machine, q) == pytest.approx(min(0.25 - x, 0.279 - y), abs=1e-9)


@pytest.mark.parametrize("name", MACHINES[:2])
def test_left_is_the_mirror_image_of_right(name: str) -> None:
    machine, rng = machine_of(name), np.random.default_rng(2)
    for _ in range(10):
        q = rng.uniform(machine.limits.position_lower, machine.limits.position_upper)
        roll, pitch = rng.uniform(-0.15, 0.15, 2)
        mirrored = q * np.array([-1.0, 1.0, 1.0, 1.0])
        assert margin(machine, q, zs.Slope(roll=roll, pitch=pitch)) == pytest.approx(
            margin(machine, mirrored, zs.Slope(roll=-roll, pitch=pitch)), abs=1e-9
        )


def test_the_manipulator_turned_by_half_a_turn_is_the_same_on_the_opposite_slope() -> None:
    machine, rng = machine_of("mobile_manipulator"), np.random.default_rng(3)
    for _ in range(10):
        q, (roll, pitch) = rng.uniform(-3.0, 3.0, 6), rng.uniform(-0.1, 0.1, 2)
        turned = q + np.array([np.pi, 0.0, 0.0, 0.0, 0.0, 0.0])
        g = zs.Slope(roll=roll, pitch=pitch).gravity()
        opposite = zs.Slope(roll=-roll, pitch=-pitch)
        np.testing.assert_allclose(opposite.gravity(), g * [-1.0, -1.0, 1.0], atol=1e-12)
        here = margin(machine, q, zs.Slope(roll=roll, pitch=pitch))
        assert here == pytest.approx(margin(machine, turned, opposite), abs=1e-9)


@pytest.mark.parametrize("name", MACHINES)
def test_the_simplified_model_says_why_it_does_not_serve_them(name: str) -> None:
    machine = machine_of(name)
    q = np.clip(
        np.zeros(machine.size), machine.limits.position_lower, machine.limits.position_upper
    )
    with pytest.raises(zs.ProblemError, match="the simplified model needs"):
        zs.Problem(machine, q, q, model="simplified")
