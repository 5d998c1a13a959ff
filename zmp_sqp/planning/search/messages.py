"""How planning ended, in words."""

from __future__ import annotations

import numpy as np

from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.proof.certificate import Certificate
from zmp_sqp.planning.proof.words import spelled
from zmp_sqp.planning.search.answer import Status

__all__ = ["failure_message", "spelled"]


def failure_message(
    problem: Problem, status: Status, checked: Certificate, obstacle: str = ""
) -> str:
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
    said = [str(status)]
    if checked.fault:
        missed = np.isinf(checked.limit_excess)
        said.append(
            f"The last motion looked at {checked.fault}{_sideways(problem) if missed else ''}."
        )
    if checked.margin < problem.margin:
        said.append(_zmp(problem, checked))
    return " ".join(said)


def _zmp(problem: Problem, checked: Certificate) -> str:
    """Where, when and by how much the ZMP is not where it should be."""
    support = problem.machine.support
    edge = "" if support is None else support.edge_name(checked.edge)
    extreme = f" with {checked.corner}" if checked.corner else ""
    if not np.isfinite(checked.sampled):
        return f"At {checked.margin_at:.2f} s the machine would lift off the ground{extreme}."
    kept = f" less the margin of {problem.margin:.3g} m" if problem.margin else ""
    if not np.isfinite(checked.margin):
        return f"No margin can be proven of the last motion looked at{extreme}{checked.doubt and ': '}{checked.doubt}."
    leaves = "would leave" if checked.sampled < problem.margin else "may leave"
    short = spelled(problem.margin - checked.margin)
    return (
        f"At {checked.margin_at:.2f} s the ZMP {leaves} the {edge} edge{kept} by {short}{extreme}."
    )


def _sideways(problem: Problem) -> str:
    """Why a base does not get to a goal beside it, and what would help; empty if the goal does not lie there."""
    base = problem.base
    if base is None:
        return ""
    step, heading = base.goal[:2] - base.start[:2], 0.5 * (base.start[2] + base.goal[2])
    ahead, across = (
        step @ [np.cos(heading), np.sin(heading)],
        step @ [-np.sin(heading), np.cos(heading)],
    )
    if abs(across) <= abs(ahead):
        return ""
    return (
        f"; the goal lies {spelled(abs(float(across)))} across the heading, and tracks do not slip sideways: plan by "
        "way of a pose ahead or behind, or turn towards the goal first"
    )
