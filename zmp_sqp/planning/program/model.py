"""The arm on a standing base, as the stages of the nonlinear program see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import effort_derivatives, efforts

__all__ = ["ArmModel"]


@dataclass(frozen=True, slots=True, eq=False)
class ArmModel:
    r"""The arm on a standing base, in coordinates y that drive its joints.

    In normalised time s = t / T, with w = T v, alpha = T^2 a and S = T^2, the efforts times S are

    .. math:: M(q) \alpha + h(q, w) - S M_{root}(q) g

    which is inverse dynamics with gravity scaled by S: affine in (alpha, S) and quadratic in w.
    Arguments and derivatives below are those of the coordinates: q, w, alpha stand for y, y', y''.

    Attributes:
        machine: The machine.
        gravity: In the root frame, shape (3,) [m/s^2].
        coordinates: From y to the joints.
        joint_efforts: Whether the joints' efforts follow the ground reaction wrench.
    """

    machine: Machine
    gravity: Array
    coordinates: Coordinates
    joint_efforts: bool = False

    has_momentum_rate = True  # the wrench is the rate of the machine's momentum

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return self.coordinates.size

    def efforts(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> Array:
        """S times the efforts, shape (K, R) [N s^2, N m s^2]; positions are not used.

        Args:
            q, w, alpha: Coordinates and their derivatives by s, shape (K, n) each.
            S: Squared duration [s^2].
            positions: Not used.
        """
        return efforts(
            self.machine,
            *self._joints(q, w, alpha),
            root_acceleration=self._root_acceleration(S),
            joints=self.joint_efforts,
        )

    def effort_derivatives(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> tuple[Array, Array]:
        """Efforts with their Jacobian by (q, w, alpha, S), shapes (K, R) and (K, R, 3n + 1).

        Args:
            q, w, alpha, S, positions: Arguments of `efforts`.
        """
        found = effort_derivatives(
            self.machine,
            *self._joints(q, w, alpha),
            root_acceleration=self._root_acceleration(S),
            joints=self.joint_efforts,
        )
        n = self.size
        jacobian = np.empty((*found.effort.shape, 3 * n + 1))
        parts = (found.wrt_position, found.wrt_rate, found.wrt_joint_acceleration)
        for i, part in enumerate(parts):
            drawn = part if self.coordinates.is_identity else part @ self.coordinates.G
            jacobian[:, :, i * n : (i + 1) * n] = drawn
        jacobian[:, :, -1] = found.by_a[:, :, :3] @ -self.gravity
        return found.effort, jacobian

    def _joints(self, q: Array, w: Array, alpha: Array) -> tuple[Array, Array, Array]:
        coordinates = self.coordinates
        return coordinates.joints(q), coordinates.rates(w), coordinates.rates(alpha)

    def _root_acceleration(self, S: float) -> Array:
        return np.concatenate([-S * self.gravity, np.zeros(3)])
