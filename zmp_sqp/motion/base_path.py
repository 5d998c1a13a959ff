"""Where a base drives between nodes: its place as polynomials of high degree, from its speed and yaw."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.errors import TrajectoryError

__all__ = ["PositionCurve"]

POINTS = 20  # per interval: exact far beyond rounding for a turn in a plane
MOST_PASSES = 60
SETTLED = 1e-14  # of the distance driven: smaller changes are rounding
STUCK = 1e-9  # [m] larger ones mean that the passes do not converge


def _gauss() -> tuple[Array, Array]:
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    return 0.5 * (nodes + 1.0), 0.5 * weights


def _integrals(share: Array) -> Array:
    r"""Integrals of the Legendre polynomials over [0, share], shape (..., POINTS).

    .. math:: \int_0^\tau P_n(2 \sigma - 1) d\sigma = \frac{P_{n+1} - P_{n-1}}{2 (2 n + 1)}(2 \tau -
        1), \quad n > 0
    """
    values = np.polynomial.legendre.legvander(2.0 * share - 1.0, POINTS)
    order = np.arange(1, POINTS)
    rest = (values[..., 2:] - values[..., :-2]) / (2.0 * (2.0 * order + 1.0))
    return np.concatenate([share[..., None], rest], axis=-1)


GAUSS_NODES, GAUSS_WEIGHTS = _gauss()
_VALUES = np.polynomial.legendre.legvander(2.0 * GAUSS_NODES - 1.0, POINTS - 1)  # (points, orders)
# from values at the points
TO_SERIES = (2.0 * np.arange(POINTS)[:, None] + 1.0) * (_VALUES * GAUSS_WEIGHTS[:, None]).T
TO_INTEGRAL = (
    _integrals(GAUSS_NODES) @ TO_SERIES
)  # from values at the points to integrals up to them


@dataclass(frozen=True, slots=True, eq=False)
class PositionCurve:
    r"""Displacements from the nodes: intervals are cut into equal pieces, each a Legendre series by its share.

    .. math:: p(t) = p_k + \int_{t_k}^t \dot p\, dt, \quad \dot p = \sum_n c_n P_n

    Attributes:
        first: First piece of each interval, and their number M, shape (N + 1,).
        steps: Lengths of the pieces, shape (M,) [s].
        origins: Displacement where each piece begins, from the node, shape (M, 2) [m].
        series: c, shape (M, POINTS, 2) [m/s].
    """

    first: Indices
    steps: Array
    origins: Array
    series: Array

    @classmethod
    def integrated(
        cls,
        places: Array,
        steps: Array,
        parts: Indices,
        rates: Callable[[Array], Array],
        *,
        chained: bool,
    ) -> tuple[PositionCurve, Array]:
        """Collocation at Gauss points, by passes of Picard, which contract as the path is short or the ground smooth.

        Args:
            places: At the starts of the intervals, shape (N, 2) [m].
            steps: Lengths of the intervals, shape (N,) [s].
            parts: Into how many pieces each one is cut, shape (N,).
            rates: From places at `GAUSS_NODES` of the pieces, shape (M, POINTS, 2), to their rates
                there, likewise.
            chained: Whether only the first place is given and each of the others is where the
                interval before ends.

        Returns:
            The curve, and the places at its Gauss points, shape (M, POINTS, 2).

        Raises:
            TrajectoryError: The passes do not converge: an interval leads too far over ground that
                is too rough.
        """
        first = np.concatenate([[0], np.cumsum(parts)])
        node = np.repeat(first[:-1], parts)
        steps, starts = np.repeat(steps / parts, parts), np.repeat(places, parts, axis=0)
        at, change = np.repeat(starts[:, None], POINTS, axis=1), np.inf
        for _ in range(MOST_PASSES):
            found = rates(at)
            ends = np.cumsum(steps[:, None] * (GAUSS_WEIGHTS @ found), axis=0)
            begins = np.vstack([np.zeros(2), ends[:-1]])
            origins = begins - begins[node]
            here = starts[0] + begins if chained else starts + origins
            moved = here[:, None] + steps[:, None, None] * (TO_INTEGRAL @ found)
            change = float(np.abs(moved - at).max(initial=0.0))
            at = moved
            if not change > SETTLED * (1.0 + float(np.abs(at).max(initial=0.0))):
                break
        if not change <= STUCK:
            raise TrajectoryError(
                f"the base's path between its nodes cannot be found to better than {change:.3g} m: give more nodes"
            )
        return cls(first, steps, origins, TO_SERIES @ found), at

    @property
    def pieces(self) -> Indices:
        """Into how many pieces each interval is cut, shape (N,)."""
        return np.diff(self.first)

    def displacement(self, k: Indices, since: Array) -> Array:
        """From the starts of intervals k over the times `since`, shape (K, 2) [m]."""
        step = self.steps[self.first[k]]
        share = np.divide(since, step, out=np.zeros_like(since), where=step > 0.0)
        number = np.clip(share.astype(int), 0, self.first[k + 1] - self.first[k] - 1)
        piece = self.first[k] + number
        within = np.einsum("kn,knc->kc", _integrals(share - number), self.series[piece])
        return np.asarray(self.origins[piece] + step[:, None] * within)
