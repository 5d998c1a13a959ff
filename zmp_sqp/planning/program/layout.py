"""Where each variable and row of the transcription stands, and the fixed sparsity of its Jacobians."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy.sparse as sp

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.planning.program.hold import Hold

__all__ = ["Layout", "layout_of"]


@dataclass(frozen=True)
class Layout:
    """Index arithmetic of N intervals, n coordinates, E wrench rows per point, and a hold with c controls per interval.

    Variables: positions, rates (all nodes), controls (interval by interval, c vectors each), sigma.
        Inequalities:
    wrench rows (starts of all intervals, then ends, then middle control points; E each), controls
    (upper, lower), rates (upper, lower; nodes, then the hold's control points), positions (upper,
    lower; likewise), sigma. Equalities: first state, gaps of q, gaps of w, last state.
    """

    N: int
    n: int
    E: int
    hold: Hold

    @property
    def size(self) -> int:
        """Number of variables."""
        return (2 * (self.N + 1) + self.hold.controls * self.N) * self.n + 1

    @property
    def positions(self) -> slice:
        """Of the variables."""
        return slice(0, (self.N + 1) * self.n)

    @property
    def rates(self) -> slice:
        """Of the variables."""
        return slice((self.N + 1) * self.n, 2 * (self.N + 1) * self.n)

    @property
    def controls(self) -> slice:
        """Of the variables."""
        return slice(2 * (self.N + 1) * self.n, self.size - 1)

    @cached_property
    def free(self) -> Indices:
        """Controls and sigma: what is left when the gaps are eliminated."""
        return np.arange(self.controls.start, self.size)

    @property
    def eliminated(self) -> int:
        """Equalities that the basis satisfies: the first state and the gaps."""
        return 2 * self.n + 2 * self.N * self.n

    @property
    def wrench_rows(self) -> int:
        """Number of wrench rows."""
        return 3 * self.N * self.E

    @property
    def control_rows(self) -> slice:
        """Of the inequalities."""
        return slice(self.wrench_rows, self.wrench_rows + 2 * self.hold.controls * self.N * self.n)

    @property
    def rate_rows(self) -> slice:
        """Of the inequalities."""
        first = self.control_rows.stop
        return slice(first, first + 2 * (self.N + 1 + len(self.hold.rate_points) * self.N) * self.n)

    @property
    def inequalities(self) -> int:
        """Number of inequalities."""
        return (
            int(self.rate_rows.stop)
            + 2 * (self.N + 1 + len(self.hold.position_points) * self.N) * self.n
            + 1
        )

    def split(self, x: Array) -> tuple[Array, Array, Array, float]:
        """Scaled (q, w, controls, sigma), shapes (N+1, n), (N+1, n), (N, c, n)."""
        q, w = x[self.positions].reshape(-1, self.n), x[self.rates].reshape(-1, self.n)
        return q, w, x[self.controls].reshape(self.N, self.hold.controls, self.n), float(x[-1])

    def join(self, q: Array, w: Array, controls: Array, sigma: float) -> Array:
        """The inverse of `split`."""
        return np.concatenate([q.ravel(), w.ravel(), controls.ravel(), [sigma]])

    @cached_property
    def _columns(self) -> tuple[Indices, Indices, Indices]:
        """Columns of positions and rates by node, (N+1, n) each, and of controls, (N, c, n)."""
        index = np.arange(self.size)
        q, w = index[self.positions].reshape(-1, self.n), index[self.rates].reshape(-1, self.n)
        return q, w, index[self.controls].reshape(self.N, self.hold.controls, self.n)

    @cached_property
    def end_columns(self) -> Indices:
        """Columns (q, w, alpha, sigma) that each interval's start, then each end, touches, shape (2N, 3n + 1)."""
        q, w, controls = self._columns
        sigma = np.full((2 * self.N, 1), self.size - 1)
        push = np.vstack([controls[:, 0], controls[:, -1]])
        return np.hstack([np.vstack([q[:-1], q[1:]]), np.vstack([w[:-1], w[1:]]), push, sigma])

    @cached_property
    def middle_columns(self) -> Indices:
        """Columns (q, w, controls, sigma) that each interval's middle touches, shape (N, (2 + c) n + 1)."""
        q, w, controls = self._columns
        return np.hstack(
            [q[:-1], w[:-1], controls.reshape(self.N, -1), np.full((self.N, 1), self.size - 1)]
        )

    @cached_property
    def _inequality_pattern(self) -> tuple[Indices, Indices]:
        """Column indices and row pointers of the inequalities' CSR matrix."""
        q, w, controls = self._columns
        sigma = self.size - 1
        rows = [
            np.repeat(touched, self.E, axis=0)
            for touched in (self.end_columns, self.middle_columns)
        ]
        limited = [_stack(controls, sigma)] * 2
        rate = [
            _stack(w, sigma),
            *(_stack(w[:-1], controls[:, 0], sigma) for _ in self.hold.rate_points),
        ]
        place = [q.reshape(-1, 1), *(_stack(q[at], w[at]) for at in self._point_nodes)]
        blocks = [*rows, *limited, *rate, *rate, *place, *place, np.array([[sigma]])]
        counts = np.concatenate([np.full(len(block), block.shape[1]) for block in blocks])
        return np.concatenate([block.ravel() for block in blocks]), np.concatenate(
            [[0], np.cumsum(counts)]
        )

    @cached_property
    def _point_nodes(self) -> list[slice]:
        """Nodes whose position and rate make each of the hold's position control points."""
        return [
            slice(0, -1) if point > 0.0 else slice(1, None) for point in self.hold.position_points
        ]

    def inequality_jacobian(
        self,
        ends: Array,
        middles: Array,
        *,
        control_share: Array,
        rate_slope: Array,
        rate_scale: Array,
        control_step: Array,
    ) -> sp.csr_array:
        """Jacobian of the inequalities.

        Args:
            ends: Slopes of the wrench rows at starts and ends by (q, w, alpha, sigma), shape (2N,
                E, 3n + 1).
            middles: Of the middle control points by (q, w, controls, sigma), shape (N, E, (2 + c) n
                + 1).
            control_share: Of sigma in the acceleration limits, shape (n,).
            rate_slope: Derivative of the rate limits by sigma, shape (n,).
            rate_scale: w per scaled rate, shape (n,).
            control_step: Scaled rate per scaled control and interval, shape (n,).
        """
        N, c = self.N, self.hold.controls
        push, rate, reach = (
            np.tile(part, rows)
            for part, rows in ((control_share, N * c), (rate_slope, N + 1), (rate_slope, N))
        )
        parts = [ends.ravel(), middles.ravel()]
        parts += [
            np.column_stack([sign * np.ones_like(push), -push]).ravel() for sign in (1.0, -1.0)
        ]
        for sign in (1.0, -1.0):
            parts.append(np.column_stack([sign * np.ones_like(rate), -rate]).ravel())
            for point in self.hold.rate_points:
                step = np.tile(sign * point * control_step, N)
                parts.append(np.column_stack([np.full_like(reach, sign), step, -reach]).ravel())
        for sign in (1.0, -1.0):
            parts.append(np.full((N + 1) * self.n, sign))
            for point in self.hold.position_points:
                step = np.tile(sign * point * rate_scale / N, N)
                parts.append(np.column_stack([np.full(N * self.n, sign), step]).ravel())
        parts.append(np.array([-1.0]))
        return self._csr(np.concatenate(parts), self._inequality_pattern, self.inequalities)

    @cached_property
    def _equality_pattern(self) -> tuple[Indices, Indices]:
        """Column indices and row pointers of the equalities' CSR matrix."""
        q, w, controls = self._columns
        sigma, each = self.size - 1, [controls[:, i] for i in range(self.hold.controls)]
        blocks = [
            _stack(q[0]),
            _stack(w[0], sigma),
            _stack(q[:-1], q[1:], w[:-1], *each),
            _stack(w[:-1], w[1:], *each),
            _stack(q[-1]),
            _stack(w[-1], sigma),
        ]
        counts = np.concatenate([np.full(len(block), block.shape[1]) for block in blocks])
        return np.concatenate([block.ravel() for block in blocks]), np.concatenate(
            [[0], np.cumsum(counts)]
        )

    def equality_jacobian(
        self,
        *,
        position_weight: Array,
        rate_scale: Array,
        control_scale: Array,
        first: Array,
        last: Array,
    ) -> sp.csr_array:
        """Jacobian of the equalities.

        Args:
            position_weight: Factor of the positions' rows, shape (n,).
            rate_scale: w per scaled rate, shape (n,).
            control_scale: alpha per scaled control, shape (n,).
            first: Derivatives of the first rates' rows by sigma, shape (n,).
            last: Likewise of the last rates' rows.
        """
        N, one = self.N, np.ones(self.n)
        to_q = [-share * control_scale / N**2 for share in self.hold.to_position]
        to_w = [-share * control_scale / rate_scale / N for share in self.hold.to_rate]
        gap_q = (
            position_weight[:, None] * np.column_stack([-one, one, -rate_scale / N, *to_q])
        ).ravel()
        gap_w = np.column_stack([-one, one, *to_w]).ravel()
        boundary = [np.column_stack([one, slope]).ravel() for slope in (first, last)]
        data = [
            position_weight,
            boundary[0],
            np.tile(gap_q, N),
            np.tile(gap_w, N),
            position_weight,
            boundary[1],
        ]
        return self._csr(np.concatenate(data), self._equality_pattern, self.eliminated + 2 * self.n)

    @cached_property
    def sums(self) -> tuple[Array, Array]:
        """What unit controls add to positions and rates at the nodes, shape (N+1, N c) each."""
        node, interval = np.arange(self.N + 1)[:, None, None], np.arange(self.N)[None, :, None]
        to_q, to_w = np.array(self.hold.to_position), np.array(self.hold.to_rate)
        since = node - interval - 1  # whole intervals after it
        q = np.where(since >= 0, (to_q + since * to_w) / self.N**2, 0.0)
        w = np.where(since >= 0, to_w / self.N, 0.0)
        return q.reshape(self.N + 1, -1), w.reshape(self.N + 1, -1)

    def basis(self, rate_scale: Array, control_scale: Array) -> Array:
        """Null-space basis of the gaps for a start at rest: sums over the controls, shape (size, N c n + 1)."""
        nodes, n, count = self.N + 1, self.n, self.N * self.hold.controls
        Z, joints = np.zeros((self.size, count * n + 1)), np.arange(n)
        scales = (control_scale, control_scale / rate_scale)
        for part, sums, scale in zip((self.positions, self.rates), self.sums, scales, strict=True):
            block = np.zeros((nodes, n, count, n))
            block[:, joints, :, joints] = sums[None] * scale[:, None, None]
            Z[part, :-1] = block.reshape(nodes * n, count * n)
        Z[self.free, np.arange(count * n + 1)] = 1.0
        return Z

    def hessian(
        self, diagonal: Array, ends: tuple[Array, Indices], middles: tuple[Array, Indices]
    ) -> sp.csr_array:
        """Sparse Hessian: a diagonal, dense blocks at interval ends, and dense blocks of intervals.

        Args:
            diagonal: Shape (size,).
            ends: Blocks by (q, w, alpha, sigma), shape (K, 3n + 1, 3n + 1), and which of the 2N
                ends they belong to.
            middles: Blocks by (q, w, controls, sigma) of the start, and which of the N intervals
                they belong to.
        """
        entries, rows, columns = [diagonal], [np.arange(self.size)], [np.arange(self.size)]
        for (blocks, which), touched in ((ends, self.end_columns), (middles, self.middle_columns)):
            at = touched[which]
            width = at.shape[1]
            entries.append(blocks.ravel())
            rows.append(np.repeat(at, width, axis=1).ravel())
            columns.append(np.tile(at, (1, width)).ravel())
        where = np.concatenate(rows), np.concatenate(columns)
        return sp.csr_array(sp.coo_array((np.concatenate(entries), where), (self.size, self.size)))

    def _csr(self, data: Array, pattern: tuple[Indices, Indices], rows: int) -> sp.csr_array:
        return sp.csr_array((data, *pattern), shape=(rows, self.size))


def _stack(*columns: Indices | int) -> Indices:
    """One row per entry, with these columns; whole numbers are repeated."""
    length = np.size(columns[0])
    return np.column_stack(
        [np.full(length, part) if isinstance(part, int) else part.ravel() for part in columns]
    )


@lru_cache(maxsize=32)
def layout_of(N: int, n: int, E: int, hold: Hold) -> Layout:
    """Layout with its patterns, made once per shape of problem."""
    return Layout(N, n, E, hold)
