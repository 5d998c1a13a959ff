"""The nonlinear program of a machine that drives: that of its coordinates, and where they lead the base."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.ground import Slope, Terrain
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase
from zmp_sqp.planning.program.driving.corridor import corridor_rows
from zmp_sqp.planning.program.driving.course import Course
from zmp_sqp.planning.program.driving.moves import Moves, runge_kutta_moves
from zmp_sqp.planning.program.transcription import Transcription
from zmp_sqp.sqp.nlp import Basis, Evaluation, Linearization

__all__ = ["DrivingTranscription"]

ARRIVED = 1e-12  # [m] from the goal: Newton's steps lead no nearer
ARRIVALS = 8  # steps at most; a plane takes one
# of a unit way: a miss across a heading that turns by less stays, rather than cost large changes
SIDEWAYS = 1e-3
PASSES = 20  # of Newton's method over all nodes at once; a plane takes one
SETTLED = 1e-14  # relative, of positions
PLANE = Slope()


class DrivingTranscription:
    r"""Program over x = (coordinates' variables, p_0..p_N, sigma) with positions p = (x, y) of the base.

    The coordinates (joints, way along the heading, yaw) are double integrators: their program, the
    `inner` one, is that of an arm. The way is free at the goal; the position is not. It follows
    from p' = w_lambda G(p, psi) by a step of Runge and Kutta per interval (`moves`); in a plane G
    is the heading and the step Simpson's rule:

    .. math:: p_{k+1} = p_k + \Delta(p_k, \psi, w_\lambda), \quad p_0 = start, \; p_N = goal

    Equalities: those of the inner program that its basis satisfies, first position, gaps of the
        position (interval by
    interval), its last states but for the way, last position. Inequalities: the inner program's,
    then the bounds on x and y at the nodes. The Hessian has the curvature of the position's gaps by
    the course, with the multipliers that follow from those of the goal and of the bounds in a
    plane; what the ground's own curvature adds is left out.

    Sparsity of gap k: psi_k, w_k (way, yaw), u_k (way, yaw), psi_{k+1}, w_{k+1} (way), p_k,
        p_{k+1}. Unless the ground
    is the same everywhere, wrench rows have p_k (start), p_{k+1} (end), and the gap's columns
    (middle) as well.
    """

    def __init__(
        self,
        inner: Transcription,
        base: UnicycleBase,
        terrain: Terrain = PLANE,
        *,
        reach: float = 0.0,
        drawn_in: float = 0.0,
    ) -> None:
        """Add positions.

        Args:
            inner: Program of the coordinates, of which the last two are the way and the yaw.
            base: Start and goal, and the bounds on x and y.
            terrain: What the base drives on.
            reach: Of the tracks from the base's place: it stays so far inside a map, but where it
                begins and ends [m].
            drawn_in: By how much nodes stay inside the bounds on x and y [m].
        """
        self.inner, self.base, self.terrain = inner, base, terrain
        self.N, self.n, self.hold, self.reference = inner.N, inner.n, inner.hold, inner.reference
        self._sigma = inner.layout.size - 1  # of the inner program
        self.size = inner.layout.size + 2 * (self.N + 1)
        self.positions = slice(self._sigma, self.size - 1)
        self._eliminated = inner.layout.eliminated
        self.eliminated = self._eliminated + 2 + 2 * self.N
        # rows of the inner program
        self._last = np.delete(np.arange(2 * self.n), self.n - 2) + self._eliminated
        columns = np.arange(self.size)[self.positions].reshape(-1, 2)[1:-1]  # the ends are given
        self._corridor, self._edges = corridor_rows(
            base, terrain, columns, size=self.size, reach=reach, drawn_in=drawn_in
        )
        self._course = Course(inner)
        self.nonlinear_rows: npt.NDArray[np.bool_] = np.append(
            inner.nonlinear_rows, np.zeros(len(self._edges), dtype=bool)
        )

    @property
    def aim(self) -> Array:
        """Where the base shall end, shape (2,) [m]."""
        return np.asarray(self.base.goal[:2])

    # --- points -------------------------------------------------------------------------------

    def pack(self, controls: Array, S: float) -> Array:
        """Point with controls (N, c, n) [T^2 a] and squared duration S [s^2] whose gaps are closed."""
        inner = self.inner.pack(controls, S)
        return self._join(inner, self._driven(*self._course.of(inner)))

    def _driven(self, psi: Array, w: Array) -> Array:
        """Positions of the nodes, shape (N + 1, 2), by Newton's method on the gaps."""
        p = np.repeat(self.base.start[None, :2], self.N + 1, axis=0)
        for _ in range(PASSES):
            moves = runge_kutta_moves(self.terrain, p[:-1], psi, w)
            gaps = np.diff(p, axis=0) - moves.whole
            change = _propagated(moves, np.zeros(2), -gaps)
            p = p + change
            if self.terrain.uniform or np.abs(change).max() <= SETTLED * (1.0 + np.abs(p).max()):
                break
        return p

    def unpack(self, x: Array) -> tuple[Array, Array, Array, float]:
        """The coordinates' unscaled (q, w, controls, S), as `Transcription.unpack`."""
        return self.inner.unpack(self._inner(x))

    def arrived(self, x: Array, aim: Array | None = None) -> tuple[Array, Array, Array, float]:
        """As `unpack`, with gaps closed and the goal met to rounding by the smallest change of the controls.

        First all but the way, then the way's controls by Newton's method; in a plane the position
        is linear in them. Sideways of a constant heading it stays.

        Args:
            x: Point.
            aim: Where the moves shall end, shape (2,) [m]; None for the goal.
        """
        inner, aim = self.inner, self.base.goal[:2] if aim is None else aim
        _, _, controls, S = self.unpack(x)
        T, flat, way = np.sqrt(S), controls.reshape(-1, self.n).copy(), self.n - 2
        sums = np.vstack([part[-1] for part in inner.layout.sums])  # (2, N c)
        start, goal = inner.start, inner.goal
        wanted = np.vstack([goal.q - start.q - start.v * T, (goal.v - start.v) * T])
        change = sums.T @ np.linalg.solve(sums @ sums.T, wanted - sums @ flat)
        change[:, way] = 0.0
        flat += change
        rates = self._course.rates_by_controls()
        before = np.inf
        for _ in range(ARRIVALS):
            psi, w = self._course.of(inner.pack(flat.reshape(controls.shape), S))
            p = self._driven(psi, w)
            miss = np.append(aim - p[-1], wanted[1, way] - sums[1] @ flat[:, way])
            far = float(np.abs(miss).max())
            if far <= ARRIVED or far > 0.5 * before:  # what is left lies sideways
                break
            before = far
            moves = runge_kutta_moves(self.terrain, p[:-1], psi, w)
            pushed = np.einsum("kas,skc->kac", moves.whole_slopes[:, :, 5:], rates)
            reach = _propagated(moves, np.zeros((2, pushed.shape[2])), pushed)[-1]
            flat[:, way] += np.linalg.lstsq(np.vstack([reach, sums[1]]), miss, rcond=SIDEWAYS)[0]
        return inner.unpack(inner.pack(flat.reshape(controls.shape), S))

    # --- the nonlinear program ----------------------------------------------------------------

    def evaluate(self, x: Array) -> Evaluation:
        """Values at x."""
        moves = self._moves(x)
        return self._evaluation(
            x, self.inner.evaluate(self._inner(x), self._places(x, moves)), moves
        )

    def linearize(self, x: Array) -> Linearization:
        """Values and first derivatives at x."""
        moves = self._moves(x)
        lin, by_places = self.inner.linearize_at(self._inner(x), self._places(x, moves))
        at = self._evaluation(x, lin.at, moves)
        slopes = -self._course.slopes(moves.whole_slopes)
        A, gaps = self._widened(lin.A), self._widened(slopes) + self._steps(moves)
        A = sp.vstack(
            [A[: self._eliminated], self._first, gaps, A[self._last], self._final], format="csr"
        )
        C = self._widened(lin.C)
        if not self.terrain.uniform:
            C = C + self._place_slopes(by_places, moves, C.shape[0])
        if len(self._edges):
            C = sp.vstack([C, self._corridor], format="csr")
        still = np.zeros(2 * (self.N + 1))
        gradient, tie_gradient = (
            self._join(lin.gradient, still),
            self._join(lin.tie_gradient, still),
        )
        basis = None if lin.basis is None else self._basis(lin.basis, slopes, moves, at.equalities)
        return Linearization(at, gradient, tie_gradient, A, C, basis)

    def hessian(self, x: Array, y: Array, z: Array, *, convex: bool) -> sp.csr_array:
        """Hessian of the Lagrangian but for derivatives by the position; exact in a plane."""
        of_inner = np.zeros(2 * self.n)
        if len(y):
            of_inner[self._last - self._eliminated] = y[: len(self._last)]
        rows = self.inner.layout.inequalities
        places = None if self.terrain.uniform else self._places(x, self._moves(x))
        H = self.inner.hessian(self._inner(x), of_inner, z[:rows], convex=convex, places=places)
        if len(y):
            weights = np.repeat(y[None, -2:], self.N, axis=0)
            if len(self._edges):
                pull = (self._corridor.T @ z[rows:])[self.positions].reshape(-1, 2)[1:]
                weights += np.cumsum(pull[::-1], axis=0)[::-1]
            if weights.any():
                p = x[self.positions].reshape(-1, 2)
                H = sp.csr_array(
                    H
                    + self._course.curvature(
                        self.terrain, p, self._inner(x), weights, convex=convex
                    )
                )
        H = self._widened(H)
        pointers = np.concatenate(
            [H.indptr[:-1], np.full(2 * (self.N + 1), H.indptr[-2]), H.indptr[-1:]]
        )
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
        return sp.csr_array(
            (matrix.data, indices, matrix.indptr), shape=(matrix.shape[0], self.size)
        )

    def _moves(self, x: Array) -> Moves:
        return runge_kutta_moves(
            self.terrain, x[self.positions].reshape(-1, 2)[:-1], *self._course.of(self._inner(x))
        )

    def _places(self, x: Array, moves: Moves) -> Array | None:
        """Where the base is at starts, ends, middles of the intervals, (3N, 2); None where it does not matter."""
        p = x[self.positions].reshape(-1, 2)
        return None if self.terrain.uniform else np.vstack([p[:-1], p[1:], p[:-1] + moves.half])

    def _evaluation(self, x: Array, inner: Evaluation, moves: Moves) -> Evaluation:
        p = x[self.positions].reshape(-1, 2)
        gaps = p[1:] - p[:-1] - moves.whole
        equalities = [
            inner.equalities[: self._eliminated],
            p[0] - self.base.start[:2],
            gaps.ravel(),
            inner.equalities[self._last],
            p[-1] - self.base.goal[:2],
        ]
        inequalities = inner.inequalities
        if len(self._edges):
            inequalities = np.append(inequalities, self._corridor @ x - self._edges)
        return Evaluation(
            inner.objective, inner.tie_breaker, np.concatenate(equalities), inequalities
        )

    def _by_nodes(self, blocks: Array, node: int) -> sp.csr_array:
        """Rows with derivatives (N, R, 2) by the position at each interval's start (node 0) or end (1), (N R, size)."""
        N, rows, _ = blocks.shape
        columns = self._sigma + 2 * node + np.arange(2 * N).reshape(N, 1, 2).repeat(rows, axis=1)
        pointers = 2 * np.arange(N * rows + 1)
        return sp.csr_array(
            (blocks.ravel(), columns.ravel(), pointers), shape=(N * rows, self.size)
        )

    def _steps(self, moves: Moves) -> sp.csr_array:
        """Derivatives of the gaps by the positions, shape (2 N, size)."""
        one = np.broadcast_to(np.eye(2), (self.N, 2, 2))
        return self._by_nodes(one, 1) - self._by_nodes(one + moves.whole_slopes[:, :, :2], 0)

    def _place_slopes(self, by_places: Array, moves: Moves, rows: int) -> sp.csr_array:
        """What the inequalities' Jacobian gains where wrench rows (3N, E) depend on the place, shape (rows, size).

        The middle row is a control point: twice the middle less half the ends.
        """
        start, end, middle = by_places.reshape(3, self.N, -1, 2)
        to_half = moves.half_slopes[:, :, :2] + np.eye(2)
        count = start.shape[1]
        course = self._widened(self._course.slopes(moves.half_slopes))
        pointers = 2 * np.arange(self.N * count + 1)
        columns = np.arange(2 * self.N).reshape(self.N, 1, 2).repeat(count, axis=1)
        weights = sp.csr_array(
            (2.0 * middle.ravel(), columns.ravel(), pointers), shape=(self.N * count, 2 * self.N)
        )
        inner = weights @ course + self._by_nodes(2.0 * middle @ to_half - 0.5 * start, 0)
        blocks = [
            self._by_nodes(start, 0),
            self._by_nodes(end, 1),
            inner - self._by_nodes(0.5 * end, 1),
        ]
        rest = sp.csr_array((rows - 3 * self.N * count, self.size))
        return sp.vstack([*blocks, rest], format="csr")

    @property
    def _first(self) -> sp.csr_array:
        return sp.eye_array(2, self.size, k=self._sigma, format="csr")

    @property
    def _final(self) -> sp.csr_array:
        return sp.eye_array(2, self.size, k=self.size - 3, format="csr")

    def _basis(self, inner: Basis, slopes: sp.csr_array, moves: Moves, equalities: Array) -> Basis:
        """The inner basis with rows for the positions: each node's from those of the node before."""
        N, r = self.N, inner.Z.shape[1]
        Z, d = np.zeros((self.size, r)), np.zeros(self.size)
        Z[: self._sigma], Z[-1], d[: self._sigma] = inner.Z[:-1], inner.Z[-1], inner.d[:-1]
        gaps = equalities[self._eliminated : self.eliminated].reshape(N + 1, 2)
        pushed, moved = (
            (slopes @ inner.Z).reshape(N, 2, r),
            (slopes @ inner.d).reshape(N, 2) + gaps[1:],
        )
        Z[self.positions] = _propagated(moves, np.zeros((2, r)), -pushed).reshape(-1, r)
        d[self.positions] = _propagated(moves, -gaps[0], -moved).ravel()
        free = np.append(inner.free[:-1], self.size - 1) if len(inner.free) else inner.free
        return Basis(Z, d, free, self.eliminated)


def _propagated(moves: Moves, first: Array, added: Array) -> Array:
    """What a change of the first position and changes (N, 2, ...) of the moves make of the nodes, (N + 1, 2, ...)."""
    by_place = moves.whole_slopes[:, :, :2]
    if not by_place.any():  # a plane
        return np.asarray(
            first + np.concatenate([np.zeros_like(added[:1]), np.cumsum(added, axis=0)])
        )
    changes = [first]
    for slope, part in zip(by_place, added, strict=True):
        changes.append(changes[-1] + slope @ changes[-1] + part)
    return np.stack(changes)
