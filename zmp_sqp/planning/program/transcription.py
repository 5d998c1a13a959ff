"""The optimal control problem as a nonlinear program: multiple shooting in normalised time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from zmp_sqp.arrays import Array
from zmp_sqp.planning.program.hold import CONSTANT, LINEAR, Hold
from zmp_sqp.planning.program.layout import layout_of
from zmp_sqp.planning.program.null_space import null_space, with_last_column
from zmp_sqp.planning.program.rows import StageRows
from zmp_sqp.sqp.nlp import Basis, Evaluation, Linearization

__all__ = ["Boundary", "PathBounds", "Transcription"]

# Weight of the mean squared scaled acceleration, which picks one of many fastest motions. Where the
# ZMP costs time it trades time for smoothness: 1e-2 costs up to 1 %, but finds better motions; 3e-4
# costs less than 0.05 %.
REGULARIZATION = {CONSTANT: 1e-2, LINEAR: 3e-4}
SHORT_WAY = 1e-8  # [rad or m] below it, rounding of the positions is felt


@dataclass(frozen=True, slots=True, eq=False)
class Boundary:
    """Coordinates q and rates v at the start or the goal, shape (n,) each [rad or m, per second]."""

    q: Array
    v: Array


@dataclass(frozen=True, slots=True, eq=False)
class PathBounds:
    """Limits of the coordinates and of the duration.

    Attributes:
        position_lower, position_upper, velocity, acceleration: Of the coordinates, shape (n,).
        least_duration: Proven lower bound of the duration [s].
    """

    position_lower: Array
    position_upper: Array
    velocity: Array
    acceleration: Array
    least_duration: float


class Transcription:
    r"""Nonlinear program over x = (q_0..q_N, w_0..w_N, controls of the N intervals, sigma).

    .. math::
        \min \sigma + \tfrac{\epsilon}{2 N c n} \sum |u_k|^2, \quad
        q_{k+1} = q(1; q_k, w_k, u_k), \; w_{k+1} = w(1; w_k, u_k), \quad
        |w_k| \le v \sqrt{S}, \; |u_k| \le a S

    with h = 1/N, S = T^2 = sigma S_ref, boundary rates v_0 sqrt(S) and v_f sqrt(S), and the motion
    within an interval as its `Hold` says. The joint chain does not contain T.

    Rows of the wrench (an edge of the polygon, or the least normal force) hold at both ends of
    every interval, because the acceleration jumps at the nodes, and at the middle Bernstein control
    point 2 c(1/2) - (c(0) + c(1)) / 2 of the parabola through start, middle and end, so that this
    parabola keeps the bound everywhere. Rates and positions are polynomials and hold at their
    Bernstein points: everywhere. All variables are scaled to order one.

    Sparsity of a wrench row of interval k: start q_k, w_k, u_k (first), sigma; end q_{k+1},
        w_{k+1}, u_k (last), sigma;
    middle q_k, w_k, u_k (all), sigma.
    """

    def __init__(
        self,
        rows: StageRows,
        start: Boundary,
        goal: Boundary,
        bounds: PathBounds,
        *,
        intervals: int,
        hold: Hold = CONSTANT,
        ties: sp.csr_array | None = None,
    ) -> None:
        """Transcribe.

        Args:
            rows: The path constraints; their reference duration, that of the initial guess, scales
                time.
            start, goal: Boundary states.
            bounds: Limits of the coordinates.
            intervals: Number N of equal intervals.
            hold: How accelerations run within an interval.
            ties: Map from fewer free variables to the controls, shape (N c n, r); None leaves every
                control free.
        """
        self.rows, self.start, self.goal, self.bounds, self.hold = rows, start, goal, bounds, hold
        self.N, self.n, self.reference = intervals, rows.size, rows.reference
        reference = rows.reference
        S = reference**2
        reach = np.maximum(np.abs(goal.q - start.q), 1.0)
        self.control_scale = np.minimum(bounds.acceleration * S, 10.0 * reach)
        self.rate_scale = np.minimum(
            np.minimum(bounds.velocity * reference, 5.0 * reach), self.control_scale
        )
        # a short way must be gone as exactly as a long one
        self._position_weight = 1.0 / np.clip(self.control_scale, SHORT_WAY, 1.0)
        self.layout = layout_of(intervals, self.n, rows.count, hold)
        self._rate_share = bounds.velocity * reference / self.rate_scale
        self._control_share = bounds.acceleration * S / self.control_scale
        self._control_step = self.control_scale / self.rate_scale / intervals
        self._basis_Z = null_space(self.layout, self.rate_scale, self.control_scale, ties)
        self._free = self.layout.free if ties is None else self.layout.free[:0]
        self._start_rate, self._goal_rate = (
            side.v * reference / self.rate_scale for side in (start, goal)
        )
        self._stage_scale = np.concatenate(
            [np.ones(self.n), self.rate_scale, self.control_scale, [S]]
        )
        scales = np.ones(self.n), self.rate_scale, np.tile(self.control_scale, hold.controls), [S]
        self._middle_scale = np.concatenate(scales)
        self._to_middle = self._from_start(np.eye(3 * self.n + 1), 0.5) * self._middle_scale
        self._sigma_min = (bounds.least_duration / reference) ** 2
        self._tie_weight = REGULARIZATION[hold] / (intervals * hold.controls * self.n)
        self.nonlinear_rows: npt.NDArray[np.bool_] = (
            np.arange(self.layout.inequalities) < self.layout.wrench_rows
        )

    # --- points -------------------------------------------------------------------------------

    def pack(self, controls: Array, S: float) -> Array:
        """Point with controls (N, c, n) [T^2 a] and squared duration S [s^2] whose shooting gaps are closed."""
        sigma, flat = S / self.reference**2, controls.reshape(-1, self.n)
        to_q, to_w = self.layout.sums
        first = self.start.v * np.sqrt(S)
        q = self.start.q + np.linspace(0.0, 1.0, self.N + 1)[:, None] * first + to_q @ flat
        return self.layout.join(
            q, (first + to_w @ flat) / self.rate_scale, controls / self.control_scale, sigma
        )

    def unpack(self, x: Array) -> tuple[Array, Array, Array, float]:
        """Unscaled (q, w, controls, S), shapes (N+1, n), (N+1, n), (N, c, n), scalar [rad, s^2]."""
        q, w, controls, sigma = self.layout.split(x)
        return q, w * self.rate_scale, controls * self.control_scale, sigma * self.reference**2

    aim = None  # nothing drives

    def arrived(self, x: Array, aim: Array | None = None) -> tuple[Array, Array, Array, float]:
        """Result of `unpack` after the smallest change of controls that meets gaps and goal.

        Args:
            x: Point.
            aim: Not used.
        """
        _, _, controls, S = self.unpack(x)
        T, flat = np.sqrt(S), controls.reshape(-1, self.n)
        sums = np.vstack([part[-1] for part in self.layout.sums])  # (2, N c)
        wanted = np.vstack(
            [self.goal.q - self.start.q - self.start.v * T, (self.goal.v - self.start.v) * T]
        )
        flat = flat + sums.T @ np.linalg.solve(sums @ sums.T, wanted - sums @ flat)
        return self.unpack(self.pack(flat.reshape(controls.shape), S))

    # --- the nonlinear program ----------------------------------------------------------------

    def evaluate(self, x: Array, places: Array | None = None) -> Evaluation:
        """Values at x, with the base at places, starts, ends, middles of all intervals, shape (3N, 2) [m]."""
        return self._evaluation(x, self.rows.evaluate(*self._states(x), places))

    def linearize(self, x: Array) -> Linearization:
        """Values and first derivatives at x."""
        return self.linearize_at(x)[0]

    def linearize_at(self, x: Array, places: Array | None = None) -> tuple[Linearization, Array]:
        """As `linearize`, with a base at places as in `evaluate`, and slopes of wrench rows by them, (3N, E, m)."""
        N, layout = self.N, self.layout
        values, slopes = self.rows.linearize(*self._states(x), places)  # (3N, E, 3n + 1 [+ 2])
        slopes, by_places = slopes[:, :, : 3 * self.n + 1], slopes[:, :, 3 * self.n + 1 :]
        start, end, middle = (
            self._from_start(slopes[i * N : (i + 1) * N], s)
            for i, s in ((0, 0.0), (1, 1.0), (2, 0.5))
        )
        middles = (2.0 * middle - 0.5 * (start + end)) * self._middle_scale
        root_slope = 0.5 / np.sqrt(x[-1])
        C = layout.inequality_jacobian(
            slopes[: 2 * N] * self._stage_scale,
            middles,
            control_share=self._control_share,
            rate_slope=root_slope * self._rate_share,
            rate_scale=self.rate_scale,
            control_step=self._control_step,
        )
        A = layout.equality_jacobian(
            position_weight=self._position_weight,
            rate_scale=self.rate_scale,
            control_scale=self.control_scale,
            first=-root_slope * self._start_rate,
            last=-root_slope * self._goal_rate,
        )
        gradient, tie_gradient = np.zeros((2, layout.size))
        gradient[-1] = 1.0
        tie_gradient[layout.controls] = self._tie_weight * x[layout.controls]
        at = self._evaluation(x, values)
        lin = Linearization(
            at, gradient, tie_gradient, A, C, self._basis(at.equalities, root_slope)
        )
        return lin, by_places

    def hessian(
        self, x: Array, y: Array, z: Array, *, convex: bool, places: Array | None = None
    ) -> sp.csr_array:
        """Hessian of the Lagrangian: small weight on accelerations, square roots, curvature of the wrench and `extra`.

        Exact along closed gaps; with `convex`, a control point's curvature is that of the start.
        """
        layout, sigma = self.layout, x[-1]
        diagonal = np.zeros(layout.size)
        diagonal[layout.controls] = self._tie_weight
        roots = z[layout.rate_rows].reshape(-1, self.n).sum(axis=0) @ self._rate_share
        roots += y[self.n :] @ self._goal_rate if len(y) else 0.0
        diagonal[-1] = 0.25 * roots / sigma**1.5
        diagonal[-1] = max(diagonal[-1], 0.0) if convex else diagonal[-1]
        weights = self._point_weights(z, convex=convex)
        if not len(active := np.flatnonzero(weights.any(axis=1))):
            return sp.csr_array(sp.diags_array(diagonal))
        states_q, states_w, alpha, S = self._states(x)
        at = states_q[active], states_w[active], alpha[active]
        where = None if places is None else places[active]
        blocks = self.rows.curvature(*at, S, weights[active], where)
        ends, middles = active[active < 2 * self.N], active[active >= 2 * self.N] - 2 * self.N
        of_ends, of_middles = np.split(blocks, [len(ends)])
        of_ends *= self._stage_scale[:, None] * self._stage_scale
        of_middles = self._to_middle.T @ of_middles @ self._to_middle
        if convex:
            values, vectors = np.linalg.eigh(of_ends)
            of_ends = (vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
        return layout.hessian(diagonal, (of_ends, ends), (of_middles, middles))

    def optimality_gap(self, x: Array) -> float:
        """How far sigma stands above its proven lower bound, relative."""
        return float(x[-1] / self._sigma_min - 1.0) if self._sigma_min > 0.0 else np.inf

    # --- parts --------------------------------------------------------------------------------

    def _states(self, x: Array) -> tuple[Array, Array, Array, float]:
        """States (q, w, alpha) at the starts, at the ends, in the middle of all intervals, (3N, n) each, and S."""
        q, w, controls, S = self.unpack(x)
        h = 1.0 / self.N
        once, twice = (
            np.einsum("c,kcn->kn", shape, controls) for shape in self.hold.shapes(0.5)[1:]
        )
        middle_q, middle_w = q[:-1] + 0.5 * h * w[:-1] + h**2 * twice, w[:-1] + h * once
        alpha = np.vstack(
            [np.einsum("c,kcn->kn", self.hold.shapes(s)[0], controls) for s in (0.0, 1.0, 0.5)]
        )
        return np.vstack([q[:-1], q[1:], middle_q]), np.vstack([w[:-1], w[1:], middle_w]), alpha, S

    def _point_weights(self, z: Array, *, convex: bool) -> Array:
        """Weights of the rows' curvature at starts, ends and middles, shape (3N, E), from their multipliers.

        A control point is 2 c(1/2) - (c(0) + c(1)) / 2: parts of opposite signs, which clipping one
        by one would keep from cancelling. For that its curvature is taken as the start's, right but
        for O(h).
        """
        N = self.N
        weights = z[self.nonlinear_rows].reshape(3 * N, -1)
        starts, ends, controls = weights[:N], weights[N : 2 * N], weights[2 * N :]
        shares = (1.0, 0.0, 0.0) if convex else (-0.5, -0.5, 2.0)
        return np.vstack(
            [starts + shares[0] * controls, ends + shares[1] * controls, shares[2] * controls]
        )

    def _from_start(self, slopes: Array, s: float) -> Array:
        """Derivatives by (q, w, alpha, S) at share s of the intervals, by (q, w, controls, S) at their starts."""
        n, h = self.n, 1.0 / self.N
        by_q, by_w, by_alpha = slopes[..., :n], slopes[..., n : 2 * n], slopes[..., 2 * n : 3 * n]
        parts = [by_q, by_w + h * s * by_q]
        for level, once, twice in zip(*self.hold.shapes(s), strict=True):
            parts.append(level * by_alpha + h * once * by_w + h**2 * twice * by_q)
        return np.concatenate([*parts, slopes[..., 3 * n :]], axis=-1)

    def _evaluation(self, x: Array, values: Array) -> Evaluation:
        layout, bounds, hold, N = self.layout, self.bounds, self.hold, self.N
        q, w, controls, sigma = layout.split(x)
        root = np.sqrt(sigma) if sigma > 0.0 else np.nan
        rows = values.copy()
        rows[2 * N :] = 2.0 * rows[2 * N :] - 0.5 * (rows[:N] + rows[N : 2 * N])
        limit, rate = self._control_share * sigma, self._rate_share * root
        rates = np.vstack(
            [
                w,
                *(
                    w[:-1] + point * self._control_step * controls[:, 0]
                    for point in hold.rate_points
                ),
            ]
        )
        step = self.rate_scale / N
        inner = [
            q[:-1] + p * step * w[:-1] if p > 0.0 else q[1:] + p * step * w[1:]
            for p in hold.position_points
        ]
        places = np.vstack([q, *inner])
        inequalities = [
            rows,
            controls - limit,
            -controls - limit,
            rates - rate,
            -rates - rate,
            places - bounds.position_upper,
            bounds.position_lower - places,
            np.array([self._sigma_min - sigma]),
        ]
        push = self.control_scale * np.einsum("c,kcn->kn", hold.to_position, controls) / N
        gap_q = self._position_weight * (q[1:] - q[:-1] - (self.rate_scale * w[:-1] + push) / N)
        gap_w = w[1:] - w[:-1] - self._control_step * np.einsum("c,kcn->kn", hold.to_rate, controls)
        equalities = [
            self._position_weight * (q[0] - self.start.q),
            w[0] - root * self._start_rate,
            gap_q,
            gap_w,
            self._position_weight * (q[-1] - self.goal.q),
            w[-1] - root * self._goal_rate,
        ]
        tie_breaker = 0.5 * self._tie_weight * float(np.sum(controls**2))
        return Evaluation(sigma, tie_breaker, _flat(equalities), _flat(inequalities))

    def _basis(self, equalities: Array, root_slope: float) -> Basis:
        layout, n, N = self.layout, self.n, self.N
        Z = self._basis_Z
        if self._start_rate.any():
            moved = np.outer(np.arange(N + 1) / N, self.rate_scale * root_slope * self._start_rate)
            Z = with_last_column(Z, moved, np.tile(root_slope * self._start_rate, N + 1), layout)
        gaps, d = equalities[: layout.eliminated], np.zeros(layout.size)
        if np.abs(gaps).max() > 0.0:
            first_q, first_w = gaps[:n] / self._position_weight, gaps[n : 2 * n]
            gap_q, gap_w = gaps[2 * n :].reshape(2, N, n)
            dw = -(first_w + np.vstack([np.zeros(n), np.cumsum(gap_w, axis=0)]))
            moved = self.rate_scale * dw[:-1] / N - gap_q / self._position_weight
            d[layout.positions] = (
                np.vstack([np.zeros(n), np.cumsum(moved, axis=0)]) - first_q
            ).ravel()
            d[layout.rates] = dw.ravel()
        return Basis(Z, d, self._free, layout.eliminated)


def _flat(parts: list[Array]) -> Array:
    return np.concatenate([np.ravel(part) for part in parts])
