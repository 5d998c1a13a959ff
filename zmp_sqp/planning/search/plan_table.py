"""Many plans side by side, as columns for NumPy, pandas or a CSV file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, shortened
from zmp_sqp.errors import ProblemError
from zmp_sqp.planning.search.answer import Plan

__all__ = ["table"]


def table(plans: Mapping[str, Plan] | Iterable[Plan]) -> dict[str, Any]:
    """Columns of a table with one row per plan, such as `pandas.DataFrame` takes.

    Columns, each of length K; numbers are arrays, NaN where a plan has no value:

    =============== =========================================================================
    name            name in the mapping; in a list, the number of the plan from 0, as text
    success         whether a safe motion was found, array of bool
    status          name of the `Status`, in lower case
    duration        duration of the safe motion [s]
    lower_bound     duration that no motion within the limits can undercut [s]
    above_bound     duration / lower_bound - 1 [-]
    margin          guaranteed distance from the ZMP to the edges, all uncertainties included [m]
    margin_asked    margin that the problem asks for [m]
    intervals       number of intervals of the safe motion
    iterations      number of SQP iterations
    solve_time      wall time of planning [s]
    qp_solver       name of the QP solver, as given
    payload         mass of the payload [kg]
    message         message of the plan
    =============== =========================================================================

    Args:
        plans: Plans by name, or one after the other.

    Raises:
        ProblemError: An entry is no Plan.
    """
    named = dict(plans) if isinstance(plans, Mapping) else _numbered(plans)
    for name, one in named.items():
        if not isinstance(one, Plan):
            raise ProblemError(f"plan {name!r} of the table must be a Plan, not {shortened(one)}")
    found = list(named.values())
    safe = [one.duration if one.success else np.nan for one in found]
    bounds = _numbers(one.lower_bound for one in found)
    above: Array = np.full(len(found), np.nan)
    np.divide(_numbers(safe), bounds, out=above, where=bounds > 0.0)
    return {
        "name": [str(name) for name in named],
        "success": np.array([one.success for one in found], dtype=bool),
        "status": [one.status.name.lower() for one in found],
        "duration": _numbers(safe),
        "lower_bound": bounds,
        "above_bound": above - 1.0,
        "margin": _numbers(one.margin if one.success else np.nan for one in found),
        "margin_asked": _numbers(one.problem.margin for one in found),
        "intervals": _numbers(
            len(one.trajectory.times) - 1 if one.success else np.nan for one in found
        ),
        "iterations": np.array([one.iterations for one in found], dtype=np.intp),
        "solve_time": _numbers(one.solve_time for one in found),
        "qp_solver": [one.qp_solver for one in found],
        "payload": _numbers(one.problem.machine.payload_mass for one in found),
        "message": [one.message for one in found],
    }


def _numbered(plans: Any) -> dict[str, Any]:
    """Plans by their number in an iterable."""
    if isinstance(plans, Plan) or not isinstance(plans, Iterable):
        raise ProblemError(
            f"table takes several plans, in a list or by name, not {shortened(plans)}"
        )
    return {str(i): one for i, one in enumerate(plans)}


def _numbers(values: Iterable[float]) -> Array:
    return np.array(list(values), dtype=np.float64)
