"""Motion of the root as power series of time: standing, or driving in a plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.rigorous.balls import ORDER
from zmp_sqp.rigorous.base_path import displacement, velocity_series
from zmp_sqp.rigorous.motion_series import MotionSeries, Stretch
from zmp_sqp.rigorous.series_algebra import Matrix, Vector, derivative

__all__ = ["PathOfStretch", "PlaneRoot", "Root", "RootOfStretch"]


@dataclass(frozen=True, slots=True)
class Root:
    """Motion of the root's origin O, ground axes.

    Attributes:
        rotation: From root axes to ground axes.
        spin: Angular velocity [rad/s].
        velocity: Velocity of O [m/s].
    """

    rotation: Matrix
    spin: Vector
    velocity: Vector


STANDING = Root(((1, 0, 0), (0, 1, 0), (0, 0, 1)), (0, 0, 0), (0, 0, 0))


@dataclass(frozen=True, slots=True)
class RootOfStretch:
    """Series of the root on a stretch.

    Attributes:
        thin: About its middle; several where they differ, of which the union counts.
        thick: About the ball of all its times; likewise.
        order: Even number of coefficients that are continuous; the next one bounds the remainder.
    """

    thin: tuple[Root, ...]
    thick: tuple[Root, ...]
    order: int


@dataclass(frozen=True, slots=True)
class PathOfStretch:
    """Path of a base on a stretch, for x and y.

    Attributes:
        rows: Coefficients about the middle of the stretch, an even number [m].
        rests: The next coefficient at all of its times.
    """

    rows: tuple[list[Any], list[Any]]
    rests: tuple[Any, Any]


class PlaneRoot:
    """Root of a base that stands, or drives in a plane."""

    def __init__(self, flint: Any, motion: MotionSeries, base: UnicycleMotion | None) -> None:
        """Root along the polynomials of a motion; `base` gives the positions at its nodes."""
        self._flint, self._motion = flint, motion
        self._starts = [] if base is None else base.poses[:-1, :2].tolist()

    def on(self, stretch: Stretch, middle: Any, ball: Any, radius: Any) -> RootOfStretch:
        """Series on a stretch."""
        if not self._motion.yaw:
            return RootOfStretch((STANDING,), (STANDING,), ORDER)
        k = stretch.interval
        return RootOfStretch(
            (self._at(k, middle, ORDER + 2),), (self._at(k, ball, ORDER + 3),), ORDER
        )

    def position(self, k: int, share: float) -> tuple[Any, Any]:
        """Ball of (x, y) at a share of the duration of interval k [m]."""
        x, y = displacement(self._flint, self._motion, k, share)
        start_x, start_y = (self._flint.arb(one) for one in self._starts[k])
        return start_x + x, start_y + y

    def path_on(self, stretch: Stretch, middle: Any, ball: Any, radius: Any) -> PathOfStretch:
        """Path on a stretch."""
        k = stretch.interval
        at = self.position(k, 0.5 * (stretch.start + stretch.end))
        thin = velocity_series(self._motion, k, middle, ORDER - 1)
        thick = velocity_series(self._motion, k, ball, ORDER)
        rows = [[at[axis], *(thin[axis][m] / (m + 1) for m in range(ORDER - 1))] for axis in (0, 1)]
        x, y = (rates[ORDER - 1] / ORDER for rates in thick)
        return PathOfStretch((rows[0], rows[1]), (x, y))

    def _at(self, k: int, point: Any, length: int) -> Root:
        motion = self._motion
        yaw = motion.at(motion.yaw[k], point, length)
        sin, cos = yaw.sin_cos()
        return Root(
            ((cos, -sin, 0), (sin, cos, 0), (0, 0, 1)),
            (0, 0, derivative(yaw)),
            (*velocity_series(motion, k, point, length), 0),
        )
