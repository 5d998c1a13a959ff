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
UP = np.array([0.0, 0.0, 1.0])  # z axis of the root


@dataclass(frozen=True, slots=True, eq=False)
class LumpedMass:
    r"""Horizontal distance d of the slewing mass from the slew axis, by the boom angle.

    .. math:: d(q_2) = A - B \sin q_2, \quad B = \Delta / \sum m_i
              \qquad \text{(Song \& Sharf 2020, eq. (9))}

    where q_2 is the boom angle, negative for a boom that leans forwards. The distance is that of
    the centre of mass of all links that slew, along the direction in which the arm reaches.

    Attributes:
        A: Distance with the boom upright, q_2 = 0: the share of the cabin, and of the links beyond
            the levelling joint, whose attitude is constant [m].
        B: Amplitude: how much further out the mass is with the boom level, q_2 = -pi/2; negative
            where the boom leans forwards at positive angles [m].
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

        Raises:
            ProblemError: The distance is not of the form of eq. (9), as where a centre of mass is
                off the line between the joints of boom or stick.
        """
        model, data = machine.model, machine.model.createData()
        slew = model.getJointId(machine.joint_names[0])
        slewing = list(model.subtrees[slew])
        # -1 where negative boom angles lean forwards, else 1; the stick's coordinate tells
        lean = float(-np.sign(coordinates.origin[2] * coordinates.G[2, 1]))
        forward = -lean * np.cross(UP, _axes(machine)[1])

        def reach(boom: float) -> tuple[float, float]:  # distance [m] and mass [kg]
            q = machine.configuration(coordinates.joints(np.array([[0.0, boom]])))[0]
            pin.forwardKinematics(model, data, q)
            masses = np.array([model.inertias[joint].mass for joint in slewing])
            centres = np.array(
                [data.oMi[joint].act(model.inertias[joint].lever) for joint in slewing]
            )
            axis = data.oMi[slew].translation
            return float(masses @ ((centres - axis) @ forward) / masses.sum()), float(masses.sum())

        (upright, mass), (level, _) = reach(0.0), reach(0.5 * np.pi * lean)
        found = cls(upright, -lean * (level - upright), mass)
        between = 0.25 * np.pi * lean
        off = abs(float(found.distance(np.array(between))) - reach(between)[0])
        if off > FORM_TOLERANCE:
            raise ProblemError(
                "the distance of the simplified model's lumped mass is not A - B sin(boom angle) "
                f"(Song & Sharf 2020, eq. (9)): it is off by {off:.3g} m with the boom half down; "
                "the centres of mass of boom and stick must lie on the lines between their joints"
            )
        return found

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

    Signs are the machine's own. The arm may reach in any horizontal direction. An axis of stick or
    levelling joint opposite to the boom's turns the sign of that joint, and a boom that leans
    forwards at positive angles has +pi in place of -pi: the start pose tells.

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
            f"the machine has {', '.join(names) or 'no joints'}"
        )
    stick, tilt = _check_chain(machine)
    half_turn = float(np.copysign(np.pi, stick * start[2] + 2.0 * start[1]))
    off = stick * start[2] - half_turn + 2.0 * start[1]
    if abs(off) > FORM_TOLERANCE:
        wanted = stick * (half_turn - 2.0 * start[1])
        needed, given = distinct_texts(float(wanted), float(start[2]))
        turned = "-pi" if stick * half_turn < 0.0 else "pi"
        raise ProblemError(
            f"the simplified model needs {names[2]!r} = {turned} {'-+'[stick < 0.0]} 2 "
            f"{names[1]!r} (Song & Sharf 2020, eq. (7)), which is {needed} rad, but the start has "
            f"{given} rad"
        )
    G = np.zeros((len(names), 2))
    # dq_3/dq_2 = -2, dq_4/dq_2 = -1 + 2
    G[0, 0], G[1, 1], G[2, 1], G[3, 1] = 1.0, 1.0, -2.0 * stick, tilt
    origin = np.array(start, dtype=float)
    origin[0], origin[1], origin[2] = 0.0, 0.0, stick * half_turn
    origin[3] = start[3] - tilt * start[1]
    return Coordinates(origin, G)


def _axes(machine: Machine) -> Array:
    """Axes of the planned joints at zero coordinates, root axes, (n, 3); zero if they slide."""
    model, data = machine.model, machine.model.createData()
    pin.computeJointJacobians(model, data, machine.configuration(np.zeros((1, machine.size)))[0])
    return np.array(
        [
            pin.getJointJacobian(model, data, model.getJointId(name), pin.LOCAL_WORLD_ALIGNED)[
                3:, column
            ]
            for name, column in zip(machine.joint_names, machine.index_v, strict=True)
        ]
    )


def _check_chain(machine: Machine) -> tuple[float, float]:
    """Refuse a machine whose first four joints do not have the form that eq. (7) needs.

    Returns:
        1 or -1 for the axes of stick and levelling joint: as the boom's, or opposite to it.
    """
    model, data, names = machine.model, machine.model.createData(), machine.joint_names
    ids = [model.getJointId(name) for name in names[:4]]
    for joint, parent in zip(ids[1:], ids[:3], strict=True):
        if model.parents[joint] != parent:
            raise ProblemError(
                "the simplified model needs slew, boom, stick and levelling joint one behind the "
                f"other, but joint {model.names[joint]!r} does not follow {model.names[parent]!r}"
            )
    axes = _axes(machine)
    for name, axis, unit in zip(names[:4], axes, machine.joint_units, strict=False):
        if unit != "rad":
            raise ProblemError(
                f"the simplified model needs revolute joints, but {name!r} is prismatic"
            )
        if name == names[0] and np.abs(np.abs(axis) - UP).max() > FORM_TOLERANCE:
            raise ProblemError(
                f"the simplified model needs {name!r} to turn about the z axis of the root link, "
                f"not about {_spell(axis)}"
            )
    for name, axis in zip(names[2:4], axes[2:], strict=False):
        if np.linalg.norm(np.cross(axis, axes[1])) > FORM_TOLERANCE:
            raise ProblemError(
                f"the simplified model needs the axes of {names[1]!r} and {name!r} to be parallel, "
                f"but they are {_spell(axes[1])} and {_spell(axis)}"
            )
    if abs(axes[1][2]) > FORM_TOLERANCE:
        raise ProblemError(
            f"the simplified model needs {names[1]!r} to turn about a horizontal axis, "
            f"not about {_spell(axes[1])}"
        )
    pin.forwardKinematics(model, data, machine.configuration(np.zeros((1, machine.size)))[0])
    origins = np.array([data.oMi[joint].translation for joint in ids[1:]])
    _check_lengths(names, origins, np.cross(UP, axes[1]))
    stick, tilt = (float(np.sign(axis @ axes[1])) for axis in axes[2:4])
    return stick, tilt


def _check_lengths(names: tuple[str, ...], origins: Array, ahead: Array) -> None:
    """Refuse boom and stick that are not upright at q = 0, or not equally long.

    Args:
        names: Names of the joints.
        origins: Positions of boom, stick and levelling joint at q = 0, root frame, shape (3, 3).
        ahead: Horizontal unit vector in the plane in which the arm moves, shape (3,).
    """
    faults, arms = [], np.diff(origins, axis=0) @ np.column_stack([ahead, UP])  # (2, 2), in plane
    lengths = np.linalg.norm(arms, axis=1)
    if abs(lengths[0] - lengths[1]) > FORM_TOLERANCE:
        spelled = distinct_texts(float(lengths[0]), float(lengths[1]), digits=4)
        faults.append(
            "boom and stick of equal length, so that their tip can move on a level line, but "
            f"{names[1]!r} and {names[2]!r} are {' m and '.join(spelled)} m long"
        )
    for i, (aside, up) in enumerate(arms, start=1):
        if abs(aside) > FORM_TOLERANCE or up <= 0.0:
            faults.append(
                f"{names[i]!r} to point straight up at q = 0, but there {names[i + 1]!r} is "
                f"{aside:.4g} m ahead of {names[i]!r} and {up:.4g} m above it"
            )
    if faults:
        raise ProblemError(f'the simplified model needs {"; and ".join(faults)}. Use model="full"')


def _spell(vector: Array) -> str:
    """Three numbers in parentheses."""
    return f"({', '.join(f'{entry + 0.0:.4g}' for entry in vector)})"
