"""The question: from where to where, on which ground, with which margin."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array, shortened
from zmp_sqp.errors import MachineError, ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.ground import Ground, Slope, Terrain, terrain_of
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.uncertainty import Corner, com_box, corners
from zmp_sqp.planning.problem.simplified import (
    FORM_TOLERANCE,
    DistanceLimits,
    simplified_coordinates,
)
from zmp_sqp.planning.problem.statics import check_at_rest, check_in_motion, gravity_under
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase

__all__ = ["MODELS", "Problem"]

LEVEL = Slope()
MOST_ACCELERATIONS = 10_000  # intervals times joints: memory goes with the square, here 2 GB
MODELS = ("full", "simplified")
UNCERTAINTIES = (
    ("tipping_fraction", 0.1, 1.0),
    ("payload_uncertainty", 0.0, 0.9),
    ("slope_uncertainty", 0.0, 0.5),
)
FARTHEST = 1e5  # [rad or m] coordinates beyond it leave too few digits
LIMIT_TOLERANCE = 1e-9  # [rad or m] rounding that a start or goal may stand outside its limits
# [rad or m, per second, per second squared] beyond, squares of durations overflow
LIMIT_RANGE = (1e-12, 1e12)


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Fastest motion of a machine from a start to a goal with its ZMP inside the support polygon.

    Attributes:
        machine: The machine, with its payload, limits and support polygon.
        start: Joint coordinates at the start, shape (n,) [rad or m].
        goal: Joint coordinates at the goal, shape (n,) [rad or m].
        ground: What the machine stands on.
        start_velocity: Joint rates at the start, shape (n,) [rad/s or m/s]; None is rest.
        goal_velocity: Joint rates at the goal, likewise.
        margin: Distance kept between ZMP and every edge [m].
        intervals: Number N of equal intervals with constant acceleration.
        model: "full": every joint is planned; "simplified": slew angle and distance of the lumped
            mass, eq. (20).
        distance_limits: The paper's bounds on that distance in place of the joints' limits; None
            keeps the joints' own.
        base: Where the machine drives meanwhile; None stands still at yaw zero.
        tipping_fraction: Share of the load that tips it which the payload may be (ISO 10567: 0.75):
            the motion is safe with the payload divided by it, too.
        payload_uncertainty: Share by which the payload's mass and inertia may be off, either way.
        slope_uncertainty: Angle by which gravity may be off, in any direction [rad].
        payload_com_uncertainty: By how much the payload's centre of mass may be off along each axis
            of the frame that carries it, either way; scalar or shape (3,) [m].

    Raises:
        ProblemError: The problem contradicts itself or the machine's limits, or the machine tips
            over at rest at the start or the goal; the message names joint or edge, value and
            allowed range.
    """

    machine: Machine
    start: Array
    goal: Array
    ground: Ground = LEVEL
    start_velocity: Any = None
    goal_velocity: Any = None
    margin: float = 0.0
    intervals: int = 50
    model: str = "full"
    distance_limits: DistanceLimits | None = None
    base: UnicycleBase | None = None
    tipping_fraction: float = 1.0
    payload_uncertainty: float = 0.0
    slope_uncertainty: float = 0.0
    payload_com_uncertainty: Any = 0.0
    _coordinates: Coordinates = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.machine, Machine):
            raise ProblemError(
                f"machine must be a Machine (see load_machine), not {type(self.machine).__name__}"
            )
        if isinstance(self.ground, type) or not isinstance(self.ground, Ground):
            raise ProblemError(
                f"ground must have a gravity(yaw) as Slope has, not {shortened(self.ground)}"
            )
        size = self.machine.size
        for name in ("start", "goal", "start_velocity", "goal_velocity"):
            given = getattr(self, name)
            if given is None and name.endswith("velocity"):
                given = np.zeros(size)
            names = self.machine.joint_names
            values = frozen_array(given, name=name, shape=(size,), error=ProblemError, labels=names)
            object.__setattr__(self, name, values)
        if (
            isinstance(self.intervals, bool)
            or not isinstance(self.intervals, (int, np.integer))
            or self.intervals < 2
        ):
            raise ProblemError(
                f"intervals must be a whole number of at least 2, not {shortened(self.intervals)}"
            )
        if self.intervals * size > MOST_ACCELERATIONS:
            most = MOST_ACCELERATIONS // size
            raise ProblemError(
                f"intervals must be at most {most} for {size} joints, not {shortened(self.intervals)}"
            )
        object.__setattr__(self, "intervals", int(self.intervals))
        if self.model not in MODELS:
            raise ProblemError(f"unknown model {self.model!r}; there is {', '.join(MODELS)}")
        self._check_limits()
        self._check_support()
        self._check_base()
        self._check_uncertainty()
        simplified = self.model == "simplified"
        found = (
            simplified_coordinates(self.machine, self.start)
            if simplified
            else Coordinates.identity(size)
        )
        object.__setattr__(self, "_coordinates", found)
        self._check_model()
        for name in ("start", "goal"):
            self._check_boundary(name, getattr(self, name), getattr(self, f"{name}_velocity"))

    def _check_limits(self) -> None:
        missing = self.machine.limits.missing(self.machine.joint_names)
        if missing:
            parts = [
                f"{key.replace('_', ' ')} limit for joint {_names(joints)}"
                for key, joints in missing.items()
            ]
            raise ProblemError(
                f"no {'; no '.join(parts)}: give limits= to load_machine, or a joint_limits.yaml beside the URDF"
            )
        least, most = LIMIT_RANGE
        for key in ("velocity", "acceleration"):
            for joint, value in zip(
                self.machine.joint_names, getattr(self.machine.limits, key), strict=True
            ):
                if not least <= value <= most:
                    raise ProblemError(
                        f"{key} limit of joint {joint!r} is {value:.6g}: planning needs {least:g} to {most:g}"
                    )

    @property
    def coordinates(self) -> Coordinates:
        """What is planned: the joints, or the coordinates of the simplified model."""
        return self._coordinates

    def corners(self, *, every: bool = False) -> tuple[Corner, ...]:
        """Extremes of payload and slope that the motion must be safe for; one if nothing is uncertain.

        Args:
            every: All that a proof needs, not only those that a search does.
        """
        return self._corners_of(self.machine, self.ground, every=every)

    def _corners_of(
        self, machine: Machine, ground: Ground, *, every: bool = False
    ) -> tuple[Corner, ...]:
        return corners(
            machine,
            ground,
            tipping_fraction=self.tipping_fraction,
            payload_uncertainty=self.payload_uncertainty,
            slope_uncertainty=self.slope_uncertainty,
            payload_com_uncertainty=self.payload_com_uncertainty,
            every=every,
        )

    def _check_uncertainty(self) -> None:
        for name, lower, upper in UNCERTAINTIES:
            value = finite_number(getattr(self, name), name=name, error=ProblemError)
            if not lower <= value <= upper:
                raise ProblemError(f"{name} must lie within [{lower:g}, {upper:g}], not {value:g}")
            object.__setattr__(self, name, value)
        name = "payload_com_uncertainty"
        object.__setattr__(self, name, com_box(getattr(self, name), name=name))
        self.corners()

    def _check_base(self) -> None:
        if self.base is None:
            if (
                isinstance(self.ground, Terrain)
                and not self.ground.uniform
                and self.machine.support is not None
            ):
                self.ground.check_on(np.zeros((1, 2)))
                self.ground.check_followable(self.machine.support, np.zeros((1, 3)))
            return
        if not isinstance(self.base, UnicycleBase):
            raise ProblemError(f"base must be a UnicycleBase, not {type(self.base).__name__}")
        if self.model != "full":
            raise ProblemError(f'a base that drives needs model="full", not {self.model!r}')
        self._check_terrain(self.base)

    def _check_terrain(self, base: UnicycleBase) -> None:
        if self.machine.support is None:
            return
        for name in ("start", "goal"):
            pose = getattr(base, name)[None]
            try:
                self.base_ground.check_on(pose[:, :2])
                self.base_ground.check_followable(self.machine.support, pose)
            except ProblemError as cause:
                raise ProblemError(f"base {name}: {cause}") from None

    @property
    def base_ground(self) -> Terrain:
        """The ground, for a base to drive on.

        Raises:
            ProblemError: No base can.
        """
        return terrain_of(self.ground)

    @property
    def base_way(self) -> float:
        """Straight line through space from the base's start to its goal, negative backwards; 0 without base [m]."""
        if self.base is None:
            return 0.0
        if self.base_ground.uniform:
            return self.base.travel
        ends, _ = self.base_ground.base_pose(np.vstack([self.base.start, self.base.goal]))
        return float(np.copysign(np.linalg.norm(ends[1] - ends[0]), self.base.travel))

    def gravity_at(self, side: str) -> Array:
        """Gravity in the root frame at the "start" or the "goal", shape (3,) [m/s^2]."""
        return gravity_under(self.ground, None if self.base is None else getattr(self.base, side))

    def _check_model(self) -> None:
        if self.distance_limits is not None and self.model != "simplified":
            raise ProblemError('distance_limits belong to model="simplified"')
        if self.distance_limits is not None and not isinstance(
            self.distance_limits, DistanceLimits
        ):
            raise ProblemError(
                f"distance_limits must be DistanceLimits, not {type(self.distance_limits).__name__}"
            )
        if self.model == "full":
            return
        coordinates = self.coordinates
        for name, values, fitted in (
            ("goal", self.goal, coordinates.joints(coordinates.coordinates_of(self.goal))),
            (
                "start velocity",
                self.start_velocity,
                coordinates.rates(coordinates.rates_of(self.start_velocity)),
            ),
            (
                "goal velocity",
                self.goal_velocity,
                coordinates.rates(coordinates.rates_of(self.goal_velocity)),
            ),
        ):
            worst = int(np.argmax(np.abs(values - fitted)))
            if abs(values[worst] - fitted[worst]) > FORM_TOLERANCE:
                raise ProblemError(
                    f"the simplified model cannot reach the {name}: its joint "
                    f"{self.machine.joint_names[worst]!r} would be at {fitted[worst]:.6g}, not {values[worst]:.6g} "
                    "(eq. 7; the head keeps its attitude at the start)"
                )

    def _check_support(self) -> None:
        support = self.machine.support
        if support is None:
            raise ProblemError(
                f"machine {self.machine.name!r} has no support polygon: give support= to load_machine, "
                "a SupportPolygon or the names of its contact links"
            )
        margin = finite_number(self.margin, name="margin", error=ProblemError)
        object.__setattr__(self, "margin", margin)
        if margin < 0.0:
            raise ProblemError(f"margin must not be negative, not {margin} m")
        try:
            support.inset(margin)
        except MachineError:
            raise ProblemError(f"margin {margin} m leaves nothing of the support polygon") from None

    def _check_boundary(self, name: str, q: Array, v: Array) -> None:
        limits = self.machine.limits
        for i, joint in enumerate(self.machine.joint_names):
            lower, upper, rate = (
                limits.position_lower[i],
                limits.position_upper[i],
                limits.velocity[i],
            )
            if not lower - LIMIT_TOLERANCE <= q[i] <= upper + LIMIT_TOLERANCE:
                unit = self.machine.joint_units[i]
                raise ProblemError(
                    f"{name} of joint {joint!r} is {q[i]:.6g}, outside its limits [{lower:.6g}, {upper:.6g}] {unit}"
                )
            if abs(v[i]) > rate * (1.0 + LIMIT_TOLERANCE):
                raise ProblemError(
                    f"{name} velocity of joint {joint!r} is {v[i]:.6g}, outside its limits +-{rate:.6g}"
                )
            if abs(q[i]) > FARTHEST:
                raise ProblemError(
                    f"{name} of joint {joint!r} is {q[i]:.6g}: planning needs it within +-{FARTHEST:g}"
                )
            # at the goal, the way it must have come from
            onward = v[i] if name == "start" else -v[i]
            room = upper - q[i] if onward > 0.0 else q[i] - lower
            needed = onward**2 / (2.0 * limits.acceleration[i])
            if needed > room + LIMIT_TOLERANCE:
                what = "stop before" if name == "start" else "reach that rate from"
                side = f"upper limit {upper:.6g}" if onward > 0.0 else f"lower limit {lower:.6g}"
                raise ProblemError(
                    f"{name} velocity {v[i]:.6g} of joint {joint!r} leaves no room to {what} its {side}: "
                    f"{needed:.4g} needed, {room:.4g} there"
                )
        base_moves = self.base is not None and getattr(self.base, f"{name}_velocity").any()
        pose = None if self.base is None else getattr(self.base, name)
        if not (v.any() or base_moves):
            asked = self.machine, self.ground, self._corners_of
            check_at_rest(name, *asked, q, pose=pose, margin=self.margin)
        elif self.base is None:
            check_in_motion(name, self.corners(), q, v, margin=self.margin)


def _names(joints: tuple[str, ...]) -> str:
    return ", ".join(repr(joint) for joint in joints)
