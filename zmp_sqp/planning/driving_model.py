"""What a stage of the transcription sees of a machine that drives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import ground_reaction, ground_reaction_derivatives
from zmp_sqp.planning.model import StageModel

__all__ = ["DrivingModel", "turned_gravity"]

FORWARD, TURN = 0, 5  # of a twist: along the heading, about the normal of the ground


@dataclass(frozen=True, slots=True, eq=False)
class DrivingModel:
    r"""Arm and unicycle base on a plane, in coordinates y = (joints, way along the heading, yaw).

    In normalised time s = t/T, with w = y', alpha = y'', S = T^2, the root has the twist
    :math:`(w_\lambda, 0, 0, 0, 0, w_\psi)` and the spatial acceleration
    :math:`(\alpha_\lambda, 0, 0, 0, 0, \alpha_\psi)` in its own axes (spatial, not classical: no speed times yaw rate),
    and gravity turns with the yaw. The wrench times S is affine in (alpha, S) and quadratic in w, as without a base.

    Attributes:
        machine: The machine.
        gravity: In the root frame at yaw zero, shape (3,) [m/s^2].
    """

    machine: Machine
    gravity: Array

    @property
    def size(self) -> int:
        """Number of coordinates: the joints and two."""
        return self.machine.size + 2

    @property
    def parts(self) -> tuple[StageModel, ...]:
        """Itself: it has one wrench."""
        return (self,)

    @property
    def extra_rows(self) -> int:
        """Number of rows of `extra`: none."""
        return 0

    def extra(self, q: Array, w: Array, alpha: Array, S: float) -> tuple[Array, Array]:
        """No other rows than the wrench's."""
        return np.zeros((len(q), 0)), np.zeros((len(q), 0, 3 * self.size + 1))

    def wrench(self, q: Array, w: Array, alpha: Array, S: float) -> Array:
        """S times the ground reaction wrench, shape (K, 6) [N s^2, N m s^2]."""
        return ground_reaction(
            self.machine, q[:, :-2], w[:, :-2], alpha[:, :-2],
            root_velocity=_root(w), root_acceleration=self._root_acceleration(q, alpha, S),
        )  # fmt: skip

    def wrench_derivatives(self, q: Array, w: Array, alpha: Array, S: float) -> tuple[Array, Array]:
        """The same with its derivatives by (q, w, alpha, S), shapes (K, 6) and (K, 6, 3n + 1)."""
        found = ground_reaction_derivatives(
            self.machine, q[:, :-2], w[:, :-2], alpha[:, :-2],
            root_velocity=_root(w), root_acceleration=self._root_acceleration(q, alpha, S),
        )  # fmt: skip
        columns = np.append(np.arange(6, 6 + self.machine.size), [FORWARD, TURN])
        gravity, turned = turned_gravity(self.gravity, q[:, -1])
        push = found.wrt_acceleration[:, :, :3]  # (K, 6, 3)
        by_yaw = -S * np.einsum("kri,ki->kr", push, turned)
        by_S = -np.einsum("kri,ki->kr", push, gravity)
        parts = [
            found.wrt_position, np.zeros((len(q), 6, 1)), by_yaw[:, :, None], found.wrt_velocity[:, :, columns],
            found.wrt_acceleration[:, :, columns], by_S[:, :, None],
        ]  # fmt: skip
        return found.wrench, np.concatenate(parts, axis=2)

    def _root_acceleration(self, q: Array, alpha: Array, S: float) -> Array:
        acceleration = _root(alpha)
        acceleration[:, :3] -= S * turned_gravity(self.gravity, q[:, -1])[0]
        return acceleration


def turned_gravity(gravity: Array, yaw: Array) -> tuple[Array, Array]:
    """Gravity in root axes at yaws in a plane and its derivative by the yaw, shape (K, 3) each; given at yaw zero."""
    x, y, z = gravity
    cos, sin = np.cos(yaw), np.sin(yaw)
    forward, left = cos * x + sin * y, cos * y - sin * x
    return np.column_stack([forward, left, np.full_like(yaw, z)]), np.column_stack([left, -forward, 0.0 * yaw])


def _root(rates: Array) -> Array:
    """Twist, or spatial acceleration, of the root."""
    root = np.zeros((len(rates), 6))
    root[:, FORWARD], root[:, TURN] = rates[:, -2], rates[:, -1]
    return root
