"""Certificate of a motion: guarantees that hold at all times, not only at samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from zmp_sqp.arrays import Array, finite_number
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.ground import Ground, Slope, is_uneven
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.uncertainty import Corner
from zmp_sqp.motion.root_motion import check_tracks, with_ground
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.constraints.binding import bound_rows, checked_constraints
from zmp_sqp.planning.constraints.guarantee import Guarantee
from zmp_sqp.planning.constraints.protocol import ConstraintRows, MotionSample, PathConstraint
from zmp_sqp.planning.constraints.tip_over import Contact, TipOver, supported
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.undercarriage import Standing
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase
from zmp_sqp.planning.proof.base_check import base_guarantees
from zmp_sqp.planning.proof.corner_efforts import CornerEfforts, grouped
from zmp_sqp.planning.proof.corner_motion import CornerMotion, MotionEfforts, is_proven, row_scale
from zmp_sqp.planning.proof.effort_curves import EffortCurves
from zmp_sqp.planning.proof.limits_in_time import joints_least_duration, limit_guarantee
from zmp_sqp.planning.proof.motion_checks import check_arguments, check_drift, reason_of_doubt
from zmp_sqp.planning.proof.subdivision import ROUNDING, LeastValue, Wanted, subdivide
from zmp_sqp.planning.proof.words import fault_of

__all__ = ["Certificate", "certify", "certify_at", "certify_for"]

SAMPLING = 2000.0  # [1/s] rate at which rows without a bound between samples are sampled
MOST_SAMPLES = 400_000  # largest number of these samples, which limits time and memory
LIMITS = ("joint_limits", "base")


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """Guarantees for a motion that hold at all times.

    Attributes:
        guarantees: One per constraint: "tip_over", "contact", the problem's own constraints by
            name, "joint_limits", and several of the name "base" if the base's limits are given.
        edge: Index of the edge of the support polygon that the zero moment point comes nearest to.
        sampled: Least sampled distance from this edge; the guaranteed distance is below it [m].
        limit_excess: Largest excess over a limit of the joints or the base; zero or negative if
            all limits are kept, infinite if the base does not start or end as required [rad or m,
            per second, per second squared].
        gap: duration / lower bound - 1, where the lower bound is the least duration within the
            limits of joints and base alone; zero if there is none (a limit is missing, or a rate at
            the start or the end exceeds its limit).
        required: Required margin [m].
        doubt: Why no margin can be proven although every sample has one, in words; empty if a
            margin is proven.
    """

    guarantees: tuple[Guarantee, ...]
    edge: int
    sampled: float
    limit_excess: float
    gap: float
    required: float
    doubt: str = ""

    @classmethod
    def of_nothing(cls, required: float) -> Certificate:
        """Certificate of a motion that could not be made: nothing is guaranteed."""
        rows = (("tip_over", "", "m"), ("joint_limits", "", ""))
        guarantees = tuple(
            Guarantee(name, label, -np.inf, unit, 0.0, "", proven=False)
            for name, label, unit in rows
        )
        return cls(guarantees, 0, -np.inf, np.inf, 0.0, required)

    @property
    def is_of_nothing(self) -> bool:
        """Whether no motion was looked at, see `of_nothing`."""
        return not self.tip_over.label

    @property
    def tip_over(self) -> Guarantee:
        """Guarantee of the distance from the zero moment point to the nearest edge."""
        return next(found for found in self.guarantees if found.name == "tip_over")

    @property
    def margin(self) -> float:
        """Guaranteed least signed distance from the zero moment point to an edge [m].

        It is -inf if the ground may have to pull at the machine.
        """
        return self.tip_over.value

    @property
    def margin_at(self) -> float:
        """Time of the least sampled distance [s]."""
        return self.tip_over.time

    @property
    def corner(self) -> str:
        """Payload and slope for which the margin is least; empty if nothing is uncertain."""
        return self.tip_over.corner

    @property
    def broken(self) -> tuple[Guarantee, ...]:
        """Guarantees that are below the required values."""
        return tuple(found for found in self.guarantees if not found.kept)

    @property
    def limits_ok(self) -> bool:
        """Whether the motion keeps the limits of joints and base, and the base's start and goal."""
        return all(found.kept for found in self.guarantees if found.name in LIMITS)

    @property
    def fault(self) -> str:
        """The first constraint that is not kept, in words that follow "the motion"; or empty."""
        order = sorted(self.broken, key=lambda found: found.name != "joint_limits")
        words = (fault_of(found) for found in order if found.name not in ("tip_over", "contact"))
        return next(words, "")

    @property
    def safe(self) -> bool:
        """Whether all constraints are kept at all times, tip-over with a margin of at least 0."""
        return not self.broken


def certify(
    machine: Machine,
    trajectory: Trajectory,
    ground: Ground,
    margin: float = 0.0,
    *,
    base: UnicycleBase | None = None,
    spread: float = 0.0,
    constraints: Sequence[PathConstraint] = (),
) -> Certificate:
    """Certificate of any trajectory of the machine, whether it was planned here or not.

    It does not ask that the motion begin and end at rest, or at any place.

    Time is cut into stretches. Inside a stretch the ground reaction is close to a polynomial
    (`effort_curves`), or over uneven ground to a straight line (`effort_chords`), whose control
    points bound the rows of the constraints. A stretch whose bound is too loose is cut further.
    Guarantees are reduced by bounds on all errors, rounding included.

    Args:
        machine: Machine with a support polygon.
        trajectory: Motion of the joints of the machine, and of its base if it drives.
        ground: Ground that the machine stands or drives on.
        margin: Required distance from every edge [m].
        base: Limits, x and y bounds, start and goal that the base's motion is checked against; None
            checks none of them.
        spread: Mass of a payload times the squared distance by which its centre of mass may be
            displaced, if this machine is one corner of an uncertain one: the margin is reduced
            by the effect of that displacement in motion [kg m^2].
        constraints: Path constraints beside tip-over and the limits.

    Raises:
        MachineError: No machine, or no support polygon.
        ProblemError: The trajectory has other joints; margin, spread or gravity are not numbers;
            the spread is negative; a constraint does not fit the machine; or the base moves on
            ground that is no terrain, off its map, over ground that its tracks cannot follow, or
            not at all although it has limits.
        TrajectoryError: No trajectory, or one whose nodes drift away from what its accelerations
            produce.
    """
    if (spread := finite_number(spread, name="spread", error=ProblemError)) < 0.0:
        raise ProblemError(f"spread must not be negative, not {spread:g} kg m^2")
    corner, given = Corner(machine, ground, "", spread), checked_constraints(constraints)
    return certify_at((corner,), trajectory, margin, base=base, constraints=given)


def certify_for(problem: Problem, trajectory: Trajectory, *, anywhere: bool = False) -> Certificate:
    """Certificate of a motion for every payload and slope that a problem allows.

    The wrench is affine in the payload's mass and in gravity, so that rows which are kept at the
    corners of both are kept between them. The effect of a displaced centre of mass that is not
    affine is bounded by `moment_of_spread`.

    Args:
        problem: Its margin, base, constraints and uncertainties are used, not its start and goal.
        trajectory: The motion.
        anywhere: Whether a base that drives may end anywhere instead of at its goal.
    """
    base = problem.base
    if anywhere and base is not None and trajectory.base is not None:
        base = replace(base, goal=trajectory.base.poses[-1], goal_velocity=None)
    return certify_at(
        problem.corners(every=True),
        trajectory,
        problem.margin,
        base=base,
        constraints=problem.own_constraints,
        coordinates=problem.coordinates,
    )


def certify_at(
    corners: Sequence[Corner],
    trajectory: Trajectory,
    margin: float,
    *,
    base: UnicycleBase | None = None,
    constraints: Sequence[PathConstraint] = (),
    coordinates: Coordinates | None = None,
    limit_allowance: Array | None = None,
) -> Certificate:
    """Certificate of a motion at several corners of payload and slope: the least guarantees.

    Args:
        corners: At least one.
        trajectory, margin, base, constraints: Arguments of `certify`.
        coordinates: Planning coordinates that constraints of the simplified model need; None if
            the joints themselves were planned.
        limit_allowance: Excess over joint limits that counts as kept, see `limit_guarantee`.
    """
    first = corners[0]
    check_arguments(first.machine, trajectory, first.ground)
    driven = with_ground(trajectory, first.ground)
    if driven.base is not None:
        check_tracks(driven.base, supported(first.machine))
    elif is_uneven(first.ground):
        Standing(first.ground).check(first.machine, "full")
    check_drift(driven)
    required = finite_number(margin, name="margin", error=ProblemError)
    every: tuple[PathConstraint, ...] = (TipOver(), Contact(), *constraints)
    planned = coordinates or Coordinates.identity(first.machine.size)
    merged = _prove_all(corners, driven, required, every, planned)
    guarantees = [proof.guarantee for proof in merged]
    of_joints, excess = limit_guarantee(first.machine, trajectory, limit_allowance)
    guarantees.append(of_joints)
    least_duration = joints_least_duration(first.machine, trajectory)
    if base is not None:
        if driven.base is None:
            raise ProblemError(
                "`base` gives limits of a base that drives, but that of the trajectory stands"
            )
        of_base = base_guarantees(base, driven.base)
        guarantees += of_base
        missed = any(not row.kept and " " in row.label for row in of_base)
        excess = np.inf if missed else max(excess, *(-row.value for row in of_base))
        least_duration = max(least_duration, base.least_duration)
    return Certificate(
        guarantees=tuple(guarantees),
        edge=merged[0].row,
        sampled=merged[0].sampled,
        limit_excess=excess,
        gap=trajectory.duration / least_duration - 1.0 if least_duration > 0.0 else 0.0,
        required=required,
        doubt=merged[0].doubt,
    )


@dataclass(frozen=True, slots=True)
class _Proof:
    """Guarantee of one constraint at the worst of some corners.

    Attributes:
        guarantee: The guarantee.
        scaled: Value of the guarantee in the unit of the constraint's first row; compares corners.
        sampled: Least sampled value, in the unit of the guarantee.
        row: Row of the constraint that has the least sampled value.
        doubt: Why nothing can be proven although all samples are finite; empty otherwise.
    """

    guarantee: Guarantee
    scaled: float
    sampled: float
    row: int
    doubt: str


def _prove_all(
    corners: Sequence[Corner],
    driven: Trajectory,
    required: float,
    constraints: Sequence[PathConstraint],
    planned: Coordinates,
) -> list[_Proof]:
    """Least guarantee of each constraint at any corner.

    Args:
        corners: At least one.
        driven: The motion, its base on the first corner's ground.
        required: Required margin [m].
        constraints: All constraints, tip-over first.
        planned: Planning coordinates.
    """
    proofs: list[dict[int, _Proof]] = []
    for number, group in enumerate(grouped(corners, driven)):
        rows_of = {
            id(corner.machine): bound_rows(constraints, corner.machine, planned)
            for corner in {id(corner.machine): corner for corner in group}.values()
        }
        rows = [
            [rows_of[id(corner.machine)][i] for corner in group] for i in range(len(constraints))
        ]
        # rows that do not depend on the corner are proven with the first one
        kept = [i for i, part in enumerate(rows) if number == 0 or part[0].per_corner]
        asked = [required if constraints[i].name == "tip_over" else 0.0 for i in kept]
        names = [constraints[i].name for i in kept]
        found = _prove(group, driven, asked, names, [rows[i] for i in kept])
        proofs.append(dict(zip(kept, found, strict=True)))
    return [
        min((found[i] for found in proofs if i in found), key=lambda proof: proof.scaled)
        for i in range(len(constraints))
    ]


def _prove(
    corners: Sequence[Corner],
    trajectory: Trajectory,
    asked: Sequence[float],
    names: Sequence[str],
    rows: Sequence[Sequence[ConstraintRows]],
) -> list[_Proof]:
    """Guarantees of constraints at corners that can be proven together.

    Args:
        corners: Corners, see `grouped`.
        trajectory: The motion.
        asked: Required value of each constraint.
        names: Name of each constraint.
        rows: Rows of each constraint at each corner.
    """
    trajectory = with_ground(trajectory, corners[0].ground)
    joints = any(part[0].needs_joint_efforts for part in rows)
    standing = trajectory.base is None or isinstance(trajectory.base.ground, Slope)
    with np.errstate(all="ignore"):  # bounds that overflow give no guarantee
        efforts: MotionEfforts
        if standing:
            efforts = EffortCurves.of(CornerEfforts(corners, trajectory, joints))
        else:
            from zmp_sqp.planning.proof.effort_chords import EffortChords  # only needed here

            efforts = EffortChords.of(corners[0], trajectory, joints=joints)
        motion = CornerMotion(corners, trajectory, efforts, rows)
        wanted = [
            Wanted(value, efforts.fineness * float(part[0].resolution[0]))
            for value, part in zip(asked, rows, strict=True)
        ]
        least = subdivide(motion.first_parts, motion.values, wanted)
        found = []
        for name, part, value, margin in zip(names, rows, least, asked, strict=True):
            piece, corner = motion.numbers(value.interval)
            if not is_proven(part[corner], trajectory):
                _sample_densely(part[corner], corners[corner].machine, trajectory, value)
            elif efforts.exhausted:
                _recompute_sample(part[corner], motion, (piece, corner), value)
            found.append(_proof(name, part[corner], value, motion, corners[corner], margin))
    return found


def _proof(
    name: str,
    rows: ConstraintRows,
    least: LeastValue,
    motion: CornerMotion,
    corner: Corner,
    required: float,
) -> _Proof:
    """Guarantee of one constraint from its least value."""
    scale, doubt = float(row_scale(rows)[least.row]), ""
    guaranteed = least.guaranteed if not np.isnan(least.guaranteed) else -np.inf
    if np.isneginf(guaranteed) and np.isfinite(least.sampled):
        exhausted = least.exhausted or motion.efforts.exhausted
        doubt = reason_of_doubt(motion, exhausted=exhausted)
    scaled = guaranteed - ROUNDING
    guarantee = Guarantee(
        name=name,
        label=rows.labels[least.row],
        value=scaled * scale,
        unit=rows.units[least.row],
        time=least.time,
        corner=corner.text,
        proven=is_proven(rows, motion.trajectory),
        required=required,
    )
    return _Proof(guarantee, scaled, least.sampled * scale, least.row, doubt)


def _recompute_sample(
    rows: ConstraintRows, motion: CornerMotion, at: tuple[int, int], least: LeastValue
) -> None:
    """Replace the sampled value, which polynomials gave, by inverse dynamics at its time.

    Args:
        rows: Rows of the constraint.
        motion: The motion.
        at: Piece and corner of the least sampled value.
        least: Holds that value.
    """
    interval = motion.efforts.interval[[at[0]]]
    since = np.array([least.time]) - motion.trajectory.times[interval]
    room = rows.room(motion.sample(at[1], interval, since))[0] / row_scale(rows)
    least.sampled, least.row = float(room.min()), int(room.argmin())


def _sample_densely(
    rows: ConstraintRows, machine: Machine, trajectory: Trajectory, least: LeastValue
) -> None:
    """Sample rows without a bound between samples at 2000 Hz, the least sample as guarantee."""
    steps = np.diff(trajectory.times)
    rate = min(SAMPLING, MOST_SAMPLES / max(trajectory.duration, 1.0 / SAMPLING))
    counts = np.maximum(np.ceil(steps * rate), 1.0).astype(int)
    interval = np.repeat(np.arange(len(steps)), counts)
    number = np.arange(len(interval)) - np.repeat(np.cumsum(counts) - counts, counts)
    since = number * (steps / counts)[interval]
    nothing: Array = np.zeros((len(interval), 0))
    sample = MotionSample(machine, *trajectory.state_in(interval, since), nothing)
    scaled = rows.room(sample) / row_scale(rows)
    at = int(scaled.min(axis=1).argmin())
    value = float(scaled[at].min())
    if value < least.sampled:
        least.sampled, least.row = value, int(scaled[at].argmin())
        least.time = float(trajectory.times[interval[at]] + since[at])
    least.guaranteed = least.sampled
