"""Messages of plans: how planning ended and, without success, the faults of the last motion."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import length_text
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.zmp_words import zmp_position
from zmp_sqp.planning.proof.certificate import Certificate
from zmp_sqp.planning.proof.words import broken_own, fault_of, limit_fault, name_in_words
from zmp_sqp.planning.search.answer import Status

__all__ = ["failure_message"]


def failure_message(
    problem: Problem, status: Status, checked: Certificate, obstacle: str = ""
) -> str:
    """Message of a plan: its status and, without success, each violated constraint.

    With success, it names the constraints that are only sampled, not proven.

    Args:
        problem: Problem that was planned.
        status: How planning ended.
        checked: Certificate of the last motion of the search.
        obstacle: Why the last motion could not be certified; empty if it could.

    Returns:
        One or more sentences; for a violated constraint, when it is violated and by how much.
    """
    if obstacle:
        return f"{status} The last motion looked at: {obstacle}."
    if status.success:
        return f"{status}{_sampled_only(checked)}"
    if problem.machine.support is None:
        return str(status)
    sentences = [_ending(problem, status, checked)]
    sentences += [f"The last motion looked at {words}." for words in _faults(problem, checked)]
    if checked.margin < problem.margin:
        sentences.append(_zmp_sentence(problem, checked))
    return " ".join(sentences)


def _ending(problem: Problem, status: Status, checked: Certificate) -> str:
    """Status; where tip-over is not the problem, the names of the constraints that are violated."""
    own = broken_own(checked.guarantees)
    if status is not Status.INFEASIBLE or not own or checked.margin < problem.margin:
        return str(status)
    names = " and ".join(found.name for found in own)
    return (
        f"Not solved: the search ended at a motion that still breaks {names}; try a looser limit, "
        "a lighter payload, or another start or goal."
    )


def _faults(problem: Problem, checked: Certificate) -> list[str]:
    """Faults other than tip-over, as predicates that follow "the motion".

    All violated constraints of the problem, and the first violated limit of joints or base.
    """
    words = [fault_of(found) for found in broken_own(checked.guarantees)]
    if limit := limit_fault(checked.guarantees):
        missed = np.isinf(checked.limit_excess)  # the base misses its goal
        words.append(f"{limit}{_goal_to_the_side(problem) if missed else ''}")
    return words


def _sampled_only(checked: Certificate) -> str:
    """Sentence on constraints that are not proven between samples; empty if all are proven."""
    names = [name_in_words(found) for found in checked.guarantees if not found.proven]
    if not names:
        return ""
    return f" Sampled only, 2000 times a second, not proven: {', '.join(names)}."


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


def _goal_to_the_side(problem: Problem) -> str:
    """Reason and advice for a base whose goal lies to its side; empty if it does not."""
    base = problem.base
    if base is None:
        return ""
    ahead, across = base.offset
    if abs(across) <= abs(ahead):
        return ""
    return (
        f"; the goal lies {length_text(abs(across))} to the side of the heading, and tracks do not "
        "slip sideways: plan by way of a pose ahead or behind, or turn towards the goal first"
    )
