"""Machines whose load charts are known by hand, as URDF text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import zmp_sqp as zs

HALF = 2.0  # [m] half side of the square support of every machine here
SQUARE = zs.SupportPolygon([(-HALF, -HALF), (HALF, -HALF), (HALF, HALF), (-HALF, HALF)])
BASE, BALLAST, TROLLEY, HOOK = 5000.0, 500.0, 200.0, 100.0  # [kg]
BALLAST_AT, JIB = 3.0, 10.0  # [m] behind the slew axis; height of the jib
HOIST = 30e3  # [N] effort limit of the hoist
SLEW_DRIVE, TROLLEY_DRIVE = 1e6, 1e6


def body(name: str, mass: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> str:
    x, y, z = at
    return f"""<link name="{name}"><inertial><origin xyz="{x} {y} {z}"/><mass value="{mass}"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def joint(
    name: str,
    *,
    kind: str,
    parent: str,
    axis: str,
    limits: tuple[float, float],
    at: str = "0 0 0",
    effort: float = 1e9,
) -> str:
    """Joint that moves the link of its name."""
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}"/>
    <origin xyz="{at}"/><axis xyz="{axis}"/>
    <limit lower="{limits[0]}" upper="{limits[1]}" effort="{effort}" velocity="1"/></joint>"""


def load(folder: Path, name: str, parts: list[str], **options: Any) -> zs.Machine:
    path = folder / f"{name}.urdf"
    path.write_text(f'<robot name="{name}">{"".join(parts)}</robot>', encoding="utf-8")
    return zs.load_machine(path, **{"support": SQUARE, "limits": {"acceleration": 1.0}} | options)


def tower_crane(folder: Path, *, slew: tuple[float, float] = (-7.0, 7.0)) -> zs.Machine:
    """Ballast behind, a trolley at 1 to 8 m on a level jib, a hook that hoists from 0 to 9 m.

    Everything is a point mass in the plane of the jib, the base at the ground.
    """
    parts = [
        body("base", BASE),
        joint("slew", kind="revolute", parent="base", axis="0 0 1", limits=slew, effort=SLEW_DRIVE),
        body("slew", BALLAST, (-BALLAST_AT, 0.0, JIB)),
        joint(
            "trolley",
            kind="prismatic",
            parent="slew",
            axis="1 0 0",
            limits=(1.0, 8.0),
            at=f"0 0 {JIB}",
            effort=TROLLEY_DRIVE,
        ),
        body("trolley", TROLLEY),
        joint(
            "hook",
            kind="prismatic",
            parent="trolley",
            axis="0 0 1",
            limits=(-JIB, -1.0),
            effort=HOIST,
        ),
        body("hook", HOOK),
    ]
    return load(folder, "tower_crane", parts)


def telescopic_crane(folder: Path) -> zs.Machine:
    """Boom, stick and telescope: one joint more than radius and height need; torques limit."""
    parts = [
        body("base", 20000.0),
        joint("slew", kind="revolute", parent="base", axis="0 0 1", limits=(-4.0, 4.0)),
        body("slew", 500.0),
        joint(
            "boom",
            kind="revolute",
            parent="slew",
            axis="0 -1 0",
            limits=(-0.2, 1.4),
            at="0 0 2",
            effort=90e3,
        ),
        body("boom", 300.0, (1.5, 0.0, 0.0)),
        joint(
            "stick",
            kind="revolute",
            parent="boom",
            axis="0 -1 0",
            limits=(-2.6, -0.1),
            at="3 0 0",
            effort=50e3,
        ),
        body("stick", 200.0, (0.8, 0.0, 0.0)),
        joint(
            "extension",
            kind="prismatic",
            parent="stick",
            axis="1 0 0",
            limits=(1.6, 3.6),
            effort=20e3,
        ),
        body("extension", 80.0, (-0.8, 0.0, 0.0)),
    ]
    return load(folder, "telescopic_crane", parts)
