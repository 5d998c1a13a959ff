"""Figures of motions. matplotlib is an extra: it is imported when a figure is drawn, not before."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ContactLost, ProblemError
from zmp_sqp.mechanics import Ground, Machine, SupportPolygon
from zmp_sqp.planning import Problem, Trajectory, UnicycleBase, trajectory_zmp
from zmp_sqp.scenario import sliding_joints
from zmp_sqp.show.base_plots import draw_base, draw_plan_view

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "PLANNER_COLOURS",
    "draw_loci",
    "joint_unit",
    "new_figure",
    "planner_colours",
    "plot_joints",
    "plot_zmp",
    "sample_times",
    "save",
]

# the paper's
PLANNER_COLOURS = {"phase plane": "tab:green", "full model": "tab:red", "simplified": "tab:blue"}
OTHER_COLOURS = ("tab:purple", "tab:orange", "tab:brown", "tab:pink", "tab:olive", "tab:cyan")
# Okabe & Ito 2008
JOINT_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#666666")
LINE_STYLES = ("-", ":", "-.")  # once the colours are used up
MEASURED_AT = 0.11  # of the motion, where fig. 3 shows d_u and d_l
LEVEL = 1e-3  # sine of a slope that is not worth an arrow
RESOLUTION = 100  # [dots per inch]


def plot_zmp(
    problem: Problem,
    trajectories: Mapping[str, Trajectory],
    path: str | Path,
    *,
    window: float = 0.0,
    measured: str | None = None,
) -> None:
    """Draw ZMP loci in the support polygon: fig. 3 of Song & Sharf 2020.

    The axes are the paper's, x to the right of the machine and y ahead of it: (-y, x) of the root
    frame. The ZMP jumps where an acceleration does; a jump is a thin line. Intervals on which the
    machine lifts off have no ZMP and are left out.

    Args:
        problem: Gives machine, support polygon and ground.
        trajectories: Motions by planner; "phase plane", "full model" and "simplified" have the
            paper's colours.
        path: File to write; its ending chooses the format.
        window: As in `draw_loci` [m].
        measured: As in `draw_loci`.

    Raises:
        ProblemError: The machine has no support polygon.
    """
    support = problem.machine.support
    if support is None:
        raise ProblemError(f"machine {problem.machine.name!r} has no support polygon to draw")
    figure = new_figure(width=5.4, height=6.0)
    loci = {
        name: [_locus(problem, trajectory, times) for times in sample_times(trajectory)]
        for name, trajectory in trajectories.items()
    }
    draw_loci(figure, support, problem.gravity_at("start"), loci, window=window, measured=measured)
    save(figure, path)


def draw_loci(
    figure: Figure,
    support: SupportPolygon,
    gravity: Array,
    loci: Mapping[str, Sequence[Array]],
    *,
    window: float = 0.0,
    measured: str | None = None,
) -> None:
    """Draw support polygon, ZMP loci with their ends, and the way downhill; the legend stands above.

    Args:
        figure: An empty one.
        support: The polygon.
        gravity: In the root frame, which tells the way downhill, shape (3,) [m/s^2].
        loci: By planner; one array (K, 2) of ZMPs in the root frame for each piece without a jump
            [m].
        window: Both axes reach from -window to window, as the paper's do [m]; 0 fits them to what
            is drawn.
        measured: From a point of this planner's locus, d_u and d_l of eq. (21) are drawn; None
            draws none.
    """
    axes = figure.add_subplot()
    vertices = support.vertices  # (V, 2)
    axes.plot(
        *_paper_axes(np.vstack([vertices, vertices[:1]])).T,
        color="black",
        linewidth=1.6,
        label="support polygon",
    )
    colours = planner_colours(loci)
    for name, locus in loci.items():
        pieces = [_paper_axes(piece) for piece in locus]
        gap = np.full((1, 2), np.nan)
        axes.plot(*np.vstack(pieces).T, color=colours[name], linewidth=0.9, alpha=0.7)
        broken = np.vstack([row for piece in pieces for row in (piece, gap)])
        axes.plot(*broken.T, color=colours[name], linewidth=1.6, label=f"ZMP locus: {name}")
        for point, marker in ((pieces[0][0], "o"), (pieces[-1][-1], "s")):
            axes.plot(
                *point,
                color=colours[name],
                marker=marker,
                markersize=7,
                markeredgecolor="black",
                zorder=3,
            )
    for marker, label in (("o", "ZMP initial"), ("s", "ZMP final")):
        axes.plot(
            [],
            [],
            "w",
            marker=marker,
            markersize=7,
            markeredgecolor="black",
            linestyle="none",
            label=label,
        )
    _draw_downhill(axes, gravity)
    if measured is not None and measured in loci:
        _draw_room(axes, support, loci[measured][int(MEASURED_AT * len(loci[measured]))][0])
    if window:
        axes.set(xlim=(-window, window), ylim=(-window, window))
    axes.set_aspect("equal", adjustable="box" if window else "datalim")
    axes.set_xlabel("x, to the right of the machine [m]")
    axes.set_ylabel("y, ahead of the machine [m]")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=2)


def plot_joints(
    machine: Machine,
    trajectory: Trajectory,
    path: str | Path,
    *,
    base: UnicycleBase | None = None,
    ground: Ground | None = None,
) -> None:
    """Draw joint accelerations, rates and angles over time: fig. 4 (a-c) of Song & Sharf 2020; and the base's motion.

    Limits are dashed: black where several joints share one, else in the joint's colour. Position
        limits far from the
    motion are left out. A base that moves has columns of its own: way, speed, yaw, yaw rate, and
    its path seen from above.

    Args:
        machine: Gives the limits.
        trajectory: The motion.
        path: File to write; its ending chooses the format.
        base: Gives the base's limits.
        ground: For the way downhill beside the base's path.
    """
    limits, unit = machine.limits, joint_unit(machine)
    times = np.concatenate(sample_times(trajectory))
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
    drive = trajectory.base
    figure = new_figure(width=6.4 if drive is None else 15.0, height=7.2)
    parts: Any = (
        [figure] if drive is None else figure.subfigures(1, 3, width_ratios=(6.0, 4.0, 5.0))
    )
    for axes, (label, values, lower, upper) in zip(
        parts[0].subplots(3, 1, sharex=True), panels, strict=True
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
    parts[0].legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=6)
    if drive is not None:
        draw_base(parts[1].subplots(4, 1, sharex=True), drive, base, times)
        if machine.support is not None:
            draw_plan_view(parts[2].subplots(), drive, machine.support, base, ground)
    save(figure, path)


def sample_times(trajectory: Trajectory, count: int = 600) -> list[Array]:
    """Times within each interval of a trajectory, both ends included, about `count` in all.

    An interval's last time stands one rounding error before its end, so that the trajectory is
    evaluated with the acceleration inside the interval and not with the next one.

    Returns:
        One array for each of the N intervals [s].
    """
    per_second = count / trajectory.duration if trajectory.duration > 0.0 else 0.0
    pieces = []
    for begin, end in zip(trajectory.times[:-1], trajectory.times[1:], strict=True):
        times = np.linspace(begin, end, 2 + int(per_second * (end - begin)))
        pieces.append(np.minimum(times, np.nextafter(end, begin)))
    return pieces


def joint_unit(machine: Machine) -> str:
    """Unit of the joint coordinates: rad, m, or both."""
    sliding = len(sliding_joints(machine))
    return "rad" if sliding == 0 else "m" if sliding == machine.size else "rad or m"


def _locus(problem: Problem, trajectory: Trajectory, times: Array) -> Array:
    """ZMP at times within one interval, shape (K, 2) [m]; NaN if the machine lifts off."""
    try:
        return trajectory_zmp(problem.machine, trajectory, times, problem.ground)
    except ContactLost:
        return np.full((len(times), 2), np.nan)


def _paper_axes(points: Array) -> Array:
    """(K, 2) points (forward, left) of the root frame as (right, forward), the paper's x0 and y0."""
    return np.column_stack([-points[:, 1], points[:, 0]])


def _draw_downhill(axes: Axes, gravity: Array) -> None:
    """Arrow from the origin down the slope, as long as the slope is steep; none on level ground."""
    down = gravity[:2] / np.linalg.norm(gravity)
    if np.linalg.norm(down) > LEVEL:
        [tip] = _paper_axes(2.0 * down[None])
        axes.annotate(
            "",
            xy=tip,
            xytext=(0.0, 0.0),
            arrowprops={"arrowstyle": "->", "color": "grey", "linewidth": 1.6},
        )
        axes.annotate(
            "downhill", xy=(0.0, 0.0), xytext=(6.0, -12.0), textcoords="offset points", color="grey"
        )


def _draw_room(axes: Axes, support: SupportPolygon, point: Array) -> None:
    """Arrows from a ZMP along the heading to the front edge (d_u) and to the rear one (d_l)."""
    ahead, room = support.normals[:, 0], support.offsets - support.normals @ point
    for sign, name in ((1.0, "$d_u$"), (-1.0, "$d_l$")):
        facing = sign * ahead > LEVEL
        end = point + np.array([sign * float((room[facing] / (sign * ahead[facing])).min()), 0.0])
        arrow = {"arrowstyle": "<->", "color": "dimgrey", "shrinkA": 0.0, "shrinkB": 0.0}
        [tail], [tip] = _paper_axes(point[None]), _paper_axes(end[None])
        axes.annotate("", xy=tip, xytext=tail, arrowprops=arrow)
        axes.annotate(
            name, xy=0.5 * (tail + tip), xytext=(4.0, 0.0), textcoords="offset points", va="center"
        )


def _draw_limits(axes: Axes, bounds: Array, *, everything: bool) -> None:
    """Dash the bounds, the lower ones of the n joints, then the upper ones; all, or those within the axes' range."""
    low, high = axes.get_ylim()
    for bound in np.unique(bounds):
        joints = np.flatnonzero(bounds == bound) % (len(bounds) // 2)
        if everything or low <= bound <= high:
            colour = _joint_colour(joints[0]) if len(joints) == 1 else "black"
            axes.axhline(bound, color=colour, linestyle="--", linewidth=1.0)


def _joint_colour(joint: int) -> str:
    return JOINT_COLOURS[joint % len(JOINT_COLOURS)]


def planner_colours(names: Iterable[str]) -> dict[str, str]:
    """Colours by planner: the paper's for its own, others in turn."""
    others = [name for name in names if name not in PLANNER_COLOURS]
    return PLANNER_COLOURS | {
        name: OTHER_COLOURS[i % len(OTHER_COLOURS)] for i, name in enumerate(others)
    }


def new_figure(*, width: float, height: float) -> Figure:
    """Figure of that size in inches that needs no display and leaves no state in matplotlib.pyplot."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure; the path's ending chooses the format."""
    figure.savefig(path, dpi=RESOLUTION)
