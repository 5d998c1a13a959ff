"""Where a base may be at the nodes: inside its bounds on x and y, and on the map."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.mechanics.ground import Terrain
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase

__all__ = ["corridor_rows"]

CORRIDOR_GUARD = 1e-7  # [m] kept inside x and y bounds at the nodes
RIM_GUARD = 0.02  # [m] kept inside the map at the nodes, so that it is not left between them


def corridor_rows(
    base: UnicycleBase,
    terrain: Terrain,
    columns: Indices,
    *,
    size: int,
    reach: float,
    drawn_in: float = 0.0,
) -> tuple[sp.csr_array, Array]:
    """Rows R and bounds b with R x <= b: positions of the nodes between the bounds that there are.

    Args:
        base: Start and goal, between which the bounds hold in any case, and the bounds on x and y.
        terrain: Its extent bounds the positions, too.
        columns: Where x and y of the nodes stand among the variables, shape (K, 2).
        size: Number of variables.
        reach: Of the tracks from the base's place: it stays so far inside a map [m].
        drawn_in: By how much the nodes stay inside x and y bounds, so that these hold between them,
            too [m].
    """
    lower, upper = base.position_bounds
    low, high = terrain.extent
    guard = CORRIDOR_GUARD + drawn_in
    lower = np.maximum(lower + guard, low + reach + RIM_GUARD)
    upper = np.minimum(upper - guard, high - reach - RIM_GUARD)
    both = np.vstack([base.start[:2], base.goal[:2]])
    lower, upper = np.minimum(lower, both.min(axis=0)), np.maximum(upper, both.max(axis=0))
    index, signs, edges = [np.zeros(0, dtype=int)], [np.zeros(0)], [np.zeros(0)]
    for axis in range(2):
        for sign, bound in ((1.0, upper[axis]), (-1.0, lower[axis])):
            if np.isfinite(bound):
                index.append(columns[:, axis])
                signs.append(np.full(len(columns), sign))
                edges.append(np.full(len(columns), sign * bound))
    count = sum(len(part) for part in edges)
    entries = (np.concatenate(signs), (np.arange(count), np.concatenate(index)))
    return sp.csr_array(entries, shape=(count, size)), np.concatenate(edges)
