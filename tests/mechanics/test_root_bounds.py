"""Bounds on derivatives of the surface and on the base's turning, against differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import RectBivariateSpline

from zmp_sqp.mechanics.bounds.root_bounds import root_bounds
from zmp_sqp.mechanics.ground import Slope
from zmp_sqp.mechanics.terrain import spline_bounds
from zmp_sqp.mechanics.terrain.heightmap import Heightmap

ROUNDING = 1e-9
DIFFERENCES = 0.02  # of a third derivative
STEP = 2e-3  # [s]
SIDE = 16  # samples


def terrain(rng: np.random.Generator) -> Heightmap:
    resolution = rng.choice([0.5, 1.0, 2.0])
    x = resolution * np.arange(SIDE)
    heights = x[:, None] * rng.uniform(-0.4, 0.4)
    for direction in rng.uniform(0.0, 6.0, 3):
        along = np.cos(direction) * x[None, :] + np.sin(direction) * x[:, None]
        length = rng.uniform(6.0, 20.0) * resolution
        heights = heights + rng.uniform(0.0, 0.2) * resolution * np.cos(
            2.0 * np.pi / length * along
        )
    return Heightmap(heights, resolution)


def forms(terrain: Heightmap, places: np.ndarray) -> np.ndarray:
    """Derivatives of order 1 to 4 in 60 directions, by SciPy, shape (4, 60, K)."""
    x = terrain.resolution * np.arange(SIDE)
    oracle = RectBivariateSpline(x, x, terrain.heights.T, kx=5, ky=5, s=0.0)
    directions = np.linspace(0.0, np.pi, 60)
    norms = []
    for order in range(1, 5):
        total = 0.0
        for i in range(order + 1):
            choose = np.prod([(order - k) / (k + 1.0) for k in range(i)])
            part = choose * np.cos(directions) ** i * np.sin(directions) ** (order - i)
            total = total + part[:, None] * oracle.ev(*places.T, dx=i, dy=order - i)
        norms.append(total)
    return np.array(norms)


@pytest.mark.parametrize("seed", range(12))
def test_no_derivative_in_a_box_is_above_its_bound(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ground = terrain(rng)
    low = rng.uniform(0.0, ground.extent[1], (6, 2))
    high = np.minimum(low + rng.uniform(0.0, 3.0, (6, 2)) * ground.resolution, ground.extent[1])
    bounds = ground.derivative_bounds(low, high)
    for k in range(6):
        places = low[k] + rng.uniform(0.0, 1.0, (200, 2)) * (high[k] - low[k])
        found = forms(ground, places)
        assert (
            np.abs(found).max(axis=1) <= bounds[:4, k, None] * (1.0 + ROUNDING) + ROUNDING
        ).all()
        # of the fourth one, from place to place
        rise = np.abs(np.diff(found[3], axis=1)).max(axis=0)
        apart = np.linalg.norm(np.diff(places, axis=0), axis=1)
        assert (rise <= bounds[4, k] * apart * (1.0 + ROUNDING) + ROUNDING).all()


def test_bounds_are_close_where_the_box_is_small() -> None:
    ground = terrain(np.random.default_rng(1))
    middle = 0.5 * ground.extent[1][None] + 0.5 * ground.resolution
    found = ground.derivative_bounds(middle, middle)[:, 0]
    assert (found[:3] <= 3.0 * np.abs(forms(ground, middle)).max(axis=1)[:3, 0] + 0.05).all()


def test_many_large_boxes_are_bounded_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    ground = terrain(np.random.default_rng(2))
    low, high = np.zeros((3, 2)), ground.extent[1] * np.array([[0.2], [0.5], [1.0]])
    one_by_one = ground.derivative_bounds(low, high)
    monkeypatch.setattr(spline_bounds, "MOST_PAIRS", 10)
    together = ground.derivative_bounds(low, high)
    np.testing.assert_array_equal(together, np.repeat(one_by_one[:, 2:], 3, axis=1))


def test_a_plane_bends_nowhere() -> None:
    peaks = np.random.default_rng(0).uniform(0.0, 2.0, (2, 3, 4))
    assert not Slope(0.3, 0.1).derivative_bounds(np.zeros((4, 2)), np.ones((4, 2))).any()
    np.testing.assert_array_equal(root_bounds(peaks, np.zeros((5, 4)))[1, :3], peaks[1])
    np.testing.assert_array_equal(root_bounds(peaks), root_bounds(peaks, np.zeros((5, 4))))


@pytest.mark.parametrize("height", [0.0, 0.8])
@pytest.mark.parametrize("seed", range(25))
def test_no_motion_of_the_root_is_above_its_bound(seed: int, height: float) -> None:
    """Angular velocity and origin with their derivatives, by differences along a bumpy path."""
    rng = np.random.default_rng([3, seed])
    ground = terrain(rng)
    speed, yaw = (
        rng.uniform(-3.0, 3.0, 3),
        np.append(rng.uniform(-3.0, 3.0), rng.uniform(-1.0, 1.0, 3)),
    )
    if seed % 3 == 0:
        yaw[1:] = 0.0  # only the ground turns it

    def state(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rates = [
            speed[0] + speed[1] * t + speed[2] * t**2 / 2,
            yaw[1] + yaw[2] * t + yaw[3] * t**2 / 2,
        ]
        pushes = [speed[1] + speed[2] * t, yaw[2] + yaw[3] * t]
        turned = yaw[0] + yaw[1] * t + yaw[2] * t**2 / 2 + yaw[3] * t**3 / 6
        return turned, np.column_stack(rates), np.column_stack(pushes)

    def rate(t: float, place: np.ndarray) -> np.ndarray:
        turned, rates, _ = state(np.array([t]))
        return ground.ground_rates(np.append(place, turned)[None], rates).rates[0]

    start = 0.5 * ground.extent[1] + rng.uniform(-1.0, 1.0, 2) * ground.resolution
    times = STEP * np.arange(-3.0, 4.0)
    ways = [
        solve_ivp(rate, (0.0, span[-1]), start, t_eval=span, rtol=1e-12, atol=1e-13).y.T
        for span in (times[3::-1], times[3:])
    ]
    places = np.vstack([ways[0][:0:-1], ways[1]])
    turned, rates, pushes = state(times)
    pose = np.column_stack([places, turned])
    motion = ground.base_motion(pose, rates, pushes)
    positions, turns = ground.base_pose(pose)
    spin, push = (
        np.einsum("kij,kj->ki", turns, part[:, 3:])
        for part in (motion.velocity, motion.acceleration)
    )
    origin = positions - height * turns[:, :, 2]
    found = [
        np.linalg.norm(spin[3]),
        np.linalg.norm(push[3]),
        np.linalg.norm(push[4] - push[2]) / (2.0 * STEP),
        np.linalg.norm(push[4] - 2.0 * push[3] + push[2]) / STEP**2,
    ]
    drive = [
        np.linalg.norm(origin[4] - origin[2]) / (2.0 * STEP),
        np.linalg.norm(origin[4] - 2.0 * origin[3] + origin[2]) / STEP**2,
    ]
    peaks = (
        np.abs(np.stack([rates, pushes, np.repeat([[speed[2], yaw[3]]], 7, axis=0)]))
        .max(axis=1)
        .T[:, :, None]
    )
    bounds = root_bounds(
        peaks, ground.derivative_bounds(places.min(axis=0)[None], places.max(axis=0)[None]), height
    )
    assert (
        np.array(found)
        <= bounds[1, :, 0] * [1.0 + 1e-7, 1.0 + 1e-7, 1.001, 1.0 + DIFFERENCES] + 1e-7
    ).all()
    assert (np.array(drive) <= bounds[0, :2, 0] * 1.001 + 1e-4).all()
