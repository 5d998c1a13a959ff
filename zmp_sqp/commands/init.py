"""`zmp-sqp init`: a scenario and a joint_limits.yaml to start from."""

from __future__ import annotations

import argparse
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.commands.console import add_command, make_console, print_lines
from zmp_sqp.commands.exit_codes import DONE, UNSAFE, Meanings
from zmp_sqp.commands.live import live_line
from zmp_sqp.commands.machine_options import (
    add_machine_options,
    add_payload_options,
    add_slope_options,
    machine_of,
    machine_table,
    slope_of,
)
from zmp_sqp.errors import ScenarioError
from zmp_sqp.mechanics import Machine, Slope, shipped_machines
from zmp_sqp.mechanics.link_tree import default_tip
from zmp_sqp.mechanics.urdf.limits_yaml import template
from zmp_sqp.planning import Problem
from zmp_sqp.scenario import load_scenario
from zmp_sqp.scenario.starter import TRIED, Starter, find_starter, starter_text

__all__ = ["add_init", "run_init"]

LIMITS_FILE = "joint_limits.yaml"
PATHS = ("urdf", "srdf", "joint_limits")  # keys of [machine] that hold paths
PLACEHOLDER = 1.0  # [rad/s, rad/s^2] in place of missing limits, while start and goal are checked
DESCRIPTION = """\
Write two files to start from: a scenario in which one joint of the machine swings, and a
joint_limits.yaml with all limits that are known; those that planning lacks are marked in it. Start
and goal are within the limits and stand at rest, as does everything between them, so that the
scenario can be planned unchanged once the missing limits are filled in. A machine that tips over
wherever it was tried gets a place in the scenario for the polygon on which it stands, and exit
code 1.
"""
EXAMPLES = """\
examples:
  zmp-sqp init my_crane.urdf --out study      study/my_crane.toml, study/joint_limits.yaml
  zmp-sqp plan study/my_crane.toml --out study/plan
  zmp-sqp init my_crane.urdf --roll -10 --payload 500 --payload-frame hook --payload-com 0 0 0
"""


def add_init(commands: Any) -> None:
    """Add the command `init`.

    Args:
        commands: Subcommands of an argparse parser.
    """
    command = add_command(
        commands,
        "init",
        run_init,
        summary="write a scenario and joint limits to start from",
        description=DESCRIPTION,
        codes=Meanings("done", "the machine tips over wherever it was tried"),
        notes=(EXAMPLES, f"shipped machines: {', '.join(shipped_machines())}\n"),
    )
    command.add_argument(
        "urdf", metavar="URDF", help="the machine: a URDF file, or the name of a shipped one"
    )
    command.add_argument(
        "--out",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="folder for NAME.toml and joint_limits.yaml (default: the working folder)",
    )
    command.add_argument(
        "--force", action="store_true", help="replace files of these names that are there already"
    )
    add_slope_options(command)
    add_machine_options(command)
    add_payload_options(command)


def run_init(arguments: argparse.Namespace) -> int:
    """Choose a motion, write and check both files, say what is missing; returns the exit code."""
    with live_line("reading the machine"):
        machine, wheels = _without_wheels(arguments)
    ground = slope_of(arguments)
    stem = Path(arguments.urdf).stem
    scenario, limits = arguments.out / f"{stem}.toml", arguments.out / LIMITS_FILE
    _refuse_to_replace((scenario, limits), force=arguments.force)
    with live_line("looking for a first motion"):
        starter = find_starter(machine, ground)
        _check(machine, ground, starter)
    arguments.out.mkdir(parents=True, exist_ok=True)
    tables = {
        "machine": _relative(machine_table(arguments), arguments.out),
        "ground": {"roll_deg": arguments.roll, "pitch_deg": arguments.pitch},
    }
    text = starter_text(
        starter,
        machine,
        tables=tables,
        title=f"{machine.name}: {starter.joint} swings from pose '{starter.pose}'",
        heading=_heading(arguments.urdf, scenario),
        load=default_tip(machine),
    )
    # joint_limits.yaml first: without it the scenario cannot be loaded
    limits.write_text(template(machine), encoding="utf-8")
    scenario.write_text(text, encoding="utf-8")
    console = make_console(None)
    print_lines(console, [f"wrote {scenario}", f"wrote {limits}"])
    if wheels:
        print_lines(console, [f"held, because the machine stands on them: {', '.join(wheels)}"])
    print_lines(console, _advice(machine, starter, scenario, limits))
    return UNSAFE if starter.margin <= 0.0 else DONE


def _without_wheels(arguments: argparse.Namespace) -> tuple[Machine, tuple[str, ...]]:
    """The machine, and joints of wheels that are held unless the user chose what is planned."""
    chosen = arguments.joints or arguments.group or arguments.hold
    with warnings.catch_warnings(record=not chosen):
        machine = machine_of(arguments)
    if chosen:
        return machine, ()
    wheels = machine.wheels
    if wheels:
        arguments.hold = [(joint, 0.0) for joint in wheels]
    return machine_of(arguments), wheels


def _refuse_to_replace(files: Sequence[Path], *, force: bool) -> None:
    """Raise ScenarioError if one of the files is there already."""
    there = [str(path) for path in files if path.exists()]
    if there and not force:
        raise ScenarioError(
            f"{' and '.join(there)} {'is' if len(there) == 1 else 'are'} there already: give "
            "another folder by --out, or --force to replace"
        )


def _check(machine: Machine, ground: Slope, starter: Starter) -> None:
    """Pose the problem of the scenario, with placeholders for limits that are missing.

    Raises:
        ProblemError: The problem is refused.
    """
    if not starter.stands:
        return
    limits = machine.limits
    sides = {"position_lower": -np.inf, "position_upper": np.inf}
    complete = replace(
        limits,
        **{
            key: np.where(
                np.isnan(getattr(limits, key)), sides.get(key, PLACEHOLDER), getattr(limits, key)
            )
            for key in (*sides, "velocity", "acceleration")
        },
    )
    Problem(
        replace(machine, limits=complete),
        starter.start,
        starter.goal,
        ground=ground,
        margin=starter.margin,
    )


def _relative(table: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The table [machine] of a scenario in a folder, with the joint_limits.yaml beside it."""
    found = {**table, "joint_limits": str(folder / LIMITS_FILE)}
    for key in PATHS:
        if key in found:
            found[key] = _from(folder, found[key])
    if "package_dirs" in found:
        found["package_dirs"] = [_from(folder, name) for name in found["package_dirs"]]
    return found


def _from(folder: Path, path: str) -> str:
    """Path relative to a folder, with slashes."""
    return Path(os.path.relpath(path, folder)).as_posix()


def _heading(urdf: str, scenario: Path) -> str:
    return (
        f"Written by `zmp-sqp init {' '.join(Path(urdf).name.split())}`, to start from. Plan it "
        "with\n\n"
        f"    zmp-sqp plan {scenario} --out {scenario.with_suffix('')}\n\n"
        "Metres, kilograms, seconds and radians; degrees where a key ends in _deg. Paths are "
        "relative to\nthis file. `zmp-sqp plan --help` lists all tables and keys."
    )


def _advice(machine: Machine, starter: Starter, scenario: Path, limits: Path) -> Iterator[str]:
    """What is to be filled in before the scenario can be planned, or how to plan it."""
    missing = machine.limits.missing(machine.joint_names)
    if missing:
        what = " and ".join(key.replace("_", " ") for key in missing)
        joints = sorted({name for names in missing.values() for name in names})
        yield f"fill in, in {limits}: {what} limits of {', '.join(joints)}"
    if machine.support is None:
        yield f"fill in, in {scenario}: the support polygon; start and goal are not checked without"
    elif not starter.stands:
        yield (
            f"the machine tips over at rest in all poses that were tried ({TRIED} at random): see "
            f"zmp-sqp inspect, and give the polygon on which it really stands in {scenario}"
        )
    if not missing and starter.stands:
        load_scenario(scenario)  # what was written is what was checked
        yield f"now: zmp-sqp plan {scenario}"
    else:
        yield f"then: zmp-sqp plan {scenario}"
