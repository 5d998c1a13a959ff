"""How far a base drives within the intervals of a transcription: one Runge-Kutta step each, with its derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.ground import Terrain

__all__ = ["COURSE", "Moves", "runge_kutta_moves"]

COURSE = 6  # yaw at start, middle, end; then the rate of the way there
# the classical rule, Hairer, Norsett & Wanner 1993, II.1
WHOLE = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
# its continuous extension at the middle, II.6
HALF = (5.0 / 24.0, 1.0 / 6.0, 1.0 / 6.0, -1.0 / 24.0)
# (start, middle or end; share of the last stage's rate)
STAGES = ((0, 0.0), (1, 0.5), (1, 0.5), (2, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """Displacements over N intervals.

    Attributes:
        whole: Until the ends, shape (N, 2) [m].
        half: Until the middles, shape (N, 2) [m].
        whole_slopes: Of the first by (x, y) at the start and by the course (`COURSE`), shape (N, 2,
            8).
        half_slopes: Of the second, shape (N, 2, 8).
    """

    whole: Array
    half: Array
    whole_slopes: Array
    half_slopes: Array


def runge_kutta_moves(terrain: Terrain, places: Array, psi: Array, w: Array) -> Moves:
    r"""One step of p' = w G(p, psi) per interval; where G does not depend on p, Simpson's rule.

    Args:
        terrain: Gives G; beyond a map's rim it is that of the place on the rim, with no slope
            outwards.
        places: At the starts of the intervals, shape (N, 2) [m].
        psi: Yaw at their starts, middles and ends, shape (3, N) [rad].
        w: Rate of the way there, in normalised time, shape (3, N) [m].
    """
    count = len(places)
    h = 1.0 / count
    low, high = terrain.extent
    rate, slope = np.zeros((count, 2)), np.zeros((count, 2, 2 + COURSE))
    whole, half = np.zeros((2, count, 2))
    whole_slopes, half_slopes = np.zeros((2, count, 2, 2 + COURSE))
    for (at, share), to_whole, to_half in zip(STAGES, WHOLE, HALF, strict=True):
        place = places + (h * share) * rate
        inside = np.clip(place, low, high)
        pose = np.column_stack([inside, psi[at]])
        found = terrain.ground_rates(pose, np.column_stack([w[at], np.zeros(count)]))
        by_place = found.jacobian[:, :, :2] * (inside == place)[:, None, :]
        slope = (h * share) * (by_place @ slope)
        slope[:, :, :2] += by_place
        slope[:, :, 2 + at] += found.jacobian[:, :, 2]
        slope[:, :, 5 + at] += found.jacobian[:, :, 3]
        rate = found.rates
        whole += (h * to_whole) * rate
        half += (h * to_half) * rate
        whole_slopes += (h * to_whole) * slope
        half_slopes += (h * to_half) * slope
    return Moves(whole, half, whole_slopes, half_slopes)
