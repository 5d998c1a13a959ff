"""Seeded random problems in which base and arm move together on a plane slope."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import zmp_sqp as zs
from benchmarks.problems.scene import FOOTPRINT, Scene, Tree, arm_range

__all__ = ["KINDS", "DrivingProblem", "random_driving_problem"]

KINDS = ("ahead", "back", "arc ahead", "arc back", "sideways", "on the spot")  # seed modulo 6
STEEPEST = np.deg2rad(20.0)  # largest slope
PAYLOAD = (1000.0, 5000.0)  # [kg]
STANDING = 0.05  # [m] least stability margin at rest, at start and goal
POSES = 200  # pairs of arm poses tried on one slope before another slope is drawn
CLEARANCE = (0.05, 0.6)  # [m] of a corridor beside start and goal


@dataclass(frozen=True)
class DrivingProblem:
    """A problem, its scene, and the features by which its result is listed."""

    seed: int
    kind: str  # one of KINDS
    moving: bool  # base and arm are in motion at start and goal
    corridor: bool  # the base is kept within a rectangle around start and goal
    scene: Scene
    problem: zs.Problem


def random_driving_problem(seed: int) -> DrivingProblem:
    """Problem of base and arm between two random poses on a random slope.

    Of 24 consecutive seeds six start and arrive in motion, and six have a corridor.
    """
    rng = np.random.default_rng([2021, seed])
    cycle, number = divmod(seed, len(KINDS))
    kind, moving, corridor = KINDS[number], cycle % 4 == 1, cycle % 4 == 3
    while True:
        steepness, downhill = STEEPEST * np.sqrt(rng.uniform()), rng.uniform(-np.pi, np.pi)
        roll, pitch = steepness * np.cos(downhill), steepness * np.sin(downhill)
        scene = Scene(
            "feller_buncher", FOOTPRINT, Tree(rng.uniform(*PAYLOAD)), roll=roll, pitch=pitch
        )
        machine = scene.load()
        base = _random_base(rng, kind, moving=moving, corridor=corridor)
        lower, upper = arm_range(machine)
        rates = rng.uniform(-0.1, 0.1, (2, machine.size)) * moving
        for start, goal in rng.uniform(lower, upper, (POSES, 2, machine.size)):
            try:
                # posed at rest first: refused unless both ends have the margin
                zs.Problem(machine, start, goal, scene.ground, margin=STANDING, base=_at_rest(base))
                problem = zs.Problem(
                    machine,
                    start,
                    goal,
                    scene.ground,
                    start_velocity=rates[0],
                    goal_velocity=rates[1],
                    base=zs.UnicycleBase(**base),
                )
            except zs.ProblemError:  # tips over at rest, or cannot stop before a limit: draw again
                continue
            return DrivingProblem(seed, kind, moving, corridor, scene, problem)


def _random_base(
    rng: np.random.Generator, kind: str, *, moving: bool, corridor: bool
) -> dict[str, Any]:
    """Arguments of a `zs.UnicycleBase`."""
    start = np.array([*rng.uniform(-5.0, 5.0, 2), rng.uniform(-np.pi, np.pi)])
    chord, turn, aside = rng.uniform(1.0, 8.0), 0.0, 0.0  # [m], [rad], [rad]
    if kind.startswith("arc"):
        turn = rng.uniform(0.3, 1.5) * rng.choice([-1.0, 1.0])
    if kind == "sideways":
        # aside: angle from the mean heading to the chord
        turn, aside = rng.uniform(-0.3, 0.3), rng.uniform(0.1, 0.6) * rng.choice([-1.0, 1.0])
    if kind == "on the spot":
        chord, turn = 0.0, rng.uniform(0.3, 3.0) * rng.choice([-1.0, 1.0])
    if "back" in kind or (kind == "sideways" and rng.uniform() < 0.5):
        chord = -chord
    direction = start[2] + 0.5 * turn + aside
    goal = start + np.array([chord * np.cos(direction), chord * np.sin(direction), turn])
    limits = {
        "max_speed": rng.uniform(0.8, 3.0),
        "max_acceleration": rng.uniform(0.5, 2.0),
        "max_yaw_rate": rng.uniform(0.3, 0.8),
        "max_yaw_acceleration": rng.uniform(0.5, 1.5),
    }
    found: dict[str, Any] = {"start": start, "goal": goal, **limits}
    if moving:
        speeds, yaw_rates = np.sign(chord) * rng.uniform(0.0, 0.3, 2), rng.uniform(-0.1, 0.1, 2)
        found |= {
            f"{end}_velocity": (speeds[i], yaw_rates[i]) for i, end in enumerate(("start", "goal"))
        }
    if corridor:
        ends = np.vstack([start[:2], goal[:2]])
        clearance = rng.uniform(*CLEARANCE)
        bounds = np.column_stack([ends.min(axis=0) - clearance, ends.max(axis=0) + clearance])
        found |= {"x_bounds": bounds[0], "y_bounds": bounds[1]}
    return found


def _at_rest(base: dict[str, Any]) -> zs.UnicycleBase:
    """Base with these arguments, but at rest at both ends."""
    return zs.UnicycleBase(
        **{key: value for key, value in base.items() if not key.endswith("velocity")}
    )
