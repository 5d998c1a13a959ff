"""Where each variable and row of the transcription stands, and the fixed sparsity of its Jacobians."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy.sparse as sp

from zmp_sqp.arrays import Array, Indices

__all__ = ["Layout", "layout_of"]


@dataclass(frozen=True)
class Layout:
    """Index arithmetic of N intervals, n coordinates and E wrench rows per interval end.

    Variables: positions, rates, accelerations, sigma. Inequalities: wrench rows (starts of all intervals, then ends, then
    middle control points; E each), accelerations (upper, lower), rates (upper, lower; all nodes), positions at the nodes
    (upper, lower), middle control points (upper, lower), sigma. Equalities: first state, gaps of q, gaps of w, last state.
    """

    N: int
    n: int
    E: int

    @property
    def size(self) -> int:
        """Number of variables."""
        return (3 * self.N + 2) * self.n + 1

    @property
    def positions(self) -> slice:
        """Of the variables."""
        return slice(0, (self.N + 1) * self.n)

    @property
    def rates(self) -> slice:
        """Of the variables."""
        return slice((self.N + 1) * self.n, 2 * (self.N + 1) * self.n)

    @property
    def accelerations(self) -> slice:
        """Of the variables."""
        return slice(2 * (self.N + 1) * self.n, self.size - 1)

    @cached_property
    def free(self) -> Indices:
        """Accelerations and sigma: what is left when the gaps are eliminated."""
        return np.arange(self.accelerations.start, self.size)

    @property
    def eliminated(self) -> int:
        """Equalities that the basis satisfies: the first state and the gaps."""
        return 2 * self.n + 2 * self.N * self.n

    @property
    def wrench_rows(self) -> int:
        """Number of wrench rows."""
        return 3 * self.N * self.E

    @property
    def inequalities(self) -> int:
        """Number of inequalities."""
        return self.wrench_rows + (2 * self.N + 4 * (self.N + 1) + 2 * self.N) * self.n + 1

    @property
    def rate_rows(self) -> slice:
        """Of the inequalities."""
        first = self.wrench_rows + 2 * self.N * self.n
        return slice(first, first + 2 * (self.N + 1) * self.n)

    def split(self, x: Array) -> tuple[Array, Array, Array, float]:
        """Scaled (q, w, alpha, sigma)."""
        shape = (-1, self.n)
        q, w, alpha = x[self.positions].reshape(shape), x[self.rates].reshape(shape), x[self.accelerations].reshape(shape)
        return q, w, alpha, float(x[-1])

    def join(self, q: Array, w: Array, alpha: Array, sigma: float) -> Array:
        """The inverse of `split`."""
        return np.concatenate([q.ravel(), w.ravel(), alpha.ravel(), [sigma]])

    @cached_property
    def end_columns(self) -> Indices:
        """Columns (q, w, alpha, sigma) that each interval end touches, shape (2N, 3n + 1)."""
        node = np.concatenate([np.arange(self.N), np.arange(1, self.N + 1)])[:, None] * self.n + np.arange(self.n)
        interval = np.tile(np.arange(self.N), 2)[:, None] * self.n + np.arange(self.n)
        sigma = np.full((2 * self.N, 1), self.size - 1)
        return np.hstack([node, node + self.rates.start, interval + self.accelerations.start, sigma])

    @cached_property
    def _inequality_pattern(self) -> tuple[Indices, Indices]:
        """Column indices and row pointers of the inequalities' CSR matrix."""
        touched = np.vstack([self.end_columns, self.end_columns[: self.N]])  # a control point is seen from the start
        columns = [np.repeat(touched, self.E, axis=0).ravel()]
        counts = [np.full(self.wrench_rows, 3 * self.n + 1)]
        q, w, alpha = (np.arange(part.start, part.stop) for part in (self.positions, self.rates, self.accelerations))
        for part in (alpha, alpha, w, w):
            columns.append(np.column_stack([part, np.full(len(part), self.size - 1)]).ravel())
            counts.append(np.full(len(part), 2))
        columns += [q, q]
        counts += [np.ones(2 * len(q), dtype=np.intp)]
        middle = np.column_stack([q[: -self.n], w[: -self.n]]).ravel()
        columns += [middle, middle, np.array([self.size - 1])]
        counts += [np.full(2 * self.N * self.n, 2), np.ones(1, dtype=np.intp)]
        return np.concatenate(columns), np.concatenate([[0], np.cumsum(np.concatenate(counts))])

    def inequality_jacobian(
        self, slopes: Array, *, acceleration_share: Array, rate_slope: Array, half_step: Array
    ) -> sp.csr_array:
        """Jacobian of the inequalities.

        Args:
            slopes: Of the wrench rows at starts, ends and middle control points, shape (3N, E, 3n + 1).
            acceleration_share: Of sigma in the acceleration limits, shape (n,).
            rate_slope: Derivative of the rate limits by sigma, shape (n,).
            half_step: What a rate adds to its interval's middle control point, shape (n,).
        """
        N, nodes = self.N, self.N + 1
        parts = [slopes.ravel()]
        for rows, share in ((N, acceleration_share), (nodes, rate_slope)):
            limit = np.tile(-share, rows)
            one = np.ones_like(limit)
            parts += [np.column_stack([one, limit]).ravel(), np.column_stack([-one, limit]).ravel()]
        one = np.ones(nodes * self.n)
        middle = np.column_stack([np.ones(N * self.n), np.tile(half_step, N)]).ravel()
        parts += [one, -one, middle, -middle, np.array([-1.0])]
        return self._csr(np.concatenate(parts), self._inequality_pattern, self.inequalities)

    @cached_property
    def _equality_pattern(self) -> tuple[Indices, Indices]:
        """Column indices and row pointers of the equalities' CSR matrix."""
        N, n = self.N, self.n
        q, w, alpha = (np.arange(part.start, part.stop) for part in (self.positions, self.rates, self.accelerations))
        sigma = np.full(n, self.size - 1)
        columns = [
            q[:n], np.column_stack([w[:n], sigma]).ravel(),
            np.column_stack([q[:-n], q[n:], w[:-n], alpha]).ravel(), np.column_stack([w[:-n], w[n:], alpha]).ravel(),
            q[-n:], np.column_stack([w[-n:], sigma]).ravel(),
        ]  # fmt: skip
        counts = np.repeat([1, 2, 4, 3, 1, 2], [n, n, N * n, N * n, n, n])
        return np.concatenate(columns), np.concatenate([[0], np.cumsum(counts)])

    def equality_jacobian(
        self, *, rate_scale: Array, acceleration_scale: Array, first: Array, last: Array
    ) -> sp.csr_array:
        """Jacobian of the equalities.

        Args:
            rate_scale: w per scaled rate, shape (n,).
            acceleration_scale: alpha per scaled acceleration, shape (n,).
            first: Derivatives of the first rates' rows by sigma, shape (n,).
            last: Likewise of the last rates' rows.
        """
        N, one = self.N, np.ones(self.n)
        gap_q = np.column_stack([-one, one, -rate_scale / N, -0.5 * acceleration_scale / N**2]).ravel()
        gap_w = np.column_stack([-one, one, -acceleration_scale / rate_scale / N]).ravel()
        boundary = [np.column_stack([one, slope]).ravel() for slope in (first, last)]
        data = [one, boundary[0], np.tile(gap_q, N), np.tile(gap_w, N), one, boundary[1]]
        return self._csr(np.concatenate(data), self._equality_pattern, self.eliminated + 2 * self.n)

    @cached_property
    def _sums(self) -> tuple[Array, Array]:
        """What unit accelerations add to positions and rates at the nodes, shape (N+1, N) each."""
        node, control = np.arange(self.N + 1)[:, None], np.arange(self.N)[None, :]
        earlier = control < node
        return np.where(earlier, (node - control - 0.5) / self.N**2, 0.0), np.where(earlier, 1.0 / self.N, 0.0)

    def basis(self, rate_scale: Array, acceleration_scale: Array) -> Array:
        """Null-space basis of the gaps for a start at rest: sums over the controls, shape (size, N n + 1)."""
        N, n = self.N, self.n
        to_q, to_w = self._sums
        Z = np.zeros((self.size, N * n + 1))
        joints = np.arange(n)
        parts = ((self.positions, to_q, acceleration_scale), (self.rates, to_w, acceleration_scale / rate_scale))
        for part, sums, scaled in parts:
            block = np.zeros((N + 1, n, N, n))
            block[:, joints, :, joints] = sums[None] * scaled[:, None, None]
            Z[part, :-1] = block.reshape((N + 1) * n, N * n)
        Z[self.free, np.arange(N * n + 1)] = 1.0
        return Z

    def hessian(self, diagonal: Array, blocks: Array, ends: Indices) -> sp.csr_array:
        """Sparse Hessian: a diagonal plus one dense block per interval end."""
        columns = self.end_columns[ends]
        width = columns.shape[1]
        rows = np.repeat(columns, width, axis=1).ravel()
        entries = sp.coo_array((blocks.ravel(), (rows, np.tile(columns, (1, width)).ravel())), (self.size, self.size))
        return sp.csr_array(entries + sp.diags_array(diagonal))

    def _csr(self, data: Array, pattern: tuple[Indices, Indices], rows: int) -> sp.csr_array:
        return sp.csr_array((data, *pattern), shape=(rows, self.size))


@lru_cache(maxsize=32)
def layout_of(N: int, n: int, E: int) -> Layout:
    """Layout with its patterns, made once per shape of problem."""
    return Layout(N, n, E)
