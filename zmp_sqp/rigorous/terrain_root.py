r"""Root of a base that drives over a heightmap, as power series of time.

The rotation is :math:`R = E R_z(yaw)`, where E has the surface's normal as its z axis, and its x
axis is vertically above the map's (`SurfaceFrame` has the formula). The path follows from

.. math:: (\dot x, \dot y) = s\, E_{1..2, 1..2}(x, y) (\cos yaw, \sin yaw)

Its Taylor coefficients are found by Picard iteration, one per pass. As E is a rotation, a position
is never farther from the last one than the length of the path between them, which gives the boxes
over which remainders are computed. Where such a box touches several cells of the spline, whose
fourth derivative is continuous, only as many coefficients count as are continuous there, and the
next one is the union over these cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

from zmp_sqp.mechanics.terrain.heightmap import Heightmap
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.rigorous.balls import ORDER, above
from zmp_sqp.rigorous.motion_series import MotionSeries, Stretch
from zmp_sqp.rigorous.root_series import PathOfStretch, Root, RootOfStretch
from zmp_sqp.rigorous.series_algebra import Vector, cross, derivative, product, scaled, vector_sum
from zmp_sqp.rigorous.spline_cells import Cell, SplineCells

__all__ = ["TerrainRoot"]

PATH_ORDER = 10  # number of Taylor coefficients of a step along the path inside a cell
CROSSING_ORDER = 4  # and of one that touches several: the path's fourth derivative is continuous
# number of coefficients of the wrench that count on a stretch that touches several cells: its first
# derivative is continuous
KINKED_ORDER = 2
FINEST = 1e-3  # [s] steps are halved where they touch several cells, down to this duration
MOST_CELLS = 4  # a stretch that touches more has no bound, and is halved

Position = tuple[Any, Any]


class TerrainRoot:
    """Root of a base along its path over a heightmap."""

    def __init__(
        self, flint: Any, motion: MotionSeries, base: UnicycleMotion, ground: Heightmap, height: Any
    ) -> None:
        """Root of a base.

        Args:
            flint: Module.
            motion: Polynomials of speed and yaw.
            base: Gives the positions at the nodes.
            ground: The heightmap.
            height: z of the support plane in the root frame, ball [m].
        """
        self._flint, self._motion, self._height = flint, motion, height
        self._surface = SplineCells(flint, ground)
        self._positions: dict[tuple[int, float], Position] = {
            (k, 0.0): (flint.arb(float(x)), flint.arb(float(y)))
            for k, (x, y) in enumerate(base.poses[:-1, :2].tolist())
        }

    def position(self, k: int, share: float) -> Position:
        """Ball of (x, y) at a share of the duration of interval k [m]."""
        key = k, share
        if key not in self._positions:
            start = max(at for number, at in self._positions if number == k and at < share)
            self._positions[key] = self._stepped(k, start, share)
        return self._positions[key]

    def on(self, stretch: Stretch, middle: Any, ball: Any, radius: Any) -> RootOfStretch:
        """Series on a stretch; no roots at all where it touches too many cells."""
        k = stretch.interval
        at = self.position(k, 0.5 * (stretch.start + stretch.end))
        box = self._box(k, at, ball, radius)
        near, touched = self._surface.over(*at), self._surface.over(*box)
        if not 0 < len(touched) <= MOST_CELLS:
            return RootOfStretch((), (), KINKED_ORDER)
        order = ORDER if len(touched) == 1 else KINKED_ORDER
        return RootOfStretch(
            tuple(self._root(k, middle, at, cell, order + 2) for cell in near),
            tuple(self._root(k, ball, box, cell, order + 3) for cell in touched),
            order,
        )

    def path_on(
        self, stretch: Stretch, middle: Any, ball: Any, radius: Any
    ) -> PathOfStretch | None:
        """Path on a stretch; None where it touches too many cells."""
        k = stretch.interval
        at = self.position(k, 0.5 * (stretch.start + stretch.end))
        box = self._box(k, at, ball, radius)
        touched = self._surface.over(*box)
        if not 0 < len(touched) <= MOST_CELLS:
            return None
        order = ORDER if len(touched) == 1 else CROSSING_ORDER
        thin, thick = self._both(k, (middle, at), (ball, box), order)
        x, y = ([_union([one[axis][m] for one in thin]) for m in range(order)] for axis in (0, 1))
        rest_x, rest_y = (_union([one[axis][order] for one in thick]) for axis in (0, 1))
        return PathOfStretch((x, y), (rest_x, rest_y))

    def _both(
        self, k: int, start: tuple[Any, Position], every: tuple[Any, Position], order: int
    ) -> tuple[list[Position], list[Position]]:
        """Series of a path about a time and a position, and about balls of all of them, by cell."""
        thin = [self._path(k, *start, cell, order) for cell in self._surface.over(*start[1])]
        thick = [self._path(k, *every, cell, order + 1) for cell in self._surface.over(*every[1])]
        return thin, thick

    def _box(self, k: int, at: Position, times: Any, duration: Any) -> Position:
        """Box of all positions that a ball of times reaches within a duration from a position."""
        speed = self._motion.speed[k](times)
        reach = self._flint.arb(0, 1) * (abs(speed) * duration)
        return at[0] + reach, at[1] + reach

    def _stepped(self, k: int, start: float, end: float) -> Position:
        """Position at share `end`, from that at share `start`."""
        flint, at = self._flint, self._positions[k, start]
        h = self._motion.steps[k]
        begin, duration = h * start, h * (end - start)
        times = begin + duration / 2 + duration / 2 * flint.arb(0, 1)
        box = self._box(k, at, times, duration)
        touched = self._surface.over(*box)
        if len(touched) != 1 and above(duration) > FINEST:
            middle = 0.5 * (start + end)
            self._positions[k, middle] = self._stepped(k, start, middle)
            return self._stepped(k, middle, end)
        if not 0 < len(touched) <= MOST_CELLS:
            return flint.arb.nan(), flint.arb.nan()
        order = PATH_ORDER if len(touched) == 1 else CROSSING_ORDER
        thin, thick = self._both(k, (begin, at), (times, box), order)
        found = []
        for axis in (0, 1):
            place = flint.arb(0)
            for m in range(order):
                place += _union([one[axis][m] for one in thin]) * duration**m
            found.append(place + _union([one[axis][order] for one in thick]) * duration**order)
        return found[0], found[1]

    def _path(self, k: int, point: Any, at: Position, cell: Cell, length: int) -> tuple[Any, Any]:
        """Series of x and y about a ball of times, from balls of their values there."""
        flint, motion = self._flint, self._motion
        yaw = motion.at(motion.yaw[k], point, length)
        speed = motion.at(motion.speed[k], point, length)
        sin, cos = yaw.sin_cos()
        along, across = speed * cos, speed * sin
        x, y = (flint.arb_series([value], 1) for value in at)
        for _ in range(length - 1):
            E = self._frame(cell, x, y)
            x_rate = E[0][0] * along + E[0][1] * across
            y_rate = E[1][1] * across
            x, y = x_rate.integral() + at[0], y_rate.integral() + at[1]
        return x, y

    def _frame(self, cell: Cell, x: Any, y: Any) -> tuple[Vector, Vector, Vector]:
        """Rotation E at series of x and y."""
        p, r = self._surface.gradient(cell, x, y)
        square = p * p + 1
        A, W = square.rsqrt(), (square + r * r).rsqrt()  # their reciprocals
        rAW = r * A * W
        return (
            (A, -(p * rAW), -(p * W)),
            (0, square * A * W, -(r * W)),
            (p * A, rAW, W),
        )

    def _root(self, k: int, point: Any, at: Position, cell: Cell, length: int) -> Root:
        """Root at the position `at`, which is in a cell."""
        motion = self._motion
        x, y = self._path(k, point, at, cell, length)
        E = self._frame(cell, x, y)
        yaw = motion.at(motion.yaw[k], point, length)
        speed = motion.at(motion.speed[k], point, length)
        sin, cos = yaw.sin_cos()
        one, two, normal = (tuple(row[i] for row in E) for i in range(3))
        ahead = vector_sum(scaled(cos, one), scaled(sin, two))
        left = vector_sum(scaled(-sin, one), scaled(cos, two))
        axes: list[Any] = [ahead, left, normal]
        spin: Vector = (0, 0, 0)
        for axis in axes:  # twice the angular velocity
            spin = vector_sum(spin, cross(axis, tuple(map(derivative, axis))))
        half = self._flint.arb(1) / 2
        drop: Any = tuple(product(-self._height, derivative(x)) for x in normal)
        velocity = vector_sum(scaled(speed, ahead), drop)
        rows: Any = tuple(zip(*axes, strict=True))
        return Root(rows, scaled(half, spin), velocity)


def _union(balls: Sequence[Any]) -> Any:
    """Least ball around some balls."""
    return reduce(lambda a, b: a.union(b), balls)
