"""The base as a unicycle: where it drives from and to, and how fast it may."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.limits import JointLimits
from zmp_sqp.motion.double_integrator import minimum_time

__all__ = ["UnicycleBase"]

LIMITS = ("max_speed", "max_acceleration", "max_yaw_rate", "max_yaw_acceleration")
LIMIT_TOLERANCE = 1e-9  # [m or relative] rounding that a start or goal may stand outside its limits
LEAST_DISTANCE = 1e-12  # [m] nearer than this, the base stays where it is


@dataclass(frozen=True, slots=True, eq=False)
class UnicycleBase:
    r"""Undercarriage on tracks: it drives along its heading and turns, and does not slip sideways.

    .. math:: \dot x = s \cos\psi, \; \dot y = s \sin\psi, \; \dot s = u_a, \; \ddot\psi = u_\psi
              \qquad \text{(Song \& Sharf 2020, eq. (19))}

    Attributes:
        start: x, y, yaw at the start, in the ground's coordinates (of a Slope in its plane, of a
            Heightmap on the map), shape (3,) [m, m, rad].
        goal: x, y, yaw at the goal; the yaw counts turns [m, m, rad].
        max_speed: Along the heading, either way [m/s].
        max_acceleration: Along the heading [m/s^2].
        max_yaw_rate: [rad/s].
        max_yaw_acceleration: [rad/s^2].
        start_velocity: Speed and yaw rate at the start, shape (2,) [m/s, rad/s]; None is rest.
        goal_velocity: Likewise at the goal.
        x_bounds: Least and largest x at any time [m]; None is no bound.
        y_bounds: Likewise of y.

    Raises:
        ProblemError: An entry is no number, a limit not positive, a boundary speed or position
            outside its limits.
    """

    start: Any
    goal: Any
    max_speed: float
    max_acceleration: float
    max_yaw_rate: float
    max_yaw_acceleration: float
    start_velocity: Any = None
    goal_velocity: Any = None
    x_bounds: Any = None
    y_bounds: Any = None

    def __post_init__(self) -> None:
        for name in LIMITS:
            value = finite_number(getattr(self, name), name=f"base {name}", error=ProblemError)
            if value <= 0.0:
                raise ProblemError(f"base {name} must be positive, not {value}")
            object.__setattr__(self, name, value)
        for name in ("start", "goal"):
            self._freeze(name, getattr(self, name), 3)
            rates = getattr(self, f"{name}_velocity")
            self._freeze(f"{name}_velocity", np.zeros(2) if rates is None else rates, 2)
            self._check_rates(f"{name}_velocity")
        for axis, name in enumerate(("x_bounds", "y_bounds")):
            self._check_bounds(axis, name)

    def _freeze(self, name: str, values: Any, size: int) -> None:
        array = frozen_array(values, name=f"base {name}", shape=(size,), error=ProblemError)
        object.__setattr__(self, name, array)

    def _check_rates(self, name: str) -> None:
        largest = (self.max_speed, self.max_yaw_rate)
        for what, value, limit in zip(
            ("speed", "yaw rate"), getattr(self, name), largest, strict=True
        ):
            if abs(value) > limit * (1.0 + LIMIT_TOLERANCE):
                raise ProblemError(
                    f"base {name}: {what} {value:.6g} is outside its limits +-{limit:.6g}"
                )

    def _check_bounds(self, axis: int, name: str) -> None:
        given = getattr(self, name)
        if given is None:
            return
        self._freeze(name, given, 2)
        lower, upper = getattr(self, name)
        if lower > upper:
            raise ProblemError(
                f"base {name}: the lower bound {lower:.6g} m lies above the upper one {upper:.6g} m"
            )
        for side in ("start", "goal"):
            place = getattr(self, side)[axis]
            if not lower - LIMIT_TOLERANCE <= place <= upper + LIMIT_TOLERANCE:
                raise ProblemError(
                    f"base {side}: {name[0]} = {place:.6g} m is outside {name} [{lower:.6g}, {upper:.6g}]"
                )

    @property
    def distance(self) -> float:
        """From start to goal in a straight line: no way is shorter [m]."""
        return float(np.hypot(*(self.goal[:2] - self.start[:2])))

    @property
    def travel(self) -> float:
        """That distance along the heading: negative where the goal lies behind the mean heading [m]."""
        step, heading = self.goal[:2] - self.start[:2], 0.5 * (self.start[2] + self.goal[2])
        ahead = float(step @ [np.cos(heading), np.sin(heading)])
        return self.distance if ahead >= -LEAST_DISTANCE else -self.distance

    @property
    def least_duration(self) -> float:
        """No motion of the base within its limits is shorter [s]: of the yaw, and of |speed| over the distance."""
        v0, v1 = (float(abs(rates[0])) for rates in (self.start_velocity, self.goal_velocity))
        direct = 0.5 * (v0 + v1) * abs(v1 - v0) / self.max_acceleration  # covered anyway
        way = minimum_time(
            max(self.distance, direct),
            max_velocity=max(self.max_speed, v0, v1),
            max_acceleration=self.max_acceleration,
            start_velocity=v0,
            goal_velocity=v1,
        )
        turn = minimum_time(
            float(self.goal[2] - self.start[2]),
            max_velocity=self.max_yaw_rate,
            max_acceleration=self.max_yaw_acceleration,
            start_velocity=float(self.start_velocity[1]),
            goal_velocity=float(self.goal_velocity[1]),
        )
        return max(way.duration, turn.duration)

    @property
    def limits(self) -> JointLimits:
        """Of the way along the heading and of the yaw, shape (2,) each."""
        unlimited = np.full(2, np.inf)
        return JointLimits(
            position_lower=-unlimited,
            position_upper=unlimited,
            velocity=np.array([self.max_speed, self.max_yaw_rate]),
            acceleration=np.array([self.max_acceleration, self.max_yaw_acceleration]),
            effort=np.full(2, np.nan),
        )

    @property
    def position_bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of x and y, infinite where there are none, shape (2,) each [m]."""
        sides = [
            (-np.inf, np.inf) if given is None else given
            for given in (self.x_bounds, self.y_bounds)
        ]
        return np.array([side[0] for side in sides]), np.array([side[1] for side in sides])
