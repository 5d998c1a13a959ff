"""Picture of a machine from the side and from above, with what decides whether it stands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array, length_text
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.inspection import Inspection, PoseReport
from zmp_sqp.mechanics.summary import mass_text
from zmp_sqp.plots.canvas import new_figure
from zmp_sqp.plots.outlines import hull, joint_colours, shapes_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["machine"]

ZMP_COLOUR, SUPPORT_COLOUR, TIP_COLOUR = "#c00000", "#2e7d32", "#6a1b9a"
COLUMN = 5.6  # [inch] width of one pose
SHORTEST, TALLEST = 2.0, 5.5  # [inch] height of one view
BORDER = 0.06  # free space around the machine, as a share of its size
NEGLIGIBLE = 1e-4  # share of the machine's mass up to which a link without shape is not drawn
LETTER, LINE = 0.066, 0.15  # [inch] width of a letter and height of a line of joint names
TOGETHER = 0.025  # share of the machine's size within which joints share one label
ARROW = 0.12  # length of the root frame's arrows, as a share of the machine's size
MOST_NAMED_EDGES = 8  # edges of a polygon that are labelled


class _View(NamedTuple):
    """Direction from which the machine is seen; the root's x axis points to the right on paper.

    Attributes:
        title: The view in words.
        vertical: Index of the root axis that points upwards on paper.
        label: Label of that axis.
        arrow: Name of that axis's direction.
    """

    title: str
    vertical: int
    label: str
    arrow: str


SIDE = _View("seen from its right-hand side", 2, "z up [m]", "up")
TOP = _View("seen from above", 1, "y left [m]", "left")


class _Scene(NamedTuple):
    """One pose, ready to be drawn.

    Attributes:
        found: What was understood of the machine.
        pose: The pose.
        origins: Origin of each link, root frame, (3,) [m], by index of its frame.
        outlines: Corner points of the shapes, root frame, (P, 3) [m], each with its colour.
        colours: Colour of each joint's links, by index of the joint in the Pinocchio model.
    """

    found: Inspection
    pose: PoseReport
    origins: Mapping[int, Array]
    outlines: Sequence[tuple[Array, str]]
    colours: Mapping[int, str]


def machine(
    found: Inspection,
    urdf: str | PathLike[str] | None = None,
    *,
    package_dirs: Sequence[str | Path] = (),
    poses: Sequence[str] | None = None,
) -> Figure:
    """Machine at rest, one pose beside the other, from the side and from above.

    The axes are those of the root frame (REP-103) in metres. At rest the ZMP lies where the
    vertical through the centre of mass meets the ground; the two are joined by a dashed line. The
    shapes are the convex hulls of those in the URDF; links without shapes are lines between joints.

    Args:
        found: Made by `inspect`.
        urdf: File or name from which the machine was loaded, for its shapes; None is that of a
            shipped machine with the same name and links, and no shapes otherwise.
        package_dirs: Folders of packages with meshes, as for `load_machine`.
        poses: Names of the poses to draw; None draws all.

    Raises:
        MachineError: There is no such file, or no such pose.
        MissingExtra: matplotlib is not installed.
    """
    known = [pose.name for pose in found.poses]
    for name in poses or ():
        if name not in known:
            raise MachineError(f"there is no pose {name!r}; poses are {', '.join(known)}")
    shapes = shapes_of(found.machine, urdf, package_dirs)
    scenes = [
        _scene(found, pose, shapes) for pose in found.poses if poses is None or pose.name in poses
    ]
    low, high = _extent(scenes)
    heights = [float(COLUMN / (high[0] - low[0]) * (high - low)[i]) for i in (2, 1)]
    figure = new_figure(width=max(COLUMN * len(scenes), 6.5), height=sum(heights) + 2.7)
    grid = figure.add_gridspec(2, len(scenes), height_ratios=heights)
    for column, scene in enumerate(scenes):
        for row, view in enumerate((SIDE, TOP)):
            axes = figure.add_subplot(grid[row, column])
            axes.set(xlim=(low[0], high[0]), ylim=(low[view.vertical], high[view.vertical]))
            axes.set_aspect("equal", adjustable="box")
            _draw(axes, scene, view, size=float((high - low).max()))
    title = f"{found.machine.name}: {mass_text(found.machine.mass)}"
    figure.suptitle(title, fontsize=12)
    entries: dict[str, Any] = {}
    for axes in figure.axes:
        handles, labels = axes.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    figure.legend(
        entries.values(), entries.keys(), loc="outside lower center", ncols=3, fontsize=8.5
    )
    return figure


def _scene(found: Inspection, pose: PoseReport, shapes: Mapping[str, Sequence[Array]]) -> _Scene:
    model = found.machine.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, found.machine.configuration(pose.q[None])[0])
    colours = joint_colours(found.machine)
    outlines = []
    for link in found.links:
        placement = data.oMf[link.frame]
        for points in shapes.get(link.name, ()) if link.motion != "payload" else ():
            placed = points @ placement.rotation.T + placement.translation
            outlines.append((placed, colours[model.frames[link.frame].parentJoint]))
    bare = _without_substance(found, shapes)
    origins = {
        link.frame: np.array(data.oMf[link.frame].translation)
        for link in found.links
        if link.frame not in bare
    }
    return _Scene(found, pose, origins, outlines, colours)


def _without_substance(found: Inspection, shapes: Mapping[str, Sequence[Array]]) -> set[int]:
    """Frames of links with hardly any mass, no shape and no load, and nothing else on them."""
    bare: set[int] = set()
    carrying: set[int] = set()
    for link in reversed(found.links):  # links come before those that hang on them
        planned_or_drawn = link.planned or link.name in shapes or link.name == found.tip
        heavy = link.mass > NEGLIGIBLE * found.machine.mass
        if heavy or planned_or_drawn or link.frame in carrying or not link.parent_frame:
            carrying.add(link.parent_frame)
        else:
            bare.add(link.frame)
    return bare


def _extent(scenes: Sequence[_Scene]) -> tuple[Array, Array]:
    """Lowest and highest coordinates of all that is drawn, with a border, (3,) each [m]."""
    points = [np.zeros((1, 3))]
    for scene in scenes:
        points += [outline for outline, _ in scene.outlines]
        points += [
            np.array(list(scene.origins.values())),
            scene.pose.com[None],
            scene.pose.tip[None],
        ]
        support = scene.found.machine.support
        if support is not None:
            flat = np.vstack([support.vertices, scene.pose.zmp[None]])
            flat = flat[np.isfinite(flat).all(axis=1)]
            points.append(np.column_stack([flat, np.full(len(flat), support.height)]))
    everything = np.vstack(points)
    low, high = everything.min(axis=0), everything.max(axis=0)
    size = float((high - low).max())
    sides = high - low + 2.0 * (BORDER * size + 1e-3)
    sides[0] = max(sides[0], sides[1:].max() * COLUMN / TALLEST)
    sides[1:] = np.maximum(sides[1:], sides[0] * SHORTEST / COLUMN)
    middle = 0.5 * (low + high)
    return middle - 0.5 * sides, middle + 0.5 * sides


def _draw(axes: Axes, scene: _Scene, view: _View, *, size: float) -> None:
    shown = [0, view.vertical]
    for points, colour in scene.outlines:
        corners = hull(points[:, shown])
        axes.fill(*corners.T, facecolor=colour, alpha=0.22, linewidth=0.0, zorder=1)
        axes.fill(*corners.T, fill=False, edgecolor=colour, linewidth=0.9, zorder=2)
    model = scene.found.machine.model
    for link in scene.found.links:
        if link.parent_frame and link.frame in scene.origins:
            ends = np.array([scene.origins[link.parent_frame], scene.origins[link.frame]])
            colour = scene.colours[model.frames[link.parent_frame].parentJoint]
            axes.plot(*ends[:, shown].T, color=colour, linewidth=1.8, zorder=3)
    if view is TOP:
        _draw_support(axes, scene)
    else:
        _draw_ground(axes, scene)
    _draw_joints(axes, scene, shown, size if view is SIDE else None)
    _draw_points(axes, scene, view)
    _draw_root(axes, view, ARROW * size)
    axes.set_xlabel("x forward [m]")
    axes.set_ylabel(view.label)
    axes.grid(alpha=0.25)
    axes.set_title(_title(scene, view), fontsize=9.5)


def _title(scene: _Scene, view: _View) -> str:
    if view is TOP:
        return view.title
    pose, words = scene.pose, "no support polygon is known"
    if np.isfinite(pose.margin):
        edge = pose.edge if pose.edge.startswith("edge") else f"the {pose.edge} edge"
        words = (
            f"stands: ZMP {length_text(pose.margin)} inside {edge}"
            if pose.margin > 0.0
            else f"TIPS OVER: ZMP {length_text(-pose.margin)} outside {edge}"
        )
    if pose.tipping is not None and 0.0 < pose.tipping.mass < np.inf:
        words += f"\ntips over with {mass_text(pose.tipping.mass)} more at {scene.found.tip}"
    return f"pose '{pose.name}'\n{words}\n{view.title}"


def _draw_support(axes: Axes, scene: _Scene) -> None:
    """Draw the support polygon from above, with names of edges and the margin of the ZMP."""
    support = scene.found.machine.support
    if support is None:
        return
    axes.fill(
        *support.vertices.T,
        facecolor=SUPPORT_COLOUR,
        alpha=0.12,
        linewidth=0.0,
        zorder=0,
    )
    axes.fill(
        *support.vertices.T,
        fill=False,
        edgecolor=SUPPORT_COLOUR,
        linewidth=2.2,
        zorder=4,
        label="support polygon (where it touches the ground)",
    )
    middles = 0.5 * (support.vertices + np.roll(support.vertices, -1, axis=0))
    for i, (middle, normal) in enumerate(zip(middles, support.normals, strict=True)):
        if len(middles) <= MOST_NAMED_EDGES:
            axes.annotate(
                support.edge_name(i),
                middle,
                xytext=8.0 * normal,
                textcoords="offset points",
                color=SUPPORT_COLOUR,
                fontsize=8,
                ha="center",
                va="center",
                rotation=90.0 if abs(normal[0]) > abs(normal[1]) else 0.0,
            )
    point = scene.pose.zmp
    if np.isfinite(point).all():
        room = support.offsets - support.normals @ point
        edge = int(np.argmin(room))
        foot = point + room[edge] * support.normals[edge]
        axes.plot(*np.array([point, foot]).T, color=ZMP_COLOUR, linewidth=1.2, zorder=6)


def _draw_ground(axes: Axes, scene: _Scene) -> None:
    """Draw the support plane from the side, thick where the machine touches it."""
    support = scene.found.machine.support
    if support is None:
        return
    axes.axhline(support.height, color="#7a6a58", linewidth=0.8, zorder=0)
    ends = [support.vertices[:, 0].min(), support.vertices[:, 0].max()]
    axes.plot(ends, [support.height] * 2, color=SUPPORT_COLOUR, linewidth=3.0, zorder=4)


def _draw_joints(axes: Axes, scene: _Scene, shown: list[int], size: float | None) -> None:
    """Draw a dot on each planned joint, with names if the machine's size [m] is given.

    Joints at one place share a label.
    """
    origins = {
        link.joint: scene.origins[link.frame][shown] for link in scene.found.links if link.planned
    }
    dots = np.array(list(origins.values()))
    axes.plot(
        *dots.T,
        linestyle="none",
        marker="o",
        color="white",
        markeredgecolor="black",
        markersize=5.5,
        zorder=7,
        label="planned joint",
    )
    if size is not None:
        _write_names(axes, origins, size)


def _write_names(axes: Axes, origins: Mapping[str, Array], size: float) -> None:
    """Write the names of joints beside their dots, as far as there is room for them."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    inch = (right - left) / COLUMN  # [m] on paper
    taken: list[tuple[float, float, float, float]] = []
    for at, names in _groups(origins, TOGETHER * size):
        text = ", ".join(names) if len(names) < 3 else f"{names[0]} ... {names[-1]}"
        width, height = LETTER * inch * len(text), LINE * inch
        for dx, dy in ((0.08, 0.03), (0.08, -0.17), (-0.08 - width / inch, 0.03), (0.08, 0.2)):
            x, y = at[0] + dx * inch, at[1] + dy * inch
            box = (x, x + width, y, y + height)
            inside = left < box[0] and box[1] < right and low < box[2] and box[3] < high
            if inside and not any(_overlap(box, other) for other in taken):
                taken.append(box)
                note = axes.text(x, y, text, fontsize=8, va="bottom", zorder=9)
                note.set_bbox({"boxstyle": "round,pad=0.1", "fc": "white", "alpha": 0.7, "lw": 0})
                break


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    """Whether two boxes (left, right, low, high) overlap."""
    return a[0] < b[1] and b[0] < a[1] and a[2] < b[3] and b[2] < a[3]


def _groups(origins: Mapping[str, Array], distance: float) -> list[tuple[Array, list[str]]]:
    """Points that lie apart by more than a distance, each with the names of all that are near."""
    groups: list[tuple[Array, list[str]]] = []
    for name, at in origins.items():
        near = next((g for g in groups if np.linalg.norm(g[0] - at) < distance), None)
        if near is None:
            groups.append((at, [name]))
        else:
            near[1].append(name)
    return groups


def _draw_points(axes: Axes, scene: _Scene, view: _View) -> None:
    """Draw centre of mass, ZMP, and the point at which the tipping load hangs."""
    pose, support = scene.pose, scene.found.machine.support
    height = 0.0 if support is None else support.height
    com, tip = pose.com[[0, view.vertical]], pose.tip[[0, view.vertical]]
    point = np.array([*pose.zmp, height])[[0, view.vertical]]
    style: dict[str, Any] = {"linestyle": "none", "markeredgecolor": "black", "zorder": 8}
    axes.plot(*np.array([com, point]).T, color=ZMP_COLOUR, linewidth=1.0, linestyle="--", zorder=5)
    load = f"load point: {scene.found.tip}"
    axes.plot(*tip, marker="v", markersize=8, color=TIP_COLOUR, label=load, **style)
    axes.plot(*com, marker="o", markersize=10, color="gold", label="centre of mass", **style)
    axes.plot(*point, marker="X", markersize=9, color=ZMP_COLOUR, label="ZMP at rest", **style)


def _draw_root(axes: Axes, view: _View, length: float) -> None:
    """Draw the axes of the root frame as arrows with their directions in words."""
    for tip, word in (((length, 0.0), "forward"), ((0.0, length), view.arrow)):
        axes.annotate(
            "",
            xy=tip,
            xytext=(0.0, 0.0),
            arrowprops={"arrowstyle": "-|>", "color": "black", "linewidth": 1.2},
            zorder=6,
        )
        axes.annotate(word, tip, xytext=(2, 2), textcoords="offset points", fontsize=7.5, zorder=9)
