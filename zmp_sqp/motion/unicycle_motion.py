"""Where the base is at all times: speed and yaw rate are polynomials, the position is their quadrature."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, Indices, frozen_array, shortened
from zmp_sqp.errors import TrajectoryError
from zmp_sqp.mechanics.ground import Slope, Terrain
from zmp_sqp.motion.base_path import GAUSS_NODES, PositionCurve

__all__ = ["BASE_COLUMNS", "PLANE", "UnicycleMotion"]

BASE_COLUMNS = (
    "base.x",
    "base.y",
    "base.yaw",
    "base.speed",
    "base.yaw_rate",
    "base.acceleration",
    "base.yaw_acceleration",
    "base.jerk",
    "base.yaw_jerk",
)
# [m, rad, per second] how far a file's nodes may be from what its accelerations give
CONSISTENCY = 1e-6
PLANE = Slope()
PLANAR = " in a plane; if it drove over a heightmap, give that as its ground"
LONGEST_PIECE = 0.1  # [s] of a piece of path over uneven ground that is one polynomial
LARGEST_TURN = (
    0.1  # [rad] of yaw likewise: how well the path is known goes with the cube of the turn
)
MOST_PIECES = 20_000  # however long the motion is


@dataclass(frozen=True, slots=True, eq=False)
class UnicycleMotion:
    r"""Unicycle over nodes t_0 = 0 < ... < t_N, its accelerations linear within the intervals.

    .. math:: p(t) = p_k + \int_{t_k}^{t} s\, B(p) (\cos\psi, \sin\psi)\, dt

    from the node before (`PositionCurve`); speed s and yaw psi are exact polynomials, and B is what
    the ground makes of a heading (`Terrain.ground_rates`; in a plane the identity).

    Attributes:
        times: Nodes, shape (N+1,) [s].
        poses: x, y, yaw at the nodes, in the ground's coordinates, shape (N+1, 3) [m, m, rad].
        velocities: Speed along the heading and yaw rate at the nodes, shape (N+1, 2) [m/s, rad/s].
        accelerations: At the starts of the intervals, shape (N, 2) [m/s^2, rad/s^2].
        jerks: On the intervals, shape (N, 2) [m/s^3, rad/s^3].
        ground: What it drives on; the same for all planes.

    Raises:
        TrajectoryError: Shapes differ, entries are not finite, or poses and velocities do not
            follow from the accelerations.
        ProblemError: It leaves the map.
    """

    times: Array
    poses: Array
    velocities: Array
    accelerations: Array
    jerks: Array
    ground: Terrain = PLANE
    _path: PositionCurve = field(init=False, repr=False)

    def __post_init__(self) -> None:
        count = len(self.times)
        if count < 2:
            raise TrajectoryError(f"a base motion needs at least 2 nodes, not {count}")
        shapes = {
            "poses": (count, 3),
            "velocities": (count, 2),
            "accelerations": (count - 1, 2),
            "jerks": (count - 1, 2),
        }
        times = frozen_array(self.times, name="base times", shape=(count,), error=TrajectoryError)
        object.__setattr__(self, "times", times)
        for name, shape in shapes.items():
            array = frozen_array(
                getattr(self, name), name=f"base {name}", shape=shape, error=TrajectoryError
            )
            object.__setattr__(self, name, array)
        motion = self.poses[:-1], self.velocities[:-1], self.accelerations, self.jerks
        path, places = _curve(*motion, np.diff(times), self.ground, chained=False)
        self.ground.check_on(places.reshape(-1, 2))
        object.__setattr__(self, "_path", path)
        pose, velocity, _ = self.state_in(np.arange(count - 1), np.diff(times))
        gap = np.hstack([self.poses[1:] - pose, self.velocities[1:] - velocity])
        worst = np.unravel_index(np.argmax(np.abs(gap)), gap.shape)
        if abs(gap[worst]) > CONSISTENCY:
            name = BASE_COLUMNS[int(worst[1])]
            raise TrajectoryError(
                f"{name} does not follow from the accelerations: node {int(worst[0]) + 1} is off by {gap[worst]:.3g}"
                f"{PLANAR if self.ground.uniform and worst[1] < 2 else ''}"
            )

    @classmethod
    def from_start(
        cls,
        times: Array,
        start: Array,
        velocities: Array,
        yaw: Array,
        pushes: tuple[Array, Array],
        ground: Terrain = PLANE,
    ) -> UnicycleMotion:
        """Motion from a pose (3,) on, from speeds (N+1, 2), yaws (N+1,), and accelerations with jerks (N, 2) each.

        Raises:
            TrajectoryError: As for the class.
            ProblemError: It leaves the map; the message says where.
        """
        poses = np.column_stack([np.zeros((len(times), 2)), yaw])
        poses[:, :2] = start[:2]
        curve, _ = _curve(
            poses[:-1], velocities[:-1], *pushes, np.diff(times), ground, chained=True
        )
        k = np.arange(len(times) - 1)
        poses[1:, :2] += np.cumsum(curve.displacement(k, np.diff(times)), axis=0)
        return cls(times, poses, velocities, *pushes, ground)

    @property
    def pieces(self) -> Indices:
        """How many polynomials make the path in each interval, shape (N,)."""
        return self._path.pieces

    def on(self, ground: Terrain) -> UnicycleMotion:
        """The same motion on other ground.

        Raises:
            TrajectoryError: The places at the nodes do not follow there.
            ProblemError: It leaves the map.
        """
        return self if ground is self.ground else replace(self, ground=ground)

    def state_in(self, k: Indices, since: Array) -> tuple[Array, Array, Array]:
        """Pose (K, 3), velocity (K, 2), acceleration (K, 2) in intervals k at times `since` after their starts [s]."""
        place = self.poses[k, :2] + self._path.displacement(k, since)
        since = since[:, None]
        yaw = _yaw(self.poses[k], self.velocities[k], self.accelerations[k], self.jerks[k], since)
        return np.hstack([place, yaw]), *self._rates_in(k, since)

    def __call__(self, t: Any) -> tuple[Array, Array, Array]:
        """Pose (x, y, yaw), velocity (speed, yaw rate), acceleration at any time.

        Args:
            t: Scalar or shape (K,) [s], within [0, duration].

        Returns:
            Shapes (3,), (2,), (2,) for a scalar; (K, 3), (K, 2), (K, 2) for an array.

        Raises:
            TrajectoryError: A time outside the motion or not finite.
        """
        when = frozen_array(np.atleast_1d(t), name="t", shape=(None,), error=TrajectoryError)
        last = float(self.times[-1])
        slack = 1e-12 * max(1.0, last)
        for outside in when[(when < -slack) | (when > last + slack)]:
            raise TrajectoryError(
                f"t = {outside:.6g} s is outside the motion, which lasts {last:.6g} s"
            )
        k = np.clip(
            np.searchsorted(self.times, when, side="right") - 1, 0, len(self.accelerations) - 1
        )
        pose, velocity, acceleration = self.state_in(k, np.clip(when, 0.0, last) - self.times[k])
        return (
            (pose[0], velocity[0], acceleration[0])
            if np.shape(t) == ()
            else (pose, velocity, acceleration)
        )

    def peaks(self, k: Indices, since: Array, length: Array) -> Array:
        """Largest |speed|, |acceleration|, |jerk|, then of the yaw rate, over stretches of intervals, shape (2, 3, K).

        Rates are parabolas: between two times they exceed their ends by at most an eighth of jerk
            times length squared.
        """
        ends = [self._rates_in(k, at[:, None]) for at in (since, since + length)]
        velocity, push = (
            np.maximum(np.abs(one), np.abs(other)) for one, other in zip(*ends, strict=True)
        )
        jerk = np.abs(self.jerks[k])
        return np.stack([velocity + 0.125 * length[:, None] ** 2 * jerk, push, jerk]).transpose(
            2, 0, 1
        )

    def _rates_in(self, k: Indices, since: Array) -> tuple[Array, Array]:
        a, j = self.accelerations[k], self.jerks[k]
        return self.velocities[k] + since * a + 0.5 * since**2 * j, a + since * j

    def table(self) -> Array:
        """One row per node in the order of `BASE_COLUMNS`; the last row holds the final acceleration."""
        h = np.diff(self.times)[:, None]
        final = (self.accelerations + h * self.jerks)[-1:]
        pushes = np.vstack([self.accelerations, final]), np.vstack([self.jerks, self.jerks[-1:]])
        return np.column_stack([self.poses, self.velocities, *pushes])

    @classmethod
    def from_table(cls, times: Array, table: Array, ground: Terrain = PLANE) -> UnicycleMotion:
        """The inverse of `table`."""
        return cls(times, table[:, :3], table[:, 3:5], table[:-1, 5:7], table[:-1, 7:9], ground)


def _yaw(pose: Array, velocity: Array, a: Array, j: Array, since: Array) -> Array:
    """Yaw at times (K, s) after the starts of K intervals."""
    return np.asarray(
        pose[:, 2:]
        + since * velocity[:, 1:]
        + 0.5 * since**2 * a[:, 1:]
        + since**3 * j[:, 1:] / 6.0
    )


def _curve(
    pose: Array,
    velocity: Array,
    a: Array,
    j: Array,
    steps: Array,
    ground: Terrain,
    *,
    chained: bool,
) -> tuple[PositionCurve, Array]:
    """Path of N intervals, and its places at Gauss points; off the map as at its rim."""
    if not isinstance(ground, Terrain) or isinstance(ground, type):
        raise TrajectoryError(
            f"a base drives on a Slope or a Heightmap, not on {shortened(ground)}"
        )
    parts = np.ones(len(steps), dtype=int)
    if not ground.uniform:
        turn = steps * (
            np.abs(velocity[:, 1]) + steps * (np.abs(a[:, 1]) + 0.5 * steps * np.abs(j[:, 1]))
        )
        wanted = np.maximum(steps / LONGEST_PIECE, turn / LARGEST_TURN)
        parts = (
            np.ceil(wanted * (MOST_PIECES / max(float(wanted.sum()), MOST_PIECES)))
            .astype(int)
            .clip(1)
        )
    number = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    t = np.repeat(steps / parts, parts)[:, None] * (
        number[:, None] + GAUSS_NODES
    )  # (pieces, points)
    pose, velocity, a, j, places = (
        *(np.repeat(part, parts, axis=0) for part in (pose, velocity, a, j)),
        pose[:, :2],
    )
    yaw = _yaw(pose, velocity, a, j, t).ravel()
    rates = np.zeros((yaw.size, 2))
    rates[:, 0] = (velocity[:, :1] + t * a[:, :1] + 0.5 * t**2 * j[:, :1]).ravel()
    low, high = ground.extent

    def to_rates(places: Array) -> Array:
        poses = np.column_stack([np.clip(places.reshape(-1, 2), low, high), yaw])
        return ground.ground_rates(poses, rates).rates.reshape(places.shape)

    return PositionCurve.integrated(places, steps, parts, to_rates, chained=chained)
