"""Random moves of the excavator, the forwarder crane and the mobile manipulator with a load."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pinocchio as pin

import zmp_sqp as zs
from zmp_sqp.mechanics.tipping_load import tipping_load

__all__ = ["KINDS", "WIDE", "random_move"]

Array = np.ndarray

# a polygon that nothing tips over, so that joint and torque limits alone are left
WIDE = zs.SupportPolygon([[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]])
SHARES = (0.60, 0.95)  # of the tipping load at start and goal, whichever is less
LEAST = 0.02  # share of the machine's mass that the tipping load must be for a pose to count
TRIES = 10_000


@dataclass(frozen=True)
class Kind:
    """What random moves of one machine are like.

    Attributes:
        frame: Link that carries the load.
        offset: The load in that link's frame [m].
        slope: Largest roll and pitch [rad].
        heights: Range of the load's height [m].
        least_radius: Of the load about the first axis [m].
        most: Largest load [kg].
        draw: Joint coordinates of a pose from its random numbers.
    """

    frame: str
    offset: tuple[float, float, float]
    slope: float
    heights: tuple[float, float]
    least_radius: float
    most: float
    draw: Callable[[np.random.Generator, zs.JointLimits], Array]


def _within_limits(rng: np.random.Generator, limits: zs.JointLimits) -> Array:
    """Slew within half a turn, so that moves are no longer than a turn; others in their range."""
    q = rng.uniform(limits.position_lower, limits.position_upper)
    q[0] = rng.uniform(-np.pi / 2.0, np.pi / 2.0)
    return np.asarray(q)


def _reaching(rng: np.random.Generator, limits: zs.JointLimits) -> Array:
    """An arm that reaches out, to either side or over the top; the last wrist joints at rest."""
    lower, upper = (-3.0, -2.6, -0.2, -2.5), (3.0, -0.4, 2.0, 0.0)
    return np.append(rng.uniform(lower, upper), [-np.pi / 2.0, 0.0])


KINDS = {
    "excavator": Kind(
        "stick", (2.925, 0.0, 0.0), np.radians(12.0), (0.0, 5.0), 4.0, 6e3, _within_limits
    ),
    "forwarder_crane": Kind(
        "grapple", (0.0, 0.0, 0.0), np.radians(19.3), (0.5, 6.0), 3.0, 1500.0, _within_limits
    ),
    "mobile_manipulator": Kind(
        "tool", (0.0, 0.0, 0.15), np.radians(5.0), (0.5, 2.0), 0.5, 12.5, _reaching
    ),
}


@cache
def _machine(name: str) -> zs.Machine:
    return zs.load_machine(name)


def random_move(name: str, seed: int) -> zs.Problem:
    """A move from rest to rest with a load, joint and torque limits, on a random slope.

    Poses stand with the load, and their torques at rest are within the limits: what `Problem`
    refuses is drawn again.

    Args:
        name: Of the machine.
        seed: Of the problem.
    """
    kind, machine, rng = KINDS[name], _machine(name), np.random.default_rng([seed, len(name)])
    for _ in range(TRIES):
        slope = zs.Slope(*rng.uniform(-kind.slope, kind.slope, 2))
        poses = [kind.draw(rng, machine.limits) for _ in range(2)]
        loads = [_allowed(machine, kind, q, slope) for q in poses]
        mass = min(kind.most, rng.uniform(*SHARES) * min(loads))
        if mass <= LEAST * machine.mass:
            continue
        loaded = machine.with_payload(zs.Payload(mass, kind.offset, kind.frame))
        try:
            return zs.Problem(loaded, *poses, ground=slope, constraints=[zs.TorqueLimits()])
        except zs.ProblemError:  # torques at rest
            continue
    raise RuntimeError(f"no move of {name} found for seed {seed}")


def _allowed(machine: zs.Machine, kind: Kind, q: Array, slope: zs.Slope) -> float:
    """Tipping load of a pose [kg]; zero where the load would be out of the kind's bounds."""
    model, data = machine.model, machine.model.createData()
    pin.framesForwardKinematics(model, data, machine.configuration(q[None])[0])
    x, y, z = data.oMf[model.getFrameId(kind.frame, pin.FrameType.BODY)].act(np.array(kind.offset))
    if not kind.heights[0] <= z <= kind.heights[1] or np.hypot(x, y) < kind.least_radius:
        return 0.0
    found = tipping_load(machine, q, slope, frame=kind.frame, offset=np.array(kind.offset))
    return float(found.mass)
