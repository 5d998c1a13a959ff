"""Figures of a driving base: its motion over time, and its path seen from above."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics import Ground, SupportPolygon, Terrain
from zmp_sqp.planning import UnicycleBase, UnicycleMotion
from zmp_sqp.plots.canvas import COLOURS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

__all__ = ["draw_base", "draw_plan_view"]

LABELS = ("distance [m]", "speed [m/s]", "yaw [rad]", "yaw rate [rad/s]")
# colours of the path, and of the footprints at start and goal
COLOUR, FIRST, LAST = COLOURS[1], COLOURS[2], COLOURS[0]
APART = 1.2  # [m driven or rad of yaw] between footprints
LEVEL = 1e-3  # sine of the steepest slope that gets no arrow downhill
SAMPLES = 121  # of a heightmap along each axis, for contour lines
LINES = 24  # contour lines in and around the view, at most
ROOM = 0.15  # share of a limit by which axes reach beyond it


def draw_base(
    axes: Sequence[Axes], motion: UnicycleMotion, base: UnicycleBase | None, times: Array
) -> None:
    """Draw distance driven, speed, yaw and yaw rate over time; limits are dashed.

    Args:
        axes: Four axes, for `LABELS`.
        motion: Motion of the base.
        base: Gives the limits of speed and yaw rate; None draws none.
        times: Increasing times within the motion, shape (K,) [s].
    """
    pose, velocity, _ = motion(times)
    steps = 0.5 * np.diff(times) * (velocity[1:, 0] + velocity[:-1, 0])
    columns = np.append(0.0, np.cumsum(steps)), velocity[:, 0], pose[:, 2], velocity[:, 1]
    limits = (
        (None, None, None, None)
        if base is None
        else (None, base.max_speed, None, base.max_yaw_rate)
    )
    for one, label, values, limit in zip(axes, LABELS, columns, limits, strict=True):
        one.plot(times, values, color=COLOUR, linewidth=1.4)
        if limit is not None and np.abs(values).max() > (1.0 - ROOM) / 2.0 * limit:
            one.set_ylim(-(1.0 + ROOM) * limit, (1.0 + ROOM) * limit)
            for bound in (-limit, limit):
                one.axhline(bound, color="black", linestyle="--", linewidth=1.0)
        elif limit is not None:  # a line far above the curve would flatten the curve
            one.text(
                0.99, 0.04, f"limit {limit:g}", transform=one.transAxes, ha="right", color="dimgrey"
            )
        one.set_ylabel(label)
        one.margins(x=0.0)
        one.grid(alpha=0.3)
    axes[-1].set_xlabel("time [s]")


def draw_plan_view(
    axes: Axes,
    motion: UnicycleMotion,
    support: SupportPolygon,
    base: UnicycleBase | None,
    ground: Ground | None,
) -> None:
    """Draw the path seen from above, with footprints, bounds on x and y, and the ground.

    Args:
        axes: Empty axes.
        motion: Motion of the base.
        support: The footprint in the frame of the base.
        base: Gives the bounds on x and y, dashed; None draws none.
        ground: A slope has an arrow downhill, a heightmap contour lines with labels in metres; None
            draws neither.
    """
    times = np.linspace(0.0, float(motion.times[-1]), 400)
    pose, velocity, _ = motion(times)
    # [m or rad] integral of the larger of speed and yaw rate
    covered = np.append(0.0, np.cumsum(np.diff(times) * np.abs(velocity[1:]).max(axis=1)))
    between = np.searchsorted(covered, np.arange(APART, covered[-1] - 0.5 * APART, APART))
    for k, colour, label in [
        *((k, "silver", None) for k in between),
        (0, FIRST, "start"),
        (len(times) - 1, LAST, "goal"),
    ]:
        _draw_footprint(axes, support, pose[k], colour, 1.0 if label is None else 1.6)
        if label is not None:
            axes.plot([], [], color=colour, label=label)
    axes.plot(*pose[:, :2].T, color=COLOUR, linewidth=2.0, label="path")
    if base is not None:
        _draw_bounds(axes, base)
    if isinstance(ground, Terrain) and not ground.uniform:
        _draw_contours(axes, ground)
    elif ground is not None:
        _draw_downhill(axes, ground)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x on the ground, forward at yaw 0 [m]")
    axes.set_ylabel("y on the ground, left at yaw 0 [m]")
    axes.grid(alpha=0.3)
    axes.legend(loc="best")


def _draw_footprint(
    axes: Axes, support: SupportPolygon, pose: Array, colour: str, linewidth: float
) -> None:
    """Draw the support polygon of a base at a pose x, y, yaw, with an arrow along its heading."""
    x, y, yaw = pose
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    corners = support.vertices @ turn.T + [x, y]
    axes.plot(*np.vstack([corners, corners[:1]]).T, color=colour, linewidth=linewidth)
    ahead = turn @ [float(support.vertices[:, 0].max()), 0.0]
    arrow = {"arrowstyle": "->", "color": colour, "linewidth": linewidth}
    axes.annotate("", xy=(x + ahead[0], y + ahead[1]), xytext=(x, y), arrowprops=arrow)


def _draw_bounds(axes: Axes, base: UnicycleBase) -> None:
    """Draw dashed lines at the bounds on the base's x and y."""
    lower, upper = base.position_bounds
    for axis, line in enumerate((axes.axvline, axes.axhline)):
        for bound in (lower[axis], upper[axis]):
            if np.isfinite(bound):
                line(bound, color="black", linestyle="--", linewidth=1.0)


def _draw_contours(axes: Axes, ground: Terrain) -> None:
    """Draw lines of equal height behind the path.

    They reach beyond the view, because equal scales of both axes may widen it.
    """
    drawn = axes.dataLim.frozen()
    view = np.array([axes.get_xlim(), axes.get_ylim()])  # (axis, side)
    around = float(np.ptp(view, axis=1).max())
    low, high = (
        np.clip(side, *ground.extent) for side in (view[:, 0] - around, view[:, 1] + around)
    )
    x, y = (np.linspace(low[axis], high[axis], SAMPLES) for axis in range(2))
    poses = np.column_stack([np.tile(x, SAMPLES), np.repeat(y, SAMPLES), np.zeros(SAMPLES**2)])
    heights = ground.base_pose(poses)[0][:, 2].reshape(SAMPLES, SAMPLES)
    if np.ptp(heights) > 0.0:
        lines = axes.contour(
            x,
            y,
            heights,
            levels=LINES,
            colors="tan",
            linewidths=0.7,
            linestyles="solid",
            zorder=0.5,
        )
        axes.clabel(lines, fmt="%g m", fontsize=7.0, inline_spacing=2)
    axes.dataLim.set(drawn)  # contour lines shall not widen the view
    axes.autoscale_view()


def _draw_downhill(axes: Axes, ground: Ground) -> None:
    """Draw an arrow downhill in a corner of the axes; none on level ground."""
    gravity = ground.gravity()
    down = gravity[:2] / np.linalg.norm(gravity)
    sine = float(np.linalg.norm(down))
    if sine > LEVEL:
        tip = 0.12 + 0.08 * down[0] / sine, 0.1 + 0.08 * down[1] / sine
        arrow = {"arrowstyle": "->", "color": "grey", "linewidth": 1.6}
        axes.annotate(
            "",
            xy=tip,
            xytext=(0.12, 0.1),
            xycoords="axes fraction",
            textcoords="axes fraction",
            arrowprops=arrow,
        )
        axes.annotate(
            "downhill", xy=(0.12, 0.02), xycoords="axes fraction", color="grey", ha="center"
        )
