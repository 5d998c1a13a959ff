"""A scenario to start from: a swing of one joint that a machine can make without tipping over."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import floor, log10
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ContactLost, ProblemError
from zmp_sqp.mechanics import Ground, Machine, stability_margin
from zmp_sqp.mechanics.named_poses import named_poses
from zmp_sqp.planning.problem.intervals import MANY_JOINTS, suggested_intervals
from zmp_sqp.scenario.text import joint_lines, one_line, table_lines, toml_value

__all__ = ["TRIED", "Starter", "find_starter", "starter_text"]

SWINGS = {"rad": np.radians([90.0, 60.0, 30.0, 10.0]), "m": np.array([1.0, 0.5, 0.2, 0.05])}
CHECKED = 33  # poses on the way from start to goal at which the machine has to stand
TRIED = 500  # random poses tried where it stands in no pose with a name
SEED = 0
DIGITS = 4  # decimals of start and goal
ASKED = 0.25  # share of the least margin at rest on the way that the scenario asks for
MOST_ASKED = 0.1  # [m]
PAYLOAD_LINES = (
    "",
    "# [machine.payload]       # what it carries: remove the number signs",
    "# mass = 100.0            # [kg]",
    "# com = [0.0, 0.0, 0.0]   # [m] its centre of mass in the frame of the link",
    "# frame = {frame}  # that carries it",
)
SUPPORT_LINES = (
    "",
    "# FILL IN the support polygon: corners in the frame of the root link, [x, y] in metres, x",
    "# forward, y left, counter-clockwise, in the plane z = height. Or, under [machine], the names",
    "# of the links on which it stands: contact_links = [...]; they need collision shapes.",
    "# [machine.support]",
    "# vertices = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]",
    "# height = 0.0",
)


@dataclass(frozen=True, slots=True, eq=False)
class Starter:
    """Start and goal of a scenario to start from.

    Attributes:
        pose: Name of the pose at the start.
        joint: Name of the joint that swings.
        start: Joint coordinates at the start, shape (n,) [rad or m].
        goal: Joint coordinates at the goal, shape (n,) [rad or m].
        margin: Distance between ZMP and edges to ask for [m]; not positive if the machine tips over
            on the way, NaN if it has no support polygon.
    """

    pose: str
    joint: str
    start: Array
    goal: Array
    margin: float

    @property
    def stands(self) -> bool:
        """Whether the machine stands at rest all the way from start to goal."""
        return self.margin > 0.0


def find_starter(machine: Machine, ground: Ground) -> Starter:
    """Start and goal at which the machine stands at rest, as it does everywhere in between.

    Hence a slow motion between them is safe, and a plan will be found. Of the poses with a name
    (see `named_poses`) the first one is taken from which a joint can swing; the first planned joint
    that turns is tried first, and large swings before small ones.

    Args:
        machine: The machine; limits that are missing count as none.
        ground: Ground on which it stands.

    Returns:
        Start and goal. If no joint can swing from any pose that was tried, a swing from the first
        pose from which one can swing within its limits, with a margin that is not positive.

    Raises:
        ProblemError: No joint can swing within its limits.
    """
    best = None
    for name, exact in _poses(machine):
        pose = _rounded(machine, exact)
        if best is not None and _least_margin(machine, ground, pose, pose) <= 0.0:
            continue
        for joint, goal in _goals(machine, pose):
            margin = _least_margin(machine, ground, pose, goal)
            if not margin <= 0.0:  # NaN without support polygon
                asked = float(np.minimum(MOST_ASKED, _round_down(ASKED * margin)))
                return Starter(name, joint, pose, goal, asked)
            best = best or Starter(name, joint, pose, goal, margin)
    if best is None:
        raise ProblemError(f"no joint of machine {machine.name!r} has room to move")
    return best


def starter_text(
    starter: Starter,
    machine: Machine,
    *,
    tables: Mapping[str, Mapping[str, Any]],
    title: str,
    heading: str,
    load: str,
) -> str:
    """Scenario file (TOML) with comments.

    Args:
        starter: Start, goal and margin.
        machine: Gives the joints.
        tables: Keys of [machine] and [ground], by name of the table; [machine] may hold tables.
        title: Title of the scenario, one line.
        heading: Comment at the top, without the leading number signs.
        load: Name of the frame for the payload that is commented out.
    """
    ground = tables["ground"]
    lines = [f"# {line}".rstrip() for line in heading.splitlines()]
    lines += ["", f"title = {toml_value(title)}", "", *table_lines("machine", tables["machine"])]
    if "payload" not in tables["machine"]:
        lines += [line.format(frame=toml_value(load)) for line in PAYLOAD_LINES]
    if not starter.stands:
        lines += SUPPORT_LINES
    lines += [
        "",
        "[ground]",
        f"roll_deg = {float(ground['roll_deg'])}   # negative leans the machine to its left",
        f"pitch_deg = {float(ground['pitch_deg'])}  # positive is nose down",
        "",
        "[motion]  # from rest to rest; start_deg and goal_deg are in degrees",
        *joint_lines("start", starter.start.tolist(), machine, f"pose '{one_line(starter.pose)}'"),
        *joint_lines(
            "goal", starter.goal.tolist(), machine, f"{one_line(starter.joint)} has swung"
        ),
        "",
        "[plan]",
    ]
    margin = starter.margin if starter.margin > 0.0 else 0.0
    lines.append(f"margin = {margin:g}  # [m] kept between the ZMP and every edge of the polygon")
    if machine.size > MANY_JOINTS:
        few = suggested_intervals(machine.size)
        lines.append(
            f"intervals = {few}  # of the time grid; 50 take twice as long with many joints"
        )
    return "\n".join([*lines, ""])


def _poses(machine: Machine) -> Iterator[tuple[str, Array]]:
    """Poses with a name, the middle of the limits before zero, then random ones."""
    named = named_poses(machine)
    zero = named.pop("zero")
    yield from named.items()
    yield "zero", zero
    rng = np.random.default_rng(SEED)
    low, high = _range(machine)
    for _ in range(TRIED):
        yield "found at random", rng.uniform(low, high)


def _rounded(machine: Machine, pose: Array) -> Array:
    """Pose with few digits, where that does not leave the limits."""
    rounded = np.round(pose, DIGITS)
    lower, upper = machine.limits.position_lower, machine.limits.position_upper
    return np.where((rounded < lower) | (rounded > upper), pose, rounded)


def _range(machine: Machine) -> tuple[Array, Array]:
    """Position limits; where there are none, half a turn or a metre to either side of zero."""
    limits = machine.limits
    wide = np.array([np.pi if unit == "rad" else 1.0 for unit in machine.joint_units])
    low = np.where(np.isfinite(limits.position_lower), limits.position_lower, -wide)
    high = np.where(np.isfinite(limits.position_upper), limits.position_upper, wide)
    return np.minimum(low, high), np.maximum(low, high)


def _goals(machine: Machine, start: Array) -> Iterator[tuple[str, Array]]:
    """Goals that differ from a start by the swing of one joint, with the name of that joint.

    Joints that turn come before those that slide.
    """
    lower = np.nan_to_num(machine.limits.position_lower, nan=-np.inf)
    upper = np.nan_to_num(machine.limits.position_upper, nan=np.inf)
    joints = enumerate(zip(machine.joint_names, machine.joint_units, strict=True))
    for i, (name, unit) in sorted(joints, key=lambda joint: joint[1][1] == "m"):
        for swing in SWINGS[unit]:
            for sign in (1.0, -1.0):
                goal = start.copy()
                goal[i] = np.round(start[i] + sign * swing, DIGITS)
                if lower[i] <= goal[i] <= upper[i]:
                    yield name, goal


def _least_margin(machine: Machine, ground: Ground, start: Array, goal: Array) -> float:
    """Least stability margin at rest between two poses [m]; NaN without support polygon."""
    if machine.support is None:
        return np.nan
    shares = np.linspace(0.0, 1.0, CHECKED)[:, None]
    poses = start + shares * (goal - start)
    still = np.zeros_like(poses)
    try:
        return float(stability_margin(machine, poses, still, still, ground).min())
    except ContactLost:
        return -np.inf


def _round_down(value: float) -> float:
    """Value rounded down to one significant digit; NaN stays."""
    if not value > 0.0:
        return value
    step = 10.0 ** floor(log10(value))
    return floor(value / step) * step
