"""What a live view is about: the tables of a scenario, read from a file or made for a machine."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError, ScenarioError, ZmpSqpError
from zmp_sqp.mechanics import Machine
from zmp_sqp.mechanics.inspection import inspect
from zmp_sqp.mechanics.named_poses import named_poses
from zmp_sqp.planning.problem.intervals import MANY_JOINTS, suggested_intervals
from zmp_sqp.scenario.load import read_content, read_joints
from zmp_sqp.scenario.plan_file import PlanFile
from zmp_sqp.scenario.scene import DEGREES, build_ground, build_machine
from zmp_sqp.scenario.schema import SCHEMA, check_table
from zmp_sqp.scenario.starter import find_starter
from zmp_sqp.view.controls import DIGITS, Control, controls_of
from zmp_sqp.view.stance import Stance

__all__ = ["Subject", "relocated", "subject_of_machine", "subject_of_plan", "subject_of_scenario"]

PATHS = ("urdf", "srdf", "joint_limits")  # keys of [machine] that hold paths
ENDS = ("start", "goal")


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A scenario with a machine, and what can be set in it.

    Attributes:
        content: Tables of the scenario; start and goal are lists with one number per joint.
        path: File of the scenario, or where it would be: paths in the tables are relative to its
            folder, and messages name it.
        machine: The machine, as the tables have it.
        poses: Joint coordinates by name of the pose, shape (n,) each [rad or m].
        controls: What can be set, by key.
        tip: Frame that carries a payload if the scenario has none, and its place there [m].
        warnings: What was conspicuous when the machine was loaded.
        moves: Whether the page begins with a motion rather than with the machine at rest.
    """

    content: Mapping[str, Any]
    path: Path
    machine: Machine = field(repr=False)
    poses: Mapping[str, Array] = field(repr=False)
    controls: Mapping[str, Control] = field(repr=False)
    tip: tuple[str, tuple[float, ...]]
    warnings: tuple[str, ...]
    moves: bool

    @property
    def title(self) -> str:
        """Title of the scenario, one line; its name if it has none."""
        return str(self.content.get("title", self.path.stem))

    def content_with(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Tables of the scenario with other numbers.

        Args:
            values: Values of controls by key, see `checked_values`.
        """
        tables = deepcopy(dict(self.content))
        for key, value in values.items():
            group, _, name = key.partition(".")
            if group in ENDS:
                self._set_joint(tables["motion"], group, name, value)
            elif group == "ground":
                tables.setdefault("ground", {})[f"{name}_deg"] = value
            elif group == "payload":
                self._set_payload(tables["machine"], value)
            elif group == "margin":
                tables.setdefault("plan", {})["margin"] = value
            elif group == "limits":
                self._set_limit(tables, name, value)
            elif group == "missing":
                self._fill_in(tables["machine"], name, value)
            elif group == "base":
                at = ["x", "y", "yaw"].index(name)
                goal = list(tables["base"]["goal"])
                goal[at] = float(np.deg2rad(value)) if name == "yaw" else value
                tables["base"]["goal"] = goal
        return tables

    def pose(self, values: Mapping[str, float], group: str) -> Array:
        """Joint coordinates of a group of controls, shape (n,) [rad or m].

        Args:
            values: Values of controls by key; the others are at their first values.
            group: goal, start or pose.
        """
        machine = self.machine
        keys = [f"{group}.{name}" for name in machine.joint_names]
        shown = [values.get(key, self.controls[key].value) for key in keys]
        turns = np.array([unit == "rad" for unit in machine.joint_units])
        return np.where(turns, np.deg2rad(shown), shown)

    def displayed(self, joint: str, value: float) -> float:
        """A joint's coordinate [rad or m] as its controls show it [deg or m]."""
        control = self.controls[f"pose.{joint}"]
        shown = float(np.rad2deg(value)) if control.unit == "deg" else value
        return min(max(round(shown, DIGITS), control.low), control.high)

    def _set_joint(self, motion: dict[str, Any], end: str, joint: str, value: float) -> None:
        """Replace a coordinate [deg or m] of start or goal."""
        i = self.machine.joint_names.index(joint)
        if f"{end}{DEGREES}" in motion:
            motion[f"{end}{DEGREES}"][i] = value
        else:
            turns = self.machine.joint_units[i] == "rad"
            motion[end][i] = float(np.deg2rad(value)) if turns else value

    def _set_payload(self, machine: dict[str, Any], mass: float) -> None:
        """Replace the payload's mass [kg]; its inertia goes with it. At 0 there is no payload."""
        payload = machine.pop("payload", None)
        if mass == 0.0:
            return
        if payload is None:
            frame, place = self.tip
            machine["payload"] = {"mass": mass, "frame": frame, "com": list(place)}
            return
        if "inertia" in payload and mass != payload["mass"]:
            inertia = np.array(payload["inertia"]) * (mass / payload["mass"])
            payload["inertia"] = inertia.tolist()
        machine["payload"] = {**payload, "mass": mass}

    def _set_limit(self, tables: dict[str, Any], name: str, percent: float) -> None:
        """Replace limits by a percentage of those that the scenario has."""
        share = percent / 100.0
        if name == "effort":
            for table in tables["constraints"]:
                if table.get("type") == "torque_limits":
                    table["share"] = share
            return
        given = getattr(self.machine.limits, name)
        limits = tables["machine"].setdefault("limits", {})
        joints = zip(self.machine.joint_names, given.tolist(), strict=True)
        limits[name] = {joint: share * limit for joint, limit in joints}

    def _fill_in(self, machine: dict[str, Any], name: str, value: float) -> None:
        """Give joints that lack a limit this one, in SI units; 0 leaves it missing."""
        if value == 0.0:
            return
        complete = np.nan_to_num(getattr(self.machine.limits, name), nan=value).tolist()
        limits = machine.setdefault("limits", {})
        limits[name] = dict(zip(self.machine.joint_names, complete, strict=True))


def subject_of_scenario(name_or_path: str | Path) -> Subject:
    """Subject of a scenario file, or of a shipped scenario by name.

    Raises:
        ScenarioError: There is no such scenario, it is damaged, or its machine or ground cannot be
            used.
    """
    content, path = read_content(name_or_path)
    try:
        return _subject(content, path, moves=True)
    except ZmpSqpError as cause:
        raise ScenarioError(f"{path}: {cause}") from cause


def subject_of_plan(path: Path) -> Subject:
    """Subject of a plan.json: its scenario, with the margin that was asked for.

    Raises:
        ScenarioError: It is no plan.json, or its scenario cannot be used.
        OSError: It cannot be read.
    """
    plan = PlanFile.read(path, needs_motion=False)
    content = plan.tables()
    settings = content.get("plan", {})
    if isinstance(settings, dict) and settings.get("margin", 0.0) != plan.margin:
        content["plan"] = settings | {"margin": plan.margin}
    try:
        return _subject(content, plan.place, moves=True)
    except ZmpSqpError as cause:
        raise ScenarioError(
            f"{path}: the scenario in it cannot be used; if files that it names lie elsewhere, "
            f"view the scenario file: {cause}"
        ) from cause


def subject_of_machine(tables: Mapping[str, Mapping[str, Any]], path: Path) -> Subject:
    """Subject of a machine alone: a swing of one joint as in `zmp-sqp init`.

    Args:
        tables: The tables [machine] and [ground] of a scenario, by name.
        path: Where the scenario would be: paths in the tables are relative to its folder.

    Raises:
        MachineError: The machine cannot be used.
    """
    with _noted() as said:
        machine = build_machine(tables["machine"], path.parent)
    ground = build_ground(tables["ground"], path.parent)
    pose = next(iter(named_poses(machine).values()))
    start, goal, margin = pose, pose, 0.0
    title = f"{machine.name}: a first motion"
    try:
        found = find_starter(machine, ground)
    except ProblemError:  # no joint has room to move
        pass
    else:
        start, goal = found.start, found.goal
        margin = found.margin if found.margin > 0.0 else 0.0
        title = f"{machine.name}: {found.joint} swings from pose '{found.pose}'"
    content: dict[str, Any] = {
        "title": " ".join(title.split()),
        **{name: dict(table) for name, table in tables.items()},
        "motion": {"start": start.tolist(), "goal": goal.tolist()},
        "plan": {"margin": margin},
    }
    if machine.size > MANY_JOINTS:
        content["plan"]["intervals"] = suggested_intervals(machine.size)
    return _subject(content, path, moves=False, said=said)


def relocated(content: Mapping[str, Any], old: Path, new: Path | None) -> dict[str, Any]:
    """Tables of a scenario for a file elsewhere.

    Args:
        content: The tables.
        old: Folder to which their paths are relative.
        new: Folder to which they shall be relative; None makes them absolute.
    """

    def moved(path: str) -> str:
        there = Path(old, Path(path).expanduser()).resolve()
        return there.as_posix() if new is None else Path(os.path.relpath(there, new)).as_posix()

    tables = deepcopy(dict(content))
    machine = tables["machine"]
    machine |= {key: moved(machine[key]) for key in PATHS if key in machine}
    if "package_dirs" in machine:
        machine["package_dirs"] = [moved(name) for name in machine["package_dirs"]]
    if "heightmap" in tables.get("ground", {}):
        heightmap = tables["ground"]["heightmap"]
        heightmap["file"] = moved(heightmap["file"])
    return tables


def _subject(
    content: Mapping[str, Any], path: Path, *, moves: bool, said: list[str] | None = None
) -> Subject:
    check_table(content, SCHEMA)
    tables = deepcopy(dict(content))
    with _noted() as heard:
        machine = build_machine(tables["machine"], path.parent)
    ground = build_ground(tables.get("ground", {}), path.parent)
    motion = tables["motion"]
    ends: dict[str, Array] = {}
    for key in ENDS:
        found = read_joints(motion, key, machine)
        ends[key] = np.zeros(machine.size) if found is None else found
        written = key if key in motion else f"{key}{DEGREES}"
        if not isinstance(motion[written], list):  # a pose, or a table of joints
            motion.pop(written)
            motion[key] = ends[key].tolist()
    poses = named_poses(machine)
    shown = ends["start"] if moves else next(iter(poses.values()))
    about = inspect(machine, Stance.of(tables, ground).gravity_only, poses={})
    controls = controls_of(tables, machine, ground, {**ends, "pose": shown}, about.tip)
    return Subject(
        content=tables,
        path=path,
        machine=machine,
        poses=poses,
        controls={control.key: control for control in controls},
        tip=(about.tip, tuple(about.tip_offset.tolist())),
        warnings=tuple(said or heard),
        moves=moves,
    )


@contextmanager
def _noted() -> Iterator[list[str]]:
    """Texts of the warnings of a block."""
    texts: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield texts
    texts.extend(dict.fromkeys(str(warning.message) for warning in caught))
