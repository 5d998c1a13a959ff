"""Loads a machine from a URDF file, with its joint limits and its support polygon."""

from __future__ import annotations

import os
import sys
import tempfile
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import shortened
from zmp_sqp.errors import MachineError, MachineWarning
from zmp_sqp.mechanics.inertia import spatial_inertia
from zmp_sqp.mechanics.limits import JointLimits
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.mechanics.urdf.description import UrdfDescription, read_description
from zmp_sqp.mechanics.urdf.elements import MOVABLE
from zmp_sqp.mechanics.urdf.footprint import footprint, footprint_of_links
from zmp_sqp.mechanics.urdf.limits_yaml import read_joint_limits
from zmp_sqp.mechanics.urdf.mimics import Mimics
from zmp_sqp.mechanics.urdf.plausibility import massless_chains, unphysical_inertias

__all__ = ["load_machine", "shipped_machines"]

STDERR = 2  # file descriptor of the standard error stream
_stderr_lock = threading.Lock()  # held while the standard error stream is redirected


def load_machine(
    source: str | os.PathLike[str],
    *,
    support: SupportPolygon | str | Sequence[str] | None = None,
    limits: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    strict: bool = False,
) -> Machine:
    """Load a machine from a URDF file.

    The planned joints are all revolute, continuous and prismatic joints, in the order of the file,
    but those that <mimic> another one. These follow it with multiplier and offset, and limit its
    position, velocity and acceleration, and its effort where it has no limit of its own. A joint
    that mimics no joint of the file moves on its own, with a `MachineWarning`.

    The root link's axes are those of REP-103: x forward, y left, z up. Roll and pitch of a `Slope`,
    the heading of a base that drives and names of edges refer to them. A machine whose front is the
    y axis plans the same motions on the same slope, given about these axes, but its front edge is
    called 'left', and it cannot drive forwards. The root's origin may be anywhere.

    Joint limits come from the URDF. Limits from a joint_limits.yaml in the format of MoveIt replace
    them: by default from the file `<stem>.joint_limits.yaml` in the folder of the URDF or, if there
    is none, from `joint_limits.yaml` in that folder. A limit that is given nowhere is NaN, which is
    no error here.

    Args:
        source: Name of a shipped machine, or path of a URDF. Meshes are never opened.
        support: Support polygon in the root frame; or names of the contact links, whose collision
            shapes' lowest points span the polygon. None takes the lowest points of all links fixed
            to the root link; if these span no polygon, the machine has no support.
        limits: Path of a joint_limits.yaml to be read instead of the one in the folder of the URDF;
            or a mapping such as {"acceleration": 0.4} or {"velocity": {"slew": 0.8}} that replaces
            single limits of planned joints that come from these files.
        strict: Whether to refuse inertias that no body can have, and mimics of no joint.

    Links without mass or without <inertial> are taken as such. Inertias that no body can have are
    used as given, with a `MachineWarning` if that shifts the ZMP by more than rounding does.

    Raises:
        MachineError: Invalid file, limits or support; the message names the file, and the link,
            joint or key.
    """
    path = _locate(source)
    try:
        description = read_description(_content(path))
        model = _build(description)
        polygon = _support(support, description, model)
        movable = [joint for joint in description.joints if joint.kind in MOVABLE]
        mimics = Mimics.of(movable)
    except MachineError as fault:
        raise MachineError(f"{path}: {fault}") from None
    _judge(description, mimics, path, strict=strict)
    return Machine(
        name=description.name,
        model=model,
        joint_names=mimics.leaders,
        limits=_limits(limits, path, mimics, _urdf_limits(movable)),
        support=polygon,
        coupling=mimics.coupling(model),
    )


def shipped_machines() -> dict[str, Path]:
    """Machines that come with this library: path of the URDF by name of the machine."""
    package = Path(__file__).resolve().parents[2]
    folders = (package / "urdf", package.parent / "urdf")  # in a wheel; in a source checkout
    folder = next((folder for folder in folders if folder.is_dir()), folders[0])
    return {path.stem: path for path in sorted(folder.glob("*.urdf"))}


def _locate(source: str | os.PathLike[str]) -> Path:
    """Path of the URDF of a shipped machine or of a user's file."""
    if not isinstance(source, str | os.PathLike) or not os.fspath(source):
        raise MachineError(
            f"source must be the name of a machine or the path of a URDF, not {shortened(source)}"
        )
    shipped = shipped_machines()
    if isinstance(source, str) and source in shipped:
        return shipped[source]
    try:
        path = Path(source).expanduser()
        if path.is_file():
            return path
        if path.is_dir():
            raise MachineError(f"{path} is a folder, not a URDF")
    # a NUL byte, a name that is too long, no home folder, bytes instead of text
    except (ValueError, OSError, RuntimeError, TypeError) as cause:
        raise MachineError(f"{source!r} is not a path that can be read: {cause}") from None
    if isinstance(source, str) and path.name == source and not path.suffix:
        raise MachineError(
            f"there is no machine {source!r}; machines are {', '.join(shipped)}, "
            "or give the path of a URDF"
        )
    raise MachineError(f"there is no file {path}")


def _content(path: Path) -> bytes:
    """Content of a file."""
    try:
        return path.read_bytes()
    except OSError as cause:
        raise MachineError(f"it cannot be read: {cause.strerror or cause}") from None


def _judge(description: UrdfDescription, mimics: Mimics, path: Path, *, strict: bool) -> None:
    """Warn of what is hardly meant so; raise MachineError for it if strict.

    Masses that may be forgotten are never refused.
    """
    leaderless, impossible = mimics.remarks, unphysical_inertias(description.bodies)
    if strict and (leaderless or impossible):
        raise MachineError(f"{path}: {leaderless or impossible}")
    planned = set(mimics.leaders)
    light = massless_chains(description.bodies, description.joints, planned)
    for said in (leaderless, impossible, light):
        if said:
            warnings.warn(f"{path}: {said}", MachineWarning, stacklevel=3)


def _build(description: UrdfDescription) -> Any:
    """Pinocchio model on a free-flyer root, without gravity; every link's frame has its inertia."""
    taken = {joint.name for joint in description.joints}
    root = next(
        name for name in ("root_joint", "free_flyer", "free_flyer_root_joint") if name not in taken
    )
    # for an invalid URDF Pinocchio raises a ValueError without a cause, and writes the cause to the
    # standard error stream of C++
    with _captured_stderr() as log:
        try:
            model, fault = (
                pin.buildModelFromXML(description.xml, pin.JointModelFreeFlyer(), root),
                None,
            )
        except (ValueError, RuntimeError, IndexError) as cause:
            model, fault = None, cause
        log.seek(0)
        complaints = log.read().decode(errors="replace").splitlines()
    if fault is not None:
        causes = [
            line.removeprefix("Error:").strip()
            for line in complaints
            if not line.strip().startswith("at line")
        ]
        raise MachineError(
            f"Pinocchio cannot read this URDF: {'; '.join(filter(None, causes)) or fault}"
        )
    model.gravity = pin.Motion.Zero()
    # Pinocchio stores the inertia of some links in the frame of the fixed joint above them
    for frame in model.frames:
        body = description.bodies.get(frame.name) if frame.type == pin.FrameType.BODY else None
        frame.inertia = (
            pin.Inertia.Zero()
            if body is None
            else spatial_inertia(body.mass, body.com, body.inertia)
        )
    return model


@contextmanager
def _captured_stderr() -> Iterator[IO[bytes]]:
    """Redirect file descriptor 2, to which C++ writes its errors, into a temporary file."""
    with _stderr_lock, tempfile.TemporaryFile() as log:
        try:
            saved = os.dup(STDERR)
        except OSError:  # the descriptor is closed, so there is nothing to redirect
            yield log
            return
        try:
            if sys.stderr is not None:
                sys.stderr.flush()
            os.dup2(log.fileno(), STDERR)
            yield log
        finally:
            os.dup2(saved, STDERR)
            os.close(saved)


def _support(
    support: SupportPolygon | str | Sequence[str] | None, description: UrdfDescription, model: Any
) -> SupportPolygon | None:
    """Support polygon from the `support` argument of `load_machine`."""
    if support is None:
        return footprint(description, model)
    if isinstance(support, SupportPolygon):
        return support
    links = [support] if isinstance(support, str) else support
    if not isinstance(links, Sequence) or not all(isinstance(link, str) for link in links):
        raise MachineError(
            f"support must be a SupportPolygon or names of contact links, not {shortened(support)}"
        )
    return footprint_of_links(description, model, links)


def _urdf_limits(movable: Sequence[Any]) -> JointLimits:
    """Joint limits of the URDF's movable joints."""
    return JointLimits(
        position_lower=np.array([joint.lower for joint in movable]),
        position_upper=np.array([joint.upper for joint in movable]),
        velocity=np.array([joint.velocity for joint in movable]),
        acceleration=np.full(len(movable), np.nan),  # the URDF format has no acceleration limits
        effort=np.array([joint.effort for joint in movable]),
    )


def _limits(limits: Any, path: Path, mimics: Mimics, urdf: JointLimits) -> JointLimits:
    """Joint limits from the `limits` argument of `load_machine`, from YAML files and the URDF."""
    is_file = isinstance(limits, str | os.PathLike)
    beside = (path.with_name(f"{path.stem}.joint_limits.yaml"), path.with_name("joint_limits.yaml"))
    found = next((candidate for candidate in beside if candidate.is_file()), None)
    source = Path(limits) if is_file else found
    known = urdf if source is None else read_joint_limits(source, urdf, mimics.joints)
    try:
        leading = mimics.leading(known)
    except MachineError as fault:
        raise MachineError(f"{path}: {fault}") from None
    return leading if limits is None or is_file else leading.updated(limits, mimics.leaders)
