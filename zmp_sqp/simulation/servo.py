"""Simulated machine for control loops: joints that follow commanded rates late, noisy sensors."""

from __future__ import annotations

from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.ground import Ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.simulation.free_standing import FreeStanding

__all__ = ["ServoMachine"]

SETTLING = 0.5  # [s] simulated time at rest at first, in which the contacts settle
FRICTION = 10.0  # of a foot: it does not slide, as the zero moment point assumes


class ServoMachine:
    r"""Machine that stands freely in MuJoCo and is driven by commanded joint rates.

    Each joint follows its commanded rate u with a first-order lag, as valve and pump of a
    hydraulic drive do:

    .. math:: \tau \ddot q + \dot q = u

    The drives are as strong as this needs. The undercarriage is a free rigid body on feet at the
    corners of the support polygon, as in `replay`: it tips over where physics says so.
    """

    def __init__(
        self,
        machine: Machine,
        q: Any,
        ground: Ground,
        *,
        lag: Any = 0.05,
        noise: tuple[float, float] = (5e-4, 5e-3),
        time_step: float = 2e-3,
        seed: int = 0,
    ) -> None:
        """Machine at rest on its ground.

        Args:
            machine: Machine with a support polygon.
            q: Joint coordinates, shape (n,) [rad or m].
            ground: Ground on which it stands; only its gravity is used.
            lag: Time constant tau of the joints, scalar or shape (n,) [s].
            noise: Standard deviations of measured coordinates [rad or m] and rates [rad/s or m/s].
            time_step: Time step of the simulation, at most 5 ms [s].
            seed: Of the measurement noise.

        Raises:
            MissingExtra: MuJoCo is not installed.
            MachineError: The machine has no support polygon.
            ProblemError: An argument is out of its range.
        """
        n, joints = machine.size, machine.joint_names
        self.machine, self.ground = machine, ground
        self._time_step = finite_number(time_step, name="time_step", error=ProblemError)
        if not 1e-6 <= self._time_step <= 5e-3:
            raise ProblemError(f"time_step must be from 1e-06 to 0.005 s, not {time_step:g} s")
        lags = np.broadcast_to(np.asarray(lag, dtype=np.float64), (n,))
        self._lag = frozen_array(lags, name="lag", shape=(n,), error=ProblemError, labels=joints)
        if (self._lag < self._time_step).any():
            raise ProblemError(
                f"lag must be at least the time_step of {time_step:g} s, not {self._lag.min():g} s"
            )
        self._noise, self._rng = noise, np.random.default_rng(seed)
        self._own = machine.coupling.own
        start = frozen_array(q, name="q", shape=(n,), error=ProblemError, labels=joints)
        self._physics = self._standing(machine)
        self._physics.set_positions(machine.coupling.positions(start))
        self._acceleration = np.zeros(n)
        for _ in range(round(SETTLING / self._time_step)):
            self._physics.accelerate(np.zeros(len(self._physics.at_v)))

    def _standing(self, machine: Machine) -> FreeStanding:
        return FreeStanding.of(machine, self.ground, time_step=self._time_step, friction=FRICTION)

    def drive(self, rates: Any, duration: float) -> None:
        """Simulate a time during which the commanded rates do not change.

        Args:
            rates: Commanded joint rates u, shape (n,) [rad/s or m/s].
            duration: Simulated time [s], rounded to time steps.
        """
        command, physics = np.asarray(rates, dtype=np.float64), self._physics
        rates_of = self.machine.coupling.rates
        for _ in range(max(round(duration / self._time_step), 1)):
            now = physics.data.qvel[physics.at_v][self._own]
            self._acceleration = (command - now) / self._lag
            physics.accelerate(rates_of(self._acceleration))

    def change_machine(self, machine: Machine) -> None:
        """Go on with another payload; the state of all bodies stays as it is.

        Args:
            machine: This machine, with another payload.
        """
        old, self.machine = self._physics, machine
        self._physics = self._standing(machine)
        for name in ("qpos", "qvel", "qacc_warmstart"):
            getattr(self._physics.data, name)[:] = getattr(old.data, name)

    @property
    def measured(self) -> tuple[Array, Array]:
        """Joint coordinates and rates as the sensors give them, shape (n,) each."""
        (of_q, of_v), n = self._noise, self.machine.size
        q, v, _ = self.state
        return q + self._rng.normal(0.0, of_q, n), v + self._rng.normal(0.0, of_v, n)

    @property
    def state(self) -> tuple[Array, Array, Array]:
        """True joint coordinates and rates, and accelerations of the last step, shape (n,) each."""
        data, physics = self._physics.data, self._physics
        q, v = data.qpos[physics.at_q][self._own], data.qvel[physics.at_v][self._own]
        return q, v, self._acceleration

    @property
    def foot_loads(self) -> Array:
        """Normal force on the foot at each corner of the support polygon, shape (V,) [N]."""
        return self._physics.foot_loads()

    @property
    def contact_margin(self) -> float:
        """Distance from the centre of pressure to the nearest edge of the support polygon [m].

        The centre of pressure cannot leave the polygon: where the machine tips over, this is zero.
        NaN where no foot touches the ground.
        """
        loads, support = self.foot_loads, self.machine.support
        if support is None or loads.sum() <= 0.0:
            return float("nan")
        centre = loads @ support.vertices / loads.sum()
        return float((support.offsets - support.normals @ centre).min())

    @property
    def tilt(self) -> float:
        """Angle between the root's z axis and the normal of the ground [rad]."""
        _, x, y, _ = self._physics.root_pose[3:]
        return float(2.0 * np.arcsin(min(np.hypot(x, y), 1.0)))
