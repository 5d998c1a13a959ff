"""Figures of motions: ZMP loci, and joints over time.

matplotlib is an optional package, so it is imported only when a figure is drawn.
"""

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

# colours of the figures of Song & Sharf 2020, by planner
PLANNER_COLOURS = {"phase plane": "tab:green", "full model": "tab:red", "simplified": "tab:blue"}
OTHER_COLOURS = ("tab:purple", "tab:orange", "tab:brown", "tab:pink", "tab:olive", "tab:cyan")
# Okabe & Ito 2008: distinguishable with any colour vision
JOINT_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#666666")
LINE_STYLES = ("-", ":", "-.")  # of the joints, in turn once the colours are used up
MEASURED_AT = 0.11  # share of the motion at which fig. 3 of the paper shows d_u and d_l
LEVEL = 1e-3  # sine of the steepest slope that gets no arrow downhill
SIDEWAYS = 1e-3  # cosine between heading and normal below which an edge is neither front nor rear
RESOLUTION = 100  # [dots per inch]
FIRST, LAST = "o", "s"  # markers at the ends of a locus
MARKER: dict[str, Any] = {"markersize": 7, "markeredgecolor": "black"}


def plot_zmp(
    problem: Problem,
    trajectories: Mapping[str, Trajectory],
    path: str | Path,
    *,
    window: float = 0.0,
    measured: str | None = None,
) -> None:
    """Draw ZMP loci in the support polygon, as in fig. 3 of Song & Sharf 2020.

    The axes are the paper's: x to the right of the machine and y ahead of it, which are (-y, x) of
    the root frame. Where an acceleration jumps, so does the ZMP; jumps are thin lines. Intervals on
    which the machine lifts off have no ZMP and are left out.

    Args:
        problem: Gives machine, support polygon and ground.
        trajectories: Motions by planner; "phase plane", "full model" and "simplified" have the
            paper's colours.
        path: File to write; its ending chooses the format.
        window: Both axes reach from -window to window [m]; 0 fits them to the loci.
        measured: Name of the planner on whose locus d_u and d_l of eq. (21) are drawn; None draws
            none.

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
    """Draw support polygon, ZMP loci, the downhill direction, and a legend above them.

    Args:
        figure: An empty figure.
        support: The support polygon.
        gravity: Gravity in the root frame, shape (3,) [m/s^2]; its horizontal part points downhill.
        loci: ZMP loci by planner; each is a list of pieces without jumps, arrays of shape (K, 2) in
            the root frame [m].
        window: Both axes reach from -window to window [m]; 0 fits them to the loci.
        measured: Name of the planner on whose locus d_u and d_l of eq. (21) are drawn; None draws
            none.
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
        _draw_locus(axes, [_paper_axes(piece) for piece in locus], name, colours[name])
    for marker, label in ((FIRST, "ZMP initial"), (LAST, "ZMP final")):  # for the legend alone
        axes.plot([], [], "w", marker=marker, linestyle="none", label=label, **MARKER)
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


def _draw_locus(axes: Axes, pieces: Sequence[Array], name: str, colour: str) -> None:
    """Draw one ZMP locus with markers at its ends; jumps between its pieces are thin lines.

    Args:
        axes: Axes of the paper.
        pieces: Pieces without jumps, shape (K, 2) each, in the axes of the paper [m].
        name: Name of the planner.
        colour: Colour of the locus.
    """
    gap = np.full((1, 2), np.nan)
    axes.plot(*np.vstack(pieces).T, color=colour, linewidth=0.9, alpha=0.7)
    broken = np.vstack([row for piece in pieces for row in (piece, gap)])
    axes.plot(*broken.T, color=colour, linewidth=1.6, label=f"ZMP locus: {name}")
    for point, marker in ((pieces[0][0], FIRST), (pieces[-1][-1], LAST)):
        axes.plot(*point, color=colour, marker=marker, zorder=3, **MARKER)


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


def sample_times(trajectory: Trajectory, count: int = 600) -> list[Array]:
    """Times within each interval of a trajectory, its ends included.

    Accelerations jump at nodes. The last time of an interval is one rounding error before its end,
    so that the trajectory has the acceleration of that interval there, not of the next.

    Args:
        trajectory: The trajectory.
        count: Number of times in all, approximately.

    Returns:
        One array of times for each of the N intervals [s].
    """
    per_second = count / trajectory.duration if trajectory.duration > 0.0 else 0.0
    pieces = []
    for begin, end in zip(trajectory.times[:-1], trajectory.times[1:], strict=True):
        times = np.linspace(begin, end, 2 + int(per_second * (end - begin)))
        pieces.append(np.minimum(times, np.nextafter(end, begin)))
    return pieces


def joint_unit(machine: Machine) -> str:
    """Unit of the joint coordinates: "rad", "m", or "rad or m" if both occur."""
    sliding = len(sliding_joints(machine))
    return "rad" if sliding == 0 else "m" if sliding == machine.size else "rad or m"


def _locus(problem: Problem, trajectory: Trajectory, times: Array) -> Array:
    """ZMP in the root frame, shape (K, 2) [m]; NaN if the machine lifts off at any of the times."""
    try:
        return trajectory_zmp(problem.machine, trajectory, times, problem.ground)
    except ContactLost:
        return np.full((len(times), 2), np.nan)


def _paper_axes(points: Array) -> Array:
    """Points (forward, left) of the root frame as (right, forward), shape (K, 2)."""
    return np.column_stack([-points[:, 1], points[:, 0]])


def _draw_downhill(axes: Axes, gravity: Array) -> None:
    """Draw an arrow from the origin downhill, longer on steeper ground; none on level ground."""
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
    """Draw arrows from a ZMP along the heading to the front edge (d_u) and the rear edge (d_l)."""
    ahead, room = support.normals[:, 0], support.offsets - support.normals @ point
    for sign, name in ((1.0, "$d_u$"), (-1.0, "$d_l$")):
        facing = sign * ahead > SIDEWAYS
        end = point + np.array([sign * float((room[facing] / (sign * ahead[facing])).min()), 0.0])
        arrow = {"arrowstyle": "<->", "color": "dimgrey", "shrinkA": 0.0, "shrinkB": 0.0}
        [tail], [tip] = _paper_axes(point[None]), _paper_axes(end[None])
        axes.annotate("", xy=tip, xytext=tail, arrowprops=arrow)
        axes.annotate(
            name, xy=0.5 * (tail + tip), xytext=(4.0, 0.0), textcoords="offset points", va="center"
        )


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


def planner_colours(names: Iterable[str]) -> dict[str, str]:
    """Colours by planner: `PLANNER_COLOURS`, and `OTHER_COLOURS` in turn for other names."""
    others = [name for name in names if name not in PLANNER_COLOURS]
    return PLANNER_COLOURS | {
        name: OTHER_COLOURS[i % len(OTHER_COLOURS)] for i, name in enumerate(others)
    }


def new_figure(*, width: float, height: float) -> Figure:
    """Empty figure of the given size in inches; it needs no display and no state of pyplot."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure to a file; the ending of the path chooses the format."""
    figure.savefig(path, dpi=RESOLUTION)
