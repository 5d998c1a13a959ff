"""Straight base motion along the heading, and its states beside those of an arm motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.motion.unicycle_motion import UnicycleMotion

__all__ = ["BaseMotion", "asymmetric_profile", "combined_states", "driven_trajectory"]

# Share of an interval by which its outermost samples stand inside it: accelerations jump at nodes,
# and every sample shall have the acceleration of its own interval.
INSIDE = 1e-9
SAMPLES = 10  # least number of samples between two nodes of arm or base
MOST_SAMPLES = 100_000  # for the whole motion, to bound memory
# [s] largest time between samples. A ZMP that accelerates by 10 m/s^2, as a heavy arm's does, then
# leaves the chord between two samples by 10 * STEP^2 / 8 = 0.03 mm.
STEP = 5e-3


@dataclass(frozen=True, slots=True, eq=False)
class BaseMotion:
    """Straight motion of the base along its heading, beside an arm motion.

    Attributes:
        trajectory: Motion of one coordinate, "base": distance along the heading from the start,
            forward positive [m].
        lower: Bound of eq. (21) on the acceleration, backward (negative) [m/s^2].
        upper: Bound of eq. (21) on the acceleration, forward [m/s^2].
        factor: Share of that bound that the motion may use; below 1.0 if the bound had to shrink.
        margin: Least sampled distance from the ZMP of arm and base together to an edge [m].
    """

    trajectory: Trajectory
    lower: float
    upper: float
    factor: float
    margin: float

    @property
    def shrunk(self) -> bool:
        """Whether the bound of eq. (21) had to shrink to keep the ZMP inside the polygon."""
        return self.factor < 1.0

    @property
    def duration(self) -> float:
        """Duration of arm and base together: the base never ends before the arm [s]."""
        return self.trajectory.duration

    @property
    def times(self) -> Array:
        """Times of the nodes, shape (B+1,) [s]."""
        return self.trajectory.times

    @property
    def positions(self) -> Array:
        """Distances along the heading at the nodes, shape (B+1,) [m]."""
        return self.trajectory.positions[:, 0]

    @property
    def speeds(self) -> Array:
        """Speeds at the nodes, forward positive, shape (B+1,) [m/s]."""
        return self.trajectory.velocities[:, 0]

    @property
    def accelerations(self) -> Array:
        """Accelerations, constant on each interval, shape (B,) [m/s^2]."""
        return self.trajectory.accelerations[:, 0]

    def __call__(self, t: Any) -> tuple[Any, Any, Any]:
        """Distance [m], speed [m/s] and acceleration [m/s^2] at times t, each of the shape of t."""
        position, speed, acceleration = self.trajectory(t)
        return position[..., 0], speed[..., 0], acceleration[..., 0]


def asymmetric_profile(
    distance: float, *, forward: float, backward: float, max_speed: float, least_duration: float
) -> Trajectory:
    r"""Bang-coast-bang motion from rest to rest with different limits forward and backward.

    .. math::
        v = \min(v_{max}, \sqrt{2 D / (1/a_1 + 1/a_2)}), \quad
        T = D/v + v/(2 a_1) + v/(2 a_2)

    a_1 speeds up and a_2 brakes; which of the two is the forward limit depends on the sign of the
    distance. If T is less than `least_duration`, time is stretched by s = least_duration / T, which
    divides speeds by s and accelerations by s^2.

    Args:
        distance: Distance along the heading, negative backward [m].
        forward: Largest acceleration forward, positive [m/s^2].
        backward: Largest acceleration backward, positive [m/s^2].
        max_speed: Largest speed in both directions [m/s].
        least_duration: The motion lasts at least so long, 0 or more [s].

    Returns:
        Motion of one coordinate, "base" [m].
    """
    if distance == 0.0:
        still = np.zeros((2, 1))
        return Trajectory(("base",), np.array([0.0, least_duration]), still, still, still[:1])
    D = abs(distance)
    up, down = (forward, backward) if distance > 0.0 else (backward, forward)
    # without coasting, D = v^2 * ramps
    ramps = 0.5 / up + 0.5 / down
    speed = min(max_speed, float(np.sqrt(D / ramps)))
    coast = D / speed - speed * ramps
    phases = (
        [speed / up, coast, speed / down]
        if coast > 1e-12 * D / speed
        else [speed / up, speed / down]
    )
    steps = np.array(phases) * max(least_duration / sum(phases), 1.0)
    rates = np.array([0.0, 1.0, 1.0, 0.0] if len(steps) == 3 else [0.0, 1.0, 0.0])
    rates *= distance / np.sum(0.5 * steps * (rates[1:] + rates[:-1]))
    positions = np.concatenate([[0.0], np.cumsum(0.5 * steps * (rates[1:] + rates[:-1]))])
    times = np.concatenate([[0.0], np.cumsum(steps)])
    if np.isclose(times[-1], least_duration, rtol=1e-12, atol=0.0):
        times[-1] = least_duration  # removes the rounding error
    return Trajectory(
        ("base",), times, positions[:, None], rates[:, None], (np.diff(rates) / steps)[:, None]
    )


def combined_states(
    arm: Trajectory, base: Trajectory | None
) -> tuple[Array, Array, Array, Array, Array]:
    """States of arm and base on a grid with as many samples in each interval of their nodes.

    Whichever ends first rests at its goal.

    Args:
        arm: Arm motion.
        base: Base motion, one coordinate [m]; None for a base that stands.

    Returns:
        Times, shape (K,) [s]; the arm's positions, rates and accelerations, shape (K, n); the
        base's accelerations, shape (K,) [m/s^2].
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
    base_acceleration = base(np.minimum(times, base.duration))[2][:, 0]
    base_acceleration[times > base.duration] = 0.0
    return times, q, v, a, base_acceleration


def driven_trajectory(arm: Trajectory, base: Trajectory, start: Array) -> Trajectory:
    """Arm motion and straight base motion as one trajectory, exactly.

    Whichever ends first rests at its goal.

    Args:
        arm: Arm motion.
        base: Base motion: distance along the heading from the start, one coordinate [m].
        start: Pose x, y, yaw at which the base starts, shape (3,) [m, m, rad].

    Returns:
        Trajectory whose nodes are those of both motions.
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
    (q, v, a, jerks), (_, speed, acceleration, jerk) = parts
    # columns: along the heading, and in yaw
    still = np.zeros_like(acceleration)
    accelerations = np.hstack([acceleration, still]), np.hstack([jerk, still])
    rates, yaw = np.hstack([speed, np.zeros_like(speed)]), np.full(len(nodes), start[2])
    drive = UnicycleMotion.from_start(nodes, start, rates, yaw, accelerations)
    return Trajectory(arm.joint_names, nodes, q, v, a, jerks, drive)
