"""Checks of the start and the goal: the machine must not tip over there or break a constraint.

No motion can begin or end in a state that fails these checks, so `Problem` refuses it before
anything is planned. Where a machine at rest tips over, the message names the largest payload and
the steepest slope with which it would not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ContactLost, ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.ground import Ground, Slope, Terrain
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.uncertainty import Corner
from zmp_sqp.mechanics.wrench import (
    WrenchDerivatives,
    efforts,
    ground_reaction,
    ground_reaction_derivatives,
)
from zmp_sqp.mechanics.zero_moment_point import zmp_of_wrench
from zmp_sqp.planning.constraints.guarantee import amount_in_words
from zmp_sqp.planning.constraints.protocol import MotionSample, PathConstraint
from zmp_sqp.planning.constraints.tip_over import supported
from zmp_sqp.planning.problem.zmp_words import edge_text, zmp_position

__all__ = [
    "check_at_rest",
    "check_constraints_at_rest",
    "check_in_motion",
    "gentler",
    "gravity_under",
    "largest_share",
    "stands_at_rest",
    "tilt_of",
]

TOLERANCE = 1e-9  # [m, or unit of a constraint] violation at rest that counts as rounding
HALVINGS = 20  # bisection steps: shares of payload and slope are found to 2^-20
LEAST_SHARE = 1e-6  # share of the payload that stands for none, because a payload needs a mass
Corners = Callable[[Machine, Ground], Iterable[Corner]]


class _RestingZmp(NamedTuple):
    """ZMP of a machine at rest, and the edge that it is nearest to or furthest beyond.

    Attributes:
        point: ZMP in the root frame, shape (2,) [m].
        edge: Index of the edge.
        distance: Signed distance from the edge to the ZMP, positive inside [m].
    """

    point: Array
    edge: int
    distance: float


@dataclass(frozen=True, slots=True)
class _RestPose:
    """Pose of a machine at rest, with the required margin.

    Attributes:
        q: Joint coordinates, shape (n,) [rad or m].
        pose: Pose x, y, yaw of a base that drives, shape (3,) [m, m, rad]; None for one that
            stands.
        margin: Required distance from the ZMP to every edge of the support polygon [m].
    """

    q: Array
    pose: Array | None
    margin: float

    def zmp(self, machine: Machine, ground: Ground) -> _RestingZmp:
        """ZMP of a machine at rest in this pose.

        Raises:
            ContactLost: Gravity points away from the ground.
        """
        support = supported(machine)
        still = np.zeros((1, len(self.q)))
        root = np.concatenate([-gravity_under(ground, self.pose), np.zeros(3)])
        wrench = ground_reaction(machine, self.q[None], still, still, root_acceleration=root)
        point = zmp_of_wrench(wrench, support.height)[0]
        beyond = support.normals @ point - support.offsets
        edge = int(np.argmax(beyond))
        return _RestingZmp(point, edge, -float(beyond[edge]))

    def stands(self, machine: Machine, ground: Ground) -> bool:
        """Whether the ZMP has the required margin."""
        try:
            return self.margin - self.zmp(machine, ground).distance <= TOLERANCE
        except ContactLost:
            return False


def stands_at_rest(
    corners: tuple[Corner, ...], q: Array, *, pose: Array | None, margin: float
) -> bool:
    """Whether a machine keeps its margin at rest in a pose: `check_at_rest` without its reasons.

    Args:
        corners: Extremes of payload and slope; all must be safe.
        q, pose, margin: As for `check_at_rest`.
    """
    rest = _RestPose(q, pose, margin)
    return all(rest.stands(corner.machine, corner.ground) for corner in corners)


def check_at_rest(
    name: str,
    machine: Machine,
    ground: Ground,
    corners: Corners,
    q: Array,
    *,
    pose: Array | None,
    margin: float,
) -> None:
    """Refuse a pose at rest in which the machine tips over or the ZMP misses its margin.

    Args:
        name: "start" or "goal", for the message.
        machine: The machine with its nominal payload.
        ground: The ground with its nominal slope.
        corners: Extremes of payload and slope for a machine on a ground; all must be safe.
        q: Joint coordinates, shape (n,) [rad or m].
        pose: Pose x, y, yaw of a base that drives, shape (3,) [m, m, rad]; None for one that
            stands.
        margin: Required distance from the ZMP to every edge of the support polygon [m].

    Raises:
        ProblemError: The margin is missed; the message gives the ZMP, the edge, the distance, and
            the payload and the slope that would be possible. Or gravity may point away from the
            ground, because the slope is too uncertain.
    """
    rest, worst = _RestPose(q, pose, margin), TOLERANCE
    found: tuple[Corner, _RestingZmp] | None = None
    for corner in corners(machine, ground):
        try:
            zmp = rest.zmp(corner.machine, corner.ground)
        except ContactLost:
            raise ProblemError(
                f"at rest at the {name}{_extreme(corner)}, gravity would point away from the "
                "ground: give a gentler slope or a smaller slope_uncertainty"
            ) from None
        if margin - zmp.distance > worst:
            worst, found = margin - zmp.distance, (corner, zmp)
    if found is None:
        return

    def stands(machine: Machine, ground: Ground) -> bool:
        return all(
            rest.stands(extreme.machine, extreme.ground) for extreme in corners(machine, ground)
        )

    raise ProblemError(
        f"{_tips_over_at_rest(name, *found, margin)}{_possible_instead(machine, ground, stands)}"
    )


def _tips_over_at_rest(name: str, corner: Corner, zmp: _RestingZmp, margin: float) -> str:
    """Sentence about a pose at rest whose ZMP is outside the polygon or misses the margin."""
    fault = "tips over" if zmp.distance < 0.0 else f"misses the margin of {margin:.10g} m"
    position = zmp_position(
        supported(corner.machine), zmp.edge, distance=zmp.distance, margin=margin
    )
    return (
        f"the machine {fault} at rest at the {name}{_extreme(corner)}: "
        f"its ZMP, x forward {zmp.point[0]:.3f} m and y left {zmp.point[1]:.3f} m, {position}"
    )


def check_in_motion(
    name: str, corners: tuple[Corner, ...], q: Array, v: Array, *, margin: float
) -> None:
    r"""Refuse a state in motion from which no acceleration of the joints keeps the machine upright.

    The row of an edge is affine in the joint accelerations a: it is r + s . a, positive where the
    ZMP violates the margin. No acceleration within its limits makes it zero or less if

    .. math:: r - |s| \cdot a_{max} > 0

    One such edge proves that no safe motion passes through the state.

    Args:
        name: "start" or "goal", for the message.
        corners: Extremes of payload and slope.
        q: Joint coordinates, shape (n,) [rad or m].
        v: Joint rates, shape (n,) [rad/s or m/s].
        margin: Required distance from the ZMP to every edge of the support polygon [m].

    Raises:
        ProblemError: The proof succeeds for an edge; the message names it.
    """
    for corner in corners:
        machine = corner.machine
        if machine.support is None:
            continue
        root = np.concatenate([-corner.ground.gravity(), np.zeros(3)])
        found = ground_reaction_derivatives(
            machine, q[None], v[None], 0.0 * q[None], root_acceleration=root
        )
        least = _least_rows(machine, found, margin)
        edge = int(np.argmax(least))
        tolerance = TOLERANCE * abs(float(found.wrench[0, 2]))
        if least[edge] > tolerance:
            tips = _least_rows(machine, found, 0.0)[edge] > tolerance
            fault = "tips over" if tips else f"misses the margin of {margin:.10g} m"
            leads = "leaves the support polygon across" if tips else "is too close to"
            raise ProblemError(
                f"the machine {fault} at the {name}{_extreme(corner)} whatever its joints do "
                "within their acceleration limits: at these rates the ZMP "
                f"{leads} {edge_text(machine.support, edge)}"
            )


def _least_rows(machine: Machine, found: WrenchDerivatives, margin: float) -> Array:
    """Least row of each edge over all joint accelerations within their limits, shape (V,) [N m].

    Args:
        machine: The machine.
        found: Wrench of one state with its derivatives, at joint accelerations zero.
        margin: Required distance from the ZMP to every edge of the support polygon [m].
    """
    rows = supported(machine).wrench_rows(margin)
    by_joints = rows @ found.wrt_acceleration[0, :, 6:]  # (V, n)
    return np.asarray(rows @ found.wrench[0] - np.abs(by_joints) @ machine.limits.acceleration)


def check_constraints_at_rest(
    name: str,
    corners: tuple[Corner, ...],
    constraints: Sequence[PathConstraint],
    coordinates: Coordinates,
    q: Array,
    *,
    pose: Array | None,
) -> None:
    """Refuse a pose at rest that breaks a path constraint.

    Args:
        name: "start" or "goal", for the message.
        corners: Extremes of payload and slope.
        constraints: The path constraints beside tip-over.
        coordinates: Map from planning coordinates to joint coordinates.
        q: Joint coordinates, shape (n,) [rad or m].
        pose: Pose x, y, yaw of a base that drives, shape (3,) [m, m, rad]; None for one that
            stands.

    Raises:
        ProblemError: A constraint is broken; the message says which, and by how much.
    """
    still = np.zeros((1, len(q)))
    for corner in corners if constraints else ():
        root = np.concatenate([-gravity_under(corner.ground, pose), np.zeros(3)])
        found = efforts(corner.machine, q[None], still, still, root_acceleration=root)
        sample = MotionSample(corner.machine, q[None], still, still, found)
        for constraint in constraints:
            rows = constraint.rows(corner.machine, coordinates)
            room = rows.room(sample)[0]
            worst = int(np.argmin(room))
            if room[worst] < -TOLERANCE:
                what = f"constraint {constraint.name} ({rows.labels[worst]})"
                at_rest = f"at rest at the {name}{_extreme(corner)}"
                if not np.isfinite(room[worst]):
                    raise ProblemError(f"{what} has no value {at_rest}")
                short = amount_in_words(float(-room[worst]), rows.units[worst])
                raise ProblemError(f"{what} is violated by {short} {at_rest}")


def _extreme(corner: Corner) -> str:
    """Payload and slope of a corner, in words that follow a sentence; empty if all is certain."""
    return f" with {corner.text}" if corner.text else ""


def gravity_under(ground: Ground, pose: Array | None) -> Array:
    """Gravity in the root frame of a machine at rest, shape (3,) [m/s^2].

    Args:
        ground: The ground.
        pose: Pose x, y, yaw of a base that drives, shape (3,) [m, m, rad]; None for one that
            stands at x = y = yaw = 0.
    """
    if pose is None or not isinstance(ground, Terrain):
        return ground.gravity()
    rest = np.zeros((1, 2))
    return np.asarray(-ground.base_motion(pose[None], rest, rest).acceleration[0, :3])


def _possible_instead(
    machine: Machine, ground: Ground, stands: Callable[[Machine, Ground], bool]
) -> str:
    """Largest payload and steepest slope that a pose allows; empty if neither would be enough.

    Args:
        machine: The machine with its nominal payload.
        ground: The nominal ground; if it is a Slope, gentler ones are tried.
        stands: Whether a machine is safe on a ground, whatever is uncertain of them.

    Returns:
        Words to append to a sentence, beginning with a semicolon.
    """
    parts = []
    if machine.payload_mass > 0.0:
        share = largest_share(
            lambda mu: stands(machine.with_payload_scaled(max(mu, LEAST_SHARE)), ground)
        )
        if share is not None:
            heaviest = np.floor(share * machine.payload_mass)
            parts.append(f"the payload could be at most {heaviest:.0f} kg")
    if isinstance(ground, Slope) and (ground.roll or ground.pitch):
        share = largest_share(lambda part: stands(machine, gentler(ground, part)))
        if share is not None:
            steepest = np.floor(10.0 * np.degrees(tilt_of(gentler(ground, share)))) / 10.0
            parts.append(f"the slope could be at most {steepest:.1f} degrees")
    return f"; in this pose {', or '.join(parts)}" if parts else ""


def gentler(ground: Slope, share: float) -> Slope:
    """Slope with roll and pitch multiplied by a share between 0 and 1."""
    return Slope(share * ground.roll, share * ground.pitch)


def tilt_of(ground: Slope) -> float:
    """Angle between the ground and the horizontal plane [rad]."""
    return float(np.arccos(np.cos(ground.roll) * np.cos(ground.pitch)))


def largest_share(feasible: Callable[[float], bool], *, halvings: int = HALVINGS) -> float | None:
    """Largest share between 0 and 1 that is feasible, by bisection; None if 0 is not.

    Args:
        feasible: Whether a share is feasible; every share below a feasible one is taken to be
            feasible, and 1 is taken not to be.
        halvings: Bisection steps. The result is feasible, and within 2^-halvings of the largest.
    """
    lower, upper = 0.0, 1.0
    if not feasible(lower):
        return None
    for _ in range(halvings):
        middle = 0.5 * (lower + upper)
        lower, upper = (middle, upper) if feasible(middle) else (lower, middle)
    return lower
