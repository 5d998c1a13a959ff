"""Room of a motion to tip-over, contact and torque limits on a stretch of time, in balls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.ground import GRAVITY, Ground, Slope
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.terrain.heightmap import Heightmap
from zmp_sqp.mechanics.uncertainty import Corner
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.constraints.tip_over import supported
from zmp_sqp.rigorous.balls import above, below, bernstein
from zmp_sqp.rigorous.decide import Bound
from zmp_sqp.rigorous.link_series import (
    LinkSeries,
    Momenta,
    joint_constants,
    link_series,
    momenta,
)
from zmp_sqp.rigorous.machine_numbers import Body, bodies_of, joints_of, payload_link
from zmp_sqp.rigorous.motion_series import MotionSeries, Stretch
from zmp_sqp.rigorous.root_series import PlaneRoot, Root
from zmp_sqp.rigorous.series_algebra import (
    Scalar,
    Vector,
    cross,
    dot,
    plus,
    product,
    scaled,
    times_transposed,
    vector_derivative,
    vector_sum,
)
from zmp_sqp.rigorous.terrain_root import TerrainRoot

__all__ = ["EffortBalls"]

# relative to gravity: rounding errors of the corners of an uncertain slope, which are floats
GRAVITY_ROUNDING = 1e-13


@dataclass(frozen=True, slots=True)
class _Quantities:
    """Series of one corner: zero moment point [m], normal force [N], planned efforts [N m or N]."""

    point: tuple[Scalar, Scalar]
    normal: Scalar
    efforts: tuple[Scalar, ...]


class EffortBalls:
    """Bounds on the room to the constraints on efforts at all corners.

    Guarantees in their order: tip-over (one row per edge), contact, and torque limits (two rows per
    joint) if there are any.
    """

    def __init__(
        self,
        flint: Any,
        corners: Sequence[Corner],
        trajectory: Trajectory,
        motion: MotionSeries,
        root: PlaneRoot | TerrainRoot,
        torques: Array | None,
    ) -> None:
        """Read machine and corners as plain numbers.

        Args:
            flint: Module.
            corners: At least one; all machines have the same joints and support.
            trajectory: The motion.
            motion: Its polynomials.
            root: Motion of its root.
            torques: Largest efforts of the planned joints, shape (n,); None if there are none.
        """
        machine = corners[0].machine
        self._flint, self._motion = flint, motion
        self._joints = joint_constants(flint, joints_of(machine))
        self._size = machine.size
        self._torques = None if torques is None else [flint.arb(float(x)) for x in torques]
        self._bodies = [bodies_of(flint, corner.machine) for corner in corners]
        drives = trajectory.base is not None
        self._gravities = [_gravity(flint, corner.ground, drives=drives) for corner in corners]
        self._spreads = [flint.arb(corner.spread) for corner in corners]
        self._carrier = payload_link(machine)
        self._edges = _edges(flint, machine)
        self._height = flint.arb(supported(machine).height)
        self._root = root
        turning = [0.0] * machine.size
        for one in self._joints:
            if not one.joint.slides:
                turning[one.joint.leader] += abs(one.joint.multiplier)
        self._turning = [flint.arb(x) for x in turning]

    def __call__(self, stretch: Stretch) -> list[Bound]:
        """Bounds of all guarantees on a stretch."""
        flint = self._flint
        middle, radius = self._motion.centre(stretch)
        ball = middle + radius * flint.arb(0, 1)
        root = self._root.on(stretch, middle, ball, radius)
        if not root.thin or not root.thick:
            number = 2 if self._torques is None else 3
            return [Bound(-inf, inf, inf, self._motion.time(stretch, 0.5), 0)] * number
        k, order = stretch.interval, root.order
        thin, _ = self._united(k, middle, root.thin, range(order))
        thick, spreads = self._united(k, ball, root.thick, (order,))
        found: list[Bound] = []
        for number, (rows, rests, off) in enumerate(zip(thin, thick, spreads, strict=True)):
            bounds = self._bounds(stretch, rows, [x for (x,) in rests], off, radius, number)
            found = (
                bounds if not found else [_worse(a, b) for a, b in zip(found, bounds, strict=True)]
            )
        return found

    def _united(
        self, k: int, point: Any, roots: Sequence[Root], orders: Sequence[int]
    ) -> tuple[list[list[list[Any]]], list[Any]]:
        """Coefficients of some orders of all quantities at all corners, and missed moments.

        They contain those that any of the roots gives.
        """
        flint, united = self._flint, None
        for root in roots:
            quantities, missed = self._corners_at(k, point, orders[-1] + 1, root)
            rows = [
                [[_coefficient(flint, x, m) for m in orders] for x in _series_of(one)]
                for one in quantities
            ]
            if united is None:
                united = rows, missed
                continue
            united = (
                [
                    [
                        [a.union(b) for a, b in zip(*row, strict=True)]
                        for row in zip(*one, strict=True)
                    ]
                    for one in zip(united[0], rows, strict=True)
                ],
                [a.union(b) for a, b in zip(united[1], missed, strict=True)],
            )
        return united if united is not None else ([], [])

    def _corners_at(
        self, k: int, point: Any, length: int, root: Root
    ) -> tuple[list[_Quantities], list[Any]]:
        """Series of all corners about a ball of times, and bounds on their missed moments."""
        flint, motion = self._flint, self._motion
        q = [motion.at(one, point, length + 2) for one in motion.joints[k]]  # differentiated twice
        links = link_series(self._joints, q, root)
        cache: dict[tuple[int, tuple[float, ...]], Momenta] = {}
        quantities, missed = [], []
        spinning = self._spread(links[self._carrier])
        for bodies, gravity, spread in zip(
            self._bodies, self._gravities, self._spreads, strict=True
        ):
            parts = [
                self._part(i, links[i], body, root.velocity, cache) for i, body in enumerate(bodies)
            ]
            quantities.append(self._quantities(links, parts, gravity))
            missed.append(spread * spinning if spread > 0 else flint.arb(0))
        return quantities, missed

    def _part(
        self,
        index: int,
        link: LinkSeries,
        body: Body,
        velocity: Vector,
        cache: dict[tuple[int, tuple[float, ...]], Momenta],
    ) -> Momenta:
        """Rates of momentum of a link with one of its bodies, computed once."""
        key = index, body.key
        if key not in cache:
            cache[key] = momenta(link, body, velocity)
        return cache[key]

    def _spread(self, link: LinkSeries) -> Any:
        r"""Bound on :math:`|\dot\omega| + |\omega|^2 / 2` of a link, constant terms alone."""
        flint, squares = self._flint, []
        for vector in (vector_derivative(link.spin), link.spin):
            parts = [_constant(flint, x) for x in vector]
            squares.append(flint.arb(above(sum((x * x for x in parts), flint.arb(0)))))
        return squares[0].sqrt() + squares[1] / 2

    def _quantities(
        self, links: Sequence[LinkSeries], parts: Sequence[Momenta], gravity: Vector
    ) -> _Quantities:
        """Series of one corner from the rates of momentum of its links, weights included."""
        flint = self._flint
        forces, moments = [], []
        for part in parts:
            weight = scaled(part.mass, gravity)
            forces.append(vector_sum(part.force, _negative(weight)))
            moments.append(vector_sum(part.moment, _negative(cross(part.first, gravity))))
        efforts: list[Scalar] = [0] * self._size
        for i in range(len(self._joints), 0, -1):  # leaves first
            one, link = self._joints[i - 1], links[i]
            if self._torques is not None:
                about = vector_sum(moments[i], _negative(cross(link.origin, forces[i])))
                effort = dot(link.axis, forces[i] if one.joint.slides else about)
                leader = one.joint.leader
                efforts[leader] = plus(efforts[leader], product(one.multiplier, effort))
            parent = one.joint.parent
            forces[parent] = vector_sum(forces[parent], forces[i])
            moments[parent] = vector_sum(moments[parent], moments[i])
        force = times_transposed(links[0].rotation, forces[0])
        moment = times_transposed(links[0].rotation, moments[0])
        about_x = plus(moment[0], product(self._height, force[1]))
        about_y = plus(moment[1], product(-self._height, force[0]))
        point = _quotient(flint, -about_y, force[2]), _quotient(flint, about_x, force[2])
        return _Quantities(point, force[2], tuple(efforts))

    def _bounds(
        self,
        stretch: Stretch,
        rows: list[list[Any]],
        rests: list[Any],
        off: Any,
        radius: Any,
        corner: int,
    ) -> list[Bound]:
        """Bounds of all guarantees at one corner.

        Args:
            stretch: The stretch.
            rows: Coefficients about its middle, an even number, of each quantity.
            rests: Ball of the next coefficient of each quantity at all of its times.
            off: Moment that the corners miss.
            radius: Half the duration of the stretch.
            corner: Number of the corner.
        """
        flint, order = self._flint, len(rows[0])
        powers = [flint.arb(1)]
        for _ in range(order):
            powers.append(powers[-1] * radius)
        scaled_rows = [[row[m] * powers[m] for row in rows] for m in range(order)]
        control = bernstein(order) * flint.arb_mat(scaled_rows)  # (order, quantities)
        points = [[control[m, i] for m in range(order)] for i in range(len(rows))]
        last = [rest * powers[order] for rest in rests]
        samples = [
            [p[0] + x, row[0], p[-1] + x] for p, row, x in zip(points, rows, last, strict=True)
        ]
        times = [self._motion.time(stretch, share) for share in (0.0, 0.5, 1.0)]
        normal = _Row(points[2], last[2], samples[2])
        contact = _bound([normal], flint.arb(0), times, corner)
        tip = self._tip_over(points, last, samples, off, normal, times, corner)
        found = [tip, contact]
        if self._torques is not None:
            found.append(self._torque(points, last, samples, off, times, corner))
        return found

    def _tip_over(
        self,
        points: list[list[Any]],
        last: list[Any],
        samples: list[list[Any]],
        off: Any,
        normal: _Row,
        times: Sequence[float],
        corner: int,
    ) -> Bound:
        """Bounds on the distance from the zero moment point to the edges."""
        flint = self._flint
        held = [i for i in range(3) if above(normal.samples[i]) < 0.0]
        if held:  # the ground would have to pull
            return Bound(-inf, -inf, -inf, times[held[0]], 0, corner)
        sure = [i for i in range(3) if below(normal.samples[i]) > 0.0]
        rows = []
        for ex, ey, b in self._edges:
            rows.append(
                _Row(
                    [b - ex * x - ey * y for x, y in zip(points[0], points[1], strict=True)],
                    -ex * last[0] - ey * last[1],
                    [b - ex * x - ey * y for x, y in zip(samples[0], samples[1], strict=True)],
                )
            )
        least_normal = normal.lower
        if not least_normal > 0.0:
            found = _bound(rows, flint.arb(0), times, corner, only=sure)
            return found._replace(lower=-inf, reachable=inf)
        return _bound(rows, off / flint.arb(least_normal), times, corner)

    def _torque(
        self,
        points: list[list[Any]],
        last: list[Any],
        samples: list[list[Any]],
        off: Any,
        times: Sequence[float],
        corner: int,
    ) -> Bound:
        """Bounds on the limits less the efforts of either sign, as shares of the limits."""
        rows, offs = [], []
        for sign in (1, -1):
            for i, limit in enumerate(self._torques or ()):
                at = 3 + i
                rows.append(
                    _Row(
                        [1 - sign * x / limit for x in points[at]],
                        -sign * last[at] / limit,
                        [1 - sign * x / limit for x in samples[at]],
                    )
                )
                offs.append(off * self._turning[i] / limit)
        parts = [
            _bound([row], less, times, corner)._replace(row=i)
            for i, (row, less) in enumerate(zip(rows, offs, strict=True))
        ]
        worst = parts[0]
        for part in parts[1:]:
            worst = _worse(worst, part)
        return worst


class _Row:
    """Control points, remainder and samples (start, middle, end) of one row, balls."""

    __slots__ = ("last", "points", "samples")

    def __init__(self, points: Sequence[Any], last: Any, samples: Sequence[Any]) -> None:
        self.points, self.last, self.samples = points, last, samples

    @property
    def lower(self) -> float:
        """Lower bound: the remainder is between zero and `last`, because its power is even."""
        rest = below(self.last)
        if rest == -inf:
            return -inf
        if rest >= 0.0:
            return min(below(x) for x in self.points)
        return min(below(x + self.last) for x in self.points)


def _bound(
    rows: Sequence[_Row],
    less: Any,
    times: Sequence[float],
    corner: int,
    only: Sequence[int] = (0, 1, 2),
) -> Bound:
    """Bound on the least of some rows, which the corners miss by at most `less`."""
    lower, upper, where, number, reachable = inf, inf, 0, 0, inf
    off = above(less)
    for i, row in enumerate(rows):
        lower = min(lower, row.lower)
        for at in only:
            value = above(row.samples[at])
            if value < upper:
                upper, where, number = value, at, i
        if 1 in only:
            reachable = min(reachable, above(row.samples[1]))
    lower = below_difference(lower, off)
    return Bound(lower, reachable - off, upper, times[where], number, corner)


def below_difference(a: float, b: float) -> float:
    """a - b, rounded down."""
    return float(np.nextafter(a - b, -inf)) if b else a


def _worse(a: Bound, b: Bound) -> Bound:
    """Bounds on the lesser of two rooms."""
    least = a if a.upper <= b.upper else b
    return least._replace(lower=min(a.lower, b.lower), reachable=min(a.reachable, b.reachable))


def _series_of(found: _Quantities) -> list[Scalar]:
    return [*found.point, found.normal, *found.efforts]


def _coefficient(flint: Any, x: Scalar, order: int) -> Any:
    """Coefficient of a series or a constant."""
    if hasattr(x, "derivative"):
        return x[order]
    first = flint.arb(x)
    return first if order == 0 or not first.is_finite() else flint.arb(0)


def _constant(flint: Any, x: Scalar) -> Any:
    return x[0] if hasattr(x, "derivative") else flint.arb(x)


def _negative(x: Vector) -> Vector:
    return -x[0], -x[1], -x[2]


def _quotient(flint: Any, a: Scalar, b: Scalar) -> Scalar:
    """Quotient of two series; a ball that is not finite where the divisor may vanish."""
    if a.__class__ is int and a == 0:
        return 0
    return flint.arb.nan() if _constant(flint, b).contains(0) else a / b


def _gravity(flint: Any, ground: Ground, *, drives: bool) -> Vector:
    """Gravity in the ground frame: of a slope's angles in balls, otherwise as the ground gives it.

    That of a heightmap is vertical if the base drives; if it stands, the frame is that of its root.

    The corners of an uncertain slope are floats; balls of `GRAVITY_ROUNDING` contain exact ones.
    """
    arb = flint.arb
    if drives and isinstance(ground, Heightmap):
        return 0, 0, -arb(GRAVITY)
    if type(ground) is Slope:
        roll, pitch, g = arb(ground.roll), arb(ground.pitch), arb(GRAVITY)
        lean = g * pitch.cos()
        return g * pitch.sin(), -lean * roll.sin(), -lean * roll.cos()
    x, y, z = (float(part) for part in ground.gravity())
    radius = GRAVITY_ROUNDING * float(np.linalg.norm([x, y, z]))
    return arb(x, radius), arb(y, radius), arb(z, radius)


def _edges(flint: Any, machine: Machine) -> list[tuple[Any, Any, Any]]:
    """Outward normals and offsets of the edges of the support polygon, from its vertices."""
    corners = supported(machine).vertices.tolist()
    vertices = [(flint.arb(x), flint.arb(y)) for x, y in corners]
    found = []
    for (x, y), (far_x, far_y) in zip(vertices, vertices[1:] + vertices[:1], strict=True):
        dx, dy = far_x - x, far_y - y
        length = (dx * dx + dy * dy).sqrt()
        ex, ey = dy / length, -dx / length
        found.append((ex, ey, ex * x + ey * y))
    return found
