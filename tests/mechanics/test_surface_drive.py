from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from tests.mechanics.conftest import (
    MAP_ORIGIN,
    MAP_X,
    MAP_Y,
    RESOLUTION,
    random_drive,
    random_motion,
)
from zmp_sqp.mechanics.ground import GRAVITY, Ground, Slope
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.terrain.heightmap import Heightmap
from zmp_sqp.mechanics.wrench import ground_reaction
from zmp_sqp.mechanics.zero_moment_point import zmp

Array = np.ndarray
PLANE = 1e-9  # [m/s^2, rad/s^2, and so on]: rounding in the spline, amplified by differentiation
JACOBIAN = 1e-6  # relative to the largest entry: truncation of central differences
COUNT = 40


def plane(slope: Slope) -> Heightmap:
    """Heights of the plane through the origin that leans by the slope's roll and pitch."""
    normal = (
        pin.utils.rotate("y", slope.pitch) @ pin.utils.rotate("x", slope.roll) @ [0.0, 0.0, 1.0]
    )
    heights = -(normal[0] * MAP_X[None, :] + normal[1] * MAP_Y[:, None]) / normal[2]
    return Heightmap(heights, RESOLUTION, MAP_ORIGIN)


# --- a planar map is a slope -------------------------------------------------------------------


@pytest.mark.parametrize("slope", [Slope(), Slope(-0.35, 0.26), Slope(0.2, -0.4)])
def test_a_planar_heightmap_moves_the_base_as_the_slope_does(slope: Slope) -> None:
    pose, rates, accelerations = random_drive(COUNT, seed=3)
    there, here = (
        ground.base_motion(pose, rates, accelerations, 7.0) for ground in (slope, plane(slope))
    )
    for name in there.__dataclass_fields__:
        np.testing.assert_allclose(
            getattr(here, name), getattr(there, name), rtol=0.0, atol=PLANE, err_msg=name
        )


def test_a_planar_heightmap_gives_the_ground_reaction_of_the_slope(loaded: Machine) -> None:
    slope = Slope(-0.35, 0.26)
    pose, rates, accelerations = random_drive(COUNT, seed=3)
    q, v, a = random_motion(loaded, COUNT, seed=5)
    wrenches = []
    for ground in (slope, plane(slope)):
        motion = ground.base_motion(pose, rates, accelerations)
        root = {"root_velocity": motion.velocity, "root_acceleration": motion.acceleration}
        wrenches.append(ground_reaction(loaded, q, v, a, **root))
    np.testing.assert_allclose(
        wrenches[1], wrenches[0], rtol=PLANE, atol=PLANE * loaded.mass * GRAVITY
    )


def test_map_rates_on_a_plane_are_its_rates_seen_from_above() -> None:
    slope = Slope(-0.35, 0.26)
    pose, rates, _ = random_drive(COUNT, seed=3)
    lean = pin.utils.rotate("y", slope.pitch) @ pin.utils.rotate("x", slope.roll)
    expected = slope.ground_rates(pose, rates).rates @ lean[:2, :2].T
    np.testing.assert_allclose(plane(slope).ground_rates(pose, rates).rates, expected, atol=PLANE)


def test_a_planar_heightmap_turns_the_root_as_roll_pitch_and_yaw_do() -> None:
    slope = Slope(-0.35, 0.26)
    pose, _, _ = random_drive(COUNT, seed=3)
    lean = pin.utils.rotate("y", slope.pitch) @ pin.utils.rotate("x", slope.roll)
    _, rotations = plane(slope).base_pose(pose)
    np.testing.assert_allclose(rotations, lean @ slope.base_pose(pose)[1], atol=PLANE)


def test_a_machine_stands_on_the_tangent_plane(loaded: Machine, rolling: Heightmap) -> None:
    q, v, a = random_motion(loaded, 5, seed=2)
    at_origin = Heightmap(rolling.heights, RESOLUTION, (-10.0, -8.0))
    np.testing.assert_allclose(
        zmp(loaded, q, v, a, at_origin), zmp(loaded, q, v, a, at_origin.slope_at(0.0, 0.0))
    )
    pose, _, _ = random_drive(COUNT, seed=3)
    still = rolling.base_motion(pose, np.zeros((COUNT, 2)), np.zeros((COUNT, 2)))
    leans = np.array([-rolling.slope_at(x, y).gravity(yaw) for x, y, yaw in pose])
    np.testing.assert_allclose(still.acceleration[:, :3], leans, atol=PLANE)


# --- derivatives -------------------------------------------------------------------------------

GROUNDS = ["slope", "plane", "rolling"]


def ground_named(name: str, rolling: Heightmap) -> Ground:
    slope = Slope(-0.35, 0.26)
    return {"slope": slope, "plane": plane(slope), "rolling": rolling}[name]


def assert_jacobian(found: Array, function: Callable[[Array], Array], variables: Array) -> None:
    """Compare derivatives (K, m, n) with central differences by each column of (K, n)."""
    # of each row: angular ones are small beside gravity
    scale = np.maximum(np.abs(found).max(axis=(0, 2)), 0.1)
    for column in range(variables.shape[1]):
        step = np.zeros(variables.shape[1])
        step[column] = 1e-5
        difference = (function(variables + step) - function(variables - step)) / 2e-5
        np.testing.assert_allclose(
            found[:, :, column] / scale, difference / scale, rtol=0.0, atol=JACOBIAN
        )


@pytest.mark.parametrize("name", GROUNDS)
def test_derivatives_of_the_base_motion_are_those_of_differences(
    name: str, rolling: Heightmap
) -> None:
    ground = ground_named(name, rolling)
    pose, rates, accelerations = random_drive(COUNT, seed=3)
    scale = np.full((COUNT, 1), 7.0)  # S is one number for all states
    motion = ground.base_motion(pose, rates, accelerations, 7.0)
    variables = np.hstack([pose, rates, accelerations, scale])

    def at(values: Array) -> tuple[Array, Array]:
        moved = ground.base_motion(
            values[:, :3], values[:, 3:5], values[:, 5:7], float(values[0, 7])
        )
        return moved.velocity, moved.acceleration

    assert_jacobian(motion.velocity_jacobian, lambda values: at(values)[0], variables)
    assert_jacobian(motion.acceleration_jacobian, lambda values: at(values)[1], variables)


@pytest.mark.parametrize("name", GROUNDS)
def test_derivatives_of_the_ground_rates_are_those_of_differences(
    name: str, rolling: Heightmap
) -> None:
    ground = ground_named(name, rolling)
    pose, rates, _ = random_drive(COUNT, seed=3)
    jacobian = ground.ground_rates(pose, rates).jacobian
    variables = np.hstack([pose, rates])
    assert_jacobian(
        jacobian, lambda values: ground.ground_rates(values[:, :3], values[:, 3:]).rates, variables
    )


def test_time_scales_out_of_the_base_motion(rolling: Heightmap) -> None:
    pose, rates, accelerations = random_drive(COUNT, seed=3)
    T = 4.5  # [s]
    seconds = rolling.base_motion(pose, rates, accelerations)
    scaled = rolling.base_motion(pose, rates * T, accelerations * T**2, T**2)
    np.testing.assert_allclose(scaled.velocity, T * seconds.velocity, rtol=1e-12)
    np.testing.assert_allclose(scaled.acceleration, T**2 * seconds.acceleration, rtol=1e-12)


# --- motion along a path -----------------------------------------------------------------------

TICK = 1e-3  # [s] between the points of the differences


def drive(ground: Ground, start: Array, rates: Array, accelerations: Array, ticks: int) -> Array:
    """Pose (3,) after |ticks| Runge-Kutta steps with constant accelerations.

    Negative ticks go back in time.
    """
    pose, step = start.copy(), np.sign(ticks) * TICK

    def derivative(t: float, at: Array) -> Array:
        now = rates + accelerations * t
        return np.append(ground.ground_rates(at[None], now[None]).rates[0], now[1])

    for n in range(abs(ticks)):
        t = n * step
        k1 = derivative(t, pose)
        k2 = derivative(t + step / 2, pose + step / 2 * k1)
        k3 = derivative(t + step / 2, pose + step / 2 * k2)
        pose = pose + step / 6 * (k1 + 2 * k2 + 2 * k3 + derivative(t + step, pose + step * k3))
    return pose


def placements(ground: Ground, poses: list[Array]) -> list[pin.SE3]:
    positions, rotations = ground.base_pose(np.array(poses))
    return [
        pin.SE3(rotation, position) for position, rotation in zip(positions, rotations, strict=True)
    ]


@pytest.mark.parametrize("name", GROUNDS)
def test_twist_and_acceleration_are_those_of_the_moving_root(name: str, rolling: Heightmap) -> None:
    ground = ground_named(name, rolling)
    for pose, rates, accelerations in zip(*random_drive(6, seed=3), strict=True):
        poses = [drive(ground, pose, rates, accelerations, ticks) for ticks in (-2, -1, 0, 1, 2)]
        roots = placements(ground, poses)
        near = pin.log6(roots[1].actInv(roots[3])).vector / (2 * TICK)
        far = pin.log6(roots[0].actInv(roots[4])).vector / (4 * TICK)
        halves = [pin.log6(roots[2].actInv(roots[i])).vector for i in (1, 3)]
        motion = ground.base_motion(pose[None], rates[None], accelerations[None])
        np.testing.assert_allclose(motion.velocity[0], (4 * near - far) / 3, rtol=0.0, atol=1e-6)
        # log6(M^-1 M(t)) = v t + a t^2 / 2 + O(t^3): the twist's own bracket vanishes, so this is
        # d(v)/dt in the root
        wide = [pin.log6(roots[2].actInv(roots[i])).vector for i in (0, 4)]
        second = (16 * sum(halves) - sum(wide)) / (12 * TICK**2)
        still = ground.base_motion(
            pose[None], 0.0 * rates[None], 0.0 * accelerations[None]
        ).acceleration[0]
        np.testing.assert_allclose(motion.acceleration[0] - still, second, rtol=0.0, atol=1e-6)


def test_the_ground_reaction_is_what_changes_the_momentum(
    loaded: Machine, rolling: Heightmap
) -> None:
    model = loaded.model.copy()
    data = model.createData()
    q, v, a = random_motion(loaded, 1, seed=8)
    pose, rates, accelerations = (part[0] for part in random_drive(1, seed=9))
    motion = rolling.base_motion(pose[None], rates[None], accelerations[None])
    root = {"root_velocity": motion.velocity, "root_acceleration": motion.acceleration}
    wrench = ground_reaction(loaded, q, v, a, **root)[0]

    def momentum(t: int) -> tuple[Array, Array]:
        """Momentum about the world's origin in world axes, and centre of mass, from poses."""
        full = []
        for tick in (t - 1, t, t + 1):
            time = tick * TICK
            position, rotation = (
                part[0]
                for part in rolling.base_pose(
                    drive(rolling, pose, rates, accelerations, tick)[None]
                )
            )
            one = loaded.configuration(q + v * time + 0.5 * a * time**2)[0]
            one[:7] = pin.SE3ToXYZQUAT(pin.SE3(rotation, position))
            full.append(one)
        velocity = (
            0.5
            * (pin.difference(model, full[0], full[1]) + pin.difference(model, full[1], full[2]))
            / TICK
        )
        pin.computeCentroidalMomentum(model, data, full[1], velocity)
        hg = data.hg
        return np.append(hg.linear, hg.angular + np.cross(data.com[0], hg.linear)), data.com[
            0
        ].copy()

    (_, com), before, after = momentum(0), momentum(-1)[0], momentum(1)[0]
    change = (after - before) / (2 * TICK)
    weight = loaded.mass * np.array([0.0, 0.0, -GRAVITY])
    change[3:] -= np.cross(com, weight)
    change[:3] -= weight
    position, rotation = (part[0] for part in rolling.base_pose(pose[None]))
    force = rotation.T @ change[:3]
    moment = rotation.T @ (change[3:] - np.cross(position, change[:3]))
    np.testing.assert_allclose(
        wrench, np.append(force, moment), rtol=0.0, atol=1e-5 * loaded.mass * GRAVITY
    )


def test_the_root_above_its_tracks_swings_with_them(rolling: Heightmap) -> None:
    pose, rates, accelerations = random_drive(COUNT, seed=3)
    height = -0.4  # [m] the ground is below the root
    ground = rolling.base_motion(pose, rates, accelerations)
    root = ground.at_support_height(height)
    shift = pin.SE3(np.eye(3), np.array([0.0, 0.0, -height])).toActionMatrixInverse()
    for name in root.__dataclass_fields__:
        expected = np.einsum("ij,kj...->ki...", shift, getattr(ground, name))
        np.testing.assert_allclose(getattr(root, name), expected, atol=1e-12)
