"""The undercarriage of a problem: it stands, or it drives as a unicycle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.ground import Ground, Terrain, terrain_of
from zmp_sqp.mechanics.limits import JointLimits
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning.problem.statics import gravity_under
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase

__all__ = ["Driving", "Standing", "Undercarriage", "undercarriage_of"]


class Undercarriage(Protocol):
    """What the planner asks of an undercarriage, whether it stands or drives.

    A driving one adds b = 2 planning coordinates to those of the joints: the length of its path
    along the heading, and its yaw. A standing one adds none.
    """

    @property
    def limits(self) -> JointLimits:
        """Limits of its b coordinates."""

    @property
    def least_duration(self) -> float:
        """No motion of it within its limits is shorter [s]."""

    @property
    def route(self) -> Array | None:
        """Positions (x, y) at start and goal, shape (2, 2) [m]; None if it stands."""

    def boundary(self, side: str) -> tuple[Array, Array]:
        """Its coordinates and rates at the "start" or the "goal", shape (b,) each."""

    def pose(self, side: str) -> Array | None:
        """x, y, yaw at the "start" or the "goal", shape (3,) [m, m, rad]; None if it stands."""

    def moves(self, side: str) -> bool:
        """Whether it is in motion at the "start" or the "goal"."""

    def motion(
        self, times: Array, yaw: Array, rates: Array, accelerations: Array, jerks: Array
    ) -> UnicycleMotion | None:
        """Its motion in seconds, from its coordinates' derivatives; None if it stands.

        Args:
            times: Nodes, shape (N+1,) [s].
            yaw: At the nodes, shape (N+1,) [rad]; not used if it stands.
            rates: Speed and yaw rate at the nodes, shape (N+1, b).
            accelerations, jerks: On the intervals, shape (N, b) each.
        """

    def still(self) -> UnicycleMotion | None:
        """The motion of no duration at the start, for a start that is the goal."""

    def check(self, machine: Machine, model: str) -> None:
        """Refuse ground that does not carry the machine at start or goal.

        Raises:
            ProblemError: The tracks cannot follow the ground, or the model cannot drive.
        """


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """An undercarriage that stands at x = y = yaw = 0.

    Attributes:
        ground: What it stands on.
    """

    ground: Ground
    least_duration = 0.0
    route = None

    @property
    def limits(self) -> JointLimits:
        """No limits, shape (0,) each."""
        nothing = np.zeros(0)
        return JointLimits(nothing, nothing, nothing, nothing, nothing)

    def boundary(self, side: str) -> tuple[Array, Array]:
        """No coordinates, shape (0,) each."""
        return np.zeros(0), np.zeros(0)

    def pose(self, side: str) -> Array | None:
        """None: it stands as the ground says."""
        return None

    def moves(self, side: str) -> bool:
        """False."""
        return False

    def motion(
        self, times: Array, yaw: Array, rates: Array, accelerations: Array, jerks: Array
    ) -> UnicycleMotion | None:
        """None: there is no motion."""
        return None

    def still(self) -> UnicycleMotion | None:
        """None: there is no motion."""
        return None

    def check(self, machine: Machine, model: str) -> None:
        """Refuse uneven ground that does not carry the tracks where the machine stands."""
        ground = self.ground
        if isinstance(ground, Terrain) and not ground.uniform and machine.support is not None:
            ground.check_on(np.zeros((1, 2)))
            ground.check_followable(machine.support, np.zeros((1, 3)))


@dataclass(frozen=True, slots=True, eq=False)
class Driving:
    """An undercarriage that drives.

    Attributes:
        base: From where to where, and how fast it may.
        terrain: What it drives on.
    """

    base: UnicycleBase
    terrain: Terrain

    @property
    def limits(self) -> JointLimits:
        """Limits of the path length along the heading and of the yaw, shape (2,) each."""
        return self.base.limits

    @property
    def least_duration(self) -> float:
        """No motion of it within its limits is shorter [s]."""
        return self.base.least_duration

    @property
    def route(self) -> Array:
        """Positions (x, y) at start and goal, shape (2, 2) [m]."""
        return np.vstack([self.base.start[:2], self.base.goal[:2]])

    @property
    def path_length(self) -> float:
        """Straight line through space from start to goal, negative where it drives backwards [m]."""
        if self.terrain.uniform:
            return self.base.travel
        ends, _ = self.terrain.base_pose(np.vstack([self.base.start, self.base.goal]))
        return float(np.copysign(np.linalg.norm(ends[1] - ends[0]), self.base.travel))

    def boundary(self, side: str) -> tuple[Array, Array]:
        """Path length, which begins at zero, and yaw, with speed and yaw rate, shape (2,) each."""
        length = 0.0 if side == "start" else self.path_length
        pose, rates = getattr(self.base, side), getattr(self.base, f"{side}_velocity")
        return np.array([length, pose[2]]), rates

    def pose(self, side: str) -> Array | None:
        """x, y, yaw at the "start" or the "goal", shape (3,) [m, m, rad]."""
        return np.asarray(getattr(self.base, side))

    def moves(self, side: str) -> bool:
        """Whether speed or yaw rate is not zero there."""
        return bool(getattr(self.base, f"{side}_velocity").any())

    def motion(
        self, times: Array, yaw: Array, rates: Array, accelerations: Array, jerks: Array
    ) -> UnicycleMotion | None:
        """Its motion in seconds, from the start pose on."""
        of_rates = accelerations, jerks
        start, ground = self.base.start, self.terrain
        return UnicycleMotion.from_start(times, start, rates, yaw, of_rates, ground)

    def still(self) -> UnicycleMotion | None:
        """The motion of no duration at the start."""
        nothing, rates = np.zeros((1, 2)), np.vstack([self.base.start_velocity] * 2)
        yaw = np.full(2, self.base.start[2])
        return self.motion(np.zeros(2), yaw, rates, nothing, nothing)

    def check(self, machine: Machine, model: str) -> None:
        """Refuse a model that cannot drive, and start or goal where tracks cannot follow."""
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


def undercarriage_of(base: UnicycleBase | None, ground: Ground) -> Undercarriage:
    """The undercarriage of a problem with this base, which is None if it stands.

    Raises:
        ProblemError: `base` is no UnicycleBase, or no base can drive on the ground.
    """
    if base is None:
        return Standing(ground)
    if not isinstance(base, UnicycleBase):
        raise ProblemError(f"base must be a UnicycleBase, not {type(base).__name__}")
    return Driving(base, terrain_of(ground))


def gravity_at(undercarriage: Undercarriage, ground: Ground, side: str) -> Array:
    """Gravity in the root frame at the "start" or the "goal", shape (3,) [m/s^2]."""
    return gravity_under(ground, undercarriage.pose(side))
