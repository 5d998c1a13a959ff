r"""Polynomials of time that stand in for inverse dynamics, with a bound on their error.

Accelerations are polynomials of time within an interval, so that efforts are entire functions of
time there. A function f that is bounded by :math:`M(\rho)` on the ellipse with the semi-axes
:math:`\tau (\rho \pm 1/\rho) / 2` about a piece of the length :math:`2 \tau` differs from the
polynomial p of degree n through its values at n + 1 Chebyshev points by at most

.. math:: |f - p| \le \frac{4 M(\rho)}{\rho^n (\rho - 1)} \quad \text{for every } \rho > 1

(Trefethen 2019, Approximation Theory and Approximation Practice, Theorem 8.2; the proof uses that a
Chebyshev polynomial of a degree above n takes the values of one up to n, or minus these, or zero at
the points, which holds for the roots that are used here, too). `effort_size` gives
:math:`M(\rho)`. For times :math:`t_c + z` on the ellipse, :math:`|z| \le A` and
:math:`|\mathrm{Im} z| \le B` with its semi-axes A and B, hence for a coordinate with the rate v,
acceleration a and jerk j at the centre

.. math:: |\mathrm{Im} q| \le B (|v| + A |a| + A^2 |j| / 2)

Where accelerations are cubics, :math:`A^3 |s| / 6 + A^4 |c| / 24` with the snap s and the crackle c
joins the terms in the brackets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import comb

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.mechanics.bounds.effort_bounds import EffortBound
from zmp_sqp.mechanics.bounds.effort_norms import BodyNorms, Norms, body_norms, effort_size
from zmp_sqp.mechanics.bounds.payload_spread import joint_shares, moment_of_spread
from zmp_sqp.mechanics.ground import GRAVITY
from zmp_sqp.motion.root_motion import root_motion_bounds
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.proof.corner_efforts import CornerEfforts, gravity_of
from zmp_sqp.planning.proof.joint_peaks import joint_peaks
from zmp_sqp.planning.proof.subdivision import Mask

__all__ = ["EffortCurves", "control_points"]

DEGREES = (3, 4, 5, 6, 7, 8, 9, 10)  # degrees of polynomials that are tried, the least first
# [m] largest error of a polynomial, as an error of the zero moment point's distance from an edge
TOLERANCE = 4e-7
# factor on the resolution of constraints: tighter guarantees cost little, because stretches of
# polynomials take no inverse dynamics
FINENESS = 0.02
# values of rho that are tried; the largest is for motions at rest, where efforts are constant
ELLIPSES = np.append(np.geomspace(3.0, 96.0, 8), 1e9)
MOST_PIECES = 16_000  # largest number of pieces, which limits time and memory
MOST_CUTS = 16  # largest number of parts into which a piece is cut at once
# rounding errors that add up in an effort: at most ten per joint and factor, with room to spare
OPERATIONS = 100.0
EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """P pieces of the motion, with bounds on the errors of polynomials of each degree.

    Attributes:
        interval: Interval of each piece, shape (P,).
        since: Start of each piece after the start of its interval, shape (P,) [s].
        length: Length of each piece, shape (P,) [s].
        terms: Bound on the sum of the absolute values of all terms of the efforts, shape (P,).
        size: Bound on the efforts inside, shape (P,).
        remainder: Bound on the error of the polynomial of each of `DEGREES`, shape (D, P).
    """

    interval: Indices
    since: Array
    length: Array
    terms: EffortBound
    size: EffortBound
    remainder: EffortBound


@dataclass(frozen=True, slots=True, eq=False)
class EffortCurves:
    """Polynomials for the efforts at C corners along P pieces of a motion, see `MotionEfforts`.

    Attributes:
        efforts: Inverse dynamics that the polynomials approximate.
        interval: Interval of each piece, shape (P,).
        since: Start of each piece after the start of its interval, shape (P,) [s].
        length: Length of each piece, shape (P,) [s].
        values: Values of the polynomials at n + 1 Chebyshev points, shape (n + 1, P C, R).
        error: Bound on the difference between polynomials and exact efforts, shape (P,) if all
            corners have the same, otherwise (P C,).
        is_vague: Whether rounding errors on each piece have no finite bound, shape (P,).
        exhausted: Whether there are `MOST_PIECES` pieces, so that errors may be large.
    """

    efforts: CornerEfforts
    interval: Indices
    since: Array
    length: Array
    values: Array
    error: EffortBound
    is_vague: Mask
    exhausted: bool
    fineness = FINENESS

    @classmethod
    def of(cls, efforts: CornerEfforts) -> EffortCurves:
        """Polynomials with errors below `TOLERANCE`, unless this takes too many pieces."""
        corners, trajectory = efforts.corners, efforts.trajectory
        bodies = body_norms([corner.machine for corner in corners])
        weight = sum(body.mass for body in bodies) * GRAVITY
        grounds = {id(corner.ground): corner.ground for corner in corners}.values()
        strength = max(float(np.linalg.norm(gravity_of(ground))) for ground in grounds)
        support = corners[0].machine.support
        reach = 1.0 if support is None else 1.0 + support.reach + abs(support.height)
        pieces, chosen = _good_pieces(
            bodies, trajectory, strength, TOLERANCE * weight, reach, joints=efforts.joints
        )
        if len(corners) > 1:  # one degree for all pieces: the values need not be rearranged
            chosen = np.full(len(chosen), chosen.max())
        rounding = _rounding(pieces, efforts, chosen)
        error = rounding.plus(pieces.remainder[chosen, np.arange(len(chosen))])
        if any(corner.spread > 0.0 for corner in corners):
            error = _with_spread(error, efforts, pieces)
        values = _values(efforts, pieces, chosen)
        return cls(
            efforts,
            pieces.interval,
            pieces.since,
            pieces.length,
            values,
            error,
            ~(np.isfinite(rounding.force) & np.isfinite(rounding.moment)),
            len(pieces.interval) >= MOST_PIECES,
        )

    @property
    def first_parts(self) -> Indices:
        """One stretch per piece."""
        return np.ones(len(self.interval), dtype=int)

    def at(self, corner: int, interval: Indices, since: Array) -> Array:
        """Efforts of one corner by inverse dynamics, shape (K, R)."""
        alone = replace(self.efforts, corners=[self.efforts.corners[corner]])
        return np.asarray(alone.at(interval, since)[:, 0])

    def stretches(
        self, corner: Indices, piece: Indices, share: Array, length: Array
    ) -> tuple[Array, EffortBound, EffortBound]:
        """Control points on K stretches and their error; see `MotionEfforts.stretches`."""
        number = piece * len(self.efforts.corners) + corner
        if len(number) == self.values.shape[1] and (length == 1.0).all():
            control = control_points(self.values)
        else:
            control = control_points(self.values[:, number], share, length)
        error = self.error[piece if len(self.error.force) == len(self.interval) else number]
        none = EffortBound(0.0 * error.force, 0.0 * error.moment, 0.0 * error.joints)
        return control, none, error


def control_points(values: Array, share: Array | None = None, length: Array | None = None) -> Array:
    """Control points (Bernstein coefficients) of K polynomials on parts of their pieces.

    A polynomial lies in the convex hull of its control points, of which the first and the last are
    its values at the ends.

    Args:
        values: At the Chebyshev points of the pieces, shape (n + 1, K, R).
        share: Start of each part, as a share of its piece, shape (K,); None for whole pieces.
        length: Length of each part, as a share of its piece, shape (K,); None for whole pieces.

    Returns:
        Shape (n + 1, K, R).
    """
    n, shape = len(values) - 1, values.shape
    if share is None or length is None:
        return (_bernstein(n) @ _to_powers(n) @ values.reshape(n + 1, -1)).reshape(shape)
    coefficients = (_to_powers(n) @ values.reshape(n + 1, -1)).reshape(shape)
    centre, half, orders = 2.0 * share + length - 1.0, length, np.arange(n + 1)
    # w = centre + half x: the coefficient of x^i holds comb(j, i) centre^(j - i) half^i of w^j
    powers = centre[:, None] ** orders
    shift = _binomials(n) * powers[:, np.maximum(orders - orders[:, None], 0)]  # (K, i, j)
    shift *= (half[:, None] ** orders)[:, :, None]
    moved = _bernstein(n) @ shift @ coefficients.transpose(1, 0, 2)
    return np.ascontiguousarray(moved.transpose(1, 0, 2))


def _good_pieces(
    bodies: Sequence[BodyNorms],
    trajectory: Trajectory,
    strength: float,
    tolerance: float,
    reach: float,
    *,
    joints: bool,
) -> tuple[_Pieces, Indices]:
    """Pieces on which a polynomial of one of the degrees is good enough.

    Args:
        bodies: Norms of the machine's bodies, see `body_norms`.
        trajectory: The motion.
        strength: Norm of gravity [m/s^2].
        tolerance: Largest error of the moment, and of the force times `reach` [N m].
        reach: Largest distance of an edge from the root origin [m].
        joints: Whether to bound the joints' efforts too.

    Returns:
        The pieces, and for each the index of the least degree that is good enough, shape (P,).
    """
    parts = np.ones(trajectory.intervals, dtype=int)
    while True:
        pieces = _pieces(bodies, trajectory, strength, parts, joints=joints)
        missed = np.maximum(pieces.remainder.moment, reach * pieces.remainder.force)  # (D, P)
        good = missed <= tolerance
        chosen = np.where(good.any(axis=0), good.argmax(axis=0), len(DEGREES) - 1)
        if good[-1].all() or len(pieces.interval) >= MOST_PIECES:
            return pieces, chosen
        cuts = np.ceil((2.0 * missed[-1] / tolerance) ** (1.0 / (DEGREES[-1] + 1)))
        cuts = np.where(good[-1], 1, np.clip(cuts, 2, MOST_CUTS)).astype(int)
        wanted = parts * np.maximum.reduceat(cuts, np.cumsum(parts) - parts)
        if wanted.sum() > MOST_PIECES:
            room = (MOST_PIECES - parts.sum()) / (wanted.sum() - parts.sum())
            wanted = parts + np.ceil(room * (wanted - parts)).astype(int)
        parts = wanted


def _pieces(
    bodies: Sequence[BodyNorms],
    trajectory: Trajectory,
    strength: float,
    parts: Indices,
    *,
    joints: bool,
) -> _Pieces:
    """Pieces of intervals that are cut into equal parts, N numbers `parts`, with their bounds."""
    interval = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(interval)) - np.repeat(np.cumsum(parts) - parts, parts)
    steps = np.diff(trajectory.times)
    length = (steps / parts)[interval]
    since = number * length
    # row 0 is for rounding, see `_norms`
    A = np.vstack([steps[interval], 0.25 * np.outer(ELLIPSES + 1.0 / ELLIPSES, length)])
    B = np.vstack([0.0 * length, 0.25 * np.outer(ELLIPSES - 1.0 / ELLIPSES, length)])
    norms = _norms(bodies, trajectory, interval, since + 0.5 * length, A, B, strength)
    found = effort_size(bodies, norms, joints=joints)
    shape = len(A), len(interval)
    force, moment = (_known(part.reshape(shape)) for part in (found.force, found.moment))
    of_joints = _known(found.joints.reshape(*shape, -1))
    factor = 4.0 / (ELLIPSES ** np.array(DEGREES)[:, None] * (ELLIPSES - 1.0))  # (D, E)
    remainder = EffortBound(
        (factor[:, :, None] * force[1:]).min(axis=1),
        (factor[:, :, None] * moment[1:]).min(axis=1),
        (factor[:, :, None, None] * of_joints[1:]).min(axis=1),
    )
    terms, size = (EffortBound(force[i], moment[i], of_joints[i]) for i in (0, 1))
    return _Pieces(interval, since, length, terms, size, remainder)


def _norms(
    bodies: Sequence[BodyNorms],
    trajectory: Trajectory,
    interval: Indices,
    centre: Array,
    A: Array,
    B: Array,
    strength: float,
) -> Norms:
    """Norms of the motion at all complex times on ellipses about the pieces' centres.

    Row 0 is for rounding instead. States are computed from the start of the interval, so that its
    norms are sums of the absolute values of all terms, v_0 + h a_0 + h^2 j_0 / 2 and so on. Those
    of a base are taken about the centre with twice the length, which exceeds them.

    Args:
        bodies: Norms of the machine's bodies.
        trajectory: The motion.
        interval: Interval of each piece, shape (P,).
        centre: Centre of each piece after the start of its interval, shape (P,) [s].
        A: Real semi-axes, but the length of the interval in row 0, shape (E, P) [s].
        B: Imaginary semi-axes, but zero in row 0, shape (E, P) [s].
        strength: Norm of gravity [m/s^2].

    Returns:
        Norms with K = E P columns.
    """
    rows = zip(
        _derivatives(trajectory, interval, 0.0 * centre),
        _derivatives(trajectory, interval, centre),
        strict=True,
    )
    q, v, a, j, *higher = (
        np.concatenate([first, np.broadcast_to(other, (len(first), len(A) - 1, A.shape[1]))], 1)
        for first, other in rows
    )  # (n, E, P)
    n, zero = len(q), np.zeros(A.size)
    change = A * j
    rate = A * (0.5 * change + a) + v
    if higher:
        s, c = higher
        change = change + A**2 * (0.5 * s + A * c / 6.0)
        rate = rate + A**3 * (s / 6.0 + A * c / 24.0)
    reach = q + A * rate if any(body.slides for body in bodies) else rate  # else not used
    parts = (B * rate, reach, rate, a + change)
    imaginary, reach, rate, acceleration = (part.reshape(n, -1) for part in parts)
    of_joints = imaginary, reach, rate, acceleration
    if trajectory.base is None:
        return Norms(*of_joints, zero, zero, zero + strength)
    peak = trajectory.base.peaks(interval, centre, 0.0 * centre)  # (2, 3, P)
    A = np.vstack([2.0 * A[:1], A[1:]])
    (speed, acceleration_s, jerk), (spin, turn, yaw_jerk) = peak
    speed = speed + A * (acceleration_s + 0.5 * A * jerk)
    spin = spin + A * (turn + 0.5 * A * yaw_jerk)
    # the acceleration along the heading, the centripetal one, and gravity, which rotates by -yaw
    along = acceleration_s + A * jerk
    root_acceleration = along + speed * spin + strength * np.exp(B * spin)
    return Norms(*of_joints, spin.ravel(), (turn + A * yaw_jerk).ravel(), root_acceleration.ravel())


def _derivatives(trajectory: Trajectory, interval: Indices, since: Array) -> tuple[Array, ...]:
    """Absolute values of q and its derivatives at times in intervals, shape (n, 1, P) each."""
    state = *trajectory.state_in(interval, since), *trajectory.higher_in(interval, since)
    return tuple(np.ascontiguousarray(np.abs(part).T)[:, None] for part in state)


def _values(efforts: CornerEfforts, pieces: _Pieces, chosen: Indices) -> Array:
    """Values of the polynomials at the Chebyshev points of the highest degree, (n + 1, P C, R).

    Args:
        efforts: Inverse dynamics at C corners.
        pieces: The P pieces.
        chosen: Index of the degree of each piece, shape (P,).
    """
    groups = [(DEGREES[i], np.flatnonzero(chosen == i)) for i in np.unique(chosen)]
    at, since = [], []
    for degree, group in groups:
        shares = 0.5 * (1.0 + _points(degree))[:, None]  # (n + 1, 1)
        at.append(np.tile(group, degree + 1))
        since.append((pieces.since[group] + shares * pieces.length[group]).ravel())
    where = np.concatenate(at)
    computed = efforts.at(pieces.interval[where], np.concatenate(since))  # (K, C, R)
    most, shape = groups[-1][0], computed.shape[1:]
    if len(groups) == 1:
        return computed.reshape(most + 1, -1, shape[-1])
    found, first = np.empty((most + 1, len(chosen), *shape)), 0
    for degree, group in groups:
        last = first + (degree + 1) * len(group)
        part = _resampled(degree, most) @ computed[first:last].reshape(degree + 1, -1)
        found[:, group] = part.reshape(most + 1, len(group), *shape)
        first = last
    return found.reshape(most + 1, -1, shape[-1])


def _rounding(pieces: _Pieces, efforts: CornerEfforts, chosen: Indices) -> EffortBound:
    """Bound on the rounding errors of computed efforts and of the polynomials' control points.

    Errors are relative to the sum of the absolute values of all terms. The rounding error of an
    angle rotates all links beyond its joint.
    """
    trajectory, coupling = efforts.trajectory, efforts.corners[0].machine.coupling
    h = np.diff(trajectory.times)[pieces.interval]
    ends = trajectory.positions[:-1], trajectory.velocities[:-1], trajectory.accelerations
    q, v, a = (np.abs(part)[pieces.interval] for part in ends)
    j, h = np.abs(trajectory.jerks[pieces.interval]), h[:, None]
    reach = q + h * (v + h * (0.5 * a + h * j / 6.0))  # all terms of the coordinates
    if trajectory.snaps is not None:
        s, c = (np.abs(part)[pieces.interval] for part in (trajectory.snaps, trajectory.crackles))
        reach = reach + h**4 * (s / 24.0 + h * c / 120.0)
    turned = coupling.largest_positions(reach).sum(axis=1)
    if (base := trajectory.base) is not None:
        (_, (spin, _, _)) = base.peaks(pieces.interval, 0.0 * pieces.since, h[:, 0])
        turned = turned + np.abs(base.poses[pieces.interval, 2]) + h[:, 0] * spin
    # differences between corners take up to three times as many operations again
    operations = OPERATIONS * (1.0 + turned) * (1.0 if len(efforts.corners) == 1 else 4.0)
    none = EffortBound(0.0 * turned, 0.0 * turned, 0.0 * pieces.terms.joints)
    computed = none.plus(pieces.terms, EPSILON * operations)
    found = computed.plus(pieces.size, EPSILON * _operations(DEGREES[int(chosen.max())]))
    return EffortBound(_known(found.force), _known(found.moment), _known(found.joints))


def _with_spread(error: EffortBound, efforts: CornerEfforts, pieces: _Pieces) -> EffortBound:
    """Error at each corner, shape (P C,), with the effect of `moment_of_spread` added.

    Args:
        error: Error without this effect, shape (P,).
        efforts: Efforts at the corners.
        pieces: Pieces of the motion.
    """
    machine, trajectory = efforts.corners[0].machine, efforts.trajectory
    _, v, a, _ = joint_peaks(trajectory, pieces.interval, pieces.since, pieces.length)
    base = None
    if trajectory.base is not None:
        base = root_motion_bounds(
            trajectory.base, pieces.interval, pieces.since, pieces.length, height=0.0
        )
    of_one = moment_of_spread(machine, v, a, spread=1.0, base=base)
    spreads = np.array([corner.spread for corner in efforts.corners])
    off = _known(np.outer(of_one, spreads)).ravel()
    joints = np.repeat(error.joints, len(spreads), axis=0)
    return EffortBound(
        np.repeat(error.force, len(spreads)),
        np.repeat(error.moment, len(spreads)) + off,
        joints + off[:, None] * joint_shares(machine) if efforts.joints else joints,
    )


def _known(bounds: Array) -> Array:
    """Bounds that are infinite where their computation gave NaN."""
    return np.where(np.isnan(bounds), np.inf, bounds)


@cache
def _points(degree: int) -> Array:
    """Roots of the Chebyshev polynomial of the next degree, shape (degree + 1,)."""
    return np.asarray(np.cos((2.0 * np.arange(degree + 1) + 1.0) * np.pi / (2.0 * degree + 2.0)))


@cache
def _to_powers(degree: int) -> Array:
    """Matrix from values at the Chebyshev points to coefficients of powers of w."""
    values = np.polynomial.chebyshev.chebvander(_points(degree), degree)
    # discrete orthogonality: column k of the values has the squared norm (degree + 1) / 2
    to_chebyshev = (2.0 / (degree + 1.0)) * values.T
    to_chebyshev[0] *= 0.5
    return np.asarray(_chebyshev_powers(degree) @ to_chebyshev)


def _chebyshev_powers(degree: int) -> Array:
    """Coefficients of powers in row i of Chebyshev polynomial k in column k: exact integers.

    By T_{k+1} = 2 w T_k - T_{k-1}; numpy's `cheb2poly` takes milliseconds for the same numbers.
    """
    powers = np.eye(degree + 1)
    for k in range(1, degree):
        powers[1:, k + 1] = 2.0 * powers[:-1, k]
        powers[:, k + 1] -= powers[:, k - 1]
    return powers


@cache
def _resampled(degree: int, most: int) -> Array:
    """Matrix from values at the Chebyshev points of one degree to those of a higher degree."""
    powers = _points(most)[:, None] ** np.arange(degree + 1)
    return np.asarray(powers @ _to_powers(degree)) if degree < most else np.eye(most + 1)


@cache
def _operations(degree: int) -> float:
    """Rounding error of control points, in units of machine precision times the largest value.

    Powers of w are at most one, on the piece and after the shift to a part of it, and each sum has
    `degree` + 1 terms, so that the coefficients decide.
    """
    resampled = 3.0  # upper bound on the Lebesgue constants of all degrees; 2.5 for degree 10
    return float(12.0 * resampled * (degree + 1.0) * np.abs(_to_powers(degree)).sum())


@cache
def _bernstein(degree: int) -> Array:
    """Matrix from coefficients of powers of w, with w in [-1, 1], to control points.

    Control point i of w^j is the mean of the products of j of the numbers that hold i times 1 and
    degree - i times -1.
    """
    found = np.empty((degree + 1, degree + 1))
    for i in range(degree + 1):
        for j in range(degree + 1):
            chosen = range(max(0, j - degree + i), min(i, j) + 1)
            total = sum(comb(i, k) * comb(degree - i, j - k) * (-1) ** (j - k) for k in chosen)
            found[i, j] = total / comb(degree, j)
    return found


@cache
def _binomials(degree: int) -> Array:
    """Binomial coefficients comb(j, i) in row i and column j."""
    return np.array([[float(comb(j, i)) for j in range(degree + 1)] for i in range(degree + 1)])
