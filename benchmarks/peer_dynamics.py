"""Ground reaction wrench of a machine in CasADi, from the bare numbers of its URDF: Newton and Euler, body by body.

Nothing of the library and nothing of Pinocchio is used, so that neither can lend the peer its
mistakes.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.problems.scene import Scene

__all__ = ["Body", "read_bodies", "wrench_function"]

Array = np.ndarray


@dataclass(frozen=True)
class Body:
    """One link, with the joint that hangs it on its parent."""

    name: str
    parent: str | None  # None: the root
    joint: str | None  # name of a joint that moves; None: fixed
    origin: Array  # of the joint in the parent's frame (3,) [m]
    rotation: Array  # link axes in the parent's at q = 0 (3, 3)
    axis: Array  # of the joint in the link's frame (3,)
    mass: float  # [kg]
    com: Array  # in the link's frame (3,) [m]
    inertia: Array  # about the com, link axes (3, 3) [kg m^2]


def read_bodies(urdf: Path) -> list[Body]:
    """Links of a URDF with revolute and fixed joints, parents first, in the order of the file."""
    robot = ET.parse(urdf).getroot()
    joints = {joint.find("child").get("link"): joint for joint in robot.findall("joint")}  # type: ignore[union-attr]
    bodies = []
    for link in robot.findall("link"):
        joint = joints.get(link.get("name"))
        parent, name, axis = None, None, np.array([1.0, 0.0, 0.0])
        if joint is not None:
            parent = joint.find("parent").get("link")  # type: ignore[union-attr]
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
        place = None if joint is None else joint.find("origin")
        bodies.append(
            Body(
                name=str(link.get("name")),
                parent=parent,
                joint=name,
                origin=_vector(place, "xyz"),
                rotation=_rotation(_vector(place, "rpy")),
                axis=axis,
                mass=float(inertial.find("mass").get("value")),
                com=_vector(inertial.find("origin"), "xyz"),
                inertia=turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T,
            )
        )
    return bodies


def wrench_function(scene: Scene) -> ca.Function:
    r"""Ground reaction wrench about the root origin, root axes, as a function of (q, v, a, gravity, payload's mass).

    .. math:: f = \sum m_i (\ddot c_i - g), \quad
              \tau = \sum c_i \times m_i (\ddot c_i - g) + I_i \dot\omega_i + \omega_i \times I_i
              \omega_i

    The payload's place and shape are the scene's tree; its inertia goes with its mass.
    """
    bodies = read_bodies(scene.urdf)
    moving = [body.joint for body in bodies if body.joint is not None]
    q, v, a = (ca.SX.sym(name, len(moving)) for name in "qva")
    gravity, load = ca.SX.sym("gravity", 3), ca.SX.sym("load")
    force, moment = ca.SX.zeros(3), ca.SX.zeros(3)
    frames: dict[str, Any] = {}
    for body in bodies:
        if body.parent is None:
            R, place, spin, spin_rate, push = (
                ca.SX.eye(3),
                ca.SX.zeros(3),
                ca.SX.zeros(3),
                ca.SX.zeros(3),
                -gravity,
            )
        else:
            R, place, spin, spin_rate, push = frames[body.parent]
            arm = R @ body.origin
            place, push = (
                place + arm,
                push + ca.cross(spin_rate, arm) + ca.cross(spin, ca.cross(spin, arm)),
            )
            R = R @ body.rotation
            if body.joint is not None:
                i = moving.index(body.joint)
                axis = R @ body.axis
                spin_rate = spin_rate + axis * a[i] + ca.cross(spin, axis * v[i])
                spin = spin + axis * v[i]
                cross = ca.skew(body.axis)
                R = R @ (ca.DM.eye(3) + ca.sin(q[i]) * cross + (1.0 - ca.cos(q[i])) * cross @ cross)
        frames[body.name] = R, place, spin, spin_rate, push
        parts = [(body.mass, body.com, body.inertia)]
        if scene.tree is not None and scene.tree.frame == body.name:
            parts.append(
                (load, np.array(scene.tree.com), load * (scene.tree.inertia / scene.tree.mass))
            )
        for mass, com, inertia in parts:
            arm = R @ com
            pull = mass * (push + ca.cross(spin_rate, arm) + ca.cross(spin, ca.cross(spin, arm)))
            turned = R @ inertia @ R.T
            force += pull
            moment += (
                ca.cross(place + arm, pull) + turned @ spin_rate + ca.cross(spin, turned @ spin)
            )
    return ca.Function("wrench", [q, v, a, gravity, load], [ca.vertcat(force, moment)])


def _vector(element: ET.Element | None, key: str) -> Array:
    return np.array(
        [
            float(entry)
            for entry in ("0 0 0" if element is None else element.get(key, "0 0 0")).split()
        ]
    )


def _rotation(rpy: Array) -> Array:
    """R_z(yaw) R_y(pitch) R_x(roll), as URDF has it."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    return np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]]) @ about_y @ about_x
