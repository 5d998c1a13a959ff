"""What would be possible instead, where no safe motion was found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from zmp_sqp.errors import ProblemError, ZmpSqpError
from zmp_sqp.mechanics.ground import Slope
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.statics import gentler, largest_share
from zmp_sqp.planning.search.answer import Plan, Status
from zmp_sqp.planning.search.planner import plan

__all__ = ["Diagnosis", "diagnose"]

LEAST_SHARE = 1e-3  # of payload or slope that stands for none
BITS = 4  # of a share: it is found to 1/16


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Why there is no plan, and what would do, for the same start and goal.

    Attributes:
        message: One or two sentences for the operator.
        largest_payload: Heaviest payload for which a motion was found [kg]; None if there is none,
            or no payload.
        steepest_slope: Tilt of the steepest slope in the same direction for which one was found
            [rad]; None likewise.
        time_outside: When the least-violating motion that was found is furthest out [s].
        outside: By how much its ZMP leaves the polygon less the margin, sampled [m]; negative where
            only the proof fails, infinite where no motion was looked at.
        edge: Name of that edge.
    """

    message: str
    largest_payload: float | None
    steepest_slope: float | None
    time_outside: float
    outside: float
    edge: str


def diagnose(
    found: Plan,
    *,
    time_budget: float | None = 10.0,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Look for the payload and the slope that a motion could be found for, by planning again with less of each.

    The last motion that the search looked at is the least-violating one it found (its QPs weigh the
    violation where they have no solution). That there is none is not proven: what is proven
    impossible, a start or goal that tips over by itself, is a `ProblemError` of `Problem`.

    Args:
        found: A plan without success.
        time_budget: Of each of the at most 12 plans [s]; None for as long as they take.
        progress: Called with what is looked at next, in words.

    Raises:
        ProblemError: The plan has succeeded: there is nothing to diagnose.
    """
    if not isinstance(found, Plan):
        raise ProblemError(f"diagnose takes a Plan, not {type(found).__name__}")
    if found.success:
        raise ProblemError("the plan has succeeded: there is nothing to diagnose")
    problem, checked = found.problem, found.certificate
    if found.status is Status.TERRAIN:  # it is the way that is wrong
        return Diagnosis(found.message, None, None, checked.margin_at, np.inf, "")

    def works(changed: Callable[[], Problem], words: str) -> bool:
        progress(words)
        try:
            return plan(changed(), qp_solver=found.qp_solver, time_budget=time_budget).success
        except ZmpSqpError:  # start or goal tips over at rest, or the contact is lost there
            return False

    machine, ground, parts = problem.machine, problem.ground, []
    payload = slope = None
    if machine.payload_mass > 0.0:

        def carries(share: float) -> bool:
            share = max(share, LEAST_SHARE)
            words = f"with a payload of {share * machine.payload_mass:.0f} kg"
            return works(
                lambda: replace(problem, machine=machine.with_payload_scaled(share)), words
            )

        share = largest_share(carries, halvings=BITS)
        if share is not None:
            payload = max(share, LEAST_SHARE) * machine.payload_mass
            parts.append(f"the payload could be {np.floor(payload):.0f} kg")
    if isinstance(ground, Slope) and (ground.roll or ground.pitch):

        def climbs(share: float) -> bool:
            less = gentler(ground, share)
            words = f"with roll {np.degrees(less.roll):.1f} and pitch {np.degrees(less.pitch):.1f} degrees"
            return works(lambda: replace(problem, ground=less), words)

        share = largest_share(climbs, halvings=BITS)
        if share is not None:
            slope = float(np.arccos(np.cos(share * ground.roll) * np.cos(share * ground.pitch)))
            parts.append(f"the slope {np.floor(10.0 * np.degrees(slope)) / 10.0:.1f} degrees")
    advice = (
        f" For this goal {', or '.join(parts)}."
        if parts
        else " Neither less payload nor less slope would help."
    )
    support = problem.machine.support
    return Diagnosis(
        message=f"{found.message}{advice}",
        largest_payload=payload,
        steepest_slope=slope,
        time_outside=checked.margin_at,
        outside=problem.margin - checked.sampled,
        edge="" if support is None else support.edge_name(checked.edge),
    )
