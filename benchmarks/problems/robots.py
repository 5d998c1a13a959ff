"""Machines of others, from the package example-robot-data, and random problems for them.

Nothing is adapted to a robot by hand. What is planned: the joints of the SRDF's group with "arm" in
its name that moves the most mass; without one all joints, if they are at most twelve and the robot
does not stand on what they move; else the chain of at most twelve joints with the most mass that
carries no foot. `load_robot(whole=True)` plans all joints that carry neither foot nor wheel, if
they are more than twelve. Where it stands: on what `load_machine` finds, else on the rectangle
around its lowest shapes. How fast: its velocity limits, 1 rad/s or 0.3 m/s where there are none, at
most 6 rad/s or 2 m/s, reached in half a second.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import zmp_sqp as zs
from zmp_sqp.mechanics.urdf.srdf import read_srdf
from zmp_sqp.planning.problem.intervals import MANY_JOINTS, suggested_intervals

__all__ = [
    "MOST_JOINTS",
    "Robot",
    "blocked_at",
    "load_robot",
    "random_problems",
    "robot_files",
    "robots_folder",
    "standing_share",
]

PACKAGE = "example-robot-data"
MOST_JOINTS = MANY_JOINTS
SPEEDS = {"rad": 1.0, "m": 0.3}  # [rad/s or m/s] where the URDF gives none
FASTEST = {"rad": 6.0, "m": 2.0}  # [rad/s or m/s] where it gives more, which stands for no limit
RANGES = {"rad": np.pi, "m": 0.5}  # [rad or m] to either side of zero where there are no limits
NO_LIMIT = 100.0  # [rad or m] beyond which a limit stands for none
STARTING = 0.5  # [s] in which a joint reaches its velocity limit
STEEPEST = np.radians(10.0)  # of roll and pitch of the slopes
TRIED, IMPROVED = 3000, 12  # random poses, and rounds that improve them, at one joint value
VALUES = 12  # of a joint between start and goal, at which standing poses are looked for
POSES = 4000  # random poses among which standing ones are looked for
FOOT = 0.1  # [m] above the lowest link, within which links are feet
WHEEL = re.compile("wheel|caster")
ARM = re.compile("arm|manipulator", re.IGNORECASE)


@dataclass(frozen=True, slots=True, eq=False)
class Robot:
    """A robot that was loaded.

    Attributes:
        path: Its URDF.
        machine: The machine with limits and support, or None if it is not planned.
        planned: How the planned joints were chosen.
        support: Where the support polygon comes from.
        said: Warnings of `load_machine`.
        refusal: Why it is not planned; empty if it is.
    """

    path: Path
    machine: zs.Machine | None
    planned: str = ""
    support: str = ""
    said: tuple[str, ...] = ()
    refusal: str = ""


def robots_folder() -> Path | None:
    """Folder of the robots; None if the package is not installed."""
    try:
        found = distribution(PACKAGE).locate_file(f"cmeel.prefix/share/{PACKAGE}/robots")
    except PackageNotFoundError:
        return None
    return Path(str(found))


def robot_files(folder: Path) -> tuple[Path, ...]:
    """All URDFs, sorted."""
    return tuple(sorted(folder.rglob("*.urdf")))


def load_robot(path: Path, folder: Path, *, whole: bool = False) -> Robot:
    """Load a robot and choose what is planned; raises MachineError if it does not load.

    Args:
        path: URDF.
        folder: Folder of all robots.
        whole: Whether to plan all joints that carry neither foot nor wheel, if there are more than
            twelve, instead of one arm.
    """
    options: dict[str, Any] = {"package_dirs": [folder.parents[1]]}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        complete = zs.load_machine(path, **options)
        texts = tuple(str(warning.message).removeprefix(f"{path}: ") for warning in said)
        options["srdf"] = _srdf(path, complete)
        if whole:
            chosen, planned = _all_free(complete)
        else:
            chosen, planned = _chosen(path, complete, texts, options)
        if chosen is None:
            return Robot(path, None, said=texts, refusal=planned)
        machine = zs.load_machine(path, **options, **chosen)
    machine, support = _standing(_moving(machine))
    refusal = "" if machine.support else f"no support polygon: {machine.support_hint}"
    return Robot(path, None if refusal else machine, planned, support, texts, refusal)


def standing_share(machine: zs.Machine) -> float:
    """Share of random poses in which a machine stands at rest on level ground."""
    return len(_standing_poses(machine, zs.Slope(), np.random.default_rng(0))) / POSES


def random_problems(robot: Robot, count: int) -> Iterator[tuple[int, zs.Problem]]:
    """Seeded problems between random poses in which the robot stands on a random slope.

    Slopes on which it stands in none of the random poses are left out; there are none if it stands
    on none of the first three, and at most three slopes are drawn per problem.
    """
    machine = robot.machine
    if machine is None:
        return
    left = count
    for seed in range(3 * count):
        rng = np.random.default_rng(seed)
        roll, pitch = rng.uniform(-STEEPEST, STEEPEST, 2)
        slope = zs.Slope(roll=roll, pitch=pitch)
        standing = _standing_poses(machine, slope, rng)
        if len(standing) >= 2:
            yield (
                seed,
                zs.Problem(
                    machine,
                    standing[0],
                    standing[1],
                    ground=slope,
                    intervals=suggested_intervals(machine.size),
                ),
            )
            left -= 1
        if left == 0 or (seed == 2 and left == count):
            return


def blocked_at(problem: zs.Problem) -> tuple[str, float, float] | None:
    """Joint, its value and the best margin [m] there, where every way to the goal is blocked.

    A joint passes all values between start and goal. Where the best pose that is found with the
    joint at one of them tips over at rest, no slow motion leads to the goal. Best poses are looked
    for among random ones, then by smaller and smaller random changes of the best twenty.
    """
    machine, rng = problem.machine, np.random.default_rng(0)
    low, high = _ranges(machine)
    low = np.minimum(low, np.minimum(problem.start, problem.goal))
    high = np.maximum(high, np.maximum(problem.start, problem.goal))

    def margins(q: np.ndarray) -> np.ndarray:
        still = np.zeros_like(q)
        return np.asarray(zs.stability_margin(machine, q, still, still, problem.ground))

    def best(joint: int, value: float) -> float:
        q, step = rng.uniform(low, high, (TRIED, machine.size)), 0.2 * (high - low)
        q[:, joint] = value
        found = margins(q)
        for _ in range(IMPROVED):
            if found.max() > 0.0:
                break
            kept = np.argsort(-found)[:20]
            sizes = rng.choice([1.0, 0.1], (300, 1))
            new = np.repeat(q[kept], 15, axis=0) + sizes * step * rng.normal(size=(300, len(low)))
            new = np.clip(new, low, high)
            new[:, joint] = value
            q, found = np.vstack([q[kept], new]), np.concatenate([found[kept], margins(new)])
            step = 0.75 * step
        return float(found.max())

    worst: tuple[str, float, float] | None = None
    for joint, name in enumerate(machine.joint_names):
        for value in np.linspace(problem.start[joint], problem.goal[joint], VALUES + 2)[1:-1]:
            margin = best(joint, float(value))
            if margin < min(0.0, np.inf if worst is None else worst[2]):
                worst = name, float(value), margin
    return worst


def _standing_poses(machine: zs.Machine, slope: zs.Slope, rng: np.random.Generator) -> np.ndarray:
    """Random poses within the joint limits at which the machine stands at rest."""
    low, high = _ranges(machine)
    q = rng.uniform(low, high, (POSES, machine.size))
    still = np.zeros_like(q)
    return q[zs.stability_margin(machine, q, still, still, slope) > 1e-3 * machine.support.reach]


def _ranges(machine: zs.Machine) -> tuple[np.ndarray, np.ndarray]:
    """Position limits, or the usual ranges where there are none."""
    low, high = machine.limits.position_lower, machine.limits.position_upper
    wide = np.array([RANGES[unit] for unit in machine.joint_units])
    low = np.where(np.abs(low) < NO_LIMIT, low, np.minimum(-wide, high))
    high = np.where(np.abs(high) < NO_LIMIT, high, np.maximum(wide, low))
    return low + 0.0, high + 0.0  # no -0.0, which numpy's generators take for less than 0.0


def _srdf(path: Path, whole: zs.Machine) -> Path | None:
    """SRDF that goes with a URDF: of its name, or the only one of its package that fits."""
    package = next(part for part in path.parents if part.parent.name == "robots")
    fitting = []
    for candidate in sorted(package.rglob("*.srdf")):
        try:
            zs.load_machine(path, srdf=candidate)
        except zs.MachineError:
            continue
        fitting.append(candidate)
    same = [candidate for candidate in fitting if candidate.stem == path.stem]
    return (same or (fitting if len(fitting) == 1 else []) or [None])[0]


def _chosen(
    path: Path, whole: zs.Machine, said: Sequence[str], options: dict[str, Any]
) -> tuple[dict[str, Any] | None, str]:
    """Arguments of `load_machine` that choose the planned joints, and how they were chosen."""
    if not whole.size:
        return None, "no movable joint"
    if options["srdf"] is not None:
        masses = {}
        for group in read_srdf(options["srdf"]).groups:
            try:
                machine = zs.load_machine(path, group=group, **options)
            except zs.MachineError:
                continue
            if ARM.search(group) and 2 <= machine.size <= MOST_JOINTS:
                masses[group] = _moved_mass(machine, machine.joint_names)
        if masses:
            best = max(masses, key=masses.__getitem__)
            return {"group": best}, f"group {best}"
    wheeled = any(WHEEL.search(name) for name in whole.joint_names)
    hanging = [text for text in said if "moves and is" in text]
    if whole.size <= MOST_JOINTS and not wheeled:
        return (None, f"no arm on a base: {hanging[0]}") if hanging else ({}, "all joints")
    chain = _heaviest_chain(whole)
    if not chain:
        return None, "no arm: every chain of joints ends in a foot"
    return {"joints": chain}, f"chain of {len(chain)} joints"


def _moved_mass(machine: zs.Machine, names: Sequence[str]) -> float:
    """Mass of the bodies that some joints carry directly [kg]."""
    return float(sum(machine.model.inertias[machine.model.getJointId(name)].mass for name in names))


def _all_free(whole: zs.Machine) -> tuple[dict[str, Any] | None, str]:
    """Arguments that choose all joints that carry neither foot nor wheel, if they are many."""
    carrying = {at for foot in _feet(whole) for at in list(whole.model.supports[foot])}
    names = [
        name
        for name in whole.joint_names
        if whole.model.getJointId(name) not in carrying and not WHEEL.search(name)
    ]
    if len(names) <= MOST_JOINTS:
        return None, f"{len(names)} joints carry neither foot nor wheel"
    return {"joints": names}, f"all {len(names)} that carry no foot"


def _feet(whole: zs.Machine) -> set[int]:
    """Joints that carry the lowest links directly."""
    model, data = whole.model, whole.model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    heights = {
        i: data.oMf[i].translation[2]
        for i, frame in enumerate(model.frames)
        if frame.type == pin.FrameType.BODY
    }
    return {
        model.frames[i].parentJoint for i, z in heights.items() if z < min(heights.values()) + FOOT
    }


def _heaviest_chain(whole: zs.Machine) -> list[str]:
    """Planned joints of the chain with the most mass that carries no foot."""
    model, feet = whole.model, _feet(whole)
    best: list[str] = []
    for joint in range(2, model.njoints):
        path = [at for at in list(model.supports[joint]) if at > 1]
        below = [at for at in range(2, model.njoints) if path[0] in list(model.supports[at])]
        names = [model.names[at] for at in path if model.names[at] in whole.joint_names]
        if feet & set(below) or not 2 <= len(names) <= MOST_JOINTS:
            continue
        if _moved_mass(whole, names) > _moved_mass(whole, best):
            best = names
    return best


def _moving(machine: zs.Machine) -> zs.Machine:
    """The machine with velocity limits where it has none, and acceleration limits."""
    default = np.array([SPEEDS[unit] for unit in machine.joint_units])
    most = np.array([FASTEST[unit] for unit in machine.joint_units])
    limits = machine.limits
    velocity = np.where(np.isnan(limits.velocity), default, np.minimum(limits.velocity, most))
    wide = np.array([RANGES[unit] for unit in machine.joint_units])
    lower = np.where(np.isnan(limits.position_lower), -wide, limits.position_lower)
    upper = np.where(np.isnan(limits.position_upper), wide, limits.position_upper)
    changes = {
        "velocity": velocity,
        "acceleration": velocity / STARTING,
        "position_lower": lower,
        "position_upper": upper,
    }
    return replace(machine, limits=limits.updated(changes, machine.joint_names))


def _standing(machine: zs.Machine) -> tuple[zs.Machine, str]:
    """The machine with a support polygon, and where that comes from."""
    if machine.support is not None:
        return machine, "contacts"
    suggested = re.search(r"SupportPolygon\((\[.*\]), height=(\S+)\)", machine.support_hint)
    if suggested is None:
        return machine, ""
    numbers = re.findall(r"-?\d+\.\d+", suggested[1])
    vertices = np.array(numbers, dtype=float).reshape(-1, 2)
    return machine.with_support(zs.SupportPolygon(vertices, float(suggested[2]))), "rectangle"
