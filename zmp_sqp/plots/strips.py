"""Film strip: the machine at several instants of a motion, with ZMP and support polygon."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array, length_text, shortened
from zmp_sqp.errors import ContactLost, ProblemError
from zmp_sqp.mechanics import Heightmap
from zmp_sqp.planning import Plan, Problem, Trajectory, trajectory_zmp
from zmp_sqp.plots.canvas import ALARM, new_figure
from zmp_sqp.plots.loci import BOX, tick_labels
from zmp_sqp.plots.outlines import Outline, hull, machine_outlines
from zmp_sqp.plots.shown_motion import ShownMotion
from zmp_sqp.report.sampling import root_poses

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["film_strip"]

ZMP_COLOUR, SUPPORT_COLOUR, GROUND_COLOUR = "#f0e442", "#2e7d32", "#7a6a58"
MOST = 24  # instants
WIDE, COLUMN = 13.0, (1.9, 4.2)  # [in] of a strip, and least and largest width of a column
TALL = 5.5  # [in] largest height of overlaid instants
NEAR = 0.08  # share of the axes within which instants share one label
BORDER = 0.04  # free space around the machine, as a share of its size
FAINT = 0.16  # opacity of the first of overlaid instants
TRAIL = 200  # points of the ZMP's path
LEVEL = 1e-3  # share of gravity that a view must show for its arrow to be drawn
PROFILE = 200  # points of the line of a terrain


class _View(NamedTuple):
    """Direction from which the machine is seen.

    Attributes:
        title: The view in words.
        across, upwards: Axes of the ground frame on paper.
        labels: Labels of these axes.
        mirrored: Whether the first of them points to the left on paper.
    """

    title: str
    across: int
    upwards: int
    labels: tuple[str, str]
    mirrored: bool


FORWARD, LEFT, UP = "x forward [m]", "y left [m]", "z up [m]"
VIEWS = {
    "side": _View("from its right-hand side", 0, 2, (FORWARD, UP), mirrored=False),
    "top": _View("from above", 0, 1, (FORWARD, LEFT), mirrored=False),
    "rear": _View("from behind", 1, 2, (LEFT, UP), mirrored=True),
}


@dataclass(frozen=True, slots=True, eq=False)
class _Instant:
    """The machine at one time, in the ground frame.

    Attributes:
        time: [s].
        outlines: Points of each outline, shape (P, 3) [m].
        support: Corners of the support polygon, shape (V, 3) [m]; empty without one.
        zmp: Shape (3,) [m]; None where the ground would have to pull.
        room: Distance from the ZMP to the nearest edge, negative outside [m]; NaN without both.
        root: Origin of the root, shape (3,) [m].
    """

    time: float
    outlines: Sequence[Array]
    support: Array
    zmp: Array | None
    room: float
    root: Array


def film_strip(
    source: Plan | Problem,
    trajectory: Trajectory | None = None,
    *,
    count: int = 5,
    views: Sequence[str] = ("side", "top"),
    overlaid: bool = False,
    urdf: str | PathLike[str] | None = None,
    package_dirs: Sequence[str | Path] = (),
) -> Figure:
    """Machine at instants of a motion, evenly spaced in time, with ZMP and support polygon.

    The axes are those of the ground frame in metres: the root frame of a machine that stands; x
    forward at yaw 0 of one that drives. On a slope its z axis is normal to the slope, and an arrow
    shows the direction of gravity. Shapes are the convex hulls of those in the URDF; payloads are
    cylinders. The ZMP is that of payload and slope as given, red where it is outside.

    Args:
        source: A plan, whose last motion is drawn, safe or not; or a problem.
        trajectory: Motion of a problem; None for a plan.
        count: Number of instants, start and end included.
        views: Rows of the strip: "side", "top", "rear".
        overlaid: Whether all instants are in one picture, earlier ones fainter, instead of side by
            side.
        urdf: File or name from which the machine was loaded, for its shapes; None is that of a
            shipped machine with the same name and links, else bars join the joints.
        package_dirs: Folders of packages with meshes, as for `load_machine`.

    Raises:
        MachineError: There is no such URDF.
        MissingExtra: matplotlib is not installed.
        NotSolved: The plan has no motion at all.
        ProblemError: An argument is of another kind, or an unknown view.
    """
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MOST:
        raise ProblemError(f"count must be from 1 to {MOST}, not {shortened(count)}")
    unknown = [name for name in views if name not in VIEWS]
    if unknown or not views:
        raise ProblemError(f"views are {', '.join(VIEWS)}, not {shortened(unknown or views)}")
    shown = ShownMotion.of(source, trajectory)
    drawn = machine_outlines(shown.problem.machine, urdf, package_dirs)
    times = np.linspace(0.0, shown.trajectory.duration, count) if count > 1 else np.zeros(1)
    instants = [_instant(shown, float(t), drawn) for t in times]
    trail = _trail(shown)
    low, high = _extent(instants)
    chosen = [VIEWS[name] for name in views]
    if overlaid:
        figure, rows = _side_by_side(chosen, high - low)
    else:
        figure, rows = _grid(chosen, high - low, count)
    for row, view in zip(rows, chosen, strict=True):
        for column, axes in enumerate(row):
            those = instants if overlaid else [instants[column]]
            _draw(axes, shown.problem, view, those, drawn, trail)
            _frame(axes, view, low, high, labelled=column == 0)
        _titles(row, view, instants, overlaid=overlaid, first=view is chosen[0])
    return figure


def _grid(views: Sequence[_View], size: Array, count: int) -> tuple[Figure, Sequence[Any]]:
    """Figure with a row of axes for each view and a column for each instant."""
    wide = float(np.clip(WIDE / count, *COLUMN))
    heights = [wide * float(size[view.upwards] / size[view.across]) for view in views]
    height = sum(heights) + 0.75 * len(views) + 0.4
    figure = new_figure(width=wide * count + 0.6, height=height)
    rows: Any = figure.subplots(len(views), count, squeeze=False, height_ratios=heights)
    return figure, rows


def _side_by_side(views: Sequence[_View], size: Array) -> tuple[Figure, Sequence[Any]]:
    """Figure with the views beside each other, all in one scale."""
    across, upwards = [size[view.across] for view in views], [size[view.upwards] for view in views]
    scale = min(WIDE / sum(across), TALL / max(upwards))  # [in per m]
    figure = new_figure(
        width=scale * sum(across) + 0.7 * len(views), height=scale * max(upwards) + 0.9
    )
    [row] = figure.subplots(1, len(views), squeeze=False, width_ratios=across)
    return figure, [[axes] for axes in row]


def _instant(shown: ShownMotion, t: float, drawn: Sequence[Outline]) -> _Instant:
    problem, motion = shown.problem, shown.trajectory
    machine, support = problem.machine, problem.machine.support
    model, data = machine.model, machine.model.createData()
    pin.forwardKinematics(model, data, machine.configuration(motion(t)[0][None])[0])
    position, rotation = _root_at(shown, np.array([t]))
    outlines = []
    for outline in drawn:
        placement = data.oMi[outline.joint]
        points = outline.points @ placement.rotation.T + placement.translation
        outlines.append(points @ rotation[0].T + position[0])
    room, at, corners = np.nan, None, np.zeros((0, 3))
    height = 0.0 if support is None else support.height
    try:
        flat = trajectory_zmp(machine, motion, t, problem.ground)
        at = rotation[0] @ np.array([*flat, height]) + position[0]
    except ContactLost:
        flat = None
    if support is not None:
        raised = np.column_stack([support.vertices, np.full(len(support.vertices), height)])
        corners = raised @ rotation[0].T + position[0]
        if flat is not None:
            room = float(support.signed_distance(flat[None])[0])
    return _Instant(t, outlines, corners, at, room, position[0])


def _root_at(shown: ShownMotion, times: Array) -> tuple[Array, Array]:
    """Root in the ground frame at K times, positions (K, 3) [m] and rotations (K, 3, 3)."""
    base = shown.trajectory.base
    poses = np.zeros((len(times), 3)) if base is None else base(times)[0]
    return root_poses(shown.problem, poses)


def _trail(shown: ShownMotion) -> Array:
    """Path of the ZMP in the ground frame, shape (K, 3) [m]; NaN where there is none."""
    support = shown.problem.machine.support
    height = 0.0 if support is None else support.height
    times = np.linspace(0.0, shown.trajectory.duration, TRAIL)
    points = np.full((TRAIL, 3), np.nan)
    positions, rotations = _root_at(shown, times)
    for k, t in enumerate(times):
        try:
            flat = trajectory_zmp(
                shown.problem.machine, shown.trajectory, float(t), shown.problem.ground
            )
        except ContactLost:
            continue
        points[k] = rotations[k] @ np.array([*flat, height]) + positions[k]
    return points


def _extent(instants: Sequence[_Instant]) -> tuple[Array, Array]:
    """Lowest and highest coordinates of all that is drawn, with a border, (3,) each [m]."""
    points = np.vstack([part for one in instants for part in (*one.outlines, one.support)])
    low, high = points.min(axis=0), points.max(axis=0)
    border = BORDER * float((high - low).max()) + 1e-3
    return low - border, high + border


def _draw(
    axes: Axes,
    problem: Problem,
    view: _View,
    instants: Sequence[_Instant],
    drawn: Sequence[Outline],
    trail: Array,
) -> None:
    """Draw the instants into one picture, earlier ones fainter."""
    shown = [view.across, view.upwards]
    _draw_ground(axes, problem, view, instants[-1])
    for number, one in enumerate(instants):
        opacity = 1.0
        if len(instants) > 1:
            opacity = FAINT + (1.0 - FAINT) * (number / (len(instants) - 1)) ** 2
        for outline, points in zip(drawn, one.outlines, strict=True):
            corners = hull(points[:, shown])
            axes.fill(*corners.T, facecolor=outline.colour, alpha=0.55 * opacity, linewidth=0.0)
            look: dict[str, Any] = {"edgecolor": outline.colour, "linewidth": 0.8}
            axes.fill(*corners.T, fill=False, alpha=opacity, **look)
        _draw_support(axes, view, one, opacity)
    axes.plot(*trail[:, shown].T, color="black", linewidth=0.8, linestyle=":", zorder=5)
    for one in instants:
        if one.zmp is not None:
            colour = ALARM if one.room < 0.0 else ZMP_COLOUR
            style: dict[str, Any] = {"markeredgecolor": "black", "markersize": 6.5, "zorder": 6}
            axes.plot(*one.zmp[shown], "X" if one.room < 0.0 else "o", color=colour, **style)
    if len(instants) > 1 and view.upwards == 1:
        there = [(one.time, one.zmp[shown]) for one in instants if one.zmp is not None]
        times, points = np.array([t for t, _ in there]), np.array([at for _, at in there])
        near = NEAR * float(np.ptp(axes.get_xlim()))
        for (x, y), text in tick_labels(times, points, near):
            note: dict[str, Any] = {"textcoords": "offset points", "fontsize": 7.5, "zorder": 7}
            axes.annotate(text, (x, y), xytext=(6, 5), bbox=BOX, **note)


def _draw_support(axes: Axes, view: _View, one: _Instant, opacity: float) -> None:
    """Draw the outline of the support polygon, from the side a line or a narrow shape."""
    if not len(one.support):
        return
    corners = one.support[:, [view.across, view.upwards]]
    closed = np.vstack([corners, corners[:1]])
    axes.plot(*closed.T, color=SUPPORT_COLOUR, linewidth=2.2, alpha=opacity, zorder=4)


def _draw_ground(axes: Axes, problem: Problem, view: _View, last: _Instant) -> None:
    """Draw the ground as a line, and the direction of gravity where the ground leans."""
    ground = problem.ground
    if isinstance(ground, Heightmap) and view.upwards == 2:
        (low, high) = ground.extent
        along = np.linspace(low[view.across], high[view.across], PROFILE)
        poses = np.tile([*last.root[:2], 0.0], (PROFILE, 1))
        poses[:, view.across] = along
        heights = ground.base_pose(poses)[0][:, 2]
        axes.plot(along, heights, color=GROUND_COLOUR, linewidth=1.2, zorder=0.5)
    elif view.upwards == 2:
        axes.axhline(0.0, color=GROUND_COLOUR, linewidth=1.2, zorder=0.5)
    down = ground.gravity() if not isinstance(ground, Heightmap) else np.array([0.0, 0.0, -1.0])
    down = (down / np.linalg.norm(down))[[view.across, view.upwards]]
    leaning = abs(down[0]) if view.upwards == 2 else float(np.linalg.norm(down))
    if leaning > LEVEL:
        down = down / np.linalg.norm(down)
        sign = -1.0 if view.mirrored else 1.0
        start = (0.12, 0.9 - 0.18 * max(0.0, float(down[1])))
        end = (start[0] + 0.16 * sign * down[0], start[1] + 0.16 * down[1])
        place: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "axes fraction"}
        arrow = {"arrowstyle": "->", "color": "dimgrey", "linewidth": 1.4}
        axes.annotate("", xy=end, xytext=start, arrowprops=arrow, **place)
        words = "g" if view.upwards == 2 else "downhill"
        axes.annotate(
            words, (start[0] + 0.02, start[1]), xycoords="axes fraction", va="center", fontsize=8
        )


def _frame(axes: Axes, view: _View, low: Array, high: Array, *, labelled: bool) -> None:
    """Set range, labels and equal scales of one picture."""
    across = (low[view.across], high[view.across])
    axes.set(
        xlim=across[::-1] if view.mirrored else across,
        ylim=(low[view.upwards], high[view.upwards]),
        aspect="equal",
        xlabel=view.labels[0],
    )
    if labelled:
        axes.set_ylabel(view.labels[1])
    else:
        axes.tick_params(labelleft=False)
    axes.grid(alpha=0.25)


def _titles(
    row: Sequence[Axes], view: _View, instants: Sequence[_Instant], *, overlaid: bool, first: bool
) -> None:
    """Write the view, and in the first row the time and where the ZMP is."""
    if overlaid:
        row[0].set_title(view.title, fontsize=9.5)
        return
    for number, (axes, one) in enumerate(zip(row, instants, strict=True)):
        words = view.title if number == 0 else ""
        if first:
            words = "\n".join([f"{one.time:.2f} s", _room_in_words(one), words])
        unsafe = first and (one.zmp is None or one.room < 0.0)
        axes.set_title(words, fontsize=9, color=ALARM if unsafe else "black")


def _room_in_words(one: _Instant) -> str:
    if one.zmp is None:
        return "lifts off"
    if np.isnan(one.room):
        return ""
    return f"ZMP {length_text(abs(one.room))} {'outside' if one.room < 0.0 else 'inside'}"
