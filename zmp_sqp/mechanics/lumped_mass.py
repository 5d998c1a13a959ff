"""The simplified machine of Song & Sharf 2020, eq. (7)-(11): slew angle and the distance of a lumped mass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine

__all__ = ["FORM_TOLERANCE", "LumpedMass", "simplified_coordinates"]

# [m, rad] how far the chain, a start or a goal may be from the form that (7) needs
FORM_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class LumpedMass:
    r"""Horizontal distance d of the slewing mass from the slew axis as a function of the boom angle, eq. (9).

    .. math:: d(q_2) = A - B \sin q_2, \quad B = \Delta / \sum m_i

    A holds what does not move with the boom: cabin, and the parts of constant attitude beyond the
        levelling joint.

    Attributes:
        A: [m].
        B: [m].
        mass: Of all that slews [kg].
    """

    A: float
    B: float
    mass: float

    @classmethod
    def of(cls, machine: Machine, coordinates: Coordinates) -> LumpedMass:
        """Lumped mass of a machine whose joints move as `simplified_coordinates` says."""
        model, data = machine.model, machine.model.createData()
        slewing = [model.getJointId(name) for name in machine.joint_names]

        def reach(boom: float) -> tuple[float, float]:
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
        """d [m] at boom angles [rad], eq. (9)."""
        return np.asarray(self.A - self.B * np.sin(boom))

    def boom(self, distance: Array) -> Array:
        """Boom angles [rad] at distances [m], eq. (10)."""
        return np.asarray(np.arcsin((self.A - distance) / self.B))

    def derivatives(self, boom: Array) -> tuple[Array, Array, Array]:
        """First, second and third derivative of d by the boom angle [m]."""
        sine, cosine = np.sin(boom), np.cos(boom)
        return -self.B * cosine, self.B * sine, self.B * cosine

    def motion(self, boom: Array, rate: Array, acceleration: Array) -> tuple[Array, Array, Array]:
        """(d, d', d'') [m, s] of a boom motion, the inverse of eq. (11)."""
        first, second, _ = self.derivatives(boom)
        return self.distance(boom), first * rate, first * acceleration + second * rate**2


def simplified_coordinates(machine: Machine, start: Array) -> Coordinates:
    r"""Slew and boom angle as the coordinates of the simplified model, eq. (7).

    .. math:: q_3 = -\pi - 2 q_2, \quad q_4 = c - q_2 - q_3, \quad q_5 = \text{const}

    with c, the head's attitude, and q_5 from the start pose. The distance d of the lumped mass is
    monotone in the boom angle (`LumpedMass`), so both describe the same motions; in the boom angle
    the limits of the real joints are linear and the joints' motion is a polynomial, exactly.

    Args:
        machine: A slew joint, then boom, stick and levelling joint with parallel horizontal axes,
            boom and stick of equal length and in line at q = 0; joints beyond keep their start
            angles.
        start: Joint coordinates, shape (n,) [rad].

    Returns:
        Map from (slew, boom) to all joints.

    Raises:
        ProblemError: The chain does not have this form, or the start pose is not one of the model;
            the message says what is off.
    """
    names = machine.joint_names
    if len(names) < 4:
        raise ProblemError(
            f"the simplified model needs slew, boom, stick and levelling joint; there is {', '.join(names)}"
        )
    _check_chain(machine)
    off = start[2] + np.pi + 2.0 * start[1]
    if abs(off) > FORM_TOLERANCE:
        raise ProblemError(
            f"the simplified model needs {names[2]!r} = -pi - 2 {names[1]!r} (eq. 7), "
            f"here {-np.pi - 2.0 * start[1]:.6g}, "
            f"but the start has {start[2]:.6g}"
        )
    G = np.zeros((len(names), 2))
    G[0, 0], G[1:4, 1] = 1.0, (1.0, -2.0, 1.0)
    origin = np.array(start, dtype=float)
    origin[0], origin[1], origin[2], origin[3] = 0.0, 0.0, -np.pi, start[3] - start[1]
    return Coordinates(origin, G)


def _check_chain(machine: Machine) -> None:
    model, data, names = machine.model, machine.model.createData(), machine.joint_names
    ids = [model.getJointId(name) for name in names]
    for joint, parent in zip(ids[1:4], ids[:3], strict=True):
        if model.parents[joint] != parent:
            raise ProblemError(
                f"the simplified model needs a serial chain, but {model.names[joint]!r} hangs elsewhere"
            )
    pin.forwardKinematics(model, data, machine.configuration(np.zeros((1, machine.size)))[0])
    pin.computeJointJacobians(model, data)
    axes = []
    for name, joint in zip(names[:4], ids[:4], strict=True):
        column = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)[
            :, machine.index_v[names.index(name)]
        ]
        if np.linalg.norm(column[:3]) > FORM_TOLERANCE:
            raise ProblemError(f"the simplified model needs revolute joints, but {name!r} slides")
        axes.append(column[3:])
    if np.linalg.norm(axes[0] - [0.0, 0.0, 1.0]) > FORM_TOLERANCE:
        raise ProblemError(
            f"the simplified model needs {names[0]!r} to turn about the vertical of the root, not {axes[0]}"
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
            f"the simplified model needs {names[1]!r} to turn about -y (positive: backwards), not {axes[1]}"
        )
    places = [data.oMi[joint].translation for joint in ids[:4]]
    boom, stick = places[2] - places[1], places[3] - places[2]
    if np.abs(boom[:2]).max() > FORM_TOLERANCE or np.abs(stick[:2]).max() > FORM_TOLERANCE:
        raise ProblemError(
            f"the simplified model needs {names[1]!r} and {names[2]!r} to point straight up at q = 0"
        )
    if abs(boom[2] - stick[2]) > FORM_TOLERANCE:
        raise ProblemError(
            "the simplified model needs boom and stick of equal length, "
            f"but they are {boom[2]:.4g} m and {stick[2]:.4g} m"
        )
