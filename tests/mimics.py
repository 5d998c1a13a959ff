"""Machines with mimic joints, and the same machines with all joints planned, coupled by hand."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import zmp_sqp as zs

__all__ = ["MACHINES", "Coupled", "coupled", "urdf"]

Array = np.ndarray

# link: mass [kg], centre of mass [m], edges of the box [m]
GRIPPER_LINKS = {
    "base": (600.0, (0.1, -0.05, 0.3), (1.6, 1.2, 0.4)),
    "mast": (80.0, (0.0, 0.05, 0.4), (0.3, 0.3, 0.8)),
    "arm": (60.0, (0.7, 0.0, 0.1), (1.4, 0.2, 0.2)),
    "jaw": (45.0, (0.1, 0.1, 0.0), (0.3, 0.1, 0.2)),
    "other": (40.0, (0.1, -0.1, 0.0), (0.3, 0.1, 0.2)),
    "thumb": (15.0, (0.1, 0.0, 0.2), (0.1, 0.1, 0.4)),
    "hook": (12.0, (0.0, 0.1, 0.2), (0.1, 0.1, 0.3)),
}
# joint: type, parent, child, place [m], turn [rad], axis, limits, mimic
GRIPPER_JOINTS = {
    "turn": ("continuous", "base", "mast", (0.2, 0.0, 0.5), "0 0 0", "0 0 1", (0, 0, 1.2), ""),
    "lift": ("revolute", "mast", "arm", (0.1, 0, 0.8), "0 0 0.1", "0 -1 0", (-1.2, 1.2, 0.9), ""),
    # before its leader in the file, and before it in Pinocchio's order
    "a_other": (
        *("prismatic", "arm", "other", (1.4, -0.1, 0.0), "0 0 0", "0 1 0", (-0.5, 0.5, 2.0)),
        '<mimic joint="jaw" multiplier="-1"/>',
    ),
    "jaw": ("prismatic", "arm", "jaw", (1.4, 0.1, 0), "0 0 0", "0 1 0", (-0.3, 0.6, 0.8), ""),
    "thumb": (
        *("revolute", "jaw", "thumb", (0.2, 0.0, 0.1), "0.2 0 0", "1 0 0", (-2.0, 2.0, 3.0)),
        '<mimic joint="a_other" multiplier="-2.5" offset="0.3"/>',
    ),
    "hook": (
        *("continuous", "other", "hook", (0.2, 0, 0), "0 0.4 0", "0 0.6 0.8", (0, 0, 4.0)),
        '<mimic joint="thumb" multiplier="1.2" offset="-0.7"/>',
    ),
}
GRIPPER_COUPLING = {
    "a_other": ("jaw", -1.0, 0.0),
    "thumb": ("jaw", 2.5, 0.3),
    "hook": ("jaw", 3.0, -0.34),  # 1.2 (2.5 y + 0.3) - 0.7
}

# a parallel linkage: the head keeps its attitude, a counterweight swings back on the undercarriage,
# two stages telescope together, and a drum turns with the slew
LINKAGE_LINKS = {
    "base": (900.0, (0.0, 0.0, 0.3), (2.0, 1.6, 0.5)),
    "cabin": (150.0, (-0.3, 0.0, 0.4), (0.8, 0.6, 0.7)),
    "boom": (70.0, (1.0, 0.0, 0.0), (2.0, 0.2, 0.2)),
    "rod": (20.0, (0.9, 0.05, 0.0), (1.8, 0.1, 0.1)),
    "stage": (40.0, (0.5, 0.0, 0.0), (1.0, 0.2, 0.2)),
    "tip": (30.0, (0.4, 0.0, 0.0), (0.8, 0.1, 0.1)),
    "head": (60.0, (0.1, 0.0, -0.2), (0.3, 0.4, 0.4)),
    "weight": (120.0, (-0.5, 0.0, 0.1), (0.4, 0.6, 0.4)),
    "drum": (25.0, (0.1, 0.0, 0.0), (0.3, 0.3, 0.1)),
}
LINKAGE_JOINTS = {
    "slew": ("continuous", "base", "cabin", (0, 0, 0.6), "0 0 0", "0 0 1", (0, 0, 0.8), ""),
    "boom": ("revolute", "cabin", "boom", (0.3, 0, 0.5), "0 0 0", "0 -1 0", (-0.6, 1.2, 0.6), ""),
    "rod": (
        *("revolute", "cabin", "rod", (0.3, 0.0, 0.7), "0 0 0", "0 -1 0", (-0.7, 1.3, 0.6)),
        '<mimic joint="boom"/>',
    ),
    "extend": ("prismatic", "boom", "stage", (1, 0, 0), "0 0 0", "1 0 0", (0.0, 0.9, 0.5), ""),
    "a_extend": (
        *("prismatic", "stage", "tip", (0.9, 0.0, 0.0), "0 0 0", "1 0 0", (0.0, 0.8, 0.6)),
        '<mimic joint="extend" multiplier="0.8" offset="0.05"/>',
    ),
    "head": (
        *("revolute", "tip", "head", (0.8, 0.0, 0.0), "0 0 0", "0 -1 0", (-1.5, 1.5, 0.7)),
        '<mimic joint="rod" multiplier="-1"/>',
    ),
    "weight": (
        *("revolute", "base", "weight", (-0.6, 0.0, 0.6), "0 0 0", "0 1 0", (-1.0, 1.0, 0.5)),
        '<mimic joint="boom" multiplier="0.5" offset="-0.1"/>',
    ),
    "drum": (
        *("continuous", "base", "drum", (0.7, 0.2, 0.6), "0 0 0", "0 0 1", (0, 0, 9.0)),
        '<mimic joint="slew" multiplier="-3" offset="0.4"/>',
    ),
}
LINKAGE_COUPLING = {
    "rod": ("boom", 1.0, 0.0),
    "a_extend": ("extend", 0.8, 0.05),
    "head": ("boom", -1.0, 0.0),
    "weight": ("boom", 0.5, -0.1),
    "drum": ("slew", -3.0, 0.4),
}
MACHINES = {
    "gripper": (GRIPPER_LINKS, GRIPPER_JOINTS, GRIPPER_COUPLING, "arm"),
    "linkage": (LINKAGE_LINKS, LINKAGE_JOINTS, LINKAGE_COUPLING, "head"),
}


def urdf(name: str, *, mimic: bool = True) -> str:
    """URDF of a machine, with its mimic joints or with all of its joints on their own."""
    links, joints, _, _ = MACHINES[name]
    parts = [f'<robot name="{name}">']
    for link, (mass, com, edges) in links.items():
        squares = np.square(edges)
        xx, yy, zz = (mass / 12.0 * (squares.sum() - square) for square in squares)
        shape = ""
        if link == "base":
            shape = (
                '<collision><origin xyz="0 0 0.1"/><geometry>'
                f'<box size="{edges[0]} {edges[1]} 0.2"/></geometry></collision>'
            )
        parts.append(
            f'<link name="{link}"><inertial><origin xyz="{_spell(com)}" rpy="0.1 0 0.2"/>'
            f'<mass value="{mass}"/><inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" '
            f'iyz="0"/></inertial>{shape}</link>'
        )
    for joint, (kind, parent, child, at, turn, axis, limit, follows) in joints.items():
        lower, upper, velocity = limit
        ends = "" if kind == "continuous" else f'lower="{lower}" upper="{upper}" '
        parts.append(
            f'<joint name="{joint}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{_spell(at)}" rpy="{turn}"/><axis xyz="{axis}"/>'
            f'<limit {ends}velocity="{velocity}" effort="5000"/>{follows if mimic else ""}</joint>'
        )
    return "\n".join([*parts, "</robot>"])


def _spell(numbers: tuple[float, ...]) -> str:
    return " ".join(map(str, numbers))


@dataclass(frozen=True)
class Coupled:
    """A machine with mimics and one without, whose coordinates are q = G y + g_0.

    Attributes:
        machine: Machine with mimic joints.
        free: The same machine with all joints planned.
        G: Shape (m, n), rows in the order of `free.joint_names`.
        offset: g_0, shape (m,).
    """

    machine: zs.Machine
    free: zs.Machine
    G: Array
    offset: Array

    def states(self, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        """States of `free`, shape (K, m) each."""
        return q @ self.G.T + self.offset, v @ self.G.T, a @ self.G.T

    def loaded(self, payload: zs.Payload) -> Coupled:
        both = self.machine.with_payload(payload), self.free.with_payload(payload)
        return Coupled(*both, self.G, self.offset)


@cache
def coupled(name: str) -> Coupled:
    """A machine of `MACHINES` with its double."""
    *_, coupling, _ = MACHINES[name]
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.urdf"
        both = []
        for mimic in (True, False):
            path.write_text(urdf(name, mimic=mimic))
            both.append(zs.load_machine(path, limits={"acceleration": 1.5}))
    machine, free = both
    G, offset = np.zeros((free.size, machine.size)), np.zeros(free.size)
    for row, joint in enumerate(free.joint_names):
        leader, factor, shift = coupling.get(joint, (joint, 1.0, 0.0))
        G[row, machine.joint_names.index(leader)], offset[row] = factor, shift
    return Coupled(machine, free, G, offset)
