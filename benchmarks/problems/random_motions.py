"""Random motions of the shipped machines: standing and driving, with torque limits or without."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import zmp_sqp as zs
from zmp_sqp.mechanics.uncertainty import Corner, corners
from zmp_sqp.motion.interpolation import quintic_motion
from zmp_sqp.motion.unicycle_motion import UnicycleMotion

__all__ = ["RandomMotion", "random_motion"]

NAMES = ("feller_buncher", "excavator", "forwarder_crane", "mobile_manipulator")
TREE = {"feller_buncher": ("head", 2000.0), "excavator": ("bucket", 500.0)}
STEEPEST = 0.15  # [rad]
UNCERTAIN = {
    "tipping_fraction": 0.9,
    "payload_uncertainty": 0.1,
    "payload_com_uncertainty": np.array([0.1, 0.0, 0.2]),
}
LEANING = 0.02  # [rad] uncertainty of the slope of every other uncertain motion


@dataclass(frozen=True, slots=True, eq=False)
class RandomMotion:
    """A motion, and what it is checked for.

    Attributes:
        kind: "standing", "quintic", "driving" or "uncertain".
        corners: Payloads and slopes; one unless the kind is "uncertain".
        constraints: Torque limits, where the machine has effort limits and the seed is odd.
    """

    kind: str
    machine: zs.Machine
    trajectory: zs.Trajectory
    ground: zs.Ground
    corners: tuple[Corner, ...]
    constraints: tuple[zs.PathConstraint, ...]


def random_motion(seed: int) -> RandomMotion:
    """Motion of one seed: 3 to 8 intervals of 0.1 to 0.8 s, rates up to 0.03 to 0.6 rad/s."""
    rng = np.random.default_rng([1815, seed])
    kind = ("standing", "quintic", "driving", "standing", "driving", "uncertain")[seed % 6]
    name = NAMES[0] if kind == "uncertain" else NAMES[int(rng.integers(len(NAMES)))]
    machine = zs.load_machine(name)
    if name in TREE and (kind == "uncertain" or rng.uniform() < 0.5):
        frame, mass = TREE[name]
        com = rng.uniform(-0.5, 0.5, 3)
        machine = machine.with_payload(zs.Payload(mass, com, frame, np.diag([90.0, 80.0, 40.0])))
    ground = zs.Slope(*rng.uniform(-STEEPEST, STEEPEST, 2))
    trajectory = _joints(rng, machine, curved=kind == "quintic")
    if kind == "driving":
        trajectory = _driven(rng, trajectory, ground)
    loads = (Corner(machine, ground),)
    if kind == "uncertain":
        off = LEANING * (seed % 12 == 11)
        loads = corners(machine, ground, **UNCERTAIN, slope_uncertainty=off, every=True)
    limited = seed % 2 and not np.isnan(machine.limits.effort).any()
    return RandomMotion(
        kind, machine, trajectory, ground, loads, (zs.TorqueLimits(),) if limited else ()
    )


def _joints(rng: np.random.Generator, machine: zs.Machine, *, curved: bool) -> zs.Trajectory:
    """Motion of the joints with random rates and accelerations at random nodes."""
    count, n = int(rng.integers(3, 9)), machine.size
    steps = rng.uniform(0.1, 0.8, count)
    times = np.concatenate([[0.0], np.cumsum(steps)])
    steps = np.diff(times)[:, None]
    speed = np.exp(rng.uniform(np.log(0.03), np.log(0.6)))
    v = speed * rng.uniform(-1.0, 1.0, (count + 1, n))
    start = rng.uniform(-1.5, 1.5, n)
    if curved:
        q = start + np.vstack([np.zeros(n), np.cumsum(steps * 0.5 * (v[1:] + v[:-1]), axis=0)])
        a = 2.0 * speed * rng.uniform(-1.0, 1.0, (count + 1, n))
        return quintic_motion(machine.joint_names, times, q, v, a)
    a = np.diff(v, axis=0) / steps * rng.uniform(0.5, 1.5, (count, n))
    j = 2.0 * (np.diff(v, axis=0) - steps * a) / steps**2
    rise = steps * v[:-1] + 0.5 * steps**2 * a + steps**3 * j / 6.0
    q = start + np.vstack([np.zeros(n), np.cumsum(rise, axis=0)])
    return zs.Trajectory(machine.joint_names, times, q, v, a, j)


def _driven(rng: np.random.Generator, joints: zs.Trajectory, ground: zs.Slope) -> zs.Trajectory:
    """The motion with a base that drives and turns at random."""
    times, steps = joints.times, np.diff(joints.times)[:, None]
    v = rng.uniform(-1.0, 1.0, (len(times), 2)) * rng.uniform([0.2, 0.1], [2.0, 0.8])
    a = np.diff(v, axis=0) / steps * rng.uniform(0.5, 1.5, (len(steps), 2))
    j = 2.0 * (np.diff(v, axis=0) - steps * a) / steps**2
    rise = steps * v[:-1] + 0.5 * steps**2 * a + steps**3 * j / 6.0
    yaw = rng.uniform(-3.0, 3.0) + np.concatenate([[0.0], np.cumsum(rise[:, 1])])
    start = np.append(rng.uniform(-5.0, 5.0, 2), yaw[0])
    base = UnicycleMotion.from_start(times, start, v, yaw, (a, j), ground)
    return zs.Trajectory(
        joints.joint_names,
        times,
        joints.positions,
        joints.velocities,
        joints.accelerations,
        joints.jerks,
        base=base,
    )
