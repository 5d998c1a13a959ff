"""Figure of the iterations of a search: duration, violation, and how far from optimal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from zmp_sqp.arrays import Array, shortened
from zmp_sqp.errors import ProblemError
from zmp_sqp.planning import Plan
from zmp_sqp.planning.search.run import SearchRun
from zmp_sqp.plots.canvas import COLOURS, new_figure
from zmp_sqp.sqp.result import IterationRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["convergence"]

LEAST = 1e-12  # measures below are drawn here, at the lower end of the axes
LINE = 0.19  # [in] height of a line of text


class _Steps(NamedTuple):
    """Iterations of one run.

    Attributes:
        run: The run.
        first: Number of iterations before it.
        records: Its iterations.
    """

    run: SearchRun
    first: int
    records: Sequence[IterationRecord]


def convergence(plan: Plan) -> Figure:
    """Iterations of the SQP in the order in which they ran.

    Above the duration [s] after each, with the lower bound; below, on a logarithmic axis, the
    largest violation of a constraint (rows of order one) and the decrease of the merit function
    that a full step was predicted to give, which is zero at a Karush-Kuhn-Tucker point. Runs of the
    search are bands with numbers, listed below with guess, grid and outcome. Iterations without a
    step are crosses.

    Args:
        plan: A plan, with or without success.

    Raises:
        MissingExtra: matplotlib is not installed.
        ProblemError: The argument is no plan.
    """
    if not isinstance(plan, Plan):
        raise ProblemError(f"give a Plan, not {shortened(plan)}")
    runs = list(_runs(plan))
    texts = [_words(number, steps) for number, steps in enumerate(runs, 1)]
    if not plan.history:
        texts.append("No iteration was needed: a motion in closed form is the answer.")
    figure = new_figure(width=7.4, height=5.2 + LINE * len(texts))
    above, below = figure.subplots(2, 1, sharex=True)
    for number, steps in enumerate(runs, 1):
        _draw_run(above, below, number, steps)
    above.axhline(
        plan.lower_bound, color="black", linestyle="--", linewidth=1.0, label="lower bound"
    )
    above.set_ylabel("duration [s]")
    below.set_ylabel("measure (no unit)")
    below.set_xlabel("iteration")
    if plan.history:
        below.set_yscale("log")
        below.set_xlim(0.5, len(plan.history) + 0.5)
        below.xaxis.get_major_locator().set_params(integer=True)
    for axes in (above, below):
        axes.grid(alpha=0.3)
        entries = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
        axes.legend(entries.values(), entries.keys(), fontsize=8.5)
    figure.supxlabel("\n".join(texts), fontsize=8.5, x=0.02, ha="left")
    return figure


def _runs(plan: Plan) -> Iterator[_Steps]:
    """Runs with iterations, in order."""
    first = 0
    for run in plan.runs:
        records = plan.history[first : first + run.iterations]
        if records:
            yield _Steps(run, first, records)
        first += run.iterations


def _words(number: int, steps: _Steps) -> str:
    run = steps.run
    outcome = run.status.replace("_", " ")
    return (
        f"{number}  {run.purpose}: {run.intervals} intervals, {run.iterations} "
        f"iteration{'' if run.iterations == 1 else 's'}, "
        f"{outcome}, {run.duration:.4f} s, {run.backend}"
    )


def _draw_run(above: Axes, below: Axes, number: int, steps: _Steps) -> None:
    """Draw the iterations of one run as a band, with its number on top."""
    records = steps.records
    at = steps.first + 1.0 + np.arange(len(records))
    for axes in (above, below):
        if number % 2 == 0:
            axes.axvspan(at[0] - 0.5, at[-1] + 0.5, color="0.93", zorder=0, linewidth=0.0)
    middle = 0.5 * (at[0] + at[-1])
    style: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": 8.5}
    above.annotate(f"{number}", (middle, 1.01), xycoords=("data", "axes fraction"), **style)
    durations = steps.run.reference * np.sqrt([record.objective for record in records])
    above.plot(at, durations, "o-", color=COLOURS[0], markersize=4, label="duration")
    still = np.array([record.step == 0.0 for record in records])
    if still.any():
        above.plot(
            at[still], durations[still], "x", color="black", markersize=7, label="no step taken"
        )
    for name, marker, colour in (
        ("violation", "s-", COLOURS[1]),
        ("decrease", "^:", COLOURS[2]),
    ):
        label = {"violation": "largest violation", "decrease": "predicted decrease of merit"}[name]
        values = _measure(records, name)
        if not np.isfinite(values).any():
            continue
        below.plot(at, values, marker, color=colour, markersize=4, label=label)


def _measure(records: Sequence[IterationRecord], name: str) -> Array:
    """Values for a logarithmic axis; NaN where there is none."""
    values = np.abs([getattr(record, name) for record in records])
    return np.asarray(np.where(np.isnan(values), np.nan, np.maximum(values, LEAST)))
