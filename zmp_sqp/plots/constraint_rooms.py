"""Figure of the room that a motion leaves to every constraint over time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.planning import Guarantee, Plan, Problem, Trajectory
from zmp_sqp.planning.constraints.guarantee import amount_in_words
from zmp_sqp.plots.canvas import ALARM, colour_of, new_figure, style_of
from zmp_sqp.plots.shown_motion import ShownMotion
from zmp_sqp.report.sampling import ConstraintRoom, MotionSamples

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["margins"]

SAMPLES = 600  # of the motion, about
MOST_ROWS = 10  # rows of a constraint that have a curve each; of more, only the least is drawn
LEAST_IN_KILO = 1e4  # [N, N m] forces and torques from here on are given in kN and kN m
PANEL = 2.1  # [in] height of a panel


@dataclass(frozen=True, slots=True, eq=False)
class _Panel:
    """Rows of one constraint that have the same unit.

    Attributes:
        name: Name of the constraint.
        unit: Unit of the rows.
        curves: Room over time, shape (K,), by name of the row [unit].
        guarantee: What the certificate guarantees of these rows; None for nothing.
    """

    name: str
    unit: str
    curves: dict[str, Array]
    guarantee: Guarantee | None


def margins(source: Plan | Problem, trajectory: Trajectory | None = None) -> Figure:
    """Room that a motion leaves to every constraint over time, each in its own unit.

    Tip-over, contact, torques, and a user's own rows have a panel each, with a curve for every row:
    for tip-over the distance from the ZMP to each edge. The room is that of the worst payload and
    slope where these are uncertain. The line at zero is the bound, below which the constraint is
    violated; what is asked for is dashed, and what the certificate guarantees for all times is a
    dotted line with its value and a diamond at its time.
    Limits of joints and base are in `profiles`.

    Args:
        source: A plan, whose last motion is drawn, safe or not; or a problem.
        trajectory: Motion of a problem; None for a plan.

    Raises:
        MissingExtra: matplotlib is not installed.
        NotSolved: The plan has no motion at all.
        ProblemError: An argument is of another kind.
    """
    shown = ShownMotion.of(source, trajectory)
    samples = MotionSamples.of(shown.problem, shown.trajectory, SAMPLES)
    panels = [panel for room in samples.rooms for panel in _panels(room, shown)]
    figure = new_figure(width=8.2, height=PANEL * len(panels) + 0.5)
    rows = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, panel in zip(rows, panels, strict=True):
        _draw(axes, samples.times, panel)
    rows[-1].set_xlabel("time [s]")
    return figure


def _panels(room: ConstraintRoom, shown: ShownMotion) -> Iterator[_Panel]:
    """Panels of a constraint, one per unit; rows of the same name are drawn by their least."""
    guarantees = [one for one in shown.certificate.guarantees if one.name == room.name]
    for unit in dict.fromkeys(room.units):
        curves: dict[str, Array] = {}
        for row, label in enumerate(room.labels):
            if room.units[row] == unit:
                values = np.where(np.isfinite(room.every[:, row]), room.every[:, row], np.nan)
                curves[label] = np.fmin(curves.get(label, values), values)
        if len(curves) > MOST_ROWS:
            least = np.fmin.reduce(list(curves.values()))
            curves = {f"least of {len(curves)} rows": least}
        found = next((one for one in guarantees if one.unit == unit), None)
        yield _Panel(room.name, unit, curves, found)


def _draw(axes: Axes, times: Array, panel: _Panel) -> None:
    values = np.concatenate(list(panel.curves.values()))
    largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
    kilo = panel.unit in ("N", "N m") and largest >= LEAST_IN_KILO
    scale, unit = (1e-3, f"k{panel.unit}") if kilo else (1.0, panel.unit)
    for number, (label, curve) in enumerate(panel.curves.items()):
        look, colour = style_of(number), colour_of(number)
        axes.plot(times, scale * curve, look, color=colour, linewidth=1.4, label=label)
    axes.axhline(0.0, color="black", linewidth=1.2, label="bound: 0")
    found = panel.guarantee
    if found is not None and found.required > 0.0:
        words = f"asked for: {amount_in_words(found.required, found.unit)}"
        axes.axhline(found.required, color="black", linestyle="--", linewidth=1.0, label=words)
    if found is not None and np.isfinite(found.value):
        words = amount_in_words(found.value, found.unit)
        kind = "guaranteed" if found.proven else "sampled only"
        label = f"{kind}: {words}\n({found.label})"
        axes.axhline(scale * found.value, color=ALARM, linestyle=":", linewidth=1.8, label=label)
        axes.plot(found.time, scale * found.value, "D", color=ALARM, markersize=5, zorder=5)
    _limit(axes, scale * values)
    low, _ = axes.get_ylim()
    if low < 0.0:  # hatched: no room
        style: dict[str, Any] = {
            "facecolor": "none",
            "edgecolor": ALARM,
            "alpha": 0.35,
            "linewidth": 0.0,
        }
        axes.axhspan(low, 0.0, hatch="///", zorder=0, **style)
    axes.set_ylim(low)
    axes.set_title(panel.name.replace("_", " "), fontsize=10, loc="left")
    axes.set_ylabel(f"room [{unit}]" if unit else "room")
    axes.margins(x=0.0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5))


def _limit(axes: Axes, values: Array) -> None:
    """Show the least room, the bound, and not more above than helps to see them."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        axes.set_ylim(-1.0, 1.0)
        return
    low, high = min(float(finite.min()), 0.0), max(float(finite.max()), 0.0)
    size = (high - low) or 1.0
    axes.set_ylim(low - 0.06 * size, high + 0.06 * size)
