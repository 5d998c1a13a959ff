"""Whether a machine tips over at rest, and how much less payload or slope would keep it standing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ContactLost, ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.ground import Ground, Slope, Terrain
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.uncertainty import Corner
from zmp_sqp.mechanics.wrench import efforts, ground_reaction, ground_reaction_derivatives
from zmp_sqp.mechanics.zero_moment_point import zmp_of_wrench
from zmp_sqp.planning.constraints.guarantee import amount_in_words
from zmp_sqp.planning.constraints.protocol import MotionSample, PathConstraint

__all__ = [
    "check_at_rest",
    "check_constraints_at_rest",
    "check_in_motion",
    "gentler",
    "gravity_under",
    "largest_share",
    "possible_instead",
]

TOLERANCE = 1e-9  # [m] rounding that a ZMP at rest may stand outside
HALVINGS = 20  # of the share of payload or slope that a machine can stand
LEAST_SHARE = 1e-6  # of a payload that stands for none
Corners = Callable[[Machine, Ground], Iterable[Corner]]


@dataclass(frozen=True, slots=True)
class _Place:
    """A pose at rest: joint coordinates q, pose of a base that drives (3,), margin asked for [m]."""

    q: Array
    pose: Array | None
    margin: float

    def outside(self, machine: Machine, ground: Ground) -> tuple[float, int, Array]:
        """How far the ZMP stands outside the polygon less the margin [m], the worst edge, and the ZMP [m]."""
        support = machine.support
        if support is None:
            raise ProblemError(f"machine {machine.name!r} has no support polygon")
        still, root = (
            np.zeros((1, len(self.q))),
            np.concatenate([-gravity_under(ground, self.pose), np.zeros(3)]),
        )
        point = zmp_of_wrench(
            ground_reaction(machine, self.q[None], still, still, root_acceleration=root),
            support.height,
        )[0]
        over = support.normals @ point - support.offsets
        edge = int(np.argmax(over))
        return float(over[edge]) + self.margin, edge, point

    def stands(self, machine: Machine, ground: Ground) -> bool:
        try:
            return self.outside(machine, ground)[0] <= TOLERANCE
        except ContactLost:
            return False


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
    """Refuse a pose that tips over at rest: no motion starts or ends there.

    Args:
        name: What the message calls it: start or goal.
        machine: As it should be.
        ground: Likewise.
        corners: Payloads and slopes that such a machine on such a ground must stand.
        q: Joint coordinates, shape (n,).
        pose: Of a base that drives, x, y, yaw, shape (3,) [m, rad]; None stands as the ground says.
        margin: Kept from the edges [m].

    Raises:
        ProblemError: It tips over; the message gives ZMP, edge, by how much, and what it could
            stand. Or the slope is so uncertain that gravity may point away from the ground.
    """
    place, worst = _Place(q, pose, margin), TOLERANCE
    found: tuple[Corner, int, Array] | None = None
    for corner in corners(machine, ground):
        try:
            over, edge, point = place.outside(corner.machine, corner.ground)
        except ContactLost:
            extreme, _ = _circumstances(corner, margin)
            raise ProblemError(
                f"the machine falls off the ground at rest at the {name}{extreme}: gravity would point away from the "
                "ground; give a gentler slope, or less slope_uncertainty"
            ) from None
        if over > worst:
            worst, found = over, (corner, edge, point)
    if found is None or machine.support is None:
        return
    corner, edge, point = found
    extreme, kept = _circumstances(corner, margin)

    def stands(machine: Machine, ground: Ground) -> bool:
        return all(
            place.stands(extreme.machine, extreme.ground) for extreme in corners(machine, ground)
        )

    raise ProblemError(
        f"the machine tips over at rest at the {name}{extreme}: its ZMP ({point[0]:.3f}, {point[1]:.3f}) m lies "
        f"{worst:.3f} m outside the {machine.support.edge_name(edge)} edge of the support polygon{kept}"
        f"{possible_instead(machine, ground, stands)}"
    )


def check_in_motion(
    name: str, corners: tuple[Corner, ...], q: Array, v: Array, *, margin: float
) -> None:
    r"""Refuse a state in motion that tips over whatever the joints do within their acceleration limits.

    A row of the wrench is affine in the accelerations, r + s . a, so that

    .. math:: r - |s| \cdot a_{max} > 0

    for a single edge proves that no motion passes there safely.

    Raises:
        ProblemError: It is proven; the message names the edge.
    """
    for corner in corners:
        machine = corner.machine
        if machine.support is None:
            continue
        root = np.concatenate([-corner.ground.gravity(), np.zeros(3)])
        found = ground_reaction_derivatives(
            machine, q[None], v[None], 0.0 * q[None], root_acceleration=root
        )
        rows = machine.support.wrench_rows(margin)
        best = (
            rows @ found.wrench[0]
            - np.abs(rows @ found.wrt_acceleration[0, :, 6:]) @ machine.limits.acceleration
        )
        edge = int(np.argmax(best))
        if best[edge] > TOLERANCE * abs(found.wrench[0, 2]):
            extreme, kept = _circumstances(corner, margin)
            raise ProblemError(
                f"the machine tips over at the {name}{extreme} whatever its joints do within their acceleration "
                f"limits: at these rates the ZMP leaves the {machine.support.edge_name(edge)} edge of the support "
                f"polygon{kept}"
            )


def check_constraints_at_rest(
    name: str,
    corners: tuple[Corner, ...],
    constraints: Sequence[PathConstraint],
    coordinates: Coordinates,
    q: Array,
    *,
    pose: Array | None,
) -> None:
    """Refuse a pose at rest that breaks a path constraint: no motion starts or ends there.

    Args:
        name: What the message calls the pose: start or goal.
        corners: Extremes of payload and slope.
        constraints: The path constraints beside tip-over.
        coordinates: From planning coordinates to joints.
        q: Joint coordinates, shape (n,).
        pose: Of a base that drives, x, y, yaw, shape (3,) [m, rad]; None stands as the ground says.

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
                extreme, _ = _circumstances(corner, 0.0)
                what = f"constraint {constraint.name} ({rows.labels[worst]})"
                at_rest = f"at rest at the {name}{extreme}"
                if not np.isfinite(room[worst]):
                    raise ProblemError(f"{what} has no value {at_rest}")
                short = amount_in_words(float(-room[worst]), rows.units[worst])
                raise ProblemError(f"{what} is broken {at_rest}, by {short}")


def _circumstances(corner: Corner, margin: float) -> tuple[str, str]:
    """Payload and slope, and the margin, in words; empty where there is nothing to say."""
    return (
        f" with {corner.text}" if corner.text else "",
        f" less the margin of {margin:.3g} m" if margin else "",
    )


def gravity_under(ground: Ground, pose: Array | None) -> Array:
    """Gravity in the root frame of a machine whose base rests at a pose (3,), or stands (None), shape (3,) [m/s^2]."""
    if pose is None or not isinstance(ground, Terrain):
        return ground.gravity()
    rest = np.zeros((1, 2))
    return np.asarray(-ground.base_motion(pose[None], rest, rest).acceleration[0, :3])


def possible_instead(
    machine: Machine, ground: Ground, stands: Callable[[Machine, Ground], bool]
) -> str:
    """What payload and what slope would do, in words, with a semicolon in front; empty if neither would.

    Args:
        machine: With its payload, if it has one, as it should be.
        ground: If it is a Slope, gentler ones are tried.
        stands: Whether a machine on a ground is safe for all that is uncertain of them.
    """
    parts = []
    if machine.payload_mass > 0.0:
        share = largest_share(
            lambda mu: stands(machine.with_payload_scaled(max(mu, LEAST_SHARE)), ground)
        )
        if share is not None:
            parts.append(
                f"the payload could be at most {np.floor(share * machine.payload_mass):.0f} kg"
            )
    if isinstance(ground, Slope) and (ground.roll or ground.pitch):
        share = largest_share(lambda part: stands(machine, gentler(ground, part)))
        if share is not None:
            # rounded towards the gentler
            tilt = np.degrees(np.arccos(np.cos(share * ground.roll) * np.cos(share * ground.pitch)))
            parts.append(f"the slope at most {np.floor(10.0 * tilt) / 10.0:.1f} degrees")
    return f"; there {', or '.join(parts)}" if parts else ""


def gentler(ground: Slope, share: float) -> Slope:
    """The slope with roll and pitch times a share."""
    return Slope(share * ground.roll, share * ground.pitch)


def largest_share(holds: Callable[[float], bool], *, halvings: int = HALVINGS) -> float | None:
    """Largest share in (0, 1) up to which something holds, by bisection; None if it does not hold at nothing.

    Args:
        holds: Whether it does at a share; taken to hold below any at which it does.
        halvings: Bits of the answer, which is on the safe side.
    """
    lower, upper = 0.0, 1.0
    if not holds(lower):
        return None
    for _ in range(halvings):
        middle = 0.5 * (lower + upper)
        lower, upper = (middle, upper) if holds(middle) else (lower, middle)
    return lower
