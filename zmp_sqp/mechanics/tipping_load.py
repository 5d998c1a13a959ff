"""Tipping load: the largest mass that a machine at rest can carry at a point before it tips."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.errors import GIVE_SUPPORT, MachineError
from zmp_sqp.mechanics.ground import Ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.mechanics.wrench import ground_reaction

__all__ = ["TippingLoad", "frame_index", "frame_position", "tipping_load", "worst_turn"]

# share of a moment's size below which it counts as zero: a load exactly above an edge's line
ROUNDING = 1e-12
TURN = 2.0 * np.pi  # [rad]


@dataclass(frozen=True, slots=True)
class TippingLoad:
    """Largest payload at rest.

    Attributes:
        mass: Payload at which the ZMP reaches an edge [kg]; 0 if the machine tips over without
            any, infinity if no payload at this point tips it over.
        edge: Index of that edge; -1 if there is none.
        coordinate: Coordinate of the turning joint [rad]; NaN where no joint was turned, or where
            no payload tips the machine over.
    """

    mass: float
    edge: int
    coordinate: float = np.nan


def tipping_load(
    machine: Machine, q: Array, ground: Ground, *, frame: str, offset: Array | None = None
) -> TippingLoad:
    r"""Largest point mass at a frame of the machine at rest before the ZMP reaches an edge.

    The moment about edge i is affine in the payload m (see `SupportPolygon.wrench_rows`):

    .. math:: M_i(m) = M_i^0 + m c_i \le 0, \quad m = \min_{c_i > 0} -M_i^0 / c_i

    Args:
        machine: Machine with a support polygon; payloads that it carries already count.
        q: Joint coordinates, shape (n,) [rad or m].
        ground: Ground on which the machine stands.
        frame: Name of the link (or other frame) that carries the mass.
        offset: Position of the mass in that frame, shape (3,) [m]; None is its origin.

    Raises:
        MachineError: No support polygon, or an unknown frame.
    """
    return _least(*_moments(machine, np.asarray(q)[None], ground, frame, offset))


def worst_turn(
    machine: Machine,
    q: Array,
    ground: Ground,
    *,
    joint: str,
    frame: str,
    offset: Array | None = None,
) -> TippingLoad:
    r"""Least tipping load while one revolute joint turns through its whole range.

    While a single joint turns by theta, all positions are of the form
    a + b cos(theta) + c sin(theta), and so are M_i^0 and c_i. The ratio of two such functions has
    at most two stationary points per turn, in closed form; the least tipping load is at one of
    them, at an end of the range, or is zero because the machine tips over unloaded on the way.

    Args:
        machine: Machine with a support polygon; payloads that it carries already count.
        q: Coordinates of the other joints, shape (n,) [rad or m].
        ground: Ground on which the machine stands.
        joint: Name of a planned revolute or continuous joint that moves itself only.
        frame: Name of the link (or other frame) that carries the mass.
        offset: Position of the mass in that frame, shape (3,) [m]; None is its origin.

    Raises:
        MachineError: No support polygon, an unknown frame, or a joint that others mimic.
    """
    if mimics := machine.mimics_of(joint):
        raise MachineError(f"joint {joint!r} does not turn alone: joint {mimics[0]!r} mimics it")
    index = machine.joint_names.index(joint)
    poses = np.repeat(np.asarray(q, dtype=np.float64)[None], 3, axis=0)
    poses[:, index] = 2.0 * np.pi * np.arange(3) / 3.0  # they tell first harmonics exactly
    samples = _moments(machine, poses, ground, frame, offset)  # two arrays of shape (3, V)
    unloaded, per_mass = (_first_harmonics(values, poses[:, index]) for values in samples)
    range_ = (machine.limits.position_lower[index], machine.limits.position_upper[index])
    turns = _within(range_, np.append(_stationary(unloaded, per_mass).ravel(), float(q[index])))
    basis = np.column_stack([np.ones_like(turns), np.cos(turns), np.sin(turns)])
    return _least(basis @ unloaded, basis @ per_mass, turns)


def frame_index(machine: Machine, frame: str) -> int:
    """Index of a frame in the Pinocchio model; a link takes precedence over a joint of this name.

    Raises:
        MachineError: An unknown frame; the message lists the links.
    """
    model = machine.model
    links = [found.name for found in model.frames if found.type == pin.FrameType.BODY]
    if frame in links:
        return int(model.getFrameId(frame, pin.FrameType.BODY))
    if not model.existFrame(frame):
        raise MachineError(f"there is no frame {frame!r}; links are {', '.join(links)}")
    return int(model.getFrameId(frame))


def frame_position(machine: Machine, q: Array, frame: str, offset: Array | None = None) -> Array:
    """Position of a point fixed to a frame, root frame, shape (K, 3) [m].

    Args:
        machine: The machine.
        q: Joint coordinates, shape (K, n) [rad or m].
        frame: Name of the link (or other frame).
        offset: Position in that frame, shape (3,) [m]; None is its origin.

    Raises:
        MachineError: An unknown frame; the message lists the links.
    """
    model, index = machine.model, frame_index(machine, frame)
    point = np.zeros(3) if offset is None else np.asarray(offset, dtype=np.float64)
    data, found = model.createData(), []
    for row in machine.configuration(q):
        pin.forwardKinematics(model, data, row)
        found.append(pin.updateFramePlacement(model, data, index).act(point))
    return np.array(found).reshape(-1, 3)


def _moments(
    machine: Machine, q: Array, ground: Ground, frame: str, offset: Array | None
) -> tuple[Array, Array]:
    """Moments about the edges at rest: unloaded [N m] and per payload [N m / kg], (K, V) each."""
    support = _supported(machine)
    gravity, still = ground.gravity(), np.zeros_like(q)
    root = np.concatenate([-gravity, np.zeros(3)])
    rows = support.wrench_rows()  # (V, 6)
    wrench = ground_reaction(machine, q, still, still, root_acceleration=root)  # (K, 6)
    point = frame_position(machine, q, frame, offset)
    force = np.broadcast_to(-gravity, point.shape)
    return wrench @ rows.T, np.column_stack([force, np.cross(point, force)]) @ rows.T


def _supported(machine: Machine) -> SupportPolygon:
    if machine.support is None:
        raise MachineError(
            f"machine {machine.name!r} has no support polygon: {GIVE_SUPPORT.arguments}"
        )
    return machine.support


def _least(unloaded: Array, per_mass: Array, turns: Array | None = None) -> TippingLoad:
    """Least tipping load of K poses.

    Args:
        unloaded: Moments about the edges without payload, shape (K, V) [N m].
        per_mass: Moments of a payload of 1 kg, shape (K, V) [N m / kg].
        turns: Coordinates of the turning joint, shape (K,) [rad]; None if none turns.
    """
    outwards = per_mass > ROUNDING * np.abs(per_mass).max(initial=0.0)
    masses = np.full(unloaded.shape, np.inf)
    masses[outwards] = np.maximum(-unloaded[outwards] / per_mass[outwards], 0.0)
    # an edge whose moment is exceeded without any payload; of several, the most exceeded one
    excess = unloaded.max(axis=1)
    if excess.max() >= 0.0:
        pose = int(np.argmax(excess))
        mass, edge = 0.0, int(np.argmax(unloaded[pose]))
    else:
        pose, edge = (int(i) for i in np.unravel_index(np.argmin(masses), masses.shape))
        mass = float(masses[pose, edge])
    if not np.isfinite(mass):
        return TippingLoad(np.inf, -1)
    return TippingLoad(mass, edge, np.nan if turns is None else float(turns[pose]))


def _first_harmonics(values: Array, angles: Array) -> Array:
    """Coefficients of 1, cos and sin, shape (3, V), of values at three angles, shape (3, V)."""
    basis = np.column_stack([np.ones_like(angles), np.cos(angles), np.sin(angles)])
    return np.asarray(np.linalg.solve(basis, values))


def _stationary(top: Array, bottom: Array) -> Array:
    r"""Angles at which top / bottom and top are stationary, NaN where there are none.

    With top = a_0 + a_1 cos + a_2 sin and bottom = b_0 + b_1 cos + b_2 sin, the derivative of the
    ratio is zero where

    .. math:: (a_2 b_1 - a_1 b_2) + (a_2 b_0 - a_0 b_2) \cos + (a_0 b_1 - a_1 b_0) \sin = 0

    Args:
        top: Coefficients, shape (3, V).
        bottom: Coefficients, shape (3, V).

    Returns:
        Angles, shape (4, V) [rad].
    """
    (a0, a1, a2), (b0, b1, b2) = top, bottom
    constant, cosine, sine = a2 * b1 - a1 * b2, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    size = np.hypot(cosine, sine)
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.arccos(-constant / size)
    middle = np.arctan2(sine, cosine)
    crest = np.arctan2(a2, a1)  # top itself is largest here: the machine may tip over unloaded
    return np.array([middle - half, middle + half, crest, crest + np.pi])


def _within(limits: tuple[float, float], angles: Array) -> Array:
    """Ends of a joint's range and those angles, moved by whole turns, that lie between them.

    Of several whole turns the one nearest to zero is taken. A side that is not finite is no limit.
    """
    lower, upper = limits
    angles = angles[np.isfinite(angles)]
    moved = np.pi - np.mod(np.pi - angles, TURN)  # in (-pi, pi]
    if np.isfinite(lower):
        moved = moved + TURN * np.ceil(np.maximum(lower - moved, 0.0) / TURN)
    if np.isfinite(upper):
        moved = moved - TURN * np.ceil(np.maximum(moved - upper, 0.0) / TURN)
    inside = ~((moved < lower) | (moved > upper))  # NaN is no limit
    ends = np.array([end for end in limits if np.isfinite(end)])
    return np.concatenate([moved[inside], ends])
