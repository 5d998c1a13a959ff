"""Bounds on the distance of the simplified model's lumped mass from the slew axis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from zmp_sqp.arrays import Array, finite_number
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.limits import JointLimits
from zmp_sqp.mechanics.lumped_mass import LumpedMass
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.planning.constraints.protocol import MotionSample, StageSample, Stretch

__all__ = ["DistanceLimits", "DistanceRows", "boom_limits"]

SIMPLIFIED = ("slew", "boom")  # the coordinates of the simplified model
BOOM = 1  # column of the boom angle, among the joints and among the simplified coordinates
GUARD = 1e-6  # of the limits, kept inside them so that the certificate need not be tight
RESOLUTION = 1e-4  # of the limits, by which a guarantee may fall short of the samples
ROUNDING = 1e-12  # of the limits
LEAST_COSINE = 1e-2  # of the boom angle where the distance hardly depends on it


@dataclass(frozen=True, slots=True)
class DistanceLimits:
    """The paper's bounds on the lumped mass, in place of those of boom, stick and levelling joint.

    The paper tightens them by hand until the joints keep their own limits. The same is asked of the
    user: a plan whose joints exceed their own limits is not successful.

    Attributes:
        velocity: Largest |d'| [m/s].
        acceleration: Largest |d''| [m/s^2].
        lower: Least d [m].
        upper: Largest d [m].

    Raises:
        ProblemError: Not positive, not finite, or lower above upper.
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
                raise ProblemError(f"distance limit {name} must be positive, not {value}")
        if self.lower > self.upper:
            raise ProblemError(
                f"distance limits contradict each other: lower {self.lower} m, upper {self.upper} m"
            )

    def rows(self, machine: Machine, coordinates: Coordinates) -> DistanceRows:
        """Rows |d'| <= velocity and |d''| <= acceleration; lower and upper bound the boom angle.

        Raises:
            ProblemError: The coordinates are not those of the simplified model.
        """
        if coordinates.size != len(SIMPLIFIED):
            raise ProblemError('distance_limits belong to model="simplified"')
        return DistanceRows(
            LumpedMass.of(machine, coordinates),
            np.array([self.velocity, self.acceleration]),
            drawn_in=GUARD * np.array([self.velocity, self.acceleration]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class DistanceRows:
    r"""Rows :math:`\pm d' \le v` and :math:`\pm d'' \le a` for d = A - B sin(boom).

    In normalised time, with w and alpha the boom's derivatives by s and d_i the i-th derivative of d
    by the boom angle,

    .. math:: \pm d_1 w - v \sqrt S \le 0, \quad \pm (d_1 \alpha + d_2 w^2) - a S \le 0

    each divided by its limit.

    Attributes:
        lumped: The distance as a function of the boom angle.
        limits: v and a, shape (2,) [m/s, m/s^2].
        drawn_in: By how much the program stays inside them, shape (2,).
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
        """Room by which a guarantee may fall short of the samples, shape (4,)."""
        return np.tile(RESOLUTION * self.limits, 2)

    def evaluate(self, sample: StageSample) -> Array:
        """Rows in normalised time, shape (K, 4)."""
        return self.linearize(sample)[0]

    def linearize(self, sample: StageSample) -> tuple[Array, Array]:
        """Rows with their Jacobian, shapes (K, 4) and (K, 4, 3n + 1)."""
        count, n = sample.q.shape
        boom, rate, push = (part[:, BOOM] for part in (sample.q, sample.w, sample.alpha))
        sqrt_S = np.sqrt(sample.S)
        first, second, third = self.lumped.derivatives(boom)
        by_state = np.zeros((count, 2, 3 * n + 1))
        by_state[:, 0, BOOM], by_state[:, 0, n + BOOM] = second * rate, first
        by_state[:, 1, BOOM] = second * push + third * rate**2
        by_state[:, 1, n + BOOM] = 2.0 * second * rate
        by_state[:, 1, 2 * n + BOOM] = first
        values = np.column_stack([first * rate, first * push + second * rate**2])
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
        r"""Hessian of `weights . rows` in closed form, shape (K, 3n + 1, 3n + 1).

        .. math:: \nabla^2 (d_1 w): \; d_3 w, d_2; \quad
                  \nabla^2 (d_1 \alpha + d_2 w^2): \;
                  d_3 \alpha + d_4 w^2, 2 d_3 w, d_2, 2 d_2

        entries by (q, q), (q, w), then (q, alpha), (w, w).
        """
        count, n = sample.q.shape
        H = np.zeros((count, 3 * n + 1, 3 * n + 1))
        boom, rate, push = (part[:, BOOM] for part in (sample.q, sample.w, sample.alpha))
        _, second, third = self.lumped.derivatives(boom)
        fourth = -second  # d is a sine of the boom angle
        of_rate, of_acceleration = ((weights[:, :2] - weights[:, 2:]) / self.limits).T
        by_boom, by_rate, by_push = BOOM, n + BOOM, 2 * n + BOOM
        H[:, by_boom, by_boom] = of_rate * third * rate
        H[:, by_boom, by_boom] += of_acceleration * (third * push + fourth * rate**2)
        mixed = of_rate * second + 2.0 * of_acceleration * third * rate
        H[:, by_boom, by_rate] = H[:, by_rate, by_boom] = mixed
        H[:, by_boom, by_push] = H[:, by_push, by_boom] = of_acceleration * second
        H[:, by_rate, by_rate] = 2.0 * of_acceleration * second
        share = 1.0 - self.drawn_in[0] / self.limits[0]
        # of the square root of S in the rate's bound
        H[:, -1, -1] = 0.25 * share * (weights[:, 0] + weights[:, 2]) / sample.S**1.5
        return H

    def tightened(self, amount: float) -> DistanceRows:
        """The rows with both limits lower by an amount [m/s, m/s^2]."""
        return replace(self, drawn_in=self.drawn_in + amount)

    def room(self, sample: MotionSample) -> Array:
        """Limits less the distance's rate and acceleration of either sign, shape (K, 4)."""
        boom, rate, push = (part[:, BOOM] for part in (sample.q, sample.v, sample.a))
        _, first, second = self.lumped.motion(boom, rate, push)
        values = np.column_stack([first, second])
        return np.hstack([self.limits - values, self.limits + values])

    def least_between(self, stretch: Stretch, ends: Array) -> tuple[Array, Array]:
        r"""Room at the ends less delta^2 / 8 times a bound on the rows' second derivatives.

        .. math:: |d'''| \le B (j + 3 v a + v^3), \quad
                  |d''''| \le B (4 v j + 3 a^2 + 6 v^2 a + v^4)
        """
        v, a, j = (part[:, BOOM] for part in (stretch.v, stretch.a, stretch.j))
        third = j + 3.0 * v * a + v**3
        fourth = 4.0 * v * j + 3.0 * a**2 + 6.0 * v**2 * a + v**4
        bend = self.lumped.B * np.column_stack([third, fourth])
        sag = np.tile(0.125 * stretch.length[:, None] ** 2 * bend, 2)
        reachable = ends - ROUNDING * np.tile(self.limits, 2)
        return reachable - sag, reachable


def boom_limits(lumped: LumpedMass, bounds: DistanceLimits, joints: JointLimits) -> JointLimits:
    """Limits of (slew, boom) that the bounds on d imply, generously; the slew keeps its own.

    With |cos q_2| >= c on the range of d: |q_2'| <= v / (B c) and |q_2''| <= (a + B q_2'^2) / (B c).
    """
    reachable = np.clip([bounds.lower, bounds.upper], lumped.A - lumped.B, lumped.A + lumped.B)
    upper, lower = (float(angle) for angle in lumped.boom(reachable))
    lower = max(lower, float(joints.position_lower[BOOM]))
    upper = min(upper, float(joints.position_upper[BOOM]))
    least = lumped.B * max(min(np.cos(lower), np.cos(upper)), LEAST_COSINE)
    rate = bounds.velocity / least
    acceleration = (bounds.acceleration + lumped.B * rate**2) / least
    changes = {
        "velocity": [joints.velocity[0], rate],
        "acceleration": [joints.acceleration[0], acceleration],
        "position_lower": [joints.position_lower[0], lower],
        "position_upper": [joints.position_upper[0], upper],
    }
    return joints.updated(changes, SIMPLIFIED)
