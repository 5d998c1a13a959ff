"""Limits of coordinates and duration, as inequality rows of the staged program."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.planning.program.grid import ENDS
from zmp_sqp.planning.program.stages import STATE, Stages

__all__ = ["LEAST_SHARE", "Boundary", "LimitRows", "PathBounds", "PositionBound"]

# inner Bernstein points of an interval's positions, which are cubic: q + p h w, with q and w at the
# interval's start for p > 0 and at its end for p < 0
POSITION_POINTS = (1.0 / 3.0, -1.0 / 3.0)
# inner Bernstein point of an interval's rates, which are quadratic: w + h u / 2, with w and u at
# the interval's start
MIDDLE = 0.5
LEAST_SHARE = 0.25  # smallest ratio of sigma after a step to sigma before: keeps S positive
FAR = 9e3  # [rad or m] position limits of this size or more get no rows


@dataclass(frozen=True, slots=True, eq=False)
class Boundary:
    """Coordinates q and rates v at the start or the goal, shape (n,) each.

    Positions in rad or m, rates in rad/s or m/s.

    Attributes:
        q: Coordinates; for free ones of the goal, any value.
        v: Rates.
        free: Whether the coordinates are free, which only those of the goal may be.
    """

    q: Array
    v: Array
    free: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class PathBounds:
    """Limits of the coordinates and of the duration.

    Attributes:
        position_lower, position_upper: Limits of the coordinates, shape (n,) each [rad or m].
        velocity, acceleration: Largest absolute values, shape (n,) each.
        least_duration: Proven lower bound of the duration [s].
    """

    position_lower: Array
    position_upper: Array
    velocity: Array
    acceleration: Array
    least_duration: float


@dataclass(frozen=True, slots=True)
class PositionBound:
    """Bound on x or y of a driving base at the nodes: sign * position[axis] <= bound.

    Attributes:
        axis: 0 for x, 1 for y.
        sign: 1 for an upper bound, -1 for a lower one.
        bound: Largest signed position [m].
    """

    axis: int
    sign: float
    bound: float


class LimitRows:
    """Inequality rows of the limits of coordinates and duration; not positive where they hold.

    Order: accelerations, rates at nodes and between them, positions, base positions, sigma; upper
    limits before lower ones. Accelerations are limited at both ends of every interval, rates and
    positions at their Bernstein points, so that the limits hold at all times. The last row keeps
    sigma above its proven lower bound, and above a quarter of its value at the iterate.
    """

    def __init__(
        self,
        stages: Stages,
        bounds: PathBounds,
        reference: float,
        ends: tuple[Array, Array],
        position_bounds: tuple[PositionBound, ...],
    ) -> None:
        """Scale the limits to the units of the stage variables.

        Args:
            stages: Variables and maps.
            bounds: Limits of coordinates and duration.
            reference: Duration that scales time [s].
            ends: Scaled rates at start and goal per square root of sigma, shape (n,) each.
            position_bounds: Bounds on x and y of a driving base.
        """
        self.stages, self.bounds, self.position_bounds = stages, bounds, position_bounds
        self.first, self.last = ends
        self.moving = bool(self.first.any() or self.last.any())
        self.rate = bounds.velocity * reference / stages.rate_scale
        self.control = bounds.acceleration * reference**2 / stages.control_scale
        self.upper = np.flatnonzero(np.abs(bounds.position_upper) < FAR)
        self.lower = np.flatnonzero(np.abs(bounds.position_lower) < FAR)
        self.least = (bounds.least_duration / reference) ** 2

    @cached_property
    def columns(self) -> list[Indices]:
        """Variables in each group of rows, shape (rows, width) each; -1 for given states."""
        stages, N, n = self.stages, self.stages.grid.size, self.stages.n
        x, sigma = stages.columns, stages.size - 1
        both = [x[:N, :n], x[:N, n : 2 * n], x[1:, :n], x[1:, n : 2 * n], np.full((N, n), sigma)]
        hermite = np.stack(both, axis=-1)  # (N, n, 5)
        controls = np.repeat(hermite[:, None], ENDS, axis=1).reshape(-1, 5)
        node = x[1:N, n : 2 * n].ravel()
        nodes = np.column_stack([node, np.full(len(node), sigma)])
        groups = [controls, controls, nodes, nodes, hermite.reshape(-1, 5), hermite.reshape(-1, 5)]
        for point in POSITION_POINTS:
            at = x[:N] if point > 0.0 else x[1:]
            for which in (self.upper, self.lower):
                by_sigma = np.full(N * len(which), sigma if self.moving else -1)
                parts = [at[:, which].ravel(), at[:, n + which].ravel(), by_sigma]
                groups.append(np.column_stack(parts))
        for bound in self.position_bounds:
            groups.append(x[1:N, 2 * n + bound.axis][:, None])
        groups.append(np.array([[sigma]]))
        return groups

    @cached_property
    def rate_rows(self) -> slice:
        """Rows of the rate limits, which follow those of the accelerations."""
        sizes = [len(group) for group in self.columns]
        return slice(sum(sizes[:2]), sum(sizes[:6]))

    @cached_property
    def count(self) -> int:
        """Number of rows."""
        return sum(len(group) for group in self.columns)

    def values(self, states: Array, controls: Array, sigma: float) -> Array:
        """Values of all rows, shape (count,).

        Args:
            states: Scaled states at the nodes, shape (N + 1, nx).
            controls: Scaled accelerations, shape (N, 2 n).
            sigma: Scaled squared duration.
        """
        stages, n = self.stages, self.stages.n
        q, w = states[:, :n], states[:, n : 2 * n]
        control = np.tile(self.control, ENDS) * sigma
        rate = self.rate * np.sqrt(sigma)
        h = stages.grid.steps[:, None]
        middle = w[:-1] + MIDDLE * h * self._control_step * controls[:, :n]
        parts = [controls - control, -controls - control, w[1:-1] - rate, -w[1:-1] - rate]
        parts += [middle - rate, -middle - rate]
        step = stages.rate_scale * h
        for point in POSITION_POINTS:
            at, rates = (q[:-1], w[:-1]) if point > 0.0 else (q[1:], w[1:])
            position = at + point * step * rates
            parts.append((position - self.bounds.position_upper)[:, self.upper])
            parts.append((self.bounds.position_lower - position)[:, self.lower])
        for bound in self.position_bounds:
            parts.append(bound.sign * states[1:-1, 2 * n + bound.axis] - bound.bound)
        parts.append(np.array([max(self.least, LEAST_SHARE * sigma) - sigma]))
        return np.concatenate([part.ravel() for part in parts])

    @property
    def _control_step(self) -> Array:
        """Scaled rate per scaled acceleration and unit of normalised time, shape (n,)."""
        return self.stages.control_scale / self.stages.rate_scale

    def entries(self, sigma: float) -> tuple[list[Array], Array]:
        """Entries of the Jacobian, group by group, at a scaled squared duration.

        Returns:
            Arrays of the shapes of `columns`; derivatives by sigma due to boundary rates, (count,).
        """
        stages, n, N = self.stages, self.stages.n, self.stages.grid.size
        sqrt_derivative = 0.5 / np.sqrt(sigma)
        first, last = sqrt_derivative * self.first, sqrt_derivative * self.last
        by_sigma = sqrt_derivative * self.rate
        u, groups, added = stages.control_entries, [], []

        def add(
            entries: Array, at_first: Array | None = None, at_last: Array | None = None
        ) -> None:
            """Add a group (N, R, width), with the effect of boundary rates on its end intervals."""
            through_boundary = np.zeros(entries.shape[:2])
            if at_first is not None:
                through_boundary[0] += at_first
            if at_last is not None:
                through_boundary[-1] += at_last
            if self.moving and entries.shape[2] > 1:
                entries[..., -1] += through_boundary
            groups.append(entries)
            added.append(through_boundary.ravel())

        for sign in (1.0, -1.0):
            of_controls = np.empty((N, ENDS, n, 5))
            of_controls[..., :4], of_controls[..., 4] = sign * u, -self.control
            start, end = of_controls[0, ..., 1] * first, of_controls[-1, ..., 3] * last
            unscaled = 1.0 / STATE  # boundary rates are no variables, so STATE does not apply
            add(
                of_controls.reshape(N, ENDS * n, 5),
                unscaled * start.ravel(),
                unscaled * end.ravel(),
            )
        for sign in (1.0, -1.0):
            of_nodes = np.empty((N - 1, n, 2))
            of_nodes[..., 0], of_nodes[..., 1] = sign * STATE, -by_sigma
            add(of_nodes)
        step = (MIDDLE * stages.grid.steps[:, None] * self._control_step)[..., None]
        for sign in (1.0, -1.0):
            of_middle = np.empty((N, n, 5))
            of_middle[..., :4] = sign * step * u[:, 0]
            of_middle[..., 1] += sign * STATE
            of_middle[..., 4] = -by_sigma
            start, end = of_middle[0, :, 1] * first, of_middle[-1, :, 3] * last
            add(of_middle, start / STATE, end / STATE)
        for point in POSITION_POINTS:
            for which, sign in ((self.upper, 1.0), (self.lower, -1.0)):
                step = point * stages.grid.steps[:, None] * stages.rate_scale[which]
                of_positions = np.zeros((N, len(which), 3))
                of_positions[..., 0], of_positions[..., 1] = sign * STATE, sign * step * STATE
                start = sign * step[0] * first[which] if point > 0.0 else None
                end = sign * step[-1] * last[which] if point < 0.0 else None
                add(of_positions, start, end)
        for bound in self.position_bounds:
            add(np.full((N - 1, 1, 1), bound.sign * STATE))
        add(np.full((1, 1, 1), -1.0))
        return groups, np.concatenate(added)
