"""Positions of a driving base: states of the staged program, with gaps to close and bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.ground import Terrain
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase
from zmp_sqp.planning.program.driving.displacements import HEADING, Displacements, runge_kutta
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.limits import PositionBound
from zmp_sqp.planning.program.stages import STATE, Stages

__all__ = ["Positions", "position_bounds"]

BOUND_GUARD = 1e-7  # [m] by which x and y bounds are tightened, against rounding
RIM_GUARD = 0.02  # [m] kept from the rim of the map at the nodes, so that it holds between them too
PASSES = 20  # largest number of Newton steps that close the gaps; a plane takes one
SETTLED = 1e-14  # relative change of the positions at which Newton's method ends: rounding
ARRIVED = 1e-12  # [m] distance from the target at which the correction of the path ends: rounding
ARRIVALS = 8  # largest number of Gauss-Newton steps towards the target; a plane takes one
# [m per m] smallest reach sideways worth correcting: below it the correction would change the
# accelerations more than it gains
SIDEWAYS = 1e-3
# weights of Simpson's rule at start, middle and end of an interval
SIMPSON = np.array([[1.0], [4.0], [1.0]]) / 6.0


@dataclass(frozen=True, eq=False)
class Positions:
    r"""Position p = (x, y) of a unicycle base: one Runge-Kutta step per interval.

    .. math:: p_{k+1} = p_k + \Delta(p_k, \psi, w_\lambda), \quad p_0 = start, \; p_N = goal

    where \Delta is one Runge-Kutta step of p' = w_lambda G(p, psi). Path length lambda and yaw psi
    are the last two coordinates. At the goal the position is given, the path length is not.

    Attributes:
        base: Start, goal and bounds of the base.
        terrain: Ground that the base drives on.
    """

    base: UnicycleBase
    terrain: Terrain

    @property
    def goal(self) -> Array:
        """Position of the base at the goal, shape (2,) [m]."""
        return np.asarray(self.base.goal[:2])

    def heading(self, grid: Grid, q: Array, w: Array, controls: Array) -> tuple[Array, Array]:
        """Yaw and rate of the path length at starts, middles and ends, shape (3, N) each."""
        middle_q, middle_w, _ = grid.within(0.5, q[:-1], w[:-1], controls)
        yaw = np.stack([q[:-1, -1], middle_q[:, -1], q[1:, -1]])
        return yaw, np.stack([w[:-1, -2], middle_w[:, -2], w[1:, -2]])

    def path(
        self, grid: Grid, q: Array, w: Array, controls: Array, near: Array | None = None
    ) -> tuple[Array, Displacements]:
        """Base positions at the nodes, shape (N + 1, 2), and the displacements between them.

        All gaps are closed at once by Newton's method; on a plane one step is exact.

        Args:
            grid: Of normalised time.
            q, w: Coordinates and rates at the nodes, shape (N + 1, n) each.
            controls: Accelerations at the intervals' ends, shape (N, 2, n).
            near: Positions at the nodes of a path nearby, from which Newton's method starts, shape
                (N + 1, 2) [m]; None starts at the start of the base.
        """
        yaw, rate = self.heading(grid, q, w, controls)
        p = np.repeat(self.base.start[None, :2], grid.size + 1, axis=0)
        if near is not None and not self.terrain.uniform:
            p[1:] = near[1:]
        moves = runge_kutta(self.terrain, p[:-1], yaw, rate, grid.steps)
        for _ in range(PASSES):
            change = propagated(moves, moves.whole - np.diff(p, axis=0))
            p = p + change
            if self.terrain.uniform:
                break
            moves = runge_kutta(self.terrain, p[:-1], yaw, rate, grid.steps)
            if np.abs(change).max() <= SETTLED * (1.0 + np.abs(p).max()):
                break
        return np.asarray(p), moves

    def displacements(
        self, grid: Grid, p: Array, q: Array, w: Array, controls: Array
    ) -> Displacements:
        """Displacements over the intervals from given base positions p at the nodes (N + 1, 2)."""
        return runge_kutta(self.terrain, p[:-1], *self.heading(grid, q, w, controls), grid.steps)

    def end_derivatives(self, stages: Stages, moves: Displacements) -> Array:
        """Jacobian of the position at each interval's end by mapped stage variables, (N, 2, m)."""
        return self._derivatives(stages, moves.whole_jacobian)

    def add_position_derivatives(
        self, stages: Stages, moves: Displacements, by_position: Array, parts: tuple[Array, ...]
    ) -> None:
        """Add to derivatives of rows the part that acts through the base positions, in place.

        Args:
            stages: Variables and maps.
            moves: Displacements over the intervals.
            by_position: Derivatives of the rows by the base position at starts, ends and middles,
                shape (3N, E, 2).
            parts: Derivatives by mapped stage variables of the rows at start, end and middle, to
                which the part is added, shape (N, E, m) each.
        """
        N = len(moves.whole)
        start, end, middle = (by_position[i * N : (i + 1) * N] for i in range(3))
        parts[0][:, :, stages.places] += STATE * start
        parts[1][:] += end @ self.end_derivatives(stages, moves)
        parts[2][:] += middle @ self._derivatives(stages, moves.half_jacobian)

    def with_positions(
        self, stages: Stages, moves: Displacements, maps: tuple[Array, Array, Array]
    ) -> tuple[Array, Array, Array]:
        """Maps from mapped stage variables to states, extended by rows for the base position.

        Args:
            stages: Variables and maps.
            moves: Displacements over the intervals.
            maps: Maps to (q, w, alpha, S) at start, end and middle, (N or 1, 3n + 1, m) each.

        Returns:
            Maps to (q, w, alpha, S, positions) at start, end and middle, (N, 3n + 3, m) each.
        """
        N = len(moves.whole)
        at_start = np.zeros((N, 2, stages.m))
        at_start[:, :, stages.places] = STATE * np.eye(2)
        end, middle = (
            self._derivatives(stages, part) for part in (moves.whole_jacobian, moves.half_jacobian)
        )
        by_state = (np.broadcast_to(part, (N, *part.shape[1:])) for part in maps)
        start, end, middle = (
            np.concatenate(pair, axis=1)
            for pair in zip(by_state, (at_start, end, middle), strict=True)
        )
        return start, end, middle

    def _derivatives(self, stages: Stages, jacobian: Array) -> Array:
        found = jacobian[:, :, 2:] @ stages.mapped_heading
        found[:, :, stages.places] += STATE * (jacobian[:, :, :2] + np.eye(2))
        return np.asarray(found)

    def curvature(
        self, stages: Stages, p: Array, q: Array, w: Array, controls: Array, weights: Array
    ) -> Array:
        r"""Hessian of weights . displacements by the stage variables (x_k, u_k, sigma), (N, m, m).

        G, the velocity per rate of the path length, turns with the yaw like a vector. With weights
        mu the Hessian is Simpson's rule applied to

        .. math:: \partial^2 (w\, \mu \cdot G) = \begin{pmatrix} -w\, \mu \cdot G &
                  \mu \cdot G_\psi \\ \mu \cdot G_\psi & 0 \end{pmatrix} \quad
                  \text{by } (\psi, w)

        Terms due to the curvature of the ground are left out: on ground with radii of curvature
        above 44 m the SQP takes no more iterations without them.
        """
        grid, N = stages.grid, stages.grid.size
        yaw, rate = self.heading(grid, q, w, controls)
        low, high = self.terrain.extent
        middle = 0.5 * (p[:-1] + p[1:])
        positions = np.clip(np.vstack([p[:-1], middle, p[1:]]), low, high)
        unit = np.column_stack([np.ones(3 * N), np.zeros(3 * N)])
        found = self.terrain.ground_rates(np.column_stack([positions, yaw.ravel()]), unit)
        along, across = (
            np.einsum("skc,kc->sk", part.reshape(3, N, 2), weights) * SIMPSON * grid.steps
            for part in (found.rates, found.jacobian[:, :, 2])
        )
        of_heading = np.zeros((N, HEADING, HEADING))
        point = np.arange(3)
        of_heading[:, point, point] = (-rate * along).T
        of_heading[:, point, point + 3] = of_heading[:, point + 3, point] = across.T
        to_heading = stages.heading
        return np.asarray(to_heading.transpose(0, 2, 1) @ of_heading @ to_heading)

    def arrived(
        self,
        grid: Grid,
        start: Array,
        w: Array,
        controls: Array,
        aim: Array,
        near: Array | None = None,
    ) -> Array:
        """Controls whose Runge-Kutta path ends at a given position, shape (N, 2, n).

        The path accelerations are changed by the smallest amount (Gauss-Newton, least norm); on a
        plane the position is linear in them. A miss sideways of a constant heading stays.

        Args:
            grid: Of normalised time.
            start, w: Coordinates and rates at the first node, shape (n,) each.
            controls: Accelerations at the intervals' ends, shape (N, 2, n).
            aim: Position at which the path shall end, shape (2,) [m].
            near: Positions at the nodes of a path nearby, see `path`.
        """
        found, previous = controls.copy(), np.inf
        by_controls = grid.rates_by_controls
        for _ in range(ARRIVALS):
            q, rates = grid.rolled(start, w, found)
            p, moves = self.path(grid, q, rates, found, near)
            near = p
            miss = aim - p[-1]
            distance = float(np.abs(miss).max())
            if distance <= ARRIVED or distance > 0.5 * previous:  # what is left is sideways
                break
            previous = distance
            by_acceleration = np.einsum("kas,skc->kac", moves.whole_jacobian[:, :, 5:], by_controls)
            reach = propagated(moves, by_acceleration)[-1]
            wanted = np.append(miss, 0.0)  # no change of the rate at the goal
            system = np.vstack([reach, grid.sums[1]])
            change = np.linalg.lstsq(system, wanted, rcond=SIDEWAYS)[0]
            found[:, :, -2] += change.reshape(grid.size, -1)
        return found


def propagated(moves: Displacements, added: Array) -> Array:
    """Change of the nodes' positions by changes of the displacements, to first order.

    Args:
        moves: Displacements over the intervals, with their Jacobians.
        added: Change of each displacement, shape (N, 2, ...).

    Returns:
        Shape (N + 1, 2, ...); zero at the first node.
    """
    by_position = moves.whole_jacobian[:, :, :2]
    first = np.zeros_like(added[:1])
    if not by_position.any():  # a plane
        return np.concatenate([first, np.cumsum(added, axis=0)])
    changes = [first[0]]
    for jacobian, part in zip(by_position, added, strict=True):
        changes.append(changes[-1] + jacobian @ changes[-1] + part)
    return np.stack(changes)


def position_bounds(
    base: UnicycleBase, terrain: Terrain, *, reach: float, drawn_in: float
) -> tuple[PositionBound, ...]:
    """Bounds on a base's position at the nodes: its x and y bounds, and the rim of the map.

    Args:
        base: Bounds on x and y; start and goal, which are inside the resulting bounds in any case.
        terrain: Ground whose extent bounds the positions, too.
        base: Bounds on x and y; start and goal, which are always inside the resulting bounds.
            inside the map [m].
        drawn_in: Amount by which x and y bounds are tightened at the nodes, so that they hold
            between them [m].
    """
    lower, upper = base.position_bounds
    low, high = terrain.extent
    guard = BOUND_GUARD + drawn_in
    lower = np.maximum(lower + guard, low + reach + RIM_GUARD)
    upper = np.minimum(upper - guard, high - reach - RIM_GUARD)
    both = np.vstack([base.start[:2], base.goal[:2]])
    lower, upper = np.minimum(lower, both.min(axis=0)), np.maximum(upper, both.max(axis=0))
    sides = ((axis, sign) for axis in range(2) for sign in (1.0, -1.0))
    found = (
        PositionBound(axis, sign, sign * float((upper if sign > 0.0 else lower)[axis]))
        for axis, sign in sides
    )
    return tuple(bound for bound in found if np.isfinite(bound.bound))
