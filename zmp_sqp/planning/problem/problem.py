"""The question: from where to where, on which ground, with which margin."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, frozen_array, shortened
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.ground import Ground, Slope
from zmp_sqp.mechanics.lumped_mass import simplified_coordinates
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.uncertainty import Corner, com_box, corners
from zmp_sqp.planning.constraints.binding import checked_constraints
from zmp_sqp.planning.constraints.distance import DistanceLimits
from zmp_sqp.planning.constraints.protocol import PathConstraint
from zmp_sqp.planning.constraints.tip_over import Contact, TipOver
from zmp_sqp.planning.problem.checks import (
    UNCERTAINTIES,
    check_boundary_state,
    check_limits,
    check_simplified,
    checked_intervals,
    checked_margin,
    checked_share,
)
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

LEVEL = Slope()
MODELS = ("full", "simplified")
STATES = ("start", "goal", "start_velocity", "goal_velocity")


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
        constraints: Path constraints beside tip-over and the joint limits, such as `TorqueLimits()`.

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
    constraints: Any = ()
    _coordinates: Coordinates = field(init=False, repr=False)
    _undercarriage: Undercarriage = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.machine, Machine):
            raise ProblemError(
                f"machine must be a Machine (see load_machine), not {type(self.machine).__name__}"
            )
        if isinstance(self.ground, type) or not isinstance(self.ground, Ground):
            raise ProblemError(
                f"ground must have a gravity(yaw) as Slope has, not {shortened(self.ground)}"
            )
        for name in STATES:
            self._set(name, self._state(name))
        self._set("intervals", checked_intervals(self.intervals, self.machine.size))
        if self.model not in MODELS:
            raise ProblemError(f"unknown model {self.model!r}; there is {', '.join(MODELS)}")
        check_limits(self.machine)
        self._set("margin", checked_margin(self.margin, self.machine))
        self._set("_undercarriage", undercarriage_of(self.base, self.ground))
        self._undercarriage.check(self.machine, self.model)
        for name, lower, upper in UNCERTAINTIES:
            self._set(name, checked_share(name, getattr(self, name), lower, upper))
        name = "payload_com_uncertainty"
        self._set(name, com_box(getattr(self, name), name=name))
        self._set("constraints", checked_constraints(self.constraints))
        self._set("_coordinates", self._planned())
        for name in ("start", "goal"):
            self._check_boundary(name)

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def _state(self, name: str) -> Array:
        """Joint coordinates or rates at the start or the goal, checked; rates default to rest."""
        given, joints = getattr(self, name), self.machine.joint_names
        if given is None and name.endswith("velocity"):
            given = np.zeros(len(joints))
        shape = (len(joints),)
        return frozen_array(given, name=name, shape=shape, error=ProblemError, labels=joints)

    def _planned(self) -> Coordinates:
        """What is planned: the joints, or the coordinates of the simplified model."""
        given = self.distance_limits
        if given is not None and self.model != "simplified":
            raise ProblemError('distance_limits belong to model="simplified"')
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
        """Refuse a start or goal that breaks a limit or a constraint whatever the motion."""
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
        """What is planned: the joints, or the coordinates of the simplified model."""
        return self._coordinates

    @property
    def undercarriage(self) -> Undercarriage:
        """The undercarriage, which stands or drives."""
        return self._undercarriage

    @property
    def own_constraints(self) -> tuple[PathConstraint, ...]:
        """Path constraints beside tip-over: the user's, and bounds on the lumped mass."""
        given: tuple[PathConstraint, ...] = self.constraints
        return given if self.distance_limits is None else (*given, self.distance_limits)

    @property
    def path_constraints(self) -> tuple[PathConstraint, ...]:
        """All path constraints, tip-over and contact first."""
        return (TipOver(self.margin), Contact(), *self.own_constraints)

    def corners(self, *, every: bool = False) -> tuple[Corner, ...]:
        """Extremes of payload and slope that the motion must be safe for; one if all is certain.

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

    def gravity_at(self, side: str) -> Array:
        """Gravity in the root frame at the "start" or the "goal", shape (3,) [m/s^2]."""
        return gravity_at(self.undercarriage, self.ground, side)
