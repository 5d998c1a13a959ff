"""Motions from files of any origin: planned here, recorded by a logger, made by another planner."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array, finite_number, frozen_array
from zmp_sqp.errors import TrajectoryError, UnboundedAcceleration
from zmp_sqp.mechanics.ground import Terrain
from zmp_sqp.mechanics.joint_values import by_joint
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.motion.bag import read_bag_samples
from zmp_sqp.motion.consistency import drift_fault
from zmp_sqp.motion.interpolation import (
    RULES,
    SMOOTHED,
    cubic_motion,
    linear_motion,
    quintic_motion,
    rate_jumps,
    smoothed_motion,
    spline_rates,
)
from zmp_sqp.motion.joint_trajectory import read_message_samples
from zmp_sqp.motion.sample_tables import read_csv_samples, read_npz_samples
from zmp_sqp.motion.samples import Samples
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.motion.unicycle_motion import BASE_COLUMNS, PLANE, UnicycleMotion

__all__ = [
    "EXACT",
    "ROUNDING_PER_NOISE",
    "SUFFIXES",
    "Departure",
    "RecordedMotion",
    "read_motion",
]

EXACT = "exact"  # rule of files that hold the polynomials themselves
SUFFIXES = (".csv", ".npz", ".json", ".yaml", ".yml", ".mcap")
NEEDED = {
    "linear": ("position",),
    "spline": ("position",),
    "cubic": ("position", "velocity"),
    "quintic": ("position", "velocity", "acceleration"),
}
DEGREE = np.pi / 180.0
FEWEST_TO_SMOOTH = 8  # samples
# mean distance from the samples that smoothing may have: multiple of the noise that they show, and
# [rad or m]
MOST_TAKEN, LEAST_TAKEN = 2.0, 1e-5
ROUNDING_PER_NOISE = 2.0  # error of a smoothed position that counts, per noise
DEVIATIONS = 3.0  # standard deviations of the rates at the ends that count as rest


@dataclass(frozen=True, slots=True, eq=False)
class Departure:
    """How far a motion departs from the samples through which it was put.

    Attributes:
        at_samples: Largest |motion - sample| of each quantity that the file gives, up to the
            accelerations, at the samples, shape (n,) each. Where an acceleration jumps, the larger
            difference of both sides counts.
        between: Bound on the distance from the straight line between neighbouring positions, at
            all times, shape (n,) [rad or m].
    """

    at_samples: dict[str, Array]
    between: Array

    @classmethod
    def of(cls, samples: Samples, motion: Trajectory) -> Departure:
        """Departure of a motion whose nodes are the samples."""
        with np.errstate(all="ignore"):  # what overflows is infinite or not a number
            q, v, start, *_ = motion.node_rows()
            end = np.vstack([start[:1], motion.end_accelerations])
            found = {}
            # files of ours give accelerations and jerks of the interval that begins at a node
            sides_of = (start,) if "jerk" in samples.values else (start, end)
            for quantity, sides in (
                ("position", (q,)),
                ("velocity", (v,)),
                ("acceleration", sides_of),
            ):
                if quantity in samples.values:
                    off = [np.abs(side - samples.values[quantity]).max(axis=0) for side in sides]
                    found[quantity] = np.max(off, axis=0)
            h = np.diff(motion.times)[:, None]
            peak = np.maximum(np.abs(start[:-1]), np.abs(end[1:]))
            if motion.snaps is not None:  # their largest value bounds how far accelerations bend
                last = motion.snaps + h * motion.crackles
                peak = peak + 0.125 * h**2 * np.maximum(np.abs(motion.snaps), np.abs(last))
            return cls(found, (0.125 * h**2 * peak).max(axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class RecordedMotion:
    """Motion of a file, and how it follows from what the file holds.

    Attributes:
        trajectory: The motion, from time 0 on.
        rule: "exact" for the polynomials of a file of ours; "linear", "spline", "cubic" or
            "quintic" for samples, "smoothed" for samples with noise.
        samples: What the file holds.
        departure: How far the motion departs from the samples; None for exact ones.
    """

    trajectory: Trajectory
    rule: str
    samples: Samples
    departure: Departure | None


def read_motion(
    path: str | Path,
    machine: Machine,
    ground: Terrain = PLANE,
    *,
    interpolation: str | None = None,
    degrees: bool = False,
    noise: float | Sequence[float] | Mapping[str, float] | None = None,
) -> RecordedMotion:
    """Read a motion of any origin: CSV, NPZ, JSON or YAML (JointTrajectory), or a MCAP bag.

    Files of ours that hold polynomials (accelerations and all else at every node) are read exactly.
    Samples are interpolated by a rule. The default is what the ROS joint_trajectory_controller
    plays: with accelerations "quintic", with velocities "cubic"; for positions alone, which it
    would join by straight lines, it is "spline": cubics with continuous accelerations, at rest at
    both ends if the joints can be. An exported file says itself which rule it is made for; one of
    ours whose numbers were rounded is played as cubics.

    Args:
        path: File to read; its ending says what it is.
        machine: Machine whose joints the file must have, in any order.
        ground: Ground on which the base drives, if the motion has one.
        interpolation: "linear", "spline", "cubic" or "quintic"; None for the default.
        degrees: Whether angles are in degrees, the yaw of a base too.
        noise: Standard deviation of the noise of measured positions [rad or m], one number or one
            per joint: the motion is then that of smoothing splines ("smoothed"), which pass the
            samples at that distance in the mean, and velocities and accelerations of the file are
            not used. More than twice the noise that neighbouring samples show is refused, because
            it would smooth away what the joints do. None takes positions as exact: accelerations of
            splines through noisy samples are mostly noise, 30 rad/s^2 for 0.1 mrad at 100 Hz.

    Raises:
        ProblemError: The base leaves the map.
        UnboundedAcceleration: Linear interpolation, whose rates jump.
        TrajectoryError: The file cannot be read, lacks joints or what the rule needs, holds no
            motion, or gives units although `degrees` does; the message names file, row and column.
    """
    samples, named = _read(Path(path), machine)
    if degrees:
        if samples.converted:
            raise TrajectoryError(
                f"{samples.source}: its header gives units already: leave out degrees"
            )
        samples = _in_radians(samples, machine)
    samples = replace(samples, times=samples.times - samples.times[0])
    if samples.base is not None and interpolation is not None:
        raise TrajectoryError(
            f"{samples.source}: a motion whose base drives is read as it stands: leave out the "
            "interpolation"
        )
    if noise is not None:
        return _smoothed(samples, noise, machine, interpolation)
    if interpolation is None and named is None:
        exact = _exact(samples, machine, ground, needed=samples.base is not None)
        if exact is not None:
            return RecordedMotion(exact, EXACT, samples, None)
    rule = interpolation or named or _default(samples)
    motion = _by_rule(samples, rule, machine)
    return RecordedMotion(motion, rule, samples, Departure.of(samples, motion))


def _smoothed(
    samples: Samples, noise: Any, machine: Machine, interpolation: str | None
) -> RecordedMotion:
    """Motion of smoothing splines; noise also explains small rates at rest."""
    if interpolation is not None or samples.base is not None:
        raise TrajectoryError(
            f"{samples.source}: noise makes smoothing splines of the joints' positions: leave out "
            "the interpolation, and give no motion whose base drives"
        )
    noise = by_joint(noise, machine, name="noise", error=TrajectoryError)
    count = len(samples.joint_names)
    if np.ndim(noise) == 0:
        noise = np.full(count, finite_number(noise, name="noise", error=TrajectoryError))
    sigma = frozen_array(noise, name="noise", shape=(count,), error=TrajectoryError)
    if not (sigma > 0.0).all():
        raise TrajectoryError(f"noise must be positive, not {sigma.min():g}")
    if len(samples.times) < FEWEST_TO_SMOOTH:
        raise TrajectoryError(
            f"{samples.source}: smoothing needs at least {FEWEST_TO_SMOOTH} samples"
        )
    found = smoothed_motion(samples.joint_names, samples.times, samples.values["position"], sigma)
    if found is None:
        raise TrajectoryError(
            f"{samples.source}: no smoothing spline passes the samples at {sigma.max():g} rad or "
            "m; is the noise larger, or are samples too far apart?"
        )
    motion, slopes = found
    _check_smoothing(samples, motion, sigma, machine)
    rounding = {"position": ROUNDING_PER_NOISE * sigma, "velocity": DEVIATIONS * slopes}
    known = replace(samples, values={"position": samples.values["position"]}, rounding=rounding)
    return RecordedMotion(motion, SMOOTHED, known, Departure.of(known, motion))


def _check_smoothing(samples: Samples, motion: Trajectory, noise: Array, machine: Machine) -> None:
    """Refuse noise with which smoothing takes more from the samples than noise.

    Raises:
        TrajectoryError: Of a joint's samples more is taken than neighbouring ones show as noise.
    """
    shown = MOST_TAKEN * samples.apparent_noise() + LEAST_TAKEN
    taken = np.sqrt(((motion.positions - samples.values["position"]) ** 2).mean(axis=0))
    joint = int(np.argmax(taken / shown))
    if taken[joint] > shown[joint]:
        name, unit = samples.joint_names[joint], machine.joint_units[joint]
        raise TrajectoryError(
            f"{samples.source}: a noise of {noise[joint]:g} {unit} would smooth away what joint "
            f"{name!r} does: neighbouring samples show about "
            f"{samples.apparent_noise()[joint]:.2g} {unit} of noise"
        )


def _read(path: Path, machine: Machine) -> tuple[Samples, str | None]:
    """Samples of a file by its ending, and the interpolation that it names."""
    joint_names = machine.joint_names
    suffix = path.suffix.lower()
    if path.is_dir() and (path / "metadata.yaml").exists():
        suffix = ".mcap"
    if suffix not in SUFFIXES:
        raise TrajectoryError(
            f"{path}: a motion is a file that ends in {', '.join(SUFFIXES)}, not in "
            f"{suffix or 'nothing'}"
        )
    if suffix == ".csv":
        return read_csv_samples(path, joint_names, machine.joint_units), None
    if suffix == ".npz":
        return read_npz_samples(path, joint_names), None
    if suffix == ".mcap":
        return read_bag_samples(path, joint_names), None
    return read_message_samples(path, joint_names)


def _in_radians(samples: Samples, machine: Machine) -> Samples:
    """Samples whose angles were in degrees, those of a base too; lengths stay as they are."""
    factor = np.array([DEGREE if unit == "rad" else 1.0 for unit in machine.joint_units])
    rounding = {
        quantity: error * (1.0 if quantity == "time" else float(factor.max()))
        for quantity, error in (samples.rounding or {}).items()
    }
    values = {quantity: part * factor for quantity, part in samples.values.items()}
    base = samples.base
    if base is not None:
        base = base * [DEGREE if "yaw" in name else 1.0 for name in BASE_COLUMNS]
    return replace(samples, values=values, rounding=rounding, base=base)


def _exact(
    samples: Samples, machine: Machine, ground: Terrain, *, needed: bool
) -> Trajectory | None:
    """Motion whose accelerations at the nodes are the file's; None if they do not make one.

    Args:
        samples: The samples.
        machine: Gives the joints.
        ground: Ground on which the base drives.
        needed: Whether to raise the TrajectoryError where they make none.
    """
    rows = [samples.values[quantity] for quantity in samples.given]
    if samples.given[:3] != ("position", "velocity", "acceleration"):
        if needed:
            raise TrajectoryError(
                f"{samples.source}: a motion whose base drives needs positions, velocities and "
                "accelerations at all nodes, as Trajectory.to_csv writes them"
            )
        return None
    try:
        base = None
        if samples.base is not None:
            base = UnicycleMotion.from_table(samples.times, samples.base, ground)
        motion = Trajectory.from_rows(machine, samples.times, _filled(samples, rows), base)
        if fault := drift_fault(motion):
            raise TrajectoryError(fault)
    except TrajectoryError as cause:
        if needed:
            raise TrajectoryError(f"{samples.source}: {cause}") from None
        return None
    return motion


def _filled(samples: Samples, rows: list[Array]) -> list[Array]:
    """Quantities from the positions on, with jerks, and all or none of what follows them."""
    zero = np.zeros_like(rows[0])
    rows = [*rows[:3], samples.values.get("jerk", zero)]
    curved = [samples.values.get(quantity) for quantity in ("snap", "crackle")]
    if any(part is not None for part in curved):
        rows += [zero if part is None else part for part in curved]
    return rows


def _default(samples: Samples) -> str:
    """Rule for the quantities that a file gives."""
    if "velocity" not in samples.values:
        return "spline"
    # jerks are given by files of ours, whose pieces are cubics, and by no controller
    return "quintic" if samples.given == NEEDED["quintic"] else "cubic"


def _by_rule(samples: Samples, rule: str, machine: Machine) -> Trajectory:
    """Motion through the samples by a rule, after a check that they suffice for it."""
    if rule not in RULES:
        raise TrajectoryError(f"interpolation must be one of {', '.join(RULES)}, not {rule!r}")
    if lacking := [quantity for quantity in NEEDED[rule] if quantity not in samples.values]:
        able = [name for name, needed in NEEDED.items() if set(needed) <= set(samples.values)]
        raise TrajectoryError(
            f"{samples.source}: {rule} interpolation needs the {lacking[0]} of every joint; for "
            f"{' and '.join(samples.given)} there is {', '.join(able)}"
        )
    try:
        return _through(samples, rule, machine)
    except UnboundedAcceleration:
        raise
    except (TrajectoryError, ValueError, np.linalg.LinAlgError) as cause:
        raise TrajectoryError(
            f"{samples.source}: the {rule} through its samples cannot be computed: "
            f"{' '.join(str(cause).split())}"
        ) from None


def _through(samples: Samples, rule: str, machine: Machine) -> Trajectory:
    """Motion through the samples by a rule for which they suffice."""
    names, times, q = samples.joint_names, samples.times, samples.values["position"]
    with np.errstate(all="ignore"):  # numbers that overflow are refused by Trajectory
        if rule == "quintic":
            v, a = samples.values["velocity"], samples.values["acceleration"]
            return quintic_motion(names, times, q, v, a)
        if rule == "linear":
            motion = linear_motion(names, times, q)
            if motion is None:
                raise UnboundedAcceleration(_jump(samples, machine))
            return motion
        if rule == "spline":
            slack = 4.0 * samples.error_of("position")
            return cubic_motion(
                names, times, q, spline_rates(times, q, machine.limits.acceleration, slack)
            )
        return cubic_motion(names, times, q, samples.values["velocity"])


def _jump(samples: Samples, machine: Machine) -> str:
    """The largest jump of a rate of straight lines between the samples, in words."""
    jumps = rate_jumps(samples.times, samples.values["position"])
    at, joint = np.unravel_index(int(np.abs(jumps).argmax()), jumps.shape)
    name, unit = samples.joint_names[joint], machine.joint_units[joint]
    return (
        f"straight lines between its samples let the rate of joint {name!r} jump by "
        f"{abs(jumps[at, joint]):.3g} {unit}/s at {samples.times[at + 1]:.3f} s "
        f"({samples.rows[at + 1]}): no acceleration limit is kept, and the ZMP has no bound"
    )
