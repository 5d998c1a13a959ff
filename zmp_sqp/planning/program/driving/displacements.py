"""How far a base drives within the intervals of a grid, with derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.ground import Terrain

__all__ = ["HEADING", "Displacements", "runge_kutta"]

# what an interval's displacement depends on: yaw at start, middle and end, then the rate of the
# path length there
HEADING = 6
# the classical rule, Hairer, Norsett & Wanner 1993, II.1
WHOLE = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
# its continuous extension at the middle, II.6
HALF = (5.0 / 24.0, 1.0 / 6.0, 1.0 / 6.0, -1.0 / 24.0)
# (start, middle or end; share of the last stage's rate)
STAGES = ((0, 0.0), (1, 0.5), (1, 0.5), (2, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class Displacements:
    """Displacements over N intervals.

    Attributes:
        whole: Until the ends, shape (N, 2) [m].
        half: Until the middles, shape (N, 2) [m].
        whole_jacobian: Of `whole` by (x, y) at the start and by `HEADING`, shape (N, 2, 8).
        half_jacobian: Of `half`, shape (N, 2, 8).
    """

    whole: Array
    half: Array
    whole_jacobian: Array
    half_jacobian: Array


def runge_kutta(
    terrain: Terrain, positions: Array, yaw: Array, rate: Array, steps: Array
) -> Displacements:
    r"""One step of p' = w G(p, yaw) per interval; where G does not depend on p, Simpson's rule.

    Args:
        terrain: Gives G; beyond a map's rim it is that of the position on the rim, with no
            derivative outwards.
        positions: At the starts of the intervals, shape (N, 2) [m].
        yaw: At their starts, middles and ends, shape (3, N) [rad].
        rate: w, derivative of the path length by normalised time there, shape (3, N) [m].
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
    for (at, share), to_whole, to_half in zip(STAGES, WHOLE, HALF, strict=True):
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
    """The Runge-Kutta step where G does not depend on the position."""
    count = yaw.shape[1]
    pose = np.zeros((3 * count, 3))
    pose[:, 2] = yaw.ravel()
    rates = np.zeros((3 * count, 2))
    rates[:, 0] = rate.ravel()
    found = terrain.ground_rates(pose, rates)
    velocity = found.rates.reshape(3, count, 2)
    by_heading = found.jacobian[:, :, 2:4].reshape(3, count, 2, 2)  # by yaw and by rate
    parts = []
    for weights in (WHOLE, HALF):
        of_point = np.array([weights[0], weights[1] + weights[2], weights[3]])
        share = of_point[:, None] * steps  # (3, N)
        jacobian = np.zeros((count, 2, 2 + HEADING))
        scaled = share[..., None, None] * by_heading
        jacobian[:, :, 2:5] = scaled[..., 0].transpose(1, 2, 0)
        jacobian[:, :, 5:] = scaled[..., 1].transpose(1, 2, 0)
        parts.append((np.einsum("sk,skc->kc", share, velocity), jacobian))
    (whole, whole_jacobian), (half, half_jacobian) = parts
    return Displacements(whole, half, whole_jacobian, half_jacobian)
