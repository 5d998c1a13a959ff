"""Zero moment point (ZMP) and stability margin of a machine in motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, frozen_array
from zmp_sqp.errors import GIVE_SUPPORT, ContactLost, MachineError
from zmp_sqp.mechanics.ground import Ground, check_ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import ground_reaction

__all__ = ["stability_margin", "zmp", "zmp_of_wrench"]


def zmp(machine: Machine, q: Any, v: Any, a: Any, ground: Ground) -> Array:
    r"""Zero moment point: where the ground reaction has no tilting moment about the support plane.

    .. math:: p = (-\tau'_y, \tau'_x) / f_z, \quad \tau' = \tau - (0, 0, h) \times f

    with the ground reaction wrench (f, tau) about the root origin and the height h of the support
    plane. This is eq. (5) of Song & Sharf 2020 extended to rigid bodies; for
    `Machine.with_point_masses` it is eq. (5) itself. The base stands still.

    Args:
        machine: Machine; without a support polygon, the support plane is z = 0 of the root frame.
        q: Joint coordinates, shape (K, n) or (n,) [rad or m].
        v: Joint rates, shape of q [rad/s or m/s].
        a: Joint accelerations, shape of q [rad/s^2 or m/s^2].
        ground: Ground on which the machine stands.

    Returns:
        ZMP in the root frame, shape (K, 2) or (2,) [m].

    Raises:
        MachineError: Wrong shapes, or an entry that is not finite; the message names the joint.
        ContactLost: The ground would have to pull at the machine (f_z <= 0); the message names the
            first such index.
    """
    if not isinstance(machine, Machine):
        raise MachineError(
            f"machine must be a Machine (see load_machine), not {type(machine).__name__}"
        )
    check_ground(ground, MachineError)
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

    with the ZMP p, the outward unit normals e_i of the edges and their offsets b_i. For a ZMP
    outside it is the negative distance to the most violated edge line, not to a corner. The base
    stands still.

    Args:
        machine: Machine with a support polygon.
        q: Joint coordinates, shape (K, n) or (n,) [rad or m].
        v: Joint rates, shape of q [rad/s or m/s].
        a: Joint accelerations, shape of q [rad/s^2 or m/s^2].
        ground: Ground on which the machine stands.

    Returns:
        Signed distances, shape (K,) or () [m].

    Raises:
        MachineError: No support polygon, wrong shapes, or an entry that is not finite.
        ContactLost: The ground would have to pull at the machine (f_z <= 0).
    """
    points = zmp(machine, q, v, a, ground)
    if machine.support is None:
        raise MachineError(
            f"machine {machine.name!r} has no support polygon: {GIVE_SUPPORT.arguments}"
        )
    return machine.support.signed_distance(points)


def zmp_of_wrench(wrench: Array, height: float = 0.0) -> Array:
    """Zero moment point of K ground reaction wrenches.

    Args:
        wrench: Ground reaction (f, tau) about the root origin, root axes, shape (K, 6) [N, N m].
        height: z of the support plane in the root frame [m].

    Returns:
        ZMP in the root frame, shape (K, 2) [m].

    Raises:
        ContactLost: The ground would have to pull at the machine (f_z <= 0); the message names the
            first such index.
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
    """Joint values of one state (n,) or of K states (K, n), checked."""
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
