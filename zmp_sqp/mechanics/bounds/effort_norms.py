r"""Bounds on the size of inverse dynamics at real and at complex times.

Along a motion whose joint coordinates are polynomials of time, the efforts of inverse dynamics are
entire functions of time. How large they can be at complex times near an interval decides how well
a polynomial can approximate them inside it (see `effort_curves`).

A joint that turns by :math:`q = x + i y` rotates vectors by
:math:`\exp(x [z]_\times) \exp(i y [z]_\times)`. The second factor is Hermitian with the eigenvalues
1 and :math:`e^{\pm y}`, so that the rotation and its inverse lengthen a complex vector at most by
:math:`e^{|y|}`. The cross product of complex vectors keeps :math:`|a \times b| \le |a| |b|`. Norms
can therefore be propagated along the recursion of Newton and Euler in the axes of the links: from
the root to the tips

.. math::
    |\omega_i| \le e^{|y|} |\omega_p| + |\dot q|, \quad
    |\dot\omega_i| \le e^{|y|} (|\dot\omega_p| + |\omega_p| |\dot q|) + |\ddot q|, \quad
    |\ddot p_i| \le e^{|y|} (|\ddot p_p| + (|\dot\omega_p| + |\omega_p|^2) |r_i|)

and back, with the mass m, its first moment h and the inertia I about the joint,

.. math::
    |f_i| \le m |\ddot p_i| + h (|\dot\omega_i| + |\omega_i|^2), \quad
    |n_i| \le h |\ddot p_i| + I (|\dot\omega_i| + |\omega_i|^2)

At real times y = 0, and these are the sums of the absolute values of all terms of inverse dynamics.
Rounding errors are a small multiple of machine precision times them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.bounds.effort_bounds import FIRST, EffortBound, is_prismatic
from zmp_sqp.mechanics.inertia import spectral_norm
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.workspace import workspace_of

__all__ = ["BodyNorms", "Norms", "body_norms", "effort_size"]


@dataclass(frozen=True, slots=True)
class BodyNorms:
    """Norms of the bodies that are fixed to one joint.

    Attributes:
        parent: Pinocchio's index of the joint before.
        column: Index of the planned joint that the joint follows; -1 for the root.
        multiplier: Size of its multiplier |m|: the joint moves |m| times as much as that joint.
        shift: Size of its coordinate where that of the planned joint is zero [rad or m].
        slides: Whether the joint is prismatic.
        offset: Distance from the joint before, at coordinate zero [m].
        mass: Mass m [kg].
        first_moment: m times the distance of their centre of mass from the joint [kg m].
        inertia: Spectral norm of the inertia about the joint [kg m^2].
    """

    parent: int
    column: int
    multiplier: float
    shift: float
    slides: bool
    offset: float
    mass: float
    first_moment: float
    inertia: float


class Norms(NamedTuple):
    """Norms of the joints' and the root's motion at K times, real or complex.

    Attributes:
        imaginary: Largest |imaginary part| of each coordinate, shape (n, K) [rad or m].
        q, v, a: Largest |coordinate|, |rate| and |acceleration|, shape (n, K).
        root_spin: Largest |angular velocity| of the root, shape (K,) [rad/s].
        root_turn: Largest |angular acceleration| of the root, shape (K,) [rad/s^2].
        root_acceleration: Largest |acceleration of the root origin minus gravity|, shape (K,)
            [m/s^2].
    """

    imaginary: Array
    q: Array
    v: Array
    a: Array
    root_spin: Array
    root_turn: Array
    root_acceleration: Array


def body_norms(machines: Sequence[Machine]) -> tuple[BodyNorms, ...]:
    """Norms of the bodies of several machines with the same joints, the largest of each norm.

    Returns:
        One per joint of Pinocchio's model but the universe, from root to tip.
    """
    distinct = tuple({id(machine): machine for machine in machines}.values())
    return _body_norms(distinct, tuple(workspace_of(one.model).version for one in distinct))


@lru_cache(maxsize=16)
def _body_norms(machines: tuple[Machine, ...], versions: tuple[int, ...]) -> tuple[BodyNorms, ...]:
    """`body_norms` of distinct machines, whose models may have changed since the last version."""
    first = machines[0].model
    coupling = machines[0].coupling
    inertias = [list(machine.model.inertias)[1:] for machine in machines]
    mass = np.array([[body.mass for body in row] for row in inertias])
    lever = np.linalg.norm([[body.lever for body in row] for row in inertias], axis=2)
    about_com = spectral_norm([[body.inertia for body in row] for row in inertias])
    largest = (mass, mass * lever, about_com + mass * lever**2)
    bodies = np.stack([part.max(axis=0) for part in largest], axis=1)
    return tuple(
        BodyNorms(
            first.parents[joint],
            int(coupling.leader[joint - FIRST]) if joint > 1 else -1,
            abs(float(coupling.multiplier[joint - FIRST])) if joint > 1 else 0.0,
            abs(float(coupling.offset[joint - FIRST])) if joint > 1 else 0.0,
            joint > 1 and is_prismatic(first, joint),
            float(np.linalg.norm(first.jointPlacements[joint].translation)),
            *(float(value) for value in bodies[joint - 1]),
        )
        for joint in range(1, first.njoints)
    )


def effort_size(bodies: Sequence[BodyNorms], norms: Norms, *, joints: bool = False) -> EffortBound:
    """Bound on the efforts of inverse dynamics at K times.

    Args:
        bodies: Norms of the machine's bodies, see `body_norms`.
        norms: Norms of the motion.
        joints: Whether to bound the joints' efforts too.
    """
    count = len(bodies) + 1
    driven = _of_joints(bodies, norms)
    longer = np.exp(driven.imaginary)  # factor by which a joint's rotation may lengthen a vector
    spin, turn, acceleration = ([norms.root_spin] * count for _ in range(3))
    turn[1], acceleration[1] = norms.root_turn, norms.root_acceleration
    offset: list[Array | float] = [0.0] * count
    force, moment = [norms.root_spin] * count, [norms.root_spin] * count
    for joint, body in enumerate(bodies, start=1):
        parent, i = body.parent, joint - FIRST
        if joint > 1:
            turned = turn[parent] + spin[parent] ** 2
            offset[joint] = body.offset + driven.q[i] if body.slides else body.offset
            carried = acceleration[parent] + turned * offset[joint]
            if body.slides:
                spin[joint], turn[joint] = spin[parent], turn[parent]
                acceleration[joint] = carried + 2.0 * spin[parent] * driven.v[i] + driven.a[i]
            else:
                before = longer[i] * spin[parent]
                spin[joint] = before + driven.v[i]
                turn[joint] = longer[i] * turn[parent] + before * driven.v[i] + driven.a[i]
                acceleration[joint] = longer[i] * carried
        turned = turn[joint] + spin[joint] ** 2
        force[joint] = body.mass * acceleration[joint] + body.first_moment * turned
        moment[joint] = body.first_moment * acceleration[joint] + body.inertia * turned
    of_joints = np.zeros((norms.v.shape[1], len(norms.v) if joints else 0))
    for joint in range(count - 1, 1, -1):  # from tip to root
        body = bodies[joint - 1]
        parent, i = body.parent, joint - FIRST
        if joints:
            own = force[joint] if body.slides else moment[joint]
            of_joints[:, body.column] += body.multiplier * own
        if not body.slides:
            force[joint], moment[joint] = longer[i] * force[joint], longer[i] * moment[joint]
        force[parent] = force[parent] + force[joint]
        moment[parent] = moment[parent] + moment[joint] + offset[joint] * force[joint]
    return EffortBound(force[1], moment[1], of_joints)


def _of_joints(bodies: Sequence[BodyNorms], norms: Norms) -> Norms:
    """Norms of the motion of all joints behind the root, from those of the planned joints."""
    moving = bodies[1:]
    leader = np.array([body.column for body in moving], dtype=np.intp)
    factor = np.array([[body.multiplier] for body in moving]).reshape(-1, 1)
    shift = np.array([[body.shift] for body in moving]).reshape(-1, 1)
    imaginary, q, v, a = (part[leader] * factor for part in norms[:4])
    return norms._replace(imaginary=imaginary, q=q + shift, v=v, a=a)
