"""Independent check of a plan whose base is at rest: ZMP, joint limits, boundary values, dynamics.

Nothing of the library takes part but the arrays of the trajectory. The ZMP comes from a Pinocchio
model that is built here from the numbers of a `Scene`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

import zmp_sqp as zs
from benchmarks.problems.scene import GRAVITY, Scene

__all__ = [
    "Feasibility",
    "Oracle",
    "check_feasibility",
    "joint_limit_excess",
]

Array = np.ndarray
INNER_SAMPLES = np.linspace(0.0, 1.0, 14)[1:-1]  # shares of every interval


class Oracle:
    """ZMP of a scene, computed without the library's mechanics.

    Its model differs from the library's. The root is a free flyer, the slope is in the direction of
    gravity, and with point masses the payload and the link that holds it stay two points.
    """

    def __init__(self, scene: Scene) -> None:
        model = pin.buildModelFromUrdf(str(scene.urdf), pin.JointModelFreeFlyer())
        tilt = pin.utils.rotate("y", scene.pitch) @ pin.utils.rotate("x", scene.roll)
        model.gravity = pin.Motion(tilt.T @ np.array([0.0, 0.0, -GRAVITY]), np.zeros(3))
        if scene.point_masses:
            # joint 1 is the free flyer, at rest, so the root's inertia does not matter
            for i in range(2, model.njoints):
                model.inertias[i] = pin.Inertia(
                    model.inertias[i].mass, model.inertias[i].lever, np.zeros((3, 3))
                )
        bodies = [(i, model.inertias[i]) for i in range(1, model.njoints)]
        # copies: a lever is a view of the model, which appending the payload changes
        self.points = [(i, body.mass, body.lever.copy()) for i, body in bodies]
        if scene.tree is not None:
            joint = model.getJointId(scene.tree.frame)  # joint and link have one name and frame
            inertia = np.zeros((3, 3)) if scene.point_masses else scene.tree.inertia
            body = pin.Inertia(scene.tree.mass, np.array(scene.tree.com), inertia)
            model.appendBodyToJoint(joint, body, pin.SE3.Identity())
            self.points.append((joint, scene.tree.mass, np.array(scene.tree.com)))
        self.model, self.data = model, model.createData()
        corners = np.array(scene.vertices)
        edges = np.roll(corners, -1, axis=0) - corners
        inward = (
            np.column_stack([-edges[:, 1], edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
        )
        self.inward, self.offsets = inward, np.einsum("ij,ij->i", inward, corners)

    def zmp(self, q: Array, v: Array, a: Array) -> Array:
        """ZMP on the plane z = 0 from inverse dynamics, shape (K, 2) [m].

        NaN where the ground would have to pull. Where there are two more coordinates than joints,
        the root drives ahead along its x axis, and the last two are its yaw and its path length.
        """
        joints = self.model.nv - 6
        points = []
        for one_q, one_v, one_a in zip(q, v, a, strict=True):
            root, rates, accelerations = np.zeros(7), np.zeros(6), np.zeros(6)
            root[6] = 1.0
            if len(one_q) > joints:
                yaw = one_q[-2]
                root[5:] = np.sin(0.5 * yaw), np.cos(0.5 * yaw)
                rates[[5, 0]], accelerations[[5, 0]] = one_v[-2:], one_a[-2:]  # spatial, root axes
            full = (
                np.concatenate([root, one_q[:joints]]),
                np.concatenate([rates, one_v[:joints]]),
                np.concatenate([accelerations, one_a[:joints]]),
            )
            _, _, fz, tx, ty, _ = pin.rnea(self.model, self.data, *full)[:6]
            points.append([-ty / fz, tx / fz] if fz > 0.0 else [np.nan, np.nan])
        return np.array(points)

    def zmp_by_differences(self, q: Array, v: Array, a: Array, *, step: float = 1e-4) -> Array:
        """ZMP of point masses by eq. (5) of Song & Sharf 2020, shape (2,) [m].

        The accelerations of the points are second differences of their positions: no inverse
        dynamics at all.
        """
        positions = []
        for t in (-step, 0.0, step):
            full = np.concatenate([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], q + t * v + 0.5 * t**2 * a])
            pin.forwardKinematics(self.model, self.data, full)
            positions.append(
                np.array([self.data.oMi[joint].act(lever) for joint, _, lever in self.points])
            )
        masses = np.array([mass for _, mass, _ in self.points])
        second_difference = (positions[2] - 2.0 * positions[1] + positions[0]) / step**2
        acceleration = second_difference - self.model.gravity.linear  # c'' - g
        x, y, z = positions[1].T
        moments = [
            masses @ (acceleration[:, 2] * x - acceleration[:, 0] * z),
            masses @ (acceleration[:, 2] * y - acceleration[:, 1] * z),
        ]
        return np.array(moments) / (masses @ acceleration[:, 2])

    def excess(self, q: Array, v: Array, a: Array) -> float:
        """Largest distance of the ZMP beyond an edge of the support polygon [m].

        Negative where it stays inside, infinite where the ground would have to pull.
        """
        over = self.offsets - self.zmp(q, v, a) @ self.inward.T
        return float(over.max()) if np.isfinite(over).all() else np.inf


@dataclass(frozen=True)
class Feasibility:
    """Largest violations of a motion; a good motion has none above rounding."""

    zmp_at_ends: float  # [m] ZMP at both ends of every interval (accelerations jump at nodes)
    zmp_between: float  # [m] ZMP on a fine grid within the intervals
    limits: float  # joint positions, rates and accelerations, for all times
    boundary: float  # positions and rates at start and goal
    dynamics: float  # nodes against the integral of the accelerations from the first node

    @property
    def violation(self) -> float:
        """The largest of them all."""
        return max(self.zmp_at_ends, self.zmp_between, self.limits, self.boundary, self.dynamics)


def check_feasibility(scene: Scene, problem: zs.Problem, trajectory: zs.Trajectory) -> Feasibility:
    """Violations of a motion, from the arrays of its trajectory."""
    v, a, j, h = (
        trajectory.velocities,
        trajectory.accelerations,
        trajectory.jerks,
        _steps(trajectory),
    )
    q, oracle = trajectory.positions, Oracle(scene)
    ends = oracle.excess(
        np.vstack([q[:-1], q[1:]]), np.vstack([v[:-1], v[1:]]), np.vstack([a, a + h * j])
    )
    between = max(oracle.excess(*_states(trajectory, share * h)) for share in INNER_SAMPLES)
    rates = v[0] + np.vstack([0.0 * v[:1], np.cumsum(h * (a + 0.5 * h * j), axis=0)])
    displacements = h * (rates[:-1] + h * (a / 2.0 + h * j / 6.0))
    positions = q[0] + np.vstack([0.0 * q[:1], np.cumsum(displacements, axis=0)])
    boundary = [
        q[0] - problem.start,
        q[-1] - problem.goal,
        v[0] - problem.start_velocity,
        v[-1] - problem.goal_velocity,
    ]
    return Feasibility(
        zmp_at_ends=ends + problem.margin,
        zmp_between=between + problem.margin,
        limits=joint_limit_excess(problem.machine.limits, trajectory),
        boundary=float(np.abs(boundary).max()),
        dynamics=float(max(np.abs(rates - v).max(), np.abs(positions - q).max())),
    )


def joint_limit_excess(limits: Any, trajectory: zs.Trajectory) -> float:
    """Largest excess over a joint limit at any time, not only at samples.

    Between nodes accelerations are linear in time, extreme at the ends of an interval. Rates are
    parabolas, extreme where the acceleration vanishes. Positions are cubics, extreme where the rate
    vanishes. The rate is monotone before and after its extreme; bisection finds its zero in each of
    the two parts.
    """
    q, v, a, j, h = (*_nodes(trajectory), _steps(trajectory))
    with np.errstate(divide="ignore", invalid="ignore"):
        turning = np.clip(np.nan_to_num(-a / j, nan=0.0, posinf=0.0, neginf=0.0), 0.0, h)
    positions, rates = [q, _states(trajectory, turning)[0]], [v, _states(trajectory, turning)[1]]
    for low, high in ((np.zeros_like(turning), turning), (turning, h + 0.0 * turning)):
        sign = np.sign(_states(trajectory, low)[1])  # of the rate, which is monotone from here
        for _ in range(60):
            middle = 0.5 * (low + high)
            same = np.sign(_states(trajectory, middle)[1]) == sign
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        positions += [_states(trajectory, low)[0], _states(trajectory, high)[0]]
    highest, lowest = (
        pick([pick(part, axis=0) for part in positions], axis=0) for pick in (np.max, np.min)
    )
    over = (
        np.max([np.abs(part).max(axis=0) for part in rates], axis=0) - limits.velocity,
        np.maximum(np.abs(a), np.abs(a + h * j)).max(axis=0) - limits.acceleration,
        highest - limits.position_upper,
        limits.position_lower - lowest,
    )
    return float(np.max(over))


def _nodes(trajectory: zs.Trajectory) -> tuple[Array, Array, Array, Array]:
    return trajectory.positions, trajectory.velocities, trajectory.accelerations, trajectory.jerks


def _steps(trajectory: zs.Trajectory) -> Array:
    return np.diff(trajectory.times)[:, None]


def _states(trajectory: zs.Trajectory, t: Array) -> tuple[Array, Array, Array]:
    """Position, rate, acceleration at times t after the start of each interval, shape (N, n).

    Times have shape (N, 1), or (N, n) with a time for each joint.
    """
    q, v, a, j = _nodes(trajectory)
    q, v = q[:-1], v[:-1]
    return q + t * (v + t * (a / 2.0 + t * j / 6.0)), v + t * (a + t * j / 2.0), a + t * j
