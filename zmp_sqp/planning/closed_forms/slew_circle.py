"""ZMP of a machine that slews on level ground (Song & Sharf 2020, eqs. (12)-(18)).

The ZMP is on a circle whose radius depends on rate and acceleration of the slew. Misprints of the
paper are corrected.
"""

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

# [m, or sine of an angle] Axes count as vertical, and points as on the axis, within this: the
# rounding of numbers in a URDF.
ALIGNED = 1e-6


@dataclass(frozen=True, slots=True)
class SlewInsight:
    """Turning part of a machine in one pose, lumped into one mass (Assumption 2 of the paper).

    Attributes:
        mass: Mass m_c of everything that turns with the first joint, the slew [kg].
        distance: Distance d of its centre of mass from the slew axis [m].
        height: Height h_c above the support plane at which a point mass m_c at distance d has the
            product of inertia of the turning part [m]. If the turning part is one point mass, h_c
            is its height; otherwise h_c is the only height for which the circle is exact.
        total_mass: Mass M = m_0 + m_c of the machine [kg].
        mean_height: Height of the machine's centre of mass above the support plane [m].
        axis: Point at which the slew axis meets the support plane, root frame [m].
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

        Song & Sharf 2020, from eq. (16):

        .. math:: r^2 = (m_c d / M)^2 [ (1 + h_c w^2 / g)^2 + (h_c \alpha / g)^2 ]

        Args:
            rate: Rate w of the slew [rad/s].
            acceleration: Acceleration alpha of the slew [rad/s^2].
        """
        share = self.height / GRAVITY
        return self.radius_at_rest * np.hypot(
            1.0 + share * np.square(rate), share * np.asarray(acceleration)
        )

    def centre(self, base_acceleration: Any = 0.0) -> Array:
        r"""Centre of the ZMP's circle while the base accelerates, root frame, shape (..., 2) [m].

        Song & Sharf 2020, eq. (16), with u_a counted once and x forward:

        .. math:: (x, y)_{axis} - (u_a \textstyle\sum m h / (M g), 0)

        Args:
            base_acceleration: Acceleration u_a of the base, forward positive, shape (...) [m/s^2].
        """
        u_a = np.asarray(base_acceleration, dtype=np.float64)
        return np.stack(
            [self.axis[0] + self.centre_derivative * u_a, self.axis[1] + 0.0 * u_a], axis=-1
        )

    @property
    def centre_derivative(self) -> float:
        r"""Derivative -sum m h / (M g) of the centre's x by the base acceleration, (17) [s^2]."""
        return -self.mean_height / GRAVITY

    def squared_radius_rate(self, rate: Any, acceleration: Any, jerk: Any = 0.0) -> Any:
        r"""Time derivative of the squared radius r^2 [m^2/s].

        Song & Sharf 2020, eq. (18), with its missing factor and with the jerk that Assumption 2 c)
        takes for zero:

        .. math::
            d(r^2)/dt = (m_c d / M)^2
            [ 4 (h_c^2 w^3 \alpha + g h_c w \alpha) + 2 h_c^2 \alpha \dot\alpha ] / g^2

        Without jerk it is positive while the slew speeds up, negative while it slows down.

        Args:
            rate: Rate w of the slew [rad/s].
            acceleration: Acceleration alpha of the slew [rad/s^2].
            jerk: Jerk of the slew [rad/s^3].
        """
        share = self.height / GRAVITY
        rate, acceleration = np.asarray(rate), np.asarray(acceleration)
        growth = 4.0 * share * rate * acceleration * (1.0 + share * rate**2)
        return self.radius_at_rest**2 * (growth + 2.0 * share**2 * acceleration * np.asarray(jerk))

    def reserve(self, radius: float) -> float:
        """Ratio rho = R M / (m_c d) of a circle's radius R to that of the ZMP at rest.

        If rho > 1, the ZMP at rest is inside the circle.

        Args:
            radius: Radius R of the circle [m].
        """
        return radius / self.radius_at_rest

    def acceleration_bound(self, rate: Any, radius: float) -> Any:
        r"""Largest slew acceleration with the ZMP in a circle about the slew axis [rad/s^2].

        .. math:: |\alpha| \le (g / h_c) \sqrt{\rho^2 - (1 + h_c w^2 / g)^2}

        It is 0 at and above `top_rate`.

        Args:
            rate: Rate w of the slew [rad/s].
            radius: Radius R of the circle [m].
        """
        room = self.reserve(radius) ** 2 - (1.0 + self.height * np.square(rate) / GRAVITY) ** 2
        return GRAVITY / self.height * np.sqrt(np.maximum(room, 0.0))

    def top_rate(self, radius: float) -> float:
        r"""Rate at which a slew without acceleration has the ZMP on the circle of a radius [rad/s].

        .. math:: w_{top} = \sqrt{g (\rho - 1) / h_c}

        Args:
            radius: Radius R of the circle [m].
        """
        return float(np.sqrt(GRAVITY * max(self.reserve(radius) - 1.0, 0.0) / self.height))


def slew_insight(machine: Machine, pose: Any) -> SlewInsight:
    r"""Lumped quantities of the part of a machine that turns with its first joint, in one pose.

    .. math::
        d = |c_{xy} - p|, \qquad e = (c_{xy} - p) / d, \qquad
        h_c = \int (e \cdot (r - p)) \, z \, dm / (m_c d)

    c is the centre of mass of the turning part, p the slew axis, r a point of the turning part and
    z its height above the support plane.

    Args:
        machine: The machine with its payload.
        pose: Joint coordinates, shape (n,) [rad or m].

    Raises:
        MachineError: The first joint does not turn on the root about a vertical axis; the standing
            part has its centre of mass off the slew axis (the paper's Assumption 2 d); or the
            turning part has its centre of mass on the axis, or h_c is not positive.
    """
    q = frozen_array(pose, name="pose", shape=(machine.size,), error=MachineError)
    axis = _slew_axis(machine, q)
    turn, stand = _turning_and_standing(machine, q)
    total = turn.mass + stand.mass
    offset = stand.mass / total * float(np.linalg.norm(stand.lever[:2] - axis))
    if offset > ALIGNED:
        raise MachineError(
            "the part that does not turn has its centre of mass at "
            f"({stand.lever[0]:.6g}, {stand.lever[1]:.6g}) m, off the slew axis at "
            f"({axis[0]:.6g}, {axis[1]:.6g}) m: the ZMP's circle is not centred on the axis"
        )
    plane = 0.0 if machine.support is None else machine.support.height
    weighted = turn.mass * turn.lever[2] + stand.mass * stand.lever[2]
    distance, height = _lumped_mass(turn, axis, plane, total)
    return SlewInsight(
        mass=float(turn.mass),
        distance=distance,
        height=height,
        total_mass=float(total),
        mean_height=float(weighted / total - plane),
        axis=(float(axis[0]), float(axis[1])),
    )


def _slew_axis(machine: Machine, q: Array) -> Array:
    """Horizontal position of the slew axis in the root frame, shape (2,) [m]."""
    model, data, name = machine.model, machine.model.createData(), machine.joint_names[0]
    joint = model.getJointId(name)
    if mimics := machine.mimics_of(name):
        raise MachineError(
            f"joint {mimics[0]!r} mimics {name!r}: what turns with the slew is not rigid"
        )
    pin.computeJointJacobians(model, data, machine.configuration(q[None])[0])
    # twist of the joint's unit rate about the root origin, root axes: linear, then angular
    twist = pin.getJointJacobian(model, data, joint, pin.WORLD)[:, machine.index_v[0]]
    if (
        model.parents[joint] != 1
        or np.abs(twist[[2, 3, 4]]).max() > ALIGNED
        or abs(abs(twist[5]) - 1.0) > ALIGNED
    ):
        raise MachineError(
            f"the first joint, {name!r}, must turn on the root about a vertical axis to be a slew"
        )
    return np.asarray(np.array([-twist[1], twist[0]]) / twist[5] + 0.0)  # + 0.0 removes -0.0


def _turning_and_standing(machine: Machine, q: Array) -> tuple[pin.Inertia, pin.Inertia]:
    """Spatial inertias, root frame, of what turns with the first joint and of what stands."""
    model, data = machine.model, machine.model.createData()
    pin.forwardKinematics(model, data, machine.configuration(q[None])[0])
    turning = set(model.subtrees[model.getJointId(machine.joint_names[0])])
    bodies = {
        index: data.oMi[index].act(model.inertias[index]) for index in range(1, model.njoints)
    }
    turn = sum((bodies[index] for index in turning), pin.Inertia.Zero())
    stand = sum((bodies[index] for index in bodies.keys() - turning), pin.Inertia.Zero())
    return turn, stand


def _lumped_mass(turn: pin.Inertia, axis: Array, plane: float, total: float) -> tuple[float, float]:
    """Distance d from the slew axis and height h_c of the lumped mass [m].

    Args:
        turn: Spatial inertia of the turning part, root frame.
        axis: Position of the slew axis, shape (2,) [m].
        plane: Height of the support plane [m].
        total: Mass of the machine [kg].
    """
    arm = turn.lever[:2] - axis
    distance = float(np.linalg.norm(arm))
    if turn.mass * distance <= ALIGNED * total:
        raise MachineError(
            "the part that turns has its centre of mass on the slew axis, so that slewing does not "
            "move the ZMP"
        )
    # integral of (r - p) z dm, by the parallel axis theorem
    product = turn.mass * arm * (turn.lever[2] - plane) - turn.inertia[:2, 2]
    height = float(product @ arm) / (turn.mass * distance**2)
    if height <= 0.0:
        raise MachineError(
            f"the lumped mass of the part that turns is {-height:.3g} m below the support plane"
        )
    return distance, height
