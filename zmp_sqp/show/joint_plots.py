"""Figure of joint accelerations, rates and angles over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics import Ground, Machine
from zmp_sqp.planning import Trajectory, UnicycleBase
from zmp_sqp.scenario import sliding_joints
from zmp_sqp.show.base_plots import draw_base, draw_plan_view
from zmp_sqp.show.canvas import new_figure, sample_times, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["joint_unit", "plot_joints"]

# Okabe & Ito 2008: distinguishable with any colour vision
JOINT_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#666666")
LINE_STYLES = ("-", ":", "-.")  # of the joints, in turn once the colours are used up


def plot_joints(
    machine: Machine,
    trajectory: Trajectory,
    path: str | Path,
    *,
    base: UnicycleBase | None = None,
    ground: Ground | None = None,
) -> None:
    """Draw joint accelerations, rates and angles over time, as in fig. 4 of Song & Sharf 2020.

    Limits are dashed: black if several joints share one, else in the joint's colour. Position
    limits far from the motion are left out. A base that moves has its own columns: distance driven,
    speed, yaw and yaw rate over time, and the path seen from above.

    Args:
        machine: Gives the limits.
        trajectory: The motion.
        path: File to write; its ending chooses the format.
        base: Gives the base's limits; None draws none.
        ground: Gives the downhill direction or contour lines around the base's path; None draws
            neither.
    """
    times = np.concatenate(sample_times(trajectory))
    drive = trajectory.base
    figure = new_figure(width=6.4 if drive is None else 15.0, height=7.2)
    parts: Any = (
        [figure] if drive is None else figure.subfigures(1, 3, width_ratios=(6.0, 4.0, 5.0))
    )
    _draw_joints(parts[0], machine, trajectory, times)
    if drive is not None:
        draw_base(parts[1].subplots(4, 1, sharex=True), drive, base, times)
        if machine.support is not None:
            draw_plan_view(parts[2].subplots(), drive, machine.support, base, ground)
    save(figure, path)


def _draw_joints(part: Any, machine: Machine, trajectory: Trajectory, times: Array) -> None:
    """Draw accelerations, rates and angles of all joints, one above the other.

    Args:
        part: Figure or subfigure of matplotlib.
        machine: Gives the limits.
        trajectory: The motion.
        times: Times to draw, shape (K,) [s].
    """
    limits, unit = machine.limits, joint_unit(machine)
    angles, rates, accelerations = trajectory(times)
    panels = (  # label, values (K, n), lower and upper limits (n,)
        (f"acceleration [{unit}/s²]", accelerations, -limits.acceleration, limits.acceleration),
        (f"rate [{unit}/s]", rates, -limits.velocity, limits.velocity),
        (
            "angle [rad]" if unit == "rad" else f"position [{unit}]",
            angles,
            limits.position_lower,
            limits.position_upper,
        ),
    )
    for axes, (label, values, lower, upper) in zip(
        part.subplots(3, 1, sharex=True), panels, strict=True
    ):
        for joint, name in enumerate(trajectory.joint_names):
            dashes = LINE_STYLES[joint // len(JOINT_COLOURS) % len(LINE_STYLES)]
            axes.plot(
                times,
                values[:, joint],
                dashes,
                color=_joint_colour(joint),
                linewidth=1.4,
                label=name,
            )
        _draw_limits(axes, np.concatenate([lower, upper]), everything=values is not angles)
        axes.set_ylabel(label)
        axes.margins(x=0.0)
        axes.grid(alpha=0.3)
    axes.set_xlabel("time [s]")
    part.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=6)


def _draw_limits(axes: Axes, bounds: Array, *, everything: bool) -> None:
    """Draw dashed lines at the limits of the joints.

    Args:
        axes: Axes with the joints' curves.
        bounds: Lower limits of the n joints, then upper limits, shape (2n,).
        everything: Whether limits outside the axes' range are drawn too.
    """
    low, high = axes.get_ylim()
    for bound in np.unique(bounds):
        joints = np.flatnonzero(bounds == bound) % (len(bounds) // 2)
        if everything or low <= bound <= high:
            colour = _joint_colour(joints[0]) if len(joints) == 1 else "black"
            axes.axhline(bound, color=colour, linestyle="--", linewidth=1.0)


def _joint_colour(joint: int) -> str:
    return JOINT_COLOURS[joint % len(JOINT_COLOURS)]


def joint_unit(machine: Machine) -> str:
    """Unit of the joint coordinates: "rad", "m", or "rad or m" if both occur."""
    sliding = len(sliding_joints(machine))
    return "rad" if sliding == 0 else "m" if sliding == machine.size else "rad or m"
