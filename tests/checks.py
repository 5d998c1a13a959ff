"""Checkers that do not use what they check: Jacobians by central differences, feasibility by a model of their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

import zmp_sqp as zs
from tests.problems import GRAVITY, Scene

__all__ = [
    "Feasibility",
    "Oracle",
    "central_differences",
    "check_feasibility",
    "joint_limit_excess",
]

Array = np.ndarray
INNER_SAMPLES = np.linspace(0.0, 1.0, 14)[1:-1]  # of every interval


def central_differences(
    function: Callable[[Array], Array], x: Array, *, step: float = 1e-6
) -> Array:
    """Jacobian of a vector function, shape (m, n); its error is of second order in the step."""
    columns = []
    for i in range(len(x)):
        ahead, behind = x.copy(), x.copy()
        ahead[i] += step
        behind[i] -= step
        columns.append((function(ahead) - function(behind)) / (ahead[i] - behind[i]))
    return np.column_stack(columns)


class Oracle:
    """Ground reaction and ZMP of a scene from its URDF and bare numbers, without the library's mechanics.

    The model stands on a free-flyer root and gravity is a field of the model; tree and link stay
    two points when masses are points. `zmp_by_differences` does not even need inverse dynamics.
    """

    def __init__(self, scene: Scene) -> None:
        model = pin.buildModelFromUrdf(str(scene.urdf), pin.JointModelFreeFlyer())
        tilt = pin.utils.rotate("y", scene.pitch) @ pin.utils.rotate("x", scene.roll)
        model.gravity = pin.Motion(tilt.T @ np.array([0.0, 0.0, -GRAVITY]), np.zeros(3))
        if scene.point_masses:
            # what is fixed to the root stands still: its inertia does not matter
            for i in range(2, model.njoints):
                model.inertias[i] = pin.Inertia(
                    model.inertias[i].mass, model.inertias[i].lever, np.zeros((3, 3))
                )
        bodies = [(i, model.inertias[i]) for i in range(1, model.njoints)]
        # a lever is a view, and the tree comes
        self.points = [(i, body.mass, body.lever.copy()) for i, body in bodies]
        if scene.tree is not None:
            joint = model.getJointId(scene.tree.frame)  # link and joint share their name and frame
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
        """ZMP on the plane z = 0, shape (K, 2), from inverse dynamics; NaN where the ground would have to pull."""
        root, zero = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), np.zeros(6)
        points = []
        for one_q, one_v, one_a in zip(q, v, a, strict=True):
            full = [
                np.concatenate(parts) for parts in ((root, one_q), (zero, one_v), (zero, one_a))
            ]
            _, _, fz, tx, ty, _ = pin.rnea(self.model, self.data, *full)[:6]
            points.append([-ty / fz, tx / fz] if fz > 0.0 else [np.nan, np.nan])
        return np.array(points)

    def zmp_by_differences(self, q: Array, v: Array, a: Array, *, step: float = 1e-4) -> Array:
        """Eq. (5) of Song & Sharf 2020 for point masses, shape (2,); accelerations are second differences."""
        places = []
        for t in (-step, 0.0, step):
            full = np.concatenate([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], q + t * v + 0.5 * t**2 * a])
            pin.forwardKinematics(self.model, self.data, full)
            places.append(
                np.array([self.data.oMi[joint].act(lever) for joint, _, lever in self.points])
            )
        masses = np.array([mass for _, mass, _ in self.points])
        pull = (places[2] - 2.0 * places[1] + places[0]) / step**2 - self.model.gravity.linear
        x, y, z = places[1].T
        moments = [
            masses @ (pull[:, 2] * x - pull[:, 0] * z),
            masses @ (pull[:, 2] * y - pull[:, 1] * z),
        ]
        return np.array(moments) / (masses @ pull[:, 2])

    def excess(self, q: Array, v: Array, a: Array) -> float:
        """Farthest that the ZMP stands outside any edge [m]; negative inside, infinite where contact is lost."""
        over = self.offsets - self.zmp(q, v, a) @ self.inward.T
        return float(over.max()) if np.isfinite(over).all() else np.inf


@dataclass(frozen=True)
class Feasibility:
    """What was found about a motion; every entry is a violation, not positive (or rounding) for a good motion."""

    # [m] at both ends of every interval, each with the interval's own acceleration
    zmp_at_ends: float
    zmp_between: float  # [m] on a fine grid within the intervals
    limits: float  # positions, rates, accelerations, at all times in closed form
    boundary: float  # start and goal, positions and rates
    dynamics: float  # nodes against double integration from the first node

    @property
    def violation(self) -> float:
        """The largest of all."""
        return max(self.zmp_at_ends, self.zmp_between, self.limits, self.boundary, self.dynamics)


def check_feasibility(scene: Scene, problem: zs.Problem, trajectory: zs.Trajectory) -> Feasibility:
    """Check a motion against its problem from the trajectory's bare arrays."""
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
    moves = h * (rates[:-1] + h * (a / 2.0 + h * j / 6.0))
    places = q[0] + np.vstack([0.0 * q[:1], np.cumsum(moves, axis=0)])
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
        dynamics=float(max(np.abs(rates - v).max(), np.abs(places - q).max())),
    )


def joint_limit_excess(limits: Any, trajectory: zs.Trajectory) -> float:
    """Largest excess over any joint limit at any time, in closed form.

    Accelerations are linear between nodes, so they are extreme at the interval ends; rates are
    parabolas, extreme where the acceleration vanishes; positions are cubics, extreme where the rate
    vanishes: a root on either side of that place, by bisection, which needs no formula for roots.
    """
    q, v, a, j, h = (*_nodes(trajectory), _steps(trajectory))
    with np.errstate(divide="ignore", invalid="ignore"):
        turning = np.clip(np.nan_to_num(-a / j, nan=0.0, posinf=0.0, neginf=0.0), 0.0, h)
    places, rates = [q, _states(trajectory, turning)[0]], [v, _states(trajectory, turning)[1]]
    for low, high in ((np.zeros_like(turning), turning), (turning, h + 0.0 * turning)):
        start = np.sign(_states(trajectory, low)[1])  # the rate is monotone from low to high
        for _ in range(60):
            middle = 0.5 * (low + high)
            same = np.sign(_states(trajectory, middle)[1]) == start
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        places += [_states(trajectory, low)[0], _states(trajectory, high)[0]]
    highest, lowest = (
        pick([pick(part, axis=0) for part in places], axis=0) for pick in (np.max, np.min)
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
    """State at times t after the start of every interval, shape (N, 1) or (N, n), with that interval's acceleration."""
    q, v, a, j = _nodes(trajectory)
    q, v = q[:-1], v[:-1]
    return q + t * (v + t * (a / 2.0 + t * j / 6.0)), v + t * (a + t * j / 2.0), a + t * j
