"""Where each variable and row of the transcription stands, and the fixed sparsity of its Jacobians."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from zmp_sqp.arrays import Array, Indices

__all__ = ["JointRows", "Layout"]


@dataclass(frozen=True, slots=True, eq=False)
class JointRows:
    """Constant part of the joint rows, with the shares of sqrt(sigma) and sigma in the rate and acceleration rows."""

    matrix: sp.csr_array
    rate_data: Indices  # where in matrix.data the rate rows' sigma entries stand
    rate_share: Array
    acceleration_share: Array
    half_step: Array


@dataclass(frozen=True)
class Layout:
    """Index arithmetic of N intervals, n coordinates and E wrench rows per interval end.

    Variables: positions, rates, accelerations, sigma. Inequalities: wrench rows (starts of all intervals, then
    ends, then middle control points; E each), accelerations (upper, lower), rates (upper, lower; all nodes), positions at the nodes (upper, lower),
    middle control points (upper, lower), sigma. Equalities: first state, gaps of q, gaps of w, last state.
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

    def joint_rows(self, *, rate_share: Array, acceleration_share: Array, half_step: Array) -> JointRows:
        """Rows of accelerations, rates, positions and sigma; constant but for the rates' sigma column."""
        nodes, intervals = (self.N + 1) * self.n, self.N * self.n

        def block(at: int, rows: int, sigma: Array | None = None) -> sp.csr_array:
            left, right = sp.csr_array((rows, at)), sp.csr_array((rows, self.size - 1 - at - rows))
            column = sp.csr_array((rows, 1)) if sigma is None else sp.csr_array(sigma[:, None])
            return sp.hstack([left, sp.eye_array(rows), right, column], format="csr")

        q, w, alpha = block(0, nodes), block(self.rates.start, nodes), block(self.accelerations.start, intervals)
        sigma_of = {rows: sp.csr_array((np.ones(rows), (np.arange(rows), np.full(rows, self.size - 1))), (rows, self.size))
                    for rows in (nodes, intervals)}  # fmt: skip
        rate = sp.diags_array(np.tile(rate_share, self.N + 1)) @ sigma_of[nodes]
        acceleration = sp.diags_array(np.tile(acceleration_share, self.N)) @ sigma_of[intervals]
        middle = q[: -self.n] + sp.diags_array(np.tile(half_step, self.N)) @ w[: -self.n]
        last = sp.csr_array(([-1.0], ([0], [self.size - 1])), (1, self.size))
        parts = [alpha - acceleration, -alpha - acceleration, w - rate, -w - rate, q, -q, middle, -middle, last]
        matrix = sp.csr_array(sp.vstack(parts, format="csr"))
        matrix.sort_indices()
        first = 2 * intervals
        rate_data = matrix.indptr[first + 1 : first + 2 * nodes + 1] - 1  # sigma is the last column
        return JointRows(matrix, rate_data, rate_share, acceleration_share, half_step)

    def rate_share(self, rows: JointRows) -> Array:
        """Shares of sqrt(sigma) in the rate rows, shape (n,)."""
        return rows.rate_share

    def fill_inequalities(self, slopes: Array, rows: JointRows, root_slope: float) -> sp.csr_array:
        """Jacobian of the inequalities.

        Args:
            slopes: Of the wrench rows at starts, ends and middle control points, shape (3N, E, 3n + 1).
            rows: Constant joint rows.
            root_slope: d sqrt(sigma) / d sigma.
        """
        width = 3 * self.n + 1
        data = rows.matrix.data.copy()
        data[rows.rate_data] *= root_slope
        touched = np.vstack([self.end_columns, self.end_columns[: self.N]])  # a control point is seen from the start
        columns = np.repeat(touched, self.E, axis=0).ravel()
        pointers = np.arange(1, self.wrench_rows + 1) * width
        return sp.csr_array(
            (
                np.concatenate([slopes.ravel(), data]),
                np.concatenate([columns, rows.matrix.indices]),
                np.concatenate([[0], pointers, rows.matrix.indptr[1:] + self.wrench_rows * width]),
            ),
            shape=(self.inequalities, self.size),
        )

    def gap_rows(self, rate_scale: Array, acceleration_scale: Array) -> sp.csr_array:
        """Equality rows with ones in place of the sigma entries of the first and last rates."""
        N, n = self.N, self.n
        eye = sp.eye_array(n)
        shift = sp.kron(sp.eye_array(N, N + 1, k=1) - sp.eye_array(N, N + 1), eye)
        here = sp.kron(sp.eye_array(N, N + 1), sp.diags_array(rate_scale / N))
        push = sp.kron(sp.eye_array(N), sp.diags_array(acceleration_scale / N))
        slow = sp.kron(sp.eye_array(N), sp.diags_array(acceleration_scale / rate_scale / N))
        first, last = sp.kron(sp.eye_array(1, N + 1), eye), sp.kron(sp.eye_array(1, N + 1, k=N), eye)
        ones = sp.csr_array(np.ones((n, 1)))
        rows = [
            [first, None, None, None],
            [None, first, None, ones],
            [shift, -here, -0.5 / N * push, None],
            [None, shift, -slow, None],
            [last, None, None, None],
            [None, last, None, ones],
        ]
        rows[0][3] = sp.csr_array((n, 1))
        return sp.csr_array(sp.block_array(rows, format="csr"))

    def fill_equalities(self, gaps: sp.csr_array, first: Array, last: Array) -> sp.csr_array:
        """Jacobian of the equalities with the sigma entries of the first and last rates set."""
        data = gaps.data.copy()
        n = self.n
        total = gaps.shape[0]
        data[gaps.indptr[n + 1 : 2 * n + 1] - 1] = first
        data[gaps.indptr[total - n + 1 : total + 1] - 1] = last
        return sp.csr_array((data, gaps.indices, gaps.indptr), shape=gaps.shape)

    def basis(self, rate_scale: Array, acceleration_scale: Array) -> Array:
        """Null-space basis of the gaps for a start at rest: sums over the controls, shape (size, N n + 1)."""
        N, n = self.N, self.n
        node, control = np.arange(N + 1)[:, None], np.arange(N)[None, :]
        earlier = control < node
        Z = np.zeros((self.size, N * n + 1))
        to_q, to_w = np.where(earlier, (node - control - 0.5) / N**2, 0.0), np.where(earlier, 1.0 / N, 0.0)
        Z4 = np.zeros((2, N + 1, n, N, n))
        joints = np.arange(n)
        Z4[0][:, joints, :, joints] = (to_q[None] * acceleration_scale[:, None, None])
        Z4[1][:, joints, :, joints] = (to_w[None] * (acceleration_scale / rate_scale)[:, None, None])
        Z[: self.accelerations.start, :-1] = Z4.reshape(-1, N * n)
        Z[self.free, np.arange(N * n + 1)] = 1.0
        return Z

    def hessian(self, diagonal: Array, blocks: Array, ends: Indices) -> sp.csr_array:
        """Sparse Hessian: a diagonal plus one dense block per interval end."""
        columns = self.end_columns[ends]
        width = columns.shape[1]
        rows = np.repeat(columns, width, axis=1).ravel()
        entries = sp.coo_array((blocks.ravel(), (rows, np.tile(columns, (1, width)).ravel())), (self.size, self.size))
        return sp.csr_array(entries + sp.diags_array(diagonal))
