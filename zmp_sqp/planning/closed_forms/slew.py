"""Fastest slew on level ground in closed form (Song & Sharf 2020, Section III-B)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array
from zmp_sqp.errors import GIVE_LIMITS, GIVE_SUPPORT, MachineError, ProblemError
from zmp_sqp.mechanics.ground import Slope
from zmp_sqp.mechanics.limits import position_fault
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.zero_moment_point import zmp
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.closed_forms.slew_circle import ALIGNED, SlewInsight, slew_insight
from zmp_sqp.planning.closed_forms.slew_ramp import SlewRamp

__all__ = ["analytic_slew", "analytic_slew_duration"]

POSE = 1e-9  # [rad or m] rounding by which other joints may move, and limits may be exceeded
OUTSIDE = 1e-9  # [m] rounding by which a sampled ZMP may leave the circle
ROUNDS = 20  # reductions of the circle's radius, at most
OVERSHOOT = 1.2  # times the ZMP's excess by which the radius is reduced, so that few rounds suffice
FEWEST = 8  # least number of intervals
SAMPLES = 8  # samples per interval, both ends included


def analytic_slew_duration(
    machine: Machine, start: Any, goal: Any, *, radius: float | None = None
) -> float:
    """Least duration of a slew with the ZMP in a circle about the slew axis [s].

    The motion of `analytic_slew` is slower by less than 1e-3 from 50 intervals on.

    Args:
        machine: The machine on level ground; the limits of its first joint, the slew, are kept.
        start: Joint coordinates at the start, shape (n,) [rad or m].
        goal: Joint coordinates at the goal; only the slew may differ from the start.
        radius: Radius R of the circle [m]; None for the largest one in the support polygon.

    Raises:
        MachineError: The machine is no slew, or the slew axis misses the centre of the polygon; see
            `analytic_slew`.
        ProblemError: Start, goal, limits or radius cannot be used; see `analytic_slew`.
    """
    ramp = _ramp(machine, *_boundary(machine, start, goal), radius)
    return 0.0 if ramp.angle == 0.0 else ramp.duration()


def analytic_slew(
    machine: Machine, start: Any, goal: Any, *, radius: float | None = None, intervals: int = 200
) -> Trajectory:
    r"""Fastest slew on level ground with the ZMP in a circle about the slew axis, without a QP.

    With the quantities of `SlewInsight`, the circle of radius R bounds rate w and acceleration
    alpha of the slew beside its joint limits v and a (Song & Sharf 2020, from eq. (16)):

    .. math::
        |\alpha| \le \min(a, (g / h_c) \sqrt{\rho^2 - (1 + h_c w^2 / g)^2}), \quad |w| \le v,
        \quad \rho = R M / (m_c d)

    The slew speeds up at the bound, coasts at the top rate if the angle is large enough, and slows
    down in the mirror image. Its acceleration is piecewise linear and below the bound at all times,
    so it is slower than `analytic_slew_duration`: by less than 1e-3 from 50 intervals on, falling
    with the square of their number. If the bodies are not symmetric about the arm's vertical plane,
    the ZMP deviates from that of one lumped mass; if it then leaves the circle, R is reduced until
    the ZMP from the complete wrench stays inside.

    Args:
        machine: The machine on level ground; the limits of its first joint, the slew, are kept.
        start: Joint coordinates at the start, shape (n,) [rad or m].
        goal: Joint coordinates at the goal; only the slew may differ from the start.
        radius: Radius R of the circle [m]; None for the largest one in the support polygon, whose
            centre must be on the slew axis.
        intervals: Number of intervals, at least 8; their lengths differ, so that nodes stand at the
            switches.

    Returns:
        The motion, from rest to rest.

    Raises:
        MachineError: The machine is no slew (see `slew_insight`), or the slew axis misses the
            centre of the support polygon.
        ProblemError: Start and goal differ in another joint or are outside the limits; a limit is
            missing; the machine tips over at rest (rho <= 1); the radius is not positive; or there
            are too few intervals.
    """
    if (
        isinstance(intervals, bool)
        or not isinstance(intervals, int | np.integer)
        or intervals < FEWEST
    ):
        raise ProblemError(
            f"intervals must be a whole number of at least {FEWEST}, not {intervals!r}"
        )
    q0, qf = _boundary(machine, start, goal)
    ramp = _ramp(machine, q0, qf, radius)
    if ramp.angle == 0.0:
        still = np.zeros((2, len(q0)))
        return Trajectory(machine.joint_names, np.zeros(2), np.vstack([q0, q0]), still, still[:1])
    return _within_circle(machine, q0, qf, ramp, int(intervals))


def _within_circle(
    machine: Machine, q0: Array, qf: Array, ramp: SlewRamp, intervals: int
) -> Trajectory:
    """Slew whose ZMP from the complete wrench stays in the circle of the given ramp.

    The radius of the ramp is reduced until it does.
    """
    wanted = ramp.radius
    for _ in range(ROUNDS):
        trajectory = _follow(machine, q0, qf, ramp, intervals)
        _, q, v, a = trajectory.within(np.linspace(0.0, 1.0, SAMPLES))
        radii = np.linalg.norm(zmp(machine, q, v, a, Slope()) - ramp.insight.centre(), axis=1)
        excess = float(radii.max()) - wanted
        if excess <= OUTSIDE:
            return trajectory
        ramp = replace(ramp, radius=ramp.radius - OVERSHOOT * excess)
        if ramp.rho <= 1.0:
            break
    raise ProblemError(
        f"no slew keeps the ZMP within {wanted:.3f} m of the axis: "
        "the bodies that turn are spread out too much to count as one mass"
    )


def _boundary(machine: Machine, start: Any, goal: Any) -> tuple[Array, Array]:
    """Start and goal as arrays; they must differ in the slew alone and keep the limits given."""
    limits = machine.limits
    q0 = frozen_array(start, name="start", shape=(machine.size,), error=ProblemError)
    qf = frozen_array(goal, name="goal", shape=(machine.size,), error=ProblemError)
    for key in ("velocity", "acceleration"):
        if np.isnan(getattr(limits, key)[0]):
            raise ProblemError(
                f"no {key} limit for joint {machine.joint_names[0]!r}: {GIVE_LIMITS.arguments}"
            )
    for i, joint in enumerate(machine.joint_names):
        if i > 0 and abs(qf[i] - q0[i]) > POSE:
            raise ProblemError(
                f"start and goal may differ in the slew, {machine.joint_names[0]!r}, alone, "
                f"but {joint!r} moves by {qf[i] - q0[i]:.6g}"
            )
        lower, upper = float(limits.position_lower[i]), float(limits.position_upper[i])
        for name, value in (("start", float(q0[i])), ("goal", float(qf[i]))):
            unit = machine.joint_units[i]
            fault = position_fault(joint, value, lower=lower, upper=upper, unit=unit)
            if fault:
                raise ProblemError(f"{name} {fault}")
    return q0, qf


def _ramp(machine: Machine, q0: Array, qf: Array, radius: float | None) -> SlewRamp:
    """Fastest speeding up of the slew; a radius of None is that of the largest circle."""
    insight = slew_insight(machine, q0)
    reach = (
        _inscribed(machine, insight)
        if radius is None
        else finite_number(radius, name="radius", error=ProblemError)
    )
    if reach <= 0.0:
        raise ProblemError(f"radius must be positive, not {reach:.6g} m")
    if insight.reserve(reach) <= 1.0:
        raise ProblemError(
            f"the machine tips over at rest: its ZMP stands {insight.radius_at_rest:.3f} m "
            f"from the slew axis, the supporting circle ends at {reach:.3f} m"
        )
    limits, angle = machine.limits, abs(float(qf[0] - q0[0]))
    return SlewRamp(insight, reach, float(limits.velocity[0]), float(limits.acceleration[0]), angle)


def _inscribed(machine: Machine, insight: SlewInsight) -> float:
    """Radius of the largest circle about the slew axis in the support polygon [m]."""
    support = machine.support
    if support is None:
        raise MachineError(
            f"machine {machine.name!r} has no support polygon: {GIVE_SUPPORT.arguments}, or give a "
            "radius"
        )
    # centre of area: that of the triangles between the origin and each edge, weighted by area
    here, there = support.vertices, np.roll(support.vertices, -1, axis=0)
    areas = here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0]
    centre = (areas[:, None] * (here + there)).sum(axis=0) / (3.0 * areas.sum())
    if np.linalg.norm(centre - insight.axis) > ALIGNED:
        raise MachineError(
            f"the slew axis at ({insight.axis[0]:.6g}, {insight.axis[1]:.6g}) m misses the centre "
            f"of the support polygon at ({centre[0]:.6g}, {centre[1]:.6g}) m: give a radius"
        )
    return float(support.signed_distance(np.array(insight.axis)))


def _follow(machine: Machine, q0: Array, qf: Array, ramp: SlewRamp, intervals: int) -> Trajectory:
    """Slew that follows a ramp, coasts, and slows down in the mirror image of the ramp.

    Accelerations are linear in time on each interval.
    """
    share = ramp.time(ramp.psi(ramp.peak)) / ramp.duration()
    count = int(np.clip(round(intervals * share), 3 * intervals // 8, (intervals - 1) // 2))
    times, alpha = ramp.nodes(count)
    step = np.diff(times)
    rate = np.concatenate([[0.0], np.cumsum(0.5 * step * (alpha[1:] + alpha[:-1]))])
    # [rad] angle turned while speeding up
    ramped = float(np.sum(step * rate[:-1] + step**2 * (2.0 * alpha[:-1] + alpha[1:]) / 6.0))
    coast = np.full(
        intervals - 2 * count, (ramp.angle - 2.0 * ramped) / rate[-1] / (intervals - 2 * count)
    )
    steps, still = np.concatenate([step, coast, step[::-1]]), 0.0 * coast
    # accelerations at the first and last instant of each interval
    first = np.concatenate([alpha[:-1], still, -alpha[:0:-1]])
    last = np.concatenate([alpha[1:], still, -alpha[-2::-1]])
    rates = np.concatenate([rate, np.full(len(coast), rate[-1]), rate[-2::-1]])
    turned = np.concatenate(
        [[0.0], np.cumsum(steps * rates[:-1] + steps**2 * (2.0 * first + last) / 6.0)]
    )
    sign = np.sign(qf[0] - q0[0])
    q, v = np.tile(q0, (intervals + 1, 1)), np.zeros((intervals + 1, len(q0)))
    a, j = np.zeros((2, intervals, len(q0)))
    q[:, 0], v[:, 0] = q0[0] + sign * turned, sign * rates
    a[:, 0], j[:, 0] = sign * first, sign * (last - first) / steps
    q[-1] = qf  # removes the rounding error
    return Trajectory(machine.joint_names, np.concatenate([[0.0], np.cumsum(steps)]), q, v, a, j)
