"""Tables of `zmp-sqp inspect` as HTML."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

from zmp_sqp.arrays import length_text
from zmp_sqp.mechanics.inspection import Inspection
from zmp_sqp.mechanics.summary import mass_text, support_text
from zmp_sqp.report.verdict import table
from zmp_sqp.show.inspection_tables import held_joints, inspection_fields, missing_lines

__all__ = ["inspection_html"]

LINK_HEADS = ("link", "mass", "hangs on joint", "motion")
JOINT_HEADS = ("joint", "unit", "from", "to", "rate", "acceleration", "effort")
POSE_HEADS = ("pose", "centre of mass (x, y, z) [m]", "ZMP to nearest edge", "tipping load")
LIMITS = ("position_lower", "position_upper", "velocity", "acceleration", "effort")
DEPTH = "\u00a0\u00a0"  # indent of a link per level; spaces would be merged


def inspection_html(found: Inspection, warnings: Sequence[str]) -> str:
    """Everything that was understood of a machine: tables of links, joints, polygon and poses.

    Args:
        found: The machine.
        warnings: What was conspicuous while it was loaded.
    """
    fields = inspection_fields(found)
    complaints = [*missing_lines(found), *(f"warning: {text}" for text in warnings)]
    parts = [
        f"<p>{escape(found.machine.name)}: {mass_text(found.machine.mass)}</p>",
        "".join(f'<p class="broken">{escape(line)}</p>' for line in complaints),
        "<h4>Poses at rest</h4>",
        table(POSE_HEADS, _poses(fields)),
        "<h4>Joints</h4>",
        table(JOINT_HEADS, _joints(fields)),
        "<h4>Links</h4>",
        table(LINK_HEADS, _links(found, fields)),
        "<h4>Support polygon</h4>",
        f"<p>{escape(_support(found))}</p>",
    ]
    return "".join(parts)


def _poses(fields: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    for name, pose in fields["poses"].items():
        com = ", ".join(f"{round(value, 2) + 0.0:.2f}" for value in pose["com"])
        margin = pose["margin"]
        stands = "-" if margin is None else f"{length_text(margin)} ({escape(pose['edge'])})"
        if margin is not None and margin < 0.0:
            stands = f'<span class="broken">{stands} &#10007; tips over</span>'
        load = pose["tipping"]
        mass = "-" if load is None else "any" if load["mass"] is None else mass_text(load["mass"])
        yield escape(name), com, stands, mass


def _joints(fields: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Limits of the joints; what planning lacks is marked."""
    missing = fields["missing"]
    for name, joint in fields["joints"].items():
        cells = []
        for key in LIMITS:
            lacks = name in missing.get(key, ())
            none = '<span class="broken">missing</span>' if lacks else "none"
            cells.append(none if joint[key] is None else f"{joint[key]:.4g}")
        yield escape(name), joint["unit"], *cells


def _links(found: Inspection, fields: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    held = held_joints(found.machine)
    for link in fields["links"]:
        name = DEPTH * link["depth"] + escape(link["name"])
        motion = link["motion"] if link["motion"] != "root" else ""
        if link["joint"] in held:
            motion += f", held at {held[link['joint']]:.4g}"
        elif link["mimics"]:
            motion += f", follows {link['mimics']}"
        elif link["planned"]:
            motion += ", planned"
        yield name, mass_text(link["mass"]), escape(link["joint"]), escape(motion)


def _support(found: Inspection) -> str:
    hint = found.machine.support_hint
    words = support_text(found.machine.support)
    return f"{words} {hint}" if found.machine.support is None and hint else words
