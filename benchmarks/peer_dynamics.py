"""Ground reaction wrench of a machine in CasADi, by the Newton-Euler equations of each body.

The numbers come from the URDF. Neither the library nor Pinocchio takes part, so that a mistake in
them shows up as a disagreement.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.problems.scene import Scene

__all__ = ["Body", "read_bodies", "wrench_function"]

Array = np.ndarray
# of a link, in root axes: rotation matrix, origin p, angular velocity and acceleration, p'' - g
Frame = tuple[Any, Any, Any, Any, Any]


@dataclass(frozen=True)
class Body:
    """A link, with the joint to its parent."""

    name: str
    parent: str | None  # None: the root
    joint: str | None  # name of the revolute joint to the parent; None: fixed
    origin: Array  # of the joint, in the parent's frame (3,) [m]
    rotation: Array  # from the link's axes to the parent's at q = 0 (3, 3)
    axis: Array  # of the joint, in the link's frame (3,)
    mass: float  # [kg]
    com: Array  # centre of mass, in the link's frame (3,) [m]
    inertia: Array  # about the centre of mass, link axes (3, 3) [kg m^2]


def read_bodies(urdf: Path) -> list[Body]:
    """Links of a URDF in the order of the file, parents first; joints are revolute or fixed."""
    robot = ET.parse(urdf).getroot()
    joints = {joint.find("child").get("link"): joint for joint in robot.findall("joint")}
    bodies = []
    for link in robot.findall("link"):
        joint = joints.get(link.get("name"))
        parent, name, axis = None, None, np.array([1.0, 0.0, 0.0])
        if joint is not None:
            parent = joint.find("parent").get("link")
            name = joint.get("name") if joint.get("type") == "revolute" else None
            axis = axis if joint.find("axis") is None else _vector(joint.find("axis"), "xyz")
            if joint.get("type") not in ("revolute", "fixed") or parent not in [
                body.name for body in bodies
            ]:
                raise ValueError(
                    f"joint {joint.get('name')!r}: only revolute and fixed joints, parents first"
                )
        inertial = link.find("inertial")
        if inertial is None:
            raise ValueError(f"link {link.get('name')!r} has no inertia")
        entries, turn = inertial.find("inertia"), _rotation(_vector(inertial.find("origin"), "rpy"))
        xx, xy, xz, yy, yz, zz = (
            float(entries.get(key)) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
        joint_frame = None if joint is None else joint.find("origin")
        bodies.append(
            Body(
                name=str(link.get("name")),
                parent=parent,
                joint=name,
                origin=_vector(joint_frame, "xyz"),
                rotation=_rotation(_vector(joint_frame, "rpy")),
                axis=axis,
                mass=float(inertial.find("mass").get("value")),
                com=_vector(inertial.find("origin"), "xyz"),
                inertia=turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T,
            )
        )
    return bodies


def wrench_function(
    scene: Scene, *, driving: bool = False, options: Mapping[str, Any] | None = None
) -> ca.Function:
    r"""Ground reaction wrench about the root origin, root axes.

    .. math:: f = \sum m_i (\ddot c_i - g), \quad
              \tau = \sum c_i \times m_i (\ddot c_i - g)
                      + I_i \dot\omega_i + \omega_i \times I_i \omega_i

    Args:
        scene: Machine and shape of the tree.
        driving: The root drives in its plane: yaw and path length follow the joints in q, v and a,
            and gravity is in root axes where the yaw is zero.
        options: Of the CasADi function.

    Returns:
        Function of q, v, a, gravity in root axes and the mass of the payload. The payload is where
        the scene's tree is; its inertia is proportional to its mass.
    """
    bodies = read_bodies(scene.urdf)
    moving = [body.joint for body in bodies if body.joint is not None]
    q, v, a = (ca.SX.sym(name, len(moving) + 2 * driving) for name in "qva")
    gravity, load = ca.SX.sym("gravity", 3), ca.SX.sym("load")
    force, moment = ca.SX.zeros(3), ca.SX.zeros(3)
    frames: dict[str, Frame] = {}
    for body in bodies:
        if body.parent is None:
            zero = ca.SX.zeros(3)
            frame = ca.SX.eye(3), zero, zero, zero, -gravity
            if driving:
                frame = _driving_root(q[-2], v[-2:], a[-2:], gravity)
        else:
            i = None if body.joint is None else moving.index(body.joint)
            joint = None if i is None else (q[i], v[i], a[i])
            frame = _link_frame(frames[body.parent], body, joint)
        frames[body.name] = frame
        R, origin, omega, omega_rate, acceleration = frame
        parts = [(body.mass, body.com, body.inertia)]
        if scene.tree is not None and scene.tree.frame == body.name:
            tree = scene.tree
            parts.append((load, np.array(tree.com), load * (tree.inertia / tree.mass)))
        for mass, com, inertia in parts:
            arm = R @ com
            push = mass * (acceleration + _relative_acceleration(omega, omega_rate, arm))
            turned = R @ inertia @ R.T
            force += push
            moment += (
                ca.cross(origin + arm, push) + turned @ omega_rate + ca.cross(omega, turned @ omega)
            )
    outputs = [ca.vertcat(force, moment)]
    return ca.Function("wrench", [q, v, a, gravity, load], outputs, dict(options or {}))


def _driving_root(yaw: Any, rates: Any, accelerations: Any, gravity: Any) -> Frame:
    """Motion of a root that drives ahead along its x axis, in its own axes.

    Args:
        yaw: [rad].
        rates: Yaw rate and speed.
        accelerations: Of yaw and path length.
        gravity: In root axes where the yaw is zero.
    """
    zero, c, s = ca.SX.zeros(3), ca.cos(yaw), ca.sin(yaw)
    turned = ca.vertcat(c * gravity[0] + s * gravity[1], c * gravity[1] - s * gravity[0])
    acceleration = ca.vertcat(accelerations[1], rates[0] * rates[1], 0.0)
    about_z = [ca.vertcat(0.0, 0.0, value) for value in (rates[0], accelerations[0])]
    return ca.SX.eye(3), zero, *about_z, acceleration - ca.vertcat(turned, gravity[2])


def _link_frame(parent: Frame, body: Body, joint: tuple[Any, Any, Any] | None) -> Frame:
    """Motion of a link: that of its parent, then that of its joint's (q, v, a), None if fixed."""
    R, origin, omega, omega_rate, acceleration = parent
    arm = R @ body.origin
    origin = origin + arm
    acceleration = acceleration + _relative_acceleration(omega, omega_rate, arm)
    R = R @ body.rotation
    if joint is not None:
        angle, rate, joint_acceleration = joint
        axis = R @ body.axis
        omega_rate = omega_rate + axis * joint_acceleration + ca.cross(omega, axis * rate)
        omega = omega + axis * rate
        cross = ca.skew(body.axis)
        R = R @ (ca.DM.eye(3) + ca.sin(angle) * cross + (1.0 - ca.cos(angle)) * cross @ cross)
    return R, origin, omega, omega_rate, acceleration


def _relative_acceleration(omega: Any, omega_rate: Any, arm: Any) -> Any:
    """Acceleration of a point of a turning body relative to the body's origin, at that arm."""
    return ca.cross(omega_rate, arm) + ca.cross(omega, ca.cross(omega, arm))


def _vector(element: ET.Element | None, key: str) -> Array:
    return np.array(
        [
            float(entry)
            for entry in ("0 0 0" if element is None else element.get(key, "0 0 0")).split()
        ]
    )


def _rotation(rpy: Array) -> Array:
    """Rotation matrix R_z(yaw) R_y(pitch) R_x(roll) of URDF's roll, pitch and yaw."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    return np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]]) @ about_y @ about_x
