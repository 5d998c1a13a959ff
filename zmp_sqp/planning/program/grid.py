"""Grid of normalised time, and integration of accelerations that are linear in its intervals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.cached import cached_property

__all__ = ["ENDS", "Grid", "hermite_shapes", "shapes"]

ENDS = 2  # controls per interval: the accelerations at its start and at its end
NESTED = 12  # decimals to which nodes are compared, to tell whether one grid contains the other
SAMPLES = 8  # per interval, for the least-squares projection on a grid that is not nested


@lru_cache(maxsize=64)
def shapes(s: float) -> tuple[Array, Array, Array]:
    r"""Shape functions of an interval: acceleration, rate and position per unit end acceleration.

    .. math:: \alpha = B u, \quad w = w_k + h B^{(-1)} u, \quad
              q = q_k + h s w_k + h^2 B^{(-2)} u, \quad B = (1 - s, s)

    where u holds the accelerations at start and end of the interval, and h is its length.

    Args:
        s: Share of the interval, 0 to 1.

    Returns:
        B and its first and second integrals by s, shape (2,) each.
    """
    return (
        np.array([1.0 - s, s]),
        np.array([s - 0.5 * s**2, 0.5 * s**2]),
        np.array([0.5 * s**2 - s**3 / 6.0, s**3 / 6.0]),
    )


@lru_cache(maxsize=64)
def hermite_shapes(s: float) -> Array:
    r"""Shape functions of cubic Hermite interpolation on an interval of unit length.

    .. math:: q = H_0 \cdot (q_k, w_k, q_{k+1}, w_{k+1}), \quad w = H_1 \cdot (\ldots), \quad
              \alpha = H_2 \cdot (\ldots)

    Args:
        s: Share of the interval, 0 to 1.

    Returns:
        The rows H_0 and, as its first and second derivatives by s, H_1 and H_2, shape (3, 4).
    """
    return np.array(
        [
            [2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, 3 * s**2 - 2 * s**3, s**3 - s**2],
            [6 * s**2 - 6 * s, 3 * s**2 - 4 * s + 1, 6 * s - 6 * s**2, 3 * s**2 - 2 * s],
            [12 * s - 6, 6 * s - 4, 6 - 12 * s, 6 * s - 2],
        ]
    )


# change of rate and position over a unit interval per unit acceleration at its start and its end
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
        """Grid from a number of equal intervals, or from an array of nodes."""
        if np.ndim(given) == 0:
            return cls(np.linspace(0.0, 1.0, int(given) + 1), uniform=True)
        return cls(np.asarray(given, dtype=float), uniform=False)

    @property
    def size(self) -> int:
        """Number N of intervals."""
        return len(self.nodes) - 1

    @cached_property
    def steps(self) -> Array:
        """Lengths h of the intervals in normalised time, shape (N,)."""
        if self.uniform:
            return np.full(self.size, 1.0 / self.size)
        return np.diff(self.nodes)

    @cached_property
    def sums(self) -> Array:
        """Jacobian of last position and rate by the accelerations at all ends, shape (2, 2N)."""
        to_rate = np.outer(self.steps, TO_RATE)
        rest = 1.0 - self.nodes[1:]
        to_position = np.outer(self.steps**2, TO_POSITION) + rest[:, None] * to_rate
        return np.vstack([to_position.ravel(), to_rate.ravel()])

    @cached_property
    def least_changes(self) -> Array:
        """Pseudo-inverse of `sums`, shape (2N, 2).

        Times a wanted change of the last position and rate it gives the least-norm change of the
        accelerations.
        """
        return np.asarray(self.sums.T @ np.linalg.inv(self.sums @ self.sums.T))

    @cached_property
    def rates_by_controls(self) -> Array:
        """Jacobian of the rates at starts, middles and ends by the accelerations, (3, N, 2N)."""
        N = self.size
        unit = np.eye(2 * N).reshape(2 * N, N, 2).transpose(1, 2, 0)  # (N, 2, 2N)
        q, w = self.rolled(np.zeros(2 * N), np.zeros(2 * N), unit)
        middle = self.within(0.5, q[:-1], w[:-1], unit)[1]
        return np.stack([w[:-1], middle, w[1:]])

    def rolled(self, q: Array, w: Array, controls: Array) -> tuple[Array, Array]:
        """Integrate accelerations: positions and rates at all nodes, shape (N + 1, n) each.

        Args:
            q, w: Position and rate at the first node, shape (n,) each.
            controls: Accelerations at the intervals' ends, shape (N, 2, n).
        """
        h = self.steps[:, None]
        rates = np.empty((self.size + 1, len(q)))
        rates[0] = w
        np.cumsum(h * np.einsum("c,kcn->kn", TO_RATE, controls), axis=0, out=rates[1:])
        rates[1:] += w
        positions = np.empty_like(rates)
        positions[0] = q
        increments = h * rates[:-1] + h**2 * np.einsum("c,kcn->kn", TO_POSITION, controls)
        np.cumsum(increments, axis=0, out=positions[1:])
        positions[1:] += q
        return positions, rates

    def within(self, s: float, q: Array, w: Array, controls: Array) -> tuple[Array, Array, Array]:
        """Positions, rates and accelerations at a share s of every interval, shape (N, n) each.

        Args:
            s: Share of the interval, 0 to 1.
            q, w: Position and rate at the starts of the intervals, shape (N, n) each.
            controls: Accelerations at the intervals' ends, shape (N, 2, n).
        """
        level, once, twice = shapes(s)
        h = self.steps[:, None]
        position = q + s * h * w + h**2 * np.einsum("c,kcn->kn", twice, controls)
        rate = w + h * np.einsum("c,kcn->kn", once, controls)
        return position, rate, np.einsum("c,kcn->kn", level, controls)

    def divided(self, parts: Any) -> Grid:
        """Grid with every interval divided into equal parts.

        Args:
            parts: Number of parts, of all intervals or of each, shape (N,).
        """
        counts = np.broadcast_to(np.asarray(parts, dtype=int), self.size)
        k = np.repeat(np.arange(self.size), counts)
        number = np.arange(len(k)) - (np.cumsum(counts) - counts)[k]
        inner = self.nodes[k] + self.steps[k] * (number / counts[k])
        return Grid(np.append(inner, self.nodes[-1]), uniform=False)

    def refined(self, intervals: int) -> Grid:
        """Grid of a larger number of intervals, with all nodes of this one, as even as possible."""
        counts = np.maximum(np.floor(intervals * self.steps), 1.0)
        while counts.sum() != intervals:
            sizes = self.steps / counts
            if counts.sum() < intervals:
                counts[np.argmax(sizes)] += 1.0
            else:
                counts[np.argmin(np.where(counts > 1.0, sizes, np.inf))] -= 1.0
        return self.divided(counts)

    def parents(self, fine: Grid) -> Array:
        """Index of the interval of this grid that each interval of a finer grid lies in, (N_fine,).

        Decided by the middles of the fine intervals.
        """
        middles = fine.nodes[:-1] + 0.5 * fine.steps
        found = np.searchsorted(self.nodes, middles, side="right") - 1
        return np.asarray(np.clip(found, 0, self.size - 1))

    def on(self, fine: Grid, controls: Array) -> Array:
        """Accelerations of this grid on a finer grid, shape (N_fine, 2, n).

        Exact where the finer grid contains all nodes of this one; otherwise the least-squares line
        in each fine interval.

        Args:
            fine: The finer grid.
            controls: Accelerations on this grid, shape (N, 2, n).
        """
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
        rise = np.einsum("m,kmn->kn", s - 0.5, values) / ((s - 0.5) ** 2).sum()
        return np.stack([mean - 0.5 * rise, mean + 0.5 * rise], axis=1)
