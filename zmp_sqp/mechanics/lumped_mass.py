"""Simplified machine of Song & Sharf 2020, eq. (7)-(11): a slewing arm as one lumped mass.

Boom, stick and levelling joint move together, so that two coordinates are left: the slew angle, and
the distance of the lumped mass from the slew axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array, distinct_texts
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine

__all__ = ["FORM_TOLERANCE", "LumpedMass", "simplified_coordinates"]

# [m or rad] deviation of the chain, a start or a goal from eq. (7) that counts as rounding
FORM_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class LumpedMass:
    r"""Horizontal distance d of the slewing mass from the slew axis, by the boom angle.

    .. math:: d(q_2) = A - B \sin q_2, \quad B = \Delta / \sum m_i
              \qquad \text{(Song \& Sharf 2020, eq. (9))}

    where q_2 is the boom angle, negative for a boom that leans forwards. The distance is that of
    the centre of mass of all links that slew, along the x axis of the slewing cabin.

    Attributes:
        A: Distance with the boom upright, q_2 = 0: the share of the cabin, and of the links beyond
            the levelling joint, whose attitude is constant [m].
        B: Amplitude: how much further out the mass is with the boom level, q_2 = -pi/2 [m].
        mass: Mass of all links that slew [kg].
    """

    A: float
    B: float
    mass: float

    @classmethod
    def of(cls, machine: Machine, coordinates: Coordinates) -> LumpedMass:
        """Lumped mass of a machine.

        Args:
            machine: Machine with its payload.
            coordinates: Map from (slew, boom) to the joints, by `simplified_coordinates`.
        """
        model, data = machine.model, machine.model.createData()
        slewing = [model.getJointId(name) for name in machine.joint_names]

        def reach(boom: float) -> tuple[float, float]:  # distance [m] and mass [kg]
            q = machine.configuration(coordinates.joints(np.array([[0.0, boom]])))[0]
            pin.forwardKinematics(model, data, q)
            masses = np.array([model.inertias[joint].mass for joint in slewing])
            centres = np.array(
                [data.oMi[joint].act(model.inertias[joint].lever) for joint in slewing]
            )
            axis = data.oMi[slewing[0]].translation
            return float(masses @ (centres - axis)[:, 0] / masses.sum()), float(masses.sum())

        (upright, mass), (forward, _) = reach(0.0), reach(-np.pi / 2)
        return cls(upright, forward - upright, mass)

    def distance(self, boom: Array) -> Array:
        """Distances d [m] at boom angles [rad], eq. (9)."""
        return np.asarray(self.A - self.B * np.sin(boom))

    def boom(self, distance: Array) -> Array:
        """Boom angles [rad] at distances d [m], eq. (10)."""
        return np.asarray(np.arcsin((self.A - distance) / self.B))

    def derivatives(self, boom: Array) -> tuple[Array, Array, Array]:
        """First, second and third derivatives of d by the boom angle [m/rad, m/rad^2, m/rad^3]."""
        sine, cosine = np.sin(boom), np.cos(boom)
        return -self.B * cosine, self.B * sine, self.B * cosine

    def motion(self, boom: Array, rate: Array, acceleration: Array) -> tuple[Array, Array, Array]:
        """Distance and its time derivatives, the inverse of eq. (11).

        Args:
            boom: Boom angles, shape (K,) [rad].
            rate: Their first time derivatives, shape (K,) [rad/s].
            acceleration: Their second time derivatives, shape (K,) [rad/s^2].

        Returns:
            d, d' and d'', shape (K,) each [m, m/s, m/s^2].
        """
        first, second, _ = self.derivatives(boom)
        return self.distance(boom), first * rate, first * acceleration + second * rate**2


def simplified_coordinates(machine: Machine, start: Array) -> Coordinates:
    r"""Planning coordinates (slew angle q_1, boom angle q_2) of the simplified model.

    .. math:: q_3 = -\pi - 2 q_2, \quad q_4 = c - q_2 - q_3, \quad q_5 = \text{const}
              \qquad \text{(Song \& Sharf 2020, eq. (7))}

    The attitude c of the head and q_5 are those of the start pose. The paper plans the distance d
    of the lumped mass instead of q_2. Both describe the same motions, because d is monotone in q_2
    (see `LumpedMass`), but in q_2 the limits of the joints are linear and the joint motions are
    exact polynomials.

    Args:
        machine: Machine whose first four joints are slew, boom, stick and levelling joint: the
            first vertical, the others with parallel horizontal axes; boom and stick equally long
            and upright at q = 0. Joints beyond keep their start angles.
        start: Joint coordinates at the start, shape (n,) [rad].

    Returns:
        Map from (slew, boom) to all joints.

    Raises:
        ProblemError: The machine does not have this form, or the start does not satisfy eq. (7);
            the message says what is wrong.
    """
    names = machine.joint_names
    if len(names) < 4:
        raise ProblemError(
            "the simplified model needs slew, boom, stick and levelling joint; "
            f"the machine has {', '.join(names)}"
        )
    _check_chain(machine)
    off = start[2] + np.pi + 2.0 * start[1]
    if abs(off) > FORM_TOLERANCE:
        needed, given = distinct_texts(float(-np.pi - 2.0 * start[1]), float(start[2]))
        raise ProblemError(
            f"the simplified model needs {names[2]!r} = -pi - 2 {names[1]!r} "
            f"(Song & Sharf 2020, eq. (7)), which is {needed} rad, but the start has {given} rad"
        )
    G = np.zeros((len(names), 2))
    G[0, 0], G[1:4, 1] = 1.0, (1.0, -2.0, 1.0)  # dq_3/dq_2 = -2, dq_4/dq_2 = -1 + 2
    origin = np.array(start, dtype=float)
    origin[0], origin[1], origin[2], origin[3] = 0.0, 0.0, -np.pi, start[3] - start[1]
    return Coordinates(origin, G)


def _check_chain(machine: Machine) -> None:
    """Refuse a machine whose first four joints do not have the form that eq. (7) needs."""
    model, data, names = machine.model, machine.model.createData(), machine.joint_names
    ids = [model.getJointId(name) for name in names]
    for joint, parent in zip(ids[1:4], ids[:3], strict=True):
        if model.parents[joint] != parent:
            raise ProblemError(
                "the simplified model needs a serial chain, but joint "
                f"{model.names[joint]!r} does not follow {model.names[parent]!r}"
            )
    pin.forwardKinematics(model, data, machine.configuration(np.zeros((1, machine.size)))[0])
    pin.computeJointJacobians(model, data)
    axes = []
    for name, joint in zip(names[:4], ids[:4], strict=True):
        column = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)[
            :, machine.index_v[names.index(name)]
        ]
        if np.linalg.norm(column[:3]) > FORM_TOLERANCE:
            raise ProblemError(
                f"the simplified model needs revolute joints, but {name!r} is prismatic"
            )
        axes.append(column[3:])
    if np.linalg.norm(axes[0] - [0.0, 0.0, 1.0]) > FORM_TOLERANCE:
        raise ProblemError(
            f"the simplified model needs {names[0]!r} to turn about the z axis of the root link, "
            f"not about {axes[0]}"
        )
    for name, axis in zip(names[2:4], axes[2:], strict=True):
        if np.linalg.norm(axis - axes[1]) > FORM_TOLERANCE:
            raise ProblemError(
                f"the simplified model needs the axes of {names[1]!r} and {name!r} to be parallel"
            )
    if (
        abs(axes[1][2]) > FORM_TOLERANCE
        or np.linalg.norm(axes[1] - [0.0, -1.0, 0.0]) > FORM_TOLERANCE
    ):
        raise ProblemError(
            f"the simplified model needs {names[1]!r} to turn about -y, so that positive angles "
            f"lean backwards, not about {axes[1]}"
        )
    origins = [data.oMi[joint].translation for joint in ids[:4]]
    boom, stick = origins[2] - origins[1], origins[3] - origins[2]
    if np.abs(boom[:2]).max() > FORM_TOLERANCE or np.abs(stick[:2]).max() > FORM_TOLERANCE:
        raise ProblemError(
            f"the simplified model needs {names[1]!r} and {names[2]!r} "
            "to point straight up at q = 0"
        )
    if abs(boom[2] - stick[2]) > FORM_TOLERANCE:
        lengths = distinct_texts(float(boom[2]), float(stick[2]), digits=4)
        raise ProblemError(
            "the simplified model needs boom and stick of equal length, "
            f"but they are {' m and '.join(lengths)} m long"
        )
