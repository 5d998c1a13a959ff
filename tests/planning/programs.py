"""Staged programs of several machines, their points, and functions of a step, for tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import zmp_sqp as zs
from benchmarks.problems.paper import paper_scene
from benchmarks.problems.scene import FOOTPRINT, Scene, Tree
from benchmarks.problems.terrain import rolling_map, unicycle_base
from tests.planning.conftest import pose
from tests.problems import slider
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.planning import simplified_coordinates
from zmp_sqp.planning.constraints.protocol import ConstraintRows, StageModel
from zmp_sqp.planning.constraints.tip_over import Contact, TipOverRows
from zmp_sqp.planning.program.driving.model import DrivingModel
from zmp_sqp.planning.program.driving.positions import Positions
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.limits import Boundary, PathBounds, PositionBound
from zmp_sqp.planning.program.model import ArmModel
from zmp_sqp.planning.program.rows import BoundConstraints, CornerRows, StageRows
from zmp_sqp.planning.program.staged import Motion, StagedProgram
from zmp_sqp.planning.program.stages import STATE

__all__ = [
    "CURVATURE",
    "DERIVATIVE",
    "GRIDS",
    "MARGIN",
    "REFERENCE",
    "ROUGH",
    "ROUNDING",
    "TILTED",
    "UNEVEN",
    "Case",
    "along",
    "arm_case",
    "driving_case",
    "path_bounds",
    "somewhere",
    "stage_rows",
]

Array = np.ndarray
DERIVATIVE = 2e-7  # error of central differences with a step of 1e-6, on rows of order one
CURVATURE = 1e-5  # relative error of central differences of gradients, of second differences
ROUNDING = 1e-12
REFERENCE = 2.3  # [s]
MARGIN = 0.05  # [m]
UNEVEN = np.array([0.0, 0.1, 0.35, 0.6, 1.0])
GRIDS = {"uniform": Grid.of(4), "uneven": Grid.of(UNEVEN)}

TILTED = Scene("feller_buncher", FOOTPRINT, Tree(3000.0), roll=-0.2, pitch=0.15)
ROUGH = rolling_map(
    -10.0, 5.0, waves=((0.6, 9.0, 0.3, 0.5), (0.4, 7.0, 1.9, 2.0)), low=(-40, -40), high=(40, 40)
)


@dataclass(frozen=True)
class Case:
    """A program with the scene that it was made from."""

    scene: Scene
    program: StagedProgram


def stage_rows(*models: StageModel, others: Sequence[ConstraintRows] = ()) -> StageRows:
    """Rows of tip-over with `MARGIN` and of contact, one corner per model, then others."""
    corners = []
    for model in models:
        contact = Contact().rows(model.machine, model.coordinates)
        rows = (("tip_over", TipOverRows.of(model.machine, MARGIN)), ("contact", contact))
        corners.append(CornerRows(model, rows))
    common = tuple(("other", rows) for rows in others)
    return StageRows(BoundConstraints(tuple(corners), common), REFERENCE)


def path_bounds(n: int, *, lower: float, upper: float) -> PathBounds:
    """Bounds of n coordinates, of the order of magnitude of the tests' points."""
    return PathBounds(
        position_lower=np.full(n, lower),
        position_upper=np.full(n, upper),
        velocity=np.full(n, 0.8),
        acceleration=np.linspace(1.0, 1.6, n),
        least_duration=1.6,  # more than half of the duration of `somewhere`
    )


def arm_case(machine: str, *, moving: bool, grid: Grid, corners: int = 1) -> Case:
    """The program of a machine that stands.

    Args:
        machine: "slider", "feller_buncher", or "simplified": the latter in two coordinates with
            bounds on the distance of the lumped mass, the paper's way.
        moving: Whether start and goal are in motion.
        grid: Of normalised time.
        corners: Payloads that the rows hold for, each a tenth heavier than the one before.
    """
    coordinates, others = None, ()
    if machine == "slider":
        scene, start, goal = slider().scene, np.array([-0.3]), np.array([0.3])
    elif machine == "simplified":
        scene, start, goal = paper_scene(), np.array([0.1, -0.5]), np.array([1.4, -0.9])
        loaded = scene.load()
        coordinates = simplified_coordinates(loaded, pose(*start))
        others = (zs.DistanceLimits(0.7, 1.3).rows(loaded, coordinates),)
    else:
        scene = TILTED
        start, goal = np.array([0.1, -0.5, -2.0, 0.5, -1.5]), np.array([1.4, -0.2, -1.2, 1.0, 0.3])
    loaded, n = scene.load(), len(start)
    v0, v1 = np.random.default_rng(7).uniform(-0.5, 0.5, (2, n)) * moving
    models = [
        ArmModel(
            loaded.with_payload_scaled(1.0 + 0.1 * i) if i else loaded,
            scene.ground.gravity(),
            coordinates or Coordinates.identity(n),
        )
        for i in range(corners)
    ]
    program = StagedProgram(
        stage_rows(*models, others=others),
        Boundary(start, v0),
        Boundary(goal, v1),
        path_bounds(n, lower=-2.9, upper=3.1),
        grid,
    )
    return Case(scene, program)


def driving_case(
    *, moving: bool, grid: Grid, terrain: Any = None, bounded: bool = True
) -> StagedProgram:
    """The program of an arm whose base drives on a terrain, None for a plane."""
    terrain = TILTED.ground if terrain is None else terrain
    machine, rng = TILTED.load(), np.random.default_rng(7)
    v0, v1 = rng.uniform(-0.4, 0.4, (2, 7)) * moving
    base = unicycle_base(
        (0.5, -0.2, 0.3), (-2.0, 1.0, -0.5), start_velocity=v0[5:], goal_velocity=v1[5:]
    )
    start = np.array([0.1, -0.5, -2.0, 0.5, -1.5, 0.0, 0.3])
    goal = np.array([1.4, -0.2, -1.2, 1.0, 0.3, base.travel, -0.5])
    bounds = path_bounds(7, lower=-9.0, upper=9.1)
    for limits in (bounds.position_lower, bounds.position_upper):
        limits[5:] *= 1e4  # the path has none
    sides = (PositionBound(0, -1.0, 3.0), PositionBound(1, 1.0, 1.5), PositionBound(1, -1.0, 1.0))
    return StagedProgram(
        stage_rows(DrivingModel(machine, terrain)),
        Boundary(start, v0),
        Boundary(goal, v1),
        bounds,
        grid,
        drive=Positions(base, terrain),
        position_bounds=sides if bounded else (),
    )


def somewhere(program: StagedProgram, seed: int = 0) -> Motion:
    """A motion with random accelerations, twice as slow as the reference."""
    shape = (program.grid.size, 2, program.n)
    controls = np.random.default_rng(seed).normal(0.0, 3.0, shape)
    return program.pack(controls, 1.3 * REFERENCE**2)


def along(program: StagedProgram, point: Motion) -> Callable[[Array], Motion]:
    """The motion whose states differ by a step d of the program's variables from a point's.

    Rates at start and goal go exactly with the square root of sigma, so that nothing needs to be
    changed for the motion to arrive. Positions of a base follow from its path.
    """
    stages, N, n = program.stages, program.grid.size, program.n
    columns, M = stages.columns, np.broadcast_to(stages.hermite, (N, stages.m, stages.m))

    def motion(step: Array) -> Motion:
        sigma = point.sigma + step[-1]
        states = point.states + STATE * np.where(columns >= 0, step[columns], 0.0)
        states[0, stages.rates] = np.sqrt(sigma) * program.first
        states[-1, stages.rates] = np.sqrt(sigma) * program.last
        sigmas = np.full((N, 1), sigma)
        variables = np.hstack([states[:-1] / STATE, states[1:, : 2 * n] / STATE, sigmas])
        controls = np.einsum("kuj,kj->ku", M[:, stages.controls], variables)
        return program.motion(controls, sigma)

    return motion
