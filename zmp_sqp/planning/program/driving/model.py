"""What a stage of the transcription sees of a machine that drives."""

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

# of GroundMotion
PLACE, YAW, RATES, PUSHES, SCALE = slice(0, 2), slice(2, 3), slice(3, 5), slice(5, 7), slice(7, 8)


@dataclass(frozen=True, slots=True, eq=False)
class DrivingModel:
    r"""Arm and unicycle base at places p on the ground.

    Coordinates are y = (joints, path length along the heading, yaw).

    In normalised time s = t/T, with w = y', alpha = y'', S = T^2, twist and spatial acceleration of
    the root are those of `Terrain.base_motion`; in a plane :math:`(w_\lambda, 0, 0, 0, 0, w_\psi)`
    and
    :math:`(\alpha_\lambda, 0, 0, 0, 0, \alpha_\psi)` (spatial, not classical: no speed times yaw
    rate), with a gravity that turns with the yaw. The wrench times S is affine in (alpha, S) and
    quadratic in w, as without a base.

    Attributes:
        machine: The machine.
        terrain: What it drives on.
        joint_efforts: Whether the joints' efforts follow the ground reaction wrench.
    """

    machine: Machine
    terrain: Terrain
    joint_efforts: bool = False

    # the root frame moves, so that the wrench in its axes is not the rate of momentum there
    has_momentum_rate = False

    @property
    def size(self) -> int:
        """Number of coordinates: the joints and two."""
        return self.machine.size + 2

    @property
    def coordinates(self) -> Coordinates:
        """The joints themselves; path length and yaw move none of them."""
        return Coordinates.identity(self.machine.size)

    def efforts(
        self, q: Array, w: Array, alpha: Array, S: float, positions: Array | None = None
    ) -> Array:
        """S times the efforts, shape (K, R) [N s^2, N m s^2].

        Args:
            q, w, alpha: Coordinates and their derivatives by s, shape (K, n) each.
            S: Squared duration [s^2].
            positions: Of the base, shape (K, 2) [m]; None where they do not matter, as on a plane.
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
        """Efforts, (K, R), and Jacobian by (q, w, alpha, S [, positions]), (K, R, 3n + 1 [+ 2]).

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
            by_root[:, :, PUSHES],
            by_root[:, :, SCALE],
        ]
        if positions is not None:
            parts.append(by_root[:, :, PLACE])
        return found.effort, np.concatenate(parts, axis=2)

    def _root(
        self, q: Array, w: Array, alpha: Array, S: float, places: Array | None
    ) -> GroundMotion:
        """Motion of the root; beyond the map's rim as on the rim, with no slope outwards."""
        pose = np.column_stack([np.zeros((len(q), 2)) if places is None else places, q[:, -1]])
        low, high = self.terrain.extent
        inside = np.clip(pose[:, :2], low, high)
        off = inside != pose[:, :2]
        pose[:, :2] = inside
        root = self.terrain.base_motion(pose, w[:, -2:], alpha[:, -2:], S)
        if off.any():
            for slopes in (root.velocity_jacobian, root.acceleration_jacobian):
                slopes[:, :, PLACE] *= ~off[:, None, :]
        return (
            root
            if self.machine.support is None
            else root.at_support_height(self.machine.support.height)
        )
