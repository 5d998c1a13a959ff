"""TOPP-RA along a given path, with the zero moment point as a second-order constraint.

TOPP-RA (Pham & Pham 2018) finds the fastest motion along a path on a grid of path positions. Along
the path of a planned motion it tells how far that motion is from the optimum along its own path.
The first and the last interval of the motion are kept: near rest the path hardly moves, and what
TOPP-RA does in the first cells breaks the constraints between their starts.
Inverse dynamics are those of `peer_dynamics`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import toppra
from toppra import algorithm, constraint
from toppra.interpolator import AbstractGeometricPath

import zmp_sqp as zs
from benchmarks.harness import timed
from benchmarks.peer_checks import Motion, polynomial_states
from benchmarks.peer_dynamics import wrench_function
from benchmarks.peer_transcription import bare_mass, edges_outward
from benchmarks.problems.scene import GRAVITY, NamedProblem

__all__ = ["Retimed", "retimed"]

Array = np.ndarray


@dataclass(frozen=True)
class Retimed:
    """Answer of TOPP-RA."""

    status: str
    motion: Motion | None  # None where TOPP-RA has failed
    seconds: float  # [s] processor time


class _Path(AbstractGeometricPath):
    """Path of a motion; the path position is the time of that motion, so that its pace is 1."""

    def __init__(self, trajectory: zs.Trajectory) -> None:
        self._trajectory = trajectory

    def __call__(self, path_positions: Array, order: int = 0) -> Array:
        at = np.atleast_1d(path_positions)
        found = polynomial_states(self._trajectory, at)[order]
        return found if np.ndim(path_positions) else found[0]

    @property
    def dof(self) -> int:
        return len(self._trajectory.joint_names)

    @property
    def path_interval(self) -> Array:
        return self._trajectory.times[[1, -2]]


def retimed(named: NamedProblem, trajectory: zs.Trajectory, *, cells: int) -> Retimed:
    """Fastest motion along the path of a trajectory that TOPP-RA finds.

    Args:
        named: Problem that the trajectory solves.
        trajectory: From rest to rest.
        cells: Of the grid of path positions, in each interval of the trajectory but the first and
            the last. Constraints hold at the start of each cell (collocation), where accelerations
            may jump.
    """
    path, nodes = _Path(trajectory), trajectory.times[1:-1]
    grid = (nodes[:-1, None] + np.diff(nodes)[:, None] * np.arange(cells) / cells).ravel()
    grid = np.append(grid, nodes[-1])
    toppra.setup_logging("CRITICAL")

    def solve() -> tuple[Array | None, Array | None, Array | None]:
        solver = algorithm.TOPPRA(_constraints(named), path, grid, solver_wrapper="seidel")
        return solver.compute_parameterization(1.0, 1.0)

    (_, pace, _), took = timed(solve)
    if pace is None or not np.isfinite(pace).all():
        return Retimed("no parametrization", None, took.processor)
    # the ends at the pace of the trajectory, which is 1
    grid = np.concatenate([[0.0], grid, [trajectory.duration]])
    pace = np.concatenate([[1.0], pace, [1.0]])
    return Retimed("solved", _motion(trajectory, grid, pace), took.processor)


def _constraints(named: NamedProblem) -> list[constraint.Constraint]:
    """Limits of rates and accelerations, and tilting moments about the edges of the polygon."""
    problem, scene = named.problem, named.scene
    limits, n = problem.machine.limits, problem.machine.size
    wrench, load = wrench_function(scene), scene.tree.mass if scene.tree else 0.0
    weight = (bare_mass(scene, problem.machine) + load) * GRAVITY
    gravity, (outward, offsets) = problem.ground.gravity(), edges_outward(scene)

    def tilting(q: Array, v: Array, a: Array) -> Array:
        f = np.array(wrench(q, v, a, gravity, load)).ravel()
        return np.array((outward[:, 0] * -f[4] + outward[:, 1] * f[3] - offsets * f[2]) / weight)

    edges = len(offsets)
    collocation = constraint.DiscretizationType.Collocation
    return [
        constraint.JointVelocityConstraint(np.column_stack([-limits.velocity, limits.velocity])),
        constraint.JointAccelerationConstraint(
            np.column_stack([-limits.acceleration, limits.acceleration]),
            discretization_scheme=collocation,
        ),
        constraint.SecondOrderConstraint(
            tilting,
            lambda q: np.eye(edges),
            lambda q: np.zeros(edges),
            n,
            discretization_scheme=collocation,
        ),
    ]


def _motion(trajectory: zs.Trajectory, grid: Array, pace: Array) -> Motion:
    """The motion that follows a path with constant path accelerations in each cell."""
    lengths = np.diff(grid)
    steps = 2.0 * lengths / (pace[:-1] + pace[1:])
    times = np.concatenate([[0.0], np.cumsum(steps)])
    rates = np.diff(pace**2) / (2.0 * lengths)  # path acceleration of each cell

    def states(t: Array) -> tuple[Array, Array, Array]:
        k = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(rates) - 1)
        since, u = (t - times[k])[:, None], rates[k][:, None]
        speed = pace[k][:, None] + u * since
        s = grid[k][:, None] + since * (pace[k][:, None] + 0.5 * u * since)
        s = np.clip(s, grid[k][:, None], grid[k + 1][:, None] - 1e-12)
        q, v, a = polynomial_states(trajectory, s.ravel())
        return q, v * speed, a * speed**2 + v * u

    return Motion(float(times[-1]), states)
