"""How planning ended, in words."""

from __future__ import annotations

import numpy as np

from zmp_sqp.planning.answer import Status
from zmp_sqp.planning.certificate import Certificate
from zmp_sqp.planning.problem import Problem

__all__ = ["failure_message"]


def failure_message(problem: Problem, status: Status, checked: Certificate, obstacle: str = "") -> str:
    """The status in a sentence; without success, which constraint stayed violated, when and by how much.

    Args:
        problem: The question.
        status: How planning ended.
        checked: Of the last motion.
        obstacle: What kept that motion from being looked at.
    """
    if obstacle:
        return f"{status} The last motion looked at: {obstacle}."
    if status.success or problem.machine.support is None:
        return str(status)
    if np.isinf(checked.limit_excess):
        return f"{status} The last motion looked at ends beside its goal, or leaves the base's x or y bounds."
    if not checked.limits_ok:
        whose = "a joint limit" if problem.base is None else "a limit of a joint or of the base"
        return f"{status} The last motion looked at exceeds {whose} by {checked.limit_excess:.3g}."
    if checked.margin >= problem.margin:
        return str(status)
    edge = problem.machine.support.edge_name(checked.edge)
    extreme = f" with {checked.corner}" if checked.corner else ""
    if not np.isfinite(checked.margin):
        return f"{status} At {checked.margin_at:.2f} s the machine would lift off the ground{extreme}."
    short = problem.margin - checked.margin
    kept = f" less the margin of {problem.margin:.3g} m" if problem.margin else ""
    return f"{status} At {checked.margin_at:.2f} s the ZMP would leave the {edge} edge{kept} by {short:.3f} m{extreme}."
