"""Displacements of a driving base over the intervals of a grid, with derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.ground import Terrain

__all__ = ["HEADING", "Displacements", "runge_kutta"]

# number of values that an interval's displacement depends on beside the position: yaw at start,
# middle and end, then the rate of the path length there
HEADING = 6
# weights of the classical Runge-Kutta method, Hairer, Norsett & Wanner 1993, II.1
RK_WEIGHTS = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
# weights of its continuous extension at the middle of the step, ibid., II.6
RK_MIDDLE = (5.0 / 24.0, 1.0 / 6.0, 1.0 / 6.0, -1.0 / 24.0)
# for each stage of the method: index of its point (start, middle, end), and the share of the step
# that the previous stage's velocity is followed for
RK_STAGES = ((0, 0.0), (1, 0.5), (1, 0.5), (2, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class Displacements:
    """Displacements of a driving base over N intervals, with their Jacobians.

    Attributes:
        whole: From start to end of each interval, shape (N, 2) [m].
        half: From start to middle of each interval, shape (N, 2) [m].
        whole_jacobian: Jacobian of `whole` by (x, y) at the start and the `HEADING` values, shape
            (N, 2, 8).
        half_jacobian: Jacobian of `half` by these variables, shape (N, 2, 8).
    """

    whole: Array
    half: Array
    whole_jacobian: Array
    half_jacobian: Array


def runge_kutta(
    terrain: Terrain, positions: Array, yaw: Array, rate: Array, steps: Array
) -> Displacements:
    r"""One classical Runge-Kutta step of p' = w G(p, yaw) per interval.

    Where G does not depend on p, this is Simpson's rule.

    Args:
        terrain: Gives G, the velocity per rate of the path length. Positions outside a map are
            moved to its rim; derivatives by such coordinates are zero.
        positions: At the starts of the intervals, shape (N, 2) [m].
        yaw: At starts, middles and ends, shape (3, N) [rad].
        rate: w, derivative of the path length by normalised time, at starts, middles and ends,
            shape (3, N) [m].
        steps: Lengths of the intervals, shape (N,).
    """
    if terrain.uniform:
        return _simpson(terrain, yaw, rate, steps)
    count = len(positions)
    h = steps[:, None]
    low, high = terrain.extent
    velocity, jacobian = np.zeros((count, 2)), np.zeros((count, 2, 2 + HEADING))
    whole, half = np.zeros((2, count, 2))
    whole_jacobian, half_jacobian = np.zeros((2, count, 2, 2 + HEADING))
    for (at, share), to_whole, to_half in zip(RK_STAGES, RK_WEIGHTS, RK_MIDDLE, strict=True):
        position = positions + share * h * velocity
        inside = np.clip(position, low, high)
        pose = np.column_stack([inside, yaw[at]])
        found = terrain.ground_rates(pose, np.column_stack([rate[at], np.zeros(count)]))
        by_position = found.jacobian[:, :, :2] * (inside == position)[:, None, :]
        jacobian = (share * h)[..., None] * (by_position @ jacobian)
        jacobian[:, :, :2] += by_position
        jacobian[:, :, 2 + at] += found.jacobian[:, :, 2]
        jacobian[:, :, 5 + at] += found.jacobian[:, :, 3]
        velocity = found.rates
        whole += to_whole * h * velocity
        half += to_half * h * velocity
        whole_jacobian += to_whole * h[..., None] * jacobian
        half_jacobian += to_half * h[..., None] * jacobian
    return Displacements(whole, half, whole_jacobian, half_jacobian)


def _simpson(terrain: Terrain, yaw: Array, rate: Array, steps: Array) -> Displacements:
    """`runge_kutta` where G does not depend on the position: Simpson's rule."""
    count = yaw.shape[1]
    pose = np.zeros((3 * count, 3))
    pose[:, 2] = yaw.ravel()
    rates = np.zeros((3 * count, 2))
    rates[:, 0] = rate.ravel()
    found = terrain.ground_rates(pose, rates)
    velocity = found.rates.reshape(3, count, 2)
    by_heading = found.jacobian[:, :, 2:4].reshape(3, count, 2, 2)  # by yaw and by rate
    parts = []
    for weights in (RK_WEIGHTS, RK_MIDDLE):
        of_point = np.array([weights[0], weights[1] + weights[2], weights[3]])
        share = of_point[:, None] * steps  # (3, N)
        jacobian = np.zeros((count, 2, 2 + HEADING))
        scaled = share[..., None, None] * by_heading
        jacobian[:, :, 2:5] = scaled[..., 0].transpose(1, 2, 0)
        jacobian[:, :, 5:] = scaled[..., 1].transpose(1, 2, 0)
        parts.append((np.einsum("sk,skc->kc", share, velocity), jacobian))
    (whole, whole_jacobian), (half, half_jacobian) = parts
    return Displacements(whole, half, whole_jacobian, half_jacobian)
