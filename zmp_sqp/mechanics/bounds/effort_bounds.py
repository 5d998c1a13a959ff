r"""Rigorous bounds on inverse dynamics and on how fast it can change, from norms alone.

With c_i the links' centres of mass and L_i their angular momenta, the ground reaction has

.. math::
    \ddot f = \sum m_i c_i^{(4)}, \quad
    \ddot \tau = \sum m_i ((c_i - o) \times (\ddot c_i - g))'' + \dddot L_i

in axes that stand still, about the root origin o, which may move. In root axes R, which turn
with :math:`\Omega`, a vector W has

.. math::
    |(R^T W)''| = |W'' - 2 \Omega \times W' - \Omega' \times W
                   + \Omega \times (\Omega \times W)|
                \le |W''| + 2 |\Omega| |W'| + (|\Omega'| + |\Omega|^2) |W|

The effort of joint j is the component of the force, or of the moment about the joint, that
moves all links beyond it, along the joint's axis :math:`z_j`: a product of a unit vector fixed
in the link before and of a vector bounded from tip to root.

The norms of all derivatives follow from root to tip: a vector b fixed in a link that turns with
w has :math:`b' = w \times b`, hence by Leibniz
:math:`|b^{(k+1)}| \le \sum_j \binom{k}{j} |w^{(j)}| |b^{(k-j)}|`; a joint adds its axis times
the rate to w; an inertia tensor in axes that stand still has :math:`|I'| \le 2 |w| |I|`.

Joints that mimic a planned joint follow it with the multiplier m: its peaks times |m| are theirs,
and |m| times the bounds on their efforts adds to that on its effort (`JointCoupling`).

The first bound is the sum of the absolute values of all that inverse dynamics adds up, so that
rounding errors are a small multiple of machine precision times it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.bounds.norms import ORDERS, Bounds, leibniz, turning
from zmp_sqp.mechanics.inertia import spectral_norm
from zmp_sqp.mechanics.machine import Machine

__all__ = [
    "EffortBound",
    "effort_bounds",
    "is_prismatic",
]

FIRST = 2  # Pinocchio's index of the first joint behind the root


@dataclass(frozen=True, slots=True, eq=False)
class EffortBound:
    """Upper bounds on the efforts of inverse dynamics, or on a time derivative, over K stretches.

    Attributes:
        force: Bound on |f| or |d^2 f / dt^2| of the ground reaction, shape (K,) [N, or N/s^2].
        moment: Bound on |tau| or |d^2 tau / dt^2| about the root origin, shape (K,)
            [N m, or N m/s^2].
        joints: Bound on each joint's |torque| or |force|, or on its second derivative, shape (K, n)
            [N m or N, or per s^2]; shape (K, 0) where joints were not asked for.
    """

    force: Array
    moment: Array
    joints: Array

    def __getitem__(self, stretches: Any) -> EffortBound:
        """Bounds of some of the stretches, by an index, slice or mask."""
        return EffortBound(self.force[stretches], self.moment[stretches], self.joints[stretches])

    def plus(self, other: EffortBound, weight: Array | float = 1.0) -> EffortBound:
        """Sum of these bounds and `weight` times other bounds; the weight is scalar or (K,)."""
        columns = weight[:, None] if isinstance(weight, np.ndarray) else weight
        return EffortBound(
            self.force + weight * other.force,
            self.moment + weight * other.moment,
            self.joints + columns * other.joints,
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Link:
    """Bounds on the motion of one link, orders of time derivatives as list entries, (K,) each.

    Attributes:
        parent: Pinocchio's index of the joint before.
        mass: [kg].
        axis: Norms of the derivatives of a unit vector fixed in the link before, orders 0 to 4.
        offset: Norms of the vector from the joint before to this one, orders 0 to 4 [m].
        origin: Norms of the vector from the root origin to this joint, orders 0 to 4 [m].
        lever: Norms of the vector from this joint to the centre of mass, orders 0 to 4 [m].
        spin: Norms of the angular velocity, orders 0 to 3 [rad/s, ...].
        unit: Norms of a unit vector fixed in the link, orders 0 to 4.
        acceleration: Norms of the acceleration of the centre of mass minus gravity, orders 0 to 2.
        tensor: Norms of the inertia tensor in axes that stand still, orders 0 to 3; empty for a
            point mass [kg m^2, ...].
    """

    parent: int
    mass: float
    axis: Bounds
    offset: Bounds
    origin: Bounds
    lever: Bounds
    spin: Bounds
    unit: Bounds
    acceleration: Bounds
    tensor: Bounds

    def force(self, k: int) -> Array:
        """Bound on the k-th derivative of the force that moves the link alone [N, ...]."""
        return np.asarray(self.mass * self.acceleration[k])

    def moment(self, about: Bounds, k: int) -> Array:
        """Bound on the k-th derivative of the force's moment; `about` is the lever's norms."""
        found = self.mass * leibniz(about, self.acceleration, k)
        if self.tensor:
            found = found + leibniz(self.tensor, self.spin, k + 1)
        return np.asarray(found)


def effort_bounds(
    machine: Machine,
    v: Array,
    a: Array,
    j: Array,
    *,
    reach: Array,
    gravity: float,
    base: Array | None = None,
    joints: bool = False,
) -> tuple[EffortBound, EffortBound]:
    r"""Bounds on efforts, and on their second time derivatives, in any motion below these peaks.

    The module's docstring has the derivation.

    Args:
        machine: The machine.
        v: Largest |rate| of each joint in each stretch, shape (K, n) [rad/s or m/s].
        a: Largest |acceleration|, shape (K, n).
        j: Largest |jerk|, shape (K, n); higher derivatives are zero.
        reach: Largest |coordinate|, shape (K, n) [m]; matters for prismatic joints only.
        gravity: Norm of gravity [m/s^2].
        base: Bounds on the motion of the root, see `root_bounds`, shape (2, 4, K); None for a root
            that stands still.
        joints: Whether to bound the joints' efforts too.
    """
    links = _link_bounds(machine, v, a, j, reach=reach, gravity=gravity, base=base)
    zero = np.zeros(len(v))
    orders = (0, 2) if base is None else (0, 1, 2)
    # of the ground reaction in axes that stand still
    force, moment = (dict.fromkeys(orders, zero) for _ in range(2))
    for link in links[1:]:
        centre = [link.origin[k] + link.lever[k] for k in range(ORDERS)]
        for k in orders:
            force[k] = force[k] + link.force(k)
            moment[k] = moment[k] + link.moment(centre, k)
    of_joints = _joint_bounds(machine, links) if joints else np.zeros((2, len(v), 0))
    second = force[2], moment[2]
    if base is not None:
        spin = base[1]
        once, none = 2.0 * spin[0], spin[1] + spin[0] ** 2  # what turning root axes add
        second = tuple(part[2] + once * part[1] + none * part[0] for part in (force, moment))
    size = EffortBound(force[0], moment[0], of_joints[0])
    return size, EffortBound(second[0], second[1], of_joints[1])


def _link_bounds(
    machine: Machine,
    v: Array,
    a: Array,
    j: Array,
    *,
    reach: Array,
    gravity: float,
    base: Array | None,
) -> list[_Link]:
    """Bounds on the motion of every link, from root to tip, by Pinocchio's joint index."""
    model, count = machine.model, len(v)
    zero = np.zeros(count)
    coordinates = _of_all_joints(machine, reach, v, a, j)
    drive, spin = (list(part) for part in (np.zeros((2, 4, count)) if base is None else base))
    still, unit = [zero] * ORDERS, turning(spin)
    world = _Link(0, 0.0, unit, still, still, still, spin, unit, [], [])
    largest = spectral_norm([body.inertia for body in model.inertias])
    links = [world]
    for joint in range(1, model.njoints):
        parent = model.parents[joint]
        before = links[parent]
        length = float(np.linalg.norm(model.jointPlacements[joint].translation))
        offset = [before.unit[k] * length for k in range(ORDERS)]
        own, body = before.spin, before.unit
        if joint > 1:  # the root itself moves as the base does
            q = coordinates[:, joint - FIRST]
            if is_prismatic(model, joint):
                offset = [offset[k] + leibniz(before.unit, q, k) for k in range(ORDERS)]
            else:
                own = [own[k] + leibniz(before.unit, q[1:], k) for k in range(ORDERS - 1)]
                body = turning(own)
        origin = [before.origin[k] + offset[k] for k in range(ORDERS)]
        inertia = model.inertias[joint]
        reaching = float(np.linalg.norm(inertia.lever))
        lever = [body[k] * reaching for k in range(ORDERS)]
        acceleration = [origin[k] + lever[k] + drive[k - 1] for k in range(2, ORDERS)]
        acceleration[0] = acceleration[0] + gravity
        tensor = []
        if largest[joint] > 0.0:
            tensor = [np.full(count, float(largest[joint]))]
            for k in range(3):
                tensor.append(2.0 * leibniz(own, tensor, k))
        links.append(
            _Link(
                parent,
                inertia.mass,
                before.unit,
                offset,
                origin,
                lever,
                own,
                body,
                acceleration,
                tensor,
            )
        )
    return links


def _of_all_joints(machine: Machine, reach: Array, *derivatives: Array) -> Array:
    """Peaks of all joints behind the root, from those of the planned ones, (K, n) each.

    Returns:
        Shape (ORDERS + 1, m, K): coordinates, rates, ..., and zeros beyond the derivatives given.
    """
    coupling = machine.coupling
    found = np.zeros((ORDERS + 1, len(coupling.leader), len(reach)))
    found[0] = coupling.largest_positions(reach).T
    for k, values in enumerate(derivatives, start=1):
        found[k] = coupling.largest_rates(values).T
    return found


def _joint_bounds(machine: Machine, links: list[_Link]) -> Array:
    """Bounds on the planned joints' efforts and their second derivatives, shape (2, K, n)."""
    model = machine.model
    force = [[link.force(k) for k in range(3)] if i else [] for i, link in enumerate(links)]
    moment = [
        [link.moment(link.lever, k) for k in range(3)] if i else [] for i, link in enumerate(links)
    ]
    leader, share = machine.coupling.leader, np.abs(machine.coupling.multiplier)
    found = np.zeros((2, len(links[1].acceleration[0]), machine.size))
    for joint in range(len(links) - 1, 1, -1):  # from tip to root
        link = links[joint]
        drawn = force[joint] if is_prismatic(model, joint) else moment[joint]
        at, weight = leader[joint - FIRST], share[joint - FIRST]
        found[0, :, at] += weight * drawn[0]
        found[1, :, at] += weight * leibniz(link.axis, drawn, 2)
        for k in range(3):
            force[link.parent][k] = force[link.parent][k] + force[joint][k]
            carried = moment[joint][k] + leibniz(link.offset, force[joint], k)
            moment[link.parent][k] = moment[link.parent][k] + carried
    return found


def is_prismatic(model: Any, joint: int) -> bool:
    """Whether a joint slides."""
    kind: str = model.joints[joint].shortname()
    return kind.startswith(("JointModelP", "JointModelMimicP"))
