"""The certificate of a problem's motion, at every extreme of what is uncertain."""

from __future__ import annotations

from dataclasses import replace

from zmp_sqp.planning.certificate import Certificate, certify
from zmp_sqp.planning.problem import Problem
from zmp_sqp.planning.trajectory import Trajectory

__all__ = ["certify_for"]


def certify_for(problem: Problem, trajectory: Trajectory) -> Certificate:
    """Guarantee for a motion at all corners of the problem's payload and slope: the least of theirs, and whose it is.

    Wrench rows are affine in payload and gravity, each for itself, so that what holds at the corners holds inside; what
    squares of a displaced centre of mass can do between them is taken off (`moment_of_spread`).

    Args:
        problem: With its margin, its base and what is uncertain.
        trajectory: The motion.
    """
    found = [
        replace(
            certify(corner.machine, trajectory, corner.ground, problem.margin, base=problem.base, spread=corner.spread),
            corner=corner.text,
        )
        for corner in problem.corners(every=True)
    ]
    return min(found, key=lambda certificate: certificate.margin)
