"""Inverse dynamics of an arm on a standing base, in normalised time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import effort_derivatives, efforts
from zmp_sqp.mechanics.wrench_hessian import wrench_hessian

__all__ = ["ArmModel"]


@dataclass(frozen=True, slots=True, eq=False)
class ArmModel:
    r"""Inverse dynamics of an arm on a standing base, in coordinates y that determine its joints.

    In normalised time s = t / T, with w = T v, alpha = T^2 a and S = T^2, the efforts times S are

    .. math:: M(q) \alpha + h(q, w) - S M_{root}(q) g

    which is inverse dynamics with gravity scaled by S: affine in (alpha, S) and quadratic in w. The
    arguments q, w, alpha of the methods are y and its first two derivatives by s.

    Attributes:
        machine: Machine with its payload.
        gravity: Acceleration g of gravity in the root frame, shape (3,) [m/s^2].
        coordinates: Map from y to the joint positions.
        joint_efforts: Whether the efforts are the ground reaction wrench and the joint efforts
            (R = 6 + number of joints), or the wrench alone (R = 6).
    """

    machine: Machine
    gravity: Array
    coordinates: Coordinates
    joint_efforts: bool = False

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return self.coordinates.size

    def efforts(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> Array:
        """S times the efforts (ground reaction wrench [, joint efforts]), shape (K, R).

        Forces in N s^2, moments in N m s^2, about the root origin in root axes.

        Args:
            q, w, alpha: Coordinates and their derivatives by s, shape (K, n) each.
            S: Squared duration [s^2].
            positions: Not used: the base stands.
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
        """S times the efforts, (K, R), and their Jacobian by (q, w, alpha, S), (K, R, 3n + 1).

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
        jacobians = (found.wrt_position, found.wrt_rate, found.wrt_joint_acceleration)
        for i, part in enumerate(jacobians):
            by_coordinates = part if self.coordinates.is_identity else part @ self.coordinates.G
            jacobian[:, :, i * n : (i + 1) * n] = by_coordinates
        jacobian[:, :, -1] = found.by_a[:, :, :3] @ -self.gravity
        return found.effort, jacobian

    def wrench_hessian(
        self,
        q: Array,
        w: Array,
        alpha: Array,
        S: float,
        weights: Array,
        *,
        gravity: Array | None = None,
        parameters: Array | None = None,
    ) -> Array:
        """Hessian of weights . S (f, tau) by (q, w, alpha, S), shape (K, 3n + 1, 3n + 1).

        Args:
            q, w, alpha, S, weights: Arguments of `StageModel.wrench_hessian`.
            gravity, parameters: Gravity and dynamic parameters of the bodies in each state, see
                `mechanics.wrench_hessian`; None for those of the model.
        """
        joints, rates, accelerations = self._joints(q, w, alpha)
        coupling = self.machine.coupling
        found = wrench_hessian(
            self.machine,
            joints,
            coupling.rates(rates),
            coupling.rates(accelerations),
            S,
            gravity=self.gravity if gravity is None else gravity,
            weights=weights,
            parameters=parameters,
        )
        G = coupling.G @ self.coordinates.G
        m, n = G.shape
        if np.array_equal(G, np.eye(m)):
            return found
        blocks = np.zeros((3 * m + 1, 3 * n + 1))
        blocks[-1, -1] = 1.0
        for i in range(3):
            blocks[i * m : (i + 1) * m, i * n : (i + 1) * n] = G
        found = blocks.T @ found @ blocks
        return np.asarray(0.5 * (found + found.transpose(0, 2, 1)))

    def _joints(self, q: Array, w: Array, alpha: Array) -> tuple[Array, Array, Array]:
        coordinates = self.coordinates
        return coordinates.joints(q), coordinates.rates(w), coordinates.rates(alpha)

    def _root_acceleration(self, S: float) -> Array:
        return np.concatenate([-S * self.gravity, np.zeros(3)])
