"""Rows of constraints that are affine in the efforts of inverse dynamics."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.bounds.effort_bounds import EffortBound
from zmp_sqp.mechanics.wrench import WRENCH
from zmp_sqp.planning.constraints.protocol import MotionSample, StageModel, StageSample, Stretch

__all__ = ["EffortRows", "effort_curvature"]

# [rad or m] step of forward differences of analytic derivatives: the error, of first order in the
# step, is far below the accuracy of curvature that the SQP needs
DIFFERENCE = 1e-6

TOLERANCE = 2e-7  # violation of a scaled row, unless a guard makes up for more


@dataclass(frozen=True, slots=True, eq=False)
class EffortRows:
    r"""Rows that are affine in the efforts e of inverse dynamics.

    In seconds and in normalised time s = t / T, they are

    .. math:: (C\, e) / d + c \le 0, \qquad (C\, e_S) / d + c\, S \le 0

    with S = T^2 and the efforts e_S = S e, which inverse dynamics give with gravity scaled by S.
    Hence Jacobians of rows are C times those of efforts, the curvature is one difference of their
    weighted sum, and bounds between samples follow from bounds on efforts.

    Attributes:
        C: Coefficients of the ground reaction wrench about the root origin in root axes, shape
            (R, 6), or of wrench and joint efforts, shape (R, 6 + n).
        c: Constant terms of the scaled rows, shape (R,).
        divisor: Scales d that bring the rows to order one, shape (R,).
        labels: Quantity that each row limits, in words.
        units: Unit of each row's room, which is -(C e + c d).
        resolution: Room by which a guarantee may fall short of the least sample, shape (R,).
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
    def tolerance(self) -> float:
        """Largest violation of a scaled row at a solution, see `ConstraintRows.tolerance`."""
        return TOLERANCE

    @property
    def needs_joint_efforts(self) -> bool:
        """Whether C has columns for joint efforts."""
        return bool(self.C.shape[1] > WRENCH)

    def matrix(self, columns: int) -> Array:
        """C with zero columns added for efforts that the rows do not use, shape (R, columns)."""
        padded = np.zeros((len(self.C), columns))
        padded[:, : self.C.shape[1]] = self.C
        return padded

    def evaluate(self, sample: StageSample) -> Array:
        """Rows in normalised time, shape (K, R)."""
        rows = self.matrix(sample.efforts.shape[1]) / self.divisor[:, None]
        return np.asarray(sample.efforts @ rows.T + sample.S * self.c)

    def linearize(self, sample: StageSample) -> tuple[Array, Array]:
        """Rows with their Jacobian, see `ConstraintRows.linearize`."""
        effort, jacobian = sample.effort_derivatives
        rows = self.matrix(effort.shape[1]) / self.divisor[:, None]
        by_state = rows @ jacobian
        by_state[:, :, 3 * sample.model.size] += self.c
        return effort @ rows.T + sample.S * self.c, by_state

    def curvature(self, sample: StageSample, weights: Array) -> Array:
        """Hessian of `weights . rows` by (q, w, alpha, S), shape (K, 3n + 1, 3n + 1)."""
        rows = self.matrix(sample.efforts.shape[1]) / self.divisor[:, None]
        return effort_curvature(sample, weights @ rows)

    def tightened(self, amount: float) -> EffortRows:
        """Rows whose limits are stricter by an amount in their own unit."""
        return replace(self, c=self.c + amount / self.divisor)

    def room(self, sample: MotionSample) -> Array:
        """Room -(C e + c d) in each row's unit, shape (K, R); -inf where it has no value."""
        efforts = sample.efforts[:, : self.C.shape[1]]
        room = -(efforts @ self.C.T) - self.c * self.divisor
        return np.where(np.isfinite(room), room, -np.inf)

    def least_between(self, stretch: Stretch, ends: Array) -> tuple[Array, Array]:
        """Lower bound on the room inside each stretch, see `ConstraintRows.least_between`."""
        return self.least_of(stretch, self.room_of(stretch))

    def least_of(self, stretch: Stretch, room: Array) -> tuple[Array, Array]:
        """Lower bound on the room inside each stretch, see `ConstraintRows.least_between`.

        It is the least room at the control points less the bounds on the error of C e.

        Args:
            stretch: K stretches.
            room: Room at their control points, shape (n + 1, K, R).
        """
        rounding, interpolation = (
            self.uncertainty(off) for off in (stretch.rounding, stretch.interpolation)
        )
        ends = np.minimum(room[0], room[-1])
        return room.min(axis=0) - rounding - interpolation, ends - rounding

    def room_of(self, stretch: Stretch) -> Array:
        """Room at the control points of K stretches, shape (n + 1, K, R)."""
        start, (points, count, columns) = stretch.start, stretch.control.shape
        efforts = stretch.control.reshape(points * count, columns)
        sample = MotionSample(start.machine, start.q, start.v, start.a, efforts)
        return self.room(sample).reshape(points, count, -1)

    def uncertainty(self, off: EffortBound) -> Array:
        """Bound on |C e| for efforts e that are bounded by `off`, shape (K, R)."""
        force, moment = off.force[:, None], off.moment[:, None]
        found = np.linalg.norm(self.C[:, :3], axis=1) * force
        found = found + np.linalg.norm(self.C[:, 3:WRENCH], axis=1) * moment
        if self.needs_joint_efforts:
            found = found + off.joints @ np.abs(self.C[:, WRENCH:]).T
        return np.asarray(found)


def effort_curvature(sample: StageSample, weights: Array) -> Array:
    """Hessian of `weights . efforts` by (q, w, alpha, S).

    It is that of `StageModel.wrench_hessian`, or comes from differences of analytic derivatives.

    Args:
        sample: K states; their derivatives are not computed again if they are known.
        weights: Weight of each of the R efforts times S, shape (K, R).

    Returns:
        Symmetric matrices, shape (K, 3n + 1, 3n + 1). Their block of (alpha, S) is zero, because
        efforts times S are affine in alpha and S.
    """
    model: StageModel = sample.model
    q, w, alpha = sample.q, sample.w, sample.alpha
    if weights.shape[1] == WRENCH:
        known = model.wrench_hessian(q, w, alpha, sample.S, weights)
        if known is not None:
            return known
    count, n = q.shape
    one, none = np.eye(n), np.zeros((n, n))
    # by q with a small step; efforts are quadratic in w, so any step is exact there
    steps_q, steps_w = np.vstack([DIFFERENCE * one, none]), np.vstack([none, one])
    shifted_q = (q[:, None] + steps_q).reshape(-1, n)
    shifted_w = (w[:, None] + steps_w).reshape(-1, n)
    repeated, positions = np.repeat(alpha, 2 * n, axis=0), sample.positions
    if positions is not None:
        positions = np.repeat(positions, 2 * n, axis=0)
    _, jacobian = model.effort_derivatives(shifted_q, shifted_w, repeated, sample.S, positions)
    jacobian = jacobian[:, :, : 3 * n + 1].reshape(count, 2 * n, -1, 3 * n + 1)
    here = sample.effort_derivatives[1][:, None, :, : 3 * n + 1]
    change = (weights[:, None, None] @ (jacobian - here))[:, :, 0]
    H = np.zeros((count, 3 * n + 1, 3 * n + 1))
    H[:, :n] = change[:, :n] / DIFFERENCE
    H[:, :n, :n] = 0.5 * (H[:, :n, :n] + H[:, :n, :n].transpose(0, 2, 1))
    H[:, n:, :n] = H[:, :n, n:].transpose(0, 2, 1)
    by_rates = change[:, n:, n : 2 * n]
    H[:, n : 2 * n, n : 2 * n] = 0.5 * (by_rates + by_rates.transpose(0, 2, 1))
    return H
