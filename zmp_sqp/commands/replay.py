"""`zmp-sqp replay`: simulate motions in MuJoCo with the machine free to tip over."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from zmp_sqp.commands.check_motion import motion_lines
from zmp_sqp.commands.console import (
    add_command,
    add_json_option,
    add_out_option,
    make_console,
    prepare_folder,
    print_lines,
    to_json,
    write_json,
)
from zmp_sqp.commands.exit_codes import DONE, INTERRUPTED, PLANNING, UNSAFE
from zmp_sqp.commands.live import LiveLine, Steps, live_line
from zmp_sqp.errors import MissingExtra, ScenarioError, TrajectoryError
from zmp_sqp.motion.reading import SUFFIXES, read_motion
from zmp_sqp.planning import Problem, Trajectory, phase_plane, plan
from zmp_sqp.scenario import Scenario, load_scenario, shipped_scenarios
from zmp_sqp.show.basis import BASIS_KEYS, Basis, basis_fields, basis_table
from zmp_sqp.show.results import margin_fields
from zmp_sqp.show.tables import margin_text, new_table
from zmp_sqp.simulation import Replay, replay
from zmp_sqp.simulation.engine import load_mujoco
from zmp_sqp.simulation.pictures import draw_strip, draw_video
from zmp_sqp.versions import installed_versions

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["REPLAY_FILES", "REPLAY_KEYS", "add_replay", "replay_result", "run_replay"]

# files of `--out`; the last one with --video only
REPLAY_FILES = ("replay.json", "replay.png", "replay.gif")
PLANNED, FROM_FILE, BASELINE = "planned", "file", "phase plane"  # names of motions
SIMULATED = (
    "the simulation has payload and ground exactly as given, drives the joints exactly, and has "
    "feet at the corners of the support polygon that do not slip; time step {:g} s"
)
DESCRIPTION = """\
Simulate a motion in MuJoCo, where the machine stands freely on the ground and may tip over. Given a
file (any that `zmp-sqp check` takes), its motion is simulated; given a scenario, the planned motion
and, beside it, the stability-blind motion (`phase plane`), which ignores the ZMP. The base has to
stand: plans whose base drives cannot be replayed.
"""
EXAMPLES = """\
examples:
  zmp-sqp replay paper_1 --out out/replay      table, picture strip
  zmp-sqp replay out/paper_1/trajectory.csv    file that `plan paper_1 --out out/paper_1` wrote
  zmp-sqp replay my.csv --scenario my_machine.toml --video --out out/mine
"""
REPLAY_KEYS = f"""\
--json writes one object; SI units, null where there is no value:
  scenario, title  name and title of the scenario
  message          why there is no planned motion; null if there is one
  motions          by name (planned or file, phase plane): duration; margin (guaranteed, under all
                   uncertainties; negative outside); nominal_margin (nothing uncertain);
                   max_tilt [rad]; lift (largest height of a corner of the support polygon),
                   lift_at (its time), lifted_at (first time above 5 mm); tipped, pivot (edge over
                   which the machine tips); least_edge_load [N], least_loaded_edge, least_loads
                   [N] (per corner); slide (largest displacement along the ground);
                   tracking_error (of the joints); fell (tilted by more than 45 degrees)
{BASIS_KEYS}  versions         of zmp-sqp, Python and the packages that the result depends on
"""


class _Motions(NamedTuple):
    """Motions to replay, on the machine and ground of a scenario.

    Attributes:
        scenario: Scenario that gives machine and ground.
        by_name: _Motions by name; the exit code judges the first.
        message: Why there is no planned motion; None if there is one.
        reading: How the motion follows from its file, in words; empty for planned motions.
    """

    scenario: Scenario
    by_name: Mapping[str, Trajectory]
    message: str | None
    reading: Sequence[str] = ()


def add_replay(commands: Any, shipped: str) -> None:
    """Add the command `replay`.

    Args:
        commands: Subcommands of an argparse parser.
        shipped: Help text that lists the shipped scenarios.
    """
    command = add_command(
        commands,
        "replay",
        run_replay,
        summary="simulate a motion in a physics engine: does the machine tip over?",
        description=DESCRIPTION,
        codes=PLANNING._replace(
            done="the motion was found, and the machine does not tip over",
            unsafe="no motion was found, or the machine tips over",
        ),
        notes=(EXAMPLES, shipped, REPLAY_KEYS),
    )
    command.add_argument(
        "source",
        metavar="SCENARIO_OR_FILE",
        help="a scenario (file or shipped name), or the file of a motion",
    )
    _add_motion_options(command)
    add_out_option(command, REPLAY_FILES)
    add_json_option(command)
    command.add_argument(
        "--video",
        action="store_true",
        help=f"also write the animation {REPLAY_FILES[-1]}, which takes a while",
    )
    command.add_argument(
        "--no-pictures", dest="pictures", action="store_false", help="draw nothing"
    )


def _add_motion_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--scenario",
        metavar="SCENARIO",
        help="scenario that gives machine, payload and ground for the motion of a file",
    )
    command.add_argument(
        "--margin",
        type=float,
        metavar="M",
        help="[m] distance that the planned ZMP keeps from every edge (default: the scenario's)",
    )
    command.add_argument(
        "--time-step",
        type=float,
        default=1e-3,
        metavar="S",
        help="[s] time step of the simulation (default: 0.001)",
    )


def run_replay(arguments: argparse.Namespace) -> int:
    """Replay, print and write; returns the exit code.

    It is DONE if the motion was found and the machine does not tip over, else UNSAFE.
    """
    load_mujoco()  # a missing engine fails before the planning
    scenario, motions, message, reading = _motions(
        arguments.source, arguments.scenario, arguments.margin
    )
    problem = scenario.problem
    prepare_folder(arguments.out, REPLAY_FILES)
    steps = Steps()
    replays: dict[str, Replay] = {}
    fields: dict[str, Any] = {}

    def simulate(name: str, _: LiveLine) -> None:
        found = replay(
            problem.machine, motions[name], problem.ground, time_step=arguments.time_step
        )
        fields[name] = replay_result(problem, found)
        replays[name] = found

    for name in motions:
        steps.run(f"simulation: {name}", partial(simulate, name), lambda: None)
    if not replays:
        return INTERRUPTED
    basis = Basis.of_problem(problem, [*reading, SIMULATED.format(arguments.time_step)])
    result: dict[str, Any] = {
        "scenario": scenario.name,
        "title": scenario.title,
        "message": message,
        "motions": fields,
        "rests_on": basis_fields(basis),
        "versions": installed_versions("mujoco"),
    }
    console = make_console(arguments.json)
    console.print(f"{scenario.name}: {scenario.title}", style="bold", soft_wrap=True)
    console.print(_table(result["motions"]))
    console.print(basis_table(basis))
    if message is not None:
        console.print(message, style="bold red", soft_wrap=True)
    text, out = to_json(result), arguments.out
    if out is not None:
        (out / REPLAY_FILES[0]).write_text(text, encoding="utf-8")
        print_lines(console, [f"wrote {out / REPLAY_FILES[0]}"])
        if arguments.pictures:
            lines: list[str] = []
            drawing = _draw(replays, out, video=arguments.video)
            steps.run("pictures", lambda _: lines.extend(drawing), lambda: None)
            print_lines(console, lines)
    write_json(text, arguments.json, console)
    print_lines(console, steps.lines())
    if steps.interrupted:
        return INTERRUPTED
    first = next(iter(replays.values()))
    return UNSAFE if message is not None or first.tipped else DONE


def replay_result(problem: Problem, found: Replay) -> dict[str, Any]:
    """Numbers of one replay of a problem's motion, for JSON; `REPLAY_KEYS` explains them."""
    support = found.support
    return {
        "duration": found.trajectory.duration,
        **margin_fields(problem, found.trajectory),
        "max_tilt": found.max_tilt,
        "lift": found.lift,
        "lift_at": found.lift_at,
        "lifted_at": found.lifted_at if found.tipped else None,
        "tipped": found.tipped,
        "pivot": support.edge_name(found.pivot) if found.tipped else None,
        "least_edge_load": found.least_edge_load,
        "least_loaded_edge": support.edge_name(found.least_loaded_edge),
        "least_loads": found.least_loads.tolist(),
        "slide": found.slide,
        "tracking_error": found.tracking_error,
        "fell": found.fell,
    }


def _motions(source: str, scenario: str | None, margin: float | None) -> _Motions:
    """Motions that the arguments ask for, with the baseline if it is from rest to rest.

    Args:
        source: Scenario, or path of a motion's file.
        scenario: Scenario of such a file; None for the one in `plan.json` beside the file.
        margin: Margin to plan with [m]; None for the scenario's.

    Raises:
        ScenarioError: The scenario cannot be used, or there is no motion to replay.
        TrajectoryError: The motion's file cannot be used.
    """
    path = Path(source)
    from_file = path.suffix.lower() in SUFFIXES
    if from_file and margin is not None:
        raise TrajectoryError(
            f"--margin is for planning, but {path} is a motion already: leave it out"
        )
    if not from_file and scenario is not None:
        raise ScenarioError(
            f"--scenario says where the motion of a file belongs, but {source} is none: it does "
            f"not end in {', '.join(SUFFIXES)}"
        )
    loaded = load_scenario((scenario or _scenario_beside(path)) if from_file else source)
    if margin is not None:
        loaded = replace(loaded, problem=replace(loaded.problem, margin=margin))
    problem = loaded.problem
    if problem.base is not None:
        raise ScenarioError(f"{loaded.path}: its base drives; a replay needs one that stands")
    if from_file:
        read = read_motion(path, problem.machine)
        lines = motion_lines(read, problem.machine, None)
        return _Motions(loaded, {FROM_FILE: read.trajectory}, None, lines)
    with live_line() as line:
        found = plan(problem, qp_solver=loaded.qp_solver, progress=line.count, announce=line.say)
    motions = {}
    if found.success:
        motions[PLANNED] = found.trajectory
    if not (np.any(problem.start_velocity) or np.any(problem.goal_velocity)):
        motions[BASELINE] = phase_plane(problem.machine, problem.start, problem.goal)
    message = None if found.success else found.message
    if not motions:
        raise ScenarioError(f"{loaded.path}: no motion to replay: {message}")
    return _Motions(loaded, motions, message)


def _scenario_beside(path: Path) -> str:
    """Name of the shipped scenario in `plan.json` beside a file that `zmp-sqp plan --out` wrote."""
    try:
        name = json.loads(path.with_name("plan.json").read_text(encoding="utf-8"))["scenario"]
    except (OSError, ValueError, LookupError, TypeError):
        name = None
    if name not in shipped_scenarios():
        raise ScenarioError(
            f"{path} does not say its machine and ground: give the scenario by --scenario"
        )
    return str(name)


def _draw(replays: Mapping[str, Replay], folder: Path, *, video: bool) -> Iterator[str]:
    """Draw the pictures of `--out`, each with all motions; yields a line about each picture."""
    try:
        draw_strip(replays, folder / "replay.png")
        yield f"wrote {folder / 'replay.png'}"
        if video:
            draw_video(replays, folder / "replay.gif")
            yield f"wrote {folder / 'replay.gif'}"
    except MissingExtra as missing:
        yield f"no pictures: {missing}"


def _table(motions: Mapping[str, Mapping[str, Any]]) -> Table:
    """Numbers of the motions, one column per motion."""
    from rich.text import Text

    table = new_table("", *motions)

    def row(label: str, show: Callable[[Mapping[str, Any]], str | Text]) -> None:
        table.add_row(label, *(show(motion) for motion in motions.values()))

    row("duration [s]", lambda motion: f"{motion['duration']:.3f}")
    row("guaranteed stability margin [m]", lambda motion: margin_text(motion["margin"]))
    if any(motion["margin"] != motion["nominal_margin"] for motion in motions.values()):
        nominal = "the same, nothing uncertain [m]"
        row(nominal, lambda motion: margin_text(motion["nominal_margin"]))
    row(
        "maximal tilt [deg]",
        lambda motion: f"{np.degrees(motion['max_tilt']):.3f}" + " (falls)" * motion["fell"],
    )
    row("largest lift of a track [mm]", lambda motion: f"{1e3 * motion['lift']:.3f}")
    row("at [s]", lambda motion: f"{motion['lift_at']:.3f}" if motion["tipped"] else "-")
    row(
        "least load of a track [kN]",
        lambda m: f"{1e-3 * m['least_edge_load']:.1f} ({m['least_loaded_edge']})",
    )
    row("slides by [mm]", lambda motion: f"{1e3 * motion['slide']:.2f}")
    row("verdict of the physics", lambda motion: Text(*_verdict(motion)))
    return table


def _verdict(motion: Mapping[str, Any]) -> tuple[str, str]:
    """Whether the machine tips over, when and over which edge; and the style to print it in."""
    if not motion["tipped"]:
        return "stands", ""
    return f"tips over {motion['pivot']} at {motion['lifted_at']:.2f} s", "bold red"
