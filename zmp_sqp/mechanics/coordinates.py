"""Planning coordinates: the joint coordinates, or a smaller set that drives them linearly."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.limits import JointLimits

__all__ = ["Coordinates"]


@dataclass(frozen=True, slots=True, eq=False)
class Coordinates:
    r"""Affine map from m planning coordinates y to n joint coordinates q.

    .. math:: q = q_0 + G y, \quad v = G \dot y, \quad a = G \ddot y

    Each joint follows at most one coordinate, so that joint limits are simple bounds on the
    coordinates.

    Attributes:
        origin: Joint coordinates q_0 at y = 0, shape (n,) [rad or m].
        G: Constant Jacobian dq/dy with at most one nonzero entry per row, shape (n, m).
        is_identity: Whether the coordinates are the joint coordinates.
    """

    origin: Array
    G: Array
    is_identity: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        one = self.G.shape[0] == self.G.shape[1] and np.array_equal(self.G, np.eye(len(self.G)))
        object.__setattr__(self, "is_identity", bool(one and not self.origin.any()))

    @classmethod
    def identity(cls, size: int) -> Coordinates:
        """Coordinates that are the `size` joint coordinates: q_0 = 0, G = I."""
        return cls(np.zeros(size), np.eye(size))

    @property
    def size(self) -> int:
        """Number m of coordinates."""
        return int(self.G.shape[1])

    def joints(self, y: Array) -> Array:
        """Joint coordinates q of coordinates y (..., m), shape (..., n) [rad or m]."""
        return y if self.is_identity else np.asarray(self.origin + y @ self.G.T)

    def rates(self, w: Array) -> Array:
        """Joint rates G w of coordinate rates w (..., m), or accelerations; shape (..., n)."""
        return w if self.is_identity else np.asarray(w @ self.G.T)

    def coordinates_of(self, q: Array) -> Array:
        """Coordinates y of joint coordinates q (n,) in the range of the map, shape (m,)."""
        return self.rates_of(q - self.origin)

    def rates_of(self, v: Array) -> Array:
        """Coordinate rates of joint rates v (n,) in the range of G, shape (m,)."""
        # columns of G are orthogonal, because each joint follows at most one coordinate
        return np.array(v) if self.is_identity else v @ self.G / (self.G**2).sum(axis=0)

    def limits(self, joints: JointLimits) -> JointLimits:
        """Tightest limits that the joints place on each coordinate.

        Effort limits are NaN, unless the coordinates are the joint coordinates.
        """
        if self.is_identity:
            return joints
        still = self.G == 0.0  # (n, m): joints that do not follow the coordinate
        drive = np.where(still, 1.0, self.G)
        first, second = (
            (bound - self.origin)[:, None] / drive
            for bound in (joints.position_lower, joints.position_upper)
        )
        share = np.abs(drive)
        return JointLimits(
            position_lower=np.where(still, -np.inf, np.minimum(first, second)).max(axis=0),
            position_upper=np.where(still, np.inf, np.maximum(first, second)).min(axis=0),
            velocity=np.where(still, np.inf, joints.velocity[:, None] / share).min(axis=0),
            acceleration=np.where(still, np.inf, joints.acceleration[:, None] / share).min(axis=0),
            effort=np.full(self.size, np.nan),
        )
