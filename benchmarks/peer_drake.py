"""The minimum-time problem in Drake: KinematicTrajectoryOptimization, positions as a B-spline.

It has no constraint on the ground reaction, but bounds on the efforts of joints at sampled times.
Between the world and the machine there is therefore a revolute joint along each edge of the support
polygon, held at zero. Its effort is the moment of the ground reaction about that edge, and it has
to be positive: the ZMP is inside. Masses are shares of the whole mass, so that efforts divided by
gravity are lengths.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.math import BsplineBasis, KnotVectorType, RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    MultibodyForces,
    RevoluteJoint,
    SpatialInertia,
    UnitInertia,
    WeldJoint,
)
from pydrake.planning import KinematicTrajectoryOptimization
from pydrake.solvers import SnoptSolver, SolverOptions
from pydrake.trajectories import BsplineTrajectory

from benchmarks.harness import timed
from benchmarks.peer_checks import Motion
from benchmarks.peer_dynamics import Body, read_bodies
from benchmarks.problems.scene import NamedProblem, Scene

__all__ = ["DrakeAnswer", "edge_moments", "solved_by_drake"]

Array = np.ndarray
FREE = 1e3  # [m^2/s^2] bound on efforts that are not bounded; those of the machine are below 100
PIECES = 30  # polynomials of the B-spline
ORDER = 4  # cubic: accelerations are linear on each piece
SAMPLES = 60  # times at which the ZMP is constrained
ITERATIONS = 500  # of SNOPT, major


@dataclass(frozen=True)
class DrakeAnswer:
    """Answer of Drake with SNOPT."""

    status: str
    motion: Motion | None  # None where SNOPT has failed
    set_up: float  # [s] processor time of building plant and program
    seconds: float  # [s] processor time of the solve


def solved_by_drake(named: NamedProblem, positions: Array, duration: float) -> DrakeAnswer:
    """Fastest B-spline that SNOPT finds.

    Args:
        named: Problem from rest to rest.
        positions: Of the guess, at equidistant times (K, n) [rad].
        duration: Of the guess [s].
    """
    (program, edges), set_up = timed(lambda: _program(named, positions, duration))
    options = SolverOptions()
    options.SetOption(SnoptSolver.id(), "Major iterations limit", ITERATIONS)
    result, took = timed(lambda: SnoptSolver().Solve(program.prog(), None, options))
    status = str(result.get_solution_result()).split(".")[-1].removeprefix("k")
    if not result.is_success():
        return DrakeAnswer(status, None, set_up.processor, took.processor)
    motion = _motion(program.ReconstructTrajectory(result), edges)
    return DrakeAnswer(status, motion, set_up.processor, took.processor)


def edge_moments(scene: Scene, gravity: Array, q: Array, v: Array, a: Array) -> Array:
    """Efforts of the joints along the edges at a state of the arm, shape (E,) [m^2/s^2].

    They are moments of the ground reaction about the edges, divided by the whole mass.
    """
    plant, edges = _plant(scene, gravity)
    context, none = plant.CreateDefaultContext(), np.zeros(edges)
    plant.SetPositions(context, np.concatenate([none, q]))
    plant.SetVelocities(context, np.concatenate([none, v]))
    forces = MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)
    efforts = plant.CalcInverseDynamics(context, np.concatenate([none, a]), forces)
    return np.array(efforts[:edges])


def _program(
    named: NamedProblem, positions: Array, duration: float
) -> tuple[KinematicTrajectoryOptimization, int]:
    """Drake's program, and the number of edge joints, which come first."""
    problem, limits = named.problem, named.problem.machine.limits
    plant, edges = _plant(named.scene, problem.ground.gravity())
    none = np.zeros(edges)
    control_points = PIECES + ORDER - 1
    basis = BsplineBasis(ORDER, control_points, KnotVectorType.kClampedUniform, 0.0, duration)
    knots, times = np.array(basis.knots()), np.linspace(0.0, duration, len(positions))
    # control points of the guess: its positions at the Greville abscissae
    abscissae = [knots[i + 1 : i + ORDER].mean() for i in range(control_points)]
    points = np.array([np.interp(abscissae, times, column) for column in positions.T])
    guess = np.vstack([np.zeros((edges, control_points)), points])
    program = KinematicTrajectoryOptimization(
        BsplineTrajectory(basis, [column[:, None] for column in guess.T])
    )

    for s, pose in ((0.0, problem.start), (1.0, problem.goal)):
        full = np.concatenate([none, pose])
        program.AddPathPositionConstraint(full, full, s)
        program.AddPathVelocityConstraint(0.0 * full, 0.0 * full, s)
    lower, upper = limits.position_lower, limits.position_upper
    program.AddPositionBounds(np.concatenate([none, lower]), np.concatenate([none, upper]))
    rates = np.concatenate([none + 1.0, limits.velocity])
    program.AddVelocityBounds(-rates, rates)
    accelerations = np.concatenate([none + 1.0, limits.acceleration])
    program.AddAccelerationBounds(-accelerations, accelerations)
    free = np.full(problem.machine.size, FREE)
    program.AddEffortBoundsAtNormalizedTimes(
        plant,
        np.linspace(0.0, 1.0, SAMPLES),
        np.concatenate([none, -free]),
        np.concatenate([none + FREE, free]),
    )
    program.AddDurationConstraint(0.1 * duration, 10.0 * duration)
    program.AddDurationCost(1.0)
    return program, edges


def _plant(scene: Scene, gravity: Array) -> tuple[MultibodyPlant, int]:
    """The machine in Drake, on revolute joints along the edges of its support polygon."""
    plant, bodies = MultibodyPlant(0.0), read_bodies(scene.urdf)
    plant.mutable_gravity_field().set_gravity_vector(gravity)
    total = sum(body.mass for body in bodies) + (scene.tree.mass if scene.tree else 0.0)
    corners = np.array(scene.vertices)
    directions = np.roll(corners, -1, axis=0) - corners
    carrier, joints = plant.world_body(), []
    for i, (corner, along) in enumerate(zip(corners, directions, strict=True)):
        outer = plant.AddRigidBody(f"edge_{i}", SpatialInertia.Zero())
        at = RigidTransform(np.append(corner, 0.0))
        axis = np.append(along / np.linalg.norm(along), 0.0)
        frames = [
            plant.AddFrame(FixedOffsetFrame(f"{name}_{i}", parent.body_frame(), at))
            for name, parent in (("in", carrier), ("out", outer))
        ]
        joints.append(plant.AddJoint(RevoluteJoint(f"edge_{i}", *frames, axis)))
        carrier = outer
    frames_of = {"": carrier.body_frame()}
    for body in bodies:
        frames_of[body.name] = _add_body(plant, body, scene, total, frames_of, joints)
    for joint in joints:
        plant.AddJointActuator(f"{joint.name()}_drive", joint)
    plant.Finalize()
    return plant, len(corners)


def _add_body(
    plant: MultibodyPlant,
    body: Body,
    scene: Scene,
    total: float,
    frames: dict[str, Any],
    joints: list[Any],
) -> Any:
    """Add a link with its share of the mass; a revolute joint to its parent is appended."""
    masses = [(body.mass, body.com, body.inertia)]
    if scene.tree is not None and scene.tree.frame == body.name:
        masses.append((scene.tree.mass, np.array(scene.tree.com), scene.tree.inertia))
    inertia = SpatialInertia.Zero()
    for mass, com, about_com in masses:
        unit = UnitInertia(
            *(about_com[np.diag_indices(3)] / mass),
            *(about_com[(0, 0, 1), (1, 2, 2)] / mass),
        ).ShiftFromCenterOfMass(-com)
        inertia += SpatialInertia(mass / total, com, unit)
    added = plant.AddRigidBody(body.name, inertia)
    turned = RigidTransform()  # the root's frame is that of the edges
    if body.parent is not None:
        turned = RigidTransform(RotationMatrix(body.rotation), body.origin)
    parent = frames[body.parent or ""]
    if body.joint is None:
        plant.AddJoint(WeldJoint(f"{body.name}_weld", parent, added.body_frame(), turned))
    else:
        socket = plant.AddFrame(FixedOffsetFrame(f"{body.name}_socket", parent, turned))
        joints.append(
            plant.AddJoint(RevoluteJoint(body.joint, socket, added.body_frame(), body.axis))
        )
    return added.body_frame()


def _motion(spline: BsplineTrajectory, edges: int) -> Motion:
    """The arm's part of a spline."""
    curves = [spline, spline.MakeDerivative(1), spline.MakeDerivative(2)]

    def states(times: Array) -> tuple[Array, Array, Array]:
        q, v, a = (
            np.array(
                [curve.value(t).ravel()[edges:] for t in np.clip(times, 0.0, spline.end_time())]
            )
            for curve in curves
        )
        return q, v, a

    return Motion(float(spline.end_time()), states)
