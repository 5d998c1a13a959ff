"""Inverse dynamics of an arm on a driving base, in normalised time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.ground import Terrain
from zmp_sqp.mechanics.ground_motion import GroundMotion
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import effort_derivatives, efforts

__all__ = ["DrivingModel"]

# columns of the Jacobians of GroundMotion: position, yaw, rates w, accelerations alpha, S
POSITION, YAW, RATES, ALPHA, SCALE = slice(0, 2), slice(2, 3), slice(3, 5), slice(5, 7), slice(7, 8)


@dataclass(frozen=True, slots=True, eq=False)
class DrivingModel:
    r"""Inverse dynamics of an arm on a unicycle base at positions p on the ground.

    Coordinates are y = (joints, path length along the heading, yaw).

    In normalised time s = t / T, with w = y', alpha = y'' and S = T^2, twist and spatial
    acceleration of the root come from `Terrain.base_motion`. In a plane they are :math:`(w_\lambda,
    0, 0, 0, 0, w_\psi)` and :math:`(\alpha_\lambda, 0, 0, 0, 0, \alpha_\psi)`, and gravity turns
    with the yaw in the root frame. The acceleration is spatial, not classical: it has no term speed
    times yaw rate. The efforts times S are affine in (alpha, S) and quadratic in w, as those of
    `ArmModel`.

    Attributes:
        machine: Machine with its payload.
        terrain: Ground that the base drives on.
        joint_efforts: Whether the efforts are the ground reaction wrench and the joint efforts
            (R = 6 + number of joints), or the wrench alone (R = 6).
    """

    machine: Machine
    terrain: Terrain
    joint_efforts: bool = False

    @property
    def size(self) -> int:
        """Number n of coordinates: the joints, path length and yaw."""
        return self.machine.size + 2

    @property
    def coordinates(self) -> Coordinates:
        """The joints themselves; path length and yaw move none of them."""
        return Coordinates.identity(self.machine.size)

    def efforts(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> Array:
        """S times the efforts (ground reaction wrench [, joint efforts]), shape (K, R).

        Forces in N s^2, moments in N m s^2, about the root origin in root axes.

        Args:
            q, w, alpha: Coordinates and their derivatives by s, shape (K, n) each.
            S: Squared duration [s^2].
            positions: Positions of the base, shape (K, 2) [m]; None where the efforts do not depend
                on them, as on a plane.
        """
        root = self._root(q, w, alpha, S, positions)
        return efforts(
            self.machine,
            q[:, :-2],
            w[:, :-2],
            alpha[:, :-2],
            root_velocity=root.velocity,
            root_acceleration=root.acceleration,
            joints=self.joint_efforts,
        )

    def effort_derivatives(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> tuple[Array, Array]:
        """S times the efforts, (K, R), and their Jacobian, (K, R, 3n + 1 [+ 2]).

        The Jacobian is by (q, w, alpha, S [, positions]).

        Args:
            q, w, alpha, S, positions: Arguments of `efforts`.
        """
        root = self._root(q, w, alpha, S, positions)
        found = effort_derivatives(
            self.machine,
            q[:, :-2],
            w[:, :-2],
            alpha[:, :-2],
            root_velocity=root.velocity,
            root_acceleration=root.acceleration,
            joints=self.joint_efforts,
        )
        by_root = found.wrt_velocity[:, :, :6] @ root.velocity_jacobian
        by_root += found.wrt_acceleration[:, :, :6] @ root.acceleration_jacobian  # (K, R, 8)
        parts = [
            found.wrt_position,
            np.zeros((*found.effort.shape, 1)),
            by_root[:, :, YAW],
            found.wrt_velocity[:, :, 6:],
            by_root[:, :, RATES],
            found.wrt_acceleration[:, :, 6:],
            by_root[:, :, ALPHA],
            by_root[:, :, SCALE],
        ]
        if positions is not None:
            parts.append(by_root[:, :, POSITION])
        return found.effort, np.concatenate(parts, axis=2)

    def wrench_hessian(
        self, q: Array, w: Array, alpha: Array, S: float, weights: Array
    ) -> Array | None:
        """None: `mechanics.wrench_hessian` is for roots that stand."""
        return None

    def _root(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None
    ) -> GroundMotion:
        """Motion of the root link.

        Positions outside the map are moved to its rim; derivatives by such coordinates are zero.
        """
        pose = np.column_stack(
            [np.zeros((len(q), 2)) if positions is None else positions, q[:, -1]]
        )
        low, high = self.terrain.extent
        inside = np.clip(pose[:, :2], low, high)
        outside = inside != pose[:, :2]
        pose[:, :2] = inside
        root = self.terrain.base_motion(pose, w[:, -2:], alpha[:, -2:], S)
        if outside.any():
            for jacobian in (root.velocity_jacobian, root.acceleration_jacobian):
                jacobian[:, :, POSITION] *= ~outside[:, None, :]
        return (
            root
            if self.machine.support is None
            else root.at_support_height(self.machine.support.height)
        )
