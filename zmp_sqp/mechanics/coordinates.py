"""Planning coordinates: the joints themselves, or fewer of them that drive the joints linearly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.limits import JointLimits

__all__ = ["Coordinates"]


@dataclass(frozen=True, slots=True, eq=False)
class Coordinates:
    r"""Affine map from m coordinates to n joints.

    .. math:: q = q_0 + G y, \quad v = G \dot y, \quad a = G \ddot y

    Every joint follows at most one coordinate, so limits of the joints are limits of the
    coordinates.

    Attributes:
        origin: q_0, shape (n,).
        G: Shape (n, m), at most one entry per row.
    """

    origin: Array
    G: Array

    @classmethod
    def identity(cls, size: int) -> Coordinates:
        """The joints themselves."""
        return cls(np.zeros(size), np.eye(size))

    @property
    def size(self) -> int:
        """Number m of coordinates."""
        return int(self.G.shape[1])

    def joints(self, y: Array) -> Array:
        """Joint coordinates, shape (..., n)."""
        return np.asarray(self.origin + y @ self.G.T)

    def rates(self, w: Array) -> Array:
        """Joint rates, or accelerations, of those of the coordinates, shape (..., n)."""
        return np.asarray(w @ self.G.T)

    def coordinates_of(self, q: Array) -> Array:
        """Coordinates of joint coordinates that lie in the map's range, shape (m,)."""
        return np.asarray(np.linalg.lstsq(self.G, q - self.origin, rcond=None)[0])

    def rates_of(self, v: Array) -> Array:
        """Rates of the coordinates, shape (m,)."""
        return np.asarray(np.linalg.lstsq(self.G, v, rcond=None)[0])

    def limits(self, joints: JointLimits) -> JointLimits:
        """The tightest limits that the driven joints put on each coordinate."""
        drive = np.where(self.G == 0.0, np.nan, self.G)  # (n, m)
        sides = np.stack(
            [
                (bound - self.origin)[:, None] / drive
                for bound in (joints.position_lower, joints.position_upper)
            ]
        )
        share = np.abs(drive)
        return JointLimits(
            position_lower=np.nanmax(sides.min(axis=0), axis=0),
            position_upper=np.nanmin(sides.max(axis=0), axis=0),
            velocity=np.nanmin(joints.velocity[:, None] / share, axis=0),
            acceleration=np.nanmin(joints.acceleration[:, None] / share, axis=0),
            effort=np.full(self.size, np.nan),
        )
