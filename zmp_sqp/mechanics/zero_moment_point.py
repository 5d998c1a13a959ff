"""Zero moment point and stability margin of a machine in motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, frozen_array
from zmp_sqp.errors import ContactLost, MachineError
from zmp_sqp.mechanics.ground import Ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import ground_reaction

__all__ = ["stability_margin", "zmp", "zmp_of_wrench"]


def zmp(machine: Machine, q: Any, v: Any, a: Any, ground: Ground) -> Array:
    r"""Point in the support plane about which the ground reaction has no tilting moment.

    .. math:: p = (-\tau'_y, \tau'_x) / f_z, \quad \tau' = \tau - (0, 0, h) \times f

    This is eq. (5) of Song & Sharf 2020 for rigid bodies, and eq. (5) itself on
    `Machine.with_point_masses`.

    Args:
        machine: The machine; without a support polygon the plane is z = 0 of the root frame.
        q: Joint coordinates, shape (K, n) or (n,) [rad or m].
        v: Their rates, same shape.
        a: Their accelerations, same shape.
        ground: What the machine stands on.

    Returns:
        ZMP in the root frame, shape (K, 2) or (2,) [m].

    Raises:
        MachineError: Wrong shapes, or an entry that is not finite; the message names the joint.
        ContactLost: The ground would have to pull (f_z <= 0); the message names the first such
            index.
    """
    if not isinstance(machine, Machine):
        raise MachineError(
            f"machine must be a Machine (see load_machine), not {type(machine).__name__}"
        )
    if isinstance(ground, type) or not isinstance(ground, Ground):
        raise MachineError(f"ground must have a gravity(yaw) as Slope has, not {ground!r}")
    position = _samples(machine, q, "q")
    velocity, acceleration = _samples(machine, v, "v"), _samples(machine, a, "a")
    for name, other in (("v", velocity), ("a", acceleration)):
        if other.shape != position.shape:
            raise MachineError(
                f"{name} must have the shape of q, {position.shape}, not {other.shape}"
            )
    rows = [np.atleast_2d(values) for values in (position, velocity, acceleration)]  # (K, n) each
    root_acceleration = np.concatenate([-ground.gravity(), np.zeros(3)])
    wrench = ground_reaction(
        machine, rows[0], rows[1], rows[2], root_acceleration=root_acceleration
    )
    height = 0.0 if machine.support is None else machine.support.height
    return zmp_of_wrench(wrench, height).reshape((*position.shape[:-1], 2))


def stability_margin(machine: Machine, q: Any, v: Any, a: Any, ground: Ground) -> Array:
    r"""Signed distance from the ZMP to the nearest edge of the support polygon, positive inside.

    .. math:: \min_i (b_i - e_i \cdot p)

    Outside a corner it is the distance to the edge line most violated, not to the corner. Arguments
    as in `zmp`.

    Returns:
        Shape (K,) or () [m].

    Raises:
        MachineError: As in `zmp`, or the machine has no support polygon.
        ContactLost: As in `zmp`.
    """
    points = zmp(machine, q, v, a, ground)
    if machine.support is None:
        raise MachineError(
            f"machine {machine.name!r} has no support polygon: give one by support=... or with_support"
        )
    return machine.support.signed_distance(points)


def zmp_of_wrench(wrench: Array, height: float = 0.0) -> Array:
    """ZMP of ground reaction wrenches.

    Args:
        wrench: (f, tau) about the root origin, root axes, shape (K, 6) [N, N m].
        height: z of the support plane in the root frame [m].

    Returns:
        Root frame, shape (K, 2) [m].

    Raises:
        ContactLost: The ground would have to pull (f_z <= 0); the message names the first such
            index.
    """
    normal_force = wrench[:, 2]
    for index in np.flatnonzero(~(normal_force > 0.0)):
        raise ContactLost(
            f"the machine lifts off: at index {index} the ground would have to pull "
            f"(normal force {normal_force[index]:.6g} N)"
        )
    moment_x, moment_y = wrench[:, 3] + height * wrench[:, 1], wrench[:, 4] - height * wrench[:, 0]
    return np.asarray(np.column_stack([-moment_y, moment_x]) / normal_force[:, None])


def _samples(machine: Machine, values: Any, name: str) -> Array:
    single = np.asarray(values, dtype=object).ndim == 1
    shape = (machine.size,) if single else (None, machine.size)
    array = frozen_array(values, name=name, shape=shape, error=MachineError, finite=False)
    for *node, joint in np.argwhere(~np.isfinite(array)):
        where = f" at index {node[0]}" if node else ""
        value = array[(*node, joint)]
        raise MachineError(
            f"{name} of joint {machine.joint_names[joint]!r}{where} must be finite, not {value}"
        )
    return array
