r"""Variables of the staged program, and the maps from them to states within the intervals.

Stage k has a state x_k = (q_k, w_k / w_s [, p_k]) of coordinates, scaled rates and, where a base
drives, its position, and accelerations u_k at both ends of its interval, scaled to order one. The
scaled squared duration sigma = S / S_ref is common to all stages. Accelerations are linear within
an interval, so that positions are cubic: u_k follows from x_k and x_{k+1} by Hermite interpolation.
The quadratic programs need neither the accelerations as variables nor the equations of motion as
equalities. Their variables are

.. math:: (x_1, \dots, x_{N-1} [, \text{free coordinates at the goal}], \sigma)

with x scaled by `STATE`. The Hessian is a chain of blocks with an arrow to sigma:

    x_1   x_2   x_3   ...   sigma
    #     #                 #
    #     #     #           #
          #     #     #     #
                #     #     #
    #     #     #     #     #

x_0 and x_N are no variables: they depend on sigma alone, by w_0 = v_0 sqrt(S) and
w_N = v_N sqrt(S), and derivatives by them are added to the column of sigma (chain rule).

Two sets of variables of a stage occur: (x_k, u_k, sigma), called stage variables, in which negative
curvature is clipped because all of them are of order one, and (x_k, x_{k+1} without its base
position, sigma), called mapped stage variables, which are those of the quadratic program.
`Stages.hermite` maps the latter to the former.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.cached import cached_property
from zmp_sqp.planning.program.grid import ENDS, Grid, hermite_shapes, shapes

__all__ = ["CACHED", "STATE", "Shape", "Stages", "stage_columns", "state_columns"]

# scaled state per unit of a quadratic program's variable, chosen so that the proximal terms of
# interior-point methods act on states and sigma with equal weight
STATE = 0.1
CACHED = 64  # index arrays of programs of this many shapes are kept


class Shape(NamedTuple):
    """Numbers that determine where the variables are, see `Stages`."""

    N: int
    n: int
    positions: int
    free: tuple[int, ...]

    @property
    def nx(self) -> int:
        """Number of entries of a state."""
        return 2 * self.n + self.positions

    @property
    def size(self) -> int:
        """Number of variables of the quadratic programs."""
        return (self.N - 1) * self.nx + len(self.free) + 1


@dataclass(frozen=True, eq=False)
class Stages:
    """Indices of the quadratic programs' variables, and linear maps from them to states.

    Attributes:
        grid: Of normalised time.
        n: Number of coordinates.
        positions: Number of a driving base's positions in the state, 2 or 0.
        rate_scale, control_scale: Units of w and of accelerations T^2 a, shape (n,) each.
        S: Squared reference duration [s^2].
        free: Indices of the coordinates that are free at the goal.
    """

    grid: Grid
    n: int
    positions: int
    rate_scale: Array
    control_scale: Array
    S: float
    free: tuple[int, ...] = ()

    @property
    def nx(self) -> int:
        """Number of entries of a state x_k."""
        return 2 * self.n + self.positions

    @property
    def m(self) -> int:
        """Number of stage variables (x_k, u_k, sigma)."""
        return self.nx + ENDS * self.n + 1

    @property
    def rates(self) -> slice:
        """Stage variables that are the rates at the interval's start."""
        return slice(self.n, 2 * self.n)

    @property
    def places(self) -> slice:
        """Stage variables that are the base's position at the interval's start."""
        return slice(2 * self.n, self.nx)

    @property
    def controls(self) -> slice:
        """Stage variables u_k; among mapped ones, coordinates and rates of the next state."""
        return slice(self.nx, self.m - 1)

    @property
    def last_rates(self) -> slice:
        """Mapped stage variables that are the rates at the interval's end."""
        return slice(self.nx + self.n, self.nx + 2 * self.n)

    @property
    def shape(self) -> Shape:
        """Numbers that determine where the variables are."""
        return Shape(self.grid.size, self.n, self.positions, self.free)

    @cached_property
    def size(self) -> int:
        """Number of variables of the quadratic programs."""
        return self.shape.size

    @property
    def columns(self) -> Indices:
        """Index of the variable for each entry of each state, (N + 1, nx); -1 where it is given."""
        return state_columns(self.shape)

    @property
    def stage_columns(self) -> Indices:
        """Index of the variable for each mapped stage variable, (N, m); -1 where it is given."""
        return stage_columns(self.shape)

    @cached_property
    def scale(self) -> Array:
        """Units of the stage variables: unscaled value per scaled one, shape (m,)."""
        ones = np.ones(self.n), np.ones(self.positions)
        controls = np.tile(self.control_scale, ENDS)
        return np.concatenate([ones[0], self.rate_scale, ones[1], controls, [self.S]])

    def state_map(self, s: float) -> Array:
        """Jacobian of (q, w, alpha, S) by the stage variables at a share s of every interval.

        Shape (K, 3n + 1, m); K is 1 for a uniform grid, N otherwise.
        """
        n, nx = self.n, self.nx
        h = (self.grid.steps[:1] if self.grid.uniform else self.grid.steps)[:, None, None]
        level, once, twice = shapes(s)
        one = np.eye(n)
        P = np.zeros((len(h), 3 * n + 1, self.m))
        P[:, :n, :n] = P[:, n : 2 * n, n : 2 * n] = one
        P[:, :n, n : 2 * n] = h * s * one
        P[:, -1, -1] = 1.0
        for i in range(ENDS):
            of_end = slice(nx + i * n, nx + (i + 1) * n)
            P[:, :n, of_end] = h**2 * twice[i] * one
            P[:, n : 2 * n, of_end] = h * once[i] * one
            P[:, 2 * n : 3 * n, of_end] = level[i] * one
        return P * self.scale

    @cached_property
    def at_start(self) -> Array:
        """`state_map` at the starts of the intervals."""
        return self.state_map(0.0)

    @cached_property
    def at_end(self) -> Array:
        """`state_map` at the ends of the intervals."""
        return self.state_map(1.0)

    @cached_property
    def at_middle(self) -> Array:
        """`state_map` in the middle of the intervals."""
        return self.state_map(0.5)

    @cached_property
    def hermite(self) -> Array:
        """Jacobian of the stage variables by the mapped ones, `STATE` included, shape (K, m, m)."""
        accelerations = self._accelerations
        M = np.zeros((len(accelerations), self.m, self.m))
        same = np.arange(self.nx)
        M[:, same, same] = STATE
        M[:, -1, -1] = 1.0
        for i in range(ENDS):
            rows = self.nx + i * self.n + np.arange(self.n)
            M[:, rows[:, None], self._neighbours] = accelerations[:, i]
        return M

    @cached_property
    def mapped(self) -> tuple[Array, Array, Array]:
        """`state_map` at start, end and middle by mapped stage variables, (K, 3n + 1, m) each."""
        rows, found = np.arange(3 * self.n)[:, None], []
        columns = np.tile(self._neighbours, (3, 1))
        for entries in self._interpolated:
            P = np.zeros((len(entries), 3 * self.n + 1, self.m))
            P[:, rows, columns] = entries.reshape(len(entries), 3 * self.n, 4)
            P[:, -1, -1] = self.S
            found.append(P)
        return found[0], found[1], found[2]

    @cached_property
    def _interpolated(self) -> tuple[Array, Array, Array]:
        """Derivatives of (q, w, alpha) at start, end and middle by `_neighbours`.

        Shape (K, 3, n, 4) each. By Hermite interpolation: coordinates are cubic in an interval.
        """
        h = (self.grid.steps[:1] if self.grid.uniform else self.grid.steps)[:, None, None]
        to_rate = np.array([0.0, 1.0, 0.0, 1.0])
        powers = h ** (to_rate - np.arange(3)[:, None])  # (K, 3, 4)
        units = np.where(to_rate > 0.0, self.rate_scale[:, None], 1.0) * STATE  # (n, 4)
        start, end, middle = (
            (powers * hermite_shapes(s))[:, :, None] * units for s in (0.0, 1.0, 0.5)
        )
        return start, end, middle

    @cached_property
    def _accelerations(self) -> Array:
        """Derivatives of the scaled accelerations by `_neighbours`, shape (K, 2, n, 4)."""
        start, end, _ = self._interpolated
        return np.stack([start[:, 2], end[:, 2]], axis=1) / self.control_scale[:, None]

    @cached_property
    def _neighbours(self) -> Indices:
        """Mapped stage variables (q_k, w_k, q_{k+1}, w_{k+1}) of each coordinate, shape (n, 4)."""
        first = np.array([0, self.n, self.nx, self.nx + self.n])
        return np.asarray(np.arange(self.n)[:, None] + first)

    @cached_property
    def heading(self) -> Array:
        """Jacobian of yaw and path rate by the stage variables, shape (K, 6, m).

        Rows: yaw at start, middle and end of the interval, then the rate of the path length there.
        Only for a driving base.
        """
        n, order = self.n, (self.at_start, self.at_middle, self.at_end)
        yaw = [part[:, n - 1] for part in order]
        rate = [part[:, 2 * n - 2] for part in order]
        return np.stack([*yaw, *rate], axis=1)

    @cached_property
    def mapped_heading(self) -> Array:
        """`heading` by mapped stage variables, shape (K, 6, m)."""
        return np.asarray(self.heading @ self.hermite)

    @cached_property
    def control_entries(self) -> Array:
        """Derivatives of the accelerations by (q_k, w_k, q_{k+1}, w_{k+1}), (N, 2, n, 4).

        All scaled; the acceleration of a joint depends on coordinates and rates of that joint only.
        """
        return np.broadcast_to(self._accelerations, (self.grid.size, ENDS, self.n, 4))

    @cached_property
    def middle_factors(self) -> tuple[Array, Array]:
        """QR factors of the transposed `at_middle`: Q (K, m, 3n + 1), and R, upper triangular."""
        Q, R = np.linalg.qr(self.at_middle.transpose(0, 2, 1))
        return Q, R


@lru_cache(maxsize=CACHED)
def state_columns(shape: Shape) -> Indices:
    """`Stages.columns`."""
    index = np.full((shape.N + 1, shape.nx), -1)
    index[1:-1] = np.arange((shape.N - 1) * shape.nx).reshape(shape.N - 1, shape.nx)
    index[-1, list(shape.free)] = np.arange(shape.size - 1 - len(shape.free), shape.size - 1)
    index.flags.writeable = False
    return index


@lru_cache(maxsize=CACHED)
def stage_columns(shape: Shape) -> Indices:
    """`Stages.stage_columns`."""
    columns = state_columns(shape)
    sigma = np.full((shape.N, 1), shape.size - 1)
    index = np.hstack([columns[:-1], columns[1:, : 2 * shape.n], sigma])
    index.flags.writeable = False
    return index
