"""What the planner and the certificate ask of a path constraint.

A path constraint is a value that the user passes to `Problem(constraints=[...])`. Bound to a
machine it gives rows. In the nonlinear program the rows are evaluated in normalised time s = t / T
on a `StageSample`; in the certificate they are evaluated in seconds on a `MotionSample` and bounded
between samples by a `Stretch`. All constraints share these samples, and with them one inverse
dynamics per state.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.bounds.effort_bounds import EffortBound
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine

__all__ = [
    "ConstraintRows",
    "MotionSample",
    "PathConstraint",
    "StageModel",
    "StageSample",
    "Stretch",
]


class StageModel(Protocol):
    """A machine at one corner of payload and slope, in n planning coordinates and normalised time.

    With w = dq/ds, alpha = d^2q/ds^2 and S = T^2, efforts times S are affine in (alpha, S) and
    quadratic in w.
    """

    @property
    def machine(self) -> Machine:
        """The machine with this corner's payload."""

    @property
    def size(self) -> int:
        """Number n of planning coordinates."""

    @property
    def coordinates(self) -> Coordinates:
        """From the planning coordinates (without those of a base) to the joints."""

    def efforts(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> Array:
        """S times wrench and, if the model has them, joint efforts, shape (K, R).

        Args:
            q, w, alpha: Coordinates and their derivatives by s, shape (K, n) each.
            S: Squared duration [s^2].
            positions: Of a base on uneven ground, shape (K, 2) [m]; None where they do not matter.
        """

    def effort_derivatives(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> tuple[Array, Array]:
        """S times the efforts, (K, R), with their Jacobian by (q, w, alpha, S, and positions if
        there are any), shape (K, R, 3n + 1 [+ 2]).

        Args:
            q, w, alpha, S, positions: Arguments of `efforts`.
        """


@dataclass(frozen=True, eq=False)
class StageSample:
    """K states in normalised time, at which all rows of one corner are evaluated.

    Attributes:
        model: Gives the efforts.
        q, w, alpha: Planning coordinates and their derivatives by s, shape (K, n) each.
        S: Squared duration [s^2].
        positions: Of a base on uneven ground, shape (K, 2) [m], or None.
    """

    model: StageModel
    q: Array
    w: Array
    alpha: Array
    S: float
    positions: Array | None = None

    @cached_property
    def efforts(self) -> Array:
        """S times wrench and joint efforts, shape (K, R); computed once, whoever asks."""
        if "effort_derivatives" in self.__dict__:
            return self.effort_derivatives[0]
        return self.model.efforts(self.q, self.w, self.alpha, self.S, self.positions)

    @cached_property
    def effort_derivatives(self) -> tuple[Array, Array]:
        """Efforts with their Jacobian, see `StageModel.effort_derivatives`; computed once."""
        return self.model.effort_derivatives(self.q, self.w, self.alpha, self.S, self.positions)


@dataclass(frozen=True, slots=True, eq=False)
class MotionSample:
    """K states of a motion in seconds.

    Attributes:
        machine: The machine with this corner's payload.
        q, v, a: Joint coordinates, rates and accelerations, shape (K, n) each [rad or m, s].
        efforts: Ground reaction wrench, then joint efforts if a constraint needs them, shape
            (K, R) [N, N m].
    """

    machine: Machine
    q: Array
    v: Array
    a: Array
    efforts: Array

    def __getitem__(self, states: Any) -> MotionSample:
        """Some of the states, by an index, slice or mask."""
        parts = (part[states] for part in (self.q, self.v, self.a, self.efforts))
        return MotionSample(self.machine, *parts)


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """K stretches of a motion, on which efforts are close to polynomials of time.

    Joint states are there for rows that are not `EffortRows`; for others they have no columns.

    Attributes:
        start, end: States at the ends.
        length: Shape (K,) [s].
        reach, v, a, j: Largest |coordinate|, |rate|, |acceleration| and |jerk| of the joints inside,
            shape (K, n) each.
        interpolation: How far efforts inside may be from the polynomials; it vanishes as stretches
            get shorter.
        rounding: How far computed efforts may be from exact ones, however short the stretch.
        control: Control points (Bernstein coefficients) of the polynomials, shape (n + 1, K, R).
            The polynomials lie in their convex hulls. The first and the last are the efforts at the
            ends.
    """

    start: MotionSample
    end: MotionSample
    length: Array
    reach: Array
    v: Array
    a: Array
    j: Array
    interpolation: EffortBound
    rounding: EffortBound
    control: Array


class ConstraintRows(Protocol):
    """R rows of a constraint that is bound to a machine at one corner.

    In the nonlinear program a row is S times its value, scaled to order one, not positive where the
    constraint holds. In the certificate a row's value is the room that it leaves in its own unit,
    not negative where the constraint holds.
    """

    @property
    def labels(self) -> tuple[str, ...]:
        """What each row limits, in words; several rows may share a label."""

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each row's room."""

    @property
    def resolution(self) -> Array:
        """Room by which a guarantee may fall short of the samples, in each row's unit, (R,)."""

    @property
    def proven(self) -> bool:
        """Whether `least_between` holds; otherwise the rows are only sampled."""

    @property
    def per_corner(self) -> bool:
        """Whether the rows depend on payload or slope; otherwise one corner is enough."""

    @property
    def needs_joint_efforts(self) -> bool:
        """Whether the rows read joint efforts beside the ground reaction wrench."""

    def evaluate(self, sample: StageSample) -> Array:
        """Rows in normalised time, shape (K, R)."""

    def linearize(self, sample: StageSample) -> tuple[Array, Array]:
        """Rows with their Jacobian by (q, w, alpha, S), shapes (K, R) and (K, R, 3n + 1 [+ 2])."""

    def curvature(self, sample: StageSample, weights: Array) -> Array:
        """Hessian of `weights . rows` by (q, w, alpha, S), shape (K, 3n + 1, 3n + 1).

        Args:
            sample: K states.
            weights: Shape (K, R).
        """

    def tightened(self, amount: float) -> ConstraintRows:
        """The rows with the limit drawn in by an amount in their own unit."""

    def room(self, sample: MotionSample) -> Array:
        """Room that each row leaves, in its own unit, shape (K, R); -inf where it has no value."""

    def least_between(self, stretch: Stretch, ends: Array) -> tuple[Array, Array]:
        """Guaranteed room inside each stretch, and the most that shorter stretches could give.

        Args:
            stretch: K stretches.
            ends: The lesser of the rooms at their two ends, shape (K, R).

        Returns:
            Shapes (K, R) each.
        """


@runtime_checkable
class PathConstraint(Protocol):
    """A constraint along the whole motion, as the user passes it."""

    @property
    def name(self) -> str:
        """Its name in guarantees and scenario files."""

    def rows(self, machine: Machine, coordinates: Coordinates) -> ConstraintRows:
        """The rows for a machine.

        Args:
            machine: With a corner's payload.
            coordinates: From planning coordinates to joints.

        Raises:
            ProblemError: The machine lacks what the constraint needs; the message says what.
        """
