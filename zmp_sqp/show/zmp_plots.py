"""Figure of ZMP loci in the support polygon."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ContactLost, ProblemError
from zmp_sqp.mechanics import SupportPolygon
from zmp_sqp.planning import Problem, Trajectory, trajectory_zmp
from zmp_sqp.show.canvas import new_figure, planner_colours, sample_times, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_loci", "plot_zmp"]

MEASURED_AT = 0.11  # share of the motion at which fig. 3 of the paper shows d_u and d_l
LEVEL = 1e-3  # sine of the steepest slope that gets no arrow downhill
SIDEWAYS = 1e-3  # cosine between heading and normal below which an edge is neither front nor rear
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

    The axes are those of the root frame (REP-103), x forward and y to the left, as in messages; the
    paper's figure is the same turned by 90 degrees. A margin that the problem asks for is dashed.
    Where an acceleration jumps, so does the ZMP; jumps are thin lines. Intervals on which the
    machine lifts off have no ZMP and are left out.

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
    draw_loci(
        figure,
        support,
        problem.gravity_at("start"),
        loci,
        margin=problem.margin,
        window=window,
        measured=measured,
    )
    save(figure, path)


def _locus(problem: Problem, trajectory: Trajectory, times: Array) -> Array:
    """ZMP in the root frame, shape (K, 2) [m]; NaN if the machine lifts off at any of the times."""
    try:
        return trajectory_zmp(problem.machine, trajectory, times, problem.ground)
    except ContactLost:
        return np.full((len(times), 2), np.nan)


def draw_loci(
    figure: Figure,
    support: SupportPolygon,
    gravity: Array,
    loci: Mapping[str, Sequence[Array]],
    *,
    margin: float = 0.0,
    window: float = 0.0,
    measured: str | None = None,
) -> None:
    """Draw support polygon, margin, ZMP loci, the downhill direction, and a legend above them.

    Args:
        figure: An empty figure.
        support: The support polygon.
        gravity: Gravity in the root frame, shape (3,) [m/s^2]; its horizontal part points downhill.
        loci: ZMP loci by planner; each is a list of pieces without jumps, arrays of shape (K, 2) in
            the root frame [m].
        margin: Distance from the edges that is asked for, drawn dashed; 0 draws none [m].
        window: Both axes reach from -window to window [m]; 0 fits them to the loci.
        measured: Name of the planner on whose locus d_u and d_l of eq. (21) are drawn; None draws
            none.
    """
    axes = figure.add_subplot()
    axes.plot(*_outline(support), color="black", linewidth=1.6, label="support polygon")
    if margin > 0.0:
        label = f"margin asked for: {margin:g} m"
        axes.plot(*_outline(support.inset(margin)), "k--", linewidth=1.0, label=label)
    colours = planner_colours(loci)
    for name, locus in loci.items():
        _draw_locus(axes, locus, name, colours[name])
    for marker, label in ((FIRST, "ZMP initial"), (LAST, "ZMP final")):  # for the legend alone
        axes.plot([], [], "w", marker=marker, linestyle="none", label=label, **MARKER)
    _draw_downhill(axes, gravity)
    if measured is not None and measured in loci:
        _draw_room(axes, support, loci[measured][int(MEASURED_AT * len(loci[measured]))][0])
    if window:
        axes.set(xlim=(-window, window), ylim=(-window, window))
    axes.set_aspect("equal", adjustable="box" if window else "datalim")
    axes.set_xlabel("x forward [m]")
    axes.set_ylabel("y left [m]")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=2)


def _draw_locus(axes: Axes, pieces: Sequence[Array], name: str, colour: str) -> None:
    """Draw one ZMP locus with markers at its ends; jumps between its pieces are thin lines.

    Args:
        axes: Axes x forward, y left.
        pieces: Pieces without jumps, shape (K, 2) each, in the root frame [m].
        name: Name of the planner.
        colour: Colour of the locus.
    """
    gap = np.full((1, 2), np.nan)
    axes.plot(*np.vstack(pieces).T, color=colour, linewidth=0.9, alpha=0.7)
    broken = np.vstack([row for piece in pieces for row in (piece, gap)])
    axes.plot(*broken.T, color=colour, linewidth=1.6, label=f"ZMP locus: {name}")
    for point, marker in ((pieces[0][0], FIRST), (pieces[-1][-1], LAST)):
        axes.plot(*point, color=colour, marker=marker, zorder=3, **MARKER)


def _draw_downhill(axes: Axes, gravity: Array) -> None:
    """Draw an arrow from the origin downhill, longer on steeper ground; none on level ground."""
    down = gravity[:2] / np.linalg.norm(gravity)
    if np.linalg.norm(down) > LEVEL:
        axes.annotate(
            "",
            xy=(2.0 * down[0], 2.0 * down[1]),
            xytext=(0.0, 0.0),
            arrowprops={"arrowstyle": "->", "color": "grey", "linewidth": 1.6},
        )
        axes.annotate(
            "downhill",
            xy=(1.2 * down[0], 1.2 * down[1]),
            xytext=(6.0, 0.0),
            textcoords="offset points",
            va="center",
            color="grey",
        )


def _draw_room(axes: Axes, support: SupportPolygon, point: Array) -> None:
    """Draw arrows from a ZMP along the heading to the front edge (d_u) and the rear edge (d_l)."""
    ahead, room = support.normals[:, 0], support.offsets - support.normals @ point
    for sign, name in ((1.0, "$d_u$"), (-1.0, "$d_l$")):
        facing = sign * ahead > SIDEWAYS
        end = point + np.array([sign * float((room[facing] / (sign * ahead[facing])).min()), 0.0])
        arrow = {"arrowstyle": "<->", "color": "dimgrey", "shrinkA": 0.0, "shrinkB": 0.0}
        axes.annotate("", xy=(end[0], end[1]), xytext=(point[0], point[1]), arrowprops=arrow)
        x, y = 0.5 * (point + end)
        axes.annotate(name, xy=(x, y), xytext=(0.0, 4.0), textcoords="offset points", ha="center")


def _outline(support: SupportPolygon) -> tuple[Array, Array]:
    """Closed outline of a polygon: x and y of its vertices, the first one twice [m]."""
    x, y = np.vstack([support.vertices, support.vertices[:1]]).T
    return x, y
