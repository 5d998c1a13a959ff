"""Constraints that a user writes in a file of his own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, shortened
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.planning.constraints.protocol import MotionSample, StageSample, Stretch

__all__ = ["PathRows", "UserRows"]

Function = Callable[[Machine, Array, Array, Array], tuple[Any, Any]]
CurvatureBound = Callable[[Machine, Array, Array, Array], Any]

GUARD = 1e-6  # of the scale, kept inside the constraint so that rounding does not break it
RESOLUTION = 1e-3  # of the scale, by which a guarantee may fall short of the samples
ROUNDING = 1e-9  # of the scale, which stands for the rounding errors of a function unknown to us
# by how much the room may pass the user's bound, relative to both bound and scale: rounding, and
# far less than a wrong formula
SLACK = 1e-7
DIFFERENCE = 1e-6  # forward step on the user's Jacobian; variables are of order one


@dataclass(frozen=True, slots=True, eq=False)
class PathRows:
    r"""A path constraint of the user's own: values(q, v, a) <= 0 at all times.

    The function works in physical units and knows nothing of normalised time. For a limit on the
    height of the second link, say::

        def below_the_wires(machine, q, v, a):
            height = 3.0 * np.cos(q[:, 1])
            jacobian = np.zeros((len(q), 1, 3 * machine.size))
            jacobian[:, 0, 1] = -3.0 * np.sin(q[:, 1])
            return (height - 2.5)[:, None], jacobian

        zs.Problem(..., constraints=[zs.PathRows("wires", below_the_wires, labels=["height"])])

    The planner holds the rows at the nodes and in the middle of every interval. With
    `curvature_bound` the certificate proves them for all times, as far as that bound is right; one
    that the motion itself refutes is an error. Without, the certificate looks at the rows 2000
    times a second, and says so: the guarantee has `proven=False`.

    Attributes:
        name: What guarantees, messages and tables call the constraint.
        function: From machine, q, v, a (shape (K, n) each, in rad or m and s) to values (K, R), at
            most zero where the constraint holds, and their Jacobian by q, v, a, shape (K, R, 3n).
            Under uncertainty it is called with the machine of each corner.
        labels: What each row limits, R words; None numbers them.
        curvature_bound: Bound on |d^2 value / dt^2|: a number, R numbers, or a function of machine
            and the largest |rates|, |accelerations| and |jerks| of the joints in K stretches of
            time, shape (K, n) each, that returns the bound, shape (K, R).
        units: Unit of each row's value; None leaves them out.
        scale: Typical size of the values; the planner divides rows by it, to bring them to order
            one.

    Raises:
        ProblemError: No name, nothing to call, labels or units that are not lists of texts, or a
            scale that is not positive.
    """

    name: str
    function: Function
    labels: Sequence[str] | None = None
    curvature_bound: Any = None
    units: Sequence[str] | None = None
    scale: float = 1.0

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise ProblemError(f"a constraint needs a name, not {shortened(self.name)}")
        if not callable(self.function):
            raise ProblemError(
                f"constraint {self.name!r} needs a function(machine, q, v, a), "
                f"not {shortened(self.function)}"
            )
        for what in ("labels", "units"):
            given = getattr(self, what)
            if given is not None:
                object.__setattr__(self, what, _texts(given, f"{what} of constraint {self.name!r}"))
        scale = finite_number(
            self.scale, name=f"scale of constraint {self.name!r}", error=ProblemError
        )
        if scale <= 0.0:
            raise ProblemError(f"scale of constraint {self.name!r} must be positive, not {scale}")
        object.__setattr__(self, "scale", scale)

    def rows(self, machine: Machine, coordinates: Coordinates) -> UserRows:
        """Rows for a machine, with one call of the function that tells how many there are.

        Raises:
            ProblemError: Values, Jacobian or curvature bound have the wrong shape, or labels or
                units another number.
        """
        still = np.zeros((1, machine.size))
        values, _ = self.values(machine, still, still, still)
        count = values.shape[1]
        if self.curvature_bound is not None:
            self.bend(machine, still, still, still, count)
        named = [f"row {i}" for i in range(count)] if self.labels is None else list(self.labels)
        units = [""] * count if self.units is None else list(self.units)
        for what, found in (("labels", named), ("units", units)):
            if len(found) != count:
                raise ProblemError(
                    f"constraint {self.name!r} has {count} rows, but {len(found)} {what}"
                )
        return UserRows(self, machine, coordinates.G, tuple(named), tuple(units))

    def values(self, machine: Machine, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Values (K, R) and Jacobian (K, R, 3n), checked.

        Raises:
            ProblemError: The function raised, or its results have the wrong shape, or the Jacobian
                is not finite where the values are.
        """
        try:
            # copies: other constraints see the same states, whatever the function does to its own
            values, jacobian = self.function(machine, q.copy(), v.copy(), a.copy())
            values, jacobian = (np.asarray(part, dtype=float) for part in (values, jacobian))
        except Exception as cause:
            raise ProblemError(
                f"constraint {self.name!r}: its function failed: {cause!r}"
            ) from cause
        count, n = q.shape
        if values.ndim != 2 or len(values) != count:
            raise ProblemError(
                f"constraint {self.name!r}: values must have shape ({count}, R), not {values.shape}"
            )
        if values.shape[1] == 0:
            raise ProblemError(f"constraint {self.name!r}: its function gives no rows")
        expected = (count, values.shape[1], 3 * n)
        if jacobian.shape != expected:
            raise ProblemError(
                f"constraint {self.name!r}: the Jacobian must have shape {expected}, "
                f"not {jacobian.shape}"
            )
        if (np.isfinite(values) & ~np.isfinite(jacobian).all(axis=2)).any():
            raise ProblemError(
                f"constraint {self.name!r}: the Jacobian must be finite where the values are"
            )
        return values, jacobian

    def bend(self, machine: Machine, v: Array, a: Array, j: Array, rows: int) -> Array:
        """The user's bound on |d^2 value / dt^2| in K stretches, shape (K, rows), checked.

        Args:
            machine: With a corner's payload.
            v, a, j: Largest |rates|, |accelerations| and |jerks|, shape (K, n) each.
            rows: Number of rows.

        Raises:
            ProblemError: The bound raised, or has the wrong shape, or is negative or NaN.
        """
        bound, what = self.curvature_bound, f"constraint {self.name!r}: its curvature_bound"
        if callable(bound):
            try:
                bound = bound(machine, v.copy(), a.copy(), j.copy())
            except Exception as cause:
                raise ProblemError(f"{what} failed: {cause!r}") from cause
        try:
            found = np.broadcast_to(np.asarray(bound, dtype=float), (len(v), rows))
        except (TypeError, ValueError):
            raise ProblemError(
                f"{what} must give {rows} numbers per stretch, not {shortened(bound)}"
            ) from None
        # motions that overflow prove nothing, but are no fault of the bound's
        if not (found >= 0.0).all() and all(np.isfinite(part).all() for part in (v, a, j)):
            raise ProblemError(f"{what} must not be negative or nan, but is {shortened(bound)}")
        return found


@dataclass(frozen=True, slots=True, eq=False)
class UserRows:
    r"""Rows of a `PathRows` in normalised time, S times values(q, w / sqrt(S), alpha / S) / scale.

    Attributes:
        given: The constraint.
        machine: The machine of this corner.
        G: Joint coordinates by planning coordinates (without those of a base), shape (n_joints, m).
        labels, units: Of the rows.
        drawn_in: By how much the program stays inside, in the rows' unit.
    """

    given: PathRows
    machine: Machine
    G: Array
    labels: tuple[str, ...]
    units: tuple[str, ...]
    drawn_in: float = 0.0
    per_corner = True
    tolerance = 2e-7
    needs_joint_efforts = False

    @property
    def proven(self) -> bool:
        """Whether the user gave a bound on curvature."""
        return self.given.curvature_bound is not None

    @property
    def resolution(self) -> Array:
        """Room by which a guarantee may fall short of the samples, shape (R,)."""
        return np.full(len(self.labels), RESOLUTION * self.given.scale)

    def evaluate(self, sample: StageSample) -> Array:
        """Rows in normalised time, shape (K, R)."""
        S = np.full(len(sample.q), sample.S)
        return self._linearize(sample, sample.q, sample.w, sample.alpha, S)[0]

    def linearize(self, sample: StageSample) -> tuple[Array, Array]:
        """Rows with their Jacobian, shapes (K, R) and (K, R, 3n + 1 [+ 2])."""
        S = np.full(len(sample.q), sample.S)
        rows, jacobian = self._linearize(sample, sample.q, sample.w, sample.alpha, S)
        if sample.positions is not None:
            by_position = np.zeros((*rows.shape, sample.positions.shape[1]))
            jacobian = np.concatenate([jacobian, by_position], axis=2)
        return rows, jacobian

    def curvature(self, sample: StageSample, weights: Array) -> Array:
        """Hessian of `weights . rows` by forward differences of the Jacobian."""
        count, n = sample.q.shape
        steps = DIFFERENCE * np.vstack([np.zeros(3 * n + 1), np.eye(3 * n + 1)])
        state = np.column_stack([sample.q, sample.w, sample.alpha, np.full(count, sample.S)])
        shifted = (state[:, None] + steps).reshape(-1, 3 * n + 1)
        parts = (shifted[:, :n], shifted[:, n : 2 * n], shifted[:, 2 * n : 3 * n], shifted[:, -1])
        _, jacobian = self._linearize(sample, *parts)
        jacobian = jacobian.reshape(count, len(steps), -1, 3 * n + 1)
        gradient = np.einsum("kr,kprj->kpj", weights, jacobian)
        H = (gradient[:, 1:] - gradient[:, :1]) / DIFFERENCE
        return np.asarray(0.5 * (H + H.transpose(0, 2, 1)))

    def tightened(self, amount: float) -> UserRows:
        """The rows with the limit drawn in by an amount in their unit."""
        return replace(self, drawn_in=self.drawn_in + amount)

    def room(self, sample: MotionSample) -> Array:
        """Minus the values, shape (K, R)."""
        values, _ = self._values(sample.q, sample.v, sample.a)
        return np.where(np.isfinite(values), -values, -np.inf)

    def _values(self, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Values (K, R) and Jacobian (K, R, 3n) of the user's function.

        Raises:
            ProblemError: The function failed, or gives another number of rows than before.
        """
        values, jacobian = self.given.values(self.machine, q, v, a)
        if values.shape[1] != len(self.labels):
            raise ProblemError(
                f"constraint {self.given.name!r}: its function gives {values.shape[1]} rows for "
                f"{len(q)} states, and {len(self.labels)} rows for one state: it must always give "
                "the same rows, also those that are kept"
            )
        return values, jacobian

    def least_between(self, stretch: Stretch, ends: Array) -> tuple[Array, Array]:
        """Room at the ends less delta^2 / 8 times the user's bound on curvature.

        Raises:
            ProblemError: The room in the middle of a stretch refutes the user's bound.
        """
        bend = self.given.bend(self.machine, stretch.v, stretch.a, stretch.j, len(self.labels))
        reachable = ends - ROUNDING * self.given.scale
        sag = 0.125 * stretch.length[:, None] ** 2 * bend
        self._check_sag(stretch, sag)
        return np.where(np.isnan(sag), -np.inf, reachable - sag), reachable

    def _check_sag(self, stretch: Stretch, sag: Array) -> None:
        """Compare the room in the middle of K stretches with the bound that the user promises.

        Args:
            stretch: K stretches of motions with linear accelerations.
            sag: Largest distance of the room inside from its chord that the bound allows, (K, R).

        Raises:
            ProblemError: The room is further below its chord than that.
        """
        room = np.stack([self.room(at) for at in (stretch.start, _middle(stretch), stretch.end)])
        below = 0.5 * (room[0] + room[2]) - room[1]
        excess = below - (1.0 + SLACK) * sag - SLACK * self.given.scale
        excess[~np.isfinite(room).all(axis=0) | np.isnan(sag)] = -np.inf
        k, row = np.unravel_index(int(excess.argmax()), excess.shape)
        if excess[k, row] > 0.0:
            bends, allowed = (8.0 * part[k, row] / stretch.length[k] ** 2 for part in (below, sag))
            unit = f" {self.units[row]}/s^2" if self.units[row] else " per s^2"
            raise ProblemError(
                f"constraint {self.given.name!r}: its curvature_bound is too small: within "
                f"{stretch.length[k]:.3g} s of this motion {self.labels[row]} bends by "
                f"{bends:.4g}{unit} in the mean, and the bound there is {allowed:.4g}. Correct the "
                "bound, or leave it out: the constraint is then only sampled"
            )

    def _linearize(
        self, sample: StageSample, q: Array, w: Array, alpha: Array, S: Array
    ) -> tuple[Array, Array]:
        """Rows and Jacobian by (q, w, alpha, S) at K states with squared durations S (K,)."""
        count, n = q.shape
        joints = self.machine.size
        G = np.zeros((joints, n))  # a base's own coordinates move no joint
        G[:, : self.G.shape[1]] = self.G
        sqrt_S = np.sqrt(S)[:, None]
        coordinates, arm = sample.model.coordinates, slice(0, self.G.shape[1])
        rate, acceleration = w / sqrt_S, alpha / S[:, None]
        values, by_state = self._values(
            coordinates.joints(q[:, arm]),
            coordinates.rates(rate[:, arm]),
            coordinates.rates(acceleration[:, arm]),
        )
        values = values + self.drawn_in + GUARD * self.given.scale
        by_q, by_v, by_a = (by_state[:, :, i * joints : (i + 1) * joints] @ G for i in range(3))
        jacobian = np.empty((count, values.shape[1], 3 * n + 1))
        scale = S[:, None, None]
        jacobian[:, :, :n] = scale * by_q
        jacobian[:, :, n : 2 * n] = sqrt_S[:, :, None] * by_v
        jacobian[:, :, 2 * n : 3 * n] = by_a
        # S r(q, w / sqrt(S), alpha / S) by S
        by_S = values - 0.5 * np.einsum("krj,kj->kr", by_v, rate)
        jacobian[:, :, -1] = by_S - np.einsum("krj,kj->kr", by_a, acceleration)
        return S[:, None] * values / self.given.scale, jacobian / self.given.scale


def _middle(stretch: Stretch) -> MotionSample:
    """States in the middle of K stretches whose accelerations are linear in time."""
    start, end, h = stretch.start, stretch.end, stretch.length[:, None]
    q = 0.5 * (start.q + end.q) + 0.125 * h * (start.v - end.v)
    v = 0.5 * (start.v + end.v) + 0.125 * h * (start.a - end.a)
    return replace(start, q=q, v=v, a=0.5 * (start.a + end.a))


def _texts(given: Any, name: str) -> tuple[str, ...]:
    """A list of texts as a tuple.

    Raises:
        ProblemError: It is no list, or an entry is no text.
    """
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise ProblemError(f"{name} must be a list of texts, not {shortened(given)}")
    for text in given:
        if not isinstance(text, str):
            raise ProblemError(f"{name} must be texts, not {shortened(text)}")
    return tuple(given)
