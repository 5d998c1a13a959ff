"""Proof that a motion keeps its distance from tipping over at all times, not only at samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.bounds.payload_spread import moment_of_spread
from zmp_sqp.mechanics.bounds.wrench_bounds import (
    WrenchBound,
    wrench_bounds,
    wrench_curvature_bound,
)
from zmp_sqp.mechanics.ground import GRAVITY, Ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import ground_reaction
from zmp_sqp.motion.root_motion import check_tracks, root_motion, root_motion_bounds, with_ground
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase
from zmp_sqp.planning.proof.base_check import check_base
from zmp_sqp.planning.proof.limits_in_time import (
    LIMIT_TOLERANCE,
    joints_least_duration,
    limit_excess,
)
from zmp_sqp.planning.proof.motion_checks import check_arguments, check_drift, reason_of_doubt
from zmp_sqp.planning.proof.path_error import misplaced_root_bounds

__all__ = ["Certificate", "certify"]

STRETCHES = 6  # per interval to begin with
LONGEST = 0.05  # [s] of a stretch to begin with
FIRST = 20_000  # stretches to begin with, however long the motion is
MOST_PARTS = 16  # into which a stretch is cut whose bound is too loose
MAX_STATES = 200_000  # looked at before the bound is left as loose as it is
# by which more parts are made than a bound that falls with the square of the length asks for
HEADROOM = 1.2
LOOSE = 2e-4  # [m] by which the guaranteed margin may fall short of the sampled one
ROUNDING = 1e-9  # [m] taken off for floating point, on top of what is proven of inverse dynamics
# roundings that add up in a wrench: at most ten per joint and factor, and to spare
OPERATIONS = 100.0
EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """What is guaranteed for all t.

    Attributes:
        margin: Least signed distance from the ZMP to an edge, guaranteed; -inf if the ground may
            have to pull [m].
        margin_at: Time of the least sampled distance [s].
        edge: Index of the nearest edge there.
        sampled: Least sampled distance, which the guaranteed one falls short of [m].
        limits_ok: Whether rates, accelerations and positions stay within those joint limits that
            are known, in closed form.
        limit_excess: Largest excess over a joint limit; not positive inside [rad or m, per second,
            per second squared].
        gap: duration / lower bound - 1: how much longer than the fastest motion that only knows the
            joint limits; zero where there is no bound (a limit is missing, or the rates at the ends
            break one).
        required: Margin that was asked for [m].
        corner: The payload and slope for which the margin is least, in words; empty where nothing
            is uncertain.
        fault: Which limit the motion does not keep, or where it does not begin or end as asked, in
            words that follow "the motion"; empty if `limits_ok`.
        doubt: Why no margin at all can be proven although all samples have one, in words; empty
            where one is.
    """

    margin: float
    margin_at: float
    edge: int
    sampled: float
    limits_ok: bool
    limit_excess: float
    gap: float
    required: float
    corner: str = ""
    fault: str = ""
    doubt: str = ""

    @classmethod
    def of_nothing(cls, required: float) -> Certificate:
        """What is guaranteed of a motion that cannot be looked at."""
        return cls(
            -np.inf,
            0.0,
            0,
            -np.inf,
            limits_ok=False,
            limit_excess=np.inf,
            gap=0.0,
            required=required,
        )

    @property
    def safe(self) -> bool:
        """Whether the asked margin, but at least none, and the joint limits hold at all times."""
        return self.margin >= max(self.required, 0.0) and self.limits_ok


def certify(
    machine: Machine,
    trajectory: Trajectory,
    ground: Ground,
    margin: float = 0.0,
    *,
    base: UnicycleBase | None = None,
    spread: float = 0.0,
) -> Certificate:
    r"""Guaranteed stability margin of any trajectory of the machine, with its base's motion if it has one, ours or not.

    Time is cut into stretches. With r = e . p f_z - b f_z of an edge (linear in the wrench) and m
    the lesser of the two margins at a stretch's ends, h = r + m f_z is not positive at both ends,
    so that by the error of interpolation

    .. math:: \text{margin}(t) \ge m - \frac{\delta^2}{8} \frac{\max |\ddot h|}{\min f_z}

    where the curvature is bounded by `wrench_curvature_bound` over the stretch. Stretches whose
    bound is too loose where it matters are cut further. Rounding errors, bounded through
    `wrench_size_bound`, are taken off too.

    Args:
        machine: With a support polygon.
        trajectory: The motion; its joints must be the machine's.
        ground: What the machine stands on.
        margin: Distance from the edges that is asked for; stretches near it are looked at more
            closely [m].
        base: Limits, x and y bounds, start and goal that the base's motion is held to at all times;
            poses within 1e-5 m and rad of start and goal count as there, as for plans
            (`check_base`). None does not look.
        spread: Mass of a payload times the squared distance by which its centre of mass may be off,
            where this machine is a corner of what it may be: what `moment_of_spread` says is taken
            off [kg m^2].

    Raises:
        MachineError: No machine, or no support polygon.
        ProblemError: The trajectory has other joints, margin, spread or gravity are not numbers,
            the spread is negative, or the base moves on ground that is no terrain, off its map,
            over ground that its tracks cannot follow, or not at all although it has limits.
        TrajectoryError: No trajectory, or one whose nodes drift away from what its accelerations
            produce.
    """
    check_arguments(machine, trajectory, ground)
    trajectory = with_ground(trajectory, ground)
    if trajectory.base is not None:
        check_tracks(trajectory.base, machine.support)  # type: ignore[arg-type]
    check_drift(trajectory)
    required = finite_number(margin, name="margin", error=ProblemError)
    asked = max(required, 0.0)  # as in `Certificate.safe`
    if (spread := finite_number(spread, name="spread", error=ProblemError)) < 0.0:
        raise ProblemError(f"spread must not be negative, not {spread:g} kg m^2")
    # a base that drives looks under itself; here only the strength counts, the same everywhere
    here = (
        ground.gravity()
        if trajectory.base is None or trajectory.base.ground.uniform
        else (0.0, 0.0, -GRAVITY)
    )
    gravity = frozen_array(here, name="gravity", shape=(3,), error=ProblemError)
    excess, relative = limit_excess(machine, trajectory)
    kept = relative <= LIMIT_TOLERANCE
    fault = "" if kept else f"exceeds a joint limit by {excess:.3g}"
    if base is not None:
        if trajectory.base is None:
            raise ProblemError("the trajectory has no base motion to hold to the limits of `base`")
        held = check_base(base, trajectory.base)
        excess, kept, fault = max(excess, held.excess), kept and held.kept, fault or held.fault
    steps = np.diff(trajectory.times)
    parts = np.maximum(STRETCHES, np.ceil(steps / LONGEST))
    parts = np.maximum(parts * min(1.0, FIRST / parts.sum()), 1.0).astype(int)
    interval = np.repeat(np.arange(len(steps)), parts)
    share = np.concatenate([np.arange(count) / count for count in parts])
    length = (1.0 / parts)[interval]
    sampled, at, edge, guaranteed, best, states = np.inf, 0.0, 0, np.inf, np.inf, 0
    with np.errstate(all="ignore"):  # what overflows is not guaranteed
        rounding, curvature = _bounds_of_intervals(
            machine, trajectory, float(np.linalg.norm(gravity)), spread
        )
        whole = curvature if steps.max() <= STRETCHES * LONGEST else None
        while len(interval):
            found = _stretches(
                machine, trajectory, gravity, interval, share, length, rounding, whole
            )
            states += len(interval)
            worst = int(np.argmin(found.least))
            if found.least[worst] < sampled:
                sampled, at, edge = (
                    float(found.least[worst]),
                    float(found.at[worst]),
                    int(found.edge[worst]),
                )
            best = min(best, float(found.reachable.min()))
            # a negative margin, where none is kept
            target = np.where(found.reachable >= asked, asked, required)
            undecided = (found.bound < target) & (found.reachable >= target)
            loose = (undecided | (found.bound < best - LOOSE)) & (
                found.bound < found.reachable - ROUNDING
            )
            enough = np.where(undecided, np.maximum(target, best - LOOSE), best - LOOSE)
            parts = np.ceil(
                np.sqrt(HEADROOM * (found.reachable - found.bound) / (found.reachable - enough))
            )
            parts = np.clip(np.nan_to_num(parts, nan=MOST_PARTS), 2, MOST_PARTS).astype(int)
            if (exhausted := states + int(parts[loose].sum()) > MAX_STATES) or not np.isfinite(
                sampled
            ):
                loose[:] = False
            guaranteed = min(guaranteed, float(found.bound[~loose].min(initial=np.inf)))
            parts = parts[loose]
            interval, length = (
                np.repeat(interval[loose], parts),
                np.repeat(length[loose] / parts, parts),
            )
            number = np.arange(len(length)) - np.repeat(np.cumsum(parts) - parts, parts)
            share = np.repeat(share[loose], parts) + length * number
    doubt = ""
    if np.isneginf(guaranteed) and np.isfinite(sampled):
        doubt = reason_of_doubt(trajectory, rounding, exhausted=exhausted)
    bound = max(
        joints_least_duration(machine, trajectory), 0.0 if base is None else base.least_duration
    )
    return Certificate(
        margin=guaranteed - ROUNDING,
        margin_at=at,
        edge=edge,
        sampled=sampled,
        limits_ok=kept,
        limit_excess=excess,
        gap=trajectory.duration / bound - 1.0 if bound > 0.0 else 0.0,
        required=required,
        fault=fault,
        doubt=doubt,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Stretches:
    """Least margin at the ends of K stretches, when and at which edge, and what is guaranteed inside, (K,) each.

    However finely they are cut, rounding and a payload's spread keep the guarantee below
    `reachable`.
    """

    least: Array
    at: Array
    edge: Any
    bound: Array
    reachable: Array


def _bounds_of_intervals(
    machine: Machine, trajectory: Trajectory, gravity: float, spread: float
) -> tuple[WrenchBound, WrenchBound]:
    """Largest errors of the wrenches in each of the N intervals and their second derivatives, (N,) each.

    Rounding is relative to the sum of the absolute values of all that adds up, within an interval
    from its start; a rounded angle turns everything beyond its joint. To it comes what a base feels
    that is not just where it is computed to be, and what a payload does whose centre of mass is not
    known.
    """
    count, h = trajectory.intervals, np.diff(trajectory.times)
    j, step = np.abs(trajectory.jerks), h[:, None]
    a = np.abs(trajectory.accelerations)
    v, a = np.abs(trajectory.velocities[:-1]) + step * a + 0.5 * step**2 * j, a + step * j
    q = np.abs(trajectory.positions[:-1]) + step * v
    base, turned = None, np.zeros(count)
    if trajectory.base is not None:
        height = machine.support.height  # type: ignore[union-attr]
        base = root_motion_bounds(
            trajectory.base, np.arange(count), np.zeros(count), h, height=height
        )
        turned = np.abs(trajectory.base.poses[:-1, 2]) + h * base[1, 0]
    ends = trajectory.state_in(np.tile(np.arange(count), 2), np.concatenate([np.zeros(count), h]))
    peaks = _peaks(ends, j, step)
    twice = None if base is None else np.concatenate([base, base], axis=2)
    reach, v, a, j = (np.vstack(pair) for pair in zip((q, v, a, j), (*peaks, j), strict=True))
    size, curvature = wrench_bounds(machine, v, a, j, reach=reach, gravity=gravity, base=twice)
    share = OPERATIONS * EPSILON * (1.0 + q.sum(axis=1) + turned)
    force, moment = share * size.force[:count], share * size.moment[:count]
    if base is not None and not trajectory.base.ground.uniform:  # type: ignore[union-attr]
        parts = (part[:count] for part in (v, a, j))
        moved = misplaced_root_bounds(trajectory.base, base, gravity=gravity, height=height)  # type: ignore[arg-type]
        more, _ = wrench_bounds(machine, *parts, reach=q, gravity=gravity, base=moved)
        force, moment = (
            force + more.force - size.force[:count],
            moment + more.moment - size.moment[:count],
        )
    if spread > 0.0:
        moment = moment + moment_of_spread(machine, v[count:], a[count:], spread=spread, base=base)
    return WrenchBound(force, moment), WrenchBound(
        curvature.force[count:], curvature.moment[count:]
    )


def _peaks(ends: tuple[Array, ...], j: Array, delta: Array) -> tuple[Array, Array, Array]:
    """Largest |coordinates|, |rates| and |accelerations| between two ends delta apart, stacked (2K, n); (K, n) each.

    Rates are parabolas, so a middle point and the jerk give their largest value.
    """
    q, v, a = (np.abs(part).reshape(2, len(j), -1).max(axis=0) for part in ends)
    v = v + 0.125 * delta**2 * j
    return q + 0.5 * delta * v, v, a


def _stretches(
    machine: Machine,
    trajectory: Trajectory,
    gravity: Array,
    interval: Any,
    share: Array,
    length: Array,
    rounding: WrenchBound,
    whole: WrenchBound | None,
) -> _Stretches:
    """Margins at the ends of the stretches and what holds inside; `whole`: curvature anywhere in the intervals."""
    support, h = machine.support, np.diff(trajectory.times)[interval]
    height = support.height  # type: ignore[union-attr]
    count = len(interval)
    # every start, and those ends that are not the next stretch's start
    apart = np.abs(np.diff(share) - length[:-1]) > 4.0 * EPSILON
    ends = np.flatnonzero(np.append((np.diff(interval) != 0) | apart, True))
    looked_at = np.concatenate([np.arange(count), ends])
    since = np.concatenate([share, (share + length)[ends]]) * h[looked_at]
    states = trajectory.state_in(interval[looked_at], since)
    twist, root = root_motion(trajectory, gravity, interval[looked_at], since, height=height)
    wrench = ground_reaction(machine, *states, root_acceleration=root, root_velocity=twist)
    follower = np.arange(1, count + 1)
    follower[ends] = count + np.arange(len(ends))
    pick = np.concatenate([np.arange(count), follower])
    since, wrench = since[pick], wrench[pick]
    q, v, a = (state[pick] for state in states)
    normal = wrench[:, 2].reshape(2, count)
    rows = support.wrench_rows()  # type: ignore[union-attr]
    margins = -(wrench @ rows.T) / wrench[:, 2:3]
    known = (wrench[:, 2:3] > 0.0) & np.isfinite(margins)
    margins = np.where(known, margins, -np.inf).reshape(2, count, -1)
    delta = length * h
    if whole is None:
        j = np.abs(trajectory.jerks[interval])
        reach, most_v, most_a = _peaks((q, v, a), j, delta[:, None])
        base = None
        if trajectory.base is not None:
            base = root_motion_bounds(trajectory.base, interval, share * h, delta, height=height)
        g = float(np.linalg.norm(gravity))
        curvature = wrench_curvature_bound(
            machine, most_v, most_a, j, reach=reach, gravity=g, base=base
        )
    else:
        curvature = WrenchBound(whole.force[interval], whole.moment[interval])
    sag = 0.125 * delta**2
    least, normal_least = margins.min(axis=0), normal.min(axis=0)[:, None]  # (K, E), (K, 1)

    def less(off: WrenchBound) -> Array:
        """Guaranteed margin if the wrench is off the straight line between the ends by at most this, (K,)."""
        force, moment = off.force[:, None], off.moment[:, None]
        error = (
            np.linalg.norm(rows[:, :3], axis=1) * force
            + np.linalg.norm(rows[:, 3:], axis=1) * moment
        )
        inside = least - (error + np.abs(least) * force) / (normal_least - force)
        return np.asarray(
            np.where((normal_least > force) & ~np.isnan(inside), inside, -np.inf).min(axis=1)
        )

    rounded = WrenchBound(rounding.force[interval], rounding.moment[interval])
    off = WrenchBound(
        sag * curvature.force + rounded.force, sag * curvature.moment + rounded.moment
    )
    flat = np.argmin(margins.min(axis=2), axis=0)
    nearest = margins[flat, np.arange(count)]
    times = trajectory.times[interval] + since.reshape(2, count)[flat, np.arange(count)]
    return _Stretches(least.min(axis=1), times, nearest.argmin(axis=1), less(off), less(rounded))
