"""What a stage of the transcription sees of a machine that drives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.ground import Terrain
from zmp_sqp.mechanics.ground_motion import GroundMotion
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import ground_reaction, ground_reaction_derivatives
from zmp_sqp.planning.program.model import StageModel

__all__ = ["DrivingModel"]

# of GroundMotion
PLACE, YAW, RATES, PUSHES, SCALE = slice(0, 2), slice(2, 3), slice(3, 5), slice(5, 7), slice(7, 8)


@dataclass(frozen=True, slots=True, eq=False)
class DrivingModel:
    r"""Arm and unicycle base, in coordinates y = (joints, way along the heading, yaw), at places p on the ground.

    In normalised time s = t/T, with w = y', alpha = y'', S = T^2, twist and spatial acceleration of
    the root are those of `Terrain.base_motion`; in a plane :math:`(w_\lambda, 0, 0, 0, 0, w_\psi)`
    and
    :math:`(\alpha_\lambda, 0, 0, 0, 0, \alpha_\psi)` (spatial, not classical: no speed times yaw
    rate), with a gravity that turns with the yaw. The wrench times S is affine in (alpha, S) and
    quadratic in w, as without a base.

    Attributes:
        machine: The machine.
        terrain: What it drives on.
    """

    machine: Machine
    terrain: Terrain

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

    def wrench(
        self, q: Array, w: Array, alpha: Array, S: float, places: Array | None = None
    ) -> Array:
        """S times the ground reaction wrench, shape (K, 6) [N s^2, N m s^2]; places do not matter in a plane."""
        root = self._root(q, w, alpha, S, places)
        return ground_reaction(
            self.machine,
            q[:, :-2],
            w[:, :-2],
            alpha[:, :-2],
            root_velocity=root.velocity,
            root_acceleration=root.acceleration,
        )

    def wrench_derivatives(
        self, q: Array, w: Array, alpha: Array, S: float, places: Array | None = None
    ) -> tuple[Array, Array]:
        """The same with its derivatives by (q, w, alpha, S, p), shapes (K, 6) and (K, 6, 3n + 3)."""
        root = self._root(q, w, alpha, S, places)
        found = ground_reaction_derivatives(
            self.machine,
            q[:, :-2],
            w[:, :-2],
            alpha[:, :-2],
            root_velocity=root.velocity,
            root_acceleration=root.acceleration,
        )
        by_root = found.wrt_velocity[:, :, :6] @ root.velocity_jacobian
        by_root += found.wrt_acceleration[:, :, :6] @ root.acceleration_jacobian  # (K, 6, 8)
        parts = [
            found.wrt_position,
            np.zeros((len(q), 6, 1)),
            by_root[:, :, YAW],
            found.wrt_velocity[:, :, 6:],
            by_root[:, :, RATES],
            found.wrt_acceleration[:, :, 6:],
            by_root[:, :, PUSHES],
            by_root[:, :, SCALE],
            by_root[:, :, PLACE],
        ]
        return found.wrench, np.concatenate(parts, axis=2)

    def _root(
        self, q: Array, w: Array, alpha: Array, S: float, places: Array | None
    ) -> GroundMotion:
        """Motion of the root; beyond the map's rim that of the place on the rim, with no slope outwards."""
        pose = np.column_stack([np.zeros((len(q), 2)) if places is None else places, q[:, -1]])
        low, high = self.terrain.extent
        inside = np.clip(pose[:, :2], low, high)
        off = inside != pose[:, :2]
        pose[:, :2] = inside
        root = self.terrain.base_motion(pose, w[:, -2:], alpha[:, -2:], S)
        if off.any():
            for jacobian in (root.velocity_jacobian, root.acceleration_jacobian):
                jacobian[:, :, PLACE] *= ~off[:, None, :]
        return (
            root
            if self.machine.support is None
            else root.at_support_height(self.machine.support.height)
        )
