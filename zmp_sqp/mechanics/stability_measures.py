"""Other measures of tip-over stability than the ZMP's distance from the edges: load transfer, force angle, energy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.ground import Ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.mechanics.wrench import ground_reaction
from zmp_sqp.mechanics.zero_moment_point import zmp, zmp_of_wrench

__all__ = ["StabilityMeasures", "center_of_mass", "measures_of_wrench", "stability_measures"]


@dataclass(frozen=True, slots=True, eq=False)
class StabilityMeasures:
    r"""Measures that are positive inside (the load transfer ratio: below 1), and zero (1) when a machine starts to tip.

    Attributes:
        margin: Distance from the ZMP to the nearest edge, shape (K,) [m].
        load_transfer_ratio: Share of the load that has gone over to one side: 0 with the ZMP in the
            middle, 1 at an edge, where the other side carries nothing. On two tracks :math:`|F_l -
            F_r| / (F_l + F_r)`. Shape (K,).
        force_angle: Papadopoulos & Rey 1996: least angle between the net force on the machine (all
            but the ground's, at its centre of mass, with the net moment taken as a couple) and the
            perpendicular to an edge, times that force over the weight, :math:`\min_i \theta_i
            |f^*_i| / (m g)`, shape (K,) [rad].
        tip_over_energy: Work that must be done to roll the machine over an edge, as a rigid body,
            against the net force at its centre of mass: Messuri & Klein 1985 at rest, with inertial
            forces after Ghasempoor & Sepehri 1998; negative where it already tips over it. Shape
            (K,) [J].
    """

    margin: Array
    load_transfer_ratio: Array
    force_angle: Array
    tip_over_energy: Array


def stability_measures(
    machine: Machine, q: Any, v: Any, a: Any, ground: Ground
) -> StabilityMeasures:
    """All measures of a machine on a base that stands; arguments, errors as in `stability_margin`, K states at once.

    Args:
        machine: With a support polygon.
        q, v, a: Joint coordinates, rates and accelerations, shape (K, n) or (n,) [rad or m, s].
        ground: What the machine stands on.

    Raises:
        MachineError: No support polygon, wrong shapes, or an entry that is not finite.
        ContactLost: The ground would have to pull.
    """
    zmp(machine, q, v, a, ground)  # complains in the user's terms
    rows = [np.atleast_2d(np.asarray(values, dtype=np.float64)) for values in (q, v, a)]
    root = np.concatenate([-ground.gravity(), np.zeros(3)])
    wrench = ground_reaction(machine, *rows, root_acceleration=root)
    return measures_of_wrench(machine, rows[0], wrench, float(np.linalg.norm(ground.gravity())))


def measures_of_wrench(
    machine: Machine, q: Array, wrench: Array, gravity: float
) -> StabilityMeasures:
    """The same from the ground reaction, whatever the root does.

    Args:
        machine: With a support polygon.
        q: Joint coordinates, shape (K, n).
        wrench: (f, tau) about the root origin, root axes, shape (K, 6) [N, N m].
        gravity: Its norm [m/s^2].
    """
    support = machine.support
    if support is None:
        raise MachineError(
            f"machine {machine.name!r} has no support polygon: give one by support=... or with_support"
        )
    points = zmp_of_wrench(wrench, support.height)
    middle = _centroid(support)
    over = ((points - middle) @ support.normals.T) / (support.offsets - support.normals @ middle)
    com = center_of_mass(machine, q)
    # of all but the ground, at the com
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
    # moment that holds the machine down, about the edge
    inside = np.einsum("kvi,vi->kv", np.cross(lever, pull), along)
    aligned = np.einsum("kvi,kvi->kv", lever, pull)
    angle = np.arctan2(inside, aligned)
    # rolled until the lever points along the pull, the centre of mass has gone furthest against it
    energy = np.sign(inside) * (strength * reach - aligned)
    return StabilityMeasures(
        margin=support.signed_distance(points),
        load_transfer_ratio=np.asarray(over.max(axis=1)),
        force_angle=np.asarray((angle * strength).min(axis=1) / (machine.mass * gravity)),
        tip_over_energy=np.asarray(energy.min(axis=1)),
    )


def center_of_mass(machine: Machine, q: Array) -> Array:
    """Centre of mass of the machine with its payload in the root frame, shape (K, 3) [m]."""
    data = machine.model.createData()
    return np.array(
        [pin.centerOfMass(machine.model, data, row) for row in machine.configuration(q)]
    ).reshape(-1, 3)


def _centroid(support: SupportPolygon) -> Array:
    """Of the polygon's area, shape (2,) [m]."""
    here = support.vertices - support.vertices[0]
    after = np.roll(here, -1, axis=0)
    double = here[:, 0] * after[:, 1] - here[:, 1] * after[:, 0]
    return np.asarray(
        support.vertices[0] + ((here + after) * double[:, None]).sum(axis=0) / (3.0 * double.sum())
    )
