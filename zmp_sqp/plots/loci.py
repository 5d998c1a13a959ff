"""Figure of ZMP loci in the support polygon."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ContactLost, ProblemError
from zmp_sqp.mechanics import SupportPolygon
from zmp_sqp.planning import Plan, Problem, Trajectory, trajectory_zmp
from zmp_sqp.planning.constraints.guarantee import amount_in_words
from zmp_sqp.plots.canvas import ALARM, new_figure, planner_colours, sample_times
from zmp_sqp.plots.shown_motion import ShownMotion

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Ticks", "draw_loci", "loci_figure", "locus", "tick_step"]

MEASURED_AT = 0.11  # share of the motion at which fig. 3 of the paper shows d_u and d_l
LEVEL = 1e-3  # sine of the steepest slope that gets no arrow downhill
SIDEWAYS = 1e-3  # cosine between heading and normal below which an edge is neither front nor rear
FIRST, LAST = "o", "s"  # markers at the ends of a locus
MARKER: dict[str, Any] = {"markersize": 7, "markeredgecolor": "black"}
MOST_TICKS = 12  # along a locus; longer motions have one tick each 2, 5, 10 ... s
SHORT = 3.0  # [s] motions below have ticks between whole seconds, too
OUTSIDE = 1e-6  # [m] by which a ZMP is outside that is drawn so
FAR = 1.0  # sizes of the polygon around it that the axes show at most
NEAR = 0.07  # share of the axes within which ticks share one label
BOX = {"boxstyle": "round,pad=0.12", "facecolor": "white", "alpha": 0.75, "linewidth": 0.0}


@dataclass(frozen=True, slots=True, eq=False)
class Ticks:
    """Marks along a locus.

    Attributes:
        times: Times of the ticks within the motion, shape (K,) [s].
        step: Time between them [s].
        points: ZMP at these times, shape (K, 2) [m]; NaN where there is none.
        worst: ZMP where the margin is least, shape (2,) [m]; None marks none.
        label: What is guaranteed there, in words.
    """

    times: Array
    step: float
    points: Array
    worst: Array | None
    label: str


def locus(
    source: Plan | Problem,
    trajectory: Trajectory | None = None,
    *,
    beside: Mapping[str, Trajectory] | None = None,
    window: float = 0.0,
) -> Figure:
    """Path of the ZMP in the support polygon, with a tick at each whole second.

    The axes are those of the root frame (REP-103), x forward and y to the left, in metres, as in
    messages; a base that drives carries them. Where the ticks lie close the ZMP is slow. Start
    and end are marked, and the place where the margin is least. A margin that the problem asks for
    is dashed. Where an acceleration jumps, so does the ZMP: jumps are thin lines. What lies outside
    the polygon has a red halo. Intervals on which the machine lifts off have no ZMP and are
    left out.

    Args:
        source: A plan, whose last motion is drawn, safe or not; or a problem.
        trajectory: Motion of a problem; None for a plan.
        beside: Other motions of the machine by name, such as "phase plane"; without ticks.
        window: Both axes reach from -window to window [m]; 0 fits them to polygon and loci.

    Raises:
        MissingExtra: matplotlib is not installed.
        NotSolved: The plan has no motion at all.
        ProblemError: The machine has no support polygon, or an argument is of another kind.
    """
    shown = ShownMotion.of(source, trajectory)
    name = shown.planner if shown.safe else f"{shown.planner}, not safe"
    motions = {**(beside or {}), name: shown.trajectory}
    return loci_figure(shown.problem, motions, window=window, ticked=(name, _ticks(shown)))


def loci_figure(
    problem: Problem,
    trajectories: Mapping[str, Trajectory],
    *,
    window: float = 0.0,
    measured: str | None = None,
    ticked: tuple[str, Ticks] | None = None,
) -> Figure:
    """Figure of several loci, as fig. 3 of Song & Sharf 2020, which it shows turned by 90 degrees.

    Args:
        problem: Gives machine, support polygon and ground.
        trajectories: Motions by planner; "phase plane", "full model" and "simplified" have the
            paper's colours.
        window: Both axes reach from -window to window [m]; 0 fits them to the loci.
        measured: Name of the planner on whose locus d_u and d_l of eq. (21) are drawn; None draws
            none.
        ticked: Name of a planner, and the marks along its locus; None marks only ends.

    Raises:
        MissingExtra: matplotlib is not installed.
        ProblemError: The machine has no support polygon.
    """
    support = problem.machine.support
    if support is None:
        raise ProblemError(f"machine {problem.machine.name!r} has no support polygon to draw")
    figure = new_figure(width=6.4, height=7.0)
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
        ticked=ticked,
    )
    return figure


def tick_step(duration: float) -> float:
    """Time between ticks: 1 s, in long motions 2, 5, 10 ... s, in short ones 0.1, 0.2 or 0.5 s."""
    powers = range(12) if duration >= SHORT else range(-1, 0)
    steps = [factor * 10.0**power for power in powers for factor in (1.0, 2.0, 5.0)]
    return next((step for step in steps if step * MOST_TICKS >= duration), steps[-1])


def tick_labels(times: Array, points: Array, near: float) -> list[tuple[Array, str]]:
    """Points with their times in words; of points near each other, the first stands for all.

    Args:
        times: Increasing times, shape (K,) [s].
        points: Shape (K, 2) [m].
        near: Distance between two points below which they share a label [m].
    """
    groups: list[tuple[Array, list[str]]] = []
    for t, point in zip(times, points, strict=True):
        text = f"{t:.2f}".rstrip("0").rstrip(".")
        if groups and np.linalg.norm(groups[-1][0] - point) < near:
            groups[-1][1].append(text)
        else:
            groups.append((point, [text]))
    return [(point, " to ".join(dict.fromkeys([of[0], of[-1]])) + " s") for point, of in groups]


def _ticks(shown: ShownMotion) -> Ticks:
    """Marks at whole seconds, and where the certificate has the least margin."""
    problem, motion, found = shown.problem, shown.trajectory, shown.certificate
    step = tick_step(motion.duration)
    times = step * np.arange(1, int(np.ceil(motion.duration / step - 1e-9)), dtype=np.float64)
    points = [_locus(problem, motion, np.array([t])) for t in times]
    worst = _locus(problem, motion, np.array([min(max(found.margin_at, 0.0), motion.duration)]))[0]
    has = bool(np.isfinite(found.margin) and np.isfinite(worst).all())
    where = [found.tip_over.label, f"at {found.margin_at:.2f} s", found.corner]
    amount = amount_in_words(found.margin, "m") if has else ""
    label = f"least margin: {amount} guaranteed,\n{', '.join(word for word in where if word)}"
    return Ticks(
        times,
        step,
        np.vstack(points) if points else np.zeros((0, 2)),
        worst if has else None,
        label,
    )


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
    ticked: tuple[str, Ticks] | None = None,
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
        ticked: Name of a planner, and the marks along its locus; None marks only ends.
    """
    axes = figure.add_subplot()
    axes.plot(*_outline(support), color="black", linewidth=1.6, label="support polygon")
    if margin > 0.0:
        label = f"margin asked for: {margin:g} m"
        axes.plot(*_outline(support.inset(margin)), "k--", linewidth=1.0, label=label)
    colours = planner_colours([name.partition(",")[0] for name in loci])
    for name, pieces in loci.items():
        _draw_locus(axes, support, pieces, name, colours[name.partition(",")[0]])
    for marker, label in ((FIRST, "ZMP initial"), (LAST, "ZMP final")):  # for the legend alone
        axes.plot([], [], "w", marker=marker, linestyle="none", label=label, **MARKER)
    _draw_downhill(axes, gravity)
    if measured is not None and measured in loci:
        _draw_room(axes, support, loci[measured][int(MEASURED_AT * len(loci[measured]))][0])
    if window:
        axes.set(xlim=(-window, window), ylim=(-window, window))
    else:
        _limit_view(axes, support)
    axes.set_aspect("equal")
    axes.set_xlabel("x forward [m]")
    axes.set_ylabel("y left [m]")
    axes.grid(alpha=0.3)
    if ticked is not None:
        name, ticks = ticked
        _draw_ticks(axes, support, ticks, colours[name.partition(",")[0]])
    figure.legend(loc="outside upper center", ncols=2, fontsize=8.5)


def _limit_view(axes: Axes, support: SupportPolygon) -> None:
    """Let square axes show polygon and loci, but at most `FAR` around the polygon."""
    corners = support.vertices.min(axis=0), support.vertices.max(axis=0)
    reach = FAR * float((corners[1] - corners[0]).max())
    drawn = np.array([axes.get_xlim(), axes.get_ylim()]).T  # (side, axis)
    low, high = np.maximum(drawn[0], corners[0] - reach), np.minimum(drawn[1], corners[1] + reach)
    middle, half = 0.5 * (low + high), 0.5 * float((high - low).max())
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)


def _draw_ticks(axes: Axes, support: SupportPolygon, ticks: Ticks, colour: str) -> None:
    """Draw dots with their times at whole seconds, and a diamond where the margin is least.

    Labels lie away from the middle of the polygon.
    """
    style: dict[str, Any] = {"markeredgecolor": colour, "linestyle": "none", "zorder": 4}
    seen = np.isfinite(ticks.points).all(axis=1)
    if seen.any():
        style["label"] = f"each {ticks.step:g} s"
        axes.plot(*ticks.points[seen].T, "o", color="white", markersize=4.5, **style)
    near, middle = NEAR * float(np.ptp(axes.get_xlim())), support.vertices.mean(axis=0)
    for point, text in tick_labels(ticks.times[seen], ticks.points[seen], near):
        away = point - middle
        away = away / max(float(np.linalg.norm(away)), 1e-9)
        axes.annotate(
            text,
            (point[0], point[1]),
            xytext=(14.0 * away[0], 11.0 * away[1]),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=8,
            bbox=BOX,
            zorder=5,
            annotation_clip=True,
        )
    if ticks.worst is not None:
        worst: dict[str, Any] = {
            "marker": "D",
            "color": ALARM,
            "markeredgecolor": "white",
            "linestyle": "none",
        }
        axes.plot(*ticks.worst, markersize=7, zorder=6, label=ticks.label, **worst)


def _draw_locus(
    axes: Axes, support: SupportPolygon, pieces: Sequence[Array], name: str, colour: str
) -> None:
    """Draw one ZMP locus with markers at its ends; jumps between its pieces are thin lines.

    Args:
        axes: Axes x forward, y left.
        support: The support polygon, outside of which a locus is red.
        pieces: Pieces without jumps, shape (K, 2) each, in the root frame [m].
        name: Name of the planner.
        colour: Colour of the locus.
    """
    gap = np.full((1, 2), np.nan)
    axes.plot(*np.vstack(pieces).T, color=colour, linewidth=0.9, alpha=0.7)
    broken = np.vstack([row for piece in pieces for row in (piece, gap)])
    axes.plot(*broken.T, color=colour, linewidth=1.6, label=f"ZMP locus: {name}")
    outside = support.signed_distance(np.nan_to_num(broken)) < -OUTSIDE
    if outside.any():
        lost = np.where(outside[:, None], broken, np.nan)
        axes.plot(*lost.T, color=ALARM, linewidth=5.0, alpha=0.4, zorder=1.5)
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
