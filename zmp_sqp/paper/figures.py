"""Figures 3, 4, 5 and 6 of Song & Sharf 2020, drawn from motions planned by zmp_sqp.

Colours are the paper's; limits are dashed. ZMP loci are drawn in the root frame, x forward and y
left, which is the paper's picture turned by 90 degrees.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError
from zmp_sqp.paper.runs import BASE, Motions
from zmp_sqp.planning import Trajectory
from zmp_sqp.planning.closed_forms.base_bound import moving_base_zmp
from zmp_sqp.planning.closed_forms.base_motion import BaseMotion
from zmp_sqp.plots.canvas import new_figure, planner_colours, sample_times, save
from zmp_sqp.plots.loci import draw_loci, loci_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["FIGURES", "draw_figures"]

FIGURES = ("figure_3.png", "figure_4.png", "figure_5.png", "figure_6.png")
WINDOW = 3.0  # [m] axes of figs. 3 and 5 reach from -3 m to 3 m
ROOM = 0.25  # share of a limit by which axes reach beyond it
STYLES: dict[str, dict[str, Any]] = {  # later curves are thinner, so that all can be seen
    "phase plane": {"linewidth": 4.5, "alpha": 0.55},
    "full model": {"linewidth": 2.6},
    "simplified": {"linewidth": 1.2},
}
# [rad] Position limits farther than this from the motion are not drawn. Axes of angles span this at
# least, so that rounding errors of a joint at rest are not magnified.
SEEN = 0.5


def draw_figures(test_1: Motions, test_2: Motions, folder: Path) -> Iterator[Path]:
    """Write the figures one by one; yields the path of each.

    Args:
        test_1: Motions of figs. 3 and 4.
        test_2: Motions of figs. 5 and 6, with those of the base.
        folder: Folder to write to.
    """
    loci = loci_figure(test_1.problem, test_1.arms, window=WINDOW, measured="simplified")
    save(loci, folder / FIGURES[0])
    yield folder / FIGURES[0]
    _draw_joints(test_1, folder / FIGURES[1])
    yield folder / FIGURES[1]
    _draw_moving_loci(test_2, folder / FIGURES[2])
    yield folder / FIGURES[2]
    _draw_accelerations(test_2, folder / FIGURES[3])
    yield folder / FIGURES[3]


def _draw_joints(motions: Motions, path: Path) -> None:
    """Draw fig. 4: columns of accelerations (a), rates (b) and angles (c), one row per joint."""
    machine = motions.problem.machine
    limits = machine.limits
    columns = (
        ("(a) joint accelerations [rad/s²]", 2, -limits.acceleration, limits.acceleration),
        ("(b) joint velocities [rad/s]", 1, -limits.velocity, limits.velocity),
        ("(c) joint angles [rad]", 0, limits.position_lower, limits.position_upper),
    )
    figure = new_figure(width=10.0, height=8.4)
    grid = figure.subplots(machine.size, 3, sharex=True)
    for column, (title, quantity, lower, upper) in enumerate(columns):
        grid[0, column].set_title(title)
        grid[-1, column].set_xlabel("time [s]")
        for joint in range(machine.size):
            axes = grid[joint, column]
            _overlay(axes, motions, quantity=quantity, joint=joint)
            _dash(axes, float(lower[joint]), float(upper[joint]), everything=quantity > 0)
    _name_rows(grid[:, 0], [f"$q_{i + 1}$ {name}" for i, name in enumerate(machine.joint_names)])
    _legend(figure, grid[0, 0])
    save(figure, path)


def _draw_accelerations(motions: Motions, path: Path) -> None:
    """Draw fig. 6: accelerations of base and joints, one row each, with their limits."""
    machine = motions.problem.machine
    figure = new_figure(width=7.0, height=8.4)
    rows = figure.subplots(machine.size + 1, 1, sharex=True)
    _draw_base_accelerations(rows[0], motions)
    limit = machine.limits.acceleration
    shown = Motions(motions.problem, {name: motions.arms[name] for name in motions.bases}, {})
    for joint in range(machine.size):
        _overlay(rows[joint + 1], shown, quantity=2, joint=joint)
        _dash(rows[joint + 1], -float(limit[joint]), float(limit[joint]), everything=True)
    _name_rows(
        rows,
        [
            "base [m/s²]",
            *(f"$q_{i + 1}$ {name}\n[rad/s²]" for i, name in enumerate(machine.joint_names)),
        ],
    )
    rows[-1].set_xlabel("time [s]")
    _legend(figure, *rows)
    save(figure, path)


def _draw_base_accelerations(axes: Axes, motions: Motions) -> None:
    """Draw the accelerations of the base with its own limits and the bounds of eq. (21)."""
    limit, colours = BASE["max_acceleration"], planner_colours(motions.bases)
    end = max(motions.arms[name].duration for name in motions.bases)
    for name, base in motions.bases.items():
        motion = base.trajectory if isinstance(base, BaseMotion) else base
        times, accelerations = _curve(motion, 2, 0)
        if motion.duration < end:  # the base stands until the arm ends
            times = np.append(times, [times[-1], end])
            accelerations = np.append(accelerations, [0.0, 0.0])
        axes.plot(times, accelerations, color=colours[name], label=name, **STYLES[name])
        if isinstance(base, BaseMotion):
            for bound in (base.lower, base.upper):
                if abs(bound) < 1.2 * limit:  # within the range of the axes
                    axes.axhline(bound, color=colours[name], linestyle=":", label="bound, eq. (21)")
    _dash(axes, -limit, limit, everything=True)


def _draw_moving_loci(motions: Motions, path: Path) -> None:
    """Draw fig. 5: ZMP loci of arm and base together, from the complete wrench."""
    problem = motions.problem
    if problem.machine.support is None:
        raise ProblemError(f"machine {problem.machine.name!r} has no support polygon to draw")
    loci = {}
    for name, base in motions.bases.items():
        arm = motions.arms[name]
        points = moving_base_zmp(problem.machine, arm, base, problem.ground)[1]
        pieces = len(arm.times if base is None else np.union1d(arm.times, base.times)) - 1
        loci[name] = list(points.reshape(pieces, -1, 2))
    figure = new_figure(width=5.4, height=6.0)
    gravity = problem.gravity_at("start")
    draw_loci(
        figure,
        problem.machine.support,
        gravity,
        loci,
        margin=problem.margin,
        window=WINDOW,
    )
    save(figure, path)


def _overlay(axes: Axes, motions: Motions, *, quantity: int, joint: int) -> None:
    """Draw one joint's angle (0), rate (1) or acceleration (2) for every planner."""
    colours = planner_colours(motions.arms)
    for name, trajectory in motions.arms.items():
        axes.plot(
            *_curve(trajectory, quantity, joint), color=colours[name], label=name, **STYLES[name]
        )


def _curve(trajectory: Trajectory, quantity: int, column: int) -> tuple[Array, Array]:
    """Times and values of one joint's angle (0), rate (1) or acceleration (2), shape (K,) each."""
    times = np.concatenate(sample_times(trajectory))
    return times, trajectory(times)[quantity][:, column]


def _dash(axes: Axes, lower: float, upper: float, *, everything: bool) -> None:
    """Draw dashed limits and set the range of the axes.

    Args:
        axes: Axes with the curves.
        lower: Lower limit.
        upper: Upper limit.
        everything: Whether the range includes both limits; else limits far from the curves are left
            out, as for positions.
    """
    low, high = axes.get_ylim()
    for limit in (lower, upper):
        if everything or low - SEEN < limit < high + SEEN:
            axes.axhline(limit, color="black", linestyle="--", linewidth=1.0, label="constraints")
    if everything:
        room = ROOM * upper
        axes.set_ylim(lower - room, upper + room)
    elif high - low < SEEN:
        axes.set_ylim(0.5 * (low + high) - 0.5 * SEEN, 0.5 * (low + high) + 0.5 * SEEN)
    axes.margins(x=0.0)
    axes.grid(alpha=0.3)


def _legend(figure: Figure, *rows: Axes) -> None:
    """Add a legend above the figure with each label of the rows once."""
    entries: dict[Any, Any] = {}
    for axes in rows:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.legend(
        list(entries.values()), list(entries), loc="outside upper center", ncols=len(entries)
    )


def _name_rows(axes: Array, names: list[str]) -> None:
    """Label the vertical axes."""
    for row, name in zip(axes, names, strict=True):
        row.set_ylabel(name)
