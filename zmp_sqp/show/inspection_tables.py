"""Tables and machine-readable results of an inspected machine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics import Ground
from zmp_sqp.mechanics.inspection import Inspection, PoseReport
from zmp_sqp.mechanics.link_tree import Link
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.summary import aligned
from zmp_sqp.mechanics.tipping_load import TippingLoad
from zmp_sqp.show.tables import new_table
from zmp_sqp.versions import installed_versions

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

__all__ = [
    "INSPECTION_KEYS",
    "edge_table",
    "held_joints",
    "inspection_fields",
    "missing_lines",
    "pose_table",
    "tree_lines",
]

INSPECTION_KEYS = """\
--json writes one object; SI units, root frame (x forward, y left, z up), null where there is no
value:
  machine, file    name of the robot, path of the URDF
  mass             [kg] in all
  links            from the root outwards: name, mass [kg], depth, parent, joint, motion (root,
                   payload, fixed, turns or slides), planned, mimics (planned joint that the
                   joint follows, or empty)
  joints           planned joints by name: unit, position_lower, position_upper, velocity,
                   acceleration, effort (null: missing, or no limit for positions; see missing)
  held             value of each joint that is held [rad or m]
  missing          limits that planning needs and that nothing gives: names of joints by limit
  support          vertices [m], height [m], edges (names), source; null if there is none
  tip, tip_offset  frame at which the tipping load hangs, and its position in it [m]
  slew             joint that turns about the vertical; empty if there is none
  poses            by name: q [rad or m], com [m], zmp [m], margin [m], edge; tipping and worst
                   (while the slew joint turns): mass [kg] (null: no load tips it over), edge,
                   coordinate of the slew joint [rad]
  warnings         what was conspicuous while the machine was loaded
  versions         of zmp-sqp, Python and the packages that the result depends on
"""
LIMITS = ("position_lower", "position_upper", "velocity", "acceleration", "effort")
MOST_EDGES = 12  # that are listed one by one
INDENT = "  "
LEVEL = 1e-3  # [deg] slope up to which ground counts as level


def tree_lines(found: Inspection) -> list[str]:
    """Links from the root outwards, one per line: mass, and the joint on which each hangs."""
    held = held_joints(found.machine)
    rows = [("link", "mass [kg]", "hangs on joint")]
    for link in found.links:
        motion = _motion(link, held, found.machine.mimics)
        joint = f"{link.joint} ({motion})" if link.joint else motion
        rows.append((INDENT * link.depth + link.name, _mass(link.mass), joint))
    return aligned(rows, left=(0, 2))


def missing_lines(found: Inspection) -> list[str]:
    """One line for each kind of limit that planning needs and that some joints lack."""
    everyone = found.machine.joint_names
    return [
        f"missing: {limit.replace('_', ' ')} limit of "
        + (
            f"all {len(everyone)} planned joints"
            if len(names) == len(everyone) > 1
            else ", ".join(names)
        )
        for limit, names in found.missing.items()
    ]


def edge_table(found: Inspection) -> Table | None:
    """Edges of the support polygon with their ends; None without polygon or with many edges."""
    support = found.machine.support
    if support is None or len(support.vertices) > MOST_EDGES:
        return None
    table = new_table("edge of the support polygon", "from (x, y) [m]", "to [m]", "length [m]")
    ends = np.roll(support.vertices, -1, axis=0)
    for i, (begin, end) in enumerate(zip(support.vertices, ends, strict=True)):
        length = f"{np.linalg.norm(end - begin):.3f}"
        table.add_row(support.edge_name(i), _point(begin), _point(end), length)
    return table


def pose_table(found: Inspection) -> Table:
    """How the machine stands in each pose: centre of mass, margin and tipping load."""
    if found.machine.support is None:
        table = new_table("pose", "centre of mass (x, y, z) [m]", "ZMP (x, y) [m]")
        for pose in found.poses:
            table.add_row(pose.name, _point(pose.com), _point(pose.zmp))
        return table
    heads = [
        "pose",
        "centre of\nmass (x, y,\nz) [m]",
        "ZMP to\nnearest\nedge [m]",
        "tipping\nload [kg]",
    ]
    if found.slew:
        heads.append("its least\nin a turn\n[kg]")
    table = new_table(*heads)
    table.caption = (
        f"at rest on {_ground(found.ground)}; tipping load: largest point mass at {found.tip} "
        "before the machine tips over"
    )
    if found.slew:
        table.caption += f"; a turn is of {found.slew}"
    for pose in found.poses:
        cells = [_point(pose.com, digits=2), _margin(pose), _load(found, pose.tipping)]
        if found.slew:
            cells.append(_load(found, pose.worst))
        table.add_row(pose.name, *cells)
    return table


def held_joints(machine: Machine) -> dict[str, float]:
    """Coordinate of each joint that is held and not planned [rad or m]."""
    return {name: float(value) for name, value in machine.held.items()}


def inspection_fields(found: Inspection) -> dict[str, Any]:
    """Results ready for JSON; `INSPECTION_KEYS` explains them."""
    machine, support = found.machine, found.machine.support
    columns = {key: _numbers(getattr(machine.limits, key)) for key in LIMITS}
    return {
        "machine": machine.name,
        "mass": machine.mass,
        "links": [
            {
                "name": link.name,
                "mass": link.mass,
                "depth": link.depth,
                "parent": link.parent,
                "joint": link.joint,
                "motion": link.motion,
                "planned": link.planned,
                "mimics": machine.mimics.get(link.joint, ("",))[0],
            }
            for link in found.links
        ],
        "joints": {
            name: {"unit": unit, **{key: columns[key][i] for key in LIMITS}}
            for i, (name, unit) in enumerate(
                zip(machine.joint_names, machine.joint_units, strict=True)
            )
        },
        "held": held_joints(machine),
        "missing": {key: list(names) for key, names in found.missing.items()},
        "support": None
        if support is None
        else {
            "vertices": support.vertices.tolist(),
            "height": support.height,
            "edges": [support.edge_name(i) for i in range(len(support.vertices))],
        },
        "tip": found.tip,
        "tip_offset": found.tip_offset.tolist(),
        "slew": found.slew,
        "poses": {pose.name: _pose_fields(found, pose) for pose in found.poses},
        "versions": installed_versions(),
    }


def _pose_fields(found: Inspection, pose: PoseReport) -> dict[str, Any]:
    return {
        "q": pose.q.tolist(),
        "com": pose.com.tolist(),
        "zmp": _numbers(pose.zmp),
        "margin": _number(pose.margin),
        "edge": pose.edge,
        "tip": pose.tip.tolist(),
        "tipping": _load_fields(found, pose.tipping),
        "worst": _load_fields(found, pose.worst),
    }


def _load_fields(found: Inspection, load: TippingLoad | None) -> dict[str, Any] | None:
    support = found.machine.support
    if load is None or support is None:
        return None
    edge = support.edge_name(load.edge) if load.edge >= 0 else ""
    return {"mass": _number(load.mass), "edge": edge, "coordinate": _number(load.coordinate)}


def _ground(ground: Ground) -> str:
    """The ground in words; gravity tells its slope."""
    x, y, z = ground.gravity() / np.linalg.norm(ground.gravity())
    tilt = np.degrees(np.arccos(np.clip(-z, -1.0, 1.0)))
    if tilt < LEVEL:
        return "level ground"
    return f"a slope of {tilt:.3g} degrees, downhill towards {_direction(x, y)}"


def _direction(x: float, y: float) -> str:
    """Direction in the root's x-y plane in words."""
    names = ["the front", "front left", "the left", "rear left"]
    names += ["the rear", "rear right", "the right", "front right"]
    return names[int(np.round(np.degrees(np.arctan2(y, x)) / 45.0)) % 8]


def _motion(link: Link, held: dict[str, float], mimics: Mapping[str, Any]) -> str:
    if link.joint in held:
        return f"{link.motion}, held at {held[link.joint]:.4g}"
    if link.motion in ("root", "payload", "fixed"):
        return "" if link.motion == "root" else link.motion
    if link.joint in mimics:
        leader, multiplier, offset = mimics[link.joint]
        shift = f" {'-+'[offset > 0.0]} {abs(offset):.4g}" if offset else ""
        return f"{link.motion}, {multiplier:.4g} x {leader}{shift}"
    return f"{link.motion}, planned" if link.planned else link.motion


def _margin(pose: PoseReport) -> str | Text:
    from rich.text import Text

    if not np.isfinite(pose.margin):
        return "-"
    stands = pose.margin > 0.0
    text = f"{pose.margin + 0.0:.3f}\n({pose.edge})"
    return Text(text if stands else f"{text}\ntips over", style="" if stands else "bold red")


def _load(found: Inspection, load: TippingLoad | None) -> str:
    support = found.machine.support
    if load is None or support is None:
        return "-"
    if not np.isfinite(load.mass):
        return "any"
    turn = f"\nat {np.degrees(load.coordinate):.0f} deg" if np.isfinite(load.coordinate) else ""
    return f"{_mass(load.mass)}\n({support.edge_name(load.edge)}){turn}"


def _mass(mass: float) -> str:
    return f"{mass:.4g}" if mass < 1000.0 else f"{mass:.0f}"


def _point(point: Array, *, digits: int = 3) -> str:
    # adding 0.0 turns -0.0 into 0.0
    return f"({', '.join(f'{value:.{digits}f}' for value in np.round(point, digits) + 0.0)})"


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _numbers(values: Array) -> list[float | None]:
    return [_number(float(value)) for value in values]
