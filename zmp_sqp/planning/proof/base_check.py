"""What a base is held to: its limits at all times in closed form, start and goal, and bounds on x and y by proof."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.motion.root_motion import root_motion_bounds
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase
from zmp_sqp.planning.proof.path_error import path_error

__all__ = ["ARRIVAL", "CORRIDOR", "BaseCheck", "check_base", "corridor_excess"]

# [m or rad] farthest from the start and the goal that counts as there, for plans as for any motion
ARRIVAL = 1e-5
RATE_ARRIVAL = 1e-6  # [m/s, rad/s, relative above one]
LIMIT_TOLERANCE = 1e-9  # [m/s, rad/s, per second] rounding
CORRIDOR = 1e-6  # [m] farthest outside x and y bounds
FINE = 1e-7  # [m] to which the excess over these is found, where there is one
ROUNDING = 1e-9  # [m]
MOST_PARTS = 16  # into which a stretch is cut that may lead outside
MAX_STATES = 200_000  # looked at before the bound is left as loose as it is
NAMES = ("max_speed", "max_yaw_rate", "max_acceleration", "max_yaw_acceleration")
UNITS = ("m/s", "rad/s", "m/s^2", "rad/s^2")


@dataclass(frozen=True, slots=True)
class BaseCheck:
    """What became of the limits of a base.

    Attributes:
        excess: Largest excess over any of them at any time; infinite if it does not begin and end
            as asked.
        outside: Likewise over the bounds on x and y alone [m]; -inf if there are none.
        fault: What is wrong, in words that follow "the motion"; empty if nothing is.
    """

    excess: float
    outside: float
    fault: str

    @property
    def kept(self) -> bool:
        """Whether the base begins, drives and ends as asked."""
        return not self.fault


def check_base(base: UnicycleBase, motion: UnicycleMotion) -> BaseCheck:
    """Hold a motion to a base's start, goal and limits at all times, not only at its nodes.

    Start and goal pose count as met within 1e-5 m and rad, speed and yaw rate there within 1e-6
    (relative above one), bounds on x and y within 1e-6 m, and the limits of speed, yaw rate and
    accelerations within 1e-9.
    """
    outside, when, axis = corridor_excess(base, motion)
    over = _rate_excess(base, motion)
    worst, fault = int(np.argmax(over)), _misses(base, motion)
    excess = np.inf if fault else max(float(over[worst]), outside)
    # first, as nothing may begin or end at rates beyond the limits either
    if not over[worst] <= LIMIT_TOLERANCE:
        fault = f"exceeds the base's {NAMES[worst]} by {over[worst]:.3g} {UNITS[worst]}"
    if not fault and not outside <= CORRIDOR:
        where = f"{'xy'[axis]}_bounds near {when:.3f} s"
        fault = f"takes the base {outside:.3g} m out of its {where}"
        if not np.isfinite(outside):
            fault = f"may take the base out of its {where}: its path is not known well enough there, give more nodes"
    return BaseCheck(excess, outside, fault)


def corridor_excess(base: UnicycleBase, motion: UnicycleMotion) -> tuple[float, float, int]:
    r"""Upper bound on how far the base leaves its bounds on x and y at any time [m], when [s], and in x (0) or y (1).

    Between two times that lie \delta apart, a place p is no further out than at these, but for

    .. math:: \frac{\delta^2}{8} \max |\ddot p| + e

    with e, how far the unicycle may be from its computed path (`path_error`). Stretches that may
    lead outside are cut until that is small. Without bounds the answer is -inf.
    """
    lower, upper = base.corridor
    if not (np.isfinite(lower).any() or np.isfinite(upper).any()):
        return -np.inf, 0.0, 0
    interval, length = np.arange(len(motion.jerks)), np.diff(motion.times)
    with np.errstate(all="ignore"):  # what overflows is not known
        bend = root_motion_bounds(motion, interval, 0.0 * length, length, height=0.0)[0, 1]
        error = np.nan_to_num(path_error(motion), nan=np.inf) + ROUNDING
    since, states = np.zeros(len(length)), 0
    outside, when, axis, found = -np.inf, 0.0, 0, -np.inf
    while len(interval):
        states += len(interval)
        ends = np.stack([motion.state_in(interval, at)[0][:, :2] for at in (since, since + length)])
        # (K, 2)
        out = np.maximum(ends.max(axis=0) - upper, lower - ends.min(axis=0)) + error[interval, None]
        with np.errstate(all="ignore"):
            sag = np.nan_to_num(0.125 * length**2 * bend[interval], nan=np.inf)
        over = out.max(axis=1)
        found = max(found, float(over.max()))
        loose = (over + sag > max(0.0, found)) & (sag > FINE) & np.isfinite(over)
        parts = np.ceil(np.sqrt(sag / FINE)).clip(2, MOST_PARTS).astype(int)
        if states + int(parts[loose].sum()) > MAX_STATES:
            loose[:] = False
        bound = np.where(loose, -np.inf, over + sag)
        worst = int(np.argmax(bound))
        if bound[worst] > outside:
            outside, axis = float(bound[worst]), int(out[worst].argmax())
            when = float(motion.times[interval[worst]] + since[worst])
        parts = parts[loose]
        interval, length = (
            np.repeat(interval[loose], parts),
            np.repeat(length[loose] / parts, parts),
        )
        number = np.arange(len(length)) - np.repeat(np.cumsum(parts) - parts, parts)
        since = np.repeat(since[loose], parts) + length * number
    return outside, when, axis


def _rate_excess(base: UnicycleBase, motion: UnicycleMotion) -> Array:
    """Largest excess of speed, yaw rate and their rates over the limits at any time, shape (4,), in closed form."""
    v, a, j, h = (
        motion.velocities,
        motion.accelerations,
        motion.jerks,
        np.diff(motion.times)[:, None],
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = -a / j
    turn = np.where((turn > 0.0) & (turn < h), turn, 0.0)
    rates = np.vstack([v, v[:-1] + turn * a + 0.5 * turn**2 * j])
    pushes = np.vstack([a, a + h * j])
    limits = base.limits
    return np.concatenate(
        [
            (np.abs(part) - limit).max(axis=0)
            for part, limit in ((rates, limits.velocity), (pushes, limits.acceleration))
        ]
    )


def _misses(base: UnicycleBase, motion: UnicycleMotion) -> str:
    """How the motion misses the state it should begin or end in, in words; empty if it does not."""
    for verb, side, k in (("begins", "start", 0), ("ends", "goal", -1)):
        off = np.abs(motion.poses[k] - getattr(base, side))
        asked = getattr(base, f"{side}_velocity")
        late = np.abs(motion.velocities[k] - asked)
        allowed = f"of the base ({ARRIVAL:g} m and rad count as there)"
        if off[:2].max() > ARRIVAL:
            return f"{verb} {np.hypot(*off[:2]):.3g} m beside the {side} {allowed}"
        if off[2] > ARRIVAL:
            return f"{verb} turned by {off[2]:.3g} rad against the {side} {allowed}"
        if (late > RATE_ARRIVAL * (1.0 + np.abs(asked))).any():
            return f"{verb} with other rates of the base than asked for: speed and yaw rate are off by {late}"
    return ""
