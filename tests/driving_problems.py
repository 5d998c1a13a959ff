"""Seeded random drive-and-swing problems, and the check of a plan that shares nothing with the planner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import zmp_sqp as zs
from tests.checks import joint_limit_excess
from tests.planning.driving import zmp_from_poses
from tests.problems import FOOTPRINT, Scene, Tree

__all__ = ["KINDS", "TOLERANCES", "DrivingProblem", "driving_violation", "random_driving_problem"]

KINDS = ("ahead", "back", "arc ahead", "arc back", "sideways", "on the spot")  # seed modulo 6
STEEPEST = np.deg2rad(20.0)
PAYLOAD = (1000.0, 5000.0)  # [kg]
STANDING = 0.05  # [m] static margin of start and goal
POSES = 200  # arm poses tried on one ground before another ground is drawn
TOLERANCES = {  # of `driving_violation`
    "zmp": 5e-3,  # [m] differences of poses
    "limits": 1e-9,  # [rad, per second] closed form
    "arrival": 1e-3,  # [m, rad] the issue's
}
SAMPLES = 400  # of the independent ZMP
CLEARANCE = (0.05, 0.6)  # [m] of a corridor beside start and goal


@dataclass(frozen=True)
class DrivingProblem:
    """A problem, the scene it was made from, and what is special about it."""

    seed: int
    kind: str
    moving: bool
    corridor: bool
    scene: Scene
    problem: zs.Problem


def random_driving_problem(seed: int) -> DrivingProblem:
    """Base and arm from pose to pose on a plane slope; a quarter in motion at both ends, a quarter in a corridor.

    The same seed is the same problem for ever: results under benchmarks/results name seeds.
    """
    rng = np.random.default_rng([2021, seed])
    cycle, place = divmod(seed, len(KINDS))
    kind, moving, corridor = KINDS[place], cycle % 4 == 1, cycle % 4 == 3
    while True:
        steepness, downhill = STEEPEST * np.sqrt(rng.uniform()), rng.uniform(-np.pi, np.pi)
        roll, pitch = steepness * np.cos(downhill), steepness * np.sin(downhill)
        scene = Scene(
            "feller_buncher", FOOTPRINT, Tree(rng.uniform(*PAYLOAD)), roll=roll, pitch=pitch
        )
        machine = scene.load()
        ways = _random_base(rng, kind, moving=moving, corridor=corridor)
        lower, upper = (
            np.array(machine.limits.position_lower),
            np.array(machine.limits.position_upper),
        )
        lower[0], upper[0] = -np.pi, np.pi
        rates = rng.uniform(-0.1, 0.1, (2, machine.size)) * moving
        for start, goal in rng.uniform(lower, upper, (POSES, 2, machine.size)):
            try:
                still = _still(ways)
                # stands at both ends
                zs.Problem(machine, start, goal, scene.ground, margin=STANDING, base=still)
                problem = zs.Problem(
                    machine,
                    start,
                    goal,
                    scene.ground,
                    start_velocity=rates[0],
                    goal_velocity=rates[1],
                    base=zs.UnicycleBase(**ways),
                )
            except zs.ProblemError:  # tips over at rest, or cannot stop before a limit: draw again
                continue
            return DrivingProblem(seed, kind, moving, corridor, scene, problem)


def _random_base(
    rng: np.random.Generator, kind: str, *, moving: bool, corridor: bool
) -> dict[str, Any]:
    """Arguments of a `UnicycleBase`."""
    start = np.array([*rng.uniform(-5.0, 5.0, 2), rng.uniform(-np.pi, np.pi)])
    way, turn, aside = rng.uniform(1.0, 8.0), 0.0, 0.0
    if kind.startswith("arc"):
        turn = rng.uniform(0.3, 1.5) * rng.choice([-1.0, 1.0])
    if kind == "sideways":
        # from the mean heading
        turn, aside = rng.uniform(-0.3, 0.3), rng.uniform(0.1, 0.6) * rng.choice([-1.0, 1.0])
    if kind == "on the spot":
        way, turn = 0.0, rng.uniform(0.3, 3.0) * rng.choice([-1.0, 1.0])
    if "back" in kind or (kind == "sideways" and rng.uniform() < 0.5):
        way = -way
    heading = start[2] + 0.5 * turn + aside
    goal = start + np.array([way * np.cos(heading), way * np.sin(heading), turn])
    limits = {
        "max_speed": rng.uniform(0.8, 3.0),
        "max_acceleration": rng.uniform(0.5, 2.0),
        "max_yaw_rate": rng.uniform(0.3, 0.8),
        "max_yaw_acceleration": rng.uniform(0.5, 1.5),
    }
    found: dict[str, Any] = {"start": start, "goal": goal, **limits}
    if moving:
        along, turning = np.sign(way) * rng.uniform(0.0, 0.3, 2), rng.uniform(-0.1, 0.1, 2)
        found |= {
            f"{end}_velocity": (along[i], turning[i]) for i, end in enumerate(("start", "goal"))
        }
    if corridor:
        sides = np.vstack([start[:2], goal[:2]])
        room = rng.uniform(*CLEARANCE)
        bounds = np.column_stack([sides.min(axis=0) - room, sides.max(axis=0) + room])
        found |= {"x_bounds": bounds[0], "y_bounds": bounds[1]}
    return found


def _still(ways: dict[str, Any]) -> zs.UnicycleBase:
    return zs.UnicycleBase(
        **{key: value for key, value in ways.items() if not key.endswith("velocity")}
    )


def driving_violation(drawn: DrivingProblem, trajectory: zs.Trajectory) -> dict[str, float]:
    """How far a motion is from what it should be, from the bare numbers: ZMP by differences of the bodies' poses.

    Returns:
        `zmp` beyond an edge [m], `limits` of the joints [rad, per second], `arrival` of base and
        arm [m, rad].
    """
    problem = drawn.problem
    pad = 2e-3  # [s] that the differences need on either side
    times = np.linspace(pad, trajectory.duration - pad, SAMPLES)
    at_node = np.abs(times[:, None] - trajectory.times).min(axis=1) < pad
    # across a jump, differences mix both sides
    points = zmp_from_poses(drawn.scene, trajectory, times[~at_node])
    corners = np.array(drawn.scene.vertices)
    over = (np.abs(points) - corners.max(axis=0)).max()
    pose = trajectory.base(np.array([0.0, trajectory.duration]))[0]
    asked = np.vstack([problem.base.start, problem.base.goal])
    ends = np.vstack([problem.start, problem.goal])
    arrival = max(np.abs(pose - asked).max(), np.abs(trajectory.positions[[0, -1]] - ends).max())
    return {
        "zmp": float(over),
        "limits": joint_limit_excess(problem.machine.limits, trajectory),
        "arrival": float(arrival),
    }
