"""Measures of tip-over stability from the literature: load transfer, force angle and energy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.errors import GIVE_SUPPORT, MachineError
from zmp_sqp.mechanics.ground import Ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.mechanics.wrench import ground_reaction
from zmp_sqp.mechanics.zero_moment_point import zmp, zmp_of_wrench

__all__ = ["StabilityMeasures", "center_of_mass", "measures_of_wrench", "stability_measures"]


@dataclass(frozen=True, slots=True, eq=False)
class StabilityMeasures:
    r"""Four measures of tip-over stability at K states.

    The margin, the force angle and the energy are positive while the machine is stable and zero
    when it starts to tip. The load transfer ratio is below 1 while the machine is stable and 1 when
    it starts to tip.

    Attributes:
        margin: Signed distance from the ZMP to the nearest edge, shape (K,) [m].
        load_transfer_ratio: Fraction of the load that has moved to one side: 0 with the ZMP at the
            centroid of the support polygon, 1 with the ZMP on an edge, where the other side carries
            nothing. For two tracks it is :math:`|F_l - F_r| / (F_l + F_r)`. Shape (K,).
        force_angle: Measure of Papadopoulos & Rey 1996, :math:`\min_i \theta_i |f^*_i| / (m g)`,
            shape (K,) [rad]. :math:`f^*_i` is the net force on the machine without the ground
            reaction, applied at the centre of mass and without its component along edge i; the net
            moment about the edge is included as a couple. :math:`\theta_i` is the angle between
            this force and the perpendicular from the centre of mass to the edge.
        tip_over_energy: Work needed to roll the machine as a rigid body over an edge, against the
            net force at its centre of mass, least over all edges; negative where the machine
            already tips. After Messuri & Klein 1985 at rest, and with inertial forces after
            Ghasempoor & Sepehri 1998. Shape (K,) [J].
    """

    margin: Array
    load_transfer_ratio: Array
    force_angle: Array
    tip_over_energy: Array


def stability_measures(
    machine: Machine, q: Any, v: Any, a: Any, ground: Ground
) -> StabilityMeasures:
    """Tip-over stability measures of a machine whose base stands still, at K states.

    Args:
        machine: Machine with a support polygon.
        q, v, a: Joint coordinates, rates and accelerations, shape (K, n) or (n,) [rad or m, s].
        ground: Ground on which the machine stands.

    Raises:
        MachineError: No support polygon, wrong shapes, or an entry that is not finite.
        ContactLost: The ground would have to pull at the machine.
    """
    zmp(machine, q, v, a, ground)  # checks the arguments and names the joint that is wrong
    rows = [np.atleast_2d(np.asarray(values, dtype=np.float64)) for values in (q, v, a)]
    root = np.concatenate([-ground.gravity(), np.zeros(3)])
    wrench = ground_reaction(machine, *rows, root_acceleration=root)
    return measures_of_wrench(machine, rows[0], wrench, float(np.linalg.norm(ground.gravity())))


def measures_of_wrench(
    machine: Machine, q: Array, wrench: Array, gravity: float
) -> StabilityMeasures:
    """Tip-over stability measures from the ground reaction wrench, also for a moving base.

    Args:
        machine: Machine with a support polygon.
        q: Joint coordinates, shape (K, n) [rad or m].
        wrench: Ground reaction (f, tau) about the root origin, root axes, shape (K, 6) [N, N m].
        gravity: Magnitude of gravity [m/s^2].

    Raises:
        MachineError: No support polygon.
        ContactLost: The ground would have to pull at the machine.
    """
    support = machine.support
    if support is None:
        raise MachineError(
            f"machine {machine.name!r} has no support polygon: {GIVE_SUPPORT.arguments}"
        )
    points = zmp_of_wrench(wrench, support.height)
    middle = _centroid(support)
    # 0 at the centroid, 1 on each edge; (K, V)
    transfer = ((points - middle) @ support.normals.T) / (
        support.offsets - support.normals @ middle
    )
    com = center_of_mass(machine, q)
    # net force and moment on the machine without the ground reaction, at the centre of mass
    force, moment = -wrench[:, :3], -(wrench[:, 3:] - np.cross(com, wrench[:, :3]))
    corners = np.column_stack([support.vertices, np.full(len(support.vertices), support.height)])
    along = np.roll(corners, -1, axis=0) - corners
    along /= np.linalg.norm(along, axis=1)[:, None]
    lever = corners[None] - com[:, None]  # (K, V, 3)
    lever -= np.einsum("kvi,vi->kv", lever, along)[..., None] * along
    reach = np.linalg.norm(lever, axis=2)
    across = force[:, None] - np.einsum("ki,vi->kv", force, along)[..., None] * along
    couple = np.einsum("ki,vi->kv", moment, along)[..., None] * along
    pull = across + np.cross(lever, couple) / reach[..., None] ** 2
    strength = np.linalg.norm(pull, axis=2)
    # stabilising moment about each edge
    inside = np.einsum("kvi,vi->kv", np.cross(lever, pull), along)
    aligned = np.einsum("kvi,kvi->kv", lever, pull)
    angle = np.arctan2(inside, aligned)
    # the centre of mass has moved farthest against the pull when the lever is parallel to it
    energy = np.sign(inside) * (strength * reach - aligned)
    return StabilityMeasures(
        margin=support.signed_distance(points),
        load_transfer_ratio=np.asarray(transfer.max(axis=1)),
        force_angle=np.asarray((angle * strength).min(axis=1) / (machine.mass * gravity)),
        tip_over_energy=np.asarray(energy.min(axis=1)),
    )


def center_of_mass(machine: Machine, q: Array) -> Array:
    """Centre of mass of machine and payloads, root frame, shape (K, 3) [m]."""
    data = machine.model.createData()
    return np.array(
        [pin.centerOfMass(machine.model, data, row) for row in machine.configuration(q)]
    ).reshape(-1, 3)


def _centroid(support: SupportPolygon) -> Array:
    """Centroid of the area of the support polygon, root frame, shape (2,) [m]."""
    here = support.vertices - support.vertices[0]
    after = np.roll(here, -1, axis=0)
    double = here[:, 0] * after[:, 1] - here[:, 1] * after[:, 0]
    return np.asarray(
        support.vertices[0] + ((here + after) * double[:, None]).sum(axis=0) / (3.0 * double.sum())
    )
