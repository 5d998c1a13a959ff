r"""Ground reaction of the differences between machines whose bodies differ in inertia alone.

A payload that is heavier or displaced changes the inertia of one body. The wrench is linear in that
inertia, so that the change of the wrench follows from the pose of the body and its derivatives,
without inverse dynamics of a second machine. With the notation of `mechanics.body_poses`, in
normalised time and with a difference :math:`\Delta P` of the pseudo-inertia,

.. math:: \Delta W = (T'' - S \hat g T) \, \Delta P \, T^T = \Lambda \, T \, \Delta P \, T^T

where :math:`\Lambda` depends on the twists, rates and accelerations of the joints between root and
body, and on gravity.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.mechanics.body_poses import AXIAL, BodyPoses, body_poses, pseudo_inertias
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import WRENCH
from zmp_sqp.planning.constraints.protocol import StageModel
from zmp_sqp.planning.program.model import ArmModel

__all__ = ["BodyDifferences"]

ROWS = 12  # entries of the first three rows of a matrix (4, 4)


@dataclass(frozen=True, eq=False)
class BodyDifferences:
    """D differences of inertia from a machine, in J of its bodies.

    Attributes:
        machine: The machine.
        coordinates: Map from planning coordinates to joint coordinates.
        joints: Pinocchio joints that carry the J bodies.
        inertias: Differences of the bodies' pseudo-inertias, shape (D, J, 4, 4) [kg, kg m, kg m^2].
        gravity: Gravity in the root frame while the base stands, shape (3,) [m/s^2].
    """

    machine: Machine
    coordinates: Coordinates
    joints: tuple[int, ...]
    inertias: Array
    gravity: Array

    @classmethod
    def of(cls, model: StageModel, parameters: Array) -> BodyDifferences:
        """Differences from the machine of a model.

        Args:
            model: The model.
            parameters: Differences of the dynamic parameters of the bodies, in the order of
                `dynamic_parameters`, shape (D, number of bodies, 10).
        """
        differ = np.flatnonzero(parameters.any(axis=(0, 2)))
        joints = tuple((differ + 1).tolist())
        inertias = pseudo_inertias(parameters[:, differ])
        gravity = model.gravity if isinstance(model, ArmModel) else np.zeros(3)
        return cls(model.machine, model.coordinates, joints, inertias, gravity)

    def poses(self, q: Array) -> BodyPoses:
        """Forward kinematics at coordinates q, shape (K, n)."""
        return body_poses(self.machine, self.coordinates.joints(q), self.joints)

    def first_moments(self, at: BodyPoses) -> Array:
        """Differences of mass times centre of mass, root frame, shape (D, K, 3) [kg m]."""
        found = np.zeros((len(self.inertias), len(at.twists), 3))
        for _, pose, inertias in self._bodies(at):
            found += (pose[:, :3] @ inertias[:, None, :, 3:])[..., 0]
        return found

    def efforts(self, at: BodyPoses, w: Array, alpha: Array, S: float) -> Array:
        """Differences of S times the ground reaction wrench while the base stands, (D, K, 6).

        Args:
            at: Poses at the K states.
            w, alpha: Derivatives of the coordinates in normalised time, shape (K, n) each.
            S: Squared duration [s^2].
        """
        found = np.zeros((len(self.inertias), len(w), WRENCH))
        w, alpha = self._joint_rates(w), self._joint_rates(alpha)
        for joint, pose, inertias in self._bodies(at):
            columns = self._columns(joint)
            chain = _Chain.of(at.twists[:, columns], w[:, columns], alpha[:, columns])
            reaction = chain.acceleration(S * self.gravity)[:, None, :3] @ _in_root(pose, inertias)
            found += _wrenches(reaction.transpose(1, 0, 2, 3))
        return found

    def derivatives(self, at: BodyPoses, w: Array, alpha: Array, S: float) -> tuple[Array, Array]:
        """Differences as of `efforts`, (D, K, 6), and their Jacobian, (K, D, 6, 3n + 1).

        Args:
            at, w, alpha, S: Arguments of `efforts`.

        Returns:
            Differences, and their Jacobian by (q, w, alpha, S).
        """
        K, D, n = len(w), len(self.inertias), self.coordinates.size
        w, alpha = self._joint_rates(w), self._joint_rates(alpha)
        efforts, jacobian = np.zeros((D, K, WRENCH)), np.zeros((K, D, WRENCH, 3 * n + 1))
        for joint, pose, inertias in self._bodies(at):
            columns = self._columns(joint)
            chain = _Chain.of(at.twists[:, columns], w[:, columns], alpha[:, columns])
            whole = _in_root(pose, inertias)  # (K, D, 4, 4)
            reaction = chain.acceleration(S * self.gravity)[:, None, :3] @ whole
            efforts += _wrenches(reaction.transpose(1, 0, 2, 3))
            changes = np.zeros((K, ROWS, 3 * n + 1))
            parts = [self._by_coordinates(part, columns) for part in chain.derivatives()]
            changes[:, :, : 3 * n] = np.concatenate(parts, axis=2)
            changes[:, 3:ROWS:4, -1] = -self.gravity
            jacobian += (_acting_on(whole) @ changes).reshape(jacobian.shape)
            # the points of the body move, too
            turns = _acting_behind(reaction) @ parts[2]
            jacobian[:, :, 3:, :n] += turns.reshape(K, D, 3, n)
        return efforts, jacobian

    def _bodies(self, at: BodyPoses) -> Iterable[tuple[int, Array, Array]]:
        """Joint, poses (K, 4, 4) and differences (D, 4, 4) of each body."""
        return zip(self.joints, at.poses, self.inertias.swapaxes(0, 1), strict=True)

    def _columns(self, joint: int) -> Indices | slice:
        """Movable joints between the root and a joint, itself included, the root's first."""
        model = self.machine.model
        chain = [model.joints[one].idx_v - WRENCH for one in model.supports[joint]][2:]
        first, count = (chain[0], len(chain)) if chain else (0, 0)
        if chain == list(range(first, first + count)):
            return slice(first, first + count)  # many times as fast as indices
        return np.array(chain, dtype=np.intp)

    def _joint_rates(self, w: Array) -> Array:
        """Rates of all m movable joints from those of the coordinates (K, n), shape (K, m)."""
        return self.machine.coupling.rates(self.coordinates.rates(w))

    def _by_coordinates(self, changes: Array, columns: Indices | slice) -> Array:
        """First three rows of matrices (K, c, 4, 4) by joint, by coordinate, (K, 12, n)."""
        K, c = changes.shape[:2]
        by_joint = np.zeros((K, ROWS, len(self.machine.coupling.leader)))
        by_joint[:, :, columns] = changes[:, :, :3].reshape(K, c, ROWS).transpose(0, 2, 1)
        found = self.machine.coupling.columns(by_joint)
        return found if self.coordinates.is_identity else found @ self.coordinates.G


@dataclass(frozen=True, slots=True, eq=False)
class _Chain:
    r"""Products of the twists of c joints, from the root to a body, at K states.

    Attributes:
        twists: :math:`\hat S_i`, shape (K, c, 4, 4).
        squares: :math:`\hat S_i \hat S_i`.
        before: :math:`\sum_{j < i} w_j \hat S_j \hat S_i`.
        behind: :math:`\sum_{j > i} w_j \hat S_i \hat S_j`.
        rest: :math:`\sum_{j \ge i} w_j \hat S_j`.
        w, alpha: Rates and accelerations of the joints, shape (K, c, 1, 1).
    """

    twists: Array
    squares: Array
    before: Array
    behind: Array
    rest: Array
    w: Array
    alpha: Array

    @classmethod
    def of(cls, twists: Array, w: Array, alpha: Array) -> _Chain:
        """Products from twists (K, c, 4, 4), rates and accelerations of the joints (K, c)."""
        w, alpha = w[:, :, None, None], alpha[:, :, None, None]
        moved = w * twists
        reached = np.cumsum(moved, axis=1)
        before, behind = reached - moved, reached[:, -1:] - reached
        squares, rest = twists @ twists, behind + moved
        return cls(twists, squares, before @ twists, twists @ behind, rest, w, alpha)

    def acceleration(self, weight: Array) -> Array:
        r""":math:`\Lambda`, shape (K, 4, 4), with S times gravity (3,)."""
        found = self._by_first().sum(axis=1)
        found[:, :3, 3] -= weight
        return np.asarray(found)

    def _by_first(self) -> Array:
        """Terms of the second derivative of T by their joint nearest to the root."""
        of_rates = self.w * (self.w * self.squares + 2.0 * self.behind)
        return np.asarray(self.alpha * self.twists + of_rates)

    def derivatives(self) -> tuple[Array, Array, Array]:
        r"""Derivatives of Lambda T by (q, w, alpha) of the joints, times the inverse of T.

        Shape (K, c, 4, 4) each.
        """
        by_first = self._by_first()
        by_last = self.alpha * self.twists
        by_last += self.w * (self.w * self.squares + 2.0 * self.before)
        nearer = np.cumsum(by_last, axis=1) - by_last  # joints before i alone
        reached = np.cumsum(by_first, axis=1)
        farther = reached[:, -1:] - reached + by_first  # joint i and those behind it alone
        by_position = nearer @ self.twists + self.twists @ farther
        by_position += 2.0 * self.before @ self.rest
        by_rate = 2.0 * (self.before + self.behind + self.w * self.squares)
        return by_position, by_rate, self.twists


def _in_root(pose: Array, inertias: Array) -> Array:
    """Pseudo-inertias (D, 4, 4) of a body at poses (K, 4, 4), root frame, shape (K, D, 4, 4)."""
    K, D = len(pose), len(inertias)
    half = (pose @ inertias.transpose(1, 0, 2).reshape(4, 4 * D)).reshape(K, 4, D, 4)
    return np.asarray(half.transpose(0, 2, 1, 3) @ pose[:, None].transpose(0, 1, 3, 2))


def _wrenches(reactions: Array) -> Array:
    """Wrenches (..., 6) of the first three rows of W, shape (..., 3, 4)."""
    found = np.empty((*reactions.shape[:-2], WRENCH))
    found[..., :3] = reactions[..., 3]
    for row, i, j in AXIAL:
        found[..., row] = reactions[..., i, j] - reactions[..., j, i]
    return found


def _acting_on(inertias: Array) -> Array:
    """Matrices that map the 12 entries of A (3, 4) to the wrenches of A P, (K, 6 D, 12).

    Args:
        inertias: P, symmetric, shape (K, D, 4, 4).
    """
    found = np.zeros((*inertias.shape[:2], WRENCH, 3, 4))
    for i in range(3):
        found[:, :, i, i] = inertias[:, :, 3]
    for row, i, j in AXIAL:
        found[:, :, row, i] = inertias[:, :, j]
        found[:, :, row, j] = -inertias[:, :, i]
    return found.reshape(len(inertias), -1, ROWS)


def _acting_behind(reactions: Array) -> Array:
    """Matrices that map the 12 entries of A (3, 4) to the moments of R A^T, (K, 3 D, 12).

    Args:
        reactions: R, shape (K, D, 3, 4).
    """
    found = np.zeros((*reactions.shape[:2], 3, 3, 4))
    for row, i, j in AXIAL:
        found[:, :, row - 3, j] = reactions[:, :, i]
        found[:, :, row - 3, i] = -reactions[:, :, j]
    return found.reshape(len(reactions), -1, ROWS)
