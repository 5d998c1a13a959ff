"""Undercarriages of a planning problem: one that stands, and one that drives as a unicycle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.ground import Ground, Terrain, is_uneven, terrain_of
from zmp_sqp.mechanics.limits import JointLimits
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning.problem.statics import gravity_under
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase

__all__ = ["Driving", "Standing", "Undercarriage", "undercarriage_of"]


class Undercarriage(Protocol):
    """Undercarriage of a machine, as the planner sees it.

    An undercarriage that drives adds b = 2 planning coordinates to those of the arm: the path
    length along its heading [m], and its yaw [rad]. One that stands adds none, b = 0.
    """

    @property
    def limits(self) -> JointLimits:
        """Limits of the b coordinates, shape (b,) each [m or rad, s]."""

    @property
    def least_duration(self) -> float:
        """Lower bound on the duration of the undercarriage's motion within its limits [s]."""

    @property
    def route(self) -> Array | None:
        """Positions (x, y) at start and goal, shape (2, 2) [m]; None for one that stands."""

    def boundary(self, side: str) -> tuple[Array, Array]:
        """Coordinates and rates at the "start" or "goal", shape (b,) each [m or rad, s]."""

    def pose(self, side: str) -> Array | None:
        """Pose x, y, yaw at the "start" or "goal" (3,) [m, m, rad]; None for one that stands."""

    def moves(self, side: str) -> bool:
        """Whether the undercarriage is in motion at the "start" or the "goal"."""

    def motion(
        self,
        times: Array,
        yaw: Array,
        rates: Array,
        accelerations: Array,
        jerks: Array,
        near: Array | None = None,
    ) -> UnicycleMotion | None:
        """Motion in seconds from the start pose; None for an undercarriage that stands.

        Args:
            times: Nodes, shape (N+1,) [s].
            yaw: Yaw at the nodes, shape (N+1,) [rad].
            rates: Speed and yaw rate at the nodes, shape (N+1, b) [m/s, rad/s].
            accelerations: Derivatives of the rates at the start of each interval, shape (N, b)
                [m/s^2, rad/s^2].
            jerks: Constant second derivatives of the rates on each interval, shape (N, b)
                [m/s^3, rad/s^3].
            near: Positions at the nodes of a path nearby, from which the exact ones are found,
                shape (N + 1, 2) [m]; None if none is known.
        """

    def still(self) -> UnicycleMotion | None:
        """Motion of zero duration at the start, for a problem whose start is its goal."""

    def check(self, machine: Machine, model: str) -> None:
        """Refuse a start or goal where the tracks cannot follow the ground.

        Args:
            machine: The machine.
            model: `Problem.model`.

        Raises:
            ProblemError: The tracks cannot follow the ground, or the model cannot drive.
        """


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """Undercarriage that stands at x = y = yaw = 0.

    Attributes:
        ground: Ground that the undercarriage stands on.
    """

    ground: Ground
    least_duration = 0.0
    route = None

    @property
    def limits(self) -> JointLimits:
        """No limits, shape (0,) each."""
        return _no_limits()

    def boundary(self, side: str) -> tuple[Array, Array]:
        """No coordinates, shape (0,) each."""
        return np.zeros(0), np.zeros(0)

    def pose(self, side: str) -> Array | None:
        """None: there is no pose to choose."""
        return None

    def moves(self, side: str) -> bool:
        """False: it stands."""
        return False

    def motion(
        self,
        times: Array,
        yaw: Array,
        rates: Array,
        accelerations: Array,
        jerks: Array,
        near: Array | None = None,
    ) -> UnicycleMotion | None:
        """None: there is no motion."""
        return None

    def still(self) -> UnicycleMotion | None:
        """None: there is no motion."""
        return None

    def check(self, machine: Machine, model: str) -> None:
        """Refuse uneven ground that the tracks cannot follow at x = y = yaw = 0."""
        ground = self.ground
        if is_uneven(ground) and machine.support is not None:
            ground.check_on(np.zeros((1, 2)))
            ground.check_followable(machine.support, np.zeros((1, 3)))


@dataclass(frozen=True, slots=True, eq=False)
class Driving:
    """Undercarriage that drives as a unicycle.

    Attributes:
        base: Start, goal and limits.
        terrain: Ground that the undercarriage drives on.
    """

    base: UnicycleBase
    terrain: Terrain

    @property
    def limits(self) -> JointLimits:
        """Limits of the path length along the heading and of the yaw, shape (2,) each."""
        return self.base.limits

    @property
    def least_duration(self) -> float:
        """Lower bound on the duration of the undercarriage's motion within its limits [s]."""
        return self.base.least_duration

    @property
    def route(self) -> Array:
        """Positions (x, y) at start and goal, shape (2, 2) [m]."""
        return np.vstack([self.base.start[:2], self.base.goal[:2]])

    @property
    def path_length(self) -> float:
        """Straight distance in space from start to goal, negative for driving backwards [m]."""
        if self.terrain.uniform:
            return self.base.travel
        ends, _ = self.terrain.base_pose(np.vstack([self.base.start, self.base.goal]))
        return float(np.copysign(np.linalg.norm(ends[1] - ends[0]), self.base.travel))

    def boundary(self, side: str) -> tuple[Array, Array]:
        """Path length from the start and yaw; speed and yaw rate; shape (2,) each [m, rad, s]."""
        length = 0.0 if side == "start" else self.path_length
        pose, rates = getattr(self.base, side), getattr(self.base, f"{side}_velocity")
        return np.array([length, pose[2]]), rates

    def pose(self, side: str) -> Array | None:
        """Pose x, y, yaw at the "start" or the "goal", shape (3,) [m, m, rad]."""
        return np.asarray(getattr(self.base, side))

    def moves(self, side: str) -> bool:
        """Whether speed or yaw rate at the "start" or the "goal" is not zero."""
        return bool(getattr(self.base, f"{side}_velocity").any())

    def motion(
        self,
        times: Array,
        yaw: Array,
        rates: Array,
        accelerations: Array,
        jerks: Array,
        near: Array | None = None,
    ) -> UnicycleMotion | None:
        """Motion in seconds from the start pose; arguments as in `Undercarriage.motion`."""
        start, derivatives = self.base.start, (accelerations, jerks)
        return UnicycleMotion.from_start(times, start, rates, yaw, derivatives, self.terrain, near)

    def still(self) -> UnicycleMotion | None:
        """Motion of zero duration at the start."""
        nothing, rates = np.zeros((1, 2)), np.vstack([self.base.start_velocity] * 2)
        yaw = np.full(2, self.base.start[2])
        return self.motion(np.zeros(2), yaw, rates, nothing, nothing)

    def check(self, machine: Machine, model: str) -> None:
        """Refuse a model that cannot drive, and a start or goal where tracks cannot follow."""
        if model != "full":
            raise ProblemError(f'a base that drives needs model="full", not {model!r}')
        if machine.support is None:
            return
        for name in ("start", "goal"):
            pose = getattr(self.base, name)[None]
            try:
                self.terrain.check_on(pose[:, :2])
                self.terrain.check_followable(machine.support, pose)
            except ProblemError as cause:
                raise ProblemError(f"base {name}: {cause}") from None


@cache
def _no_limits() -> JointLimits:
    """Limits of no coordinates, shape (0,) each."""
    nothing = np.zeros(0)
    return JointLimits(nothing, nothing, nothing, nothing, nothing)


def undercarriage_of(base: UnicycleBase | None, ground: Ground) -> Undercarriage:
    """Undercarriage for the base of a problem.

    Args:
        base: Base that drives; None for one that stands.
        ground: Ground under it.

    Raises:
        ProblemError: `base` is not a UnicycleBase, or no base can drive on the ground.
    """
    if base is None:
        return Standing(ground)
    if not isinstance(base, UnicycleBase):
        raise ProblemError(f"base must be a UnicycleBase, not {type(base).__name__}")
    return Driving(base, terrain_of(ground))


def gravity_at(undercarriage: Undercarriage, ground: Ground, side: str) -> Array:
    """Gravity in the root frame at the "start" or the "goal", shape (3,) [m/s^2]."""
    return gravity_under(ground, undercarriage.pose(side))
