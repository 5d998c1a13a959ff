"""Proof that a motion keeps its distance from tipping over at all times, not only at samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number
from zmp_sqp.errors import MachineError, ProblemError
from zmp_sqp.mechanics.ground import Ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.motion_bounds import wrench_curvature_bound
from zmp_sqp.mechanics.wrench import ground_reaction
from zmp_sqp.planning.double_integrator import minimum_time
from zmp_sqp.planning.limits_in_time import limit_excess
from zmp_sqp.planning.trajectory import Trajectory

__all__ = ["Certificate", "certify"]

STRETCHES = 6  # per interval to begin with
LONGEST = 0.05  # [s] of a stretch to begin with
SPLIT = 4  # parts into which a stretch is cut whose bound is too loose
MAX_STATES = 200_000  # looked at before the bound is left as loose as it is
LOOSE = 2e-4  # [m] by which the guaranteed margin may fall short of the sampled one
ROUNDING = 1e-9  # [m] taken off for floating point
LIMIT_TOLERANCE = 1e-9  # largest excess over a joint limit of a motion that keeps them


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """What is guaranteed for all t.

    Attributes:
        margin: Least signed distance from the ZMP to an edge, guaranteed; -inf if the ground may have to pull [m].
        margin_at: Time of the least sampled distance [s].
        edge: Index of the nearest edge there.
        sampled: Least sampled distance, which the guaranteed one falls short of [m].
        limits_ok: Whether rates, accelerations and positions stay within the joint limits, in closed form.
        limit_excess: Largest excess over a joint limit; not positive inside [rad or m, per second, per second squared].
        gap: duration / lower bound - 1: how much longer than the fastest motion that only knows the joint limits.
        required: Margin that was asked for [m].
    """

    margin: float
    margin_at: float
    edge: int
    sampled: float
    limits_ok: bool
    limit_excess: float
    gap: float
    required: float

    @property
    def safe(self) -> bool:
        """Whether the asked margin and the joint limits hold at all times."""
        return self.margin >= self.required and self.limits_ok


def certify(machine: Machine, trajectory: Trajectory, ground: Ground, margin: float = 0.0) -> Certificate:
    r"""Guaranteed stability margin of any trajectory of the machine on a standing base, ours or not.

    Time is cut into stretches. With r = e . p f_z - b f_z of an edge (linear in the wrench) and m the lesser of the two
    margins at a stretch's ends, h = r + m f_z is not positive at both ends, so that by the error of interpolation

    .. math:: \text{margin}(t) \ge m - \frac{\delta^2}{8} \frac{\max |\ddot h|}{\min f_z}

    where the curvature is bounded by `wrench_curvature_bound` over the stretch. Stretches whose bound is too loose where
    it matters are cut further.

    Args:
        machine: With a support polygon.
        trajectory: The motion; its joints must be the machine's.
        ground: What the machine stands on.
        margin: Distance from the edges that is asked for; stretches near it are looked at more closely [m].

    Raises:
        MachineError: No support polygon.
        ProblemError: The trajectory has other joints, or the margin is not a number.
    """
    if machine.support is None:
        raise MachineError(f"machine {machine.name!r} has no support polygon: give support= to load_machine")
    if trajectory.joint_names != machine.joint_names:
        raise ProblemError(f"the trajectory moves {trajectory.joint_names}, the machine has {machine.joint_names}")
    required = finite_number(margin, name="margin", error=ProblemError)
    excess = limit_excess(machine, trajectory)
    steps = np.diff(trajectory.times)
    parts = np.maximum(STRETCHES, np.ceil(steps / LONGEST)).astype(int)
    interval = np.repeat(np.arange(len(steps)), parts)
    share = np.concatenate([np.arange(count) / count for count in parts])
    length = (1.0 / parts)[interval]
    sampled, at, edge, guaranteed, states = np.inf, 0.0, 0, np.inf, 0
    while len(interval):
        found = _stretches(machine, trajectory, ground, interval, share, length)
        states += len(interval)
        worst = int(np.argmin(found.least))
        if found.least[worst] < sampled:
            sampled, at, edge = float(found.least[worst]), float(found.at[worst]), int(found.edge[worst])
        undecided = (found.bound < required) & (found.least >= required)
        loose = undecided | (found.bound < sampled - LOOSE)
        if states > MAX_STATES or not np.isfinite(sampled):
            loose[:] = False
        guaranteed = min(guaranteed, float(found.bound[~loose].min(initial=np.inf)))
        interval, length = np.repeat(interval[loose], SPLIT), np.repeat(length[loose] / SPLIT, SPLIT)
        share = np.repeat(share[loose], SPLIT) + length * np.tile(np.arange(SPLIT), int(loose.sum()))
    bound = _kinematic_bound(machine, trajectory)
    return Certificate(
        margin=guaranteed - ROUNDING, margin_at=at, edge=edge, sampled=sampled, limits_ok=excess <= LIMIT_TOLERANCE,
        limit_excess=excess, gap=trajectory.duration / bound - 1.0 if bound > 0.0 else 0.0, required=required,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Stretches:
    """Least margin at the ends of K stretches, when and at which edge, and what is guaranteed inside, (K,) each."""

    least: Array
    at: Array
    edge: Any
    bound: Array


def _stretches(
    machine: Machine, trajectory: Trajectory, ground: Ground, interval: Any, share: Array, length: Array
) -> _Stretches:
    support, h = machine.support, np.diff(trajectory.times)[interval]
    count = len(interval)
    # every start, and those ends that are not the next stretch's start
    ends = np.flatnonzero(np.append((np.diff(interval) != 0) | (np.diff(share) != length[:-1]), True))
    looked_at = np.concatenate([np.arange(count), ends])
    since = np.concatenate([share, (share + length)[ends]]) * h[looked_at]
    states = trajectory.state_in(interval[looked_at], since)
    root = np.concatenate([-ground.gravity(), np.zeros(3)])
    wrench = ground_reaction(machine, *states, root_acceleration=root)
    follower = np.arange(1, count + 1)
    follower[ends] = count + np.arange(len(ends))
    pick = np.concatenate([np.arange(count), follower])
    since, wrench = since[pick], wrench[pick]
    q, v, a = (state[pick] for state in states)
    normal = wrench[:, 2].reshape(2, count)
    rows = support.wrench_rows()  # type: ignore[union-attr]
    with np.errstate(divide="ignore", invalid="ignore"):
        margins = -(wrench @ rows.T) / wrench[:, 2:3]
    margins = np.where(wrench[:, 2:3] > 0.0, margins, -np.inf).reshape(2, count, -1)
    # bounds over the stretch: rates are parabolas, so a middle point and the jerk give their largest value
    j = np.abs(trajectory.jerks[interval])
    delta = (length * h)[:, None]
    peak_a = np.abs(a).reshape(2, count, -1).max(axis=0)
    peak_v = np.abs(v).reshape(2, count, -1).max(axis=0) + 0.125 * delta**2 * j
    reach = np.abs(q).reshape(2, count, -1).max(axis=0) + 0.5 * delta * peak_v
    curvature = wrench_curvature_bound(machine, peak_v, peak_a, j, reach=reach)
    sag = 0.125 * delta[:, 0] ** 2
    normal_least = normal.min(axis=0) - sag * curvature.force
    least = margins.min(axis=0)  # (K, E)
    error = sag[:, None] * (
        np.linalg.norm(rows[:, :3], axis=1) * curvature.force[:, None]
        + np.linalg.norm(rows[:, 3:], axis=1) * curvature.moment[:, None]
        + np.abs(least) * curvature.force[:, None]
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = least - error / normal_least[:, None]
    inside = np.where(normal_least[:, None] > 0.0, inside, -np.inf)
    flat = np.argmin(margins.min(axis=2), axis=0)
    nearest = margins[flat, np.arange(count)]
    times = trajectory.times[interval] + since.reshape(2, count)[flat, np.arange(count)]
    return _Stretches(least.min(axis=1), times, nearest.argmin(axis=1), inside.min(axis=1))


def _kinematic_bound(machine: Machine, trajectory: Trajectory) -> float:
    """Least duration of any motion between the trajectory's ends within the joint limits [s]."""
    limits, q, v = machine.limits, trajectory.positions, trajectory.velocities
    if not (np.isfinite(limits.velocity).all() and np.isfinite(limits.acceleration).all()):
        return 0.0
    rows = zip(q[-1] - q[0], limits.velocity, limits.acceleration, v[0], v[-1], strict=True)
    return max(
        minimum_time(
            float(d), max_velocity=float(top), max_acceleration=float(push),
            start_velocity=float(first), goal_velocity=float(last),
        ).duration
        for d, top, push, first, last in rows
    )  # fmt: skip
