"""Base motion beside a planned arm motion, within the bound of Song & Sharf 2020, eq. (21)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number
from zmp_sqp.errors import GIVE_SUPPORT, ContactLost, MachineError, ProblemError
from zmp_sqp.mechanics.ground import Ground, is_uneven
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.mechanics.wrench import ground_reaction
from zmp_sqp.mechanics.zero_moment_point import zmp_of_wrench
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.closed_forms.base_motion import (
    BaseMotion,
    asymmetric_profile,
    combined_states,
)

__all__ = ["base_acceleration_bound", "moving_base_zmp", "plan_base"]

# Cosine between heading and an edge's normal below which the base cannot move the ZMP over it.
SIDEWAYS = 1e-9
# [m] by which a sampled ZMP may miss the margin: arm plans are checked on a coarser grid.
TOLERANCE = 1e-7
AT_REST = 1e-6  # [rad/s or m/s] final rates below it are rounding errors of zero
# [m] Heights of the centre of mass are raised to this: the bound then exceeds any real base.
LOWEST = 1e-6
LEAST_FACTOR = 1e-4  # no smaller share of the bound of eq. (21) is tried
REFINEMENTS = 12  # bisections of that share: a resolution of 1/4096 of the last step


def base_acceleration_bound(
    machine: Machine, trajectory: Trajectory, ground: Ground, *, margin: float = 0.0
) -> tuple[float, float]:
    r"""Bound on the base's acceleration along its heading that a planned arm motion leaves.

    Song & Sharf 2020, eq. (21), with x forward:

    .. math::
        \frac{\partial x_{zmp}}{\partial \ddot x_0} = \frac{-\sum m z}{\sum m (\ddot z - g_z)},
        \qquad d_u G \le \ddot x_0 \le -d_l G, \quad G = \frac{\sum m g_z}{\sum m z}

    d_u and d_l are the least distances over the motion, along the heading, from the arm's ZMP to
    the front and rear edges. The paper neglects z'' and takes z for constant; here sum m z is the
    largest over the motion.

    Args:
        machine: The machine with a support polygon; heights are counted from the polygon's plane.
        trajectory: Arm motion, planned for a base that stands.
        ground: Ground under the machine.
        margin: Distance kept between ZMP and every edge [m].

    Returns:
        (lower, upper) [m/s^2] with lower <= 0 <= upper; forward is positive.

    Raises:
        ProblemError: The arm motion alone does not keep the margin, its joints are not the
            machine's, or the ground is no plane.
        MachineError: The machine has no support polygon.
        ContactLost: The ground would have to pull during the arm motion alone.
    """
    support = _support(machine, trajectory, margin)
    _check_plane(ground)
    times, points = moving_base_zmp(machine, trajectory, None, ground)
    room = support.offsets - margin - points @ support.normals.T  # to every edge, (K, V) [m]
    row, edge = np.unravel_index(np.argmin(room), room.shape)
    if room[row, edge] < -TOLERANCE:
        raise ProblemError(
            f"the arm's motion alone misses the margin of {margin:.3g} m from the "
            f"{support.edge_name(int(edge))} edge by {-room[row, edge]:.3f} m at "
            f"{times[row]:.2f} s: plan the arm with that margin first"
        )
    ahead = support.normals[:, 0]
    front, rear = ahead > SIDEWAYS, ahead < -SIDEWAYS
    d_u = max(float((room[:, front] / ahead[front]).min()), 0.0)
    d_l = max(float((room[:, rear] / -ahead[rear]).min()), 0.0)
    weight = machine.mass * ground.gravity()[2]  # sum m g_z < 0
    sum_mz = _largest_sum_mz(machine, trajectory(times)[0], support)
    G = weight / max(sum_mz, LOWEST * machine.mass)
    return d_u * G, -d_l * G


def _largest_sum_mz(machine: Machine, q: Array, support: SupportPolygon) -> float:
    """Largest sum m z over poses q, shape (K, n), with z above the support plane [kg m].

    Accelerating the root forward by 1 m/s^2 takes a moment about the root origin whose y component
    is sum m z.
    """
    forward = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    moments = ground_reaction(machine, q, 0.0 * q, 0.0 * q, root_acceleration=forward)[:, 4]
    return float(moments.max()) - machine.mass * support.height


def plan_base(
    machine: Machine,
    trajectory: Trajectory,
    ground: Ground,
    *,
    distance: float,
    max_speed: float,
    max_acceleration: float,
    margin: float = 0.0,
) -> BaseMotion:
    """Straight base motion from rest to rest beside a planned arm motion, within eq. (21).

    The base speeds up at one side of the bound, coasts at the largest speed and brakes at the other
    side. If the arm takes longer, the base motion is slowed down to end with the arm's; else the
    arm waits at its goal. The motion is then checked with the complete wrench of arm and base,
    sampled on both sides of every jump of an acceleration and between. If the ZMP misses the margin
    because of terms that (21) neglects, both sides of the bound shrink by one factor, the largest
    that bisection finds.

    Args:
        machine: The machine with a support polygon, of point masses or rigid bodies.
        trajectory: Arm motion, planned for a base that stands.
        ground: Plane on which the base drives.
        distance: Distance to drive along the heading, negative backward [m].
        max_speed: Limit of the base's speed in both directions [m/s].
        max_acceleration: Limit of the base's acceleration in both directions [m/s^2].
        margin: Distance kept between ZMP and every edge [m].

    Returns:
        The motion; its `factor` is 1.0 if the bound of (21) did not have to shrink.

    Raises:
        ProblemError: No base motion beside this arm motion is safe; the arm motion alone is unsafe;
            the arm ends in motion, so that it cannot wait for the base; or an argument is not a
            number of the right sign.
        MachineError: The machine has no support polygon.
    """
    distance = finite_number(distance, name="distance", error=ProblemError)
    limits = {"max_speed": max_speed, "max_acceleration": max_acceleration}
    for name, value in limits.items():
        limits[name] = finite_number(value, name=name, error=ProblemError)
        if limits[name] <= 0.0:
            raise ProblemError(f"{name} must be positive, not {value}")
    bound = base_acceleration_bound(machine, trajectory, ground, margin=margin)
    if distance != 0.0 and min(-bound[0], bound[1]) <= 0.0:
        side = "front" if bound[0] == 0.0 else "rear"
        raise ProblemError(
            f"no base motion is safe beside this arm motion: its ZMP comes up to the {side} edge, "
            f"so eq. (21) wants accelerations within [{bound[0]:.3g}, {bound[1]:.3g}] m/s^2; "
            "plan the arm with a larger margin"
        )

    def attempt(factor: float) -> BaseMotion | str:
        motion = _profile(distance, bound, limits, factor=factor, arm=trajectory)
        return _checked(machine, trajectory, motion, ground, bound, factor=factor, margin=margin)

    return _largest_safe(attempt)


def _profile(
    distance: float,
    bound: tuple[float, float],
    limits: Mapping[str, float],
    *,
    factor: float,
    arm: Trajectory,
) -> Trajectory:
    """Base motion within a share of the bound of (21) that does not end before the arm motion."""
    lower, upper = bound
    motion = asymmetric_profile(
        distance,
        forward=min(factor * upper, limits["max_acceleration"]),
        backward=min(-factor * lower, limits["max_acceleration"]),
        max_speed=limits["max_speed"],
        least_duration=arm.duration,
    )
    if motion.duration > arm.duration and np.abs(arm.velocities[-1]).max() > AT_REST:
        raise ProblemError(
            "the arm ends in motion and cannot wait for the base, which takes longer"
        )
    return motion


def _checked(
    machine: Machine,
    arm: Trajectory,
    motion: Trajectory,
    ground: Ground,
    bound: tuple[float, float],
    *,
    factor: float,
    margin: float,
) -> BaseMotion | str:
    """Base motion if arm and base together keep the margin; else the reason why not."""
    try:
        points = moving_base_zmp(machine, arm, motion, ground)[1]
    except ContactLost as lost:
        return str(lost)
    found = float(_support(machine, arm, margin).signed_distance(points).min())
    if found < margin - TOLERANCE:
        return f"the ZMP keeps {found:.3f} m instead of {margin:.3f} m from the edges"
    lower, upper = bound
    return BaseMotion(motion, lower=lower, upper=upper, factor=factor, margin=found)


def _largest_safe(attempt: Callable[[float], BaseMotion | str]) -> BaseMotion:
    """Safe base motion with the largest share of the bound of (21): halving, then bisection.

    Args:
        attempt: Base motion for a share, or the reason why there is none.

    Raises:
        ProblemError: No share above `LEAST_FACTOR` gives a safe motion.
    """
    best = attempt(1.0)
    unsafe, factor = 1.0, 1.0
    while isinstance(best, str):
        unsafe, factor = factor, 0.5 * factor
        if factor < LEAST_FACTOR:
            raise ProblemError(
                "no base motion is safe beside this arm motion: even at "
                f"{unsafe:.1e} of the bound of eq. (21) {best}"
            )
        best = attempt(factor)
    if factor < 1.0:
        for _ in range(REFINEMENTS):
            middle = 0.5 * (best.factor + unsafe)
            tried = attempt(middle)
            if isinstance(tried, str):
                unsafe = middle
            else:
                best = tried
    return best


def moving_base_zmp(
    machine: Machine, trajectory: Trajectory, base: BaseMotion | Trajectory | None, ground: Ground
) -> tuple[Array, Array]:
    """ZMP of arm and base together, sampled from the complete wrench.

    Samples stand on both sides of every jump of an acceleration, at most 5 ms apart, and at least
    ten between two nodes. `certify` proves what holds between samples.

    Args:
        machine: The machine.
        trajectory: Arm motion; the arm waits at its goal while the base still moves.
        base: Base motion along the heading; None for a base that stands.
        ground: Ground under the machine.

    Returns:
        Times, shape (K,) [s], and ZMP in the root frame, shape (K, 2) [m].

    Raises:
        ProblemError: The base moves over ground that is no plane.
        ContactLost: The ground would have to pull.
    """
    motion = base.trajectory if isinstance(base, BaseMotion) else base
    if motion is not None:
        _check_plane(ground)
    times, q, v, a, base_acceleration = combined_states(trajectory, motion)
    # root acceleration less gravity; the base accelerates along x of the root frame
    root = np.zeros((len(times), 6))
    root[:, :3] = -ground.gravity()
    root[:, 0] += base_acceleration
    height = 0.0 if machine.support is None else machine.support.height
    return times, zmp_of_wrench(ground_reaction(machine, q, v, a, root_acceleration=root), height)


def _check_plane(ground: Ground) -> None:
    if is_uneven(ground):
        raise ProblemError(
            f"eq. (21) is for a base that moves in a plane, not over a {type(ground).__name__}"
        )


def _support(machine: Machine, trajectory: Trajectory, margin: Any) -> SupportPolygon:
    """Support polygon of the machine; refuses other joints in the trajectory and bad margins."""
    if trajectory.joint_names != machine.joint_names:
        raise ProblemError(
            f"the trajectory's joints are {', '.join(trajectory.joint_names)}, "
            f"the machine's {', '.join(machine.joint_names)}"
        )
    if finite_number(margin, name="margin", error=ProblemError) < 0.0:
        raise ProblemError(f"margin must not be negative, not {margin} m")
    if machine.support is None:
        raise MachineError(
            f"machine {machine.name!r} has no support polygon: {GIVE_SUPPORT.arguments}"
        )
    return machine.support
