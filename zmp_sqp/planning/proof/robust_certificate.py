"""The certificate of a problem's motion, at every extreme of what is uncertain."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from zmp_sqp.mechanics.uncertainty import Corner
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase
from zmp_sqp.planning.proof.certificate import Certificate, certify

__all__ = ["certify_at", "certify_for"]


def certify_for(problem: Problem, trajectory: Trajectory) -> Certificate:
    """Guarantee for a motion at all corners of the problem's payload and slope: the least of theirs, and whose it is.

    Wrench rows are affine in payload and gravity, each for itself, so that what holds at the
    corners holds inside; what squares of a displaced centre of mass can do between them is taken
    off (`moment_of_spread`).

    Args:
        problem: With its margin, its base and what is uncertain.
        trajectory: The motion.
    """
    return certify_at(problem.corners(every=True), trajectory, problem.margin, base=problem.base)


def certify_at(
    corners: Iterable[Corner],
    trajectory: Trajectory,
    margin: float,
    *,
    base: UnicycleBase | None = None,
) -> Certificate:
    """The least of the guarantees at these corners, arguments as in `certify`."""
    found = [
        replace(
            certify(
                corner.machine, trajectory, corner.ground, margin, base=base, spread=corner.spread
            ),
            corner=corner.text,
        )
        for corner in corners
    ]
    return min(found, key=lambda certificate: certificate.margin)
