"""Constraints that are affine in the efforts of inverse dynamics."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.bounds.effort_bounds import EffortBound
from zmp_sqp.mechanics.wrench import WRENCH
from zmp_sqp.planning.constraints.protocol import MotionSample, StageModel, StageSample, Stretch

__all__ = ["EffortRows", "effort_curvature"]

# [rad, m] forward step on analytic derivatives: its error, of first order in the step, is far
# below what the SQP needs of curvature
DIFFERENCE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class EffortRows:
    r"""Rows that are affine in the efforts: :math:`(C e) / d + c \le 0`.

    In normalised time, where efforts times S come from inverse dynamics with gravity scaled by S,

    .. math:: (C\, e_S) / d + c\, S \le 0

    so that Jacobians are C times those of the efforts, curvature is one difference of their weighted
    sum, and a bound between samples follows from bounds on efforts.

    Attributes:
        C: Shape (R, 6), or (R, 6 + n) with the joints' efforts.
        c: Shape (R,).
        divisor: d, which scales rows to order one, shape (R,).
        labels: What each row limits, in words.
        units: Unit of each row's room, which is -(C e + c d).
        resolution: Room by which a guarantee may fall short of the samples, shape (R,).
    """

    C: Array
    c: Array
    divisor: Array
    labels: tuple[str, ...]
    units: tuple[str, ...]
    resolution: Array
    proven = True
    per_corner = True

    @property
    def needs_joint_efforts(self) -> bool:
        """Whether C has columns for the joints."""
        return bool(self.C.shape[1] > WRENCH)

    def matrix(self, columns: int) -> Array:
        """C / d with zero columns added for efforts that are not looked at, shape (R, columns)."""
        padded = np.zeros((len(self.C), columns))
        padded[:, : self.C.shape[1]] = self.C
        return padded

    def evaluate(self, sample: StageSample) -> Array:
        """Rows in normalised time, shape (K, R)."""
        rows = self.matrix(sample.efforts.shape[1]) / self.divisor[:, None]
        return np.asarray(sample.efforts @ rows.T + sample.S * self.c)

    def linearize(self, sample: StageSample) -> tuple[Array, Array]:
        """Rows with their Jacobian, shapes (K, R) and (K, R, 3n + 1 [+ 2])."""
        effort, jacobian = sample.effort_derivatives
        rows = self.matrix(effort.shape[1]) / self.divisor[:, None]
        by_state = rows @ jacobian
        by_state[:, :, 3 * sample.model.size] += self.c
        return effort @ rows.T + sample.S * self.c, by_state

    def curvature(self, sample: StageSample, weights: Array) -> Array:
        """Hessian of `weights . rows`, shape (K, 3n + 1, 3n + 1)."""
        rows = self.matrix(sample.efforts.shape[1]) / self.divisor[:, None]
        return effort_curvature(sample, weights @ rows)

    def tightened(self, amount: float) -> EffortRows:
        """The rows with every limit drawn in by an amount in its unit."""
        return replace(self, c=self.c + amount / self.divisor)

    def room(self, sample: MotionSample) -> Array:
        """-(C e + c d) in each row's unit, shape (K, R)."""
        return self.room_of(sample.efforts)

    def least_between(self, stretch: Stretch, ends: Array) -> tuple[Array, Array]:
        """Least room at the control points less the errors of the efforts."""
        return self.least_of(stretch, self.room_of(stretch.control))

    def least_of(self, stretch: Stretch, room: Array) -> tuple[Array, Array]:
        """`least_between`, from the room at the control points, shape (n + 1, K, R)."""
        rounding, interpolation = (
            self.uncertainty(off) for off in (stretch.rounding, stretch.interpolation)
        )
        ends = np.minimum(room[0], room[-1])
        return room.min(axis=0) - rounding - interpolation, ends - rounding

    def room_of(self, efforts: Array) -> Array:
        """Room of efforts of shape (..., R'), shape (..., R); -inf where it is not finite."""
        room = -(efforts[..., : self.C.shape[1]] @ self.C.T) - self.c * self.divisor
        return np.where(np.isfinite(room), room, -np.inf)

    def uncertainty(self, off: EffortBound) -> Array:
        """Bound on |C e| for efforts within `off`, shape (K, R)."""
        force, moment = off.force[:, None], off.moment[:, None]
        found = np.linalg.norm(self.C[:, :3], axis=1) * force
        found = found + np.linalg.norm(self.C[:, 3:WRENCH], axis=1) * moment
        if self.needs_joint_efforts:
            found = found + off.joints @ np.abs(self.C[:, WRENCH:]).T
        return np.asarray(found)


def effort_curvature(sample: StageSample, weights: Array) -> Array:
    """Hessian of `weights . efforts` by (q, w, alpha, S), by differences of analytic derivatives.

    Args:
        sample: K states.
        weights: Shape (K, R) for the R efforts of the sample's model.

    Returns:
        Symmetric, shape (K, 3n + 1, 3n + 1); the block of (alpha, S) is zero because the efforts are
        affine in them.
    """
    model: StageModel = sample.model
    q, w, alpha = sample.q, sample.w, sample.alpha
    count, n = q.shape
    # by q with a small step; efforts are quadratic in w, so any step is exact there
    steps_q = np.vstack([np.zeros((1, n)), DIFFERENCE * np.eye(n), np.zeros((n, n))])
    steps_w = np.vstack([np.zeros((1 + n, n)), np.eye(n)])
    shifted_q = (q[:, None] + steps_q).reshape(-1, n)
    shifted_w = (w[:, None] + steps_w).reshape(-1, n)
    repeated = np.repeat(alpha, len(steps_q), axis=0)
    where = None if sample.positions is None else np.repeat(sample.positions, len(steps_q), axis=0)
    _, jacobian = model.effort_derivatives(shifted_q, shifted_w, repeated, sample.S, where)
    jacobian = jacobian[:, :, : 3 * n + 1].reshape(count, len(steps_q), -1, 3 * n + 1)
    gradient = np.einsum("kr,kprj->kpj", weights, jacobian)
    change = gradient[:, 1:] - gradient[:, :1]
    H = np.zeros((count, 3 * n + 1, 3 * n + 1))
    H[:, :n] = change[:, :n] / DIFFERENCE
    H[:, :n, :n] = 0.5 * (H[:, :n, :n] + H[:, :n, :n].transpose(0, 2, 1))
    H[:, n:, :n] = H[:, :n, n:].transpose(0, 2, 1)
    by_rates = change[:, n:, n : 2 * n]
    H[:, n : 2 * n, n : 2 * n] = 0.5 * (by_rates + by_rates.transpose(0, 2, 1))
    return H
