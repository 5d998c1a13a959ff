"""Initial guess of the SQP: within the joint limits, and so slow that the ZMP is not far out."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.motion.double_integrator import grid_profile
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.limits import Boundary, PathBounds
from zmp_sqp.planning.program.rows import BoundConstraints

__all__ = ["initial_guess", "swung_aside"]

SLOWER = 1.5  # factor between trials
TRIALS = 24  # 1.5^24 is a factor of 17 000
FAR_OUT = 1.0  # of the polygon's half-width: guesses further out than this are slowed down
# where poses on the way do not stand: a pace as good, but for this factor, as standing still in
# them
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

    From rest to rest it is the synchronised bang-coast-bang motion on the grid, at its least
    duration unless the ZMP would be out by more than the polygon's own size; in motion it is the
    cubic that meets both ends.

    Args:
        constraints: For the ZMP of the trials.
        start: Boundary at the start.
        goal: Boundary at the goal.
        bounds: Limits of the coordinates.
        intervals: N.
        least_duration: Proven lower bound on this grid [s].
        smooth: The cubic from rest to rest, too.
        route: Places where a base begins and ends, shape (2, 2) [m]; None stands still.
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
        trials.append((alpha, duration, _worst(constraints, start, alpha, duration, route)))
        if trials[-1][2] <= FAR_OUT * size:
            return alpha, duration
        duration *= SLOWER
    # no pace mends that: the slowest would be thousands of times too slow, and sets the scale of
    # time
    enough = NEARLY * min(worst for _, _, worst in trials)
    return next((alpha, duration) for alpha, duration, worst in trials if worst <= enough)


def _cubic(start: Boundary, goal: Boundary, duration: float, intervals: int) -> Array:
    """Mean accelerations of the cubic through both boundary states, changed so that it arrives."""
    D, w0, w1 = goal.q - start.q, start.v * duration, goal.v * duration
    s = (np.arange(intervals)[:, None] + 0.5) / intervals
    alpha = (6.0 * D - 4.0 * w0 - 2.0 * w1) + s * (6.0 * (w0 + w1) - 12.0 * D)
    weights = np.vstack(
        [
            (intervals - np.arange(intervals) - 0.5) / intervals**2,
            np.full(intervals, 1.0 / intervals),
        ]
    )
    miss = np.vstack([D - w0, w1 - w0]) - weights @ alpha
    return np.asarray(alpha + weights.T @ np.linalg.solve(weights @ weights.T, miss))


def _worst(
    constraints: BoundConstraints,
    start: Boundary,
    alpha: Array,
    duration: float,
    route: Array | None,
) -> float:
    """How far out the ZMP is at the starts of the intervals [m]; infinite without contact."""
    N = len(alpha)
    w = start.v * duration + np.vstack(
        [np.zeros((1, alpha.shape[1])), np.cumsum(alpha, axis=0) / N]
    )
    moved = (w[:-1] + 0.5 * alpha / N) / N
    q = start.q + np.vstack([np.zeros((1, alpha.shape[1])), np.cumsum(moved, axis=0)])
    places = None
    if route is not None:  # straight on will do
        places = route[0] + np.linspace(0.0, 1.0, N, endpoint=False)[:, None] * (
            route[1] - route[0]
        )
    return constraints.outside(q[:-1], w[:-1], alpha, duration**2, places)


def swung_aside(
    across: float, duration: float, bounds: PathBounds, grid: Grid
) -> tuple[Array, float]:
    r"""What takes a unicycle sideways: there and back again, at two different headings.

    .. math:: \lambda = \tfrac{A}{2} (1 - \cos 2 \pi s), \quad
              \psi = B (\sin 2 \pi s - \tfrac12 \sin 4 \pi s), \quad
              \int \lambda' \psi \, ds = \tfrac{\pi}{2} A B

    Without it a goal straight to the side would be out of reach to first order.

    Args:
        across: Distance to the left of the heading [m].
        duration: Of the motion that this is added to [s].
        bounds: Limits; path length and yaw are the last two coordinates.
        grid: Of normalised time.

    Returns:
        Accelerations T^2 a of path length and yaw at both ends of the intervals, shape (N, 2, 2),
        and the duration T at which they and their rates are within the limits [s].
    """
    A = np.sqrt(2.0 * abs(across) / np.pi)
    B = np.copysign(A, across)
    s = 2.0 * np.pi * np.stack([grid.nodes[:-1], grid.nodes[1:]], axis=1)
    ahead = 2.0 * np.pi**2 * A * np.cos(s)
    yaw = 4.0 * np.pi**2 * B * (2.0 * np.sin(2.0 * s) - np.sin(s))
    controls = np.stack([ahead, yaw], axis=-1)
    most = np.abs(controls).max(axis=(0, 1))
    rates = np.array([np.pi * A, 4.0 * np.pi * A])  # at most
    needed = np.concatenate(
        [np.sqrt(most / bounds.acceleration[-2:]), rates / bounds.velocity[-2:]]
    )
    return controls, max(duration, float(needed.max()))
