"""Ground reaction wrench about the root origin, with its analytic derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.machine import Machine

__all__ = ["WrenchDerivatives", "ground_reaction", "ground_reaction_derivatives"]


@dataclass(frozen=True, slots=True, eq=False)
class WrenchDerivatives:
    """Ground reaction wrench at K states with its first derivatives.

    Attributes:
        wrench: (f, tau) about the root origin, root axes, shape (K, 6) [N, N m].
        wrt_position: By the joint coordinates, shape (K, 6, n).
        wrt_velocity: By (root twist, joint rates), shape (K, 6, 6 + n).
        wrt_acceleration: By (root spatial acceleration, joint accelerations), shape (K, 6, 6 + n).
    """

    wrench: Array
    wrt_position: Array
    wrt_velocity: Array
    wrt_acceleration: Array


def ground_reaction(
    machine: Machine,
    q: Array,
    v: Array,
    a: Array,
    *,
    root_acceleration: Array,
    root_velocity: Array | None = None,
) -> Array:
    r"""Wrench that the ground exerts on the machine, the first six rows of its inverse dynamics.

    .. math:: (f, \tau) = [M(\bar q) \bar a + h(\bar q, \bar v)]_{1..6}, \quad \bar a_{root} =
        a_{root} - g

    For point masses its quotient is eq. (5) of Song & Sharf 2020. Gravity is an acceleration of the
    root, so scaling the first three entries of `root_acceleration` scales gravity.

    Args:
        machine: The machine.
        q, v, a: Joint coordinates, rates, accelerations, shape (K, n) each [rad, s].
        root_acceleration: Spatial acceleration of the root minus gravity, root frame, shape (6,) or
            (K, 6) [m/s^2, rad/s^2].
        root_velocity: Twist of the root, root frame, shape (6,) or (K, 6) [m/s, rad/s]; None stands
            still.

    Returns:
        (f, tau) about the root origin, root axes, shape (K, 6) [N, N m].
    """
    configuration, velocity, acceleration = _stack(
        machine, q, v, a, root_velocity, root_acceleration
    )
    model, data = machine.model, machine.model.createData()
    wrench = np.empty((len(configuration), 6))
    rnea = pin.rnea
    for row, (one_q, one_v, one_a) in enumerate(
        zip(configuration, velocity, acceleration, strict=True)
    ):
        wrench[row] = rnea(model, data, one_q, one_v, one_a)[:6]
    return wrench


def ground_reaction_derivatives(
    machine: Machine,
    q: Array,
    v: Array,
    a: Array,
    *,
    root_acceleration: Array,
    root_velocity: Array | None = None,
) -> WrenchDerivatives:
    """Ground reaction wrench and its analytic first derivatives; arguments as in `ground_reaction`.

    The derivative by the root's pose is not here: in the root frame the wrench does not depend on
    it but through gravity, which is an argument.
    """
    configuration, velocity, acceleration = _stack(
        machine, q, v, a, root_velocity, root_acceleration
    )
    model, data = machine.model, machine.model.createData()
    count, columns = len(configuration), model.nv
    wrench = np.empty((count, 6))
    by_q, by_v, by_a = (np.empty((count, 6, columns)) for _ in range(3))
    differentiate = pin.computeRNEADerivatives
    # views that Pinocchio writes into
    tau, dtau_dq, dtau_dv, mass = data.tau, data.dtau_dq, data.dtau_dv, data.M
    for row, (one_q, one_v, one_a) in enumerate(
        zip(configuration, velocity, acceleration, strict=True)
    ):
        differentiate(model, data, one_q, one_v, one_a)
        wrench[row] = tau[:6]
        by_q[row] = dtau_dq[:6]
        by_v[row] = dtau_dv[:6]
        by_a[row] = mass[:6]
    lower = np.tril_indices(6, -1)
    # Pinocchio fills the upper triangle of M
    by_a[:, lower[0], lower[1]] = by_a[:, lower[1], lower[0]]
    columns_v = np.concatenate([np.arange(6), machine.index_v])
    return WrenchDerivatives(
        wrench, by_q[:, :, machine.index_v], by_v[:, :, columns_v], by_a[:, :, columns_v]
    )


def _stack(
    machine: Machine,
    q: Array,
    v: Array,
    a: Array,
    root_velocity: Array | None,
    root_acceleration: Array,
) -> tuple[Array, Array, Array]:
    velocity, acceleration = np.zeros((2, len(q), machine.model.nv))
    velocity[:, machine.index_v] = v
    acceleration[:, machine.index_v] = a
    acceleration[:, :6] = root_acceleration
    if root_velocity is not None:
        velocity[:, :6] = root_velocity
    return machine.configuration(q), velocity, acceleration
