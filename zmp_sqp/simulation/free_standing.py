"""MuJoCo simulation of a machine that stands freely and whose joints are driven kinematically."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.mechanics.ground import Ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.planning.constraints.tip_over import supported
from zmp_sqp.simulation.engine import load_mujoco
from zmp_sqp.simulation.multibody import foot_name, multibody_spec

__all__ = ["FreeStanding"]


@dataclass(frozen=True, slots=True, eq=False)
class FreeStanding:
    """MuJoCo simulation of a machine whose joints are driven kinematically.

    Attributes:
        mujoco: The package.
        model: `mujoco.MjModel` of the machine on its ground.
        data: `mujoco.MjData`, the state of the simulation.
        time_step: Length of a step [s].
        at_q, at_v: Index of each joint in MuJoCo's positions and rates, shape (m,) each; the m
            joints are those of the Pinocchio model, mimic joints included.
        drive: Inertia of each joint's drive, shape (m,) [kg m^2 or kg].
        corner_of: Corner of the support polygon whose foot a geometry is, by index of the geometry.
        corners: Number V of corners of the support polygon.
    """

    mujoco: Any
    model: Any
    data: Any
    time_step: float
    at_q: Indices
    at_v: Indices
    drive: Array
    corner_of: Indices
    corners: int

    @classmethod
    def of(
        cls,
        machine: Machine,
        ground: Ground,
        *,
        time_step: float,
        friction: float,
        sinkage: float = 0.0,
    ) -> FreeStanding:
        """Simulation of a machine on its ground, before the first step.

        Args:
            machine: Machine with a support polygon.
            ground: Ground on which it stands; only its gravity is used.
            time_step: Length of a step [s].
            friction: Friction coefficient of a foot [-]; times 1 m, it is the coefficient against
                twisting on the spot.
            sinkage: As for `multibody_spec` [m].

        Raises:
            MissingExtra: MuJoCo is not installed.
            MachineError: The machine has no support polygon.
        """
        mujoco = load_mujoco()
        model = multibody_spec(
            machine,
            ground,
            time_step=time_step,
            friction=(friction, friction * 1.0),  # 1.0 m: lever of twisting
            sinkage=sinkage,
        ).compile()
        joints = [model.joint(name) for name in list(machine.model.names)[2:]]
        at_v = np.array([joint.dofadr[0] for joint in joints])
        return cls(
            mujoco,
            model,
            mujoco.MjData(model),
            time_step,
            at_q=np.array([joint.qposadr[0] for joint in joints]),
            at_v=at_v,
            drive=model.dof_armature[at_v],
            corner_of=np.arange(model.ngeom) - model.geom(foot_name(0)).id,  # feet are consecutive
            corners=len(supported(machine).vertices),
        )

    @property
    def root_pose(self) -> Array:
        """Position and quaternion (w, x, y, z) of the root, shape (7,)."""
        return np.asarray(self.data.qpos[:7])

    def set_positions(self, q: Array) -> None:
        """Set the joint coordinates, shape (m,)."""
        self.data.qpos[self.at_q] = q

    def set_rates(self, v: Array) -> None:
        """Set the joint rates, shape (m,)."""
        self.data.qvel[self.at_v] = v

    def step_to(self, target: Array) -> float:
        """Simulate one step in which the joints are driven to `target`, shape (m,).

        The drive forces are drive * (target - q - h v) / h^2, see `replay`.

        Returns:
            Largest distance of a joint from its target after the step [rad or m].
        """
        data, h = self.data, self.time_step
        change = target - data.qpos[self.at_q] - h * data.qvel[self.at_v]
        self.accelerate(change / h**2)
        return float(np.abs(data.qpos[self.at_q] - target).max())

    def accelerate(self, acceleration: Array) -> None:
        """Simulate one step in which the joints have given accelerations, shape (m,)."""
        self.data.qfrc_applied[self.at_v] = self.drive * acceleration
        self.mujoco.mj_step(self.model, self.data)

    def foot_loads(self) -> Array:
        """Normal force on the foot at each corner in the last step, shape (V,) [N]."""
        loads, contact = np.zeros(self.corners), self.data.contact
        rows = contact.efc_address  # of the normal force, -1 for contacts without one
        corner = self.corner_of[contact.geom[:, 1]]
        np.add.at(loads, corner[rows >= 0], self.data.efc_force[rows[rows >= 0]])
        return loads
