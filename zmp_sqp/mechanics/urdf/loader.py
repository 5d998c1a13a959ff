"""Loads a machine from a URDF file, with its joint limits and its support polygon."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import shortened
from zmp_sqp.errors import MachineError, warn_of_machine
from zmp_sqp.mechanics.likely_units import doubtful_limits, doubtful_support, machine_size
from zmp_sqp.mechanics.limits import JointLimits, without_unplanned
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.mechanics.urdf.description import UrdfDescription, read_description
from zmp_sqp.mechanics.urdf.footprint import Footprint, footprint, footprint_of_links
from zmp_sqp.mechanics.urdf.limits_yaml import read_joint_limits
from zmp_sqp.mechanics.urdf.meshes import MeshFolders
from zmp_sqp.mechanics.urdf.mimics import Mimics
from zmp_sqp.mechanics.urdf.pinocchio_model import build_model
from zmp_sqp.mechanics.urdf.plausibility import massless_chains, unphysical_inertias
from zmp_sqp.mechanics.urdf.selection import select
from zmp_sqp.mechanics.urdf.sources import find_machine, package_folders, shipped_machines
from zmp_sqp.mechanics.urdf.srdf import Srdf, read_srdf
from zmp_sqp.mechanics.urdf.xacro_files import expanded

__all__ = ["load_machine", "shipped_machines"]

LOWER = 0.05  # [m] depth below the support polygon from which a moving link is worth a word


def load_machine(
    source: str | os.PathLike[str],
    *,
    support: SupportPolygon | str | Sequence[str] | None = None,
    limits: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    joints: Sequence[str] | None = None,
    group: str | None = None,
    hold: Mapping[str, float] | None = None,
    srdf: str | os.PathLike[str] | None = None,
    package_dirs: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | None = None,
    strict: bool = False,
) -> Machine:
    """Load a machine from a URDF or xacro file.

    The planned joints are all revolute, continuous and prismatic joints, in the order of the file,
    but those that <mimic> another one: these move with it. `joints`, `group` or `hold` choose among
    them; the others are held where they are, and their masses count.

    Joint limits come from the URDF, and from a joint_limits.yaml in the format of MoveIt where it
    has any: `<stem>.joint_limits.yaml` in the folder of the URDF or, if there is none,
    `joint_limits.yaml`. A limit that is given nowhere is NaN, which is no error here.

    The root link's axes are those of REP-103: x forward, y left, z up. Roll and pitch of a `Slope`,
    the heading of a base that drives and names of edges refer to them. A machine whose front is the
    y axis plans the same motions on the same slope, given about these axes, but its front edge is
    called 'left', and it cannot drive forwards. The root's origin may be anywhere.

    Args:
        source: Name of a shipped machine, or path of a file.
        support: Support polygon in the root frame; or names of the contact links, whose collision
            shapes' lowest points span it. None takes all links that no planned joint moves,
            and wheels; if these span no polygon, the machine has none, and planning says how to
            give one.
        limits: Path of a joint_limits.yaml to be read instead of the one in the folder of the URDF;
            or a mapping such as {"acceleration": 0.4} or {"velocity": {"slew": 0.8}} that replaces
            single limits of planned joints that come from these files.
        joints: Names of the joints to plan.
        group: Name of a group of the SRDF to plan, in place of `joints`.
        hold: Coordinates of joints to hold, by name [rad or m]. Other held joints stay where the
            SRDF's pose 'home' or 'default' has them, or all its poses that name them agree, else
            at zero, within their limits.
        srdf: Path of the SRDF; None takes `<stem>.srdf` in the folder of the URDF if it is there.
        package_dirs: Folders in which package:// and $(find ...) look for packages. Meshes and
            includes are opened there and in the folder of the URDF, nowhere else.
        strict: Whether to refuse inertias that no body can have, and mimics of no joint. Otherwise
            they are taken as they are, with a `MachineWarning`.

    Raises:
        MachineError: Invalid file, limits, joints or support; the message names the file, and the
            link, joint or key.
        MissingExtra: The file is in xacro, and the package for it is not installed.
    """
    path, folders = find_machine(source), package_folders(package_dirs)
    asked = {"asked": joints, "group": group, "hold": hold}
    return _load(path, folders, asked, support, limits, srdf, strict=strict)


def _load(
    path: Path,
    folders: Sequence[Path],
    asked: Mapping[str, Any],
    support: Any,
    limits: Any,
    srdf: Any,
    *,
    strict: bool,
) -> Machine:
    """Machine of a file; `asked` holds arguments of `select`, others are `load_machine`'s."""
    with _blame(path):
        description = read_description(expanded(_content(path), path, folders))
    poses = _srdf(srdf, path, description)
    with _blame(path):
        chosen = select(description.joints, srdf=poses, **asked)
        mimics = Mimics.of(chosen.moving)
        model = build_model(description, chosen.held)
        stand = _support(support, description, model, MeshFolders(path.parent, folders))
        _judge(description, mimics, path, strict=strict)
    unplanned = {joint.name for joint in description.joints} - set(mimics.joints)
    within, passed = _limits(limits, path, mimics, _urdf_limits(chosen.moving), unplanned)
    machine = Machine(
        name=description.name,
        model=model,
        joint_names=mimics.leaders,
        limits=within,
        support=stand.polygon,
        coupling=mimics.coupling(model),
        held=chosen.held,
        poses={} if poses is None else poses.poses,
        support_hint=stand.hint,
        wheels=stand.wheels,
    )
    doubts = (
        stand.said,
        passed,
        _lower_links(machine) if support is None else "",
        doubtful_support(machine.support, machine_size(machine.model)),
        doubtful_limits(machine.joint_names, machine.joint_units, machine.limits, machine.mass),
    )
    for said in filter(None, doubts):
        warn_of_machine(f"{path}: {said}")
    return machine


def _lower_links(machine: Machine) -> str:
    """Sentence about moving links below the support polygon, on which the machine may stand."""
    if machine.support is None:
        return ""
    limits = machine.limits
    zero = np.fmin(np.fmax(0.0, limits.position_lower), limits.position_upper)  # NaN is no limit
    data = machine.model.createData()
    pin.framesForwardKinematics(machine.model, data, machine.configuration(zero[None])[0])
    heights = {
        frame.name: float(placement.translation[2])
        for frame, placement in zip(machine.model.frames, data.oMf, strict=True)
        if frame.type == pin.FrameType.BODY and frame.parentJoint > 1
    }
    lowest = min(heights, key=heights.__getitem__, default="")
    if not lowest or heights[lowest] >= machine.support.height - LOWER:
        return ""
    return (
        f"link {lowest!r} moves and is {machine.support.height - heights[lowest]:.2f} m below the "
        "support polygon where joints are at zero: if the machine stands on it, hold its joints"
    )


@contextmanager
def _blame(path: Path) -> Iterator[None]:
    """Begin messages of errors with the path of the URDF."""
    try:
        yield
    except MachineError as fault:
        raise MachineError(f"{path}: {fault}") from None


def _content(path: Path) -> bytes:
    """Content of a file."""
    try:
        return path.read_bytes()
    except OSError as cause:
        raise MachineError(f"it cannot be read: {cause.strerror or cause}") from None


def _srdf(given: Any, path: Path, description: UrdfDescription) -> Srdf | None:
    """SRDF from the `srdf` argument of `load_machine`, or from beside the URDF."""
    if given is None:
        beside = path.with_name(f"{path.stem}.srdf")
        if not beside.is_file():
            return None
        given = beside
    if not isinstance(given, str | os.PathLike):
        raise MachineError(f"srdf must be the path of an SRDF, not {shortened(given)}")
    found = read_srdf(Path(given))
    joints = {joint.name for joint in description.joints}
    with _blame(Path(given)):
        found.check(description.name, joints, description.shapes.keys())
    return found


def _judge(description: UrdfDescription, mimics: Mimics, path: Path, *, strict: bool) -> None:
    """Warn of what is hardly meant so; raise MachineError for it if strict.

    Masses that may be forgotten are never refused.
    """
    leaderless, impossible = mimics.remarks, unphysical_inertias(description.bodies)
    if strict and (leaderless or impossible):
        raise MachineError(leaderless or impossible)
    planned = set(mimics.leaders)
    light = massless_chains(description.bodies, description.joints, planned)
    for said in filter(None, (leaderless, impossible, light)):
        warn_of_machine(f"{path}: {said}")


def _support(
    support: Any, description: UrdfDescription, model: Any, meshes: MeshFolders
) -> Footprint:
    """Support polygon from the `support` argument of `load_machine`."""
    if support is None:
        return footprint(description, model, meshes)
    if isinstance(support, SupportPolygon):
        return Footprint(support)
    links = [support] if isinstance(support, str) else support
    if not isinstance(links, Sequence) or not all(isinstance(link, str) for link in links):
        raise MachineError(
            f"support must be a SupportPolygon or names of contact links, not {shortened(support)}"
        )
    return footprint_of_links(description, model, links, meshes)


def _urdf_limits(movable: Sequence[Any]) -> JointLimits:
    """Joint limits of the URDF's movable joints."""
    return JointLimits(
        position_lower=np.array([joint.lower for joint in movable]),
        position_upper=np.array([joint.upper for joint in movable]),
        velocity=np.array([joint.velocity for joint in movable]),
        acceleration=np.full(len(movable), np.nan),  # the URDF format has no acceleration limits
        effort=np.array([joint.effort for joint in movable]),
    )


def _limits(
    limits: Any, path: Path, mimics: Mimics, urdf: JointLimits, unplanned: Collection[str]
) -> tuple[JointLimits, str]:
    """Joint limits from the `limits` argument of `load_machine`, from YAML files and the URDF.

    Also a sentence about joints that mimic others and pass limits of their own; empty if none do.
    """
    is_file = isinstance(limits, str | os.PathLike)
    beside = (path.with_name(f"{path.stem}.joint_limits.yaml"), path.with_name("joint_limits.yaml"))
    found = next((candidate for candidate in beside if candidate.is_file()), None)
    source = Path(limits) if is_file else found
    known = urdf if source is None else read_joint_limits(source, urdf, mimics.joints, unplanned)
    with _blame(path):
        leading = mimics.leading(known)
    if limits is None or is_file:
        return leading, ""
    given = leading.updated(without_unplanned(limits, unplanned), mimics.leaders)
    return given, mimics.passed(known, given)
