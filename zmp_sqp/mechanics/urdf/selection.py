"""Which joints of a URDF are planned, and where the others are held."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import distinct_texts, finite_number, shortened
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.urdf.elements import MOVABLE, UNPLANNED, Joint
from zmp_sqp.mechanics.urdf.mimics import Mimics
from zmp_sqp.mechanics.urdf.srdf import Srdf

__all__ = ["Selection", "select"]

# names of poses that tell where joints are held, in this order, where several poses name a joint
REST_POSES = ("home", "default")
TOLERANCE = 1e-6  # [rad or m] distance outside a limit that counts as rounding of a file


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """Joints that move, and where the others are held.

    Attributes:
        moving: Joints that are planned or mimic a planned one, in the order of the file.
        held: Coordinates of all other movable joints, by name [rad or m]. Those of a planar or
            floating joint are zero.
    """

    moving: tuple[Joint, ...]
    held: Mapping[str, float]


def select(
    joints: Sequence[Joint],
    *,
    asked: Any = None,
    group: Any = None,
    hold: Any = None,
    srdf: Srdf | None = None,
) -> Selection:
    """Choose the joints that are planned.

    Joints that mimic another move, or are held, with it.

    Args:
        joints: All joints of the URDF.
        asked: Names of the joints to plan; None for all, or those of the group.
        group: Name of a group of the SRDF to plan.
        hold: Coordinates of joints to hold, by name; None for none in particular.
        srdf: Groups and poses.

    Raises:
        MachineError: Names that are not there or contradict each other, a coordinate outside its
            joint's limits, or a planar or floating joint to be planned; the message names it.
    """
    by_name = {joint.name: joint for joint in joints}
    mimics = Mimics.of([joint for joint in joints if joint.kind in MOVABLE])
    values = _coordinates(hold, by_name, mimics)
    planned = _planned(by_name, mimics, asked, group, srdf)
    if planned is None:
        planned = {
            name for name in by_name if name not in values and by_name[name].kind != "fixed"
        } - mimics.follows.keys()
    for name in values:
        if name in planned:
            raise MachineError(
                f"joint {name!r} is to be planned and to be held: it can only be one"
            )
    for name in planned:
        if by_name[name].kind in UNPLANNED:
            raise MachineError(
                f"joint {name!r} has type {by_name[name].kind!r}; planned can be "
                f"{', '.join(MOVABLE)}. Hold it where it is with hold={{{name!r}: 0.0}}, or change "
                "its type to fixed"
            )
    poses = {} if srdf is None else srdf.poses
    held = {}
    for name, joint in by_name.items():
        if joint.kind == "fixed" or name in planned or name in mimics.follows:
            continue
        held[name] = values[name] if name in values else _resting(joint, poses)
    for name, mimic in mimics.follows.items():
        if mimic.joint in held:
            held[name] = mimic.multiplier * held[mimic.joint] + mimic.offset
    moving = tuple(joint for joint in joints if joint.kind in MOVABLE and joint.name not in held)
    return Selection(moving, {name: held[name] for name in by_name if name in held})


def _planned(
    by_name: Mapping[str, Joint], mimics: Mimics, asked: Any, group: Any, srdf: Srdf | None
) -> set[str] | None:
    """Names of the joints that are to be planned, without mimics; None for all."""
    if asked is not None and group is not None:
        raise MachineError("joints and group exclude each other: give one of them")
    if asked is not None:
        return _named(asked, by_name, mimics)
    if group is None:
        return None
    if not isinstance(group, str):
        raise MachineError(f"group must be the name of a group of the SRDF, not {shortened(group)}")
    if srdf is None:
        raise MachineError(f"group {group!r} needs an SRDF: give its path, srdf=")
    found = {
        name
        for name in srdf.joints_of(group, list(by_name.values())) - srdf.passive
        if by_name[name].kind != "fixed" and name not in mimics.follows
    }
    if not found:
        raise MachineError(f"group {group!r} has no joint that can be planned")
    return found


def _named(asked: Any, by_name: Mapping[str, Joint], mimics: Mimics) -> set[str]:
    """Names of the joints that the user wants to be planned."""
    names = [asked] if isinstance(asked, str) else asked
    if not isinstance(names, Collection) or not all(isinstance(name, str) for name in names):
        raise MachineError(f"joints must be names of joints, not {shortened(asked)}")
    if not names:
        raise MachineError("joints names no joint: there is nothing to plan")
    for name in names:
        _check_name(name, by_name, "joints: ")
        if by_name[name].kind == "fixed":
            raise MachineError(f"joints: joint {name!r} is fixed")
    for name in names:
        leader = mimics.follows[name].joint if name in mimics.follows else name
        if leader not in names:
            raise MachineError(
                f"joints: joint {name!r} mimics {leader!r}, which is held: "
                f"plan {leader!r}, and {name!r} moves with it"
            )
    return {name for name in names if name not in mimics.follows}


def _coordinates(hold: Any, by_name: Mapping[str, Joint], mimics: Mimics) -> dict[str, float]:
    """Coordinates that the user gives for joints that are held, checked."""
    if hold is None:
        return {}
    if not isinstance(hold, Mapping):
        raise MachineError(f"hold must be a mapping such as {{'mast': 0.0}}, not {shortened(hold)}")
    found = {}
    for name, given in hold.items():
        _check_name(name, by_name, "hold: ")
        joint = by_name[name]
        value = finite_number(given, name=f"hold: joint {name!r}", error=MachineError)
        if name in mimics.follows:
            raise MachineError(
                f"hold: joint {name!r} mimics {mimics.follows[name].joint!r}: hold that one"
            )
        if joint.kind == "fixed":
            raise MachineError(f"hold: joint {name!r} is fixed")
        if joint.kind in UNPLANNED and value != 0.0:
            raise MachineError(
                f"hold: joint {name!r} has type {joint.kind!r} and can only be held at 0.0, "
                f"not at {value:g}"
            )
        if value < joint.lower - TOLERANCE or value > joint.upper + TOLERANCE:
            shown, lower, upper = distinct_texts(value, joint.lower, joint.upper)
            raise MachineError(
                f"hold: joint {name!r} is to be held at {shown}, outside its limits "
                f"[{lower}, {upper}]"
            )
        found[name] = value
    return found


def _check_name(name: Any, by_name: Mapping[str, Joint], where: str) -> None:
    """Raise MachineError if there is no joint of this name."""
    if name not in by_name:
        movable = ", ".join(one.name for one in by_name.values() if one.kind != "fixed")
        raise MachineError(
            f"{where}there is no joint {shortened(name)}; joints are {movable or 'all fixed'}"
        )


def _resting(joint: Joint, poses: Mapping[str, Mapping[str, float]]) -> float:
    """Coordinate at which a joint is held if the user gives none [rad or m].

    It is that of the first of the `REST_POSES` that names the joint, else that of all poses that
    name it if they agree, else zero; within the limits of the joint.
    """
    if joint.kind in UNPLANNED:
        return 0.0
    named = [poses[name][joint.name] for name in REST_POSES if joint.name in poses.get(name, {})]
    others = {pose[joint.name] for pose in poses.values() if joint.name in pose}
    value = named[0] if named else others.pop() if len(others) == 1 else 0.0
    return float(np.fmin(np.fmax(value, joint.lower), joint.upper))  # NaN is no limit
