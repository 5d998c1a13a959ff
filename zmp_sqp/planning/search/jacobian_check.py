"""Check of the Jacobians that users give, after a search that found no motion."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.constraints.path_rows import PathRows
from zmp_sqp.planning.problem.problem import Problem

__all__ = ["wrong_jacobians"]

STATES = 7  # of the last motion at which a Jacobian is compared with differences
STEP = 1e-5  # [rad or m, per second, per second squared] of central differences
# of the larger one of both, or of a thousandth of the value: more is no rounding of differences
DIFFERENT = 1e-2


def wrong_jacobians(problem: Problem, motion: Trajectory | None) -> str:
    """Sentence about constraints whose Jacobian is not that of their values; empty without any.

    A wrong Jacobian sends the search astray, but makes no motion safe that is not. It is compared
    with central differences along random directions, in states of a motion; one that is wrong in
    half of them is named. A kink of the values is thus no fault.

    Args:
        problem: The problem.
        motion: Last motion of the search; None if there is none.
    """
    given = [one for one in problem.constraints if isinstance(one, PathRows)]
    if motion is None or not given or motion.duration <= 0.0:
        return ""
    _, *state = motion.within(np.linspace(0.05, 0.95, STATES))
    wrong = [one.name for one in given if _is_wrong(one, problem, *state)]
    if not wrong:
        return ""
    return (
        f" The Jacobian of {' and of '.join(map(repr, wrong))} is not that of the values, as their "
        "differences show: with a wrong one the search may fail."
    )


def _is_wrong(given: PathRows, problem: Problem, q: Array, v: Array, a: Array) -> bool:
    """Whether the Jacobian of a constraint differs from differences in half of the states."""
    rng, machine = np.random.default_rng(0), problem.machine
    dq, dv, da = rng.uniform(-1.0, 1.0, (3, *q.shape))
    try:
        values, jacobian = given.values(machine, q, v, a)
        ahead, behind = (
            given.values(machine, q + side * dq, v + side * dv, a + side * da)[0]
            for side in (STEP, -STEP)
        )
    except ProblemError:
        return False
    found = np.einsum("krj,kj->kr", jacobian, np.hstack([dq, dv, da]))
    expected = (ahead - behind) / (2.0 * STEP)
    size = np.maximum(np.abs(found), np.abs(expected))
    with np.errstate(invalid="ignore"):
        off = np.abs(found - expected) > DIFFERENT * np.maximum(size, 1e-3 * np.abs(values))
    return bool(2 * off.any(axis=1).sum() >= len(q))
