"""Joint coupling: how the planned joints move all joints of a machine, mimic joints included."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, Indices

__all__ = ["JointCoupling"]


@dataclass(frozen=True, slots=True, eq=False)
class JointCoupling:
    r"""Affine map from the coordinates y of n planned joints to those of all m movable joints.

    .. math:: q = G y + g_0, \quad v = G \dot y, \quad a = G \ddot y, \quad \tau_y = G^T \tau

    Each movable joint follows one planned joint: itself, with the multiplier 1 and the offset 0, or
    the joint that it mimics. The last equation is the principle of virtual work: the effort of a
    planned joint is what its drive needs to move all joints that follow it. The movable joints are
    in the order of the Pinocchio model: row i is joint i + 2 and rate i + 6, behind the root's.
    Pinocchio's own mimic joints are not used, because derivatives of inverse dynamics lack them.

    Attributes:
        leader: Index of the planned joint that each movable joint follows, shape (m,).
        multiplier: Its factor, the only entry of each row of G that can be nonzero, shape (m,).
        offset: g_0, shape (m,) [rad or m].
        own: Row of each planned joint among the movable joints, shape (n,).
        index_q: Index of each movable joint in Pinocchio's q, shape (m,); that of the cosine for a
            continuous joint, whose sine is next.
        continuous: Rows of the continuous joints.
        G: Constant Jacobian dq/dy, shape (m, n).
    """

    leader: Indices
    multiplier: Array
    offset: Array
    own: Indices
    index_q: Indices
    continuous: tuple[int, ...]
    G: Array = field(init=False, repr=False)
    _identity: bool = field(init=False, repr=False)
    _selection: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        rows, size = np.arange(len(self.leader)), len(self.own)
        G = np.zeros((len(rows), size))
        G[rows, self.leader] = self.multiplier
        alone = len(rows) == size and not self.offset.any() and bool((self.multiplier == 1.0).all())
        for values in (self.leader, self.multiplier, self.offset, self.own, self.index_q, G):
            values.setflags(write=False)
        object.__setattr__(self, "G", G)
        object.__setattr__(self, "_selection", alone)
        object.__setattr__(self, "_identity", alone and np.array_equal(self.leader, rows))

    @classmethod
    def of(
        cls, model: Any, planned: Sequence[str], follows: Mapping[str, tuple[str, float, float]]
    ) -> JointCoupling:
        """Coupling of the joints of a Pinocchio model.

        Args:
            model: Model with a free-flyer root; all other joints have one degree of freedom.
            planned: Names of the n planned joints.
            follows: Planned joint, multiplier and offset of each joint that is not planned.
        """
        names, joints = list(model.names)[2:], list(model.joints)[2:]
        column = {name: i for i, name in enumerate(planned)}
        rows = [follows.get(name, (name, 1.0, 0.0)) for name in names]
        return cls(
            leader=np.array([column[leader] for leader, _, _ in rows], dtype=np.intp),
            multiplier=np.array([factor for _, factor, _ in rows], dtype=np.float64),
            offset=np.array([offset for _, _, offset in rows], dtype=np.float64),
            own=np.array([names.index(name) for name in planned], dtype=np.intp),
            index_q=np.array([joint.idx_q for joint in joints], dtype=np.intp),
            continuous=tuple(row for row, joint in enumerate(joints) if joint.nq == 2),
        )

    def positions(self, y: Array) -> Array:
        """Coordinates q = G y + g_0 of all joints, shape (..., m), from y (..., n) [rad or m]."""
        if self._selection:
            return self.rates(y)
        return np.asarray(y[..., self.leader] * self.multiplier + self.offset)

    def rates(self, v: Array) -> Array:
        """Rates G v of all joints, shape (..., m), from those of the planned ones (..., n).

        Accelerations and jerks follow in the same way.
        """
        if self._identity:
            return v
        chosen = v[..., self.leader]
        return chosen if self._selection else np.asarray(chosen * self.multiplier)

    def largest_rates(self, v: Array) -> Array:
        """Bounds |G| v on all joints' |rates|, shape (..., m), from those of the planned ones."""
        found = self.rates(v)
        return found if self._selection else np.abs(found)

    def largest_positions(self, y: Array) -> Array:
        """Bounds |G| y + |g_0| on all joints' |coordinates|, shape (..., m)."""
        found = self.largest_rates(y)
        return found if self._selection else found + np.abs(self.offset)

    def largest_efforts(self, tau: Array) -> Array:
        """Bounds |G|^T tau on the planned joints' |efforts|, (..., n), from those of all joints."""
        if self._identity:
            return tau
        return np.asarray(tau[..., self.own] if self._selection else tau @ np.abs(self.G))

    def columns(self, jacobian: Array) -> Array:
        """Derivatives J G by the planned joints, (..., n), from J by all joints, (..., m)."""
        if self._identity:
            return jacobian
        return np.asarray(jacobian[..., self.own] if self._selection else jacobian @ self.G)

    def rows(self, values: Array, before: int) -> Array:
        """Efforts G^T tau of the planned joints and their derivatives, along the second axis.

        Args:
            values: Shape (K, before + m, ...).
            before: Number of leading rows that are no joint's and are kept, as those of the wrench.

        Returns:
            Shape (K, before + n, ...).
        """
        if self._identity:
            return values
        if self._selection:
            kept = np.arange(before)
            return np.asarray(values[:, np.concatenate([kept, before + self.own])])
        along = np.einsum("ki...,ij->kj...", values[:, before:], self.G)
        return np.concatenate([values[:, :before], along], axis=1)

    def equals(self, other: JointCoupling) -> bool:
        """Whether another coupling is the same map."""
        return self is other or all(
            np.array_equal(getattr(self, key), getattr(other, key))
            for key in ("leader", "multiplier", "offset", "own")
        )
