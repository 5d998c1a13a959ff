"""The optimal control problem as a nonlinear program: multiple shooting in normalised time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from zmp_sqp.arrays import Array
from zmp_sqp.planning.layout import layout_of
from zmp_sqp.planning.model import StageModel, wrench_curvature
from zmp_sqp.sqp.nlp import Basis, Evaluation, Linearization

__all__ = ["Boundary", "PathBounds", "Transcription"]

REGULARIZATION = 1e-2  # weight of the mean squared scaled acceleration: picks one of many fastest motions
LEAST_NORMAL_FORCE = 0.05  # of the weight: below it the tracks are as good as in the air


@dataclass(frozen=True, slots=True, eq=False)
class Boundary:
    """Coordinates q and rates v at the start or the goal, shape (n,) each [rad or m, per second]."""

    q: Array
    v: Array


@dataclass(frozen=True, slots=True, eq=False)
class PathBounds:
    """What holds along the way.

    Attributes:
        position_lower, position_upper, velocity, acceleration: Of the coordinates, shape (n,).
        wrench_rows: C with C (f, tau) <= 0 for a ZMP inside its polygon, shape (E, 6) [m per N].
        weight: Total mass times gravity, which scales the rows [N].
        least_duration: Proven lower bound of the duration [s].
    """

    position_lower: Array
    position_upper: Array
    velocity: Array
    acceleration: Array
    wrench_rows: Array
    weight: float
    least_duration: float


class Transcription:
    r"""Nonlinear program over x = (q_0..q_N, w_0..w_N, alpha_0..alpha_{N-1}, sigma).

    .. math::
        \min \sigma + \tfrac{\epsilon}{2 N n} \sum |\alpha_k|^2, \quad
        q_{k+1} = q_k + h w_k + \tfrac{h^2}{2} \alpha_k, \; w_{k+1} = w_k + h \alpha_k, \quad
        |w_k| \le v \sqrt{S}, \; |\alpha_k| \le a S

    with h = 1/N, S = T^2 = sigma S_ref, boundary rates v_0 sqrt(S) and v_f sqrt(S). The joint chain does not contain T.

    Rows of the wrench (an edge of the polygon, or the least normal force) hold at both ends of every interval, because
    the acceleration jumps at the nodes, and at the middle Bernstein control point 2 c(1/2) - (c(0) + c(1)) / 2 of the
    parabola through start, middle and end, so that this parabola keeps the bound everywhere. Positions, which are
    parabolas, hold at the nodes and at their control points q_k + h w_k / 2. All variables are scaled to order one.

    Sparsity of a wrench row of interval k, start: columns q_k, w_k, alpha_k, sigma; end: q_{k+1}, w_{k+1}, alpha_k, sigma.
    """

    def __init__(
        self, model: StageModel, start: Boundary, goal: Boundary, bounds: PathBounds, *, intervals: int, reference: float
    ) -> None:
        """Transcribe; `reference` is the duration of the initial guess, which scales time [s]."""
        self.model, self.start, self.goal, self.bounds = model, start, goal, bounds
        self.N, self.n, self.reference = intervals, model.size, reference
        S = reference**2
        reach = np.maximum(np.abs(goal.q - start.q), 1.0)
        self.rate_scale = np.minimum(bounds.velocity * reference, 5.0 * reach)
        self.acceleration_scale = np.minimum(bounds.acceleration * S, 10.0 * reach)
        least = np.zeros((1, 6))
        least[0, 2] = -1.0
        # [m] once divided by the weight; the normal-force row has the force's share of the weight as its "metre"
        self._rows = np.vstack([bounds.wrench_rows, least]) / (bounds.weight * S)
        self._row_offset = np.zeros(len(self._rows))
        self._row_offset[-1] = LEAST_NORMAL_FORCE
        self.layout = layout_of(intervals, self.n, len(self._rows))
        self._rate_share = bounds.velocity * reference / self.rate_scale
        self._acceleration_share = bounds.acceleration * S / self.acceleration_scale
        self._half_step = 0.5 * self.rate_scale / intervals
        self._basis_Z = self.layout.basis(self.rate_scale, self.acceleration_scale)
        self._start_rate, self._goal_rate = (side.v * reference / self.rate_scale for side in (start, goal))
        self._stage_scale = np.concatenate([np.ones(self.n), self.rate_scale, self.acceleration_scale, [S]])
        self._sigma_min = (bounds.least_duration / reference) ** 2
        self.nonlinear_rows: npt.NDArray[np.bool_] = np.arange(self.layout.inequalities) < self.layout.wrench_rows

    # --- points -------------------------------------------------------------------------------

    def pack(self, alpha: Array, S: float) -> Array:
        """Point with accelerations T^2 a (N, n) and squared duration S [s^2] whose shooting gaps are closed."""
        layout, sigma = self.layout, S / self.reference**2
        w = self._start_rate * np.sqrt(sigma) * self.rate_scale + np.vstack([np.zeros(self.n), np.cumsum(alpha, axis=0)]) / self.N
        moved = (w[:-1] + 0.5 * alpha / self.N) / self.N
        q = self.start.q + np.vstack([np.zeros(self.n), np.cumsum(moved, axis=0)])
        return layout.join(q, w / self.rate_scale, alpha / self.acceleration_scale, sigma)

    def unpack(self, x: Array) -> tuple[Array, Array, Array, float]:
        """Unscaled (q, w, alpha, S), shapes (N+1, n), (N+1, n), (N, n), scalar [rad, s^2]."""
        q, w, alpha, sigma = self.layout.split(x)
        return q, w * self.rate_scale, alpha * self.acceleration_scale, sigma * self.reference**2

    def arrived(self, x: Array) -> tuple[Array, Array, Array, float]:
        """As `unpack`, with gaps closed and the goal met to rounding by the smallest change of the accelerations."""
        _, _, alpha, S = self.unpack(x)
        T, N = np.sqrt(S), self.N
        to_q, to_w = (N - np.arange(N) - 0.5) / N**2, np.full(N, 1.0 / N)
        sums = np.vstack([to_q, to_w])
        wanted = np.vstack([self.goal.q - self.start.q - self.start.v * T, (self.goal.v - self.start.v) * T])
        alpha = alpha + sums.T @ np.linalg.solve(sums @ sums.T, wanted - sums @ alpha)
        q, w, alpha, S = self.unpack(self.pack(alpha, S))
        return q, w, alpha, S

    # --- the nonlinear program ----------------------------------------------------------------

    def evaluate(self, x: Array) -> Evaluation:
        """Values at x."""
        return self._evaluation(x, self.model.wrench(*self._states(x)))

    def linearize(self, x: Array) -> Linearization:
        """Values and first derivatives at x."""
        N, (*states, S) = self.N, self._states(x)
        wrench, slopes = self.model.wrench_derivatives(*states, S)
        slopes = self._rows @ slopes  # (3N, E, 3n + 1)
        last = _seen_from(slopes[N : 2 * N], -1.0 / N, self.n)
        slopes[2 * N :] = 2.0 * _seen_from(slopes[2 * N :], -0.5 / N, self.n) - 0.5 * (slopes[:N] + last)
        slopes *= self._stage_scale
        slopes[:, :, -1] += self._row_offset
        root_slope = 0.5 / np.sqrt(x[-1])
        C = self.layout.inequality_jacobian(
            slopes,
            acceleration_share=self._acceleration_share,
            rate_slope=root_slope * self._rate_share,
            half_step=self._half_step,
        )
        A = self.layout.equality_jacobian(
            rate_scale=self.rate_scale,
            acceleration_scale=self.acceleration_scale,
            first=-root_slope * self._start_rate,
            last=-root_slope * self._goal_rate,
        )
        gradient = np.zeros(self.layout.size)
        gradient[-1] = 1.0
        tie_gradient, alpha = np.zeros(self.layout.size), self.layout.accelerations
        tie_gradient[alpha] = REGULARIZATION / (self.N * self.n) * x[alpha]
        at = self._evaluation(x, wrench)
        return Linearization(at, gradient, tie_gradient, A, C, self._basis(at.equalities, root_slope))

    def hessian(self, x: Array, y: Array, z: Array, *, convex: bool) -> sp.csr_array:
        """Hessian of the Lagrangian: the small weight on accelerations, the square roots, the wrench's curvature."""
        layout, sigma = self.layout, x[-1]
        diagonal = np.zeros(layout.size)
        diagonal[layout.accelerations] = REGULARIZATION / (self.N * self.n)
        roots = z[layout.rate_rows].reshape(2, -1, self.n).sum(axis=(0, 1)) @ self._rate_share
        roots += y[self.n :] @ self._goal_rate if len(y) else 0.0
        diagonal[-1] = 0.25 * roots / sigma**1.5
        if convex:
            diagonal[-1] = max(diagonal[-1], 0.0)
        weights = z[self.nonlinear_rows].reshape(3 * self.N, -1)
        weights[: self.N] += weights[2 * self.N :]  # a control point's curvature is that of the start but for O(h)
        weights = weights[: 2 * self.N]
        active = np.flatnonzero(weights.max(axis=1) > 0.0)
        if not len(active):
            return sp.csr_array(sp.diags_array(diagonal))
        *states, S = self._states(x)
        blocks = wrench_curvature(self.model, *(part[active] for part in states), S, weights[active] @ self._rows)
        blocks *= self._stage_scale[:, None] * self._stage_scale
        if convex:
            values, vectors = np.linalg.eigh(blocks)
            blocks = (vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
        return layout.hessian(diagonal, blocks, active)

    def optimality_gap(self, x: Array) -> float:
        """How far sigma stands above its proven lower bound, relative."""
        return float(x[-1] / self._sigma_min - 1.0) if self._sigma_min > 0.0 else np.inf

    # --- parts --------------------------------------------------------------------------------

    def _states(self, x: Array) -> tuple[Array, Array, Array, float]:
        """States at the starts, at the ends, in the middle of all intervals, (3N, n) each, and S."""
        q, w, alpha, S = self.unpack(x)
        half = 0.5 / self.N
        middle_q, middle_w = q[:-1] + half * w[:-1] + 0.5 * half**2 * alpha, w[:-1] + half * alpha
        return np.vstack([q[:-1], q[1:], middle_q]), np.vstack([w[:-1], w[1:], middle_w]), np.vstack([alpha] * 3), S

    def _evaluation(self, x: Array, wrench: Array) -> Evaluation:
        layout, bounds = self.layout, self.bounds
        q, w, alpha, sigma = layout.split(x)
        root = np.sqrt(sigma) if sigma > 0.0 else np.nan
        rows = wrench @ self._rows.T + sigma * self._row_offset
        N = self.N
        rows[2 * N :] = 2.0 * rows[2 * N :] - 0.5 * (rows[:N] + rows[N : 2 * N])
        limit = self._acceleration_share * sigma
        rate = self._rate_share * root
        position_control = q[:-1] + self._half_step * w[:-1]
        inequalities = [
            rows, alpha - limit, -alpha - limit, w - rate, -w - rate, q - bounds.position_upper, bounds.position_lower - q,
            position_control - bounds.position_upper, bounds.position_lower - position_control, self._sigma_min - sigma,
        ]  # fmt: skip
        gap_q = q[1:] - q[:-1] - (self.rate_scale * w[:-1] + 0.5 / self.N * self.acceleration_scale * alpha) / self.N
        gap_w = w[1:] - w[:-1] - self.acceleration_scale / self.rate_scale * alpha / self.N
        equalities = [
            q[0] - self.start.q, w[0] - root * self._start_rate, gap_q, gap_w, q[-1] - self.goal.q, w[-1] - root * self._goal_rate
        ]  # fmt: skip
        tie_breaker = 0.5 * REGULARIZATION / (self.N * self.n) * float(np.sum(alpha**2))
        return Evaluation(sigma, tie_breaker, _flat(equalities), _flat(inequalities))

    def _basis(self, equalities: Array, root_slope: float) -> Basis:
        layout, n, N = self.layout, self.n, self.N
        Z = self._basis_Z
        if self._start_rate.any():
            Z = Z.copy()
            Z[layout.rates, -1] = np.tile(root_slope * self._start_rate, N + 1)
            Z[layout.positions, -1] = np.outer(np.arange(N + 1) / N, self.rate_scale * root_slope * self._start_rate).ravel()
        gaps = equalities[: layout.eliminated]
        d = np.zeros(layout.size)
        if np.abs(gaps).max() > 0.0:
            first_w, gap_w = gaps[n : 2 * n], gaps[2 * n + N * n :].reshape(N, n)
            dw = -(first_w + np.vstack([np.zeros(n), np.cumsum(gap_w, axis=0)]))
            moved = self.rate_scale * dw[:-1] / N - gaps[2 * n : 2 * n + N * n].reshape(N, n)
            d[layout.positions] = (np.vstack([np.zeros(n), np.cumsum(moved, axis=0)]) - gaps[:n]).ravel()
            d[layout.rates] = dw.ravel()
        return Basis(Z, d, layout.free, layout.eliminated)


def _seen_from(slopes: Array, later: float, n: int) -> Array:
    """Derivatives by the state at one time, rewritten as derivatives by the state `later` after it (same alpha)."""
    by_q, by_w, rest = slopes[..., :n], slopes[..., n : 2 * n], slopes[..., 2 * n :].copy()
    rest[..., :n] += 0.5 * later**2 * by_q - later * by_w
    return np.concatenate([by_q, by_w - later * by_q, rest], axis=-1)


def _flat(parts: list[Array]) -> Array:
    return np.concatenate([np.ravel(part) for part in parts])
