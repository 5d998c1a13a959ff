"""The planning problem: start, goal, ground, margin, uncertainties and constraints of a machine."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, frozen_array, set_frozen_state
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.ground import Ground, Slope, check_ground
from zmp_sqp.mechanics.joint_values import by_joint
from zmp_sqp.mechanics.lumped_mass import simplified_coordinates
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.uncertainty import Corner, com_box, corners
from zmp_sqp.planning.constraints.binding import checked_constraints
from zmp_sqp.planning.constraints.distance import DistanceLimits
from zmp_sqp.planning.constraints.protocol import PathConstraint
from zmp_sqp.planning.constraints.tip_over import Contact, TipOver
from zmp_sqp.planning.problem.checks import (
    AUTO,
    UNCERTAINTIES,
    check_boundary_state,
    check_limits,
    check_plannable,
    check_simplified,
    checked_in_range,
    checked_intervals,
    checked_margin,
)
from zmp_sqp.planning.problem.intervals import suggested_intervals
from zmp_sqp.planning.problem.statics import (
    check_at_rest,
    check_constraints_at_rest,
    check_in_motion,
)
from zmp_sqp.planning.problem.undercarriage import (
    Undercarriage,
    gravity_at,
    undercarriage_of,
)
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase

__all__ = ["MODELS", "Problem"]

LEVEL = Slope()  # the default ground
MODELS = ("full", "simplified")  # values of `Problem.model`
# arguments with one number per joint
STATES = ("start", "goal", "start_velocity", "goal_velocity")


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    r"""Planning problem: the fastest motion from start to goal that does not tip the machine over.

    .. math:: \min T \quad \text{s.t. } q(0), \dot q(0), q(T), \dot q(T) \text{ given, limits, }
              \min_i (b_i - e_i \cdot p(t)) \ge margin

    where p is the zero moment point (ZMP) and e_i . p = b_i are the edges of the support polygon
    (Song & Sharf 2020, eq. (19)). The last condition includes the nominal payload and slope and
    every one that the uncertainties allow.

    Attributes:
        machine: The machine, with its payload, limits and support polygon.
        start: Joint coordinates at the start, shape (n,) [rad or m]. They can be given as a mapping
            from joint names, or as the name of one of the machine's poses.
        goal: Joint coordinates at the goal, like the start's.
        ground: Ground that the machine stands or drives on: a Slope, a Heightmap, or any object
            with their method `gravity(yaw)`.
        start_velocity: Joint rates at the start, shape (n,) [rad/s or m/s]; None is rest.
        goal_velocity: Joint rates at the goal, shape (n,) [rad/s or m/s]; None is rest.
        margin: Required distance from the ZMP to every edge of the support polygon [m].
        intervals: Number N of equal intervals of the time grid. With "auto" as many, from 50 on (24
            for more than 12 joints), as bring the duration within 0.1 % of that on a grid four
            times as fine, by estimate.
        model: "full" plans every joint; "simplified" plans the slew angle and the distance of the
            lumped mass from the slew axis (Song & Sharf 2020, eq. (20)).
        distance_limits: Bounds on the lumped mass that replace the limits of boom, stick and
            levelling joint, for the simplified model only; None uses the joint limits.
        base: Start, goal and limits of a base that drives while the arm moves; None for a base
            that stands at x = y = yaw = 0.
        tipping_fraction: Largest ratio of the payload to the load that tips the machine over
            (ISO 10567: 0.75). The motion is also safe with the payload divided by this ratio.
        payload_uncertainty: Largest relative error of the payload: one unknown factor between 1 - u
            and 1 + u for masses and inertias of all payloads.
        slope_uncertainty: Largest angle between the actual and the nominal gravity, in any
            direction [rad].
        payload_com_uncertainty: Largest error of the payload's centre of mass along each axis of
            the frame that carries it, scalar or shape (3,) [m].
        constraints: Path constraints beside tip-over and the joint limits, such as
            `TorqueLimits()`.

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
    intervals: int | str = 50
    model: str = "full"
    distance_limits: DistanceLimits | None = None
    base: UnicycleBase | None = None
    tipping_fraction: float = 1.0
    payload_uncertainty: float = 0.0
    slope_uncertainty: float = 0.0
    payload_com_uncertainty: Any = 0.0
    constraints: Any = ()
    _coordinates: Coordinates = field(init=False, repr=False)
    _undercarriage: Undercarriage = field(init=False, repr=False)

    __setstate__ = set_frozen_state

    def __post_init__(self) -> None:
        if not isinstance(self.machine, Machine):
            raise ProblemError(
                f"machine must be a Machine (see load_machine), not {type(self.machine).__name__}"
            )
        check_plannable(self.machine)
        check_ground(self.ground)
        for name in STATES:
            self._set(name, self._state(name))
        self._set("intervals", checked_intervals(self.intervals, self.machine.size))
        check_model(self.model)
        check_limits(self.machine)
        self._set("margin", checked_margin(self.margin, self.machine))
        self._set("_undercarriage", undercarriage_of(self.base, self.ground))
        self._undercarriage.check(self.machine, self.model)
        for allowed in UNCERTAINTIES:
            self._set(allowed.name, checked_in_range(allowed, getattr(self, allowed.name)))
        name = "payload_com_uncertainty"
        self._set(name, com_box(getattr(self, name), name=name))
        self._set("constraints", checked_constraints(self.constraints))
        self._set("_coordinates", self._planned())
        for name in ("start", "goal"):
            self._check_boundary(name)

    def from_start(self, start: Any, start_velocity: Any) -> Problem:
        """This problem from another start, which alone is checked where nothing depends on it.

        Args:
            start: Joint coordinates, shape (n,) [rad or m].
            start_velocity: Joint rates, shape (n,) [rad/s or m/s].

        Raises:
            ProblemError: The start is refused.
        """
        changes = {"start": start, "start_velocity": start_velocity}
        if self.model != "full":  # its coordinates begin at the start
            return replace(self, **changes)
        other = copy(self)
        for name, value in changes.items():
            other._set(name, value)
            other._set(name, other._state(name))
        other._check_boundary("start")
        return other

    @property
    def refines(self) -> bool:
        """Whether the planner chooses the number of intervals."""
        return self.intervals == AUTO

    @property
    def first_intervals(self) -> int:
        """Number of intervals of the first grid that has the last word; N unless it is "auto"."""
        given = self.intervals
        return suggested_intervals(self.machine.size) if isinstance(given, str) else given

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def _state(self, name: str) -> Array:
        """One of `STATES` as a read-only array, shape (n,); velocities default to zero."""
        given, joints = getattr(self, name), self.machine.joint_names
        if given is None and name.endswith("velocity"):
            given = np.zeros(len(joints))
        shape = (len(joints),)
        if not (isinstance(given, str) and name.endswith("velocity")):
            given = by_joint(given, self.machine, name=name, error=ProblemError)
        return frozen_array(given, name=name, shape=shape, error=ProblemError, labels=joints)

    def _planned(self) -> Coordinates:
        """Planning coordinates; raises a ProblemError where the simplified model does not fit."""
        given = self.distance_limits
        if given is not None and self.model != "simplified":
            raise ProblemError(f'distance_limits need model="simplified", not {self.model!r}')
        if given is not None and not isinstance(given, DistanceLimits):
            raise ProblemError(
                f"distance_limits must be DistanceLimits, not {type(given).__name__}"
            )
        if self.model == "full":
            return Coordinates.identity(self.machine.size)
        coordinates = simplified_coordinates(self.machine, self.start)
        rates = self.start_velocity, self.goal_velocity
        check_simplified(self.machine, coordinates, goal=self.goal, rates=rates)
        return coordinates

    def _check_boundary(self, name: str) -> None:
        """Refuse a start or goal that no motion can leave or reach within all limits."""
        q, v = getattr(self, name), getattr(self, f"{name}_velocity")
        check_boundary_state(name, self.machine, q, v)
        pose = self.undercarriage.pose(name)
        if not (v.any() or self.undercarriage.moves(name)):
            asked = self.machine, self.ground, self._corners_of
            check_at_rest(name, *asked, q, pose=pose, margin=self.margin)
            check_constraints_at_rest(
                name, self.corners(), self.own_constraints, self.coordinates, q, pose=pose
            )
        elif pose is None:
            check_in_motion(name, self.corners(), q, v, margin=self.margin)

    @property
    def coordinates(self) -> Coordinates:
        """Planning coordinates of the arm: the joints, or those of the simplified model."""
        return self._coordinates

    @property
    def undercarriage(self) -> Undercarriage:
        """Undercarriage of the machine, which stands or drives."""
        return self._undercarriage

    @property
    def own_constraints(self) -> tuple[PathConstraint, ...]:
        """Path constraints that the user gave, and the bounds on the lumped mass if given."""
        given: tuple[PathConstraint, ...] = self.constraints
        return given if self.distance_limits is None else (*given, self.distance_limits)

    @property
    def path_constraints(self) -> tuple[PathConstraint, ...]:
        """All path constraints: tip-over, contact, then `own_constraints`."""
        return (TipOver(self.margin), Contact(), *self.own_constraints)

    def corners(self, *, every: bool = False) -> tuple[Corner, ...]:
        """Extremes of payload and slope for which the motion must be safe; one if all is certain.

        Args:
            every: Whether to return all corners that a proof needs; otherwise only those that the
                search needs.
        """
        return self._corners_of(self.machine, self.ground, every=every)

    def _corners_of(
        self, machine: Machine, ground: Ground, *, every: bool = False
    ) -> tuple[Corner, ...]:
        """Corners of this problem's uncertainties for another machine or ground."""
        return corners(
            machine,
            ground,
            tipping_fraction=self.tipping_fraction,
            payload_uncertainty=self.payload_uncertainty,
            slope_uncertainty=self.slope_uncertainty,
            payload_com_uncertainty=self.payload_com_uncertainty,
            every=every,
        )

    def gravity_at(self, side: str) -> Array:
        """Gravity in the root frame at the "start" or the "goal", shape (3,) [m/s^2]."""
        return gravity_at(self.undercarriage, self.ground, side)


def check_model(model: object) -> None:
    """Refuse what is not in `MODELS`.

    Raises:
        ProblemError: Unknown model.
    """
    if model not in MODELS:
        raise ProblemError(f"unknown model {model!r}; models are {', '.join(MODELS)}")
