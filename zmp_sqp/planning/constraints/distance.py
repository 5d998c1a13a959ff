"""Bounds on the distance of the simplified model's lumped mass from the slew axis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from zmp_sqp.arrays import Array, distinct_texts, finite_number
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.limits import JointLimits
from zmp_sqp.mechanics.lumped_mass import LumpedMass
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.planning.constraints.protocol import MotionSample, StageSample, Stretch

__all__ = ["DistanceLimits", "DistanceRows", "boom_limits"]

SIMPLIFIED = ("slew", "boom")  # coordinates of the simplified model
BOOM = 1  # column of the boom angle, both among the joints and among `SIMPLIFIED`
GUARD = 1e-6  # share of the limits by which the program is stricter, so that its proof is short
RESOLUTION = 1e-4  # share of the limits by which a guarantee may fall short of the least sample
ROUNDING = 1e-12  # share of the limits that bounds rounding errors of d' and d''
# least cosine of the boom angle in `boom_limits`: with the boom level, d hardly depends on it, and
# bounds on d would allow unlimited boom rates
LEAST_COSINE = 1e-2


@dataclass(frozen=True, slots=True)
class DistanceLimits:
    """Bounds on the distance d of the lumped mass from the slew axis (Song & Sharf 2020, eq. (20)).

    In the program they replace the limits of boom, stick and levelling joint, except the position
    limits of the boom. The authors tighten them by hand until the joints stay within their own
    limits, and so must the user: a plan whose joints exceed their limits has no success, with
    `Status.JOINT_LIMITS`.

    Attributes:
        velocity: Largest |d'| [m/s].
        acceleration: Largest |d''| [m/s^2].
        lower: Least d [m].
        upper: Largest d [m].

    Raises:
        ProblemError: A number is not finite, velocity or acceleration is not positive, or lower is
            above upper.
    """

    velocity: float
    acceleration: float
    lower: float = 0.0
    upper: float = 1e3
    name = "distance_limits"

    def __post_init__(self) -> None:
        for name in ("velocity", "acceleration", "lower", "upper"):
            value = finite_number(
                getattr(self, name), name=f"distance limit {name}", error=ProblemError
            )
            object.__setattr__(self, name, value)
            if name in ("velocity", "acceleration") and value <= 0.0:
                raise ProblemError(f"distance limit {name} must be positive, not {value:g}")
        if self.lower > self.upper:
            lower, upper = distinct_texts(self.lower, self.upper)
            raise ProblemError(
                f"distance limit lower must not be above upper, but is {lower} m above {upper} m"
            )

    def rows(self, machine: Machine, coordinates: Coordinates) -> DistanceRows:
        """Rows |d'| <= velocity and |d''| <= acceleration.

        `lower` and `upper` need no rows: they are limits of the boom angle, see `boom_limits`.

        Raises:
            ProblemError: The coordinates are not those of the simplified model.
        """
        if coordinates.size != len(SIMPLIFIED):
            raise ProblemError('distance_limits need model="simplified"')
        return DistanceRows(
            LumpedMass.of(machine, coordinates),
            np.array([self.velocity, self.acceleration]),
            drawn_in=GUARD * np.array([self.velocity, self.acceleration]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class DistanceRows:
    r"""Rows of `DistanceLimits`, |d'| <= v and |d''| <= a, for d = A - B sin(boom).

    In normalised time s = t / T, with S = T^2, the derivatives w and alpha of the boom angle by s,
    and the i-th derivative d_i of d by the boom angle, the four rows are

    .. math:: \pm d_1 w - v \sqrt S \le 0, \quad \pm (d_1 \alpha + d_2 w^2) - a S \le 0

    each divided by its limit v or a. Order: +d', +d'', -d', -d''.

    Attributes:
        lumped: Distance of the lumped mass as a function of the boom angle.
        limits: v and a, shape (2,) [m/s, m/s^2].
        drawn_in: Amounts by which the limits in the program are lower, shape (2,) [m/s, m/s^2].
    """

    lumped: LumpedMass
    limits: Array
    drawn_in: Array
    labels = ("distance rate", "distance acceleration") * 2
    units = ("m/s", "m/s^2") * 2
    proven = True
    per_corner = False
    tolerance = 2e-7
    needs_joint_efforts = False

    @property
    def resolution(self) -> Array:
        """Room by which a guarantee may fall short of the least sample, (4,) [m/s, m/s^2]."""
        return np.tile(RESOLUTION * self.limits, 2)

    def evaluate(self, sample: StageSample) -> Array:
        """Rows in normalised time, shape (K, 4)."""
        return self.linearize(sample)[0]

    def linearize(self, sample: StageSample) -> tuple[Array, Array]:
        """Rows with their Jacobian by (q, w, alpha, S), shapes (K, 4) and (K, 4, 3n + 1)."""
        count, n = sample.q.shape
        boom, w, alpha = (part[:, BOOM] for part in (sample.q, sample.w, sample.alpha))
        sqrt_S = np.sqrt(sample.S)
        first, second, third = self.lumped.derivatives(boom)
        by_state = np.zeros((count, 2, 3 * n + 1))
        by_state[:, 0, BOOM], by_state[:, 0, n + BOOM] = second * w, first
        by_state[:, 1, BOOM] = second * alpha + third * w**2
        by_state[:, 1, n + BOOM] = 2.0 * second * w
        by_state[:, 1, 2 * n + BOOM] = first
        values = np.column_stack([first * w, first * alpha + second * w**2])  # (K, 2)
        velocity, acceleration = self.limits - self.drawn_in
        bounds, by_S = (
            np.array([velocity * sqrt_S, acceleration * sample.S]),
            np.zeros(by_state.shape[1:]),
        )
        by_S[:, -1] = 0.5 * velocity / sqrt_S, acceleration
        scale = np.tile(self.limits, 2)
        rows = np.hstack([values - bounds, -values - bounds]) / scale
        return rows, np.concatenate([by_state - by_S, -by_state - by_S], axis=1) / scale[:, None]

    def curvature(self, sample: StageSample, weights: Array) -> Array:
        r"""Hessian of `weights . rows` by (q, w, alpha, S) in closed form, (K, 3n + 1, 3n + 1).

        Its nonzero entries are, with q the boom angle,

        .. math::
            f = d_1 w: \quad & f_{qq} = d_3 w, \; f_{qw} = d_2 \\
            g = d_1 \alpha + d_2 w^2: \quad & g_{qq} = d_3 \alpha + d_4 w^2, \;
            g_{qw} = 2 d_3 w, \; g_{q\alpha} = d_2, \; g_{ww} = 2 d_2

        and the second derivative of the bound -v sqrt(S) by S.
        """
        count, n = sample.q.shape
        H = np.zeros((count, 3 * n + 1, 3 * n + 1))
        boom, w, alpha = (part[:, BOOM] for part in (sample.q, sample.w, sample.alpha))
        _, second, third = self.lumped.derivatives(boom)
        fourth = -second  # because d is a constant plus a sine
        of_rate, of_acceleration = ((weights[:, :2] - weights[:, 2:]) / self.limits).T
        at_q, at_w, at_alpha = BOOM, n + BOOM, 2 * n + BOOM
        H[:, at_q, at_q] = of_rate * third * w
        H[:, at_q, at_q] += of_acceleration * (third * alpha + fourth * w**2)
        mixed = of_rate * second + 2.0 * of_acceleration * third * w
        H[:, at_q, at_w] = H[:, at_w, at_q] = mixed
        H[:, at_q, at_alpha] = H[:, at_alpha, at_q] = of_acceleration * second
        H[:, at_w, at_w] = 2.0 * of_acceleration * second
        share = 1.0 - self.drawn_in[0] / self.limits[0]
        H[:, -1, -1] = 0.25 * share * (weights[:, 0] + weights[:, 2]) / sample.S**1.5
        return H

    def tightened(self, amount: float) -> DistanceRows:
        """Rows whose limits are both lower by an amount [m/s and m/s^2]."""
        return replace(self, drawn_in=self.drawn_in + amount)

    def room(self, sample: MotionSample) -> Array:
        """Room v - d', a - d'', v + d', a + d'', shape (K, 4) [m/s, m/s^2]."""
        boom, rate, acceleration = (part[:, BOOM] for part in (sample.q, sample.v, sample.a))
        _, first, second = self.lumped.motion(boom, rate, acceleration)
        values = np.column_stack([first, second])
        return np.hstack([self.limits - values, self.limits + values])

    def least_between(self, stretch: Stretch, ends: Array) -> tuple[Array, Array]:
        r"""Lower bound on the room inside each stretch, see `ConstraintRows.least_between`.

        It is the room at the ends less delta^2 / 8 times a bound on the second time derivative of
        each row, with the stretch's length delta and the largest rate v, acceleration a and jerk j
        of the boom inside:

        .. math:: |d'''| \le |B| (j + 3 v a + v^3), \quad
                  |d''''| \le |B| (4 v j + 3 a^2 + 6 v^2 a + v^4)
        """
        v, a, j = (part[:, BOOM] for part in (stretch.v, stretch.a, stretch.j))
        third = j + 3.0 * v * a + v**3
        fourth = 4.0 * v * j + 3.0 * a**2 + 6.0 * v**2 * a + v**4
        bend = abs(self.lumped.B) * np.column_stack([third, fourth])
        sag = np.tile(0.125 * stretch.length[:, None] ** 2 * bend, 2)
        reachable = ends - ROUNDING * np.tile(self.limits, 2)
        return reachable - sag, reachable


def boom_limits(lumped: LumpedMass, bounds: DistanceLimits, joints: JointLimits) -> JointLimits:
    """Limits of (slew, boom) that contain all motions within the bounds on the lumped mass.

    With |cos q_2| >= c over the range of d, the bounds imply |q_2'| <= v / (|B| c) and
    |q_2''| <= (a + |B| q_2'^2) / (|B| c). The rows of `DistanceRows` are the stricter ones. The
    slew keeps its own limits.

    Args:
        lumped: Distance of the lumped mass as a function of the boom angle.
        bounds: Bounds on the distance.
        joints: Limits of the machine's joints.
    """
    B = abs(lumped.B)
    reachable = np.clip([bounds.lower, bounds.upper], lumped.A - B, lumped.A + B)
    lower, upper = sorted(float(angle) for angle in lumped.boom(reachable))
    lower = max(lower, float(joints.position_lower[BOOM]))
    upper = min(upper, float(joints.position_upper[BOOM]))
    least = B * max(min(np.cos(lower), np.cos(upper)), LEAST_COSINE)  # [m/rad] of |d_1|
    rate = bounds.velocity / least
    acceleration = (bounds.acceleration + B * rate**2) / least
    changes = {
        "velocity": [joints.velocity[0], rate],
        "acceleration": [joints.acceleration[0], acceleration],
        "position_lower": [joints.position_lower[0], lower],
        "position_upper": [joints.position_upper[0], upper],
    }
    return joints.updated(changes, SIMPLIFIED)
