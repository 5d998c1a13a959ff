"""Positions of a driving base as states of the staged program."""

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

BOUND_GUARD = 1e-7  # [m] kept inside x and y bounds at the nodes
RIM_GUARD = 0.02  # [m] kept inside the map at the nodes, so that it is not left between them
PASSES = 20  # of Newton's method over all nodes at once; a plane takes one
SETTLED = 1e-14  # relative, of positions
ARRIVED = 1e-12  # [m] from the goal: Newton's steps lead no nearer
ARRIVALS = 8  # steps at most; a plane takes one
# [m per m] smallest reach sideways worth correcting: below it the correction would change the
# accelerations more than it gains
SIDEWAYS = 1e-3
SIMPSON = np.array([[1.0], [4.0], [1.0]]) / 6.0  # at start, middle and end of an interval


@dataclass(frozen=True, eq=False)
class Positions:
    r"""Positions p = (x, y) of a unicycle whose path length and yaw are the last two coordinates.

    .. math:: p_{k+1} = p_k + \Delta(p_k, \psi, w_\lambda), \quad p_0 = start, \; p_N = goal

    with one Runge-Kutta step of p' = w_lambda G(p, psi) per interval. The path length is free at
    the goal; the position is not.

    Attributes:
        base: Start and goal.
        terrain: What the base drives on.
    """

    base: UnicycleBase
    terrain: Terrain

    @property
    def goal(self) -> Array:
        """Where the base shall end, shape (2,) [m]."""
        return np.asarray(self.base.goal[:2])

    def heading(self, grid: Grid, q: Array, w: Array, controls: Array) -> tuple[Array, Array]:
        """Yaw and rate of the path length at starts, middles and ends, shape (3, N) each."""
        middle_q, middle_w, _ = grid.within(0.5, q[:-1], w[:-1], controls)
        yaw = np.stack([q[:-1, -1], middle_q[:, -1], q[1:, -1]])
        return yaw, np.stack([w[:-1, -2], middle_w[:, -2], w[1:, -2]])

    def path(self, grid: Grid, q: Array, w: Array, controls: Array) -> tuple[Array, Displacements]:
        """Positions of the nodes, shape (N + 1, 2), and the displacements between them.

        Over terrain by Newton's method on all gaps at once.
        """
        yaw, rate = self.heading(grid, q, w, controls)
        p = np.repeat(self.base.start[None, :2], grid.size + 1, axis=0)
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

    def positions(self, grid: Grid, q: Array, w: Array, controls: Array) -> Array:
        """Positions of the nodes, shape (N + 1, 2)."""
        return self.path(grid, q, w, controls)[0]

    def displacements(
        self, grid: Grid, p: Array, q: Array, w: Array, controls: Array
    ) -> Displacements:
        """Displacements within the intervals, from positions p at the nodes."""
        return runge_kutta(self.terrain, p[:-1], *self.heading(grid, q, w, controls), grid.steps)

    def end_derivatives(self, stages: Stages, moves: Displacements) -> Array:
        """Position at each interval's end by its mapped stage's variables, shape (N, 2, m)."""
        return self._derivatives(stages, moves.whole_jacobian)

    def add_place_derivatives(
        self, stages: Stages, moves: Displacements, by_place: Array, parts: tuple[Array, ...]
    ) -> None:
        """Add to rows' derivatives by mapped stages what they owe to the positions, in place.

        Args:
            stages: Variables and maps.
            moves: Displacements.
            by_place: Derivatives of the rows at starts, ends and middles, shape (3N, E, 2).
            parts: Derivatives by mapped stages at start, end and middle, (N, E, m) each.
        """
        N = len(moves.whole)
        start, end, middle = (by_place[i * N : (i + 1) * N] for i in range(3))
        parts[0][:, :, stages.places] += STATE * start
        parts[1][:] += end @ self.end_derivatives(stages, moves)
        parts[2][:] += middle @ self._derivatives(stages, moves.half_jacobian)

    def with_positions(
        self, stages: Stages, moves: Displacements, maps: tuple[Array, Array, Array]
    ) -> tuple[Array, Array, Array]:
        """Maps to states at start, end and middle with those to positions, (N, 3n + 3, m) each."""
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
        r"""Second derivatives of weights . displacements by scaled stage variables, (N, m, m).

        With G the velocity per path length, which turns with the yaw like a vector, they are
        Simpson's rule on

        .. math:: \partial^2 (w\, \mu \cdot G) = \begin{pmatrix} -w\, \mu \cdot G &
                  \mu \cdot G_\psi \\ \mu \cdot G_\psi & 0 \end{pmatrix} \quad
                  \text{by } (\psi, w)

        What the ground's own curvature adds is left out: on ground with radii above 44 m that costs
        no iterations.
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

    def arrived(self, grid: Grid, start: Array, w: Array, controls: Array, aim: Array) -> Array:
        """Controls whose path ends at a position, by the least change of the path's accelerations.

        In a plane the position is linear in them. Sideways of a constant heading what is missed
        stays.

        Args:
            grid: Of normalised time.
            start, w: Coordinates and rates at the first node, shape (n,) each.
            controls: Shape (N, 2, n).
            aim: Where the path shall end, shape (2,) [m].
        """
        found, before = controls.copy(), np.inf
        by_controls = grid.rates_by_controls
        for _ in range(ARRIVALS):
            q, rates = grid.rolled(start, w, found)
            p, moves = self.path(grid, q, rates, found)
            miss = aim - p[-1]
            far = float(np.abs(miss).max())
            if far <= ARRIVED or far > 0.5 * before:  # what is left lies sideways
                break
            before = far
            pushed = np.einsum("kas,skc->kac", moves.whole_jacobian[:, :, 5:], by_controls)
            reach = propagated(moves, pushed)[-1]
            wanted = np.append(miss, 0.0)  # the rate at the goal stays
            system = np.vstack([reach, grid.sums[1]])
            change = np.linalg.lstsq(system, wanted, rcond=SIDEWAYS)[0]
            found[:, :, -2] += change.reshape(grid.size, -1)
        return found


def propagated(moves: Displacements, added: Array) -> Array:
    """What changes (N, 2, ...) of the displacements make of the nodes, shape (N + 1, 2, ...)."""
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
    """Bounds on a base's position at the nodes: its own, and the rim of the map.

    Args:
        base: Start and goal, between which the bounds hold in any case, and bounds on x and y.
        terrain: Its extent bounds the positions, too.
        reach: Of the tracks from the base's position: it stays so far inside a map [m].
        drawn_in: By how much nodes stay inside x and y bounds, so that these hold between them [m].
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
