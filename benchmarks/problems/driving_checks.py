"""The ZMP of a plan whose base drives, from nothing but the poses of its bodies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.interpolate import RectBivariateSpline

import zmp_sqp as zs
from benchmarks.problems.checks import joint_limit_excess
from benchmarks.problems.driving import DrivingProblem
from benchmarks.problems.scene import GRAVITY, Scene

__all__ = ["TOLERANCES", "Surface", "driving_violation", "zmp_from_poses"]

Array = np.ndarray
TOLERANCES = {  # largest violations of a solved problem, see `driving_violation`
    "zmp": 5e-3,  # [m] error of the finite differences
    "limits": 1e-9,  # [rad, rad/s, rad/s^2] rounding of closed forms
    "arrival": 1e-3,  # [m, rad] asked of the planner
}
SAMPLES = 400  # times at which the ZMP is computed


class Surface:
    """Pose of the root on a slope or a heightmap, computed without the library's terrain.

    SciPy interpolates the heights; roll and pitch of the root follow from the derivatives of the
    spline.
    """

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
        """Pose of the root in the world where the base is at (x, y, yaw)."""
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
    """ZMP from finite differences of the poses of the bodies, by the laws of Newton and Euler.

    The ground has to push with m (c'' - g) at the centre of mass c of each body, and with the rate
    of its angular momentum. Neither the library's inverse dynamics nor its kinematics of a moving
    base take part.

    Args:
        scene: Machine and slope.
        trajectory: With a base that drives.
        times: Shape (K,) [s], at least one step away from both ends.
        step: Of the differences [s].
        ground: A heightmap instead of the scene's slope.

    Returns:
        ZMP in the root frame, shape (K, 2) [m].
    """
    machine, surface = scene.load(), Surface(scene, ground)
    model, data = machine.model, machine.model.createData()
    below = np.array([0.0, 0.0, 0.0 if machine.support is None else machine.support.height])
    bodies = range(1, model.njoints)

    shares = (-1.0, -0.5, 0.0, 0.5, 1.0)
    bases = [trajectory.base(times + share * step)[0] for share in shares]
    arms = [machine.configuration(trajectory(times + share * step)[0]) for share in shares]

    def poses_of_bodies(base: Array, q: Array) -> tuple[Any, list[pin.SE3]]:
        root = surface.root(base)
        q[:7] = pin.SE3ToXYZQUAT(root * pin.SE3(np.eye(3), -below))  # tracks are on the ground
        pin.forwardKinematics(model, data, q)
        return root, [data.oMi[i].copy() for i in bodies]

    points = []
    for k in range(len(times)):
        found = [poses_of_bodies(p[k], q[k]) for p, q in zip(bases, arms, strict=True)]
        root = found[2][0]  # at the time itself
        force, moment = np.zeros(3), np.zeros(3)
        for i, poses in zip(bodies, zip(*(each for _, each in found), strict=True), strict=True):
            push, turning = _rates_of_momenta(model.inertias[i], poses, step)
            centre = poses[2].act(model.inertias[i].lever)
            force += push
            moment += np.cross(centre - root.translation, push) + turning
        f, tau = root.rotation.T @ force, root.rotation.T @ moment
        points.append([-tau[1] / f[2], tau[0] / f[2]])
    return np.array(points)


def _rates_of_momenta(
    inertia: pin.Inertia, poses: Sequence[pin.SE3], step: float
) -> tuple[Array, Array]:
    """m (c'' - g) of a body, and the rate of its angular momentum about c, in world axes.

    Args:
        inertia: Of the body.
        poses: Of the body, five, half a step apart.
        step: [s].
    """
    before, early, now, late, after = poses
    centres = [pose.act(inertia.lever) for pose in (before, now, after)]
    second_difference = (centres[2] - 2.0 * centres[1] + centres[0]) / step**2
    momenta = [  # half a step earlier and later
        middle.rotation
        @ inertia.inertia
        @ middle.rotation.T
        @ pin.log3(end.rotation @ first.rotation.T)
        / step
        for first, middle, end in ((before, early, now), (now, late, after))
    ]
    push = inertia.mass * (second_difference + np.array([0.0, 0.0, GRAVITY]))
    return push, (momenta[1] - momenta[0]) / step


def driving_violation(drawn: DrivingProblem, trajectory: zs.Trajectory) -> dict[str, float]:
    """Largest violations of a plan.

    Returns:
        `zmp`: distance of the ZMP beyond an edge of the footprint [m]. `limits`: excess over a
        joint limit [rad, rad/s, rad/s^2]. `arrival`: distance of base and arm from start and goal
        [m, rad]. Negative values are what is left.
    """
    problem = drawn.problem
    pad = 2e-3  # [s] the differences reach 1e-3 to either side of a time
    times = np.linspace(pad, trajectory.duration - pad, SAMPLES)
    at_node = np.abs(times[:, None] - trajectory.times).min(axis=1) < pad
    # at a node the acceleration may jump, and differences would mix both sides of the jump
    points = zmp_from_poses(drawn.scene, trajectory, times[~at_node])
    corners = np.array(drawn.scene.vertices)
    over = (np.abs(points) - corners.max(axis=0)).max()
    pose = trajectory.base(np.array([0.0, trajectory.duration]))[0]
    required = np.vstack([problem.base.start, problem.base.goal])
    ends = np.vstack([problem.start, problem.goal])
    arrival = max(np.abs(pose - required).max(), np.abs(trajectory.positions[[0, -1]] - ends).max())
    return {
        "zmp": float(over),
        "limits": joint_limit_excess(problem.machine.limits, trajectory),
        "arrival": float(arrival),
    }
