"""Nonlinear program of a motion, by multiple shooting in normalised time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array
from zmp_sqp.cached import cached_property
from zmp_sqp.mechanics.bounds.payload_spread import moment_of_spread
from zmp_sqp.planning.constraints.protocol import StageSample
from zmp_sqp.planning.program.clipping import clipped
from zmp_sqp.planning.program.corner_jacobian import CornerJacobian
from zmp_sqp.planning.program.driving.displacements import Displacements
from zmp_sqp.planning.program.driving.positions import Positions
from zmp_sqp.planning.program.grid import ENDS, Grid
from zmp_sqp.planning.program.limits import (
    LEAST_SHARE,
    Boundary,
    LimitRows,
    PathBounds,
    PositionBound,
)
from zmp_sqp.planning.program.patterns import Patterns, patterns_of
from zmp_sqp.planning.program.rows import StageRows
from zmp_sqp.planning.program.stages import STATE, Stages
from zmp_sqp.sqp.nlp import Evaluation, Linearization
from zmp_sqp.sqp.rows import Rows

__all__ = ["Motion", "StagedProgram"]

Mask = npt.NDArray[np.bool_]

# weight of the mean squared scaled acceleration, which picks one of many fastest motions; it costs
# less than 0.05 % of the duration
REGULARIZATION = 3e-4
POINTS = 3  # per interval where nonlinear rows are imposed: start, end, middle control point
# shares of an interval at which rows are compared with their parabola (`StagedProgram.excess`): the
# Gauss points, and a finer set for the last iterations
INSIDE = (0.2113, 0.7887)
INSIDE_FINE = (0.1, 0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 0.9)
DUST = 1e-7  # relative to the largest multiplier: rows with smaller ones add no curvature
LINEAR_TOLERANCE = 2e-7  # largest scaled violation of a limit at a solution
# `decisive` selects an acceleration limit where the acceleration is above 1 - 0.6 of it
DECISIVE = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Point of the program: a motion that meets both boundary states and closes all gaps.

    Only the position of a driving base may miss its goal.

    Attributes:
        controls: Scaled accelerations at both ends of the intervals, shape (N, 2 n).
        sigma: Squared duration over the squared reference duration.
        states: Scaled states at the nodes, integrated from the controls, shape (N + 1, nx).
        moves: Displacements of a driving base, from the states; None if it stands.
    """

    controls: Array
    sigma: float
    states: Array
    moves: Displacements | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Memory:
    """Data of a linearisation that the Hessian at its point needs.

    Attributes:
        motion: Point of the linearisation.
        states: (q, w, alpha) at starts, ends and middles of the intervals, shape (3N, n) each.
        base_positions: Base positions there, shape (3N, 2); None where rows do not depend on them.
        by_ends: Derivative of each inequality by sigma through the boundary rates v sqrt(S), shape
            (m,); of the limits only where `C` is a `CornerJacobian`.
        displacements: Displacements of a driving base, or None.
        C: Jacobian of the inequalities.
        sample: The states with the derivatives of their efforts; None for a `CornerJacobian`.
    """

    motion: Motion
    states: tuple[Array, Array, Array]
    base_positions: Array | None
    by_ends: Array
    displacements: Any
    C: Rows | CornerJacobian
    sample: StageSample | None


class StagedProgram:
    r"""Minimum-time motions whose accelerations are linear within the intervals of a grid.

    .. math::
        \min \sigma + \tfrac{\epsilon}{4 N n} \sum |u_k|^2, \quad
        |w_k| \le v \sqrt{S}, \; |u_k| \le a S, \; r(q, w, \alpha, S) \le 0

    with S = T^2 = sigma S_ref and boundary rates v_0 sqrt(S), v_f sqrt(S). In normalised time the
    integration of the coordinates does not contain T. `Stages` explains the variables.

    Nonlinear rows r (`StageRows`) are imposed at both ends of every interval, because accelerations
    jump at the nodes, and at the middle Bernstein control point 2 r(1/2) - (r(0) + r(1)) / 2 of the
    parabola through the values at start, middle and end, so that this parabola is at most zero in
    the whole interval. Limits (`LimitRows`) are imposed at Bernstein points and hold at all times.

    Where the centre of mass of a payload may lie anywhere in a box, the corners of the box do not
    cover the whole moment. Rows are raised by the difference (`moment_of_spread`, below a hundredth
    of the polygon's size); derivatives leave it out.

    The Hessian evaluates the curvature of an interval's rows at its middle, with the multipliers of
    its three points added up. Clipping the three points separately would leave in the Hessian parts
    that cancel in the sum.

    Inequalities: nonlinear rows by interval, point and row; then the limits. Equalities: gaps of
    the position of a driving base at the ends of the intervals.
    """

    def __init__(
        self,
        rows: StageRows,
        start: Boundary,
        goal: Boundary,
        bounds: PathBounds,
        grid: Grid,
        *,
        drive: Positions | None = None,
        position_bounds: tuple[PositionBound, ...] = (),
    ) -> None:
        """Scale the program.

        Args:
            rows: Rows of the path constraints; their reference duration scales time.
            start, goal: Boundary states.
            bounds: Limits of coordinates and duration.
            grid: Grid of normalised time.
            drive: Dynamics of the position of a driving base; None if it stands.
            position_bounds: Bounds on x and y of a driving base at the nodes.
        """
        self.rows, self.start, self.goal, self.bounds = rows, start, goal, bounds
        self.grid, self.n, self.reference, self.drive = grid, rows.size, rows.reference, drive
        S = self.reference**2
        reach = np.maximum(np.abs(goal.q - start.q), 1.0)
        self.control_scale = np.minimum(bounds.acceleration * S, 10.0 * reach)
        rates = np.minimum(bounds.velocity * self.reference, 5.0 * reach)
        self.rate_scale = np.minimum(rates, self.control_scale)
        positions = 0 if drive is None else 2
        scales = self.rate_scale, self.control_scale
        # of a driving base, the position at the goal is given, and the path length follows
        of_base = () if drive is None else (self.n - 2,)
        free = tuple(range(self.n)) if goal.free else of_base
        self.stages = Stages(grid, self.n, positions, *scales, S, free)
        # scaled boundary rates per square root of sigma
        self.first, self.last = (
            side.v * self.reference / self.rate_scale for side in (start, goal)
        )
        ends = self.first, self.last
        self.limits = LimitRows(self.stages, bounds, self.reference, ends, position_bounds)
        self.tie = REGULARIZATION / (grid.size * ENDS * self.n)
        self.nonlinear = grid.size * POINTS * rows.count
        self.inequalities = self.nonlinear + self.limits.count
        # gaps of a base's position at the ends of the intervals; a free goal closes the last one
        self.gaps = 0 if drive is None else grid.size - int(goal.free)
        self.equalities = 2 * self.gaps
        self.size = self.stages.size
        per_row = np.tile(rows.tolerance, grid.size * POINTS)
        linear = np.full(self.limits.count, LINEAR_TOLERANCE)
        self.tolerance = np.concatenate([per_row, linear])

    # --- points -----------------------------------------------------------------------------

    def motion(self, controls: Array, sigma: float, near: Motion | None = None) -> Motion:
        """Motion by the least-norm change of given accelerations that meets the goal.

        Args:
            controls: Scaled accelerations at both ends of the intervals, shape (N, 2 n).
            sigma: Squared duration over the squared reference duration.
            near: Motion nearby, from whose positions those of a driving base are found.
        """
        n, N = self.n, self.grid.size
        T = self.reference * np.sqrt(sigma) if sigma > 0.0 else np.nan
        unscaled = controls.reshape(N * ENDS, n) * self.control_scale
        first = self.start.v * T
        wanted = np.vstack([self.goal.q - self.start.q - first, (self.goal.v - self.start.v) * T])
        missed = wanted - self.grid.sums @ unscaled
        change = self.grid.least_changes @ missed
        if self.stages.free:
            free, to_rate = list(self.stages.free), self.grid.sums[1]
            change[:, free] = np.outer(to_rate / (to_rate @ to_rate), missed[1, free])
        unscaled = (unscaled + change).reshape(N, ENDS, n)
        q, w = self.grid.rolled(self.start.q, first, unscaled)
        states, moves = [q, w / self.rate_scale], None
        if self.drive is not None:
            known = None if near is None else near.states[:, self.stages.places]
            p, moves = self.drive.path(self.grid, q, w, unscaled, known)
            states.append(p)
        scaled = (unscaled / self.control_scale).reshape(N, -1)
        return Motion(scaled, float(sigma), np.hstack(states), moves)

    def pack(self, controls: Array, S: float) -> Motion:
        """Motion nearest to accelerations T^2 a, shape (N, 2, n), at a squared duration S [s^2]."""
        scaled = (controls / self.control_scale).reshape(self.grid.size, -1)
        return self.motion(scaled, S / self.reference**2)

    def unpack(self, point: Motion) -> tuple[Array, Array, Array, float]:
        """Unscaled (q, w, controls, S) of a motion, shapes (N+1, n), (N+1, n), (N, 2, n), ()."""
        n = self.n
        q, w = point.states[:, :n], point.states[:, n : 2 * n] * self.rate_scale
        controls = point.controls.reshape(self.grid.size, ENDS, n) * self.control_scale
        return q, w, controls, point.sigma * self.reference**2

    def moved(self, lin: Linearization, point: Motion, step: Array) -> Motion:
        """Motion after a step of the variables, with gaps closed and goal met exactly."""
        change = self._stage_steps(step, point.sigma)
        M = self.stages.hermite
        controls = np.einsum(
            "kuj,kj->ku",
            np.broadcast_to(M, (self.grid.size, *M.shape[1:]))[:, self.stages.controls],
            change,
        )
        # a QP that leaves out the row of LEAST_SHARE may lower sigma further
        sigma = max(point.sigma + float(step[-1]), 0.5 * LEAST_SHARE * point.sigma)
        return self.motion(point.controls + controls, sigma)

    def _stage_steps(self, step: Array, sigma: float) -> Array:
        """Change of the mapped stage variables, boundary rates v sqrt(S) included, (N, m)."""
        columns = self.stages.stage_columns
        change = np.where(columns >= 0, step[columns], 0.0)
        by_sigma = 0.5 / np.sqrt(sigma) * step[-1] / STATE
        change[0, self.stages.rates] = by_sigma * self.first
        change[-1, self.stages.last_rates] = by_sigma * self.last
        return change

    # --- the nonlinear program --------------------------------------------------------------

    def evaluate(self, point: Motion) -> Evaluation:
        """Values of objective and constraints at a motion."""
        if not point.sigma > 0.0:
            undefined = np.full((3 * self.grid.size, self.rows.count), np.nan)
            return self._evaluation(point, undefined, None)
        states, base_positions, _ = self._samples(point)
        S = point.sigma * self.reference**2
        return self._evaluation(
            point, self.rows.evaluate(*states, S, base_positions), base_positions
        )

    def linearize(self, point: Motion) -> Linearization:
        """Values and first derivatives of objective and constraints at a motion."""
        states, base_positions, displacements = self._samples(point)
        sample: StageSample | None = None
        C: Rows | CornerJacobian
        if self.rows.models is None:
            S = point.sigma * self.reference**2
            sample = self.rows.sample(0, *states, S, base_positions)
            values, C, by_ends = self._all_rows(sample, displacements, point.sigma)
        else:
            expanded = self._rows_on_demand(states, base_positions, displacements, point.sigma)
            values, C, by_ends = expanded
        A = None
        if self.drive is not None and self._patterns.A is not None:
            by_stage = self.drive.end_derivatives(self.stages, displacements)
            by_stage = self._folded(by_stage.copy(), point.sigma)[: self.gaps]
            identity = np.full(self.equalities, -STATE)
            A = self._patterns.A.matrix(
                self._patterns.A.data(np.concatenate([by_stage.ravel(), identity]))
            )
        memory = _Memory(point, states, base_positions, by_ends, displacements, C, sample)
        at = self._evaluation(point, values, base_positions)
        return Linearization(at, self._gradient(point), A, C, memory)

    def hessian(
        self, lin: Linearization, y: Array, z: Array, *, clipped: float, damping: float
    ) -> Any:
        """Hessian of the Lagrangian, upper triangle, CSC; see `NonlinearProgram.hessian`."""
        memory: _Memory = lin.memory
        sigma = memory.motion.sigma
        blocks = self._curvature(memory, y, z, clipped)
        of_rates = z[self.nonlinear :][self.limits.rate_rows].reshape(-1, self.n).sum(axis=0)
        # curvature of sqrt(sigma) in the rate limits
        blocks[:, -1, -1] += 0.25 * float(of_rates @ self.limits.rate) / sigma**1.5 / self.grid.size
        u = np.arange(self.stages.nx, self.stages.m - 1)
        blocks[:, u, u] += self.tie
        if damping > 0.0:
            every = np.arange(self.stages.m - 1)
            blocks[:, every, every] += damping
        M = self.stages.hermite
        blocks = M.transpose(0, 2, 1) @ blocks @ M
        if self.limits.moving:
            self._fold_hessian(blocks, z, memory)
        pattern = self._patterns.H
        return pattern.matrix(pattern.data(blocks.ravel()))

    def metric(self) -> Any:
        """Matrix H for which d'Hd is the squared change of all scaled accelerations by a step d.

        Upper triangle, CSC, shape (size, size).
        """
        m = self.stages.m
        M = self.stages.hermite[:, self.stages.controls]
        blocks = np.broadcast_to(M.transpose(0, 2, 1) @ M, (self.grid.size, m, m))
        return self._patterns.H.matrix(self._patterns.H.data(blocks.ravel()))

    def decisive(self, point: Motion, *, early: bool) -> Mask:
        """Mask of acceleration limits: all of them early, then those that are near, `DECISIVE`."""
        mask = np.zeros(self.inequalities, dtype=bool)
        u, limit = point.controls, np.tile(self.limits.control, ENDS) * point.sigma
        near = -DECISIVE * limit
        sides = np.stack([(u - limit) > near, (-u - limit) > near]).ravel()
        mask[self.nonlinear : self.nonlinear + len(sides)] = early | sides
        return mask

    def excess(self, point: Motion, at: Evaluation, *, fine: bool) -> Array | None:
        """Largest excess of each row over the parabola through its start, middle and end values."""
        values, at_rows = at.memory  # at_rows: base positions where the values were taken
        N, shares = self.grid.size, INSIDE_FINE if fine else INSIDE
        q, w, controls, S = self.unpack(point)
        states = [self.grid.within(s, q[:-1], w[:-1], controls) for s in shares]
        at_q, at_w, alpha = (np.vstack(parts) for parts in zip(*states, strict=True))
        base_positions = None
        if at_rows is not None:
            p0, p1, middle = (at_rows[i * N : (i + 1) * N] for i in range(3))
            base_positions = np.vstack([_parabola(s, p0, p1, middle) for s in shares])
        found = self.rows.evaluate(at_q, at_w, alpha, S, base_positions).reshape(len(shares), N, -1)
        start, end, middle = values.reshape(3, N, -1)
        most = np.zeros((N, self.rows.count))
        for s, inside in zip(shares, found, strict=True):
            most = np.maximum(most, inside - _parabola(s, start, end, middle))
        return np.repeat(most[:, None], POINTS, axis=1).ravel()

    def optimality_gap(self, point: Motion) -> float:
        """Relative distance of sigma from its proven lower bound; infinite without one."""
        least = self.limits.least
        return point.sigma / least - 1.0 if least > 0.0 else np.inf

    # --- parts ------------------------------------------------------------------------------

    def _all_rows(
        self, sample: StageSample, displacements: Any, sigma: float
    ) -> tuple[Array, Rows, Array]:
        """Values (3N, E) of the nonlinear rows, Jacobian of all inequalities, and `by_ends`."""
        N = self.grid.size
        values, jacobian = self.rows.linearized(sample)  # (3N, E, 3n + 1 [+ 2])
        by_state = jacobian[:, :, : 3 * self.n + 1]
        start, end, middle = (
            by_state[i * N : (i + 1) * N] @ part for i, part in enumerate(self.stages.mapped)
        )
        if sample.positions is not None and self.drive is not None:
            by_place = jacobian[:, :, 3 * self.n + 1 :]
            self.drive.add_position_derivatives(
                self.stages, displacements, by_place, (start, end, middle)
            )
        blocks = np.stack([start, end, 2.0 * middle - 0.5 * (start + end)], axis=1)
        entries, by_ends = self._inequality_entries(blocks, sigma)
        return values, Rows(self._patterns.C.matrix(self._patterns.C.data(entries))), by_ends

    def _rows_on_demand(
        self,
        states: tuple[Array, Array, Array],
        base_positions: Array | None,
        displacements: Any,
        sigma: float,
    ) -> tuple[Array, CornerJacobian, Array]:
        """Results of `_all_rows` for many corners; `by_ends` is that of the limits alone."""
        stages = self.stages
        expansion = self.rows.expand(*states, sigma * self.reference**2, base_positions)
        maps = stages.mapped
        if base_positions is not None and self.drive is not None:
            maps = self.drive.with_positions(stages, displacements, maps)
        entries, by_ends = self.limits.entries(sigma)
        limits = Rows(self._patterns.C.matrix(self._patterns.C.data(entries)))
        ends = np.zeros((2, stages.m))
        half = 0.5 / np.sqrt(sigma) / STATE
        ends[0, stages.rates], ends[1, stages.last_rates] = half * self.first, half * self.last
        C = CornerJacobian(stages, expansion, maps, (ends[0], ends[1]), limits)
        return expansion.values, C, by_ends

    def _samples(self, point: Motion) -> tuple[tuple[Array, Array, Array], Array | None, Any]:
        """States at starts, ends and middles, base positions there, and displacements.

        Positions are None where rows do not depend on them, displacements where the base stands.
        """
        q, w, controls, _ = self.unpack(point)
        middle = self.grid.within(0.5, q[:-1], w[:-1], controls)
        states = (
            np.vstack([q[:-1], q[1:], middle[0]]),
            np.vstack([w[:-1], w[1:], middle[1]]),
            np.vstack([controls[:, 0], controls[:, 1], middle[2]]),
        )
        if self.drive is None:
            return states, None, None
        p = point.states[:, self.stages.places]
        displacements = point.moves
        if displacements is None:
            raise ValueError("Motion.moves is missing: make motions by StagedProgram.motion")
        if self.drive.terrain.uniform:
            return states, None, displacements
        return states, np.vstack([p[:-1], p[1:], p[:-1] + displacements.half]), displacements

    def _evaluation(self, point: Motion, values: Array, base_positions: Array | None) -> Evaluation:
        N = self.grid.size
        start, end, middle = values.reshape(3, N, -1)
        nonlinear = np.stack([start, end, 2.0 * middle - 0.5 * (start + end)], axis=1)
        if self.rows.by_turning is not None:
            nonlinear += self._turning(point)[:, None, None] * self.rows.by_turning
        with np.errstate(invalid="ignore"):
            limits = self.limits.values(point.states, point.controls, point.sigma)
        missed = np.zeros(self.equalities)
        if self.drive is not None and not self.goal.free:
            # all gaps are closed; the goal may be missed
            missed[-2:] = point.states[-1, self.stages.places] - self.drive.goal
        tie = 0.5 * self.tie * float(np.sum(point.controls**2))
        inequalities = np.concatenate([nonlinear.ravel(), limits])
        return Evaluation(point.sigma, tie, missed, inequalities, (values, base_positions))

    def _turning(self, point: Motion) -> Array:
        """`moment_of_spread` per unit of spread in each interval, times S, shape (N,)."""
        _, w, controls, _ = self.unpack(point)
        jerk = np.abs(controls[:, 1] - controls[:, 0])
        rates = np.maximum(np.abs(w[:-1]), np.abs(w[1:])) + 0.125 * self.grid.steps[:, None] * jerk
        accelerations = np.abs(controls).max(axis=1)
        model = self.rows.corners[0].model
        arm, G = model.coordinates.size, np.abs(model.coordinates.G)
        base = None
        if self.drive is not None:
            base = np.zeros((2, 4, len(rates)))
            base[1, :2] = rates[:, -1], accelerations[:, -1]
        joints = (part[:, :arm] @ G.T for part in (rates, accelerations))
        return moment_of_spread(model.machine, *joints, spread=1.0, base=base)

    def _gradient(self, point: Motion) -> Array:
        """Gradient of sigma plus the tie breaker by the variables, shape (size,)."""
        stages, M = self.stages, self.stages.hermite
        by_stage = np.zeros((self.grid.size, stages.m))
        by_stage[:, stages.controls] = self.tie * point.controls
        by_stage = (by_stage[:, None] @ M)[:, 0]
        by_stage = self._folded(by_stage[:, None], point.sigma)[:, 0]
        columns = stages.stage_columns.ravel()
        given = columns < 0
        index = np.where(given, 0, columns)
        weights = np.where(given, 0.0, by_stage.ravel())
        gradient = np.zeros(self.size)
        gradient += np.bincount(index, weights=weights, minlength=self.size)
        gradient[-1] += 1.0
        return gradient

    def _folded(self, entries: Array, sigma: float) -> Array:
        """Derivatives (N, R, m) by mapped stage variables, completed in sigma's column, in place.

        Adds to the derivative by sigma the part through the boundary rates v sqrt(S).
        """
        if self.limits.moving:
            half = 0.5 / np.sqrt(sigma) / STATE
            rates, last = self.stages.rates, self.stages.last_rates
            entries[0, :, -1] += entries[0, :, rates] @ (half * self.first)
            entries[-1, :, -1] += entries[-1, :, last] @ (half * self.last)
        return entries

    def _inequality_entries(self, blocks: Array, sigma: float) -> tuple[Array, Array]:
        """Entries of the inequality Jacobian, and `by_ends` of `_Memory`, shape (m,)."""
        nonlinear = blocks.reshape(self.grid.size, -1, self.stages.m)
        of_limits, added = self.limits.entries(sigma)
        by_ends = np.zeros(nonlinear.shape[:2])
        if self.limits.moving:
            before = nonlinear[:, :, -1].copy()
            nonlinear = self._folded(nonlinear, sigma)
            by_ends = nonlinear[:, :, -1] - before
        entries = np.concatenate([nonlinear.ravel(), of_limits])
        return entries, np.concatenate([by_ends.ravel(), added])

    def _curvature(self, memory: _Memory, y: Array, z: Array, share: float) -> Array:
        """Hessian blocks by stage variables (x_k, u_k, sigma), clipped, shape (N, m, m).

        Negative eigenvalues are scaled by 1 - share.
        """
        N, m, stages = self.grid.size, self.stages.m, self.stages
        H = np.zeros((N, m, m))
        weights = z[: self.nonlinear].reshape(N, POINTS, -1).sum(axis=1)
        active = np.flatnonzero((weights > DUST * max(1e-3, weights.max(initial=0.0))).any(axis=1))
        blocks = None
        if len(active):
            middle = 2 * N + active
            q, w, alpha = (part[middle] for part in memory.states)
            base_positions = (
                None if memory.base_positions is None else memory.base_positions[middle]
            )
            S = memory.motion.sigma * self.reference**2
            known = None if memory.sample is None else memory.sample.at(middle)
            blocks = self.rows.curvature(
                q, w, alpha, S, weights[active], base_positions, known=known
            )
        if self.drive is None:
            if blocks is not None:  # at most 3n + 1 eigenvalues of the block differ from zero
                Q, R = (
                    part if self.grid.uniform else part[active] for part in stages.middle_factors
                )
                within = clipped(R @ blocks @ R.transpose(0, 2, 1), share)
                H[active] = Q @ within @ Q.transpose(0, 2, 1)
            return H
        if blocks is not None:
            P = stages.at_middle if self.grid.uniform else stages.at_middle[active]
            H[active] = P.transpose(0, 2, 1) @ blocks @ P
        if y.any():
            point = memory.motion
            q, w, controls, _ = self.unpack(point)
            p = point.states[:, stages.places]
            of_gaps = np.zeros((N, 2))
            of_gaps[: self.gaps] = y.reshape(-1, 2)
            H += self.drive.curvature(stages, p, q, w, controls, of_gaps)
            active = np.arange(N)
        if len(active):
            H[active] = clipped(H[active], share)
        return H

    def _fold_hessian(self, blocks: Array, z: Array, memory: _Memory) -> None:
        """Add to mapped blocks the curvature through the boundary rates v sqrt(S), in place."""
        sigma = memory.motion.sigma
        half = 0.5 / np.sqrt(sigma) / STATE
        sides = ((0, self.stages.rates, self.first), (-1, self.stages.last_rates, self.last))
        for k, columns, rates in sides:
            by_sigma = np.zeros(self.stages.m)
            by_sigma[columns] = half * rates
            through = blocks[k] @ by_sigma
            blocks[k, :, -1] += through
            blocks[k, -1, :] += through
            blocks[k, -1, -1] += by_sigma @ through
        # second derivative of sqrt(sigma): only where it is convex
        if isinstance(memory.C, CornerJacobian):
            through_ends = memory.C.through_ends(z[: self.nonlinear])
            through_ends += float(z[self.nonlinear :] @ memory.by_ends)
        else:
            through_ends = float(z @ memory.by_ends)
        second_derivative = max(0.0, -0.5 / sigma * through_ends)
        blocks[:, -1, -1] += second_derivative / self.grid.size

    @cached_property
    def _patterns(self) -> Patterns:
        """Sparsity patterns; that of C has no nonlinear rows where it is a `CornerJacobian`."""
        rows = POINTS * self.rows.count if self.rows.models is None else 0
        return patterns_of(self.stages.shape, self.gaps, rows, self.limits.kinds)


def _parabola(s: float, start: Array, end: Array, middle: Array) -> Array:
    """Value at a share s of the parabola through values at start, end and middle."""
    outer = start * (1.0 - s) * (1.0 - 2.0 * s) + end * s * (2.0 * s - 1.0)
    return np.asarray(outer + middle * 4.0 * s * (1.0 - s))
