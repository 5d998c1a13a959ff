"""Motions of quintics: certificates against samples, limits against the roots of derivatives."""

from __future__ import annotations

from dataclasses import replace
from math import factorial

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.paper import paper_scene
from zmp_sqp.mechanics.bounds.effort_norms import Norms, body_norms
from zmp_sqp.mechanics.wrench import efforts
from zmp_sqp.motion.interpolation import cubic_motion, quintic_motion
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning.proof.certificate import certify_for
from zmp_sqp.planning.proof.effort_curves import _norms
from zmp_sqp.planning.proof.joint_peaks import joint_peaks
from zmp_sqp.planning.proof.limits_in_time import limit_peaks
from zmp_sqp.planning.proof.polynomial_extremes import largest_values

SCENE = paper_scene()
MACHINE = SCENE.load()
START = np.array([0.0, -np.pi / 6, -2 * np.pi / 3, np.pi / 6, -np.pi / 2])
BARE = zs.load_machine("feller_buncher")


def random_quintic(seed: int, *, count: int = 6, pace: float = 1.0) -> zs.Trajectory:
    """Motion through random states at unequal times."""
    rng = np.random.default_rng(seed)
    h = rng.uniform(0.15, 0.6, (count, 1)) / pace
    v = pace * rng.uniform(-0.25, 0.25, (count + 1, 5))
    a = pace**2 * rng.uniform(-0.5, 0.5, (count + 1, 5))
    # near what a cubic acceleration gives, so that no wild polynomial is needed
    steps = 0.5 * h * (v[1:] + v[:-1]) + h**2 / 12.0 * (a[:-1] - a[1:])
    steps += 0.03 * pace * h * rng.normal(size=steps.shape)
    q = START + np.vstack([np.zeros((1, 5)), np.cumsum(steps, axis=0)])
    times = np.concatenate([[0.0], np.cumsum(h)])
    return quintic_motion(MACHINE.joint_names, times, q, v, a)


def dense(motion: zs.Trajectory, count: int = 60) -> tuple[np.ndarray, ...]:
    return motion.within(np.linspace(0.0, 1.0, count))[1:]


def test_states_are_those_of_the_polynomial_and_its_derivatives() -> None:
    motion = random_quintic(0)
    k, since = np.array([2]), np.array([0.1])
    _, v, a = motion.state_in(k, since)
    step = 1e-4
    beside = [motion.state_in(k, since + move) for move in (-step, step)]
    np.testing.assert_allclose((beside[1][0] - beside[0][0]) / (2.0 * step), v, atol=1e-6)
    np.testing.assert_allclose((beside[1][1] - beside[0][1]) / (2.0 * step), a, atol=1e-5)
    jerk, snap, crackle = motion.higher_in(k, since)
    np.testing.assert_allclose((beside[1][2] - beside[0][2]) / (2.0 * step), jerk, atol=1e-3)
    ahead, behind = (motion.higher_in(k, since + move) for move in (step, -step))
    np.testing.assert_allclose((ahead[0] - behind[0]) / (2.0 * step), snap, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose((ahead[1] - behind[1]) / (2.0 * step), crackle, rtol=1e-6)


@pytest.mark.parametrize("first", range(0, 120, 20))
def test_certified_margins_are_just_below_dense_samples(first: int) -> None:
    """120 random motions of all paces, half of them sliding into tip-over."""
    for seed in range(first, first + 20):
        motion = random_quintic(seed, pace=float(np.random.default_rng(seed).uniform(0.2, 1.4)))
        found = zs.certify(MACHINE, motion, SCENE.ground)
        if not np.isfinite(found.sampled):
            continue
        worst = motion(np.array([found.margin_at]))
        states = (np.vstack(pair) for pair in zip(dense(motion), worst, strict=True))
        sampled = zs.stability_margin(MACHINE, *states, SCENE.ground).min()
        assert found.margin <= sampled + 1e-9, seed
        assert found.margin >= sampled - 1e-4 * (1.0 + abs(sampled)), seed
        contact = next(row for row in found.guarantees if row.name == "contact")
        assert contact.proven


@pytest.mark.parametrize("name", ["forwarder_crane", "mobile_manipulator"])
def test_one_quintic_over_many_seconds_is_certified_as_closely(name: str) -> None:
    """Two-point motions of up to 8 s, also of joints that slide: their terms cancel a lot."""
    machine, rng, with_margin = zs.load_machine(name), np.random.default_rng(11), 0
    limits = machine.limits
    lower, upper = np.maximum(limits.position_lower, -2.0), np.minimum(limits.position_upper, 2.0)
    for _ in range(40):
        T, q = rng.uniform(2.0, 8.0), rng.uniform(lower, upper)
        goal = q + rng.uniform(-0.4, 0.4, machine.size) * T * np.minimum(limits.velocity, 3.0)
        v = rng.uniform(-0.3, 0.3, (2, machine.size)) * limits.velocity
        a = rng.uniform(-0.3, 0.3, (2, machine.size)) * np.minimum(limits.acceleration, 3.0)
        times, both = np.array([0.0, T]), np.stack([q, goal])
        motion = quintic_motion(machine.joint_names, times, both, v, a)
        found = zs.certify(machine, motion, zs.Slope())
        sampled = zs.stability_margin(machine, *dense(motion, 2000), zs.Slope()).min()
        if not (np.isfinite(sampled) and sampled > 0.02):
            continue
        with_margin += 1
        assert sampled + 1e-9 >= found.margin >= sampled - 1e-3
    assert with_margin >= 10


def test_more_than_half_of_those_motions_have_a_margin() -> None:
    """So that the test above tests something."""
    with_margin = 0
    for seed in range(0, 120, 6):
        motion = random_quintic(seed, pace=float(np.random.default_rng(seed).uniform(0.2, 1.4)))
        with_margin += bool(np.isfinite(zs.certify(MACHINE, motion, SCENE.ground).sampled))
    assert with_margin > 10


@pytest.mark.parametrize("seed", range(5))
def test_torques_of_quintics_are_proven(seed: int) -> None:
    motion = random_quintic(seed)
    found = zs.certify(BARE, motion, zs.Slope(), constraints=[zs.TorqueLimits()])
    row = next(row for row in found.guarantees if row.name == "torque_limits")
    q, v, a = dense(motion)
    root = np.tile([0.0, 0.0, 9.81, 0.0, 0.0, 0.0], (len(q), 1))
    torque = efforts(BARE, q, v, a, root_acceleration=root, joints=True)[:, 6:]
    rooms = BARE.limits.effort - np.abs(torque)
    assert row.proven
    least = row.label.split()[0]
    column = BARE.joint_names.index(least)
    assert row.value <= rooms[:, column].min() + 1e-6
    assert row.value >= rooms[:, column].min() - 2e-3 * BARE.limits.effort[column]


@pytest.mark.parametrize("seed", range(8))
def test_a_payload_anywhere_in_its_box_keeps_the_certified_margin(seed: int) -> None:
    motion, side = random_quintic(seed, pace=0.7), 0.15
    goal = START + np.array([0.3, 0.0, 0.0, 0.0, 0.0])
    problem = zs.Problem(MACHINE, START, goal, payload_com_uncertainty=side)
    found = certify_for(problem, motion)
    rng = np.random.default_rng(seed)
    for _ in range(6):
        moved = MACHINE.with_payload_moved(rng.uniform(-side, side, 3))
        sampled = zs.stability_margin(moved, *dense(motion, 20), zs.Slope()).min()
        assert found.margin <= sampled + 1e-9


def polynomial_roots(motion: zs.Trajectory, joint: int) -> list[tuple[float, float, float]]:
    """States of a joint at all times where one of them can be extreme, by roots of polynomials."""
    states = []
    for k, h in enumerate(np.diff(motion.times)):
        derivatives = [
            part[k, joint]
            for part in (
                motion.positions,
                motion.velocities,
                motion.accelerations,
                motion.jerks,
                motion.snaps,
                motion.crackles,
            )
        ]
        factorials = np.array([1.0, 1.0, 2.0, 6.0, 24.0, 120.0])
        q = np.polynomial.Polynomial(np.array(derivatives) / factorials)
        v, a, j = q.deriv(), q.deriv(2), q.deriv(3)
        times = [0.0, h]
        for derivative in (v, a, j):
            roots = derivative.roots()
            times += [t.real for t in roots if abs(t.imag) < 1e-6 and 0.0 <= t.real <= h]
        states += [(q(t), v(t), a(t)) for t in times]
    return states


@pytest.mark.parametrize("seed", range(25))
def test_limits_of_quintics_are_checked_at_the_roots_of_their_derivatives(seed: int) -> None:
    motion = random_quintic(seed, count=4)
    peaks = {(peak.joint, peak.limit): peak for peak in limit_peaks(MACHINE, motion)}
    for joint, name in enumerate(MACHINE.joint_names):
        q, v, a = (np.array(part) for part in zip(*polynomial_roots(motion, joint), strict=True))
        for limit, value in (
            ("upper position", q.max()),
            ("lower position", q.min()),
            ("velocity", np.abs(v).max()),
            ("acceleration", np.abs(a).max()),
        ):
            assert peaks[name, limit].value == pytest.approx(value, abs=1e-9)
        fastest = motion(peaks[name, "velocity"].time)[1][joint]
        assert abs(fastest) == pytest.approx(np.abs(v).max(), abs=1e-9)
    upper = [peak.value for key, peak in peaks.items() if key[1] == "upper position"]
    samples = dense(motion, 300)[0].max(axis=0)
    assert (np.array(upper) >= samples - 1e-12).all()


def test_the_largest_value_of_a_polynomial_is_found_where_it_is() -> None:
    x = np.array([0.3, 0.9, 0.0, 1.0])  # places of maxima of 1 - (x - place)^2
    coefficients = np.stack([1.0 - x**2, 2.0 * x, -np.ones(4)])[:, None]
    bound, interval, share = largest_values(coefficients)
    np.testing.assert_allclose(bound, 1.0, atol=1e-12)
    assert (bound >= 1.0).all()
    np.testing.assert_allclose(share, x, atol=2e-6)
    assert (interval == 0).all()


def test_peaks_between_two_times_bound_what_is_there() -> None:
    for seed in range(20):
        motion, rng = random_quintic(seed), np.random.default_rng(seed)
        k = rng.integers(0, motion.intervals, 30)
        h = np.diff(motion.times)[k]
        since = rng.uniform(0.0, 0.7, 30) * h
        length = rng.uniform(0.0, 0.3, 30) * h
        bounds = joint_peaks(motion, k, since, length)
        for share in np.linspace(0.0, 1.0, 21):
            at = since + share * length
            values = (*motion.state_in(k, at), motion.higher_in(k, at)[0])
            for value, bound in zip(values, bounds, strict=True):
                assert (np.abs(value) <= bound + 1e-9).all()


def test_a_quintic_whose_pieces_are_cubics_has_their_certificate() -> None:
    rng = np.random.default_rng(4)
    times = np.cumsum(rng.uniform(0.1, 0.5, 7)) - 0.1
    times -= times[0]
    q = START + 0.1 * rng.normal(size=(7, 5))
    cubic = cubic_motion(MACHINE.joint_names, times, q, 0.2 * rng.normal(size=(7, 5)))
    tiny = np.full_like(cubic.jerks, 1e-300)
    same = zs.Trajectory(
        cubic.joint_names,
        cubic.times,
        cubic.positions,
        cubic.velocities,
        cubic.accelerations,
        cubic.jerks,
        snaps=tiny,
        crackles=tiny,
    )
    one, other = (zs.certify(MACHINE, motion, SCENE.ground) for motion in (cubic, same))
    assert same.snaps is not None
    assert other.margin == pytest.approx(one.margin, abs=1e-12)
    assert other.limit_excess == pytest.approx(one.limit_excess, abs=1e-10)


def test_snaps_that_are_zero_are_dropped_and_a_base_refuses_others() -> None:
    motion = random_quintic(1)
    zero = np.zeros_like(motion.jerks)
    times, q = np.array([0.0, 1.0]), np.vstack([START, START])
    still = zs.Trajectory(
        motion.joint_names, times, q, 0.0 * q, zero[:1], snaps=zero[:1], crackles=zero[:1]
    )
    assert still.snaps is None
    drive = UnicycleMotion(
        times, np.zeros((2, 3)), np.zeros((2, 2)), np.zeros((1, 2)), np.zeros((1, 2))
    )
    quintic = quintic_motion(motion.joint_names, times, q, 0.0 * q, 0.0 * q + [[0.0], [0.1]])
    with pytest.raises(zs.TrajectoryError, match="must be linear between nodes"):
        replace(quintic, base=drive)


def test_rows_of_a_user_are_sampled_only_where_their_bound_does_not_hold() -> None:
    def fast(machine: zs.Machine, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple:
        jacobian = np.zeros((len(q), 1, 3 * machine.size))
        jacobian[:, 0, machine.size] = 2.0 * v[:, 0]
        return v[:, :1] ** 2 - 4.0, jacobian

    rows = zs.PathRows(
        "fast",
        fast,
        curvature_bound=lambda machine, v, a, j: 2.0 * (a[:, :1] ** 2 + v[:, :1] * j[:, :1]),
    )
    quintic = random_quintic(2)
    cubic = cubic_motion(quintic.joint_names, quintic.times, quintic.positions, quintic.velocities)
    for motion, proven in ((quintic, False), (cubic, True)):
        found = zs.certify(BARE, motion, zs.Slope(), constraints=[rows])
        row = next(row for row in found.guarantees if row.name == "fast")
        assert row.proven is proven
        assert row.value <= 4.0 - (dense(motion)[1][:, 0] ** 2).max() + 1e-3


def test_certificates_of_motions_with_linear_accelerations_have_not_changed() -> None:
    """Numbers of the certificate before it knew quintics."""
    goal = START + np.array([np.pi, 0.0, 0.0, 0.0, 0.0])
    blind = zs.certify(MACHINE, zs.phase_plane(MACHINE, START, goal), SCENE.ground)
    assert blind.margin == pytest.approx(-0.8039437451338166, abs=1e-12)
    assert blind.tip_over.time == 2.25
    rng = np.random.default_rng(20)
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 0.4, 12))])
    a, j = rng.uniform(-0.5, 0.5, (12, 5)), rng.uniform(-1.0, 1.0, (12, 5))
    v, q = np.zeros((13, 5)), np.tile(START, (13, 1))
    q[1:] = 0.0
    for k, h in enumerate(np.diff(times)):
        v[k + 1] = v[k] + h * a[k] + 0.5 * h**2 * j[k]
        q[k + 1] = q[k] + h * v[k] + 0.5 * h**2 * a[k] + h**3 / 6.0 * j[k]
    motion = zs.Trajectory(MACHINE.joint_names, times, q, v, a, j)
    for options, margin in (
        ({}, 0.48312671894074094),
        ({"constraints": [zs.TorqueLimits()]}, 0.48312671894074094),
        ({"spread": 500.0}, 0.4793919448865879),
    ):
        found = zs.certify(MACHINE, motion, SCENE.ground, **options)
        assert found.margin == pytest.approx(margin, abs=1e-12)
        assert found.limit_excess == pytest.approx(-0.08989215518466365, abs=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_norms_at_complex_times_bound_the_polynomials_there(seed: int) -> None:
    """What the error bound of the certificate's polynomials rests on."""
    motion, rng = random_quintic(seed), np.random.default_rng(seed)
    k = rng.integers(0, motion.intervals, 12)
    h = np.diff(motion.times)[k]
    centre, half = rng.uniform(0.2, 0.8, 12) * h, 0.2 * h
    rho = rng.uniform(1.1, 20.0, (1, 12))
    A, B = half * (rho + 1.0 / rho) / 2.0, half * (rho - 1.0 / rho) / 2.0
    of_both = _norms(
        body_norms([MACHINE]), motion, k, centre, np.vstack([h, A]), np.vstack([0.0 * h, B]), 9.81
    )
    # row 0: sums of the absolute values of all terms, at the end of the interval
    powers = [h[:, None] ** i / factorial(i) for i in range(6)]
    derivatives = (motion.positions, motion.velocities, motion.accelerations)
    derivatives += (motion.jerks, motion.snaps, motion.crackles)
    for order, found in ((1, of_both.v), (2, of_both.a)):
        sums = sum(powers[i] * np.abs(term[k]) for i, term in enumerate(derivatives[order:]))
        np.testing.assert_allclose(found[:, :12], np.asarray(sums).T, rtol=1e-12)
    assert not of_both.imaginary[:, :12].any()
    norms = Norms(*(part[..., 12:] for part in of_both))
    terms = (
        motion.positions,
        motion.velocities,
        motion.accelerations,
        motion.jerks,
        motion.snaps,
        motion.crackles,
    )
    for angle in np.linspace(0.0, 2.0 * np.pi, 25):
        for size in (1.0, 0.6):
            z = centre + size * (A[0] * np.cos(angle) + 1j * B[0] * np.sin(angle))
            states = []
            for order in range(3):
                total, factor = 0.0, np.ones(12, dtype=complex)
                for i, term in enumerate(terms[order:]):
                    total = total + factor[:, None] * term[k]
                    factor = factor * z / (i + 1.0)
                states.append(total)
            assert (np.abs(states[0].imag.T) <= norms.imaginary + 1e-9).all()
            assert (np.abs(states[1].T) <= norms.v + 1e-9).all()
            assert (np.abs(states[2].T) <= norms.a + 1e-9).all()
