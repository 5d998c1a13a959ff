"""Protocol of path constraints, as the nonlinear program and the certificate use them.

A path constraint is a value that the user passes to `Problem(constraints=[...])`. For a machine it
gives rows. The nonlinear program evaluates the rows in normalised time s = t / T on a
`StageSample`. The certificate evaluates them in seconds on a `MotionSample`, and bounds them
between samples on a `Stretch`. All constraints share these samples, so that inverse dynamics are
computed once per state.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.cached import cached_property
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
    """Dynamics of a machine at one corner of payload and slope, in normalised time s = t / T.

    With n planning coordinates q, w = dq/ds, alpha = d^2q/ds^2 and the squared duration S = T^2,
    the efforts times S are affine in (alpha, S) and quadratic in w.
    """

    @property
    def machine(self) -> Machine:
        """The machine with this corner's payload."""

    @property
    def size(self) -> int:
        """Number n of planning coordinates."""

    @property
    def joint_efforts(self) -> bool:
        """Whether the efforts include the joint efforts."""

    @property
    def coordinates(self) -> Coordinates:
        """Map from planning coordinates, without those of a base, to joint coordinates."""

    def efforts(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> Array:
        """S times the ground reaction wrench, then S times the joint efforts if included, (K, R).

        Args:
            q, w, alpha: Planning coordinates and their derivatives by s, shape (K, n) each.
            S: Squared duration [s^2].
            positions: Positions (x, y) of a base on uneven ground, shape (K, 2) [m]; None for any
                other base.
        """

    def effort_derivatives(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> tuple[Array, Array]:
        """S times the efforts, with their Jacobian.

        Args:
            q, w, alpha, S, positions: Arguments of `efforts`.

        Returns:
            Efforts times S, shape (K, R), and their Jacobian by (q, w, alpha, S), shape
            (K, R, 3n + 1); with positions, by (q, w, alpha, S, x, y), shape (K, R, 3n + 3).
        """

    def wrench_hessian(
        self, q: Array, w: Array, alpha: Array, S: float, weights: Array
    ) -> Array | None:
        """Hessian of weights . S (f, tau) by (q, w, alpha, S) in closed form, if there is one.

        Args:
            q, w, alpha, S: Arguments of `efforts`.
            weights: Weights of the six rows of the wrench, shape (K, 6).

        Returns:
            Symmetric matrices, shape (K, 3n + 1, 3n + 1); None where there is no closed form.
        """


@dataclass(frozen=True, eq=False)
class StageSample:
    """K states in normalised time, at which all rows of one corner are evaluated.

    Attributes:
        model: Dynamics of the machine at the corner.
        q, w, alpha: Planning coordinates and their derivatives by s, shape (K, n) each.
        S: Squared duration [s^2].
        positions: Positions (x, y) of a base on uneven ground, shape (K, 2) [m]; None for any other
            base.
    """

    model: StageModel
    q: Array
    w: Array
    alpha: Array
    S: float
    positions: Array | None = None

    def at(self, some: Indices) -> StageSample:
        """Sample of some of the states, with their derivatives if these are known."""
        positions = None if self.positions is None else self.positions[some]
        found = StageSample(
            self.model, self.q[some], self.w[some], self.alpha[some], self.S, positions
        )
        if "effort_derivatives" in self.__dict__:
            efforts, jacobian = self.effort_derivatives
            found.__dict__["effort_derivatives"] = efforts[some], jacobian[some]
        return found

    @cached_property
    def efforts(self) -> Array:
        """S times the efforts, see `StageModel.efforts`; computed once for all constraints."""
        if "effort_derivatives" in self.__dict__:
            return self.effort_derivatives[0]
        return self.model.efforts(self.q, self.w, self.alpha, self.S, self.positions)

    @cached_property
    def effort_derivatives(self) -> tuple[Array, Array]:
        """Efforts and Jacobian, see `StageModel.effort_derivatives`; computed once for all."""
        return self.model.effort_derivatives(self.q, self.w, self.alpha, self.S, self.positions)


@dataclass(frozen=True, slots=True, eq=False)
class MotionSample:
    """K states of a motion in seconds, at which all rows of one corner are evaluated.

    Attributes:
        machine: The machine with the corner's payload.
        q, v, a: Joint coordinates, rates and accelerations, shape (K, n) each [rad or m, s].
        efforts: Ground reaction wrench about the root origin, root axes, then joint efforts if a
            constraint needs them, shape (K, R) [N, N m].
    """

    machine: Machine
    q: Array
    v: Array
    a: Array
    efforts: Array

    def __getitem__(self, states: Any) -> MotionSample:
        """Some of the states, by indices, slice or mask."""
        parts = (part[states] for part in (self.q, self.v, self.a, self.efforts))
        return MotionSample(self.machine, *parts)


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """K stretches of time of a motion, with what bounds the rows between their two ends.

    Joint states have no columns where the rows are `EffortRows`, which need none.

    Attributes:
        start, end: States at the ends.
        length: Durations, shape (K,) [s].
        reach, v, a, j: Largest |coordinate|, |rate|, |acceleration| and |jerk| of each joint
            inside, shape (K, n) each [rad or m, s].
        interpolation: Bound on the difference between the efforts inside and polynomials of time
            with the given control points; it vanishes as stretches get shorter.
        rounding: Bound on the error of computed efforts, however short the stretch.
        control: Control points (Bernstein coefficients) of these polynomials, shape (n + 1, K, R).
            A polynomial lies in the convex hull of its control points; the first and the last are
            the efforts at the ends.
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
    """R rows of a constraint, for a machine at one corner of payload and slope.

    In the nonlinear program, a row is S times its value, scaled to order one; it is at most zero
    where the constraint is satisfied. In the certificate, a row is the room that it leaves, in its
    own unit; it is at least zero where the constraint is satisfied.
    """

    @property
    def labels(self) -> tuple[str, ...]:
        """Quantity that each row limits, in words; several rows may share a label."""

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each row's room."""

    @property
    def resolution(self) -> Array:
        """Room by which a guarantee may fall short of the least sample, each unit, shape (R,)."""

    @property
    def tolerance(self) -> float:
        """Largest violation of a scaled row at a solution, which the rows' guard makes up for."""

    @property
    def proven(self) -> bool:
        """Whether `least_between` is a proof; otherwise the rows are only sampled."""

    @property
    def per_corner(self) -> bool:
        """Whether the rows depend on payload or slope; otherwise one corner is checked."""

    @property
    def needs_joint_efforts(self) -> bool:
        """Whether the rows need joint efforts beside the ground reaction wrench."""

    def evaluate(self, sample: StageSample) -> Array:
        """Rows in normalised time, shape (K, R)."""

    def linearize(self, sample: StageSample) -> tuple[Array, Array]:
        """Rows with their Jacobian.

        Returns:
            Rows, shape (K, R), and their Jacobian by (q, w, alpha, S), shape (K, R, 3n + 1); rows
            that depend on positions give (K, R, 3n + 3), see `StageModel.effort_derivatives`.
        """

    def curvature(self, sample: StageSample, weights: Array) -> Array:
        """Hessian of `weights . rows` by (q, w, alpha, S), shape (K, 3n + 1, 3n + 1).

        Args:
            sample: K states.
            weights: Multiplier of each row, shape (K, R).
        """

    def tightened(self, amount: float) -> ConstraintRows:
        """Rows whose limits are stricter by an amount in their own unit."""

    def room(self, sample: MotionSample) -> Array:
        """Room that each row leaves, in its own unit, shape (K, R); -inf where it has no value."""

    def least_between(self, stretch: Stretch, ends: Array) -> tuple[Array, Array]:
        """Lower bound on the room inside each stretch.

        Args:
            stretch: K stretches.
            ends: Lesser of the rooms at the two ends of each stretch, shape (K, R).

        Returns:
            The bound, and the bound that a stretch of no length would give, shape (K, R) each.
        """


@runtime_checkable
class PathConstraint(Protocol):
    """Constraint along a whole motion, as the user passes it to `Problem`."""

    @property
    def name(self) -> str:
        """Name of the constraint in guarantees, messages and scenario files."""

    def rows(self, machine: Machine, coordinates: Coordinates) -> ConstraintRows:
        """Rows of the constraint for a machine.

        Args:
            machine: Machine with a corner's payload.
            coordinates: Map from planning coordinates to joint coordinates.

        Raises:
            ProblemError: The machine lacks what the constraint needs; the message says what.
        """
