r"""Second derivatives of the ground reaction wrench of a machine that stands, in closed form.

The notation is that of `body_poses`. In normalised time s = t / T, with q' = w, q'' = alpha and
S = T^2, the reaction of all bodies b is

.. math:: W = \sum_b T_b'' P_b T_b^T - S \hat g \sum_b T_b P_b T_b^T

Let :math:`j < i` be the joints in front of joint i, on its way from the root, and :math:`j > i`
those behind it. The derivatives of a pose by s, without those of joint i and the joints behind it,
are products with

.. math:: V_i = \sum_{j<i} w_j \hat S_j, \quad
          A_i = \sum_{j<i} (\alpha_j + w_j^2 \hat S_j + 2 w_j V_j) \hat S_j

Three sums are taken over the bodies b that joint i moves:

.. math:: \textstyle G_i = \sum_b T_b P_b T_b^T, \quad
          \sum_b T_b' P_b T_b^T = V_i G_i + Z_i, \quad
          \sum_b T_b'' P_b T_b^T = A_i G_i + 2 V_i Z_i + N_i

.. math:: E_i = \hat S_i G_i, \quad Z_i = \sum_{j \ge i} w_j E_j, \quad
          N_i = \sum_{j \ge i} (w_j \hat S_j (w_j E_j + 2 \sum_{k>j} w_k E_k) + \alpha_j E_j)

Their derivatives by :math:`q_i` are

.. math:: e_i = E_i + E_i^T, \quad
          x_i = X_i + (V_i G_i + Z_i) \hat S_i^T, \quad
          y_i = Y_i + (A_i G_i + 2 V_i Z_i + N_i) \hat S_i^T

.. math:: X_i = V_i E_i + \hat S_i Z_i, \quad
          Y_i = A_i E_i + 2 V_i \hat S_i Z_i + \hat S_i N_i

W has the derivatives :math:`y_i - S \hat g e_i` by :math:`q_i`, :math:`2 X_i` by
:math:`w_i` and :math:`E_i` by :math:`\alpha_i`. For a joint k in front of joint i, or joint i
itself, the second derivatives are

.. math::
    \partial^2 W / \partial q_k \partial q_i &= \sigma_k'' e_i + 2 \sigma_k' x_i + \hat S_k y_i
        + (y_i - S \hat g e_i) \hat S_k^T \\
    \partial^2 W / \partial q_k \partial w_i &= 2 (\sigma_k' E_i + \hat S_k X_i + X_i \hat S_k^T) \\
    \partial^2 W / \partial w_k \partial q_i &= 2 (\sigma_k' e_i + \hat S_k x_i) \\
    \partial^2 W / \partial q_k \partial \alpha_i &= \hat S_k E_i + E_i \hat S_k^T, \quad
    \partial^2 W / \partial \alpha_k \partial q_i = \hat S_k e_i, \quad
    \partial^2 W / \partial w_k \partial w_i = 2 \hat S_k E_i

with :math:`\sigma_k' = V_k \hat S_k - \hat S_k V_k` and :math:`\sigma_k'' = A_k \hat S_k -
\hat S_k A_k - 2 \sigma_k' V_k`. All other second derivatives are zero, but for
:math:`\partial^2 W / \partial q_i \partial S = -\hat g e_i`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.body_poses import AXIAL, body_poses, dynamic_parameters, pseudo_inertias
from zmp_sqp.mechanics.machine import Machine

__all__ = ["wrench_hessian"]

ROOT = 1  # index of the root's Pinocchio joint; those of the movable joints follow


def wrench_hessian(
    machine: Machine,
    q: Array,
    w: Array,
    alpha: Array,
    S: float,
    *,
    gravity: Array,
    weights: Array,
    parameters: Array | None = None,
) -> Array:
    r"""Hessian of weights . S (f, tau) by (q, w, alpha, S) of the movable joints.

    Args:
        machine: The machine, whose base stands.
        q: Joint coordinates, shape (K, n) [rad or m].
        w, alpha: First and second derivatives by normalised time of the coordinates of all m
            movable joints, shape (K, m) each.
        S: Squared duration [s^2].
        gravity: Gravity in the root frame, shape (3,) or (K, 3) [m/s^2].
        weights: Weights of the six rows of the wrench, shape (K, 6).
        parameters: Dynamic parameters of the bodies in each state, shape (K, J, 10); None for those
            of the machine.

    Returns:
        Symmetric matrices, shape (K, 3m + 1, 3m + 1).
    """
    m = w.shape[1]
    at = body_poses(machine, q, range(ROOT + 1, ROOT + 1 + m))
    if parameters is None:
        parameters = dynamic_parameters(machine)[None]
    poses, inertias = at.poses.transpose(1, 0, 2, 3), pseudo_inertias(parameters[:, 1:])
    bodies = poses @ inertias @ np.ascontiguousarray(poses.transpose(0, 1, 3, 2))
    tree = _tree(tuple(machine.model.parents))
    return _hessian(tree, at.twists, bodies, w, alpha, S, gravity, _dual(weights))


@dataclass(frozen=True, slots=True, eq=False)
class _Tree:
    """Which of m joints are in front of which.

    Attributes:
        front: One where the joint of the column is in front of that of the row, shape (m, m).
        behind: One where it is behind.
        itself: Identity.
    """

    front: Array
    behind: Array
    itself: Array

    @property
    def moved(self) -> Array:
        """One where the joint of the row moves the body of the column, shape (m, m)."""
        return self.behind + self.itself


@lru_cache(maxsize=64)
def _tree(parents: tuple[int, ...]) -> _Tree:
    """Order of the movable joints, from the indices of the Pinocchio joints' parents."""
    m = len(parents) - ROOT - 1
    front = np.zeros((m, m))
    for i in range(m):
        joint = parents[ROOT + 1 + i]
        while joint > ROOT:
            front[i, joint - ROOT - 1] = 1.0
            joint = parents[joint]
    return _Tree(front, np.ascontiguousarray(front.T), np.eye(m))


def _hessian(
    tree: _Tree,
    twists: Array,
    bodies: Array,
    w: Array,
    alpha: Array,
    S: float,
    gravity: Array,
    dual: Array,
) -> Array:
    """Hessian from the twists and the bodies' pseudo-inertias in the root frame.

    Names are those of the module's formulas.
    """
    K, m = w.shape
    w, alpha = w[:, :, None, None], alpha[:, :, None, None]
    G = _summed(tree.moved, bodies)
    E, of_rates = twists @ G, w * twists
    V = _summed(tree.front, of_rates)
    V_twists = V @ twists
    A = _summed(tree.front, w * (of_rates @ twists + 2.0 * V_twists) + alpha * twists)
    rates = w * E
    farther = _summed(tree.behind, rates)
    Z = farther + rates
    N = _summed(tree.moved, of_rates @ (rates + 2.0 * farther) + alpha * E)
    turning, twists_Z = V_twists - twists @ V, twists @ Z
    turning_again = A @ twists - twists @ A - 2.0 * turning @ V
    # products with a transposed matrix on the right take twice as long as with its copy
    back = np.ascontiguousarray(twists.transpose(0, 1, 3, 2))
    X = V @ E + twists_Z
    Y = A @ E + 2.0 * V @ twists_Z + twists @ N
    e = E + E.transpose(0, 1, 3, 2)
    x = X + (V @ G + Z) @ back
    y = Y + (A @ G + 2.0 * V @ Z + N) @ back
    fall = _falling(gravity) @ e
    of_twists = back @ dual  # <dual, S B> = <S^T dual, B>, <dual, B S^T> = <dual S, B>
    of_turning = turning.transpose(0, 1, 3, 2) @ dual
    both = of_twists + dual @ twists
    again = turning_again.transpose(0, 1, 3, 2) @ dual
    parts = [again, 2.0 * of_turning, of_twists, dual @ twists]
    of_q = _inner(parts, [e, x, y, y - S * fall])
    q_w = 2.0 * _inner([of_turning, both], [E, X]), 2.0 * _inner([of_turning, of_twists], [e, x])
    q_alpha = _inner([both], [E]), _inner([of_twists], [e])
    of_w = 2.0 * _inner([of_twists], [E])
    found = np.zeros((K, 3 * m + 1, 3 * m + 1))
    found[:, :m, :m] = _ordered(tree, of_q, of_q)
    found[:, :m, m : 2 * m] = _ordered(tree, *q_w)
    found[:, :m, 2 * m : 3 * m] = _ordered(tree, *q_alpha)
    found[:, :m, 3 * m] = -(fall * dual).sum(axis=(2, 3))
    found[:, m:, :m] = found[:, :m, m:].transpose(0, 2, 1)
    found[:, m : 2 * m, m : 2 * m] = _ordered(tree, of_w, of_w)
    return found


def _summed(chosen: Array, values: Array) -> Array:
    """Sums over chosen joints (m, m) of matrices (K, m, 4, 4), for each joint of a row."""
    K, m = values.shape[:2]
    return np.asarray((chosen @ values.reshape(K, m, 16)).reshape(K, m, 4, 4))


def _inner(left: list[Array], right: list[Array]) -> Array:
    """Sums over pairs of the inner products of matrices (K, m, 4, 4), for all joints, (K, m, m)."""
    K, m = left[0].shape[:2]
    one, two = (
        np.concatenate([part.reshape(K, m, 16) for part in parts], axis=2)
        for parts in (left, right)
    )
    return np.asarray(one @ two.transpose(0, 2, 1))


def _ordered(tree: _Tree, first: Array, second: Array) -> Array:
    """Derivatives by two joints, from those where the first, or the second, is in front.

    Args:
        tree: Order of the joints.
        first: Entries where the joint of the row is that of the column or in front of it.
        second: Entries, transposed, where it is behind.
    """
    return np.asarray(first * tree.moved + (second * tree.behind).transpose(0, 2, 1))


def _dual(weights: Array) -> Array:
    """Matrices L with <L, W> = weights . (f, tau), shape (K, 1, 4, 4), from weights (K, 6)."""
    found = np.zeros((len(weights), 1, 4, 4))
    found[:, 0, :3, 3] = weights[:, :3]
    for row, i, j in AXIAL:
        found[:, 0, i, j] = weights[:, row]
        found[:, 0, j, i] = -weights[:, row]
    return found


def _falling(gravity: Array) -> Array:
    """Matrices of a translation by gravity, shape (1 or K, 1, 4, 4)."""
    gravity = np.atleast_2d(gravity)
    found = np.zeros((len(gravity), 1, 4, 4))
    found[:, 0, :3, 3] = gravity
    return found
