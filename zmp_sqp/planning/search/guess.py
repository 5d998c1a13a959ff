"""Initial guess of the SQP: within the joint limits, slow enough to keep the ZMP not far out."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.motion.double_integrator import grid_profile
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.limits import Boundary, PathBounds
from zmp_sqp.planning.program.rows import BoundConstraints

__all__ = ["cubic_accelerations", "initial_guess", "swung_aside"]

SLOWER = 1.5  # ratio of the durations of successive trials
TRIALS = 24  # most trials: the last is 1.5^23, about 11 000 times as slow as the first
FAR_OUT = 1.0  # in half-widths of the polygon: guesses whose ZMP is further out are slowed down
# where poses on the path tip over even at rest: the fastest trial is taken whose ZMP is at most
# this factor further out than that of the best trial
NEARLY = 1.5


def initial_guess(
    constraints: BoundConstraints,
    start: Boundary,
    goal: Boundary,
    bounds: PathBounds,
    *,
    intervals: int,
    least_duration: float,
    smooth: bool = False,
    route: Array | None = None,
) -> tuple[Array, float]:
    """Accelerations T^2 a, shape (N, n), and duration T [s] of a motion from start to goal.

    From rest to rest the guess is the synchronised bang-coast-bang motion on the grid. If start or
    goal are in motion, it is the cubic through both boundary states. The guess is slowed down while
    the ZMP is outside the margin by more than the polygon's half-width.

    Args:
        constraints: Constraints that give the ZMP of the trials.
        start: Boundary state at the start.
        goal: Boundary state at the goal.
        bounds: Limits of the coordinates.
        intervals: Number N of equal intervals.
        least_duration: Least duration of the guess [s].
        smooth: Whether to use the cubic also from rest to rest.
        route: Start and goal position of a driving base, shape (2, 2) [m]; None if it stands.
    """
    at_rest = not (start.v.any() or goal.v.any() or smooth)
    duration = least_duration if at_rest else 1.05 * least_duration
    size = constraints.half_width
    trials: list[tuple[Array, float, float]] = []
    for _ in range(TRIALS):
        if at_rest:
            alpha = duration**2 * grid_profile(
                goal.q - start.q,
                duration,
                max_velocity=bounds.velocity,
                max_acceleration=bounds.acceleration,
                intervals=intervals,
            )
        else:
            alpha = _cubic(start, goal, duration, intervals)
        trials.append((alpha, duration, _zmp_violation(constraints, start, alpha, duration, route)))
        if trials[-1][2] <= FAR_OUT * size:
            return alpha, duration
        duration *= SLOWER
    # no duration brings the ZMP near: the slowest trial would be thousands of times too slow, and
    # its duration would become the scale of time
    enough = NEARLY * min(violation for _, _, violation in trials)
    return next((alpha, duration) for alpha, duration, violation in trials if violation <= enough)


def _cubic(start: Boundary, goal: Boundary, duration: float, intervals: int) -> Array:
    """Cubic through both boundary states: accelerations constant in each interval, (N, n).

    Mean accelerations of the intervals, with the least-norm change that meets the goal exactly.
    """
    D, w0, w1 = goal.q - start.q, start.v * duration, goal.v * duration
    s = (np.arange(intervals)[:, None] + 0.5) / intervals
    alpha = (6.0 * D - 4.0 * w0 - 2.0 * w1) + s * (6.0 * (w0 + w1) - 12.0 * D)
    weights = np.vstack(
        [
            (intervals - np.arange(intervals) - 0.5) / intervals**2,
            np.full(intervals, 1.0 / intervals),
        ]
    )
    missing = np.vstack([D - w0, w1 - w0]) - weights @ alpha
    return np.asarray(alpha + weights.T @ np.linalg.solve(weights @ weights.T, missing))


def cubic_accelerations(start: Boundary, goal: Boundary, duration: float, grid: Grid) -> Array:
    """Mean accelerations T^2 a of the cubic through both boundary states, shape (N, n).

    Args:
        start, goal: Boundary states.
        duration: Duration of the motion [s].
        grid: Grid of normalised time.
    """
    D, w0, w1 = goal.q - start.q, start.v * duration, goal.v * duration
    s = 0.5 * (grid.nodes[:-1] + grid.nodes[1:])[:, None]
    return np.asarray((6.0 * D - 4.0 * w0 - 2.0 * w1) + s * (6.0 * (w0 + w1) - 12.0 * D))


def _zmp_violation(
    constraints: BoundConstraints,
    start: Boundary,
    alpha: Array,
    duration: float,
    route: Array | None,
) -> float:
    """Largest violation of the ZMP margin at the starts of the intervals [m].

    Infinite where the ground would have to pull.
    """
    N = len(alpha)
    w = start.v * duration + np.vstack(
        [np.zeros((1, alpha.shape[1])), np.cumsum(alpha, axis=0) / N]
    )
    increments = (w[:-1] + 0.5 * alpha / N) / N
    q = start.q + np.vstack([np.zeros((1, alpha.shape[1])), np.cumsum(increments, axis=0)])
    base_positions = None
    if route is not None:  # a straight line is accurate enough
        base_positions = route[0] + np.linspace(0.0, 1.0, N, endpoint=False)[:, None] * (
            route[1] - route[0]
        )
    return constraints.outside(q[:-1], w[:-1], alpha, duration**2, base_positions)


def swung_aside(
    across: float, duration: float, bounds: PathBounds, grid: Grid
) -> tuple[Array, float]:
    r"""Manoeuvre that takes a unicycle sideways: forth and back at two different headings.

    .. math:: \lambda = \tfrac{A}{2} (1 - \cos 2 \pi s), \quad
              \psi = B (\sin 2 \pi s - \tfrac12 \sin 4 \pi s), \quad
              \int \lambda' \psi \, ds = \tfrac{\pi}{2} A B

    Added to a guess, because at constant heading a goal straight to the side cannot be reached to
    first order.

    Args:
        across: Distance to the left of the heading [m].
        duration: Duration of the guess that the manoeuvre is added to [s].
        bounds: Limits of the coordinates; path length and yaw are the last two.
        grid: Grid of normalised time.

    Returns:
        Accelerations T^2 a of path length and yaw at both ends of the intervals, shape (N, 2, 2),
        and the duration T, not less than the given one, at which they and their rates are within
        the limits [s].
    """
    A = np.sqrt(2.0 * abs(across) / np.pi)
    B = np.copysign(A, across)
    s = 2.0 * np.pi * np.stack([grid.nodes[:-1], grid.nodes[1:]], axis=1)
    ahead = 2.0 * np.pi**2 * A * np.cos(s)
    yaw = 4.0 * np.pi**2 * B * (2.0 * np.sin(2.0 * s) - np.sin(s))
    controls = np.stack([ahead, yaw], axis=-1)
    most = np.abs(controls).max(axis=(0, 1))
    rates = np.array([np.pi * A, 4.0 * np.pi * A])  # upper bounds of the largest rates
    needed = np.concatenate(
        [np.sqrt(most / bounds.acceleration[-2:]), rates / bounds.velocity[-2:]]
    )
    return controls, max(duration, float(needed.max()))
