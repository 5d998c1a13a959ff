"""Limits of coordinates and duration, as inequality rows of the staged program."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.cached import cached_property
from zmp_sqp.planning.program.grid import ENDS
from zmp_sqp.planning.program.stages import CACHED, STATE, Shape, Stages, state_columns

__all__ = [
    "LEAST_SHARE",
    "Boundary",
    "LimitKinds",
    "LimitRows",
    "PathBounds",
    "PositionBound",
    "limit_columns",
]

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


@dataclass(frozen=True, slots=True)
class LimitKinds:
    """Which limits have rows, whatever their values.

    Attributes:
        upper, lower: Coordinates with an upper and a lower limit of their positions.
        moving: Whether rates at start or goal are not zero.
        axes: Axis of each bound on x or y of a driving base.
    """

    upper: tuple[int, ...]
    lower: tuple[int, ...]
    moving: bool
    axes: tuple[int, ...]


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
        axes = tuple(bound.axis for bound in position_bounds)
        sides = tuple(self.upper.tolist()), tuple(self.lower.tolist())
        self.kinds = LimitKinds(*sides, self.moving, axes)

    @property
    def columns(self) -> tuple[Indices, ...]:
        """Variables in each group of rows, shape (rows, width) each; -1 for given states."""
        return limit_columns(self.stages.shape, self.kinds)

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
        n, h = self.stages.n, self.stages.grid.steps[:, None]
        q, w = states[:, :n], states[:, n : 2 * n]
        rate = self.rate * np.sqrt(sigma)
        middle = w[:-1] + MIDDLE * h * self._control_step * controls[:, :n]
        parts: list[Array] = []
        for values, limit in (
            (controls.reshape(-1, ENDS, n), self.control * sigma),
            (w[1:-1], rate),
            (middle, rate),
        ):
            parts += [values - limit, -values - limit]
        step = self.stages.rate_scale * h
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

    def entries(self, sigma: float) -> tuple[Array, Array]:
        """Entries of the Jacobian at a scaled squared duration, in the order of `columns`.

        Returns:
            Entries of all groups; derivatives by sigma due to boundary rates, shape (count,).
        """
        constant, by_root, through_boundary = self._entries
        root = 0.5 / np.sqrt(sigma)  # derivative of sqrt(sigma)
        return constant + root * by_root, root * through_boundary

    @cached_property
    def _entries(self) -> tuple[Array, Array, Array]:
        """Entries that are constant, those per derivative of sqrt(sigma), and `entries`' second."""
        stages, n, N = self.stages, self.stages.n, self.stages.grid.size
        shapes = [group.shape for group in self.columns]
        constant, by_root = np.zeros((2, sum(rows * width for rows, width in shapes)))
        at = np.cumsum([0, *(rows * width for rows, width in shapes)])
        # upper and lower limits together, hence the leading axis of length 2
        controls = constant[: at[2]].reshape(2, N, ENDS, n, 5)
        middles = constant[at[4] : at[6]].reshape(2, N, n, 5)
        u = stages.control_entries
        of_middles = MIDDLE * stages.grid.steps[:, None, None] * self._control_step[:, None]
        of_middles = of_middles * u[:, 0]
        of_middles[..., 1] += STATE
        for side, sign in enumerate((1.0, -1.0)):
            controls[side, ..., :-1], middles[side, ..., :-1] = sign * u, sign * of_middles
            constant[at[2 + side] : at[3 + side] : 2] = sign * STATE  # rates at nodes
        controls[..., -1] = -self.control
        by_root[at[2] : at[4]].reshape(-1, n, 2)[..., -1] = -self.rate
        by_root[at[4] : at[6]].reshape(-1, n, 5)[..., -1] = -self.rate
        group = 6
        for point in POSITION_POINTS:
            for which, sign in ((self.upper, 1.0), (self.lower, -1.0)):
                by_rate = sign * point * stages.grid.steps[:, None] * stages.rate_scale[which]
                width = shapes[group][1]
                positions = constant[at[group] : at[group + 1]].reshape(N, len(which), width)
                positions[..., 0], positions[..., 1] = sign * STATE, by_rate * STATE
                group += 1
        for bound in self.position_bounds:
            constant[at[group] : at[group + 1]] = bound.sign * STATE
            group += 1
        constant[-1] = -1.0
        through = self._through_boundary(controls, middles)
        if self.moving:
            starts = np.cumsum([0, *(rows for rows, _ in shapes)])
            for k, (rows, width) in enumerate(shapes):
                if width > 1:
                    entries = by_root[at[k] : at[k + 1]].reshape(rows, width)
                    entries[:, -1] += through[starts[k] : starts[k + 1]]
        return constant, by_root, through

    def _through_boundary(self, controls: Array, middles: Array) -> Array:
        """Derivatives of the rows by sqrt(sigma) through the boundary rates, shape (count,).

        Args:
            controls: Constant entries of the acceleration limits, shape (2, N, 2, n, 5).
            middles: Constant entries of the rate limits between nodes, shape (2, N, n, 5).
        """
        found = np.zeros(self.count)
        if not self.moving:
            return found
        N, n = self.stages.grid.size, self.stages.n
        at = np.cumsum([0, *(len(group) for group in self.columns)])
        of_controls = found[: at[2]].reshape(2, N, ENDS, n)
        of_middles = found[at[4] : at[6]].reshape(2, N, n)
        for flat, rows in ((of_controls, controls), (of_middles, middles)):
            # boundary rates are no variables: without STATE
            flat[:, 0] += rows[:, 0, ..., 1] * self.first / STATE
            flat[:, -1] += rows[:, -1, ..., 3] * self.last / STATE
        group = 6
        for point in POSITION_POINTS:
            k, given = (0, self.first) if point > 0.0 else (-1, self.last)
            for which, sign in ((self.upper, 1.0), (self.lower, -1.0)):
                by_rate = sign * point * self.stages.grid.steps[k] * self.stages.rate_scale[which]
                of_positions = found[at[group] : at[group + 1]].reshape(N, len(which))
                of_positions[k] += by_rate * given[which]
                group += 1
        return found


@lru_cache(maxsize=CACHED)
def limit_columns(shape: Shape, kinds: LimitKinds) -> tuple[Indices, ...]:
    """`LimitRows.columns`."""
    x, sigma, N, n = state_columns(shape), shape.size - 1, shape.N, shape.n
    both = [x[:N, :n], x[:N, n : 2 * n], x[1:, :n], x[1:, n : 2 * n], np.full((N, n), sigma)]
    hermite = np.stack(both, axis=-1)  # (N, n, 5)
    controls = np.repeat(hermite[:, None], ENDS, axis=1).reshape(-1, 5)
    node = x[1:N, n : 2 * n].ravel()
    nodes = np.column_stack([node, np.full(len(node), sigma)])
    groups = [controls, controls, nodes, nodes, hermite.reshape(-1, 5), hermite.reshape(-1, 5)]
    for point in POSITION_POINTS:
        at = x[:N] if point > 0.0 else x[1:]
        for side in (kinds.upper, kinds.lower):
            which = np.array(side, dtype=int)
            by_sigma = np.full(N * len(which), sigma if kinds.moving else -1)
            parts = [at[:, which].ravel(), at[:, n + which].ravel(), by_sigma]
            groups.append(np.column_stack(parts))
    groups += [x[1:N, 2 * n + axis][:, None] for axis in kinds.axes]
    groups.append(np.array([[sigma]]))
    return tuple(groups)
