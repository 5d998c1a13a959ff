"""Seeded random problems in which base and arm move over a heightmap, or the plane below it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

import zmp_sqp as zs
from benchmarks.problems.scene import FOOTPRINT, Scene, Tree

__all__ = ["BASE_LIMITS", "random_drive_problem", "rolling_map", "unicycle_base"]

BASE_LIMITS = {
    "max_speed": 10.0,  # [m/s]
    "max_acceleration": 2.0,  # [m/s^2]
    "max_yaw_rate": 0.5,  # [rad/s]
    "max_yaw_acceleration": 1.0,  # [rad/s^2]
}
# height [m], length [m], direction [rad], phase [rad]; radius of curvature at least 50 m
WAVES = ((0.10, 18.0, 0.3, 0.5), (0.12, 25.0, 1.9, 2.0))
DRAWS = 300  # attempts at a problem that stands at both ends
# [rad] least and largest joint positions drawn
LOWEST, HIGHEST = np.array([-3.0, -1.2, -2.6, 0.0, -2.0]), np.array([3.0, 0.2, -1.2, 1.2, 0.5])


def unicycle_base(
    start: Any = (0.0, 0.0, 0.0), goal: Any = (0.0, 0.0, 0.0), **options: Any
) -> zs.UnicycleBase:
    """Base between two poses (x, y, yaw) with `BASE_LIMITS`, some of which options replace."""
    return zs.UnicycleBase(start=start, goal=goal, **(BASE_LIMITS | options))


def rolling_map(
    roll: float = -20.0,
    pitch: float = 0.0,
    *,
    waves: Any = WAVES,
    resolution: float = 1.0,
    low: Any = (-16.0, -14.0),
    high: Any = (10.0, 10.0),
) -> zs.Heightmap:
    """Heightmap of cosine waves on an inclined plane.

    Args:
        roll, pitch: Of the plane [deg].
        waves: Height [m], length [m], direction [rad] and phase [rad] of each wave.
        resolution: Distance of two points of the map [m].
        low, high: Corners (x, y) of the map [m].
    """
    x, y = (
        np.arange(start, stop + 0.5 * resolution, resolution)
        for start, stop in zip(low, high, strict=True)
    )
    normal = (
        pin.utils.rotate("y", np.deg2rad(pitch))
        @ pin.utils.rotate("x", np.deg2rad(roll))
        @ [0.0, 0.0, 1.0]
    )
    heights = -(normal[0] * x[None, :] + normal[1] * y[:, None]) / normal[2]
    for height, length, direction, phase in waves:
        along = np.cos(direction) * x[None, :] + np.sin(direction) * y[:, None]
        heights = heights + height * np.cos(2.0 * np.pi / length * along + phase)
    return zs.Heightmap(heights, resolution, low)


def random_drive_problem(seed: int, *, over_terrain: bool) -> zs.Problem:
    """Problem of base and arm from rest to rest, with a margin of 0.05 m.

    The base moves by up to 7 m on an arc of up to 1 rad. The ground leans by up to 20 degrees of
    roll and pitch.

    Args:
        seed: Of the problem.
        over_terrain: Two random waves lie on the plane; without them it is a `zs.Slope`.
    """
    rng = np.random.default_rng([4, seed])
    for _ in range(DRAWS):
        (roll, pitch), mass = rng.uniform(-20.0, 20.0, 2), rng.uniform(1500.0, 5500.0)
        waves = [
            (rng.uniform(0.0, 0.12), rng.uniform(16.0, 40.0), *rng.uniform(0.0, 6.3, 2))
            for _ in range(2)
        ]
        scene = Scene(
            "feller_buncher", FOOTPRINT, Tree(mass), roll=np.deg2rad(roll), pitch=np.deg2rad(pitch)
        )
        machine = scene.load()
        lower, upper = machine.limits.position_lower, machine.limits.position_upper
        start, goal = (np.clip(rng.uniform(LOWEST, HIGHEST), lower, upper) for _ in range(2))
        chord, turn, yaw = rng.uniform(-7.0, 7.0), rng.uniform(-1.0, 1.0), rng.uniform(-3.0, 3.0)
        end = (chord * np.cos(yaw + 0.5 * turn), chord * np.sin(yaw + 0.5 * turn), yaw + turn)
        ground: Any = scene.ground
        if over_terrain:
            ground = rolling_map(roll, pitch, waves=waves, low=(-18.0, -18.0), high=(18.0, 18.0))
        base = unicycle_base((0.0, 0.0, yaw), end)
        try:
            return zs.Problem(machine, start, goal, ground=ground, base=base, margin=0.05)
        except zs.ProblemError:  # tips over at rest at one end: draw again
            continue
    raise ValueError(f"no problem in {DRAWS} draws of seed {seed}")
