"""Error of replacing a box of possible payload centres of mass by the corners of the box."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.bounds.effort_bounds import FIRST, is_prismatic
from zmp_sqp.mechanics.machine import Machine

__all__ = ["joint_shares", "moment_of_spread", "turning_bounds"]


def moment_of_spread(
    machine: Machine, v: Array, a: Array, *, spread: float, base: Array | None = None
) -> Array:
    r"""Bound on the moment that the corners of the box miss, over K intervals, shape (K,) [N m].

    A payload of mass m whose centre of mass is displaced by \delta, in the axes e_i of the frame
    that carries it, adds to the moment of the ground reaction terms that are affine in \delta and

    .. math:: m \delta \times (\dot\omega \times \delta) + m \delta \times (\omega \times (\omega
              \times \delta)) = m \sum_i \delta_i^2 \left( e_i \times (\dot\omega \times e_i) +
              (\omega \cdot e_i) e_i \times \omega \right) + \text{terms in } \delta_i \delta_j

    Terms that are affine in each \delta_i alone, products \delta_i \delta_j included, are extreme
    at the corners of the box |\delta_i| <= d_i. The squares are largest at the corners but smaller
    between them, and this changes the moment by at most

    .. math:: m \sum_i d_i^2 \left( |\dot\omega| + \tfrac12 |\omega|^2 \right)

    Args:
        machine: Machine that carries the payload.
        v: Largest |rate| of each joint in each interval, shape (K, n) [rad/s or m/s].
        a: Largest |acceleration| of each joint in each interval, shape (K, n) [rad/s^2 or m/s^2].
        spread: m (d_1^2 + d_2^2 + d_3^2) [kg m^2].
        base: Bounds on the motion of the root, see `root_bounds`, shape (2, 4, K); None if the base
            stands still.
    """
    rate, acceleration = turning_bounds(machine, v, a, base=base)
    return np.asarray(spread * (acceleration + 0.5 * rate**2))


def joint_shares(machine: Machine) -> Array:
    """Largest change of each planned joint's effort per unit of `moment_of_spread`, shape (n,).

    The moment acts on every joint that turns: 1 for a planned joint that turns, 0 for one that
    slides, and the sizes of the multipliers of the turning joints that mimic it in addition.
    """
    turns = [
        not is_prismatic(machine.model, joint) for joint in range(FIRST, machine.model.njoints)
    ]
    return machine.coupling.largest_efforts(np.array(turns, dtype=np.float64))


def turning_bounds(
    machine: Machine, v: Array, a: Array, *, base: Array | None = None
) -> tuple[Array, Array]:
    r"""Bounds on angular velocity and angular acceleration of all links over K intervals.

    .. math::
        |\omega| \le |\omega_0| + \sum v_i, \qquad
        |\dot\omega| \le |\dot\omega_0| + \sum a_i
            + \tfrac12 \left( |\omega_0| + \sum v_i \right)^2

    The sums run over the joints that turn, mimic joints included, and \omega_0 belongs to the
    root. The quadratic term arises because the axis of each joint rotates with the joints before
    it.

    Args:
        machine: Machine.
        v: Largest |rate| of each joint in each interval, shape (K, n) [rad/s or m/s].
        a: Largest |acceleration| of each joint in each interval, shape (K, n) [rad/s^2 or m/s^2].
        base: Bounds on the motion of the root, see `root_bounds`, shape (2, 4, K); None if the base
            stands still.

    Returns:
        Bounds on |\omega| and |\dot\omega|, shape (K,) each [rad/s, rad/s^2].
    """
    model = machine.model
    turning = [i - FIRST for i in range(FIRST, model.njoints) if not is_prismatic(model, i)]
    v, a = (machine.coupling.largest_rates(peaks)[:, turning] for peaks in (v, a))
    spin, spin_rate = (np.zeros(len(v)),) * 2 if base is None else base[1, :2]
    rate = spin + v.sum(axis=1)
    return rate, spin_rate + a.sum(axis=1) + 0.5 * rate**2
