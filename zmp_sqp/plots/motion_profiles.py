"""Figure of joint coordinates, rates and accelerations over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.mechanics import Machine
from zmp_sqp.planning import Plan, Problem, Trajectory
from zmp_sqp.plots.base_axes import draw_base, draw_plan_view
from zmp_sqp.plots.canvas import colour_of, new_figure, sample_times, style_of
from zmp_sqp.plots.shown_motion import ShownMotion

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["profiles"]

WORDS = {"rad": "angle [rad]", "m": "position [m]"}  # by unit of a joint


def profiles(source: Plan | Problem, trajectory: Trajectory | None = None) -> Figure:
    """Joint accelerations, rates and coordinates over time with their limits.

    As in fig. 4 of Song & Sharf 2020, accelerations are on top. Joints that turn and joints that
    slide have columns of their own, in rad and m. Limits are dashed: black if several joints share
    one, else in the joint's colour. Position limits far from the motion are left out. A base that
    drives has its own columns: distance driven, speed, yaw and yaw rate over time, and the path
    seen from above with the downhill direction or the contour lines of the terrain.

    Args:
        source: A plan, whose last motion is drawn, safe or not; or a problem.
        trajectory: Motion of a problem; None for a plan.

    Raises:
        MissingExtra: matplotlib is not installed.
        NotSolved: The plan has no motion at all.
        ProblemError: An argument is of another kind.
    """
    shown = ShownMotion.of(source, trajectory)
    problem, motion = shown.problem, shown.trajectory
    machine, drive = problem.machine, motion.base
    times = np.concatenate(sample_times(motion))
    units = np.array(machine.joint_units)
    kinds = [(unit, np.flatnonzero(units == unit)) for unit in dict.fromkeys(machine.joint_units)]
    widths = [6.4] * len(kinds) + ([] if drive is None else [4.3, 5.3])
    figure = new_figure(width=sum(widths), height=7.2)
    parts: Any = (
        [figure] if len(widths) == 1 else figure.subfigures(1, len(widths), width_ratios=widths)
    )
    for part, (unit, joints) in zip(parts[: len(kinds)], kinds, strict=True):
        _draw_joints(part, machine, motion, times, unit, joints)
    if drive is not None:
        draw_base(parts[-2].subplots(4, 1, sharex=True), drive, problem.base, times)
        if machine.support is not None:
            above = parts[-1].subplots()
            draw_plan_view(above, drive, machine.support, problem.base, problem.ground)
    return figure


def _draw_joints(
    part: Any,
    machine: Machine,
    trajectory: Trajectory,
    times: Array,
    unit: str,
    joints: Indices,
) -> None:
    """Draw accelerations, rates and coordinates of joints of one unit, one above the other.

    Args:
        part: Figure or subfigure of matplotlib.
        machine: Gives the limits.
        trajectory: The motion.
        times: Times to draw, shape (K,) [s].
        unit: Unit of the joints, rad or m.
        joints: Their indices.
    """
    limits = machine.limits
    positions, rates, accelerations = trajectory(times)
    panels = (  # label, values (K, n), lower and upper limits (n,)
        (f"acceleration [{unit}/s²]", accelerations, -limits.acceleration, limits.acceleration),
        (f"rate [{unit}/s]", rates, -limits.velocity, limits.velocity),
        (WORDS[unit], positions, limits.position_lower, limits.position_upper),
    )
    for axes, (label, values, lower, upper) in zip(
        part.subplots(3, 1, sharex=True), panels, strict=True
    ):
        for joint in joints:
            name, look = machine.joint_names[joint], style_of(joint)
            curve = values[:, joint]
            axes.plot(times, curve, look, color=colour_of(joint), linewidth=1.4, label=name)
        bounds = np.concatenate([lower[joints], upper[joints]])
        _draw_limits(axes, bounds, joints, everything=values is not positions)
        axes.set_ylabel(label)
        axes.margins(x=0.0)
        axes.grid(alpha=0.3)
    axes.set_xlabel("time [s]")
    part.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=6)


def _draw_limits(axes: Axes, bounds: Array, joints: Indices, *, everything: bool) -> None:
    """Draw dashed lines at the limits of the joints.

    Args:
        axes: Axes with the joints' curves.
        bounds: Lower limits of the n joints, then upper limits, shape (2n,).
        joints: Their indices in the machine, shape (n,).
        everything: Whether limits outside the axes' range are drawn too.
    """
    low, high = axes.get_ylim()
    for bound in np.unique(bounds[np.isfinite(bounds)]):
        sharing = np.flatnonzero(bounds == bound) % len(joints)
        if everything or low <= bound <= high:
            colour = colour_of(joints[sharing[0]]) if len(sharing) == 1 else "black"
            axes.axhline(bound, color=colour, linestyle="--", linewidth=1.0)
