"""Problems with a base that drives, and a ZMP from the bodies' poses alone."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.interpolate import RectBivariateSpline

import zmp_sqp as zs
from tests.problems import FOOTPRINT, GRAVITY, PAPER_GOAL, PAPER_START, Scene, Tree, paper_scene

Array = np.ndarray
LIMITS = {
    "max_speed": 10.0,
    "max_acceleration": 2.0,
    "max_yaw_rate": 0.5,
    "max_yaw_acceleration": 1.0,
}
WAVES = ((0.10, 18.0, 0.3, 0.5), (0.12, 25.0, 1.9, 2.0))  # radius of curvature at least 50 m
CHORD = 6.0  # [m] the retreat backs off so far, on an arc of 1 rad


def base(
    start: Any = (0.0, 0.0, 0.0), goal: Any = (0.0, 0.0, 0.0), **options: Any
) -> zs.UnicycleBase:
    return zs.UnicycleBase(start=start, goal=goal, **(LIMITS | options))


def rolling_map(
    roll: float = -20.0,
    pitch: float = 0.0,
    *,
    waves: Any = WAVES,
    resolution: float = 1.0,
    low: Any = (-16.0, -14.0),
    high: Any = (10.0, 10.0),
) -> zs.Heightmap:
    """Waves (height [m], length [m], direction [rad], phase [rad]) on a plane that leans by roll and pitch [deg]."""
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


@cache
def terrain() -> tuple[Scene, zs.Plan]:
    """The retreat over rolling ground that leans as much."""
    scene = paper_scene(point_masses=False)
    return scene, zs.plan(replace(retreat_problem(scene), ground=rolling_map()))


@cache
def paper_2_joint() -> tuple[Scene, zs.Plan]:
    """Test 2 of Song & Sharf 2020 with base and arm planned together; it backs up 2 m."""
    scene = replace(paper_scene(), roll=np.deg2rad(-15.0), pitch=np.deg2rad(15.0))
    return scene, zs.plan(scene.problem(PAPER_START, PAPER_GOAL, base=base(goal=(-2.0, 0.0, 0.0))))


def retreat_problem(scene: Scene) -> zs.Problem:
    """Back off by 6 m on an arc with a turn of 1 rad while the arm swings by 180 degrees."""
    goal = (-CHORD * np.cos(0.5), -CHORD * np.sin(0.5), 1.0)
    return scene.problem(PAPER_START, PAPER_GOAL, base=base(goal=goal))


@cache
def retreat() -> tuple[Scene, zs.Plan]:
    """On a side slope of 20 degrees; rigid bodies."""
    scene = paper_scene(point_masses=False)
    return scene, zs.plan(retreat_problem(scene))


class Surface:
    """The ground of a scene, or a heightmap: root poses by SciPy's spline and angles, without the library."""

    def __init__(self, scene: Scene, ground: Any = None) -> None:
        self.tilt = pin.utils.rotate("y", scene.pitch) @ pin.utils.rotate("x", scene.roll)
        self.spline = None
        if isinstance(ground, zs.Heightmap):
            y, x = (
                start + ground.resolution * np.arange(n)
                for start, n in zip(ground.origin[::-1], ground.heights.shape, strict=True)
            )
            self.spline = RectBivariateSpline(x, y, ground.heights.T, kx=5, ky=5, s=0.0)

    def root(self, pose: Array) -> pin.SE3:
        x, y, yaw = pose
        if self.spline is None:
            return pin.SE3(
                self.tilt @ pin.utils.rotate("z", yaw), self.tilt @ np.array([x, y, 0.0])
            )
        p, r = self.spline.ev(x, y, dx=1), self.spline.ev(x, y, dy=1)
        lean = pin.utils.rotate("y", -np.arctan(p)) @ pin.utils.rotate(
            "x", np.arctan(r / np.hypot(1.0, p))
        )
        return pin.SE3(
            lean @ pin.utils.rotate("z", yaw), np.array([x, y, float(self.spline.ev(x, y))])
        )


def zmp_from_poses(
    scene: Scene, trajectory: zs.Trajectory, times: Array, *, step: float = 1e-3, ground: Any = None
) -> Array:
    """ZMP in the root frame from differences of the bodies' poses in the world, by the laws of Newton and Euler."""
    machine, surface = scene.load(), Surface(scene, ground)
    model, data = machine.model, machine.model.createData()
    bodies = range(1, model.njoints)

    shares = (-1.0, -0.5, 0.0, 0.5, 1.0)
    bases = [trajectory.base(times + share * step)[0] for share in shares]
    arms = [machine.configuration(trajectory(times + share * step)[0]) for share in shares]

    def poses(base: Array, q: Array) -> tuple[Any, list[pin.SE3]]:
        root = surface.root(base)
        q[:7] = pin.SE3ToXYZQUAT(root)
        pin.forwardKinematics(model, data, q)
        return root, [data.oMi[i].copy() for i in bodies]

    points = []
    for k in range(len(times)):
        (_, a), (_, ab), (root, b), (_, bc), (_, c) = (
            poses(p[k], q[k]) for p, q in zip(bases, arms, strict=True)
        )
        force, moment = np.zeros(3), np.zeros(3)
        for i, before, early, now, late, after in zip(bodies, a, ab, b, bc, c, strict=True):
            inertia = model.inertias[i]
            centres = [pose.act(inertia.lever) for pose in (before, now, after)]
            pull = (centres[2] - 2.0 * centres[1] + centres[0]) / step**2 + np.array(
                [0.0, 0.0, GRAVITY]
            )
            force += inertia.mass * pull
            moment += inertia.mass * np.cross(centres[1] - root.translation, pull)
            momenta = [
                middle.rotation
                @ inertia.inertia
                @ middle.rotation.T
                @ pin.log3(end.rotation @ first.rotation.T)
                / step
                for first, middle, end in ((before, early, now), (now, late, after))
            ]
            moment += (momenta[1] - momenta[0]) / step
        f, tau = root.rotation.T @ force, root.rotation.T @ moment
        points.append([-tau[1] / f[2], tau[0] / f[2]])
    return np.array(points)


DRAWS = 300  # of a random problem before one must stand at both ends
# [rad] of the joints
LOW, HIGH = np.array([-3.0, -1.2, -2.6, 0.0, -2.0]), np.array([3.0, 0.2, -1.2, 1.2, 0.5])


def random_drive_problem(seed: int, *, over_terrain: bool) -> zs.Problem:
    """Drive up to 7 m on an arc of up to 1 rad while the arm swings, on slopes to 20 degrees; rest to rest, 0.05 m."""
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
        start, goal = (np.clip(rng.uniform(LOW, HIGH), lower, upper) for _ in range(2))
        chord, turn, yaw = rng.uniform(-7.0, 7.0), rng.uniform(-1.0, 1.0), rng.uniform(-3.0, 3.0)
        end = (chord * np.cos(yaw + 0.5 * turn), chord * np.sin(yaw + 0.5 * turn), yaw + turn)
        ground: Any = scene.ground
        if over_terrain:
            ground = rolling_map(roll, pitch, waves=waves, low=(-18.0, -18.0), high=(18.0, 18.0))
        try:
            return zs.Problem(
                machine, start, goal, ground=ground, base=base((0.0, 0.0, yaw), end), margin=0.05
            )
        except zs.ProblemError:
            continue
    raise ValueError(f"no problem in {DRAWS} draws of seed {seed}")
