"""What `zmp-sqp check` says of the motion itself: how it was read, its ends, its limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, distinct_texts
from zmp_sqp.mechanics import Machine
from zmp_sqp.motion.interpolation import SMOOTHED
from zmp_sqp.motion.reading import EXACT, ROUNDING_PER_NOISE, RecordedMotion
from zmp_sqp.motion.samples import Samples
from zmp_sqp.planning import Problem, Trajectory
from zmp_sqp.planning.proof.limits_in_time import LimitPeak, joints_least_duration

__all__ = [
    "elsewhere_hints",
    "ends_in_motion",
    "finite",
    "gap_hint",
    "hints_on",
    "jump_hint",
    "limit_allowance",
    "limit_faults",
    "motion_fields",
    "motion_lines",
    "noise_hint",
]

REST = 1e-6  # [rad/s or m/s] rates that count as rest
# largest share of a rate or acceleration limit that counts as rounding of a file's digits
MOST_ROUNDING = 0.01
# a step this many times as long as the median is a gap, where there are so many steps
GAP, LEAST_STEPS = 5.0, 10
ELSEWHERE = 1e-3  # [rad or m] distance from the scenario's start or goal that is mentioned
MOST_AT_REST = 0.05  # the same of a rate limit for rates at the ends that count as rest
RULES = {
    "linear": "straight lines through the positions",
    "spline": "cubics with continuous accelerations through the positions",
    "cubic": "cubics through positions and velocities, as a ROS joint_trajectory_controller "
    "plays them",
    "quintic": "polynomials of degree five through positions, velocities and accelerations, as a "
    "ROS joint_trajectory_controller plays them",
    SMOOTHED: "smoothing splines of the positions",
}
UNITS = {"position": "", "velocity": "/s", "acceleration": "/s^2"}
SLOW = 100.0  # times the least duration, from which on times may be milliseconds
AMPLIFIED = 4.0  # acceleration of a spline per noise of its samples / interval^2, about
FEWEST_TO_TELL = 12  # samples
NOISY = 0.5  # of an acceleration limit, from which on such accelerations are worth a word
LEAST_OFF = 1e-12  # in the unit of the quantity; smaller differences from samples are rounding
LEAST_SAID = 1e-6  # [rad/s^2 or the like] smaller allowances are not mentioned
MOST_FAULTS = 3  # limits that are named; the others are counted


def finite(value: float) -> float | None:
    """The value, or None for JSON if it is not finite."""
    return float(value) if np.isfinite(value) else None


def motion_fields(read: RecordedMotion) -> dict[str, Any]:
    """How a motion follows from its file, for JSON."""
    samples, departure = read.samples, read.departure
    by_joint = None
    if departure is not None:
        columns = departure.at_samples | {"between": departure.between}
        by_joint = {
            joint: {name: finite(column[i]) for name, column in columns.items()}
            for i, joint in enumerate(samples.joint_names)
        }
    return {
        "file": samples.source,
        "interpolation": read.rule,
        "samples": len(samples.times),
        "given": list(samples.given),
        "ignored": list(samples.ignored),
        "departure": by_joint,
    }


def motion_lines(read: RecordedMotion, machine: Machine, allowance: Array | None) -> list[str]:
    """How a motion follows from its file and how far it departs from it, in words.

    Args:
        read: The motion.
        machine: Gives the units of the joints.
        allowance: Excess over limits that counts as rounding, see `limit_allowance`.
    """
    samples, departure = read.samples, read.departure
    if read.rule == EXACT or departure is None:
        lines = [f"the polynomials of {samples.source} as they stand"]
    else:
        lines = [f"{RULES[read.rule]}, {len(samples.times)} samples of {samples.source}"]
        lines += [
            f"off the given {quantity} by at most {_largest(off, machine, UNITS[quantity])}"
            for quantity, off in departure.at_samples.items()
            if off.max() > LEAST_OFF
        ]
        if read.rule == SMOOTHED:
            distance = float(np.max(samples.error_of("position"))) / ROUNDING_PER_NOISE
            lines.append(f"{distance:.2g} rad or m from them in the mean: noise of the measurement")
        between = _largest(departure.between, machine, "")
        lines.append(f"between samples at most {between} from the straight line")
    if samples.ignored:
        lines.append(f"not used: {', '.join(samples.ignored)}")
    if allowance is not None and allowance.max() > LEAST_SAID:
        words = [
            f"{float(allowance[row].max()):.2g} over {what} limits"
            for row, what in ((0, "position"), (2, "velocity"), (3, "acceleration"))
            if allowance[row].max() > LEAST_SAID
        ]
        listed = " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))
        lines.append(f"at most {listed} count as kept (--limit-tolerance)")
    return lines


def _largest(values: Array, machine: Machine, per: str) -> str:
    """Largest of one value per joint, with unit and joint."""
    joint = int(values.argmax())
    return f"{values[joint]:.2g} {machine.joint_units[joint]}{per} ({machine.joint_names[joint]})"


def ends_in_motion(trajectory: Trajectory, side: int, rounding: Any, machine: Machine) -> str:
    """What still moves at the start (side 0) or the end (side -1), in words; empty at rest.

    Args:
        trajectory: The motion.
        side: Index of the node.
        rounding: Error of the velocities, one number or one per joint [rad/s or m/s]; more than
            `MOST_AT_REST` of a joint's limit is no rest.
        machine: Gives units and limits of the joints.
    """
    rates, limit = np.abs(trajectory.velocities[side]), machine.limits.velocity
    rest = REST + np.fmin(1.01 * np.asarray(rounding), MOST_AT_REST * limit)
    moving = []
    for joint in np.flatnonzero(rates > rest).tolist():
        unit = machine.joint_units[joint]
        verb = "turns" if unit == "rad" else "slides"
        moving.append(f"{trajectory.joint_names[joint]} {verb} at {rates[joint]:.2g} {unit}/s")
    if trajectory.base is not None:
        speed, spin = np.abs(trajectory.base.velocities[side])
        still = REST + 1.01 * float(np.max(rounding))
        if speed > still:
            moving.append(f"the base drives at {speed:.2g} m/s")
        if spin > still:
            moving.append(f"the base turns at {spin:.2g} rad/s")
    if not moving:
        return ""
    more = f" and {len(moving) - MOST_FAULTS} more" if len(moving) > MOST_FAULTS else ""
    verb, when = ("begins", 0.0) if side == 0 else ("ends", trajectory.duration)
    return f"{verb} in motion: at {when:.2f} s {', '.join(moving[:MOST_FAULTS])}{more}"


def limit_allowance(read: RecordedMotion, machine: Machine, share: float | None) -> Array | None:
    r"""Excess over the joint limits that counts as kept, shape (4, n); None if there is none.

    Samples with rounding errors u of positions and w of velocities, at a distance h, give
    accelerations with errors of :math:`12 u / h^2 + 6 w / h` (cubics; quintics have
    :math:`11.6 u / h^2 + 8 w / h`, and 1.5 times the error of the accelerations). Errors of times
    count as errors of positions at the largest rate.

    Args:
        read: The motion; exact ones have no such errors.
        machine: Gives the limits.
        share: Share of the rate and acceleration limits; None is what the digits of the file
            explain, at most `MOST_ROUNDING`.
    """
    limits = machine.limits
    bounds = np.zeros((4, machine.size))
    bounds[2], bounds[3] = limits.velocity, limits.acceleration
    if share is not None:
        return share * np.where(np.isfinite(bounds), bounds, 0.0)
    if read.rule == EXACT:
        return None
    samples, motion = read.samples, read.trajectory
    h = np.diff(motion.times).min()
    fastest = np.abs(motion.velocities).max(axis=0)
    u = samples.error_of("position") + fastest * samples.error_of("time")
    w, x = samples.error_of("velocity"), samples.error_of("acceleration")
    with np.errstate(all="ignore"):  # what overflows is limited
        errors = np.stack([u, u, 3.0 * u / h + w, 12.0 * u / h**2 + 8.0 * w / h + 1.5 * x])
    most = np.where(np.isfinite(bounds), MOST_ROUNDING * bounds, 0.0)
    errors[2:] = np.fmin(errors[2:], most[2:])
    return errors


def limit_faults(peaks: Sequence[LimitPeak]) -> list[str]:
    """Limits of joints that are not kept, the worst first, in words that follow "the motion"."""
    broken = [peak for peak in peaks if not peak.kept]
    broken.sort(key=lambda peak: -peak.excess / max(abs(peak.allowed), 1e-9))
    words = []
    for peak in broken[:MOST_FAULTS]:
        value, allowed = distinct_texts(peak.value, peak.allowed, digits=3)
        words.append(
            f"exceeds the {peak.limit} limit of joint {peak.joint!r} by {peak.excess:.3g} "
            f"{peak.unit} at {peak.time:.2f} s ({value} where {allowed} is allowed)"
        )
    if len(broken) > MOST_FAULTS:
        words.append(f"exceeds {len(broken) - MOST_FAULTS} more joint limits")
    return words


def jump_hint(read: RecordedMotion, peaks: Sequence[LimitPeak]) -> list[str]:
    """Says that interpolation alone exceeds rate and acceleration limits, where it does.

    Where an acceleration jumps between two samples, a cubic or quintic exceeds it on one side.
    """
    broken = [peak for peak in peaks if not peak.kept]
    motion, names = read.trajectory, read.samples.joint_names
    with np.errstate(all="ignore"):
        means = np.abs(np.diff(motion.velocities, axis=0) / np.diff(motion.times)[:, None])
    given = {
        "velocity": np.abs(motion.velocities).max(axis=0),
        "acceleration": means.max(axis=0),
    }
    if read.rule == EXACT or not broken or any(peak.limit not in given for peak in broken):
        return []
    for peak in broken:
        if given[peak.limit][names.index(peak.joint)] > peak.allowed * (1.0 + 1e-6):
            return []
    share = max(peak.excess / peak.allowed for peak in broken)
    return [
        "from sample to sample velocities change no faster than the limits allow; the "
        f"{read.rule} exceeds them where an acceleration jumps between two samples: add samples at "
        f"the jumps, or allow it by --limit-tolerance {np.ceil(100.0 * share) / 100.0:.2f}"
    ]


def noise_hint(read: RecordedMotion, machine: Machine) -> list[str]:
    """Says that positions look noisy, where accelerations of the motion are mostly of noise.

    See `Samples.apparent_noise` on the estimate.
    """
    samples, known = read.samples, read.rule in (EXACT, SMOOTHED)
    if known or "acceleration" in samples.values or len(samples.times) < FEWEST_TO_TELL:
        return []
    with np.errstate(all="ignore"):
        h, noise = float(np.median(np.diff(samples.times))), samples.apparent_noise()
        feigned = AMPLIFIED * noise / h**2
    limits = machine.limits.acceleration
    loud = np.flatnonzero(feigned > NOISY * np.where(np.isfinite(limits), limits, np.inf))
    if not len(loud):
        return []
    joint = int(loud[np.argmax((feigned / limits)[loud])])
    name, unit = machine.joint_names[joint], machine.joint_units[joint]
    return [
        f"positions of joint {name!r} look noisy: about {noise[joint]:.1g} {unit} between samples "
        f"{h:.3g} s apart make accelerations of {feigned[joint]:.2g} {unit}/s^2. If that is the "
        f"noise of the measurement, --noise {noise[joint]:.1g} checks a smooth motion through it"
    ]


def hints_on(
    samples: Samples, trajectory: Trajectory | None, machine: Machine, *, degrees: bool
) -> list[str]:
    """What looks as if it were in another unit, in sentences."""
    hints, q = [], samples.values["position"]
    turning = np.array([unit == "rad" for unit in machine.joint_units])
    limits = machine.limits
    reach = np.maximum(np.abs(limits.position_lower), np.abs(limits.position_upper))
    endless = ~np.isfinite(reach)
    reach = np.where(endless, 4.0 * np.pi, reach)
    largest = np.abs(q).max(axis=0)
    outside = turning & (largest > 1.5 * reach)
    if not degrees and outside.any() and (largest <= 1.1 * np.degrees(reach))[turning].all():
        joint = int(np.flatnonzero(outside)[0])
        beyond = "more than two turns" if endless[joint] else f"beyond its {reach[joint]:.3g} rad"
        hints.append(
            f"{machine.joint_names[joint]} goes to {largest[joint]:.4g}, {beyond}: "
            "give --degrees if angles are in degrees"
        )
    if "velocity" in samples.values:
        given = float(np.abs(samples.values["velocity"]).max())
        with np.errstate(all="ignore"):
            followed = float(np.abs(np.diff(q, axis=0) / np.diff(samples.times)[:, None]).max())
        if 0.0 < followed < 0.02 * given or followed > 50.0 * given > 0.0:
            hints.append(
                f"rates that follow from positions and times are up to {followed:.3g}, but the "
                f"given velocities up to {given:.3g}: are they in the same units (s, rad/s)?"
            )
    elif trajectory is not None:
        least = joints_least_duration(machine, trajectory)
        if least > 0.0 and trajectory.duration > SLOW * least:
            hints.append(
                f"the motion takes {trajectory.duration:.4g} s where the joints need {least:.3g} s:"
                " are the times in milliseconds (name the column 'time [ms]' then)?"
            )
    return hints


def gap_hint(read: RecordedMotion) -> list[str]:
    """Says where samples seem to be missing: the rule of interpolation alone decides there."""
    steps = np.diff(read.samples.times)
    usual, k = float(np.median(steps)), int(np.argmax(steps))
    if read.rule == EXACT or len(steps) < LEAST_STEPS or steps[k] <= GAP * usual:
        return []
    first, last = read.samples.times[k : k + 2]
    return [
        f"between {first:.2f} and {last:.2f} s there is no sample, where others are {usual:.3g} s "
        "apart: what the machine did meanwhile is not known, and taken to be a smooth motion"
    ]


def elsewhere_hints(problem: Problem | None, trajectory: Trajectory) -> list[str]:
    """Says where a motion does not begin at a scenario's start, or not end at its goal."""
    hints = []
    for verb, end, side in (("begins", "start", 0), ("ends", "goal", -1)):
        if problem is None:
            break
        off = np.abs(trajectory.positions[side] - getattr(problem, end))
        joint = int(off.argmax())
        if off[joint] > ELSEWHERE:
            unit = problem.machine.joint_units[joint]
            hints.append(
                f"the motion {verb} elsewhere than at the {end} of the scenario: "
                f"{trajectory.joint_names[joint]} is {off[joint]:.2g} {unit} away"
            )
    return hints
