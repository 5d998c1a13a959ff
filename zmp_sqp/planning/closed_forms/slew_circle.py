"""The ZMP's circle under a machine that slews on the level (Song & Sharf 2020, eqs. (12)-(18), misprints corrected)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array, frozen_array
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.ground import GRAVITY
from zmp_sqp.mechanics.machine import Machine

__all__ = ["SlewInsight", "slew_insight"]

# [m, or sine of an angle] rounding in a URDF: what must be vertical, or on the axis, is so within
# this
ALIGNED = 1e-6


@dataclass(frozen=True, slots=True)
class SlewInsight:
    """The slewing part of a machine in one pose, as one mass on the level (Assumption 2 of the paper).

    Attributes:
        mass: Of everything that turns with the first joint, m_c [kg].
        distance: Of its centre of mass from the slew axis, d [m].
        height: Of a point mass at that distance with the same product of inertia, above the support
            plane, h_c [m]. For one mass it is its height; for many, and for rigid bodies, only this
            one makes the circle exact.
        total_mass: Of the machine, M = m_0 + m_c [kg].
        mean_height: Of the machine's centre of mass above the support plane [m].
        axis: Where the slew axis meets the support plane, root frame [m].
    """

    mass: float
    distance: float
    height: float
    total_mass: float
    mean_height: float
    axis: tuple[float, float] = (0.0, 0.0)

    @property
    def radius_at_rest(self) -> float:
        """Radius of the ZMP's circle at rest, k = m_c d / M [m]."""
        return self.mass * self.distance / self.total_mass

    def radius(self, rate: Any, acceleration: Any) -> Any:
        r"""Distance of the ZMP from the centre of its circle [m].

        .. math:: r^2 = (m_c d / M)^2 [ (1 + h_c w^2 / g)^2 + (h_c \alpha / g)^2 ]    (Song & Sharf
            2020, from eq. (16))

        Args:
            rate: Of the slew, w [rad/s].
            acceleration: Of the slew, alpha [rad/s^2].
        """
        share = self.height / GRAVITY
        return self.radius_at_rest * np.hypot(
            1.0 + share * np.square(rate), share * np.asarray(acceleration)
        )

    def centre(self, base_acceleration: Any = 0.0) -> Array:
        r"""Centre of the ZMP's circle while the base accelerates forward by u_a [m/s^2], root frame, (..., 2) [m].

        .. math:: (x, y)_{axis} - (u_a \textstyle\sum m h / (M g), 0)    (eq. (16), u_a counted
            once; x is forward here)
        """
        push = np.asarray(base_acceleration, dtype=np.float64)
        return np.stack(
            [self.axis[0] + self.centre_slope * push, self.axis[1] + 0.0 * push], axis=-1
        )

    @property
    def centre_slope(self) -> float:
        r"""Derivative of the centre's x by the base acceleration, -sum m h / (M g), eq. (17) [s^2]."""
        return -self.mean_height / GRAVITY

    def squared_radius_rate(self, rate: Any, acceleration: Any, jerk: Any = 0.0) -> Any:
        r"""Time derivative of r^2 [m^2/s]; growing while the slew speeds up, shrinking while it slows down.

        .. math:: d(r^2)/dt = (m_c d / M)^2 [ 4 (h_c^2 w^3 \alpha + g h_c w \alpha) + 2 h_c^2 \alpha
            \dot\alpha ] / g^2

        Eq. (18) with its missing factor, and with the jerk that Assumption 2 c) takes for zero.
        """
        share = self.height / GRAVITY
        rate, acceleration = np.asarray(rate), np.asarray(acceleration)
        growth = 4.0 * share * rate * acceleration * (1.0 + share * rate**2)
        return self.radius_at_rest**2 * (growth + 2.0 * share**2 * acceleration * np.asarray(jerk))

    def reserve(self, radius: float) -> float:
        """Ratio rho = R M / (m_c d) of the support's radius to the ZMP's at rest; above 1 the machine stands [-]."""
        return radius / self.radius_at_rest

    def acceleration_bound(self, rate: Any, radius: float) -> Any:
        r"""Largest slew acceleration with the ZMP in a circle about the axis [rad/s^2]; 0 at the top rate and beyond.

        .. math:: |\alpha| \le (g / h_c) \sqrt{\rho^2 - (1 + h_c w^2 / g)^2}
        """
        room = self.reserve(radius) ** 2 - (1.0 + self.height * np.square(rate) / GRAVITY) ** 2
        return GRAVITY / self.height * np.sqrt(np.maximum(room, 0.0))

    def top_rate(self, radius: float) -> float:
        r"""Rate :math:`\sqrt{g (\rho - 1) / h_c}` at which the ZMP runs on the circle without acceleration [rad/s]."""
        return float(np.sqrt(GRAVITY * max(self.reserve(radius) - 1.0, 0.0) / self.height))


def slew_insight(machine: Machine, pose: Any) -> SlewInsight:
    r"""Lumped quantities of a machine in a pose: what turns with its first joint, and what stands.

    .. math:: d = |c_{xy} - p|, \qquad h_c = \int (e \cdot (r - p)) \, z \, dm / (m_c d), \quad e =
        (c_{xy} - p) / d

    c is the centre of mass of what turns, p the slew axis, z the height above the support plane.

    Args:
        machine: The machine; its payload counts.
        pose: Joint coordinates, shape (n,) [rad or m].

    Raises:
        MachineError: The first joint does not turn on the root about a vertical axis; what stands
            has its centre of mass off that axis (the paper's Assumption 2 d); or what turns has it
            on the axis or lumped below ground.
    """
    q = frozen_array(pose, name="pose", shape=(machine.size,), error=MachineError)
    model, data, name = machine.model, machine.model.createData(), machine.joint_names[0]
    joint = model.getJointId(name)
    pin.computeJointJacobians(model, data, machine.configuration(q[None])[0])  # fills data.oMi too
    # at the root origin, root axes
    twist = pin.getJointJacobian(model, data, joint, pin.WORLD)[:, machine.index_v[0]]
    if (
        model.parents[joint] != 1
        or np.abs(twist[[2, 3, 4]]).max() > ALIGNED
        or abs(abs(twist[5]) - 1.0) > ALIGNED
    ):
        raise MachineError(
            f"the first joint, {name!r}, must turn on the root about a vertical axis to be a slew"
        )
    axis = np.array([-twist[1], twist[0]]) / twist[5] + 0.0  # no -0.0
    turning = set(model.subtrees[joint])
    bodies = {
        index: data.oMi[index].act(model.inertias[index]) for index in range(1, model.njoints)
    }
    turn = sum((bodies[index] for index in turning), pin.Inertia.Zero())
    stand = sum((bodies[index] for index in bodies.keys() - turning), pin.Inertia.Zero())
    total = turn.mass + stand.mass
    offset = stand.mass / total * float(np.linalg.norm(stand.lever[:2] - axis))
    if offset > ALIGNED:
        raise MachineError(
            f"what stands has its centre of mass at ({stand.lever[0]:.6g}, {stand.lever[1]:.6g}) m, off the slew axis "
            f"at ({axis[0]:.6g}, {axis[1]:.6g}) m: the ZMP's circle is not centred on the axis"
        )
    plane = 0.0 if machine.support is None else machine.support.height
    arm = turn.lever[:2] - axis
    distance = float(np.linalg.norm(arm))
    if turn.mass * distance <= ALIGNED * total:
        raise MachineError(
            "what turns has its centre of mass on the slew axis: the slew does not move the ZMP"
        )
    # integral of (r - p) z dm
    product = turn.mass * arm * (turn.lever[2] - plane) - turn.inertia[:2, 2]
    height = float(product @ arm) / (turn.mass * distance**2)
    if height <= 0.0:
        raise MachineError(
            f"what turns has its lumped mass {-height:.3g} m below the support plane"
        )
    weighted = turn.mass * turn.lever[2] + stand.mass * stand.lever[2]
    return SlewInsight(
        mass=float(turn.mass),
        distance=distance,
        height=height,
        total_mass=float(total),
        mean_height=float(weighted / total - plane),
        axis=(float(axis[0]), float(axis[1])),
    )
