"""How the acceleration runs within an interval: constant, or linear with jumps at the nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from zmp_sqp.arrays import Array

__all__ = ["CONSTANT", "LINEAR", "Hold", "slope_ties"]

# of the joint's largest acceleration: a larger difference between neighbours is a switch, not a
# slope
JUMP = 0.2
SMALL = 1e-9  # keeps joints that stand still smooth


@dataclass(frozen=True, slots=True)
class Hold:
    r"""Acceleration of an interval from its c control vectors u, with s the share of the interval gone.

    .. math:: \alpha(s) = \sum_i B_i(s) u_i, \quad w(s) = w_k + h \sum_i B^{(-1)}_i(s) u_i, \quad
              q(s) = q_k + h s w_k + h^2 \sum_i B^{(-2)}_i(s) u_i

    Constant: one control, B = 1. Linear: the accelerations at start and end, B = (1 - s, s); they
        are independent, so
    the acceleration may jump at the nodes.

    Attributes:
        controls: Number c of control vectors.
        rate_points: The rate's inner Bernstein points are w_k + h p u_0 for these p (none: the rate
            is linear).
        position_points: The position's inner Bernstein points are q + h p w, at the start for p >
            0, at the end for p < 0.
    """

    controls: int
    rate_points: tuple[float, ...]
    position_points: tuple[float, ...]

    def shapes(self, s: float) -> tuple[Array, Array, Array]:
        """(B, once integrated, twice integrated) at s, shape (c,) each."""
        if self.controls == 1:
            return np.ones(1), np.array([s]), np.array([0.5 * s**2])
        return (
            np.array([1.0 - s, s]),
            np.array([s - 0.5 * s**2, 0.5 * s**2]),
            np.array([0.5 * s**2 - s**3 / 6.0, s**3 / 6.0]),
        )

    @property
    def to_rate(self) -> tuple[float, ...]:
        """What each control adds to the rate over the interval, per h."""
        return tuple(float(share) for share in self.shapes(1.0)[1])

    @property
    def to_position(self) -> tuple[float, ...]:
        """What each control adds to the position over the interval, per h^2."""
        return tuple(float(share) for share in self.shapes(1.0)[2])


CONSTANT = Hold(controls=1, rate_points=(), position_points=(0.5,))
LINEAR = Hold(controls=2, rate_points=(0.5,), position_points=(1.0 / 3.0, -1.0 / 3.0))


def slope_ties(controls: Array) -> sp.csr_array:
    """Ties that make the slope of each interval follow from the means of its neighbours, as the given means suggest.

    Where the means run smoothly the slope is half their central difference; beside a switch, the
    difference to the smooth side; between two switches, zero. The linear hold then has no more free
    variables than the constant one, and is of second order where the motion is smooth.

    Args:
        controls: Accelerations of a constant hold, shape (N, n).

    Returns:
        From means (N n) to the linear hold's controls (N 2 n), CSR.
    """
    N, n = controls.shape
    index = np.arange(N * n).reshape(N, n)
    before, after = np.maximum(index - n, index[:1]), np.minimum(index + n, index[-1:])
    flat = controls.ravel()
    left, right = (np.abs(flat[a] - flat[b]) for a, b in ((index, before), (after, index)))
    jump = JUMP * np.abs(controls).max(axis=0) + SMALL
    smooth_left, smooth_right = (
        (left <= jump) & (index >= n),
        (right <= jump) & (index < (N - 1) * n),
    )
    first, last = np.where(smooth_left, before, index), np.where(smooth_right, after, index)
    steps = smooth_left.astype(float) + smooth_right
    weight = np.divide(0.5, steps, out=np.zeros_like(steps), where=steps > 0.0)
    rows = np.arange(2 * N * n).reshape(N, 2, n)
    entries = []
    # start: mean - half difference; end: mean + half difference
    for side, sign in ((0, -1.0), (1, 1.0)):
        entries += [(rows[:, side], index, np.ones((N, n))), (rows[:, side], last, sign * weight)]
        entries += [(rows[:, side], first, -sign * weight)]
    row, column, data = (np.concatenate([entry[i].ravel() for entry in entries]) for i in range(3))
    return sp.csr_array((data, (row, column)), shape=(2 * N * n, N * n))
