"""Messages of plans: how planning ended and, without success, the faults of the last motion."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import length_text
from zmp_sqp.mechanics.ground import Slope
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.zmp_words import zmp_position
from zmp_sqp.planning.proof.certificate import Certificate
from zmp_sqp.planning.proof.words import (
    broken_own,
    fault_of,
    has_no_value,
    limit_fault,
    name_in_words,
)
from zmp_sqp.planning.search.answer import Status

__all__ = ["failure_message", "success_message"]


EXACTLY = 1e-8  # relative excess over the lower bound that counts as rounding
# with 2, 3, 4 and 5 intervals 7, 2, 2 and 2 of 40 hard problems are not solved that others solve
FEW_INTERVALS = 8
FASTEST = "Solved: no motion within the joint limits is faster"


def success_message(
    status: Status, checked: Certificate, *, duration: float, lower_bound: float
) -> str:
    """Message of a plan with success: its status, and the constraints that are only sampled.

    Args:
        status: How planning ended.
        checked: Certificate of the motion.
        duration: Duration of the motion [s].
        lower_bound: Duration that no motion within the limits can undercut [s].
    """
    words = str(status)
    if status is Status.FASTEST_POSSIBLE:
        exactly = duration <= lower_bound * (1.0 + EXACTLY)
        gain = 0.0 if exactly else np.ceil(1e5 * (1.0 - lower_bound / duration)) / 1e3  # [%]
        words = f"{FASTEST}." if exactly else f"{FASTEST} by more than {gain:.3g} %."
    return f"{words}{_sampled_only(checked)}"


def failure_message(
    problem: Problem,
    status: Status,
    checked: Certificate,
    obstacle: str = "",
    *,
    duration: float | None = None,
) -> str:
    """Message of a plan without success: its status, and each violated constraint.

    Args:
        problem: Problem that was planned.
        status: How planning ended.
        checked: Certificate of the last motion of the search.
        obstacle: Why the last motion could not be certified; empty if it could.
        duration: Duration of the last motion of the search [s]; None leaves it out.

    Returns:
        One or more sentences; for a violated constraint, when it is violated and by how much.
    """
    if obstacle:
        return f"{status} The last motion looked at: {obstacle}."
    if problem.machine.support is None or checked.is_of_nothing:
        return str(status)
    sentences = [_ending(problem, status, checked)]
    sentences += [f"The last motion looked at {words}." for words in _faults(problem, checked)]
    if checked.margin < problem.margin:
        sentences.append(_zmp_sentence(problem, checked, duration))
    return " ".join(sentences)


def _ending(problem: Problem, status: Status, checked: Certificate) -> str:
    """Status; where the search ended at a violation, what is violated, and advice that applies."""
    unknown = [found.name for found in broken_own(checked.guarantees) if has_no_value(found)]
    if status is Status.FAILED and unknown:
        return (
            f"Not solved: the search ended where {' and '.join(unknown)} has no value; let its "
            "function give finite values everywhere, positive ones where the constraint is broken."
        )
    if status is not Status.INFEASIBLE:
        return str(status)
    names = [f"breaks {found.name}" for found in broken_own(checked.guarantees)]
    if checked.margin < problem.margin:
        tips = checked.sampled < 0.0 or problem.margin == 0.0
        misses = f"misses the margin of {problem.margin:.10g} m"
        names.insert(0, "tips the machine over" if tips else misses)
    if not names:
        return str(status)
    loosest = ["a smaller margin"] if checked.margin < problem.margin and problem.margin else []
    loosest += ["a looser limit"] if broken_own(checked.guarantees) else []
    finer = ["more intervals"] if problem.first_intervals < FEW_INTERVALS else []
    easier = _easier(problem)
    # a constraint of the user's own may depend on neither payload nor slope
    first, then = (easier, loosest) if checked.margin < problem.margin else (loosest, easier)
    tried = [*finer, *first, *then, "another start or goal"]
    return (
        f"Not solved: the search ended at a motion that still {' and '.join(names)}; "
        f"try {', '.join(tried[:-1])}{', or ' if len(tried) > 1 else ''}{tried[-1]}."
    )


def _easier(problem: Problem) -> list[str]:
    """What of payload and ground could be easier, in words."""
    ground = problem.ground
    easier = ["a lighter payload"] if problem.machine.payload_mass > 0.0 else []
    if not isinstance(ground, Slope) or ground.roll or ground.pitch:
        easier.append("a gentler slope")
    return easier


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


def _zmp_sentence(problem: Problem, checked: Certificate, duration: float | None) -> str:
    """Sentence that says when the ZMP violates the margin of the problem, and by how much."""
    support = problem.machine.support
    extreme = f" with {checked.corner}" if checked.corner else ""
    at = f"At {checked.margin_at:.2f} s of the last motion looked at"
    if duration is not None:
        at += f", which takes {duration:.2f} s,"
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
