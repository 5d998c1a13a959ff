"""`zmp-sqp envelope`: duration and margin over two numbers of a scenario."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.commands.console import (
    add_command,
    make_console,
    prepare_folder,
    print_lines,
    to_json,
    without_matplotlib,
    write_json,
)
from zmp_sqp.commands.exit_codes import DONE, INTERRUPTED, UNSAFE, Meanings
from zmp_sqp.commands.live import live_line
from zmp_sqp.commands.study_options import (
    Case,
    Study,
    add_result_options,
    add_study_options,
    run_study,
    write_csv,
)
from zmp_sqp.errors import ScenarioError, ZmpSqpError
from zmp_sqp.planning import Problem
from zmp_sqp.plots import envelope, save
from zmp_sqp.scenario import read_content, scenario_of
from zmp_sqp.scenario.variation import check_key, varied
from zmp_sqp.show.study_tables import ENVELOPE_LEGEND, envelope_tables

__all__ = ["ENVELOPE_FILES", "add_envelope", "run_envelope"]

ENVELOPE_FILES = ("envelope.csv", "envelope.png")
STEPS = 9  # values of a key by default
SLOPES = (-20.0, 20.0)  # [deg] of the default keys
MOST = 10_000  # plans
DESCRIPTION = """\
Plan a scenario for many pairs of two of its numbers, such as roll and pitch of the ground or
payload and reach, and show duration and guaranteed margin over both: where the machine can move,
how fast, and where it no longer can.
"""
EXAMPLES = """\
examples:
  zmp-sqp envelope paper_1 --out out/envelope
  zmp-sqp envelope paper_1 --x machine.payload.mass 0 6000 13 --y motion.goal_deg[slew] 30 180 6
  zmp-sqp envelope paper_1 --out out/envelope --resume       after Ctrl-C, or a killed run
  zmp-sqp envelope paper_1 --dask tcp://scheduler:8786       on a cluster
"""
RESULT_KEYS = """\
envelope.csv and --json have one row per pair; SI units but for keys that end in _deg:
  the two keys; success, status, duration [s], lower_bound [s], margin [m] (guaranteed), message;
  status is `refused` where start or goal are impossible
"""


def add_envelope(commands: Any, shipped: str) -> None:
    """Add the command `envelope`.

    Args:
        commands: Subcommands of an argparse parser.
        shipped: Help text that lists the shipped scenarios.
    """
    command = add_command(
        commands,
        "envelope",
        run_envelope,
        summary="show duration and margin over two numbers of a scenario",
        description=DESCRIPTION,
        codes=Meanings("at least one pair has a safe motion", "none has"),
        notes=(EXAMPLES, RESULT_KEYS, shipped),
    )
    command.add_argument(
        "scenario", metavar="SCENARIO", help="a scenario file (TOML), or the name of a shipped one"
    )
    for axis, default in (("x", "ground.roll_deg"), ("y", "ground.pitch_deg")):
        command.add_argument(
            f"--{axis}",
            nargs="+",
            metavar=("KEY FROM TO", "COUNT"),
            help=f"key of the scenario, and COUNT values from FROM to TO ({STEPS} if left out); "
            f"an entry of a list as in motion.goal_deg[slew] (default: {default} {SLOPES[0]:g} "
            f"{SLOPES[1]:g} {STEPS})",
        )
    add_study_options(command)
    add_result_options(command, ENVELOPE_FILES)


def run_envelope(arguments: argparse.Namespace) -> int:
    """Plan, print and write; returns the exit code."""
    content, path = read_content(arguments.scenario)
    scenario = scenario_of(content, path)
    joints = scenario.problem.machine.joint_names
    axes = [
        _axis(getattr(arguments, axis) or [default, *map(str, SLOPES)], axis)
        for axis, default in (("x", "ground.roll_deg"), ("y", "ground.pitch_deg"))
    ]
    (x, xs), (y, ys) = axes
    if x == y:
        raise ScenarioError(f"--x and --y are both {x!r}: give two keys")
    for key in (x, y):
        check_key(content, key, joints)
    if len(xs) * len(ys) > MOST:
        raise ScenarioError(f"{len(xs)} x {len(ys)} plans are more than {MOST}")
    prepare_folder(arguments.out, ENVELOPE_FILES)

    def problem_at(values: Mapping[str, float]) -> Problem:
        return scenario_of(varied(content, values, joints), path).problem

    pairs = [{x: float(a), y: float(b)} for b in ys for a in xs]
    cases = []
    with live_line("posing problems", total=len(pairs)) as line:
        for pair in pairs:
            cases.append(_case(problem_at, pair))
            line.say("posing problems")
    study = run_study(cases, arguments, "envelope")
    console = make_console(arguments.json)
    console.print(f"{scenario.name}: {scenario.title}", style="bold", soft_wrap=True)
    console.print(f"duration [s]: {x} to the right, {y} upwards", soft_wrap=True)
    for table in envelope_tables(study.rows, x, y, width=console.width):
        console.print(table)
    if not all(row["success"] for row in study.rows):
        console.print(ENVELOPE_LEGEND, soft_wrap=True)
    console.print(_verdict(study), soft_wrap=True)
    if study.interrupted:
        console.print(study.ending, soft_wrap=True)
    if arguments.out is not None:
        print_lines(console, _write(arguments.out, study, (x, y), figures=arguments.figures))
    write_json(to_json({"x": x, "y": y, "rows": study.rows}), arguments.json, console)
    if study.interrupted:
        return INTERRUPTED
    return DONE if any(row["success"] for row in study.rows) else UNSAFE


def _axis(words: list[str], axis: str) -> tuple[str, Any]:
    """Key and values of an axis, from KEY FROM TO [COUNT].

    Raises:
        ScenarioError: Not that form.
    """
    form = f"--{axis} takes KEY FROM TO [COUNT], such as --{axis} ground.roll_deg -20 20 9"
    if len(words) not in (3, 4):
        raise ScenarioError(f"{form}, not {' '.join(words)}")
    try:
        low, high = float(words[1]), float(words[2])
        count = int(words[3]) if len(words) == 4 else STEPS
    except ValueError:
        raise ScenarioError(f"{form}, not {' '.join(words)}") from None
    if not (np.isfinite([low, high]).all() and low < high and count >= 2):
        raise ScenarioError(f"{form} with FROM < TO and COUNT >= 2, not {' '.join(words)}")
    return words[0], np.linspace(low, high, count)


def _case(problem_at: Any, values: dict[str, float]) -> Case:
    try:
        return Case(values, problem_at(values))
    except ZmpSqpError as fault:
        return Case(values, None, str(fault))


def _verdict(study: Study) -> str:
    """How many pairs have a safe motion."""
    count = sum(bool(row["success"]) for row in study.rows)
    refused = sum(row["status"] == "refused" for row in study.rows)
    text = f"{count} of {len(study.rows)} pairs have a safe motion"
    if refused:
        text += f"; {refused} are impossible at rest at start or goal, or outside a limit"
    return text


def _write(folder: Path, study: Study, keys: tuple[str, str], *, figures: bool) -> Iterator[str]:
    """Write the files of `--out`; yields a line about each."""
    write_csv(folder / "envelope.csv", study.rows)
    yield f"wrote {folder / 'envelope.csv'}"
    if figures:
        yield from without_matplotlib(_draw(folder / "envelope.png", study, keys))


def _draw(path: Path, study: Study, keys: tuple[str, str]) -> Iterator[str]:
    save(envelope(study.rows, *keys), path)
    yield f"wrote {path}"
