"""Phase-plane method and minimum time of one joint: closed forms and brute force."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq, linprog

import zmp_sqp as zs
from benchmarks.problems.arm import random_scene
from benchmarks.problems.checks import joint_limit_excess
from tests.problems import double_integrator_time
from zmp_sqp.motion.double_integrator import grid_minimum_time, grid_profile, minimum_time

EXACT = 1e-9
ROUNDING = 1e-12
SEEDS = range(20)


# --- one joint in continuous time ---------------------------------------------------------------


def motion(found: object, distance: float, v0: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and rates at the switching times, by integration of the phases."""
    q, v = [0.0], [v0]
    for duration, a in zip(
        found.phases, (found.acceleration, 0.0, -found.acceleration), strict=True
    ):
        q.append(q[-1] + duration * v[-1] + 0.5 * duration**2 * a)
        v.append(v[-1] + duration * a)
    return np.array(q), np.array(v)


@pytest.mark.parametrize("seed", SEEDS)
def test_minimum_time_is_a_motion_that_arrives_within_the_limits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    v_max, a_max = rng.uniform(0.2, 2.0, 2)
    v0, v1 = rng.uniform(-v_max, v_max, 2)
    distance = rng.normal(0.0, 2.0)
    found = minimum_time(
        distance, max_velocity=v_max, max_acceleration=a_max, start_velocity=v0, goal_velocity=v1
    )
    q, v = motion(found, distance, v0)
    assert min(found.phases) >= -ROUNDING
    assert q[-1] == pytest.approx(distance, abs=EXACT)
    assert v[-1] == pytest.approx(v1, abs=EXACT)
    assert np.abs(v).max() <= v_max + EXACT


@pytest.mark.parametrize("seed", SEEDS)
def test_no_sampled_control_is_faster_than_minimum_time(seed: int) -> None:
    """Lower bound by brute force: the least time in which an LP on a fine grid arrives."""
    rng = np.random.default_rng([1, seed])
    v_max, a_max = rng.uniform(0.3, 1.5, 2)
    v0, v1 = rng.uniform(-v_max, v_max, 2)
    distance = rng.normal(0.0, 1.5)
    found = minimum_time(
        distance, max_velocity=v_max, max_acceleration=a_max, start_velocity=v0, goal_velocity=v1
    )
    N = 150
    if found.duration > 1e-3:
        assert reach(0.97 * found.duration, N, distance, v_max, a_max, v0, v1) > 1e-6
        assert reach(1.03 * found.duration, N, distance, v_max, a_max, v0, v1) <= 1e-9


def reach(
    T: float, N: int, distance: float, v_max: float, a_max: float, v0: float, v1: float
) -> float:
    """Least distance from the goal state after N steps of T / N, by a linear program."""
    h = T / N
    rates = h * np.tril(np.ones((N, N)))  # node rates 1..N
    place = h**2 * (N - np.arange(N) - 0.5)
    goal = np.vstack([place, rates[-1]])
    target = np.array([distance - v0 * T, v1 - v0])
    slack = -np.ones((2, 1))
    A = np.vstack(
        [
            np.hstack([goal, slack]),
            np.hstack([-goal, slack]),
            *(np.hstack([s * rates, np.zeros((N, 1))]) for s in (1, -1)),
        ]
    )
    b = np.concatenate([target, -target, np.full(N, v_max - v0), np.full(N, v_max + v0)])
    found = linprog(np.eye(N + 1)[-1], A_ub=A, b_ub=b, bounds=[(-a_max, a_max)] * N + [(0.0, None)])
    return float(found.fun)


@pytest.mark.parametrize("distance", [0.0, 1e-12, 1e-3, 0.4, 0.5, 0.6, 7.0, 1e6, -3.0])
def test_rest_to_rest_is_the_closed_form(distance: float) -> None:
    found = minimum_time(distance, max_velocity=1.0, max_acceleration=2.0)
    expected = double_integrator_time(abs(distance), max_velocity=1.0, max_acceleration=2.0)
    assert found.duration == pytest.approx(expected, rel=ROUNDING, abs=1e-15)


# --- one joint on a grid ------------------------------------------------------------------------


def farthest(T: float, N: int, v_max: float, a_max: float) -> float:
    """How far a joint gets from rest to rest in N equal steps: brute force over its node rates."""
    h = T / N
    m = np.minimum(np.arange(N + 1), N - np.arange(N + 1))
    rates = np.minimum(a_max * h * m, v_max)
    return float(h * 0.5 * (rates[1:] + rates[:-1]).sum())


@pytest.mark.parametrize("N", [2, 3, 4, 5, 10, 49, 50, 101])
@pytest.mark.parametrize("distance", [1e-6, 0.1, 0.5, 0.51, 2.0, 30.0, 1e4])
def test_grid_minimum_time_is_the_root_that_bisection_finds(N: int, distance: float) -> None:
    v_max, a_max = 0.8, 1.7
    found = grid_minimum_time(
        np.array([distance]),
        max_velocity=np.array([v_max]),
        max_acceleration=np.array([a_max]),
        intervals=N,
    )
    high = 4.0 * double_integrator_time(distance, max_velocity=v_max, max_acceleration=a_max) + 1.0
    root = brentq(
        lambda T: farthest(T, N, v_max, a_max) - distance, 0.0, high, xtol=1e-14, rtol=1e-14
    )
    assert found == pytest.approx(root, rel=1e-10)
    assert found >= double_integrator_time(distance, max_velocity=v_max, max_acceleration=a_max) * (
        1.0 - ROUNDING
    )


@pytest.mark.parametrize("N", [2, 5, 20])
def test_no_linear_program_beats_the_grids_minimum_time(N: int) -> None:
    for distance in (0.05, 0.7, 3.0):
        T = grid_minimum_time(
            np.array([distance]),
            max_velocity=np.array([0.8]),
            max_acceleration=np.array([1.7]),
            intervals=N,
        )
        assert reach(T * (1.0 + 1e-6), N, distance, 0.8, 1.7, 0.0, 0.0) <= 1e-9
        assert reach(T * (1.0 - 1e-4), N, distance, 0.8, 1.7, 0.0, 0.0) > 1e-8


def test_the_slowest_joint_decides_on_the_grid() -> None:
    distance, v, a = (
        np.array([0.1, -2.0, 0.0, 0.7]),
        np.array([0.5, 0.9, 1.0, 0.2]),
        np.array([1.0, 0.6, 1.0, 3.0]),
    )
    alone = [
        grid_minimum_time(
            distance[i : i + 1],
            max_velocity=v[i : i + 1],
            max_acceleration=a[i : i + 1],
            intervals=20,
        )
        for i in range(4)
    ]
    assert grid_minimum_time(
        distance, max_velocity=v, max_acceleration=a, intervals=20
    ) == pytest.approx(max(alone))


@pytest.mark.parametrize("seed", SEEDS)
def test_grid_profile_arrives_within_the_limits(seed: int) -> None:
    rng = np.random.default_rng([2, seed])
    N, n = int(rng.integers(2, 60)), 5
    distance = rng.normal(0.0, 1.0, n) * 10.0 ** rng.uniform(-4.0, 2.0, n)
    distance[0] = 0.0
    v, a = rng.uniform(0.3, 2.0, (2, n))
    least = grid_minimum_time(distance, max_velocity=v, max_acceleration=a, intervals=N)
    for duration in (least, 1.2 * least, 5.0 * least):
        found = grid_profile(distance, duration, max_velocity=v, max_acceleration=a, intervals=N)
        h = duration / N
        rates = h * np.vstack([np.zeros(n), np.cumsum(found, axis=0)])
        places = h * 0.5 * (rates[1:] + rates[:-1]).sum(axis=0)
        np.testing.assert_allclose(
            places, distance, rtol=EXACT, atol=EXACT * np.abs(distance).max()
        )
        np.testing.assert_allclose(rates[-1], 0.0, atol=EXACT)
        assert (np.abs(found) <= a * (1.0 + EXACT)).all()
        assert (np.abs(rates) <= v * (1.0 + EXACT)).all()


# --- phase plane --------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_phase_plane_is_synchronised_within_the_limits_and_as_fast_as_its_slowest_joint(
    seed: int,
) -> None:
    scene, (start, goal) = random_scene(seed)
    machine = scene.load()
    found = zs.phase_plane(machine, start, goal)
    limits = machine.limits
    closed_form = max(
        double_integrator_time(abs(d), max_velocity=v, max_acceleration=a)
        for d, v, a in zip(goal - start, limits.velocity, limits.acceleration, strict=True)
    )
    assert found.duration == pytest.approx(closed_form, rel=ROUNDING)
    assert joint_limit_excess(limits, found) <= EXACT
    np.testing.assert_allclose(found.positions[[0, -1]], [start, goal], atol=EXACT)
    np.testing.assert_allclose(found.velocities[[0, -1]], 0.0, atol=EXACT)
    moving = np.abs(goal - start) > 0.0
    # nobody waits: all set off and arrive together
    assert (np.abs(found.velocities[1:-1][:, moving]) > 0.0).all()


def test_phase_plane_from_a_pose_to_itself_takes_no_time() -> None:
    machine = zs.load_machine("feller_buncher")
    pose = np.array([0.1, -0.5, -2.0, 0.5, -1.5])
    found = zs.phase_plane(machine, pose, pose)
    assert found.duration == 0.0
    np.testing.assert_array_equal(found(0.0)[0], pose)


def test_phase_plane_moves_one_joint_alone() -> None:
    machine = zs.load_machine("feller_buncher")
    start = np.array([0.1, -0.5, -2.0, 0.5, -1.5])
    found = zs.phase_plane(machine, start, start + 0.3 * np.eye(5)[2])
    t = np.linspace(0.0, found.duration, 50)
    np.testing.assert_array_equal(
        found(t)[0][:, [0, 1, 3, 4]], np.tile(start[[0, 1, 3, 4]], (50, 1))
    )


@pytest.mark.parametrize("distance", [1e-12, 1e-9, 1e-6, 1e-3])
def test_phase_plane_of_a_tiny_displacement(distance: float) -> None:
    machine = zs.load_machine("feller_buncher")
    start = np.array([0.1, -0.5, -2.0, 0.5, -1.5])
    found = zs.phase_plane(machine, start, start + distance * np.array([1.0, -0.5, 0.1, 0.0, 1e-3]))
    assert joint_limit_excess(machine.limits, found) <= EXACT
    np.testing.assert_allclose(
        found.positions[-1] - start, distance * np.array([1.0, -0.5, 0.1, 0.0, 1e-3]), atol=1e-15
    )
