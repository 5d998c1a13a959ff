"""The slew that needs no QP: as fast as the ZMP's circle lets it be (Song & Sharf 2020, Section III-B)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array
from zmp_sqp.errors import MachineError, ProblemError
from zmp_sqp.mechanics.ground import Slope
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.zero_moment_point import zmp
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.closed_forms.slew_circle import ALIGNED, SlewInsight, slew_insight
from zmp_sqp.planning.closed_forms.slew_ramp import SlewRamp

__all__ = ["analytic_slew", "analytic_slew_duration"]

POSE = 1e-9  # [rad or m] rounding within which the other joints stand still, and limits are kept
OUTSIDE = 1e-9  # [m] by which a sampled ZMP may stand outside the circle
ROUNDS = 20  # of drawing the circle in
FEWEST = 8  # intervals
SAMPLES = 8  # per interval, both ends included


def analytic_slew_duration(
    machine: Machine, start: Any, goal: Any, *, radius: float | None = None
) -> float:
    """Exact least duration of the slew that `analytic_slew` makes; arguments and errors as there [s]."""
    ramp = _ramp(machine, *_boundary(machine, start, goal), radius)
    return 0.0 if ramp.angle == 0.0 else ramp.duration()


def analytic_slew(
    machine: Machine, start: Any, goal: Any, *, radius: float | None = None, intervals: int = 200
) -> Trajectory:
    r"""Fastest slew on the level with the ZMP in a circle about the slew axis: bang-bang by quadrature, without a QP.

    .. math::
        |\alpha| \le \min(a, (g / h_c) \sqrt{\rho^2 - (1 + h_c w^2 / g)^2}), \quad |w| \le v, \quad
        \rho = R M / (m_c d)

    Speed up at the bound, coast at the top rate if the angle is long enough, slow down as the
    mirror image. What is returned follows the bound by chords, inside it at all times, so it is
    slower than `analytic_slew_duration`: by less than 1e-3 from 50 intervals on, falling with their
    square. Where the bodies are not symmetric about the arm's vertical plane, the ZMP is not quite
    that of one mass; if it then leaves the circle, that is drawn in until the complete wrench stays
    inside.

    Args:
        machine: The machine, on level ground; limits of its first joint, the slew, are kept.
        start: Joint coordinates, shape (n,) [rad or m].
        goal: The same but for the slew.
        radius: Of the circle, R [m]; None for the largest one in the support polygon, whose centre
            must be on the axis.
        intervals: Number of intervals, not of equal length: nodes stand at the switches.

    Raises:
        MachineError: The machine has no vertical slew with its standing part centred on it, or the
            slew axis misses the centre of the support polygon; see `slew_insight`.
        ProblemError: The poses differ in another joint, are outside the limits, or a limit is
            missing; the machine tips over at rest (rho <= 1); a radius that is not positive; or too
            few intervals.
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
    wanted = ramp.radius
    for _ in range(ROUNDS):
        trajectory = _follow(machine, q0, qf, ramp, int(intervals))
        _, q, v, a = trajectory.within(np.linspace(0.0, 1.0, SAMPLES))
        excess = (
            float(
                np.linalg.norm(zmp(machine, q, v, a, Slope()) - ramp.insight.centre(), axis=1).max()
            )
            - wanted
        )
        if excess <= OUTSIDE:
            return trajectory
        ramp = replace(ramp, radius=ramp.radius - 1.2 * excess)
        if ramp.rho <= 1.0:
            break
    raise ProblemError(
        f"no slew keeps the ZMP within {wanted:.3f} m of the axis: the bodies are too skew for one mass"
    )


def _boundary(machine: Machine, start: Any, goal: Any) -> tuple[Array, Array]:
    """Start and goal, checked to differ in the slew alone and to be within limits that are there."""
    limits = machine.limits
    q0 = frozen_array(start, name="start", shape=(machine.size,), error=ProblemError)
    qf = frozen_array(goal, name="goal", shape=(machine.size,), error=ProblemError)
    for key in ("velocity", "acceleration"):
        if np.isnan(getattr(limits, key)[0]):
            raise ProblemError(f"no {key} limit for joint {machine.joint_names[0]!r}")
    for i, joint in enumerate(machine.joint_names):
        if i > 0 and abs(qf[i] - q0[i]) > POSE:
            raise ProblemError(
                f"start and goal may differ in the slew, {machine.joint_names[0]!r}, alone, but {joint!r} moves "
                f"by {qf[i] - q0[i]:.6g}"
            )
        lower, upper = limits.position_lower[i], limits.position_upper[i]
        for name, value in (("start", q0[i]), ("goal", qf[i])):
            if value < lower - POSE or value > upper + POSE:  # never for a limit that is NaN
                raise ProblemError(
                    f"{name} of joint {joint!r} is {value:.6g}, outside its limits [{lower:.6g}, {upper:.6g}]"
                )
    return q0, qf


def _ramp(machine: Machine, q0: Array, qf: Array, radius: float | None) -> SlewRamp:
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
            f"the machine tips over at rest: its ZMP stands {insight.radius_at_rest:.3f} m from the slew axis, "
            f"the supporting circle ends at {reach:.3f} m"
        )
    limits, angle = machine.limits, abs(float(qf[0] - q0[0]))
    return SlewRamp(insight, reach, float(limits.velocity[0]), float(limits.acceleration[0]), angle)


def _inscribed(machine: Machine, insight: SlewInsight) -> float:
    """Radius of the largest circle about the slew axis in the support polygon [m]."""
    support = machine.support
    if support is None:
        raise MachineError(
            f"machine {machine.name!r} has no support polygon: give one, or a radius"
        )
    here, there = support.vertices, np.roll(support.vertices, -1, axis=0)
    areas = here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0]
    centre = (areas[:, None] * (here + there)).sum(axis=0) / (3.0 * areas.sum())
    if np.linalg.norm(centre - insight.axis) > ALIGNED:
        raise MachineError(
            f"the slew axis at ({insight.axis[0]:.6g}, {insight.axis[1]:.6g}) m misses the centre of the support "
            f"polygon at ({centre[0]:.6g}, {centre[1]:.6g}) m: give a radius"
        )
    return float(support.signed_distance(np.array(insight.axis)))


def _follow(machine: Machine, q0: Array, qf: Array, ramp: SlewRamp, intervals: int) -> Trajectory:
    """Ramp, coast and mirrored ramp on the given number of intervals."""
    share = ramp.time(ramp.psi(ramp.peak)) / ramp.duration()
    count = int(np.clip(round(intervals * share), 3 * intervals // 8, (intervals - 1) // 2))
    times, push = ramp.nodes(count)
    step = np.diff(times)
    rate = np.concatenate([[0.0], np.cumsum(0.5 * step * (push[1:] + push[:-1]))])
    ramped = float(np.sum(step * rate[:-1] + step**2 * (2.0 * push[:-1] + push[1:]) / 6.0))
    coast = np.full(
        intervals - 2 * count, (ramp.angle - 2.0 * ramped) / rate[-1] / (intervals - 2 * count)
    )
    steps, still = np.concatenate([step, coast, step[::-1]]), 0.0 * coast
    first = np.concatenate([push[:-1], still, -push[:0:-1]])
    last = np.concatenate([push[1:], still, -push[-2::-1]])
    rates = np.concatenate([rate, np.full(len(coast), rate[-1]), rate[-2::-1]])
    turned = np.concatenate(
        [[0.0], np.cumsum(steps * rates[:-1] + steps**2 * (2.0 * first + last) / 6.0)]
    )
    sign = np.sign(qf[0] - q0[0])
    q, v = np.tile(q0, (intervals + 1, 1)), np.zeros((intervals + 1, len(q0)))
    a, j = np.zeros((2, intervals, len(q0)))
    q[:, 0], v[:, 0] = q0[0] + sign * turned, sign * rates
    a[:, 0], j[:, 0] = sign * first, sign * (last - first) / steps
    q[-1] = qf  # but for rounding, it is there
    return Trajectory(machine.joint_names, np.concatenate([[0.0], np.cumsum(steps)]), q, v, a, j)
