"""Load charts as tables on the terminal, in words, and as one JSON object."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.charts import NOT_A_SUBSTITUTE, ChartPoints, LoadChart, SwingChart
from zmp_sqp.charts.static_loads import TIPPING
from zmp_sqp.mechanics import Slope
from zmp_sqp.show.tables import new_table
from zmp_sqp.versions import installed_versions

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "CHART_KEYS",
    "OUT_OF_REACH",
    "amount_text",
    "chart_notes",
    "chart_result",
    "chart_table",
    "length_texts",
    "letters_in_words",
    "load_text",
    "load_unit",
    "swing_notes",
    "swing_table",
    "swing_text",
    "swing_title",
]

TONNE = 1000.0  # [kg] largest load from which on loads are in tonnes
OUT_OF_REACH, NOT_COMPUTED = "-", "?"
CHART_KEYS = """\
--json writes one object; SI units and radians, null where there is no value:
  machine, frame, com       the machine, the frame that carries the load, and the lift point in it,
                            the load's centre of mass [m]
  gravity                   in the axes of the machine [m/s^2]
  tipping_fraction, torque_fraction
  attachment                links that count as part of the load
  attachment_mass           their mass, which is subtracted [kg]
  attitude                  free or held
  unlimited                 joints that carry the load and have no effort limit
  points                    list: height, radius [m], maximum_reach (whether it is the largest
                            radius of its height), sector, rated, limit, tipping, torque [kg] (null
                            where nothing limits them), and the joints' coordinates
  swing                     null, or angle, start, duration, fastest, margin, only_slew, complete
                            and points: height, radius, load, duration, static_bound (the load
                            that can be held at both ends)
  versions                  of zmp-sqp, Python and the packages that the result depends on
"""


def chart_table(chart: LoadChart, sector: int) -> Table:
    """Rated loads of one sector: heights from the top, radii, last the largest radius.

    Args:
        chart: The chart.
        sector: Index of the sector in `chart.sectors`.
    """
    unit = load_unit(chart)
    radii = [f"{text} m" for text in length_texts(chart.radii)]
    table = _compact_table("height", *radii, "max. radius", "load")
    letters = chart.letters
    far = _reached_texts(chart.reach.radius)
    for row in range(len(chart.heights) - 1, -1, -1):
        cells = [
            load_text(chart.grid, (row, column), sector, unit, letters)
            for column in range(len(chart.radii))
        ]
        last = load_text(chart.reach, (row,), sector, unit, letters)
        table.add_row(f"{length_texts(chart.heights)[row]} m", *cells, far[row], last)
    return table


def swing_table(swing: SwingChart) -> Table:
    """Largest loads of a swing: heights from the top, radii."""
    chart, unit = swing.chart, load_unit(swing.chart)
    table = _compact_table("height", *(f"{text} m" for text in length_texts(chart.radii)))
    for row in range(len(chart.heights) - 1, -1, -1):
        cells = [swing_text(swing, row, column, unit) for column in range(len(chart.radii))]
        table.add_row(f"{length_texts(chart.heights)[row]} m", *cells)
    return table


def swing_text(swing: SwingChart, row: int, column: int, unit: str) -> str:
    """Largest load of a swing; a dash out of reach, a question mark where it was not computed."""
    load = float(swing.loads[row, column])
    if np.isnan(load) and swing.chart.grid.reached[row, column] and not swing.complete:
        return NOT_COMPUTED
    return amount_text(load, unit)


def swing_title(swing: SwingChart) -> str:
    """One line that says which swing it is."""
    how = " of the slew joint alone" if swing.only_slew else ""
    return (
        f"largest load [{load_unit(swing.chart)}] with a certified swing{how} by "
        f"{np.degrees(swing.angle):g} degrees from {np.degrees(swing.start):g} degrees, "
        f"in at most {swing.duration:.4g} s"
    )


def swing_notes(swing: SwingChart) -> list[str]:
    """What the loads of a swing mean and what they leave out, one sentence each."""
    kept = f"; the ZMP stays {swing.margin:g} m from the edges" if swing.margin else ""
    drawn_in = "; on the way the planner may draw the load in"
    way = ", which it keeps" if swing.only_slew else drawn_in
    notes = [
        f"Begins and ends at rest at this radius and height{way}. No fraction is applied{kept}. "
        "The load is rigid: it does not sway.",
        NOT_A_SUBSTITUTE,
    ]
    if not swing.complete:
        done = int(np.isfinite(swing.loads).sum())
        notes.insert(0, f"Interrupted: {done} points are done; {NOT_COMPUTED}: not computed.")
    return notes


def load_unit(chart: LoadChart) -> str:
    """Unit of the loads of a chart: t, or kg if all of them are light."""
    loads = np.concatenate([chart.grid.rated.ravel(), chart.reach.rated.ravel()])
    loads = loads[np.isfinite(loads)]
    return "t" if loads.size and loads.max() >= TONNE else "kg"


def load_text(
    points: ChartPoints,
    at: tuple[int, ...],
    sector: int,
    unit: str,
    letters: Mapping[int, str],
) -> str:
    """Letter of what limits a rated load, and the load; a dash out of reach."""
    load, limit = float(points.rated[(*at, sector)]), int(points.limit[(*at, sector)])
    if not np.isfinite(load):
        return amount_text(load, unit)
    return f"{letters[limit]} {amount_text(load, unit)}"


def amount_text(load: float, unit: str) -> str:
    """Load [kg] in a unit, rounded down; "any" where nothing limits it."""
    if np.isnan(load):
        return OUT_OF_REACH
    if np.isinf(load):
        return "any"
    if load == 0.0:
        return "0"
    value, digits = (load / TONNE, 2) if unit == "t" else (load, 1)
    return f"{np.floor(value * 10**digits) / 10**digits:.{digits}f}"


def length_texts(values: Array) -> list[str]:
    """Lengths [m] with as many digits as tell them apart."""
    for digits in range(4):
        if np.allclose(values, np.round(values, digits), atol=1e-9):
            return [f"{value + 0.0:.{digits}f}" for value in values]
    return [f"{value:.3f}" for value in values]


def _reached_texts(radii: Array) -> list[str]:
    return [OUT_OF_REACH if np.isnan(radius) else f"{radius:.2f} m" for radius in radii]


def letters_in_words(chart: LoadChart) -> str:
    """Which letter stands for what, of those that occur."""
    kinds = ", ".join(
        f"{letter} {chart.limit_name(limit)}"
        for limit, letter in sorted(chart.letters.items())
        if limit >= TIPPING
    )
    return f"limited by: {kinds}; 0: not even without a load; -: out of reach"


def chart_notes(chart: LoadChart) -> list[str]:
    """What a chart means and what it leaves out, one sentence each."""
    offset = chart.payload.com
    com = ", ".join(f"{value:g}" for value in offset)
    where = f"({com}) m in frame" if offset.any() else "origin of frame"
    shares = f"{100.0 * chart.rows.tipping_fraction:g} % of the tipping load"
    if len(chart.unlimited) < 1 + len(chart.arm.joints):
        held = f"{100.0 * chart.rows.torque_fraction:g} % of the load that the joints can hold"
        shares = f"the lesser of {shares} and {held}"
    notes = [
        f"Lift point: {where} {chart.payload.frame}. Radius from the slew axis, height above the "
        f"plane of support. {_ground_in_words(chart)}",
        f"Rated load (ISO 10567): {shares}{_attachment_in_words(chart)}.",
        "Pose: the best found for the load all round"
        + (", with the attitude of the frame held" if chart.held else "")
        + "; it is the same in all directions.",
    ]
    if chart.unlimited:
        everything = len(chart.unlimited) == 1 + len(chart.arm.joints)
        names = ", ".join(chart.unlimited)
        notes.append(
            "No joint has an effort limit: this chart knows tipping only."
            if everything
            else f"Joints without an effort limit, whose torques do not count: {names}."
        )
    if not chart.arm.full_circle:
        lower, upper = np.rad2deg(chart.arm.slew_range)
        notes.append(f"All round is the slew joint's range, {lower:.0f} to {upper:.0f} degrees.")
    notes.append(f"Structure, collisions and soil are not looked at. {NOT_A_SUBSTITUTE}")
    return notes


def _ground_in_words(chart: LoadChart) -> str:
    ground = chart.ground
    if isinstance(ground, Slope):
        if not ground.roll and not ground.pitch:
            return "Level ground."
        roll, pitch = np.rad2deg([ground.roll, ground.pitch])
        return f"Slope: roll {roll:g}, pitch {pitch:g} degrees."
    return "Ground as given."


def _attachment_in_words(chart: LoadChart) -> str:
    if not chart.attachment:
        return "; no attachment is subtracted"
    weighs = f"{', '.join(chart.attachment)}, {chart.attachment_mass:g} kg"
    return f", each for load and attachment together, less the attachment ({weighs})"


def chart_result(chart: LoadChart, swing: SwingChart | None) -> dict[str, Any]:
    """Object that `zmp-sqp chart --json` writes; `CHART_KEYS` explains its keys."""
    return {
        "machine": chart.machine.name,
        "frame": chart.payload.frame,
        "com": chart.payload.com.tolist(),
        "gravity": chart.ground.gravity().tolist(),
        "tipping_fraction": chart.rows.tipping_fraction,
        "torque_fraction": chart.rows.torque_fraction,
        "attachment": list(chart.attachment),
        "attachment_mass": chart.attachment_mass,
        "attitude": "held" if chart.held else "free",
        "unlimited": list(chart.unlimited),
        "points": [_finite(record) for record in chart.records()],
        "swing": None if swing is None else _swing_result(swing),
        "versions": installed_versions(),
    }


def _swing_result(swing: SwingChart) -> dict[str, Any]:
    keys = ("angle", "start", "duration", "fastest", "margin", "only_slew", "complete")
    points = [_finite(record) for record in swing.records()]
    return {**{key: getattr(swing, key) for key in keys}, "points": points}


def _finite(record: Mapping[str, Any]) -> dict[str, Any]:
    """Record with None in place of NaN and infinity, which JSON does not have."""
    return {
        key: None if isinstance(value, float) and not np.isfinite(value) else value
        for key, value in record.items()
    }


def _compact_table(first: str, *others: str) -> Table:
    table = new_table(first, *others)
    table.pad_edge, table.collapse_padding = False, True
    return table
