"""How planning ended, in words."""

from __future__ import annotations

import numpy as np

from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.proof.certificate import Certificate
from zmp_sqp.planning.proof.words import (
    broken_own,
    fault_of,
    limit_fault,
    name_in_words,
    spelled,
)
from zmp_sqp.planning.search.answer import Status

__all__ = ["failure_message", "spelled"]


def failure_message(
    problem: Problem, status: Status, checked: Certificate, obstacle: str = ""
) -> str:
    """The status in a sentence, and which constraints stayed violated, when and by how much.

    With success, the sentence names constraints that are sampled only.

    Args:
        problem: The question.
        status: How planning ended.
        checked: Of the last motion.
        obstacle: What kept that motion from being looked at.
    """
    if obstacle:
        return f"{status} The last motion looked at: {obstacle}."
    if status.success:
        return f"{status}{_sampled_only(checked)}"
    if problem.machine.support is None:
        return str(status)
    said = [_ending(problem, status, checked)]
    said += [f"The last motion looked at {words}." for words in _faults(problem, checked)]
    if checked.margin < problem.margin:
        said.append(_zmp(problem, checked))
    return " ".join(said)


def _ending(problem: Problem, status: Status, checked: Certificate) -> str:
    """The status; where the machine does not tip over, what else the search did not get rid of."""
    own = broken_own(checked.guarantees)
    if status is not Status.INFEASIBLE or not own or checked.margin < problem.margin:
        return str(status)
    names = " and ".join(found.name for found in own)
    return (
        f"Not solved: the search ended at a motion that still breaks {names}; try a looser limit, "
        "a lighter payload, or another start or goal."
    )


def _faults(problem: Problem, checked: Certificate) -> list[str]:
    """What is wrong beside tip-over, in words that follow "the motion".

    The user's constraints, all of them, and the first limit of joints or base.
    """
    words = [fault_of(found) for found in broken_own(checked.guarantees)]
    if limit := limit_fault(checked.guarantees):
        missed = np.isinf(checked.limit_excess)
        words.append(f"{limit}{_sideways(problem) if missed else ''}")
    return words


def _sampled_only(checked: Certificate) -> str:
    """Constraints that are not proven between samples, as a sentence; empty if all are."""
    names = [name_in_words(found) for found in checked.guarantees if not found.proven]
    if not names:
        return ""
    return f" Sampled only, 2000 times a second, not proven: {', '.join(names)}."


def _zmp(problem: Problem, checked: Certificate) -> str:
    """Where, when and by how much the ZMP is not where it should be."""
    support = problem.machine.support
    edge = "" if support is None else support.edge_name(checked.edge)
    extreme = f" with {checked.corner}" if checked.corner else ""
    if not np.isfinite(checked.sampled):
        return f"At {checked.margin_at:.2f} s the machine would lift off the ground{extreme}."
    kept = f" less the margin of {problem.margin:.3g} m" if problem.margin else ""
    if not np.isfinite(checked.margin):
        reason = f": {checked.doubt}" if checked.doubt else ""
        return f"No margin can be proven of the last motion looked at{extreme}{reason}."
    leaves = "would leave" if checked.sampled < problem.margin else "may leave"
    short = spelled(problem.margin - checked.margin)
    return (
        f"At {checked.margin_at:.2f} s the ZMP {leaves} the {edge} edge{kept} by {short}{extreme}."
    )


def _sideways(problem: Problem) -> str:
    """Why tracks do not reach a goal beside the base; empty if the goal lies ahead."""
    base = problem.base
    if base is None:
        return ""
    step, heading = base.goal[:2] - base.start[:2], 0.5 * (base.start[2] + base.goal[2])
    ahead = step @ [np.cos(heading), np.sin(heading)]
    across = step @ [-np.sin(heading), np.cos(heading)]
    if abs(across) <= abs(ahead):
        return ""
    return (
        f"; the goal lies {spelled(abs(float(across)))} across the heading, and tracks do not slip "
        "sideways: plan by way of a pose ahead or behind, or turn towards the goal first"
    )
