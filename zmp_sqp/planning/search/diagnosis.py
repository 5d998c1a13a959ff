"""Diagnosis of a failed plan: payload and slope for which a motion would be found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from zmp_sqp.blas import one_blas_thread
from zmp_sqp.errors import ProblemError, ZmpSqpError
from zmp_sqp.mechanics.ground import Ground, Slope
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.statics import gentler, largest_share, tilt_of
from zmp_sqp.planning.search.answer import Plan, Status
from zmp_sqp.planning.search.trials import Found, Trials

__all__ = ["Diagnosis", "diagnose"]

LEAST_SHARE = 1e-3  # share of the payload used for "no payload": its mass must be positive
HALVINGS = 4  # bisection steps: shares of payload and slope are found to 2^-4
ITERATIONS = 15  # of the SQP, to find heavier payloads and, as many again, steeper slopes
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Why there is no plan, and for which payload and slope a motion was found instead.

    Attributes:
        message: Message of the plan, followed by one sentence about payload and slope.
        largest_payload: Heaviest payload for which a motion was found [kg]; None if there is no
            payload, or no motion was found for any.
        steepest_slope: Tilt of the steepest slope, inclined in the direction of the problem's, on
            which a motion was found [rad]; None if the ground is no inclined Slope, or no motion
            was found on any.
        time_outside: Time at which the ZMP of the least-violating motion is furthest out [s].
        outside: Largest violation of the ZMP margin by that motion at sampled times [m]; negative
            where the samples keep the margin and only the proof fails, infinite where no motion
            was certified.
        edge: Name of the edge that this ZMP is beyond or nearest to, see
            `SupportPolygon.edge_name`.
    """

    message: str
    largest_payload: float | None
    steepest_slope: float | None
    time_outside: float
    outside: float
    edge: str


@one_blas_thread()
def diagnose(
    found: Plan,
    *,
    time_budget: float | None = 10.0,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Find how large a payload, and how steep a slope, has a safe motion.

    Looks for any safe motion, fast or slow, with less payload and then on gentler slopes: by
    bisection with a few shortest steps from the last motion found, then upwards with an SQP on a
    coarse grid. What is reported is certified, and may be up to a tenth below the largest payload
    or the steepest slope, because only some shares of them are tried. Start, goal and all other
    arguments of the problem are kept.

    That the given problem has no solution is not proven: the last motion of a search is only the
    least-violating one that was found. What is proven impossible, such as a goal that tips the
    machine over at rest, raises a ProblemError when the `Problem` is created.

    Args:
        found: A plan without success.
        time_budget: Wall time of each attempt, of which there are about 12 [s]; None for no limit.
        progress: Called before each attempt with a description of the payload or slope.

    Returns:
        The diagnosis; payload and slope are None for a plan that failed because of the terrain.

    Raises:
        ProblemError: `found` is no Plan, or it has succeeded.
    """
    if not isinstance(found, Plan):
        raise ProblemError(f"diagnose takes a Plan, not {type(found).__name__}")
    if found.success:
        raise ProblemError("the plan has succeeded: there is nothing to diagnose")
    problem, checked = found.problem, found.certificate
    if found.status is Status.TERRAIN:  # the path is at fault, not payload or slope
        return Diagnosis(found.message, None, None, checked.margin_at, np.inf, "")

    budget = found.qp_solver, time_budget
    payload = _largest_payload(problem, Trials(*budget, ITERATIONS), progress)
    slope = _steepest_slope(problem, Trials(*budget, ITERATIONS), progress)
    support = problem.machine.support
    return Diagnosis(
        message=f"{found.message}{_advice(problem, payload, slope)}",
        largest_payload=payload,
        steepest_slope=slope,
        time_outside=checked.margin_at,
        outside=problem.margin - checked.sampled,
        edge="" if support is None else support.edge_name(checked.edge),
    )


def _largest_payload(problem: Problem, trials: Trials, progress: Progress) -> float | None:
    """Heaviest payload below the given one for which a motion was found [kg]; None if for none."""
    machine = problem.machine
    if machine.payload_mass <= 0.0:
        return None

    def with_less(share: float) -> Problem:
        share = max(share, LEAST_SHARE)
        progress(f"with a payload of {share * machine.payload_mass:.0f} kg")
        return replace(problem, machine=machine.with_payload_scaled(share))

    share = _largest_share(with_less, trials)
    return None if share is None else max(share, LEAST_SHARE) * machine.payload_mass


def _steepest_slope(problem: Problem, trials: Trials, progress: Progress) -> float | None:
    """Tilt of the steepest slope on which a motion was found [rad]; None if on none."""
    ground = problem.ground
    if not isinstance(ground, Slope) or not _is_inclined(ground):
        return None

    def on_gentler(share: float) -> Problem:
        less = gentler(ground, share)
        roll, pitch = np.degrees([less.roll, less.pitch])
        progress(f"with roll {roll:.1f} and pitch {pitch:.1f} degrees")
        return replace(problem, ground=less)

    share = _largest_share(on_gentler, trials)
    return None if share is None else tilt_of(gentler(ground, share))


def _largest_share(changed: Callable[[float], Problem], trials: Trials) -> float | None:
    """Largest share below 1 at which a motion was found that is proven safe; None if at none.

    Args:
        changed: Problem at a share; may raise a ZmpSqpError where it is impossible at rest.
        trials: Attempts to find a motion.
    """
    motions: dict[float, Found] = {}

    def works(share: float, attempt: Callable[[Problem], Found | None]) -> bool:
        try:
            motion = attempt(changed(share))
        except ZmpSqpError:  # the machine tips over or lifts off at rest at the start or the goal
            return False
        if motion is not None:
            motions[share] = motion
        return motion is not None

    largest_share(lambda share: works(share, trials.by_steps), halvings=HALVINGS)
    least = step = 2.0**-HALVINGS
    while trials.iterations > 0 and (share := max(motions, default=-step) + step) < 1.0:
        if works(share, trials.by_search):
            step *= 2.0
        elif step == least:
            break
        else:
            step = least
    return next((share for share in sorted(motions, reverse=True) if motions[share].is_safe), None)


def _is_inclined(ground: Ground) -> bool:
    """Whether the ground is a Slope that is not horizontal."""
    return isinstance(ground, Slope) and bool(ground.roll or ground.pitch)


def _advice(problem: Problem, payload: float | None, slope: float | None) -> str:
    """Sentence on the payload [kg] and slope [rad] for which a motion was found; may be empty."""
    parts = []
    if payload is not None:
        parts.append(f"the payload could be {np.floor(payload):.0f} kg")
    if slope is not None:
        parts.append(f"the slope could be {np.floor(10.0 * np.degrees(slope)) / 10.0:.1f} degrees")
    if parts:
        return f" For this goal {', or '.join(parts)}."
    tried = ["with less payload"] if problem.machine.payload_mass > 0.0 else []
    tried += ["on a gentler slope"] if _is_inclined(problem.ground) else []
    return f" No motion was found {' or '.join(tried)} either." if tried else ""
