"""Replays a motion in MuJoCo: the machine stands free on the slope, its joints follow the trajectory."""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import finite_number
from zmp_sqp.errors import MachineError, ProblemError, TrajectoryError
from zmp_sqp.mechanics.ground import Ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.simulation.engine import load_mujoco
from zmp_sqp.simulation.multibody import contact_time, foot_name, multibody_spec
from zmp_sqp.simulation.outcome import Replay

__all__ = ["replay"]

SETTLING = 0.5  # [s] at rest before the motion
AT_REST = 1e-5  # [rad/s or m/s] of a motion's end: what plans leave of zero is less
LONGEST_STEP = 5e-3  # [s] of the simulation: half of the rigid contacts' time constant
FALLEN = np.cos(np.pi / 4)  # cosine of the tilt at which a replay ends


def replay(
    machine: Machine,
    trajectory: Trajectory,
    ground: Ground,
    *,
    time_step: float = 1e-3,
    hold: float = 1.0,
    friction: float = 10.0,
    sinkage: float = 0.0,
) -> Replay:
    r"""Physics of a motion: contact and friction under the machine instead of the assumption that it stands.

    The joints are driven kinematically: in each step the acceleration

    .. math:: a_k = (q^*(t_{k+1}) - q_k - h v_k) / h^2

    takes them to the trajectory's next positions, whatever that costs. So it is the motion that is
    judged, not a controller. The undercarriage is a free rigid body on feet at the corners of the
    support polygon, of friction high enough not to slide, as the zero moment point takes for
    granted. With a lower one, `Replay.slide` says how far the motion is from that; point feet turn
    about a corner that carries the machine alone, which tracks do not.

    Args:
        machine: With a support polygon; the trajectory must be of its joints.
        trajectory: The motion; its base must stand.
        ground: What the machine stands on.
        time_step: Of the simulation, at most 5 ms [s].
        hold: How long the machine stands still after a motion that ends at rest [s].
        friction: Coefficient of a foot's friction; times 1 m, that against twisting on the spot.
        sinkage: How far the ground yields under a machine that stands evenly, like a spring and a
            damper [m]; 0 is rigid. A machine leans on ground that yields, and its other side rises:
            go by `fell` and `max_tilt` there.

    Raises:
        MissingExtra: MuJoCo is not installed.
        MachineError: No machine, or no support polygon.
        TrajectoryError: No trajectory.
        ProblemError: Other joints, a base that drives, or a setting out of its range.
    """
    _check(machine, trajectory, ground)
    h = _setting(time_step, name="time_step", least=1e-6, most=LONGEST_STEP)
    rest = _setting(hold, name="hold", least=0.0, most=3600.0)
    if np.abs(trajectory.velocities[-1]).max() > AT_REST:
        rest = 0.0  # it would stop with a blow
    grip = _setting(friction, name="friction", least=0.0, most=1e3)
    soft = _setting(sinkage, name="sinkage", least=0.0, most=1.0)
    if soft > 0.0 and contact_time(soft) < 2.0 * h:
        raise ProblemError(
            f"a sinkage of {soft:g} m is too little for a time_step of {h:g} s: shorten it, or give 0"
        )
    mujoco = load_mujoco()
    model = multibody_spec(
        machine, ground, time_step=h, friction=(grip, grip * 1.0), sinkage=soft
    ).compile()
    data = mujoco.MjData(model)
    joints = [model.joint(name) for name in machine.joint_names]
    at_q = np.array([joint.qposadr[0] for joint in joints])
    at_v = np.array([joint.dofadr[0] for joint in joints])
    drive = model.dof_armature[at_v]
    corners = len(machine.support.vertices)  # type: ignore[union-attr]
    first_foot = model.geom(foot_name(0)).id
    corner_of = np.arange(model.ngeom) - first_foot  # feet follow one another

    before, after = round(SETTLING / h), int(np.ceil((trajectory.duration + rest) / h))
    wanted = trajectory(np.minimum(h * np.arange(after + 2), trajectory.duration))[0]  # (K + 1, n)
    data.qpos[at_q] = wanted[0]
    poses, loads = np.empty((after + 1, 7)), np.zeros((after + 1, corners))
    error, fell, count = 0.0, False, after + 1
    for k in range(-before, after + 1):
        if k == 0:  # the rate half a step ago, so that the first step has the first acceleration
            data.qvel[at_v] = trajectory.velocities[0] - 0.5 * h * trajectory.accelerations[0]
        target = wanted[max(k + 1, 0)]
        data.qfrc_applied[at_v] = drive * (target - data.qpos[at_q] - h * data.qvel[at_v]) / h**2
        if k >= 0:
            poses[k] = data.qpos[:7]
        mujoco.mj_step(model, data)
        error = max(error, float(np.abs(data.qpos[at_q] - target).max()))
        if k >= 0:
            contact = data.contact
            rows = contact.efc_address  # of the normal force, -1 for contacts without one
            np.add.at(
                loads[k], corner_of[contact.geom[:, 1]][rows >= 0], data.efc_force[rows[rows >= 0]]
            )
            if 1.0 - 2.0 * (poses[k, 4] ** 2 + poses[k, 5] ** 2) < FALLEN:
                fell, count = True, k + 1
                break
    times = np.asarray(h * np.arange(count), dtype=np.float64)
    return Replay(machine, trajectory, ground, times, poses[:count], loads[:count], error, fell)


def _setting(value: float, *, name: str, least: float, most: float) -> float:
    number = finite_number(value, name=name, error=ProblemError)
    if not least <= number <= most:
        raise ProblemError(f"{name} must be from {least:g} to {most:g}, not {number:g}")
    return number


def _check(machine: Machine, trajectory: Trajectory, ground: Ground) -> None:
    if not isinstance(machine, Machine):
        raise MachineError(
            f"machine must be a Machine (see load_machine), not {type(machine).__name__}"
        )
    if not isinstance(trajectory, Trajectory):
        raise TrajectoryError(f"trajectory must be a Trajectory, not {type(trajectory).__name__}")
    if isinstance(ground, type) or not isinstance(ground, Ground):
        raise ProblemError(f"ground must have a gravity(yaw) as Slope has, not {ground!r}")
    if machine.support is None:
        raise MachineError(
            f"machine {machine.name!r} has no support polygon: give support= to load_machine"
        )
    if trajectory.joint_names != machine.joint_names:
        raise ProblemError(
            f"the trajectory moves {trajectory.joint_names}, the machine has {machine.joint_names}"
        )
    if trajectory.base is not None:
        raise ProblemError("the trajectory's base drives; a replay needs one that stands")
