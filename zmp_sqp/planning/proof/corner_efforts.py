r"""Inverse dynamics of one motion for several corners of payload and slope at once.

The ground reaction wrench is linear in the mass, first moment and inertia of every body, and in the
acceleration of the root minus gravity. Corners that differ in payload and slope alone therefore
need one inverse dynamics and the kinematics of the bodies that differ:

.. math::
    f_c = f_0 + \sum_j \Delta f_j + m_c \, \Delta a, \quad
    \tau_c = \tau_0 + \sum_j \Delta \tau_j + s_c \times \Delta a

Here :math:`\Delta f_j` and :math:`\Delta \tau_j` come from the differences of the inertial
parameters of body j, :math:`m_c` and :math:`s_c` are mass and first moment of the machine of corner
c, and :math:`\Delta a` is the difference of the root's acceleration minus gravity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array, Indices, frozen_array
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.ground import Ground, Slope, terrain_of
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.uncertainty import Corner
from zmp_sqp.mechanics.workspace import workspace_of
from zmp_sqp.mechanics.wrench import WRENCH, efforts
from zmp_sqp.motion.trajectory import Trajectory

__all__ = ["CornerEfforts", "gravity_of", "grouped"]

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class CornerEfforts:
    """Inverse dynamics at C corners whose machines differ in the inertia of bodies alone.

    Attributes:
        corners: At least one. All grounds are slopes if the base drives and there are several.
        trajectory: Motion of the joints and of the base.
        joints: Whether the efforts of the joints follow the wrench.
    """

    corners: Sequence[Corner]
    trajectory: Trajectory
    joints: bool

    def at(self, interval: Indices, since: Array) -> Array:
        """Efforts at K times, shape (K, C, R) [N, N m].

        Args:
            interval: Interval of each time, shape (K,).
            since: Times after the starts of these intervals, shape (K,) [s].
        """
        q, v, a = self.trajectory.state_in(interval, since)
        twist, roots = self._root_motions(interval, since)
        numbers, machines = _numbered([corner.machine for corner in self.corners])
        grounds, _ = _numbered([corner.ground for corner in self.corners])
        if self.joints or len(self.corners) == 1:
            every = [
                efforts(
                    machines[number],
                    q,
                    v,
                    a,
                    root_acceleration=roots[ground],
                    root_velocity=twist,
                    joints=self.joints,
                )
                for number, ground in zip(numbers, grounds, strict=True)
            ]
            return np.stack(every, axis=1)
        first = machines[0]
        wrench = efforts(
            first, q, v, a, root_acceleration=roots[0], root_velocity=twist, joints=False
        )
        bodies = _differing_bodies(machines)
        kinematics = _Kinematics.of(first, (q, v, a), twist, roots[0], bodies)
        forces, moments, first_moments = _differences(machines, bodies, kinematics)  # (K, U, 3)
        forces, moments = forces + wrench[:, None, :3], moments + wrench[:, None, 3:]
        first_moments = first_moments + kinematics.first_moment[:, None]
        masses = np.array([machine.mass for machine in machines])
        change = np.stack([np.broadcast_to(root, (len(q), WRENCH)) for root in roots], axis=1)
        change = (change - change[:, :1])[..., :3]  # (K, G, 3)
        found = np.empty((len(q), len(self.corners), WRENCH))
        for number in range(len(machines)):
            at = [i for i, other in enumerate(numbers) if other == number]
            changes = change[:, [grounds[i] for i in at]]
            moment = _cross(first_moments[:, number, None], changes)
            found[:, at, :3] = forces[:, number, None] + masses[number] * changes
            found[:, at, 3:] = moments[:, number, None] + moment
        return found

    def _root_motions(self, interval: Indices, since: Array) -> tuple[Array | None, list[Array]]:
        """Twist of the root, and for each distinct ground its acceleration minus gravity."""
        _, grounds = _numbered([corner.ground for corner in self.corners])
        base = self.trajectory.base
        if base is None:
            return None, [np.append(-gravity_of(ground), np.zeros(3)) for ground in grounds]
        state = base.state_in(interval, since)
        support = self.corners[0].machine.support
        height = 0.0 if support is None else support.height
        terrains = [terrain_of(ground) for ground in grounds]
        motions = [terrain.base_motion(*state).at_support_height(height) for terrain in terrains]
        return motions[0].velocity, [motion.acceleration for motion in motions]


def gravity_of(ground: Ground) -> Array:
    """Gravity in the root frame of a machine that stands at yaw = 0, shape (3,) [m/s^2].

    Raises:
        ProblemError: The ground gives no three finite numbers.
    """
    return frozen_array(ground.gravity(), name="gravity", shape=(3,), error=ProblemError)


def grouped(corners: Sequence[Corner], trajectory: Trajectory) -> list[list[Corner]]:
    """Groups of corners that can be proven together: one group of all, or one for each corner.

    Corners can be proven together if their machines differ in inertia alone and if the base stands
    or all grounds are slopes.
    """
    _, machines = _numbered([corner.machine for corner in corners])
    together = all(_same_joints(machines[0], machine) for machine in machines[1:])
    if trajectory.base is not None:
        together = together and all(isinstance(corner.ground, Slope) for corner in corners)
    return [list(corners)] if together else [[corner] for corner in corners]


def _same_joints(one: Machine, other: Machine) -> bool:
    """Whether two machines have the same joints and support polygon."""
    if one is other:
        return True
    first, second = one.model, other.model
    if one.support is not other.support or first.njoints != second.njoints:
        return False
    if not one.coupling.equals(other.coupling):
        return False
    return list(first.parents) == list(second.parents) and all(
        first.joints[i] == second.joints[i]  # kind and axis
        and first.jointPlacements[i] == second.jointPlacements[i]
        for i in range(first.njoints)
    )


def _numbered(objects: Sequence[T]) -> tuple[list[int], list[T]]:
    """Index of each object in the list of distinct objects, and this list."""
    number_of: dict[int, int] = {}
    distinct: list[T] = []
    for one in objects:
        if id(one) not in number_of:
            number_of[id(one)] = len(distinct)
            distinct.append(one)
    return [number_of[id(one)] for one in objects], distinct


def _differing_bodies(machines: Sequence[Machine]) -> list[int]:
    """Joints whose bodies differ in inertia between machines."""
    inertias = [machine.model.inertias for machine in machines]
    return [
        joint
        for joint in range(1, machines[0].model.njoints)
        if any(inertia[joint] != inertias[0][joint] for inertia in inertias[1:])
    ]


@dataclass(frozen=True, slots=True, eq=False)
class _Kinematics:
    """Motion of B bodies at K times, and the first moment of the whole machine.

    Attributes:
        rotation: Rotation from joint axes to root axes, shape (B, K, 3, 3).
        position: Position of each joint in the root frame, shape (B, K, 3) [m].
        twist: Spatial velocity in joint axes, linear part first, shape (B, K, 6) [m/s, rad/s].
        acceleration: Spatial acceleration minus gravity in joint axes, shape (B, K, 6).
        first_moment: First moment of the machine about the root origin, root axes, shape (K, 3)
            [kg m].
    """

    rotation: Array
    position: Array
    twist: Array
    acceleration: Array
    first_moment: Array

    @classmethod
    def of(
        cls,
        machine: Machine,
        joint_states: tuple[Array, Array, Array],
        twist: Array | None,
        root_acceleration: Array,
        bodies: Sequence[int],
    ) -> _Kinematics:
        """Forward kinematics of K joint states (q, v, a), shape (K, n) each."""
        q, v, a = joint_states
        velocity, acceleration = np.zeros((2, len(q), machine.model.nv))
        velocity[:, WRENCH:] = machine.coupling.rates(v)
        acceleration[:, WRENCH:] = machine.coupling.rates(a)
        acceleration[:, :WRENCH] = root_acceleration
        if twist is not None:
            velocity[:, :WRENCH] = twist
        model, data = machine.model, workspace_of(machine.model).data
        count = len(bodies), len(q)
        found = cls(
            np.empty((*count, 3, 3)),
            np.empty((*count, 3)),
            np.empty((*count, 6)),
            np.empty((*count, 6)),
            np.empty((len(q), 3)),
        )
        states = zip(machine.configuration(q), velocity, acceleration, strict=True)
        # views of the memory that Pinocchio writes into
        moved = [(data.oMi[joint], data.v[joint], data.a[joint]) for joint in bodies]
        views = [(p.rotation, p.translation, v.vector, a.vector) for p, v, a in moved]
        for k, state in enumerate(states):
            found.first_moment[k] = pin.centerOfMass(model, data, state[0], False)
            if bodies:
                pin.forwardKinematics(model, data, *state)
            for b, (rotation, position, twist_now, acceleration_now) in enumerate(views):
                found.rotation[b, k], found.position[b, k] = rotation, position
                found.twist[b, k], found.acceleration[b, k] = twist_now, acceleration_now
        found.first_moment[:] *= machine.mass
        return found


def _differences(
    machines: Sequence[Machine], bodies: Sequence[int], motion: _Kinematics
) -> tuple[Array, Array, Array]:
    """Differences between each of U machines and the first one.

    Returns:
        Differences of the force, of the moment about the root origin, and of the first moment, root
        axes, shape (K, U, 3) each [N, N m, kg m].
    """
    shape = len(motion.first_moment), len(machines), 3
    force, moment, first_moment = (np.zeros(shape) for _ in range(3))
    for b, joint in enumerate(bodies):
        parameters = [_parameters(machine.model.inertias[joint]) for machine in machines]
        m, h, inertia = (
            np.stack([part - parts[0] for part in parts]) for parts in zip(*parameters, strict=True)
        )  # (U, 1), (U, 3), (U, 3, 3)
        twist, acceleration = motion.twist[b, :, None], motion.acceleration[b, :, None]
        v, w, a, turn = twist[..., :3], twist[..., 3:], acceleration[..., :3], acceleration[..., 3:]
        momentum = m * v + _cross(w, h)  # (K, U, 3)
        f = m * a + _cross(turn, h) + _cross(w, momentum)
        angular = np.einsum("kj,uij->kui", w[:, 0], inertia) + _cross(h, v)
        tau = np.einsum("kj,uij->kui", turn[:, 0], inertia) + _cross(h, a)
        tau += _cross(w, angular) + _cross(v, momentum)
        rotation, at = motion.rotation[b].transpose(0, 2, 1), motion.position[b, :, None]
        f, tau, h = f @ rotation, tau @ rotation, h @ rotation
        force += f
        moment += tau + _cross(at, f)
        first_moment += h + m * at
    return force, moment, first_moment


def _parameters(body: Any) -> tuple[Array, Array, Array]:
    """Mass, first moment and inertia about the joint of a body, joint axes."""
    mass, lever = body.mass, body.lever
    about_joint = body.inertia + mass * (lever @ lever * np.eye(3) - np.outer(lever, lever))
    return np.array([mass]), mass * lever, about_joint


def _cross(one: Array, other: Array) -> Array:
    """Cross product along the last axis; several times faster than `np.cross`."""
    x, y, z = one[..., 0], one[..., 1], one[..., 2]
    u, v, w = other[..., 0], other[..., 1], other[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)
