"""How hard the base may accelerate while the arm moves, and its motion within that (Song & Sharf 2020, eq. (21))."""

from __future__ import annotations

from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number
from zmp_sqp.errors import ContactLost, MachineError, ProblemError
from zmp_sqp.mechanics.ground import Ground, Terrain
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

# cosine between heading and an edge's normal below which the base cannot push the ZMP over it
SIDEWAYS = 1e-9
# [m] by which a sampled ZMP may miss the margin: arm plans are checked on a coarser grid
TOLERANCE = 1e-7
AT_REST = 1e-6  # [rad/s or m/s] rounding of a final rate of zero
# [m] a centre of mass this near to the ground, or below it, sets no bound that matters
LOWEST = 1e-6
LEAST_FACTOR = 1e-4  # below it no bound is looked for
REFINEMENTS = 12  # bisections of the factor


def base_acceleration_bound(
    machine: Machine, trajectory: Trajectory, ground: Ground, *, margin: float = 0.0
) -> tuple[float, float]:
    r"""Bound on the base's acceleration along its heading that the planned arm motion leaves.

    .. math::
        \frac{\partial x_{zmp}}{\partial \ddot x_0} = \frac{-\sum m z}{\sum m (\ddot z - g_z)},
        \qquad d_u G \le \ddot x_0 \le -d_l G, \quad G = \frac{\sum m g_z}{\sum m z}    (Song &
        Sharf 2020, eq. (21))

    x is forward. d_u and d_l are the ways along the heading from the arm's ZMP to the front and
    rear edges, the least over the motion. The paper takes z'' for negligible and z for constant; of
    the poses that occur, the one with the largest sum m z counts here.

    Args:
        machine: With a support polygon; heights are those above it.
        trajectory: The arm's motion, planned for a base that stands.
        ground: What the machine stands on.
        margin: Distance kept between ZMP and every edge [m].

    Returns:
        (lower, upper) [m/s^2], root frame: lower <= 0 <= upper.

    Raises:
        ProblemError: The arm's motion alone does not keep the margin, its joints are not the
            machine's, or the ground is no plane.
        MachineError: No support polygon.
        ContactLost: The arm's motion alone makes the ground pull.
    """
    support = _support(machine, trajectory, margin)
    _check_plane(ground)
    times, points = moving_base_zmp(machine, trajectory, None, ground)
    room = support.offsets - margin - points @ support.normals.T  # to every edge, (K, V) [m]
    row, edge = np.unravel_index(np.argmin(room), room.shape)
    if room[row, edge] < -TOLERANCE:
        raise ProblemError(
            f"the arm's motion alone misses the margin of {margin:.3g} m from the {support.edge_name(int(edge))} edge "
            f"by {-room[row, edge]:.3f} m at {times[row]:.2f} s: plan it with that margin first"
        )
    ahead = support.normals[:, 0]
    front, rear = ahead > SIDEWAYS, ahead < -SIDEWAYS
    d_u = max(float((room[:, front] / ahead[front]).min()), 0.0)
    d_l = max(float((room[:, rear] / -ahead[rear]).min()), 0.0)
    pull = machine.mass * ground.gravity()[2]  # sum m g_z < 0
    q = trajectory(times)[0]
    push = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # its moment about the root origin is sum m z
    moments = ground_reaction(machine, q, 0.0 * q, 0.0 * q, root_acceleration=push)[:, 4]
    G = pull / max(float(moments.max()) - machine.mass * support.height, LOWEST * machine.mass)
    return d_u * G, -d_l * G


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
    """Straight base motion along the heading, rest to rest, beside a planned arm motion: phase-plane method under (21).

    Speed up with one side of the bound, coast at the largest speed, brake with the other side. If
    the arm takes longer, the motion is stretched to end with it, gentler by the square; if not, the
    arm waits at its goal. Then the complete wrench is looked at, on both sides of every jump of an
    acceleration and between. Where what (21) neglects would break the polygon, both sides of the
    bound shrink by one factor, the largest that bisection finds.

    Args:
        machine: With a support polygon; point masses or rigid bodies, as it is.
        trajectory: The arm's motion, planned for a base that stands.
        ground: What the machine stands on, the same all along the way.
        distance: Signed, forward positive [m].
        max_speed: Of the base [m/s].
        max_acceleration: Of the base, both ways [m/s^2].
        margin: Distance kept between ZMP and every edge [m].

    Returns:
        The motion; `factor` is 1.0 where (21) held as it stands.

    Raises:
        ProblemError: No base motion with this arm motion is safe, the arm's motion alone is not, it
            ends in motion and could not wait, or an argument is not a number of the right sign.
        MachineError: No support polygon.
    """
    distance = finite_number(distance, name="distance", error=ProblemError)
    limits = {"max_speed": max_speed, "max_acceleration": max_acceleration}
    for name, value in limits.items():
        limits[name] = finite_number(value, name=name, error=ProblemError)
        if limits[name] <= 0.0:
            raise ProblemError(f"{name} must be positive, not {value}")
    lower, upper = base_acceleration_bound(machine, trajectory, ground, margin=margin)
    if distance != 0.0 and min(-lower, upper) <= 0.0:
        side = "front" if lower == 0.0 else "rear"
        raise ProblemError(
            f"no base motion is safe beside this arm motion: its ZMP comes up to the {side} edge, so eq. (21) wants "
            f"accelerations within [{lower:.3g}, {upper:.3g}] m/s^2; plan the arm with a larger margin"
        )

    def attempt(factor: float) -> BaseMotion | str:
        motion = asymmetric_profile(
            distance,
            forward=min(factor * upper, limits["max_acceleration"]),
            backward=min(-factor * lower, limits["max_acceleration"]),
            max_speed=limits["max_speed"],
            least_duration=trajectory.duration,
        )
        if (
            motion.duration > trajectory.duration
            and np.abs(trajectory.velocities[-1]).max() > AT_REST
        ):
            raise ProblemError(
                "the arm ends in motion and cannot wait for the base, which takes longer"
            )
        try:
            points = moving_base_zmp(machine, trajectory, motion, ground)[1]
        except ContactLost as lost:
            return str(lost)
        support = _support(machine, trajectory, margin)
        found = float(support.signed_distance(points).min())
        if found < margin - TOLERANCE:
            return f"the ZMP keeps {found:.3f} m instead of {margin:.3f} m from the edges"
        return BaseMotion(motion, lower=lower, upper=upper, factor=factor, margin=found)

    best = attempt(1.0)
    unsafe, factor = 1.0, 1.0
    while isinstance(best, str):
        unsafe, factor = factor, 0.5 * factor
        if factor < LEAST_FACTOR:
            raise ProblemError(
                f"no base motion is safe beside this arm motion: even at {unsafe:.1e} of the bound of eq. (21) {best}"
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
    """ZMP of arm and base together from the complete wrench, on both sides of every jump and between.

    Samples are at most 5 ms apart, and at least ten in every piece between two nodes; `certify`
    misses nothing between.

    Args:
        machine: The machine.
        trajectory: The arm's motion; it waits at its goal while the base still moves.
        base: The base's motion along its heading; None stands still.
        ground: What the machine stands on.

    Returns:
        Times, shape (K,) [s], and ZMP in the root frame, shape (K, 2) [m].

    Raises:
        ProblemError: The base moves over ground that is no plane.
        ContactLost: The ground would have to pull.
    """
    motion = base.trajectory if isinstance(base, BaseMotion) else base
    if motion is not None:
        _check_plane(ground)
    times, q, v, a, push = combined_states(trajectory, motion)
    root = np.zeros((len(times), 6))
    root[:, :3] = -ground.gravity()
    root[:, 0] += push
    height = 0.0 if machine.support is None else machine.support.height
    return times, zmp_of_wrench(ground_reaction(machine, q, v, a, root_acceleration=root), height)


def _check_plane(ground: Ground) -> None:
    if isinstance(ground, Terrain) and not ground.uniform:
        raise ProblemError(
            f"eq. (21) is for a base that moves in a plane, not over a {type(ground).__name__}"
        )


def _support(machine: Machine, trajectory: Trajectory, margin: Any) -> SupportPolygon:
    if trajectory.joint_names != machine.joint_names:
        raise ProblemError(
            f"the trajectory's joints are {', '.join(trajectory.joint_names)}, "
            f"the machine's {', '.join(machine.joint_names)}"
        )
    if finite_number(margin, name="margin", error=ProblemError) < 0.0:
        raise ProblemError(f"margin must not be negative, not {margin} m")
    if machine.support is None:
        raise MachineError(
            f"machine {machine.name!r} has no support polygon: give one by support=... or with_support"
        )
    return machine.support
