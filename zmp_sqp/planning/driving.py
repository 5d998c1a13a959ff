"""The nonlinear program of a machine that drives: that of its coordinates, and where they lead the base."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from zmp_sqp.arrays import Array
from zmp_sqp.planning.transcription import Transcription
from zmp_sqp.planning.unicycle import UnicycleBase
from zmp_sqp.sqp.nlp import Basis, Evaluation, Linearization

__all__ = ["DrivingTranscription"]

SIMPSON = np.array([1.0, 4.0, 1.0])[:, None] / 6.0  # at start, middle and end of an interval
CORRIDOR_GUARD = 1e-7  # [m] kept inside x and y bounds at the nodes


class DrivingTranscription:
    r"""Program over x = (coordinates' variables, p_0..p_N, sigma) with positions p = (x, y) of the base.

    The coordinates (joints, way along the heading, yaw) are double integrators: their program, the `inner` one, is that
    of an arm. The way is free at the goal; the position, a quadrature, is not:

    .. math:: p_{k+1} = p_k + \tfrac{h}{6} \sum_{i \in \{0, 1/2, 1\}} (1, 4, 1)_i\,
              w_\lambda(i) (\cos \psi(i), \sin \psi(i)), \quad p_0 = start, \; p_N = goal

    Equalities: those of the inner program that its basis satisfies, first position, gaps of the position (interval by
    interval), its last states but for the way, last position. Inequalities: the inner program's, then the bounds on
    x and y at the nodes. Curvature of the position's gaps is left out of the Hessian.

    Sparsity of gap k: psi_k, w_k (way, yaw), u_k (way, yaw), psi_{k+1}, w_{k+1} (way), p_k, p_{k+1}.
    """

    def __init__(self, inner: Transcription, base: UnicycleBase) -> None:
        """Add positions.

        Args:
            inner: Program of the coordinates, of which the last two are the way and the yaw.
            base: Start and goal, and the bounds on x and y.
        """
        self.inner, self.base = inner, base
        self.N, self.n, self.hold, self.reference = inner.N, inner.n, inner.hold, inner.reference
        self.model = inner.model
        self._sigma = inner.layout.size - 1  # of the inner program
        self.size = inner.layout.size + 2 * (self.N + 1)
        self.positions = slice(self._sigma, self.size - 1)
        self._eliminated = inner.layout.eliminated
        self.eliminated = self._eliminated + 2 + 2 * self.N
        self._last = np.delete(np.arange(2 * self.n), self.n - 2) + self._eliminated  # rows of the inner program
        self._corridor, self._edges = self._corridor_rows()
        self.nonlinear_rows: npt.NDArray[np.bool_] = np.append(
            inner.nonlinear_rows, np.zeros(len(self._edges), dtype=bool)
        )

    def _corridor_rows(self) -> tuple[sp.csr_array, Array]:
        """Rows R and bounds b with R x <= b: positions of the nodes between the bounds that there are."""
        lower, upper = self.base.corridor
        both = np.vstack([self.base.start[:2], self.base.goal[:2]])
        lower = np.minimum(lower + CORRIDOR_GUARD, both.min(axis=0))
        upper = np.maximum(upper - CORRIDOR_GUARD, both.max(axis=0))
        columns = np.arange(self.size)[self.positions].reshape(-1, 2)[1:-1]  # the ends are given
        index, signs, edges = [np.zeros(0, dtype=int)], [np.zeros(0)], [np.zeros(0)]
        for axis in range(2):
            for sign, bound in ((1.0, upper[axis]), (-1.0, lower[axis])):
                if np.isfinite(bound):
                    index.append(columns[:, axis])
                    signs.append(np.full(len(columns), sign))
                    edges.append(np.full(len(columns), sign * bound))
        count = sum(len(part) for part in edges)
        entries = (np.concatenate(signs), (np.arange(count), np.concatenate(index)))
        return sp.csr_array(entries, shape=(count, self.size)), np.concatenate(edges)

    # --- points -------------------------------------------------------------------------------

    def pack(self, controls: Array, S: float) -> Array:
        """Point with controls (N, c, n) [T^2 a] and squared duration S [s^2] whose gaps are closed."""
        inner = self.inner.pack(controls, S)
        moves = self._moves(*self._course(inner))
        p = self.base.start[:2] + np.vstack([np.zeros(2), np.cumsum(moves, axis=0)])
        return self._join(inner, p)

    def unpack(self, x: Array) -> tuple[Array, Array, Array, float]:
        """The coordinates' unscaled (q, w, controls, S), as `Transcription.unpack`."""
        return self.inner.unpack(self._inner(x))

    def arrived(self, x: Array) -> tuple[Array, Array, Array, float]:
        """As `unpack`, with gaps closed and the goal met to rounding by the smallest change of the controls.

        The position is linear in the way's controls once the yaw is final; sideways of a constant heading it stays.
        """
        inner, base = self.inner, self.base
        _, _, controls, S = self.unpack(x)
        T, flat, way = np.sqrt(S), controls.reshape(-1, self.n).copy(), self.n - 2
        sums = np.vstack([part[-1] for part in inner.layout.sums])  # (2, N c)
        start, goal = inner.start, inner.goal
        wanted = np.vstack([goal.q - start.q - start.v * T, (goal.v - start.v) * T])
        change = sums.T @ np.linalg.solve(sums @ sums.T, wanted - sums @ flat)
        change[:, way] = 0.0
        flat += change
        psi, w = self._course(inner.pack(flat.reshape(controls.shape), S))
        to_w = inner.layout.sums[1]  # (N + 1, N c) rates at the nodes by the controls
        middle = to_w[:-1] + self._middle_rate() / self.N
        rates = np.stack([to_w[:-1], middle, to_w[1:]])  # (3, N, N c)
        reach = [np.einsum("ik,ikc->c", SIMPSON * part, rates) / self.N for part in (np.cos(psi), np.sin(psi))]
        rows = np.vstack([*reach, sums[1]])
        p = base.start[:2] + self._moves(psi, w).sum(axis=0)
        miss = np.append(base.goal[:2] - p, wanted[1, way] - sums[1] @ flat[:, way])
        flat[:, way] += np.linalg.lstsq(rows, miss, rcond=1e-6)[0]
        return inner.unpack(inner.pack(flat.reshape(controls.shape), S))

    def _middle_rate(self) -> Array:
        """What unit controls add to the rate at the middle of their own interval, per h, shape (N, N c)."""
        once = self.hold.shapes(0.5)[1]
        return np.asarray(np.kron(np.eye(self.N), once[None]))

    # --- the nonlinear program ----------------------------------------------------------------

    def evaluate(self, x: Array) -> Evaluation:
        """Values at x."""
        return self._evaluation(x, self.inner.evaluate(self._inner(x)))

    def linearize(self, x: Array) -> Linearization:
        """Values and first derivatives at x."""
        lin = self.inner.linearize(self._inner(x))
        at = self._evaluation(x, lin.at)
        slopes = self._gap_slopes(x)
        A, moves = self._widened(lin.A), self._widened(slopes) + self._steps
        A = sp.vstack([A[: self._eliminated], self._first, moves, A[self._last], self._final], format="csr")
        C = self._widened(lin.C)
        if len(self._edges):
            C = sp.vstack([C, self._corridor], format="csr")
        still = np.zeros(2 * (self.N + 1))
        gradient, tie_gradient = self._join(lin.gradient, still), self._join(lin.tie_gradient, still)
        basis = None if lin.basis is None else self._basis(lin.basis, slopes, at.equalities)
        return Linearization(at, gradient, tie_gradient, A, C, basis)

    def hessian(self, x: Array, y: Array, z: Array, *, convex: bool) -> sp.csr_array:
        """Hessian of the Lagrangian but for the gaps of the position, in which x appears beyond the inner program's."""
        of_inner = np.zeros(2 * self.n)
        if len(y):
            of_inner[self._last - self._eliminated] = y[: len(self._last)]
        rows = self.inner.layout.inequalities
        H = self._widened(self.inner.hessian(self._inner(x), of_inner, z[:rows], convex=convex))
        pointers = np.concatenate([H.indptr[:-1], np.full(2 * (self.N + 1), H.indptr[-2]), H.indptr[-1:]])
        return sp.csr_array((H.data, H.indices, pointers), shape=(self.size, self.size))

    def optimality_gap(self, x: Array) -> float:
        """How far sigma stands above its proven lower bound, relative."""
        return self.inner.optimality_gap(x)

    # --- parts --------------------------------------------------------------------------------

    def _inner(self, x: Array) -> Array:
        return np.append(x[: self._sigma], x[-1])

    def _join(self, inner: Array, p: Array) -> Array:
        return np.concatenate([inner[:-1], p.ravel(), inner[-1:]])

    def _widened(self, matrix: sp.csr_array) -> sp.csr_array:
        """The same rows, with columns for the positions."""
        indices = np.where(matrix.indices == self._sigma, self.size - 1, matrix.indices)
        return sp.csr_array((matrix.data, indices, matrix.indptr), shape=(matrix.shape[0], self.size))

    def _course(self, inner: Array) -> tuple[Array, Array]:
        """Yaw and rate of the way at start, middle and end of the intervals, shape (3, N) each."""
        q, w, controls, _ = self.inner.unpack(inner)
        h = 1.0 / self.N
        _, once, twice = self.hold.shapes(0.5)
        yaw = q[:-1, -1] + 0.5 * h * w[:-1, -1] + h**2 * controls[:, :, -1] @ twice
        rate = w[:-1, -2] + h * controls[:, :, -2] @ once
        return np.stack([q[:-1, -1], yaw, q[1:, -1]]), np.stack([w[:-1, -2], rate, w[1:, -2]])

    def _moves(self, psi: Array, w: Array) -> Array:
        """Displacements over the intervals by Simpson's rule, shape (N, 2) [m]."""
        weighted = SIMPSON * w / self.N
        return np.column_stack([(weighted * np.cos(psi)).sum(axis=0), (weighted * np.sin(psi)).sum(axis=0)])

    def _evaluation(self, x: Array, inner: Evaluation) -> Evaluation:
        p = x[self.positions].reshape(-1, 2)
        gaps = p[1:] - p[:-1] - self._moves(*self._course(self._inner(x)))
        equalities = [
            inner.equalities[: self._eliminated], p[0] - self.base.start[:2], gaps.ravel(),
            inner.equalities[self._last], p[-1] - self.base.goal[:2],
        ]  # fmt: skip
        inequalities = inner.inequalities
        if len(self._edges):
            inequalities = np.append(inequalities, self._corridor @ x - self._edges)
        return Evaluation(inner.objective, inner.tie_breaker, np.concatenate(equalities), inequalities)

    def _gap_slopes(self, x: Array) -> sp.csr_array:
        """Derivatives of the position's gaps by the inner program's variables, shape (2 N, inner size)."""
        inner, N, h, c = self.inner, self.N, 1.0 / self.N, self.hold.controls
        psi, w = self._course(self._inner(x))
        along = np.stack([np.cos(psi), np.sin(psi)])  # (2, 3, N)
        by_w = -h * SIMPSON * along
        by_psi = -h * SIMPSON * w * np.stack([-along[1], along[0]])
        _, once, twice = self.hold.shapes(0.5)
        rate_way, rate_yaw = inner.rate_scale[-2:]
        push_way, push_yaw = inner.control_scale[-2:]
        parts = [
            by_psi[:, 0] + by_psi[:, 1], (by_w[:, 0] + by_w[:, 1]) * rate_way, by_psi[:, 1] * (0.5 * h * rate_yaw),
            *(by_w[:, 1] * (h * once[i] * push_way) for i in range(c)),
            *(by_psi[:, 1] * (h**2 * twice[i] * push_yaw) for i in range(c)),
            by_psi[:, 2], by_w[:, 2] * rate_way,
        ]  # fmt: skip
        data = np.stack(parts, axis=2).transpose(1, 0, 2)  # (N, 2, columns)
        layout, index = inner.layout, np.arange(inner.layout.size)
        q, rates = (index[part].reshape(N + 1, self.n) for part in (layout.positions, layout.rates))
        controls = index[layout.controls].reshape(N, c, self.n)
        columns = np.column_stack(
            [q[:-1, -1], rates[:-1, -2:], controls[:, :, -2], controls[:, :, -1], q[1:, -1], rates[1:, -2]]
        )
        width = columns.shape[1]
        pointers = width * np.arange(2 * N + 1)
        return sp.csr_array((data.ravel(), np.repeat(columns, 2, axis=0).ravel(), pointers), shape=(2 * N, len(index)))

    @property
    def _steps(self) -> sp.csr_array:
        """p_{k+1} - p_k, shape (2 N, size)."""
        return sp.diags_array(
            [-np.ones(2 * self.N), np.ones(2 * self.N)], offsets=[self._sigma, self._sigma + 2],
            shape=(2 * self.N, self.size), format="csr",
        )  # fmt: skip

    @property
    def _first(self) -> sp.csr_array:
        return sp.eye_array(2, self.size, k=self._sigma, format="csr")

    @property
    def _final(self) -> sp.csr_array:
        return sp.eye_array(2, self.size, k=self.size - 3, format="csr")

    def _basis(self, inner: Basis, slopes: sp.csr_array, equalities: Array) -> Basis:
        """The inner basis with rows for the positions: sums of the gaps' slopes along it."""
        N, r = self.N, inner.Z.shape[1]
        Z, d = np.zeros((self.size, r)), np.zeros(self.size)
        Z[: self._sigma], Z[-1], d[: self._sigma] = inner.Z[:-1], inner.Z[-1], inner.d[:-1]
        Z[self._sigma + 2 : -1] = -np.cumsum((slopes @ inner.Z).reshape(N, 2, r), axis=0).reshape(2 * N, r)
        gaps = equalities[self._eliminated : self.eliminated].reshape(N + 1, 2)
        moved = gaps + np.vstack([np.zeros(2), (slopes @ inner.d).reshape(N, 2)])
        d[self.positions] = -np.cumsum(moved, axis=0).ravel()
        free = np.append(inner.free[:-1], self.size - 1) if len(inner.free) else inner.free
        return Basis(Z, d, free, self.eliminated)
