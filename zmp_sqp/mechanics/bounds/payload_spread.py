"""What a payload whose centre of mass is uncertain can do to the ground reaction beyond what corners show."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.machine import Machine

__all__ = ["moment_of_spread", "turning_bounds"]


def moment_of_spread(
    machine: Machine, v: Array, a: Array, *, spread: float, base: Array | None = None
) -> Array:
    r"""Largest moment by which the ground reaction is off the corners' own, over K stretches, shape (K,) [N m].

    With its centre of mass off by \delta, in axes e_i of the frame that carries it, a payload of
    mass m adds

    .. math:: m \delta \times (\dot\omega \times \delta) + m \delta \times (\omega \times (\omega
              \times \delta)) = m \sum_i \delta_i^2 \left( e_i \times (\dot\omega \times e_i) +
              (\omega \cdot e_i) e_i \times \omega \right) + \text{terms in } \delta_i \delta_j

    to the moment, and everything else is affine in \delta. What is affine in each \delta_i by
    itself is largest at a corner of the box |\delta_i| <= d_i. The squares are not: between corners
    they may be smaller, by at most

    .. math:: m \sum_i d_i^2 \left( |\dot\omega| + \tfrac12 |\omega|^2 \right)

    Args:
        machine: The machine.
        v: Largest |rate| of each joint in each stretch, shape (K, n) [rad/s or m/s].
        a: Largest |acceleration|, shape (K, n).
        spread: m (d_1^2 + d_2^2 + d_3^2) [kg m^2].
        base: Bounds on the motion of the root, see `root_bounds`, shape (2, 4, K); None stands
            still.
    """
    rate, acceleration = turning_bounds(machine, v, a, base=base)
    return np.asarray(spread * (acceleration + 0.5 * rate**2))


def turning_bounds(
    machine: Machine, v: Array, a: Array, *, base: Array | None = None
) -> tuple[Array, Array]:
    r"""Largest angular velocity and acceleration of any link, shape (K,) each [rad/s, rad/s^2].

    .. math:: |\omega| \le |\omega_0| + \sum v_i, \qquad
              |\dot\omega| \le |\dot\omega_0| + \sum a_i + \tfrac12 \left( |\omega_0| + \sum v_i
              \right)^2

    over the joints that turn, because each joint's axis is carried round by those before it.

    Args:
        machine, v, a, base: As in `moment_of_spread`.
    """
    joints = machine.model.joints
    turning = [
        joint for joint in list(joints)[2:] if not joint.shortname().startswith("JointModelP")
    ]
    index = {int(column): i for i, column in enumerate(machine.index_v)}
    columns = [index[joint.idx_v] for joint in turning]
    spin, push = (np.zeros(len(v)),) * 2 if base is None else base[1, :2]
    rate = spin + v[:, columns].sum(axis=1)
    return rate, push + a[:, columns].sum(axis=1) + 0.5 * rate**2
