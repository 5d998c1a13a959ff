r"""Poses of bodies and twists of joints as matrices (4, 4), for many states at once.

The pseudo-inertia of a body with points x, in homogeneous coordinates of the body's frame, is
:math:`P = \int \bar x \bar x^T dm` (Wensing, Kim & Slotine 2018). With the pose T of the body in
the root frame, its points are at :math:`\bar r = T \bar x`. Their accelerations give the force f
and the moment :math:`\tau` about the root origin that move the body:

.. math:: W = \int \ddot{\bar r}\, \bar r^T dm = \ddot T P T^T, \quad
          f_i = W_{i4}, \quad \tau = (W_{32} - W_{23}, \; W_{13} - W_{31}, \; W_{21} - W_{12})

The twist of joint i at unit rate, in root axes, is a matrix :math:`\hat S_i`. All derivatives of T
by the joint coordinates are products of twists, ordered from the root to the body:

.. math:: \partial_i T = \hat S_i T, \quad \partial_i \partial_j T = \hat S_i \hat S_j T
          \quad \text{if joint i is joint j or in front of it, and so on}
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.workspace import workspace_of
from zmp_sqp.mechanics.wrench import WRENCH

__all__ = ["AXIAL", "BodyPoses", "body_poses", "dynamic_parameters", "pseudo_inertias"]

AXIAL = ((3, 2, 1), (4, 0, 2), (5, 1, 0))  # row of the wrench, and i, j: it is W_ij - W_ji


@dataclass(frozen=True, slots=True, eq=False)
class BodyPoses:
    """Poses of J bodies at K states, with the twists of the joints.

    Attributes:
        poses: T, from the frame of the body's joint to the root frame, shape (J, K, 4, 4).
        twists: Twists of all m movable joints, shape (K, m, 4, 4).
        first_moment: Mass times centre of mass of the machine, root frame, shape (K, 3) [kg m].
    """

    poses: Array
    twists: Array
    first_moment: Array


def body_poses(machine: Machine, q: Array, joints: Sequence[int]) -> BodyPoses:
    """Forward kinematics of K states.

    Args:
        machine: The machine.
        q: Joint coordinates, shape (K, n) [rad or m].
        joints: Indices of the J Pinocchio joints that carry the bodies.
    """
    model, data = machine.model, workspace_of(machine.model).data
    poses = np.zeros((len(joints), len(q), 4, 4))
    poses[:, :, 3, 3] = 1.0
    first_moment, twists = np.empty((len(q), 3)), np.empty((len(q), WRENCH, model.nv))
    # views of the memory that Pinocchio writes into, and of that of the results
    placed = [data.oMi[joint] for joint in joints]
    views = [
        (one.rotation, one.translation, found[:, :3, :3], found[:, :3, 3])
        for one, found in zip(placed, poses, strict=True)
    ]
    jacobian, jacobians_of = data.J, pin.computeJointJacobians
    centre_of_mass: Any = pin.centerOfMass
    for k, one in enumerate(machine.configuration(q)):
        first_moment[k] = centre_of_mass(model, data, one, False)
        jacobians_of(model, data)
        twists[k] = jacobian
        for rotation, position, rotations, positions in views:
            rotations[k], positions[k] = rotation, position
    first_moment *= machine.mass
    return BodyPoses(poses, _matrices(twists[:, :, WRENCH:]), first_moment)


def _matrices(twists: Array) -> Array:
    """Twists (K, 6, m), linear part first, as matrices, shape (K, m, 4, 4)."""
    K, _, m = twists.shape
    found = np.zeros((K, m, 4, 4))
    found[:, :, :3, 3] = twists[:, :3].transpose(0, 2, 1)
    for row, i, j in AXIAL:
        found[:, :, i, j] = twists[:, row]
        found[:, :, j, i] = -twists[:, row]
    return found


def dynamic_parameters(machine: Machine) -> Array:
    """Pinocchio's dynamic parameters of the body at each joint from the root on, (J, 10).

    They are mass, first moment, and xx, xy, yy, xz, yz, zz of the inertia about the joint.
    """
    inertias: Any = machine.model.inertias
    return np.array([inertias[i].toDynamicParameters() for i in range(1, machine.model.njoints)])


def pseudo_inertias(parameters: Array) -> Array:
    """Pseudo-inertias (..., 4, 4) of dynamic parameters (..., 10)."""
    found = np.empty((*parameters.shape[:-1], 4, 4))
    found[..., 3, 3] = parameters[..., 0]
    found[..., :3, 3] = found[..., 3, :3] = parameters[..., 1:4]
    inertia = parameters[..., [4, 5, 7, 5, 6, 8, 7, 8, 9]]
    inertia = inertia.reshape(*parameters.shape[:-1], 3, 3)
    half_trace = 0.5 * np.trace(inertia, axis1=-2, axis2=-1)
    found[..., :3, :3] = half_trace[..., None, None] * np.eye(3) - inertia
    return found
