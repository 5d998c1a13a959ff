"""Messages that say how planning ended and, without success, what is wrong with the last motion."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import length_text
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.zmp_words import zmp_position
from zmp_sqp.planning.proof.certificate import Certificate
from zmp_sqp.planning.search.answer import Status

__all__ = ["failure_message"]


def failure_message(
    problem: Problem, status: Status, checked: Certificate, obstacle: str = ""
) -> str:
    """Message of a plan: its status and, without success, each violated constraint.

    Args:
        problem: The problem.
        status: How planning ended.
        checked: Certificate of the last motion.
        obstacle: Why the last motion could not be certified; empty if it could.

    Returns:
        One or more sentences; for a violated constraint, when it is violated and by how much.
    """
    if obstacle:
        return f"{status} The last motion looked at: {obstacle}."
    if status.success or problem.machine.support is None:
        return str(status)
    said = [str(status)]
    if checked.fault:
        missed = np.isinf(checked.limit_excess)  # the base misses its goal
        said.append(
            f"The last motion looked at {checked.fault}{_sideways(problem) if missed else ''}."
        )
    if checked.margin < problem.margin:
        said.append(_zmp_sentence(problem, checked))
    return " ".join(said)


def _zmp_sentence(problem: Problem, checked: Certificate) -> str:
    """Sentence that says when the ZMP violates the margin of the problem, and by how much."""
    support = problem.machine.support
    extreme = f" with {checked.corner}" if checked.corner else ""
    at = f"At {checked.margin_at:.2f} s"
    if support is None or not np.isfinite(checked.sampled):
        return f"{at} the machine would lift off the ground{extreme}."
    if not np.isfinite(checked.margin):
        doubt = f": {checked.doubt}" if checked.doubt else ""
        return f"No margin can be proven for the last motion looked at{extreme}{doubt}."
    position = zmp_position(
        support,
        checked.edge,
        distance=checked.margin,
        margin=problem.margin,
        modal="would" if checked.sampled < problem.margin else "may",
    )
    return f"{at} the ZMP {position}{extreme}."


def _sideways(problem: Problem) -> str:
    """Why a base misses a goal to its side, with advice; empty if the goal is not there."""
    base = problem.base
    if base is None:
        return ""
    step, heading = base.goal[:2] - base.start[:2], 0.5 * (base.start[2] + base.goal[2])
    ahead = float(step @ [np.cos(heading), np.sin(heading)])
    across = float(step @ [-np.sin(heading), np.cos(heading)])
    if abs(across) <= abs(ahead):
        return ""
    return (
        f"; the goal lies {length_text(abs(across))} to the side of the heading, and tracks do not "
        "slip sideways: plan by way of a pose ahead or behind, or turn towards the goal first"
    )
