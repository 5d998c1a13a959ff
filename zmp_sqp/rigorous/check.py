"""A second opinion: decide anew, in ball arithmetic, what a motion guarantees at all times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf, isfinite
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number
from zmp_sqp.errors import GIVE_SUPPORT, MachineError, ProblemError, TrajectoryError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.ground import Ground, Slope
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.terrain.heightmap import Heightmap
from zmp_sqp.mechanics.uncertainty import Corner
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.constraints.binding import checked_constraints
from zmp_sqp.planning.constraints.protocol import PathConstraint
from zmp_sqp.planning.constraints.registry import TorqueLimits
from zmp_sqp.planning.constraints.tip_over import edge_label, supported
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase
from zmp_sqp.rigorous.balls import ORDER, working
from zmp_sqp.rigorous.base_in_balls import (
    BOUNDS_TOLERANCE,
    PathBounds,
    base_ends,
    base_limits,
)
from zmp_sqp.rigorous.base_path import PATH_ORDER
from zmp_sqp.rigorous.decide import Asked, Enclosure, decide
from zmp_sqp.rigorous.efforts_in_balls import EffortBalls
from zmp_sqp.rigorous.limits_in_balls import (
    PolynomialLimits,
    joint_limits,
    largest_jumps,
    with_allowance,
)
from zmp_sqp.rigorous.motion_series import MotionSeries, Stretch
from zmp_sqp.rigorous.root_series import PlaneRoot
from zmp_sqp.rigorous.terrain_root import TerrainRoot
from zmp_sqp.rigorous.verdict import RigorousCheck, RigorousGuarantee, Verdict

__all__ = ["check_rigorously"]

RESOLUTION = 1e-6  # [m] width of the enclosure of the least margin
LONGEST = max(ORDER + 3, PATH_ORDER + 1)  # largest number of coefficients of a series
NO_GROUND = "the base drives over ground that is neither a Slope nor a Heightmap"
NOT_KNOWN = "ball arithmetic knows tip-over, contact, torque limits, and limits of joints and base"


def check_rigorously(
    machine: Machine,
    trajectory: Trajectory,
    ground: Ground,
    margin: float = 0.0,
    *,
    base: UnicycleBase | None = None,
    constraints: Sequence[PathConstraint] = (),
    corners: Sequence[Corner] | None = None,
    limit_allowance: Array | None = None,
    progress: Callable[[int], None] | None = None,
) -> RigorousCheck:
    r"""Decide anew, in ball arithmetic, whether a motion keeps its guarantees at all times.

    It shares nothing with the certificate but the numbers of the machine and of the motion. Time is
    cut into stretches; on each, the kinematics are Taylor series about its middle whose remainders
    come from series over the ball of all its times, and the wrench from the ground is the rate of
    linear and angular momentum less the weights. All arithmetic is on balls with outward rounding
    (FLINT's Arb), so that neither "confirmed" nor "refuted" rests on floating point. Stretches are
    halved until every guarantee is decided and the least margin is enclosed within 1e-6 m.
    Placements, axes, masses and inertias count as exact, rotation matrices to a float's digits.
    "continuity" states that positions and rates jump by at most 1e-6 at the nodes. Limits of joints
    and base have the certificate's tolerances.

    Args:
        machine: Machine with a support polygon.
        trajectory: Motion of the machine; its base stands, or drives on a Slope or a Heightmap.
        ground: Ground that the machine stands or drives on.
        margin: Required distance from the zero moment point to every edge [m].
        base: Limits, bounds, start and goal of a base that drives; None checks none of them.
        constraints: Constraints beside these; `TorqueLimits` are decided, others not looked at.
        corners: Payloads and slopes in place of machine and ground alone, see `Problem.corners`.
        limit_allowance: Excess over joint limits that counts as kept, (4, n), see `certify_at`.
        progress: Called after every stretch of time with the number of those evaluated.

    Raises:
        MissingExtra: python-flint is not installed.
        MachineError: No machine, or no support polygon.
        ProblemError: Other joints, a margin that is no number, or limits of a base that stands.
        TrajectoryError: No trajectory.
    """
    _check(machine, trajectory, ground)
    margin = finite_number(margin, name="margin", error=ProblemError)
    every = tuple(corners) if corners else (Corner(machine, ground),)
    torque, others = _by_kind(checked_constraints(constraints))
    stretches = [Stretch(k, 0.0, 1.0) for k in range(trajectory.intervals)]
    with working(LONGEST) as flint:
        motion = MotionSeries(flint, trajectory)
        root = _root(flint, every[0], trajectory, motion)
        wrench = flint, every, trajectory, motion, root, torque, margin, stretches, progress
        found, count = _efforts(*wrench)
        rows = with_allowance(joint_limits(machine), limit_allowance)
        limits = PolynomialLimits(flint, motion, motion.joints, rows)
        found.append(_limits("joint_limits", limits, stretches))
        if base is not None:
            found += _base(flint, base, trajectory, motion, root, stretches)
        if root is not None:
            found.append(_continuity(flint, trajectory, motion, root))
    found += [_unseen(one.name, "", NOT_KNOWN) for one in others]
    return RigorousCheck(tuple(found), count)


def _by_kind(
    constraints: Sequence[PathConstraint],
) -> tuple[TorqueLimits | None, list[PathConstraint]]:
    """The strictest torque limits, from which the others follow, and constraints of other kinds."""
    limited = (one for one in constraints if isinstance(one, TorqueLimits))
    others = [one for one in constraints if not isinstance(one, TorqueLimits)]
    return min(limited, key=lambda one: one.share, default=None), others


def _check(machine: Any, trajectory: Any, ground: Any) -> None:
    """Raise for arguments of the wrong type, or a motion of another machine."""
    if not isinstance(machine, Machine):
        raise MachineError(
            f"machine must be a Machine (see load_machine), not {type(machine).__name__}"
        )
    if not isinstance(trajectory, Trajectory):
        raise TrajectoryError(f"trajectory must be a Trajectory, not {type(trajectory).__name__}")
    if isinstance(ground, type) or not isinstance(ground, Ground):
        raise ProblemError(f"ground must be a Slope or a Heightmap, not {ground!r}")
    if machine.support is None:
        raise MachineError(
            f"machine {machine.name!r} has no support polygon: {GIVE_SUPPORT.arguments}"
        )
    if trajectory.joint_names != machine.joint_names:
        raise ProblemError(
            f"the trajectory moves the joints {', '.join(trajectory.joint_names)}; the machine has "
            f"{', '.join(machine.joint_names)}"
        )


def _root(
    flint: Any, corner: Corner, trajectory: Trajectory, motion: MotionSeries
) -> PlaneRoot | TerrainRoot | None:
    """Motion of the root; None for a base that drives over ground of an unknown kind."""
    base = trajectory.base
    if base is None or isinstance(corner.ground, Slope):
        return PlaneRoot(flint, motion, base)
    if isinstance(corner.ground, Heightmap):
        height = flint.arb(supported(corner.machine).height)
        return TerrainRoot(flint, motion, base, corner.ground, height)
    return None


def _efforts(
    flint: Any,
    corners: Sequence[Corner],
    trajectory: Trajectory,
    motion: MotionSeries,
    root: PlaneRoot | TerrainRoot | None,
    torque: TorqueLimits | None,
    margin: float,
    stretches: Sequence[Stretch],
    progress: Callable[[int], None] | None,
) -> tuple[list[RigorousGuarantee], int]:
    """Guarantees of tip-over, contact and torque limits, and the number of stretches."""
    machine = corners[0].machine
    names = ["tip_over", "contact"] + (["torque_limits"] if torque is not None else [])
    if root is None:
        return [
            _undecided(name, margin if name == "tip_over" else 0.0, NO_GROUND) for name in names
        ], 0
    torques = None
    asked = [Asked(margin, RESOLUTION), Asked(0.0)]
    support = supported(machine)
    labels = [[edge_label(support, i) for i in range(len(support.vertices))]]
    units = [["m"] * len(labels[0]), ["N"]]
    labels.append(["normal force"])
    if torque is not None:
        torque.rows(machine, Coordinates.identity(machine.size))  # refuses joints without limits
        torques = torque.share * machine.limits.effort
        asked.append(Asked(0.0))
        turning = [unit == "rad" for unit in machine.joint_units]
        kinds = ["torque" if turns else "force" for turns in turning]
        pairs = zip(machine.joint_names, kinds, strict=True)
        labels.append([f"{joint} {kind}" for joint, kind in pairs] * 2)
        units.append(["of the limit"] * len(labels[-1]))
    evaluate = EffortBalls(flint, corners, trajectory, motion, root, torques)
    least, count = decide(stretches, evaluate, asked, progress)
    found = [
        _guarantee(
            name, label[one.row], unit[one.row], what.required, one, corners[one.corner].text
        )
        for name, label, unit, what, one in zip(names, labels, units, asked, least, strict=True)
    ]
    return found, count


def _limits(name: str, limits: PolynomialLimits, stretches: Sequence[Stretch]) -> RigorousGuarantee:
    """Guarantee of the limit with the least room beyond its tolerance."""
    if not limits.rows:
        return _unseen(name, "", "no limits are given")
    least, _ = decide(stretches, limits, limits.asked)
    found = [
        _guarantee(name, row.label, row.unit, what.required, one)
        for row, what, one in zip(limits.rows, limits.asked, least, strict=True)
    ]
    order = {Verdict.REFUTED: 0, Verdict.UNDECIDED: 1, Verdict.CONFIRMED: 2}
    return min(found, key=lambda one: (order[one.verdict], one.lower))


def _base(
    flint: Any,
    base: UnicycleBase,
    trajectory: Trajectory,
    motion: MotionSeries,
    root: PlaneRoot | TerrainRoot | None,
    stretches: Sequence[Stretch],
) -> list[RigorousGuarantee]:
    """Guarantees of a base's limits, bounds on x and y, start and goal."""
    if trajectory.base is None:
        raise ProblemError(
            "`base` gives limits of a base that drives, but that of the trajectory stands"
        )
    sources = list(zip(motion.speed, motion.yaw, strict=True))
    limits = PolynomialLimits(flint, motion, sources, base_limits(base))
    found = [_limits("base", limits, stretches)]
    for label, unit, end in base_ends(flint, base, trajectory.base):
        least = Enclosure(end.lower, end.upper, end.time, 0, 0)
        found.append(_guarantee("base", label, unit, 0.0, least))
    lower, upper = base.position_bounds
    if not (np.isfinite(lower).any() or np.isfinite(upper).any()):
        return found
    if root is None:
        return [*found, _undecided("base", -BOUNDS_TOLERANCE, NO_GROUND, label="x and y bounds")]
    bounds = PathBounds(flint, base, root, motion)
    asked = Asked(-BOUNDS_TOLERANCE)
    (least,), _ = decide(stretches, bounds, [asked])
    label = bounds.labels[least.row]
    return [*found, _guarantee("base", label, "m", asked.required, least)]


def _continuity(
    flint: Any, trajectory: Trajectory, motion: MotionSeries, root: PlaneRoot | TerrainRoot
) -> RigorousGuarantee:
    """Guarantee that positions and rates hardly jump at the nodes."""
    bound, labels = largest_jumps(flint, trajectory, motion, root)
    least = Enclosure(bound.lower, bound.upper, bound.time, bound.row, 0)
    return _guarantee("continuity", labels[bound.row], "", 0.0, least)


def _guarantee(
    name: str, label: str, unit: str, required: float, least: Enclosure, corner: str = ""
) -> RigorousGuarantee:
    """Guarantee with its verdict."""
    reason = ""
    if least.upper < required:
        verdict = Verdict.REFUTED
    elif least.lower >= required:
        verdict = Verdict.CONFIRMED
    else:
        verdict = Verdict.UNDECIDED
        reason = (
            f"between {least.lower:.9g} and {least.upper:.9g} {unit}".strip()
            if isfinite(least.lower)
            else "no bound was found on some stretch"
        )
    return RigorousGuarantee(
        name, label, verdict, required, least.lower, least.upper, unit, least.time, corner, reason
    )


def _undecided(name: str, required: float, reason: str, *, label: str = "") -> RigorousGuarantee:
    return RigorousGuarantee(
        name, label, Verdict.UNDECIDED, required, -inf, inf, "", 0.0, reason=reason
    )


def _unseen(name: str, label: str, reason: str) -> RigorousGuarantee:
    return RigorousGuarantee(
        name, label, Verdict.NOT_CHECKED, 0.0, -inf, inf, "", float(np.nan), reason=reason
    )
