"""The machine in MuJoCo, built from its Pinocchio model: the same inertias, joints and support polygon."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.ground import GRAVITY, Ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.simulation.engine import load_mujoco
from zmp_sqp.simulation.shapes import Solid

__all__ = ["contact_time", "foot_name", "multibody_spec"]

FOOT = 0.01  # [m] radius of the spheres that stand on the ground
DRIVE = 1e5  # [kg m^2 or kg] of a drive per kg of machine; 1e3 to 1e9 give the same motion
LEAST_INERTIA = 1e-9  # [m^2] of a body per kg of it: MuJoCo takes no point masses
# time constant [s] and impedance of contacts that yield by about a micrometre
RIGID = (0.01, 0.999)
# impedance at which MuJoCo's spring and damper are those of its time constant: critically damped
SOFT = 0.5
FRICTION_RATIO = 10.0  # how much harder friction is than the normal force
SOLVER = {"tolerance": 1e-12, "iterations": 200}  # 1e-6 changes lifts by 2 to 4 %, 1e-8 no more


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
    """MuJoCo's description of the machine, its root on a free joint, its feet on the ground.

    The world is the root frame of the machine at rest: the ground stays level and gravity is
        tilted. A sphere stands
    with its lowest point at each corner of the support polygon; nothing else touches. Each joint
    carries a drive of an inertia far above the machine's, so that a force of that inertia times an
    acceleration prescribes the joint's acceleration, whatever the rest of the machine does; the
    drive's inertia counts in the joint's own equation alone, and the root feels the joints' motion
    as it is.

    Args:
        machine: With a support polygon.
        ground: For its gravity.
        time_step: Of the simulation [s].
        friction: Coefficients of a foot's friction against sliding [-] and against twisting [m].
        sinkage: How far the ground yields under the machine at rest, a spring and a damper below
            each foot; 0 is as rigid as MuJoCo can be [m].
        solids: To be drawn.

    Returns:
        A `mujoco.MjSpec`.
    """
    mujoco = load_mujoco()
    support, model = machine.support, machine.model
    if support is None:
        raise MachineError(f"machine {machine.name!r} has no support polygon to stand on")
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep, spec.option.gravity = time_step, ground.gravity()
    spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, FRICTION_RATIO
    for key, value in SOLVER.items():
        setattr(spec.option, key, value)
    time, impedance = (contact_time(sinkage), SOFT) if sinkage > 0.0 else RIGID
    contact = {
        "condim": 4,  # normal, two of sliding, twisting
        "friction": [*friction, 0.0],
        "solref": [time, 1.0],
        "solimp": [impedance, impedance, 0.001, 0.5, 2.0],
    }
    plane = {
        "type": mujoco.mjtGeom.mjGEOM_PLANE,
        "size": [0.0, 0.0, 1.0],
        "pos": [0.0, 0.0, support.height],
    }
    spec.worldbody.add_geom(
        name="ground", contype=1, conaffinity=2, rgba=[0.0] * 4, **plane, **contact
    )
    bodies = [spec.worldbody]
    for joint in range(1, model.njoints):
        placement = model.jointPlacements[joint]
        body = bodies[model.parents[joint]].add_body(name=f"body {joint}", **_pose(placement))
        bodies.append(body)
        _set_inertia(body, model.inertias[joint])
        if joint == 1:
            body.add_freejoint(name="root")
            continue
        axis, slides = _axis(model, joint)
        kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
        body.add_joint(name=model.names[joint], type=kind, axis=axis, armature=DRIVE * machine.mass)
    for corner, (x, y) in enumerate(support.vertices):
        bodies[1].add_geom(
            name=foot_name(corner),
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[FOOT, 0.0, 0.0],
            rgba=[0.0] * 4,
            pos=[x, y, support.height + FOOT],
            contype=2,
            conaffinity=1,
            **contact,
        )
    for solid in solids:
        kind = getattr(mujoco.mjtGeom, f"mjGEOM_{solid.kind.upper()}")
        look = {"type": kind, "size": solid.size, "rgba": solid.colour}
        bodies[solid.joint].add_geom(contype=0, conaffinity=0, **look, **_pose(solid.placement))
    return spec


def contact_time(sinkage: float) -> float:
    """MuJoCo's time constant of a ground that yields so far under a standing machine, s = g (SOFT t)^2 [s]."""
    return float(np.sqrt(sinkage / GRAVITY)) / SOFT


def _pose(placement: Any) -> dict[str, Any]:
    turn = pin.Quaternion(placement.rotation)
    return {"pos": placement.translation, "quat": [turn.w, turn.x, turn.y, turn.z]}


def _set_inertia(body: Any, inertia: Any) -> None:
    """As it is, but for what makes it a body that MuJoCo takes: positive moments, of which no two fall short."""
    tensor = np.array(inertia.inertia)
    moments = np.linalg.eigvalsh(tensor)  # ascending
    # CAD files round: at most a thousandth
    lacking = max(moments[2] - moments[1] - moments[0], 0.0)
    tensor += (lacking + LEAST_INERTIA * (inertia.mass + moments[2])) * np.eye(3)
    body.mass, body.ipos, body.explicitinertial = inertia.mass, inertia.lever, True
    body.fullinertia = [*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]]


def _axis(model: Any, joint: int) -> tuple[Array, bool]:
    """Axis of a joint in its own frame, and whether it slides along it."""
    kind = model.joints[joint]
    data = kind.createData()
    kind.calc(data, pin.neutral(model))
    subspace = np.array(data.S).ravel()  # (6,), linear part first
    slides = bool(np.abs(subspace[:3]).max() > 0.0)
    return subspace[:3] if slides else subspace[3:], slides
