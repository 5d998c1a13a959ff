"""MuJoCo model of a machine: inertias, joints and support polygon of its Pinocchio model."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.ground import GRAVITY, Ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.simulation.engine import load_mujoco
from zmp_sqp.simulation.shapes import Solid

__all__ = ["contact_time", "foot_name", "multibody_spec"]

FOOT_RADIUS = 0.01  # [m] radius of the contact spheres
# [kg m^2 or kg] inertia of a joint's drive per kg of the machine: far above the machine's own
# inertia; values from 1e3 to 1e9 give the same motion
DRIVE_INERTIA = 1e5
# [m^2] moment of inertia added to a body per kg of its mass, because MuJoCo refuses point masses
LEAST_INERTIA = 1e-9
# mass of a body that has none, per kg of the machine: MuJoCo refuses massless bodies that move
LEAST_SHARE = 1e-9
LEAST_MOMENT = 1e-12  # [kg m^2] moment of inertia below which MuJoCo takes a body for massless
# time constant [s] and impedance of contacts on rigid ground, which yield by about a micrometre
RIGID = (0.01, 0.999)
# impedance of contacts on soft ground: at 0.5, MuJoCo's time constant is that of the contact's
# critically damped spring and damper
SOFT_IMPEDANCE = 0.5
FRICTION_RATIO = 10.0  # MuJoCo's impratio: stiffness of friction over that of the normal force
# MuJoCo's solver settings; a tolerance of 1e-6 changes lifts by 2 to 4 %, one of 1e-8 does not
SOLVER = {"tolerance": 1e-12, "iterations": 200}


def foot_name(corner: int) -> str:
    """Name of the contact sphere at a corner of the support polygon."""
    return f"foot {corner}"


def multibody_spec(
    machine: Machine,
    ground: Ground,
    *,
    time_step: float,
    friction: tuple[float, float],
    sinkage: float = 0.0,
    solids: Iterable[Solid] = (),
) -> Any:
    """MuJoCo description of a machine that stands freely on the ground.

    The world frame is the root frame of the machine at rest, so that the ground plane is level and
    gravity is tilted. The root has a free joint. A sphere touches the ground at each corner of the
    support polygon; nothing else has contacts.

    Each joint has a drive (MuJoCo's armature) whose inertia is far above the machine's. A drive
    force of this inertia times an acceleration therefore prescribes the joint's acceleration,
    whatever the rest of the machine does. The drive's inertia appears only in the equation of its
    own joint; the reaction on the root is that of the moving bodies alone.

    Args:
        machine: Machine with a support polygon.
        ground: Ground on which it stands; only its gravity is used.
        time_step: Time step of the simulation [s].
        friction: Friction coefficients of a foot against sliding [-] and against twisting [m].
        sinkage: Depth to which the ground yields under the machine at rest, as a spring and a
            damper below each foot [m]; 0 is as rigid as MuJoCo allows.
        solids: Solids to be drawn, without contacts.

    Returns:
        Description of the model, a `mujoco.MjSpec`.

    Raises:
        MissingExtra: MuJoCo is not installed.
        MachineError: The machine has no support polygon.
    """
    mujoco = load_mujoco()
    support = machine.support
    if support is None:
        raise MachineError(f"machine {machine.name!r} has no support polygon to stand on")
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep, spec.option.gravity = time_step, ground.gravity()
    spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, FRICTION_RATIO
    for key, value in SOLVER.items():
        setattr(spec.option, key, value)
    contact = _contact(friction, sinkage)
    _add_ground(spec, support, contact)
    bodies = _add_bodies(spec, machine)
    _add_feet(bodies[1], support, contact)
    for solid in solids:
        kind = getattr(mujoco.mjtGeom, f"mjGEOM_{solid.kind.upper()}")
        look = {"type": kind, "size": solid.size, "rgba": solid.colour}
        bodies[solid.joint].add_geom(contype=0, conaffinity=0, **look, **_pose(solid.placement))
    return spec


def _contact(friction: tuple[float, float], sinkage: float) -> dict[str, Any]:
    """Contact parameters that ground and feet share; see `multibody_spec` for the arguments."""
    time, impedance = (contact_time(sinkage), SOFT_IMPEDANCE) if sinkage > 0.0 else RIGID
    return {
        "condim": 4,  # forces: normal, two of sliding friction, torque against twisting
        "friction": [*friction, 0.0],
        "solref": [time, 1.0],
        "solimp": [impedance, impedance, 0.001, 0.5, 2.0],
    }


def _add_ground(spec: Any, support: SupportPolygon, contact: dict[str, Any]) -> None:
    """Add the plane on which the feet stand; it is not drawn."""
    spec.worldbody.add_geom(
        name="ground",
        type=load_mujoco().mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 1.0],
        pos=[0.0, 0.0, support.height],
        rgba=[0.0] * 4,
        contype=1,
        conaffinity=2,
        **contact,
    )


def _add_bodies(spec: Any, machine: Machine) -> list[Any]:
    """Add the machine's bodies and joints; returns MuJoCo's body of each Pinocchio joint."""
    mujoco, model = load_mujoco(), machine.model
    bodies = [spec.worldbody]
    for joint in range(1, model.njoints):
        placement = model.jointPlacements[joint]
        body = bodies[model.parents[joint]].add_body(name=f"body {joint}", **_pose(placement))
        bodies.append(body)
        _set_inertia(body, model.inertias[joint], LEAST_SHARE * machine.mass)
        if joint == 1:
            body.add_freejoint(name="root")
            continue
        axis, slides = _axis(model, joint)
        body.add_joint(
            name=model.names[joint],
            type=mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE,
            axis=axis,
            armature=DRIVE_INERTIA * machine.mass,
        )
    return bodies


def _add_feet(root: Any, support: SupportPolygon, contact: dict[str, Any]) -> None:
    """Add a contact sphere at each corner of the support polygon."""
    for corner, (x, y) in enumerate(support.vertices):
        root.add_geom(
            name=foot_name(corner),
            type=load_mujoco().mjtGeom.mjGEOM_SPHERE,
            size=[FOOT_RADIUS, 0.0, 0.0],
            rgba=[0.0] * 4,
            pos=[x, y, support.height + FOOT_RADIUS],
            contype=2,
            conaffinity=1,
            **contact,
        )


def contact_time(sinkage: float) -> float:
    """MuJoCo's time constant t of soft ground [s], from sinkage = g (SOFT_IMPEDANCE t)^2.

    Args:
        sinkage: Depth to which the ground yields under a machine at rest [m].
    """
    return float(np.sqrt(sinkage / GRAVITY)) / SOFT_IMPEDANCE


def _pose(placement: Any) -> dict[str, Any]:
    """Position and quaternion of a `pin.SE3` as MuJoCo's keyword arguments."""
    turn = pin.Quaternion(placement.rotation)
    return {"pos": placement.translation, "quat": [turn.w, turn.x, turn.y, turn.z]}


def _set_inertia(body: Any, inertia: Any, least_mass: float) -> None:
    """Set the mass properties of a body.

    Mass and moments of inertia are increased just enough for MuJoCo to accept them: all must be
    positive, and the sum of any two moments at least the third.
    """
    mass = max(inertia.mass, least_mass)
    tensor = np.array(inertia.inertia)
    moments = np.linalg.eigvalsh(tensor)  # ascending
    lacking = max(moments[2] - moments[1] - moments[0], 0.0)
    added = max(LEAST_INERTIA * (mass + np.abs(moments).max()), LEAST_MOMENT)
    tensor += (lacking + added) * np.eye(3)
    body.mass, body.ipos, body.explicitinertial = mass, inertia.lever, True
    body.fullinertia = [*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]]


def _axis(model: Any, joint: int) -> tuple[Array, bool]:
    """Axis of a joint in the joint's frame, shape (3,), and whether the joint slides along it."""
    kind = model.joints[joint]
    data = kind.createData()
    kind.calc(data, pin.neutral(model))
    subspace = np.array(data.S).ravel()  # (6,), linear part first
    slides = bool(np.abs(subspace[:3]).max() > 0.0)
    return subspace[:3] if slides else subspace[3:], slides
