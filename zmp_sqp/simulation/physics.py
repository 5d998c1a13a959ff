"""Replays a motion in MuJoCo: the joints follow it, and the machine stands freely on its ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from zmp_sqp.arrays import Array, finite_number
from zmp_sqp.errors import GIVE_SUPPORT, MachineError, ProblemError, TrajectoryError
from zmp_sqp.mechanics.ground import Ground, check_ground
from zmp_sqp.mechanics.joint_coupling import JointCoupling
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.simulation.free_standing import FreeStanding
from zmp_sqp.simulation.multibody import contact_time
from zmp_sqp.simulation.outcome import Replay

__all__ = ["replay"]

SETTLING = 0.5  # [s] simulated time at rest before the motion, in which the contacts settle
# [rad/s or m/s] largest final rate of a motion that counts as ending at rest; planned motions that
# end at rest stay below it
AT_REST = 1e-5
LONGEST_STEP = 5e-3  # [s] largest time step: half the time constant of rigid contacts
FALLEN = np.cos(np.pi / 4)  # cosine of the tilt at which a machine has fallen over


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
    r"""Simulate a motion with contact and friction between machine and ground.

    Planning assumes that the machine stands; the simulation does not. The joints are driven
    kinematically: in each step of length h, the acceleration

    .. math:: a_k = (q^*(t_{k+1}) - q_k - h v_k) / h^2

    takes them to the trajectory's next positions q^*, whatever force this needs. The result thus
    judges the motion and not a controller.

    The undercarriage is a free rigid body on feet at the corners of the support polygon. The
    default friction keeps them from sliding, as the zero moment point assumes; with less friction,
    `Replay.slide` tells how far they slide. Unlike tracks, a foot that alone carries the machine
    lets it turn about this foot.

    Args:
        machine: Machine with a support polygon and the joints of the trajectory.
        trajectory: Motion of the joints; the base must stand still.
        ground: Ground on which the machine stands.
        time_step: Time step of the simulation, at most 5 ms [s].
        hold: Simulated time after a motion that ends at rest [s].
        friction: Friction coefficient of a foot [-]; times 1 m, it is the coefficient against
            twisting on the spot.
        sinkage: Depth to which the ground yields, as springs and dampers, under an evenly loaded
            machine [m]; 0 is rigid. On yielding ground a machine leans to one side, so that its
            other side rises without tipping: judge by `fell` and `max_tilt` there.

    Returns:
        Motion of the machine and loads of its feet.

    Raises:
        MissingExtra: MuJoCo is not installed.
        MachineError: Not a Machine, or one without a support polygon.
        TrajectoryError: Not a Trajectory.
        ProblemError: The trajectory has other joints, its base drives, or a setting is out of its
            range.
    """
    _check(machine, trajectory, ground)
    settings = _Settings.checked(
        trajectory, time_step=time_step, hold=hold, friction=friction, sinkage=sinkage
    )
    record = _simulate(_standing(machine, ground, settings), trajectory, machine.coupling, settings)
    times = np.asarray(settings.time_step * np.arange(len(record.poses)), dtype=np.float64)
    return Replay(machine, trajectory, ground, times, *record)


@dataclass(frozen=True, slots=True)
class _Settings:
    """Checked settings of a replay; see `replay` for their meaning."""

    time_step: float
    hold: float
    friction: float
    sinkage: float

    @classmethod
    def checked(
        cls,
        trajectory: Trajectory,
        *,
        time_step: float,
        hold: float,
        friction: float,
        sinkage: float,
    ) -> _Settings:
        """Check the ranges; a motion that does not end at rest gets no hold.

        Raises:
            ProblemError: A setting is out of its range.
        """
        h = _setting(time_step, name="time_step", least=1e-6, most=LONGEST_STEP)
        rest = _setting(hold, name="hold", least=0.0, most=3600.0)
        if np.abs(trajectory.velocities[-1]).max() > AT_REST:
            rest = 0.0  # the joints would stop within one step, with a blow
        grip = _setting(friction, name="friction", least=0.0, most=1e3)
        soft = _setting(sinkage, name="sinkage", least=0.0, most=1.0)
        if soft > 0.0 and contact_time(soft) < 2.0 * h:
            raise ProblemError(
                f"a sinkage of {soft:g} m is too little for a time_step of {h:g} s: "
                "give a shorter time_step, or a sinkage of 0, which is rigid ground"
            )
        return cls(h, rest, grip, soft)


class _Record(NamedTuple):
    """Last four attributes of `Replay`: what a simulation has recorded."""

    poses: Array
    loads: Array
    tracking_error: float
    fell: bool


def _standing(machine: Machine, ground: Ground, settings: _Settings) -> FreeStanding:
    """Simulation of a machine on its ground, before the first step."""
    return FreeStanding.of(
        machine,
        ground,
        time_step=settings.time_step,
        friction=settings.friction,
        sinkage=settings.sinkage,
    )


def _simulate(
    simulation: FreeStanding, trajectory: Trajectory, coupling: JointCoupling, settings: _Settings
) -> _Record:
    """Let the machine settle at rest, then drive its joints along a trajectory."""
    h = settings.time_step
    before = round(SETTLING / h)
    after = int(np.ceil((trajectory.duration + settings.hold) / h))
    planned = trajectory(np.minimum(h * np.arange(after + 2), trajectory.duration))[0]
    wanted = coupling.positions(planned)  # (K + 1, m)
    simulation.set_positions(wanted[0])
    poses, loads = np.empty((after + 1, 7)), np.zeros((after + 1, simulation.corners))
    error = 0.0
    for k in range(-before, after + 1):  # negative steps: at rest before the motion
        if k == 0:  # the rate half a step ago, so that the first step has the first acceleration
            first = trajectory.velocities[0] - 0.5 * h * trajectory.accelerations[0]
            simulation.set_rates(coupling.rates(first))
        if k >= 0:
            poses[k] = simulation.root_pose
        error = max(error, simulation.step_to(wanted[max(k + 1, 0)]))
        if k >= 0:
            loads[k] = simulation.foot_loads()
            # 1 - 2 (x^2 + y^2) of the quaternion: z component of the root's z axis
            if 1.0 - 2.0 * (poses[k, 4] ** 2 + poses[k, 5] ** 2) < FALLEN:
                return _Record(poses[: k + 1], loads[: k + 1], error, fell=True)
    return _Record(poses, loads, error, fell=False)


def _setting(value: float, *, name: str, least: float, most: float) -> float:
    """Number within [least, most]; raises ProblemError otherwise."""
    number = finite_number(value, name=name, error=ProblemError)
    if not least <= number <= most:
        raise ProblemError(f"{name} must be from {least:g} to {most:g}, not {number:g}")
    return number


def _check(machine: Machine, trajectory: Trajectory, ground: Ground) -> None:
    """Raise unless the arguments of `replay` have the right types and match."""
    if not isinstance(machine, Machine):
        raise MachineError(
            f"machine must be a Machine (see load_machine), not {type(machine).__name__}"
        )
    if not isinstance(trajectory, Trajectory):
        raise TrajectoryError(f"trajectory must be a Trajectory, not {type(trajectory).__name__}")
    check_ground(ground)
    if machine.support is None:
        raise MachineError(
            f"machine {machine.name!r} has no support polygon: {GIVE_SUPPORT.arguments}"
        )
    if trajectory.joint_names != machine.joint_names:
        raise ProblemError(
            f"the trajectory moves the joints {', '.join(trajectory.joint_names)}; the machine has "
            f"{', '.join(machine.joint_names)}"
        )
    if trajectory.base is not None:
        raise ProblemError("the trajectory's base drives; a replay needs one that stands")
