"""Grid of normalised time, and motions whose accelerations are linear within its intervals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array

__all__ = ["ENDS", "Grid", "shapes"]

ENDS = 2  # controls per interval: the accelerations at its start and at its end
NESTED = 12  # decimals to which the nodes of nested grids agree
SAMPLES = 8  # per interval, by which accelerations are projected on a grid that does not nest


def shapes(s: float) -> tuple[Array, Array, Array]:
    r"""What the two end accelerations of an interval contribute at a share s of it, (2,) each.

    .. math:: \alpha = B u, \quad w = w_k + h B^{(-1)} u, \quad
              q = q_k + h s w_k + h^2 B^{(-2)} u, \quad B = (1 - s, s)

    Returns:
        B and its first and second integrals.
    """
    return (
        np.array([1.0 - s, s]),
        np.array([s - 0.5 * s**2, 0.5 * s**2]),
        np.array([0.5 * s**2 - s**3 / 6.0, s**3 / 6.0]),
    )


TO_RATE, TO_POSITION = shapes(1.0)[1:]


@dataclass(frozen=True, eq=False)
class Grid:
    """Nodes 0 = s_0 < ... < s_N = 1 of normalised time.

    Attributes:
        nodes: Shape (N + 1,).
        uniform: Whether all intervals are equally long.
    """

    nodes: Array
    uniform: bool

    @classmethod
    def of(cls, given: Any) -> Grid:
        """A grid of a number of equal intervals, or of nodes."""
        if np.ndim(given) == 0:
            return cls(np.linspace(0.0, 1.0, int(given) + 1), uniform=True)
        return cls(np.asarray(given, dtype=float), uniform=False)

    @property
    def size(self) -> int:
        """Number N of intervals."""
        return len(self.nodes) - 1

    @cached_property
    def steps(self) -> Array:
        """Lengths h of the intervals, shape (N,)."""
        if self.uniform:
            return np.full(self.size, 1.0 / self.size)
        return np.diff(self.nodes)

    @cached_property
    def sums(self) -> Array:
        """What unit accelerations at all ends add to the last position and rate, shape (2, 2N)."""
        to_rate = np.outer(self.steps, TO_RATE)
        rest = 1.0 - self.nodes[1:]
        to_position = np.outer(self.steps**2, TO_POSITION) + rest[:, None] * to_rate
        return np.vstack([to_position.ravel(), to_rate.ravel()])

    @cached_property
    def least_changes(self) -> Array:
        """Smallest accelerations that change last position and rate by one, shape (2N, 2)."""
        return np.asarray(self.sums.T @ np.linalg.inv(self.sums @ self.sums.T))

    @cached_property
    def rates_by_controls(self) -> Array:
        """Rates at starts, middles and ends of the intervals by unit accelerations, (3, N, 2N)."""
        N = self.size
        unit = np.eye(2 * N).reshape(2 * N, N, 2).transpose(1, 2, 0)  # (N, 2, 2N)
        q, w = self.rolled(np.zeros(2 * N), np.zeros(2 * N), unit)
        middle = self.within(0.5, q[:-1], w[:-1], unit)[1]
        return np.stack([w[:-1], middle, w[1:]])

    def rolled(self, q: Array, w: Array, controls: Array) -> tuple[Array, Array]:
        """Positions and rates at all nodes, shape (N + 1, n) each.

        Args:
            q, w: At the first node, shape (n,) each.
            controls: Accelerations at the intervals' ends, shape (N, 2, n).
        """
        h = self.steps[:, None]
        rates = np.empty((self.size + 1, len(q)))
        rates[0] = w
        np.cumsum(h * np.einsum("c,kcn->kn", TO_RATE, controls), axis=0, out=rates[1:])
        rates[1:] += w
        positions = np.empty_like(rates)
        positions[0] = q
        moved = h * rates[:-1] + h**2 * np.einsum("c,kcn->kn", TO_POSITION, controls)
        np.cumsum(moved, axis=0, out=positions[1:])
        positions[1:] += q
        return positions, rates

    def within(self, s: float, q: Array, w: Array, controls: Array) -> tuple[Array, Array, Array]:
        """States (q, w, alpha) at a share s of all intervals, shape (N, n) each.

        Args:
            s: Share of the interval.
            q, w: At the starts of the intervals, shape (N, n) each.
            controls: Shape (N, 2, n).
        """
        level, once, twice = shapes(s)
        h = self.steps[:, None]
        position = q + s * h * w + h**2 * np.einsum("c,kcn->kn", twice, controls)
        rate = w + h * np.einsum("c,kcn->kn", once, controls)
        return position, rate, np.einsum("c,kcn->kn", level, controls)

    def parents(self, fine: Grid) -> Array:
        """Interval of this grid that the middle of each of a finer grid's intervals is in."""
        middles = fine.nodes[:-1] + 0.5 * fine.steps
        found = np.searchsorted(self.nodes, middles, side="right") - 1
        return np.asarray(np.clip(found, 0, self.size - 1))

    def on(self, fine: Grid, controls: Array) -> Array:
        """Accelerations of this grid (N, 2, n) on a finer one: exact where it is nested."""
        parent = self.parents(fine)
        if set(np.round(self.nodes, NESTED)) <= set(np.round(fine.nodes, NESTED)):
            start, end = controls[parent, 0], controls[parent, 1]
            shares = (
                (fine.nodes[ends] - self.nodes[parent]) / self.steps[parent]
                for ends in (slice(None, -1), slice(1, None))
            )
            return np.stack([start + (end - start) * s[:, None] for s in shares], axis=1)
        s = (np.arange(SAMPLES) + 0.5) / SAMPLES
        at = fine.nodes[:-1, None] + s * fine.steps[:, None]
        k = np.clip(np.searchsorted(self.nodes, at, side="right") - 1, 0, self.size - 1)
        share = ((at - self.nodes[k]) / self.steps[k])[..., None]
        values = controls[k, 0] + (controls[k, 1] - controls[k, 0]) * share
        mean = values.mean(axis=1)
        slant = np.einsum("m,kmn->kn", s - 0.5, values) / ((s - 0.5) ** 2).sum()
        return np.stack([mean - 0.5 * slant, mean + 0.5 * slant], axis=1)
