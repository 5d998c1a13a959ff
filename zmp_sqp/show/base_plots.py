"""The base in figures: way, speed, yaw and yaw rate over time, and its path on the ground with footprints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics import Ground, SupportPolygon, Terrain
from zmp_sqp.planning import UnicycleBase, UnicycleMotion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

__all__ = ["draw_base", "draw_plan_view"]

LABELS = ("way [m]", "speed [m/s]", "yaw [rad]", "yaw rate [rad/s]")
# of the path, and of the footprints at its ends
COLOUR, FIRST, LAST = "tab:red", "tab:green", "tab:blue"
APART = 1.2  # [m or rad] along the way, or of yaw: footprints between the ends
LEVEL = 1e-3  # sine of a slope that is not worth an arrow
SAMPLES = 121  # of the heights, in either direction
LINES = 24  # of equal height, at most, in and around the view
ROOM = 0.15  # of a limit, above and below


def draw_base(
    axes: Sequence[Axes], motion: UnicycleMotion, base: UnicycleBase | None, times: Array
) -> None:
    """Way along the heading, speed, yaw and yaw rate; limits of the rates are dashed.

    Args:
        axes: Four, for `LABELS`.
        motion: The base's.
        base: Gives the limits; None draws none.
        times: Within the motion, growing, shape (K,) [s].
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
        elif limit is not None:  # far below it: it would flatten the curve
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
    """The path seen from above, footprints along it, x and y bounds dashed, the way downhill or contour lines.

    Args:
        axes: Empty ones.
        motion: The base's.
        support: The footprint, in the base's own axes.
        base: Gives x and y bounds; None draws none.
        ground: For its slope, an arrow, or for the heights of a map, contour lines with labels in
            metres; None for neither.
    """
    times = np.linspace(0.0, float(motion.times[-1]), 400)
    pose, velocity, _ = motion(times)
    gone = np.append(0.0, np.cumsum(np.diff(times) * np.abs(velocity[1:]).max(axis=1)))
    between = np.searchsorted(gone, np.arange(APART, gone[-1] - 0.5 * APART, APART))
    for k, colour, label in [
        *((k, "silver", None) for k in between),
        (0, FIRST, "start"),
        (len(times) - 1, LAST, "goal"),
    ]:
        x, y, yaw = pose[k]
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        corners = support.vertices @ turn.T + [x, y]
        axes.plot(
            *np.vstack([corners, corners[:1]]).T,
            color=colour,
            linewidth=1.0 if label is None else 1.6,
        )
        ahead = turn @ [float(support.vertices[:, 0].max()), 0.0]
        arrow = {"arrowstyle": "->", "color": colour, "linewidth": 1.0 if label is None else 1.6}
        axes.annotate("", xy=(x + ahead[0], y + ahead[1]), xytext=(x, y), arrowprops=arrow)
        if label is not None:
            axes.plot([], [], color=colour, label=label)
    axes.plot(*pose[:, :2].T, color=COLOUR, linewidth=2.0, label="path")
    if base is not None:
        lower, upper = base.position_bounds
        for bounds, line in (
            ((lower[0], upper[0]), axes.axvline),
            ((lower[1], upper[1]), axes.axhline),
        ):
            for bound in bounds:
                if np.isfinite(bound):
                    line(bound, color="black", linestyle="--", linewidth=1.0)
    if isinstance(ground, Terrain) and not ground.uniform:
        _draw_contours(axes, ground)
    elif ground is not None:
        _draw_downhill(axes, ground)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x on the ground [m]")
    axes.set_ylabel("y on the ground [m]")
    axes.grid(alpha=0.3)
    axes.legend(loc="best")


def _draw_contours(axes: Axes, ground: Terrain) -> None:
    """Lines of equal height behind what is drawn, and around it as far as equal scales may widen the view."""
    # (axis, side)
    drawn, view = axes.dataLim.frozen(), np.array([axes.get_xlim(), axes.get_ylim()])
    around = float(np.ptp(view, axis=1).max())
    low, high = (
        np.clip(side, *ground.extent) for side in (view[:, 0] - around, view[:, 1] + around)
    )
    x, y = (np.linspace(low[axis], high[axis], SAMPLES) for axis in range(2))
    places = np.column_stack([np.tile(x, SAMPLES), np.repeat(y, SAMPLES), np.zeros(SAMPLES**2)])
    heights = ground.base_pose(places)[0][:, 2].reshape(SAMPLES, SAMPLES)
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
    axes.dataLim.set(drawn)  # the lines shall not widen it
    axes.autoscale_view()


def _draw_downhill(axes: Axes, ground: Ground) -> None:
    """Arrow in a corner; none on level ground."""
    gravity = ground.gravity()
    down = gravity[:2] / np.linalg.norm(gravity)
    steep = float(np.linalg.norm(down))
    if steep > LEVEL:
        tip = 0.12 + 0.08 * down[0] / steep, 0.1 + 0.08 * down[1] / steep
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
