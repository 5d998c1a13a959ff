"""Position of a driving base between the nodes: the integral of its velocity, as polynomials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.errors import TrajectoryError

__all__ = ["PositionCurve"]

# number of Gauss points per polynomial: for a turn in a plane the integration error is far below
# rounding errors
POINTS = 20
MOST_PASSES = 60  # number of Picard iterations after which the integration gives up
SETTLED = 1e-14  # largest change of a converged position, relative to 1 m + largest coordinate
STUCK = 1e-9  # [m] largest change in the last iteration that still counts as converged


def _gauss() -> tuple[Array, Array]:
    """Nodes and weights of Gauss-Legendre quadrature on [0, 1], shape (POINTS,) each."""
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    return 0.5 * (nodes + 1.0), 0.5 * weights


def _integrals(share: Array) -> Array:
    r"""Integrals of the first POINTS shifted Legendre polynomials, shape (..., POINTS).

    .. math::
        \int_0^\tau P_n(2 \sigma - 1) d\sigma
            = \frac{P_{n+1}(2 \tau - 1) - P_{n-1}(2 \tau - 1)}{2 (2 n + 1)}, \quad n > 0

    Args:
        share: Upper limit of integration \tau, from 0 to 1, shape (...).
    """
    values = np.polynomial.legendre.legvander(2.0 * share - 1.0, POINTS)
    order = np.arange(1, POINTS)
    rest = (values[..., 2:] - values[..., :-2]) / (2.0 * (2.0 * order + 1.0))
    return np.concatenate([share[..., None], rest], axis=-1)


GAUSS_NODES, GAUSS_WEIGHTS = _gauss()
# Legendre polynomials at the Gauss points, (points, orders)
_VALUES = np.polynomial.legendre.legvander(2.0 * GAUSS_NODES - 1.0, POINTS - 1)
# matrix from values of a function at the Gauss points to its Legendre coefficients
TO_SERIES = (2.0 * np.arange(POINTS)[:, None] + 1.0) * (_VALUES * GAUSS_WEIGHTS[:, None]).T
# matrix from values of a function at the Gauss points to its integrals from 0 to these points
TO_INTEGRAL = _integrals(GAUSS_NODES) @ TO_SERIES


@dataclass(frozen=True, slots=True, eq=False)
class PositionCurve:
    r"""Curve of positions p = (x, y) over N intervals, whose rate is a piecewise polynomial.

    .. math:: p(t) = p_k + \int_{t_k}^t \dot p\, dt, \quad \dot p = \sum_n c_n P_n

    Each interval is divided into equal pieces, and the rate is one Legendre series on each piece.
    The curve stores displacements from the start p_k of the interval.

    Attributes:
        first: Index of the first piece of each interval, then the number M of pieces, shape
            (N + 1,).
        steps: Durations of the pieces, shape (M,) [s].
        origins: Displacement from the start of the interval to the start of each piece, shape
            (M, 2) [m].
        series: Legendre coefficients c_n of the rate on each piece, shape (M, POINTS, 2) [m/s].
    """

    first: Indices
    steps: Array
    origins: Array
    series: Array

    @classmethod
    def integrated(
        cls,
        positions: Array,
        steps: Array,
        parts: Indices,
        rates: Callable[[Array], Array],
        *,
        chained: bool,
    ) -> tuple[PositionCurve, Array]:
        """Solve dp/dt = rates(p) by collocation at the Gauss points of the pieces.

        The collocation equations are solved by Picard iteration, which converges if the pieces are
        short or the ground is smooth.

        Args:
            positions: Positions at the starts of the intervals, shape (N, 2) [m].
            steps: Durations of the intervals, shape (N,) [s].
            parts: Number of pieces of each interval, shape (N,).
            rates: Function from the positions at the `GAUSS_NODES` of all pieces, shape
                (M, POINTS, 2) [m], to the rates there, shape (M, POINTS, 2) [m/s].
            chained: Whether each interval starts where the one before ends; then only the first of
                `positions` is used.

        Returns:
            Curve, and its positions at the Gauss points, shape (M, POINTS, 2) [m].

        Raises:
            TrajectoryError: The iteration does not converge, because an interval leads too far over
                ground that is too rough.
        """
        first = np.concatenate([[0], np.cumsum(parts)])
        node = np.repeat(first[:-1], parts)
        steps, starts = np.repeat(steps / parts, parts), np.repeat(positions, parts, axis=0)
        at, change = np.repeat(starts[:, None], POINTS, axis=1), np.inf
        for _ in range(MOST_PASSES):
            found = rates(at)
            ends = np.cumsum(steps[:, None] * (GAUSS_WEIGHTS @ found), axis=0)
            begins = np.vstack([np.zeros(2), ends[:-1]])
            origins = begins - begins[node]
            piece_starts = starts[0] + begins if chained else starts + origins
            improved = piece_starts[:, None] + steps[:, None, None] * (TO_INTEGRAL @ found)
            change = float(np.abs(improved - at).max(initial=0.0))
            at = improved
            if not change > SETTLED * (1.0 + float(np.abs(at).max(initial=0.0))):
                break
        if not change <= STUCK:
            raise TrajectoryError(
                "the base's path between its nodes cannot be found to better than "
                f"{change:.3g} m: give more nodes"
            )
        return cls(first, steps, origins, TO_SERIES @ found), at

    @property
    def pieces(self) -> Indices:
        """Number of pieces of each interval, shape (N,)."""
        return np.diff(self.first)

    def displacement(self, k: Indices, since: Array) -> Array:
        """Displacement since the start of an interval.

        Args:
            k: Indices of the intervals, shape (K,).
            since: Times since the starts of these intervals, shape (K,) [s].

        Returns:
            Displacements, shape (K, 2) [m].
        """
        step = self.steps[self.first[k]]
        share = np.divide(since, step, out=np.zeros_like(since), where=step > 0.0)
        number = np.clip(share.astype(int), 0, self.first[k + 1] - self.first[k] - 1)
        piece = self.first[k] + number
        within = np.einsum("kn,knc->kc", _integrals(share - number), self.series[piece])
        return np.asarray(self.origins[piece] + step[:, None] * within)
