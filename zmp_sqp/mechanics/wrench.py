"""Inverse dynamics of the machine: ground reaction wrench and joint efforts, with derivatives.

"Efforts" are the rows of inverse dynamics: the ground reaction wrench, and the torque or force of
each joint.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.mechanics.joint_coupling import JointCoupling
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.workspace import workspace_of

__all__ = [
    "WRENCH",
    "EffortDerivatives",
    "WrenchDerivatives",
    "effort_derivatives",
    "efforts",
    "ground_reaction",
    "ground_reaction_derivatives",
]

WRENCH = 6  # number of rows of the ground reaction wrench; those of the joints follow


@dataclass(frozen=True, slots=True, eq=False)
class EffortDerivatives:
    """Efforts at K states with their first derivatives.

    The first six rows are the ground reaction wrench (f, tau) about the root origin, root axes
    [N, N m]. If joint efforts are included, n rows follow: the torque of each revolute joint [N m],
    the force of each prismatic joint [N], with the efforts of joints that mimic it.

    Attributes:
        effort: Shape (K, R) with R = 6 or 6 + n.
        by_q, by_v, by_a: Derivatives by Pinocchio's coordinates, rates and accelerations, shape
            (K, R, nv) each.
        coupling: Map from the planned joints to the joints of their columns.
    """

    effort: Array
    by_q: Array
    by_v: Array
    by_a: Array
    coupling: JointCoupling

    @property
    def wrt_position(self) -> Array:
        """Derivatives by the joint coordinates, shape (K, R, n)."""
        return self.coupling.columns(self.by_q[:, :, WRENCH:])

    @property
    def wrt_rate(self) -> Array:
        """Derivatives by the joint rates, shape (K, R, n)."""
        return self.coupling.columns(self.by_v[:, :, WRENCH:])

    @property
    def wrt_joint_acceleration(self) -> Array:
        """Derivatives by the joint accelerations, shape (K, R, n)."""
        return self.coupling.columns(self.by_a[:, :, WRENCH:])

    @property
    def wrt_velocity(self) -> Array:
        """Derivatives by (root twist, joint rates), shape (K, R, 6 + n)."""
        return np.concatenate([self.by_v[:, :, :WRENCH], self.wrt_rate], axis=2)

    @property
    def wrt_acceleration(self) -> Array:
        """Derivatives by (spatial acceleration of the root, joint accelerations), (K, R, 6 + n)."""
        return np.concatenate([self.by_a[:, :, :WRENCH], self.wrt_joint_acceleration], axis=2)

    @property
    def wrench(self) -> Array:
        """Ground reaction wrench (f, tau) about the root origin, root axes, (K, 6) [N, N m]."""
        return self.effort[:, :WRENCH]


WrenchDerivatives = EffortDerivatives  # without joint efforts, R = 6


def ground_reaction(
    machine: Machine,
    q: Array,
    v: Array,
    a: Array,
    *,
    root_acceleration: Array,
    root_velocity: Array | None = None,
) -> Array:
    r"""Wrench that the ground exerts on the machine: the first six rows of inverse dynamics.

    .. math:: (f, \tau) = [M(q) \bar a + h(q, \bar v)]_{1..6}, \quad
              \bar v = (v_{root}, v), \quad \bar a = (a_{root} - g, a)

    with the mass matrix M and the velocity-dependent forces h of the free-floating machine. Gravity
    enters as an acceleration of the root, so that scaling the first three entries of
    `root_acceleration` scales gravity. For point masses, the zero moment point of this wrench is
    eq. (5) of Song & Sharf 2020.

    Args:
        machine: The machine.
        q, v, a: Joint coordinates, rates, accelerations, shape (K, n) each [rad or m, s].
        root_acceleration: Spatial acceleration of the root minus gravity, root frame, shape (6,) or
            (K, 6) [m/s^2, rad/s^2].
        root_velocity: Twist of the root, root frame, shape (6,) or (K, 6) [m/s, rad/s]; None for a
            root that stands still.

    Returns:
        (f, tau) about the root origin, root axes, shape (K, 6) [N, N m].
    """
    return efforts(
        machine,
        q,
        v,
        a,
        root_acceleration=root_acceleration,
        root_velocity=root_velocity,
        joints=False,
    )


def efforts(
    machine: Machine,
    q: Array,
    v: Array,
    a: Array,
    *,
    root_acceleration: Array,
    root_velocity: Array | None = None,
    joints: bool = True,
) -> Array:
    r"""Ground reaction wrench and joint efforts: all rows of inverse dynamics.

    .. math:: e = M(q) \bar a + h(q, \bar v), \quad
              \bar v = (v_{root}, v), \quad \bar a = (a_{root} - g, a)

    with the mass matrix M and the velocity-dependent forces h of the free-floating machine.

    Args:
        machine: The machine.
        q, v, a: Joint coordinates, rates, accelerations, shape (K, n) each [rad or m, s].
        root_acceleration: Spatial acceleration of the root minus gravity, root frame, shape (6,) or
            (K, 6) [m/s^2, rad/s^2].
        root_velocity: Twist of the root, root frame, shape (6,) or (K, 6) [m/s, rad/s]; None for a
            root that stands still.
        joints: Whether the rows of the joints follow those of the wrench.

    Returns:
        Wrench (f, tau) about the root origin, root axes, then the torque or force of each joint
        with those of the joints that mimic it, shape (K, 6 + n), or (K, 6) without joints
        [N, N m].
    """
    states = _stack(machine, q, v, a, root_velocity, root_acceleration)
    found = np.empty((len(states[0]), machine.model.nv))
    # one thread; arrays are passed as the columns that Pinocchio expects, without a copy
    pin.rneaInParallel(1, workspace_of(machine.model).pool, *(part.T for part in states), found.T)
    return machine.coupling.rows(found, WRENCH) if joints else found[:, :WRENCH]


def ground_reaction_derivatives(
    machine: Machine,
    q: Array,
    v: Array,
    a: Array,
    *,
    root_acceleration: Array,
    root_velocity: Array | None = None,
) -> EffortDerivatives:
    """Ground reaction wrench with its analytic first derivatives, R = 6 rows.

    Args:
        machine, q, v, a, root_acceleration, root_velocity: Arguments of `ground_reaction`.
    """
    return effort_derivatives(
        machine,
        q,
        v,
        a,
        root_acceleration=root_acceleration,
        root_velocity=root_velocity,
        joints=False,
    )


def effort_derivatives(
    machine: Machine,
    q: Array,
    v: Array,
    a: Array,
    *,
    root_acceleration: Array,
    root_velocity: Array | None = None,
    joints: bool = True,
) -> EffortDerivatives:
    """Ground reaction wrench and joint efforts with their analytic first derivatives.

    The pose of the root is not an argument: in the root frame, efforts depend on that pose only
    through gravity, which is part of `root_acceleration`.

    Args:
        machine, q, v, a, root_acceleration, root_velocity, joints: Arguments of `efforts`.
    """
    states = _stack(machine, q, v, a, root_velocity, root_acceleration)
    model, data = machine.model, workspace_of(machine.model).data
    count, size, nv = len(states[0]), model.nv if joints else WRENCH, model.nv
    effort = np.empty((count, size))
    by_q, by_v, by_a = np.empty((3, count, size, nv))
    differentiate = pin.computeRNEADerivatives
    # views of the memory that Pinocchio writes into; M's lower triangle stays empty
    tau, dtau_dq, dtau_dv, mass = data.tau, data.dtau_dq, data.dtau_dv, data.M
    if not joints:
        tau, dtau_dq, dtau_dv = tau[:WRENCH], dtau_dq[:WRENCH], dtau_dv[:WRENCH]
        mass = mass[:WRENCH]
    for row, (one_q, one_v, one_a) in enumerate(zip(*states, strict=True)):
        differentiate(model, data, one_q, one_v, one_a)
        effort[row], by_q[row], by_v[row], by_a[row] = tau, dtau_dq, dtau_dv, mass
    lower = _lower_triangle(size)
    by_a[:, lower[0], lower[1]] = by_a[:, lower[1], lower[0]]
    coupling = machine.coupling
    if joints:
        effort, by_q, by_v, by_a = (
            coupling.rows(part, WRENCH) for part in (effort, by_q, by_v, by_a)
        )
    return EffortDerivatives(effort, by_q, by_v, by_a, coupling)


@lru_cache(maxsize=64)
def _lower_triangle(size: int) -> tuple[Indices, Indices]:
    """Rows and columns of the entries below the diagonal."""
    return np.tril_indices(size, -1)


def _stack(
    machine: Machine,
    q: Array,
    v: Array,
    a: Array,
    root_velocity: Array | None,
    root_acceleration: Array,
) -> tuple[Array, Array, Array]:
    """States as Pinocchio takes them: q (K, nq), v (K, nv) and a (K, nv), the root first."""
    velocity, acceleration = np.zeros((2, len(q), machine.model.nv))
    velocity[:, WRENCH:] = machine.coupling.rates(v)
    acceleration[:, WRENCH:] = machine.coupling.rates(a)
    acceleration[:, :WRENCH] = root_acceleration
    if root_velocity is not None:
        velocity[:, :WRENCH] = root_velocity
    return machine.configuration(q), velocity, acceleration
