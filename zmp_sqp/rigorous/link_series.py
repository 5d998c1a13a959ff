r"""Kinematics and inertial forces of all links as power series of time.

All vectors are in the axes of the ground frame and relative to the root's origin O:

.. math::
    f_i = \frac{d}{dt} \left( m_i (\dot d_i + \dot O) \right), \quad
    n_i = d_i \times f_i + \frac{d}{dt} \left( R_i I_i R_i^T \omega_i \right)

with the place d_i of the centre of mass of link i, its rotation R_i, and its inertia I_i about that
centre in its own axes. These are the rates of its linear momentum, and of its angular momentum
about the fixed point where O is at that time. The wrench from the ground, and the efforts of the
joints, are sums of these less the weights (d'Alembert).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

from zmp_sqp.rigorous.machine_numbers import Body, JointNumbers
from zmp_sqp.rigorous.root_series import Root
from zmp_sqp.rigorous.series_algebra import (
    Matrix,
    Scalar,
    Vector,
    cross,
    derivative,
    matrix_product,
    plus,
    product,
    scaled,
    times,
    times_transposed,
    vector_derivative,
    vector_sum,
)

__all__ = ["LinkSeries", "Momenta", "exact", "joint_constants", "link_series", "momenta"]

NONE: Vector = (0, 0, 0)


@dataclass(frozen=True, slots=True)
class JointConstants:
    """Constants of a joint as balls: K is the matrix of the cross product by its axis."""

    joint: JointNumbers
    rotation: Matrix
    origin: Vector
    axis: Vector
    K: Matrix
    KK: Matrix
    multiplier: Scalar
    offset: Scalar


@dataclass(frozen=True, slots=True)
class LinkSeries:
    """Motion of one link: rotation, origin from O [m], angular velocity [rad/s], joint axis."""

    rotation: Matrix
    origin: Vector
    spin: Vector
    axis: Vector


@dataclass(frozen=True, slots=True)
class Momenta:
    """Rates of momentum of one link about O, and its mass and first moment.

    Attributes:
        force: f_i [N].
        moment: n_i [N m].
        mass: [kg].
        first: m_i d_i [kg m].
    """

    force: Vector
    moment: Vector
    mass: Scalar
    first: Vector


def exact(flint: Any, number: float) -> Scalar:
    """A float as an exact constant: 0, 1 and -1 as int."""
    return int(number) if number in (0.0, 1.0, -1.0) else flint.arb(number)


def joint_constants(flint: Any, joints: Sequence[JointNumbers]) -> tuple[JointConstants, ...]:
    """Constants of all joints."""
    found = []
    for joint in joints:
        rotation: Any = tuple(tuple(exact(flint, x) for x in row) for row in joint.rotation)
        origin: Any = tuple(exact(flint, x) for x in joint.origin)
        x, y, z = axis = tuple(exact(flint, x) for x in joint.axis)
        K: Matrix = ((0, -z, y), (z, 0, -x), (-y, x, 0))
        factor = exact(flint, joint.multiplier)
        offset = flint.arb(joint.offset) if joint.offset else 0
        KK = matrix_product(K, K)
        found.append(JointConstants(joint, rotation, origin, axis, K, KK, factor, offset))
    return tuple(found)


def link_series(
    joints: Sequence[JointConstants], q: Sequence[Scalar], root: Root
) -> tuple[LinkSeries, ...]:
    """Motion of all links, the root first.

    Args:
        joints: Constants of the joints.
        q: Series of the planned joints.
        root: Motion of the root.
    """
    links = [LinkSeries(root.rotation, NONE, root.spin, axis=NONE)]
    for one in joints:
        parent = links[one.joint.parent]
        value = plus(product(one.multiplier, q[one.joint.leader]), one.offset)
        origin = vector_sum(parent.origin, times(parent.rotation, one.origin))
        carrier = matrix_product(parent.rotation, one.rotation)
        axis = times(carrier, one.axis)
        if one.joint.slides:
            origin = vector_sum(origin, scaled(value, axis))
            links.append(LinkSeries(carrier, origin, parent.spin, axis))
            continue
        rotation = _turned(carrier, one, value)
        spin = vector_sum(parent.spin, scaled(derivative(value), axis))
        links.append(LinkSeries(rotation, origin, spin, axis))
    return tuple(links)


def _turned(carrier: Matrix, one: JointConstants, angle: Scalar) -> Matrix:
    """Rotation by an angle about the joint's axis (Rodrigues), in the axes of the ground."""
    if angle.__class__ is int:  # exactly zero
        return carrier
    sin, cos = angle.sin_cos()
    versine = 1 - cos
    first, second = matrix_product(carrier, one.K), matrix_product(carrier, one.KK)
    rows = tuple(
        tuple(
            plus(carrier[i][j], plus(product(sin, first[i][j]), product(versine, second[i][j])))
            for j in range(3)
        )
        for i in range(3)
    )
    return cast(Matrix, rows)


def momenta(link: LinkSeries, body: Body, root_velocity: Vector) -> Momenta:
    """Rates of momentum of one link.

    Args:
        link: Its motion.
        body: What it carries.
        root_velocity: Velocity of O, ground axes.
    """
    centre = vector_sum(link.origin, times(link.rotation, body.com))
    velocity = vector_sum(vector_derivative(centre), root_velocity)
    force = vector_derivative(scaled(body.mass, velocity))
    local = times(body.inertia, times_transposed(link.rotation, link.spin))
    turning = vector_derivative(times(link.rotation, local))
    moment = vector_sum(cross(centre, force), turning)
    return Momenta(force, moment, body.mass, scaled(body.mass, centre))
