"""The base's motion along its heading, and its states beside those of the arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.motion.unicycle_motion import UnicycleMotion

__all__ = ["BaseMotion", "asymmetric_profile", "combined_states", "driven_trajectory"]

# share of a piece by which its outermost samples stand inside, so that each has its own
# accelerations
INSIDE = 1e-9
SAMPLES = 10  # per piece between two nodes of arm or base, at least
MOST_SAMPLES = 100_000  # however long the motion is
# [s] between two of them at most: the ZMP of a heavy arm bends by some 10 m/s^2, 0.03 mm in between
STEP = 5e-3


@dataclass(frozen=True, slots=True, eq=False)
class BaseMotion:
    """Straight motion of the base along its heading, beside an arm motion.

    Attributes:
        trajectory: Of the one coordinate "base", forward positive [m]; it starts at 0.
        lower: Bound on the acceleration as eq. (21) gives it, before the base's own limit and the
            factor [m/s^2].
        upper: Likewise, forward [m/s^2].
        factor: Share of that bound that was used: 1.0 as (21) says, less where it had to shrink
            [-].
        margin: Least distance from the ZMP to an edge that was found, arm and base moving together
            [m].
    """

    trajectory: Trajectory
    lower: float
    upper: float
    factor: float
    margin: float

    @property
    def shrunk(self) -> bool:
        """Whether the bound of eq. (21) would have broken the polygon."""
        return self.factor < 1.0

    @property
    def duration(self) -> float:
        """Of arm and base together, for the base never ends first [s]."""
        return self.trajectory.duration

    @property
    def times(self) -> Array:
        """Nodes, shape (B+1,) [s]."""
        return self.trajectory.times

    @property
    def positions(self) -> Array:
        """Way gone at the nodes, shape (B+1,) [m]."""
        return self.trajectory.positions[:, 0]

    @property
    def speeds(self) -> Array:
        """At the nodes, shape (B+1,) [m/s]."""
        return self.trajectory.velocities[:, 0]

    @property
    def accelerations(self) -> Array:
        """Constant on each interval, shape (B,) [m/s^2]."""
        return self.trajectory.accelerations[:, 0]

    def __call__(self, t: Any) -> tuple[Any, Any, Any]:
        """Way [m], speed [m/s] and acceleration [m/s^2] at times as `Trajectory` takes them, of the shape of t."""
        position, speed, acceleration = self.trajectory(t)
        return position[..., 0], speed[..., 0], acceleration[..., 0]


def asymmetric_profile(
    distance: float, *, forward: float, backward: float, max_speed: float, least_duration: float
) -> Trajectory:
    r"""Phase-plane motion from rest to rest with other limits forward than backward, no shorter than a duration.

    .. math:: v = \min(v_{max}, \sqrt{2 D / (1/a_1 + 1/a_2)}), \quad T = D/v + v/(2 a_1) + v/(2 a_2)

    a_1 speeds up and a_2 brakes; which of the two is the forward limit depends on the sign of the
    distance. A motion that would end too early is stretched as a whole by s: speeds by 1/s,
    accelerations by 1/s^2.

    Args:
        distance: Signed [m].
        forward: Largest acceleration forward, positive [m/s^2].
        backward: Largest acceleration backward, positive [m/s^2].
        max_speed: Both ways [m/s].
        least_duration: At least 0 [s].
    """
    if distance == 0.0:
        still = np.zeros((2, 1))
        return Trajectory(("base",), np.array([0.0, least_duration]), still, still, still[:1])
    way = abs(distance)
    up, down = (forward, backward) if distance > 0.0 else (backward, forward)
    effort = 0.5 / up + 0.5 / down
    speed = min(max_speed, float(np.sqrt(way / effort)))
    coast = way / speed - speed * effort
    phases = (
        [speed / up, coast, speed / down]
        if coast > 1e-12 * way / speed
        else [speed / up, speed / down]
    )
    steps = np.array(phases) * max(least_duration / sum(phases), 1.0)
    rates = np.array([0.0, 1.0, 1.0, 0.0] if len(steps) == 3 else [0.0, 1.0, 0.0])
    rates *= distance / np.sum(0.5 * steps * (rates[1:] + rates[:-1]))
    places = np.concatenate([[0.0], np.cumsum(0.5 * steps * (rates[1:] + rates[:-1]))])
    times = np.concatenate([[0.0], np.cumsum(steps)])
    if np.isclose(times[-1], least_duration, rtol=1e-12, atol=0.0):
        times[-1] = least_duration  # but for rounding
    return Trajectory(
        ("base",), times, places[:, None], rates[:, None], (np.diff(rates) / steps)[:, None]
    )


def combined_states(
    arm: Trajectory, base: Trajectory | None
) -> tuple[Array, Array, Array, Array, Array]:
    """States of arm and base on a fine grid, equally many in every piece between two nodes of either, both ends of it.

    The one that ends first rests where it ended.

    Returns:
        Times (K,) [s], the arm's positions, rates and accelerations (K, n), the base's
        accelerations (K,) [m/s^2].
    """
    nodes = arm.times if base is None else np.union1d(arm.times, base.times)
    count = max(
        SAMPLES,
        int(np.ceil(min(float(np.diff(nodes).max(initial=0.0)) / STEP, MOST_SAMPLES / len(nodes)))),
    )
    shares = np.linspace(INSIDE, 1.0 - INSIDE, count)
    times = (
        (nodes[:-1, None] + np.diff(nodes)[:, None] * shares).ravel()
        if len(nodes) > 1
        else np.zeros(1)
    )
    q, v, a = arm(np.minimum(times, arm.duration))
    waiting = times > arm.duration
    v[waiting], a[waiting] = 0.0, 0.0
    if base is None:
        return times, q, v, a, np.zeros_like(times)
    push = base(np.minimum(times, base.duration))[2][:, 0]
    push[times > base.duration] = 0.0
    return times, q, v, a, push


def driven_trajectory(arm: Trajectory, base: Trajectory, start: Array) -> Trajectory:
    """One trajectory of arm and base, exact: what can be certified, drawn and written like any other.

    Args:
        arm: The joints' motion.
        base: The way along the heading, from zero on, one coordinate [m].
        start: Pose x, y, yaw from which the base drives straight, shape (3,) [m, m, rad].

    Returns:
        Over the nodes of both; the one that ends first rests where it ended.
    """
    nodes = np.union1d(arm.times, base.times)
    parts = []
    for motion in (arm, base):
        middles = 0.5 * (nodes[1:] + nodes[:-1])
        k, _ = motion.locate(middles)
        q, v, a = motion.state_in(k, nodes[:-1] - motion.times[k])
        resting = middles > motion.duration
        q[resting], v[resting], a[resting] = motion.positions[-1], 0.0, 0.0
        jerks = np.where(resting[:, None], 0.0, motion.jerks[k])
        last = motion.velocities[-1:] if motion.duration == nodes[-1] else 0.0 * v[-1:]
        parts.append((np.vstack([q, motion.positions[-1:]]), np.vstack([v, last]), a, jerks))
    (q, v, a, jerks), (_, speed, push, change) = parts
    still = np.zeros_like(push)
    pushes = np.hstack([push, still]), np.hstack([change, still])
    rates, yaw = np.hstack([speed, np.zeros_like(speed)]), np.full(len(nodes), start[2])
    drive = UnicycleMotion.from_start(nodes, start, rates, yaw, pushes)
    return Trajectory(arm.joint_names, nodes, q, v, a, jerks, drive)
