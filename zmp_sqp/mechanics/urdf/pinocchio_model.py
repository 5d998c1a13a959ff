"""Builds the Pinocchio model of a URDF."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import IO, Any

import numpy as np
import pinocchio as pin

from zmp_sqp.errors import MachineError
from zmp_sqp.locks import ForkSafeLock
from zmp_sqp.mechanics.inertia import spatial_inertia
from zmp_sqp.mechanics.urdf.description import UrdfDescription

__all__ = ["build_model"]

STDERR = 2  # file descriptor of the standard error stream
# what its parser of URDFs writes there: the complaint, and a line of its source
COMPLAINT = re.compile(rb"^(?:Error|Warning): +(.*)\n +at line \d+ in .*\n?", re.MULTILINE)
_stderr_lock = ForkSafeLock()  # held while the standard error stream is redirected


def build_model(description: UrdfDescription, held: Mapping[str, float]) -> Any:
    """Pinocchio model on a free-flyer root, without gravity; every link's frame has its inertia.

    Args:
        description: Content of the URDF.
        held: Coordinates of joints that do not move, by name [rad or m]; in the model they are
            fixed. Planar and floating joints are held at zero, whatever is given.

    Raises:
        MachineError: Pinocchio refuses the URDF; the message has the cause.
    """
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
        written = log.read()
    if others := COMPLAINT.sub(b"", written):  # what other threads have written meanwhile
        os.write(STDERR, others)
    if fault is not None:
        causes = [found[1].decode(errors="replace") for found in COMPLAINT.finditer(written)]
        raise MachineError(f"Pinocchio cannot read this URDF: {'; '.join(causes) or fault}")
    if held:
        model = _reduced(model, held)
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


def _reduced(model: Any, held: Mapping[str, float]) -> Any:
    """Model in which some joints are fixed at given coordinates; changes the given model."""
    q = pin.neutral(model)
    joints = [model.getJointId(name) for name in held]
    for joint, value in zip(joints, held.values(), strict=True):
        at = model.joints[joint].idx_q
        if model.joints[joint].nq == 1:
            q[at] = value
        elif model.joints[joint].nv == 1:  # continuous: cosine and sine
            q[at], q[at + 1] = np.cos(value), np.sin(value)
    # Pinocchio looks frames up by name alone, but a link and its joint may share a name
    mark = "link "
    while any(name.startswith(mark) for name in (frame.name for frame in model.frames)):
        mark += "_"
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            frame.name = mark + frame.name
    reduced = pin.buildReducedModel(model, joints, q)
    # it leaves the parents of frames at their indices in the other model
    index = {frame.name: i for i, frame in enumerate(reduced.frames)}
    above = {frame.name: model.frames[frame.parentFrame].name for frame in model.frames}
    for frame in reduced.frames:
        frame.parentFrame = index[above[frame.name]]
    for frame in reduced.frames:
        frame.name = frame.name.removeprefix(mark)
    return reduced


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
