"""Motion of a unicycle base: polynomial speed and yaw, and the position as their integral."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, Indices, frozen_array, set_frozen_state, shortened
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
# [m, rad, m/s, rad/s] largest difference between given poses or velocities and those that follow
# from the accelerations; allows for files with rounded numbers
CONSISTENCY = 1e-6
PLANE = Slope()  # default ground; for the motion of a base, all planes are equivalent
PLANAR = " in a plane; if it drove over a heightmap, give that as its ground"  # end of a message
# Over uneven ground the path is one polynomial per piece. A piece lasts at most LONGEST_PIECE [s]
# and turns by at most LARGEST_TURN [rad], because the bound on its position error grows with the
# cube of the turn. MOST_PIECES limits the number of pieces of long motions.
LONGEST_PIECE = 0.1
LARGEST_TURN = 0.1
MOST_PIECES = 20_000


@dataclass(frozen=True, slots=True, eq=False)
class UnicycleMotion:
    r"""Motion of a unicycle base over nodes t_0 = 0 < ... < t_N.

    Accelerations are linear in time within each interval, so that speed s and yaw \psi are exact
    polynomials. The position in interval k is the integral (see `PositionCurve`)

    .. math:: p(t) = p_k + \int_{t_k}^{t} s\, B(p) (\cos\psi, \sin\psi)\, dt

    where B(p) projects the heading onto the map (see `Terrain.ground_rates`); B is the identity on
    a plane.

    Attributes:
        times: Nodes, shape (N+1,) [s].
        poses: (x, y, yaw) at the nodes, ground frame, shape (N+1, 3) [m, m, rad].
        velocities: Speed along the heading and yaw rate at the nodes, shape (N+1, 2) [m/s, rad/s].
        accelerations: Rates of speed and yaw rate at the starts of the intervals, shape (N, 2)
            [m/s^2, rad/s^2].
        jerks: Rates of the accelerations in the intervals, shape (N, 2) [m/s^3, rad/s^3].
        ground: Ground on which the base drives; all planes are equivalent.

    Raises:
        TrajectoryError: Shapes differ, entries are not finite, or poses and velocities do not
            follow from the accelerations.
        ProblemError: The base leaves the map.
    """

    times: Array
    poses: Array
    velocities: Array
    accelerations: Array
    jerks: Array
    ground: Terrain = PLANE
    _path: PositionCurve = field(init=False, repr=False)

    __setstate__ = set_frozen_state

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
        path, positions = _curve(*motion, np.diff(times), self.ground, chained=False)
        self.ground.check_on(positions.reshape(-1, 2))
        object.__setattr__(self, "_path", path)
        pose, velocity, _ = self.state_in(np.arange(count - 1), np.diff(times))
        gap = np.hstack([self.poses[1:] - pose, self.velocities[1:] - velocity])
        worst = np.unravel_index(np.argmax(np.abs(gap)), gap.shape)
        if abs(gap[worst]) > CONSISTENCY:
            name = BASE_COLUMNS[int(worst[1])]
            raise TrajectoryError(
                f"{name} does not follow from the accelerations: "
                f"node {int(worst[0]) + 1} is off by {gap[worst]:.3g}"
                f"{PLANAR if self.ground.uniform and worst[1] < 2 else ''}"
            )

    @classmethod
    def from_start(
        cls,
        times: Array,
        start: Array,
        velocities: Array,
        yaw: Array,
        controls: tuple[Array, Array],
        ground: Terrain = PLANE,
        near: Array | None = None,
    ) -> UnicycleMotion:
        """Motion whose positions are computed from a start pose, speeds and yaws.

        Args:
            times: Nodes, shape (N+1,) [s].
            start: Pose (x, y, yaw) at the first node, shape (3,) [m, m, rad]; its yaw is not used.
            velocities: Speed and yaw rate at the nodes, shape (N+1, 2) [m/s, rad/s].
            yaw: Yaw at the nodes, shape (N+1,) [rad].
            controls: Accelerations and jerks of the class, shape (N, 2) each.
            ground: Ground on which the base drives.
            near: Positions at the nodes of a path nearby, from which the iteration starts, shape
                (N+1, 2) [m]; None starts at the first node.

        Raises:
            TrajectoryError: Shapes differ, entries are not finite, or velocities and yaws do not
                follow from the accelerations.
            ProblemError: The base leaves the map; the message says where.
        """
        poses = np.column_stack([np.zeros((len(times), 2)), yaw])
        poses[:, :2] = start[:2]
        guess = poses[:-1].copy()
        if near is not None:
            guess[1:, :2] = near[1:-1]
        curve, _ = _curve(guess, velocities[:-1], *controls, np.diff(times), ground, chained=True)
        k = np.arange(len(times) - 1)
        poses[1:, :2] += np.cumsum(curve.displacement(k, np.diff(times)), axis=0)
        return cls(times, poses, velocities, *controls, ground)

    @property
    def pieces(self) -> Indices:
        """Number of polynomials that make up the path in each interval, shape (N,)."""
        return self._path.pieces

    def on(self, ground: Terrain) -> UnicycleMotion:
        """This motion on the given ground.

        Raises:
            TrajectoryError: On this ground, the positions at the nodes do not follow from the
                accelerations.
            ProblemError: The base leaves the map.
        """
        return self if ground is self.ground else replace(self, ground=ground)

    def state_in(self, k: Indices, since: Array) -> tuple[Array, Array, Array]:
        """State of the base at given times within given intervals.

        Args:
            k: Indices of the intervals, shape (K,).
            since: Times since the starts of these intervals, shape (K,) [s].

        Returns:
            Pose (x, y, yaw), shape (K, 3); velocity (speed, yaw rate), shape (K, 2); acceleration,
            shape (K, 2).
        """
        position = self.poses[k, :2] + self._path.displacement(k, since)
        since = since[:, None]
        yaw = _yaw(self.poses[k], self.velocities[k], self.accelerations[k], self.jerks[k], since)
        return np.hstack([position, yaw]), *self._rates_in(k, since)

    def __call__(self, t: Any) -> tuple[Array, Array, Array]:
        """State of the base at given times.

        Args:
            t: Times within [0, duration], scalar or shape (K,) [s].

        Returns:
            Pose (x, y, yaw), velocity (speed, yaw rate) and acceleration: shapes (3,), (2,), (2,)
            for a scalar; (K, 3), (K, 2), (K, 2) for an array.

        Raises:
            TrajectoryError: A time is outside the motion or not finite.
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

    def after(self, k: int, since: float, times: Array) -> UnicycleMotion:
        """The remainder of the motion from a time in interval k on.

        Args:
            k: Index of the interval.
            since: Time since its start [s].
            times: Nodes of the rest, from 0 on, shape (N+1-k,) [s].
        """
        at = np.array([k]), np.array([since])
        rows = *self.state_in(*at), self.jerks[[k]]
        arrays = self.poses, self.velocities, self.accelerations, self.jerks
        poses, velocities, accelerations, jerks = (
            np.vstack([row, array[k + 1 :]]) for row, array in zip(rows, arrays, strict=True)
        )
        return UnicycleMotion(times, poses, velocities, accelerations, jerks, self.ground)

    def peaks(self, k: Indices, since: Array, length: Array) -> Array:
        """Bounds on velocity, acceleration and jerk over K subintervals.

        Velocities are parabolas: within a subinterval their absolute value exceeds the larger of
        the two end values by at most |jerk| length^2 / 8.

        Args:
            k: Index of the interval that contains each subinterval, shape (K,).
            since: Start of each subinterval, measured from the start of its interval, shape (K,)
                [s].
            length: Duration of each subinterval, shape (K,) [s].

        Returns:
            Largest |speed|, |acceleration| and |jerk| along the heading in the first row, those of
            the yaw in the second; shape (2, 3, K).
        """
        ends = [self._rates_in(k, at[:, None]) for at in (since, since + length)]
        velocity, acceleration = (
            np.maximum(np.abs(one), np.abs(other)) for one, other in zip(*ends, strict=True)
        )
        jerk = np.abs(self.jerks[k])
        velocity = velocity + 0.125 * length[:, None] ** 2 * jerk
        return np.stack([velocity, acceleration, jerk]).transpose(2, 0, 1)

    def _rates_in(self, k: Indices, since: Array) -> tuple[Array, Array]:
        """Velocities and accelerations at times `since`, (K, 1) [s], in the intervals k (K,)."""
        a, j = self.accelerations[k], self.jerks[k]
        return self.velocities[k] + since * a + 0.5 * since**2 * j, a + since * j

    def table(self) -> Array:
        """Motion as a table for files, shape (N+1, 9).

        Row k holds the quantities `BASE_COLUMNS` at node k. Accelerations and jerks are those of
        the interval that begins there; the last row has the final acceleration and the last jerk.
        """
        h = np.diff(self.times)[:, None]
        final = (self.accelerations + h * self.jerks)[-1:]
        controls = np.vstack([self.accelerations, final]), np.vstack([self.jerks, self.jerks[-1:]])
        return np.column_stack([self.poses, self.velocities, *controls])

    @classmethod
    def from_table(cls, times: Array, table: Array, ground: Terrain = PLANE) -> UnicycleMotion:
        """Motion from its nodes, shape (N+1,) [s], and a table in the format of `table`."""
        return cls(times, table[:, :3], table[:, 3:5], table[:-1, 5:7], table[:-1, 7:9], ground)


def _yaw(pose: Array, velocity: Array, a: Array, j: Array, since: Array) -> Array:
    """Yaw at times `since`, shape (K, s) [s], after the starts of K intervals, shape (K, s)."""
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
    """Path of the base over N intervals, and its positions at the Gauss points.

    Beyond the edge of a map, the ground is taken as it is at the nearest point of the edge.

    Args:
        pose: Poses at the starts of the intervals, shape (N, 3) [m, m, rad].
        velocity: Speeds and yaw rates there, shape (N, 2) [m/s, rad/s].
        a: Accelerations there, shape (N, 2) [m/s^2, rad/s^2].
        j: Jerks of the intervals, shape (N, 2) [m/s^3, rad/s^3].
        steps: Durations of the intervals, shape (N,) [s].
        ground: Ground on which the base drives.
        chained: Whether each interval starts where the one before ends; then only the first
            position is used.
    """
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
    pose, velocity, a, j, positions = (
        *(np.repeat(part, parts, axis=0) for part in (pose, velocity, a, j)),
        pose[:, :2],
    )
    yaw = _yaw(pose, velocity, a, j, t).ravel()
    rates = np.zeros((yaw.size, 2))
    rates[:, 0] = (velocity[:, :1] + t * a[:, :1] + 0.5 * t**2 * j[:, :1]).ravel()
    low, high = ground.extent

    def to_rates(positions: Array) -> Array:
        poses = np.column_stack([np.clip(positions.reshape(-1, 2), low, high), yaw])
        return ground.ground_rates(poses, rates).rates.reshape(positions.shape)

    return PositionCurve.integrated(positions, steps, parts, to_rates, chained=chained)
