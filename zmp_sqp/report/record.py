"""What a report shows beside the results of a plan: the scene, and samples of its motions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ZmpSqpError
from zmp_sqp.mechanics import Ground, Heightmap, Machine
from zmp_sqp.mechanics.urdf.sources import find_machine
from zmp_sqp.motion.trajectory_json import json_content
from zmp_sqp.planning import Plan, Problem, Trajectory
from zmp_sqp.report.parts import DIGITS, machine_parts, pose_entries
from zmp_sqp.report.sampling import MotionSamples, root_at_rest
from zmp_sqp.scenario import Scenario
from zmp_sqp.scenario.load import read_content
from zmp_sqp.simulation import replay

__all__ = [
    "RECORD_KEYS",
    "bare_record",
    "body_poses",
    "ground_fields",
    "make_record",
    "motion_fields",
    "scene_fields",
    "urdf_of",
]

RECORD_KEYS = """\
  scenario_text             content of the scenario file
  trajectory                the motion as trajectory.json has it; null without success
  record                    what zmp-sqp report shows beside this, rounded for display: parts of
                            the machine, support polygon, ground, samples of the motion (without
                            success of the last one of the search, which is not safe) and of the
                            stability-blind motion (phase plane; with a base that drives, planned
                            on a plate that cannot tip over), with --html also how that one tips the
                            machine over in MuJoCo; null if no motion can be shown
"""
SAMPLES, BLIND_SAMPLES = 300, 200  # of a motion, about
FALL_SAMPLES = 200  # of a simulation
MOST_HEIGHTS = 90  # rows and columns of a terrain that is drawn
RESOLUTIONS = {"position": 6, "rate": 6, "acceleration": 5}  # digits behind the point
UP = np.array([0.0, 0.0, 1.0])


def make_record(
    scenario: Scenario, found: Plan, baseline: Trajectory | None, *, simulate: bool = False
) -> dict[str, Any]:
    """Entries `RECORD_KEYS` of the results of a plan, ready for JSON.

    Args:
        scenario: Where machine and meshes come from.
        found: The plan.
        baseline: Stability-blind motion between the plan's start and goal; None if there is none.
        simulate: Whether to simulate how that motion tips the machine over, if MuJoCo is installed.
    """
    motion = found.attempt
    record = motion and _record(scenario, found.problem, motion, baseline)
    if record and baseline and simulate:
        record["blind"]["fall"] = _fall(found.problem, baseline)
    return bare_record(scenario, found) | {"record": record}


def bare_record(scenario: Scenario, found: Plan) -> dict[str, Any]:
    """Entries `RECORD_KEYS` with the scenario and the motion alone.

    Args:
        scenario: Where the plan's problem comes from.
        found: The plan.
    """
    try:
        text = scenario.path.read_text(encoding="utf-8")
    except OSError:
        text = ""
    nodes = None
    if found.success:
        safe = found.trajectory
        nodes = json_content(safe.joint_names, safe.times, safe.node_rows(), safe.base)
    return {"scenario_text": text, "trajectory": nodes, "record": None}


def _record(
    scenario: Scenario, problem: Problem, motion: Trajectory, baseline: Trajectory | None
) -> dict[str, Any] | None:
    parts = machine_parts(problem.machine, *_files(scenario))
    joints = sorted({part["joint"] for part in parts})
    try:
        planned = motion_fields(problem, motion, joints, SAMPLES)
    except ZmpSqpError:  # a motion that failed may lead off the map
        return None
    blind = None
    if baseline is not None:
        blind = motion_fields(problem, baseline, joints, BLIND_SAMPLES, charts=False)
        blind["fall"] = None
    scene = scene_fields(problem.machine, problem.ground, problem.margin)
    return {**scene, "parts": parts, "plan": planned, "blind": blind}


def scene_fields(machine: Machine, ground: Ground, margin: float) -> dict[str, Any]:
    """What stands still in the picture: machine's name, support polygon, ground, margin [m]."""
    support = machine.support
    return {
        "machine": machine.name,
        "support": support and {"vertices": support.vertices.tolist(), "height": support.height},
        "margin_asked": margin,
        "ground": ground_fields(ground),
    }


def _fall(problem: Problem, baseline: Trajectory) -> dict[str, Any] | None:
    """Simulated poses of the root, ground frame; None if the machine stays or nothing simulates.

    Returns:
        `times` [s], `root` (poses), and `over`: whether it tilted by 45 degrees in the end.
    """
    try:
        found = replay(problem.machine, baseline, problem.ground)
    except ZmpSqpError:  # MuJoCo is not installed, or cannot simulate this machine
        return None
    if not found.tipped:
        return None
    chosen = np.linspace(0, len(found.times) - 1, FALL_SAMPLES).astype(int)
    positions, rotations = root_at_rest(problem)
    rest = pin.SE3(rotations, positions)
    x, y, z, w, i, j, k = found.poses[chosen].T
    poses = np.column_stack([x, y, z, i, j, k, w])  # MuJoCo's quaternions begin with w
    return {
        "times": _rounded(found.times[chosen], 4),
        "root": [pose_entries(rest * pin.XYZQUATToSE3(pose)) for pose in poses],
        "over": found.fell,
    }


def _files(scenario: Scenario) -> tuple[Path | None, list[Path]]:
    """URDF of a scenario, and the folders of its packages."""
    try:
        return urdf_of(read_content(scenario.path)[0]["machine"], scenario.path.parent)
    except (ZmpSqpError, KeyError):
        return None, []


def urdf_of(table: Mapping[str, Any], folder: Path) -> tuple[Path, list[Path]]:
    """URDF of the table [machine] of a scenario, and the folders of its packages.

    Args:
        table: The table.
        folder: Folder to which its paths are relative.

    Raises:
        MachineError: There is no such machine.
        KeyError: The table names none.
    """
    urdf = find_machine(table["name"] if "name" in table else folder / table["urdf"])
    return urdf, [folder / name for name in table.get("package_dirs", ())]


def ground_fields(ground: Ground) -> dict[str, Any]:
    """Rotation from the ground frame to one whose z axis is vertical, and heights of a terrain."""
    if isinstance(ground, Heightmap):
        step = -(-max(ground.heights.shape) // MOST_HEIGHTS)
        heights = ground.heights[::step, ::step]
        return {
            "rotation": [0.0, 0.0, 0.0, 1.0],
            "heights": np.round(heights, 3).tolist(),
            "resolution": ground.resolution * step,
            "origin": list(ground.origin),
        }
    up = -ground.gravity()
    turn = pin.Quaternion.FromTwoVectors(up / np.linalg.norm(up), UP).coeffs()
    return {"rotation": _rounded(turn, 6), "heights": None, "resolution": None, "origin": None}


def motion_fields(
    problem: Problem, motion: Trajectory, joints: Sequence[int], count: int, *, charts: bool = True
) -> dict[str, Any]:
    """Samples of a motion: poses of bodies in the root frame and of the root in the ground frame.

    Args:
        problem: Gives machine, ground, constraints and what is uncertain.
        motion: The motion.
        joints: Indices in the Pinocchio model of the joints whose bodies are drawn.
        count: Number of samples, about.
        charts: Whether to add the curves over time.

    Returns:
        `duration`, `times` [s], `root` and `bodies` (`pose_entries`; one entry for a body that
        stands), `zmp` [m] (null where the ground would have to pull), `margin` [m], `charts`.

    Raises:
        ProblemError: The motion leads off a heightmap.
    """
    samples = MotionSamples.of(problem, motion, count)
    margin = samples.rooms[0]
    roots = zip(samples.root_positions, samples.root_rotations, strict=True)
    fields = {
        "duration": float(samples.times[-1]),
        "times": _rounded(samples.times, 9),
        "root": [pose_entries(pin.SE3(turn, at)) for at, turn in roots],
        "bodies": body_poses(problem.machine, samples.states[0], joints),
        "zmp": [None if np.isnan(point).any() else _rounded(point, 5) for point in samples.zmp],
        "margin": _finite(margin.room, 6),
    }
    return fields | {"charts": list(_charts(problem, samples))} if charts else fields


def body_poses(machine: Machine, q: Array, joints: Sequence[int]) -> dict[str, list[list[float]]]:
    """Poses of the bodies behind some joints in the root frame, by index of the joint.

    Args:
        machine: The machine.
        q: Joint coordinates, shape (K, n) [rad or m].
        joints: Indices of the joints in the Pinocchio model.
    """
    model = machine.model
    data = model.createData()
    poses = np.empty((len(joints), len(q), 7))
    for k, configuration in enumerate(machine.configuration(q)):
        pin.forwardKinematics(model, data, configuration)
        for i, joint in enumerate(joints):
            poses[i, k] = pin.SE3ToXYZQUAT(data.oMi[joint])
    rounded = np.round(poses, DIGITS)
    return {  # a body that stands needs one pose
        str(joint): (rows[:1] if (rows == rows[0]).all() else rows).tolist()
        for joint, rows in zip(joints, rounded, strict=True)
    }


def _charts(problem: Problem, samples: MotionSamples) -> Iterator[dict[str, Any]]:
    """Curves over time with their bounds: room of constraints, then every joint, then the base."""
    for found in samples.rooms:
        yield {
            "group": "constraint",
            "title": found.name,
            "unit": " or ".join(dict.fromkeys(found.units)),
            "values": _finite(found.room, 6),
            "lower": 0.0,
            "upper": None,
            "rows": list(found.labels),
            "units": list(found.units),
            "row": found.row.tolist(),
        }
    machine, limits = problem.machine, problem.machine.limits
    bounds = {
        "position": (limits.position_lower, limits.position_upper),
        "rate": (-limits.velocity, limits.velocity),
        "acceleration": (-limits.acceleration, limits.acceleration),
    }
    for i, (name, unit) in enumerate(zip(machine.joint_names, machine.joint_units, strict=True)):
        for rows, (group, (lower, upper)), per in zip(
            samples.states, bounds.items(), ("", "/s", "/s^2"), strict=True
        ):
            yield _chart(group, name, unit + per, rows[:, i], (lower[i], upper[i]))
    if samples.base is not None:
        yield from _base_charts(problem, samples.base)


def _base_charts(problem: Problem, state: tuple[Array, Array, Array]) -> Iterator[dict[str, Any]]:
    """Speed and yaw rate of a base that drives, and their rates."""
    base = problem.base
    _, rates, accelerations = state
    nothing = (np.nan, np.nan)
    speeds = nothing if base is None else (base.max_speed, base.max_yaw_rate)
    changes = nothing if base is None else (base.max_acceleration, base.max_yaw_acceleration)
    for i, (name, unit) in enumerate((("base speed", "m"), ("base yaw", "rad"))):
        for group, rows, most, per in (
            ("rate", rates, speeds[i], "/s"),
            ("acceleration", accelerations, changes[i], "/s^2"),
        ):
            yield _chart(group, name, unit + per, rows[:, i], (-most, most))


def _chart(
    group: str, title: str, unit: str, values: Array, bounds: tuple[float, float]
) -> dict[str, Any]:
    lower, upper = (float(bound) if np.isfinite(bound) else None for bound in bounds)
    return {
        "group": group,
        "title": title,
        "unit": unit,
        "values": _finite(values, RESOLUTIONS[group]),
        "lower": lower,
        "upper": upper,
        "rows": None,
        "units": None,
        "row": None,
    }


def _finite(values: Array, digits: int) -> list[float | None]:
    """Rounded numbers, None where a value is not finite."""
    return [round(value, digits) if np.isfinite(value) else None for value in values.tolist()]


def _rounded(values: Array, digits: int) -> list[float]:
    return [round(value, digits) for value in np.asarray(values).tolist()]
