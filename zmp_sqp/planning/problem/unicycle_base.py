"""Base that drives as a unicycle: its start, its goal and its limits."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, distinct_texts, finite_number, frozen_array, set_frozen_state
from zmp_sqp.errors import ProblemError, ProblemWarning
from zmp_sqp.mechanics.limits import FULL_TURN, JointLimits
from zmp_sqp.motion.double_integrator import minimum_time

__all__ = ["UnicycleBase"]

LIMITS = ("max_speed", "max_acceleration", "max_yaw_rate", "max_yaw_acceleration")
# [m for positions, relative for rates] excess over a limit that counts as rounding
LIMIT_TOLERANCE = 1e-9
# [m] distance behind the start up to which a goal counts as beside it, and is driven to forwards
LEAST_DISTANCE = 1e-12
# turns that may be meant in degrees: from four full turns in radians to three in degrees
MANY_TURNS, MOST_DEGREES = 4.0 * FULL_TURN, 1080.0


@dataclass(frozen=True, slots=True, eq=False)
class UnicycleBase:
    r"""Base on tracks that drives along its heading and turns, and does not slip sideways.

    .. math:: \dot x = s \cos\psi, \; \dot y = s \sin\psi, \; \dot s = u_a, \; \ddot\psi = u_\psi
              \qquad \text{(Song \& Sharf 2020, eq. (19))}

    with position (x, y), heading psi (the yaw) and speed s, negative for driving backwards. The
    base drives along the x axis of the root link, whatever the machine's front is: tracks along
    another axis need a URDF whose root has x forward (REP-103). The root's origin may be anywhere;
    position and path are those of the point of the support plane on its z axis.

    Attributes:
        start: Pose x, y, yaw at the start, shape (3,) [m, m, rad]. On a Slope, x and y lie in its
            inclined plane; on a Heightmap they are those of the map.
        goal: Pose x, y, yaw at the goal, shape (3,) [m, m, rad]. The yaw counts full turns: with
            start at 0 and goal at 2 pi, the base turns once.
        max_speed: Largest |s| [m/s].
        max_acceleration: Largest |ds/dt| [m/s^2].
        max_yaw_rate: Largest |dpsi/dt| [rad/s].
        max_yaw_acceleration: Largest |d^2psi/dt^2| [rad/s^2].
        start_velocity: Speed and yaw rate at the start, shape (2,) [m/s, rad/s]; None is rest.
        goal_velocity: Speed and yaw rate at the goal, shape (2,) [m/s, rad/s]; None is rest.
        x_bounds: Least and largest x at any time, shape (2,) [m]; None is no bound.
        y_bounds: Least and largest y at any time, shape (2,) [m]; None is no bound.

    Raises:
        ProblemError: An entry is no number, a limit is not positive, or the speed, yaw rate or
            position at start or goal is outside its limits.
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

    __setstate__ = set_frozen_state

    def __post_init__(self) -> None:
        for name in LIMITS:
            value = finite_number(getattr(self, name), name=f"base {name}", error=ProblemError)
            if value <= 0.0:
                raise ProblemError(f"base {name} must be positive, not {value:g}")
            object.__setattr__(self, name, value)
        for name in ("start", "goal"):
            self._freeze(name, getattr(self, name), 3)
            rates = getattr(self, f"{name}_velocity")
            self._freeze(f"{name}_velocity", np.zeros(2) if rates is None else rates, 2)
            self._check_rates(f"{name}_velocity")
        for axis, name in enumerate(("x_bounds", "y_bounds")):
            self._check_bounds(axis, name)
        turned = float(abs(self.goal[2] - self.start[2]))
        if MANY_TURNS < turned < MOST_DEGREES:
            yaw = float(max(self.start[2], self.goal[2], key=abs))
            warnings.warn(
                f"the base turns by {turned:.6g} rad, {turned / FULL_TURN:.3g} full turns; if "
                f"yaws are meant in degrees, {yaw:g} is {np.radians(yaw):.4g} rad",
                ProblemWarning,
                stacklevel=4,  # the line that poses the base
            )

    def _freeze(self, name: str, values: Any, size: int) -> None:
        array = frozen_array(values, name=f"base {name}", shape=(size,), error=ProblemError)
        object.__setattr__(self, name, array)

    def _check_rates(self, name: str) -> None:
        speed, yaw_rate = getattr(self, name)
        for what, unit, value, limit in (
            ("speed", "m/s", speed, self.max_speed),
            ("yaw rate", "rad/s", yaw_rate, self.max_yaw_rate),
        ):
            if abs(value) > limit * (1.0 + LIMIT_TOLERANCE):
                shown, _, most = distinct_texts(float(value), float(abs(value)), limit)
                raise ProblemError(
                    f"base {name}: {what} {shown} is outside its limits +-{most} {unit}"
                )

    def _check_bounds(self, axis: int, name: str) -> None:
        given = getattr(self, name)
        if given is None:
            return
        self._freeze(name, given, 2)
        lower, upper = getattr(self, name)
        if lower > upper:
            least, most = distinct_texts(lower, upper)
            raise ProblemError(
                f"base {name}: the lower bound {least} m is above the upper bound {most} m"
            )
        for side in ("start", "goal"):
            position = getattr(self, side)[axis]
            if not lower - LIMIT_TOLERANCE <= position <= upper + LIMIT_TOLERANCE:
                shown, least, most = distinct_texts(position, lower, upper)
                raise ProblemError(
                    f"base {side}: {name[0]} = {shown} m is outside {name} [{least}, {most}] m"
                )

    @property
    def distance(self) -> float:
        """Straight distance from start to goal: no path is shorter [m]."""
        return float(np.hypot(*(self.goal[:2] - self.start[:2])))

    @property
    def offset(self) -> tuple[float, float]:
        """How far the goal lies ahead and to the left, by the mean of both headings [m]."""
        step, heading = self.goal[:2] - self.start[:2], 0.5 * (self.start[2] + self.goal[2])
        ahead = float(step @ [np.cos(heading), np.sin(heading)])
        return ahead, float(step @ [-np.sin(heading), np.cos(heading)])

    @property
    def travel(self) -> float:
        """Straight distance from start to goal, negative for driving backwards [m].

        The base drives backwards where the goal lies behind the start, seen in the mean of the
        headings at start and goal.
        """
        return self.distance if self.offset[0] >= -LEAST_DISTANCE else -self.distance

    @property
    def least_duration(self) -> float:
        """Lower bound on the duration of the base's motion within its limits [s].

        It is the longer of two minimum times: for the yaw alone, and for driving the straight
        distance at |speed| alone.
        """
        v0, v1 = (float(abs(rates[0])) for rates in (self.start_velocity, self.goal_velocity))
        # path length that the change from one boundary speed to the other takes at least
        change = 0.5 * (v0 + v1) * abs(v1 - v0) / self.max_acceleration
        drive = minimum_time(
            max(self.distance, change),
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
        return max(drive.duration, turn.duration)

    @property
    def limits(self) -> JointLimits:
        """Limits of path length along the heading and of yaw, shape (2,) each [m or rad, s]."""
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
