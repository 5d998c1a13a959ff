"""What a stage of the transcription sees of the machine: coordinates, wrench, derivatives, curvature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import ground_reaction, ground_reaction_derivatives

__all__ = ["ArmModel", "StageModel", "wrench_curvature"]

DIFFERENCE = 1e-6  # [rad, m] forward step on analytic derivatives; error of second order in it


@dataclass(frozen=True, slots=True, eq=False)
class ArmModel:
    r"""The arm on a standing base: the joints themselves are the coordinates.

    Everything is in normalised time s = t/T: w = T v, alpha = T^2 a, S = T^2, so that the wrench times S is

    .. math:: M(q) \alpha + h(q, w) - S M_{root}(q) g

    inverse dynamics with gravity scaled by S: affine in (alpha, S), quadratic in w.

    Attributes:
        machine: The machine.
        gravity: In the root frame, shape (3,) [m/s^2].
    """

    machine: Machine
    gravity: Array

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return self.machine.size

    def wrench(self, q: Array, w: Array, alpha: Array, S: float) -> Array:
        """S times the ground reaction wrench, shape (K, 6) [N s^2, N m s^2]."""
        return ground_reaction(self.machine, q, w, alpha, root_acceleration=self._root(S))

    def wrench_derivatives(self, q: Array, w: Array, alpha: Array, S: float) -> tuple[Array, Array]:
        """The same with its derivatives by (q, w, alpha, S), shapes (K, 6) and (K, 6, 3n + 1)."""
        found = ground_reaction_derivatives(self.machine, q, w, alpha, root_acceleration=self._root(S))
        by_root = found.wrt_acceleration[:, :, :3] @ -self.gravity
        parts = (
            found.wrt_position,
            found.wrt_velocity[:, :, 6:],
            found.wrt_acceleration[:, :, 6:],
            by_root[:, :, None],
        )
        return found.wrench, np.concatenate(parts, axis=2)

    def _root(self, S: float) -> Array:
        return np.concatenate([-S * self.gravity, np.zeros(3)])


StageModel = ArmModel


def wrench_curvature(model: StageModel, q: Array, w: Array, alpha: Array, S: float, weights: Array) -> Array:
    """Second derivatives of `weights . wrench` by (q, w, alpha, S), from differences of the analytic first ones.

    Args:
        model: Stage model.
        q, w, alpha: Shape (K, n) each.
        S: Squared duration [s^2].
        weights: Shape (K, 6).

    Returns:
        Symmetric, shape (K, 3n + 1, 3n + 1); the block of (alpha, S) is zero because the wrench is affine in them.
    """
    count, n = q.shape
    steps = np.vstack([np.zeros((1, n)), DIFFERENCE * np.eye(n), np.zeros((n, n))])
    rates = np.vstack([np.zeros((1 + n, n)), np.eye(n)])  # quadratic in w: any step is exact
    shifted_q = (q[:, None] + steps).reshape(-1, n)
    shifted_w = (w[:, None] + rates).reshape(-1, n)
    repeated = np.repeat(alpha, len(steps), axis=0)
    _, slopes = model.wrench_derivatives(shifted_q, shifted_w, repeated, S)
    slopes = np.einsum("kr,kprj->kpj", weights, slopes.reshape(count, len(steps), 6, 3 * n + 1))
    change = slopes[:, 1:] - slopes[:, :1]
    H = np.zeros((count, 3 * n + 1, 3 * n + 1))
    H[:, :n] = change[:, :n] / DIFFERENCE
    H[:, :n, :n] = 0.5 * (H[:, :n, :n] + H[:, :n, :n].transpose(0, 2, 1))
    H[:, n:, :n] = H[:, :n, n:].transpose(0, 2, 1)
    ww = change[:, n:, n : 2 * n]
    H[:, n : 2 * n, n : 2 * n] = 0.5 * (ww + ww.transpose(0, 2, 1))
    return H
