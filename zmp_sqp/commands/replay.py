"""`zmp-sqp replay`: motions on a machine that stands free on its slope, in MuJoCo; print, draw, write."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.errors import MissingExtra, ScenarioError, TrajectoryError
from zmp_sqp.planning import Problem, Trajectory, certify, phase_plane, plan
from zmp_sqp.scenario import load_scenario, shipped_scenarios
from zmp_sqp.show.report import versions
from zmp_sqp.simulation import Replay, replay
from zmp_sqp.simulation.engine import load_mujoco
from zmp_sqp.simulation.pictures import draw_strip, draw_video

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["REPLAY_FILES", "REPLAY_KEYS", "add_replay", "replay_result", "run_replay"]

# what `--out` writes, the last one with --video
REPLAY_FILES = ("replay.json", "replay.png", "replay.gif")
PLANNED, FROM_FILE, BASELINE = "planned", "file", "phase plane"
REPLAY_KEYS = """\
--json writes one object; SI units, null where there is no value:
  scenario, title  what was replayed
  message          why there is no planned motion
  motions          by name (planned or file, phase plane): duration, margin (certified, negative
  outside),
                   max_tilt [rad], lift (largest height of a corner of the tracks), lift_at,
                   lifted_at (first above 5 mm), tipped, pivot (edge that it tips over),
                   least_edge_load (of the tracks, [N]), least_loaded_edge, least_loads (by corner),
                   slide, tracking_error, fell (beyond 45 degrees)
  versions         of Python, of this package and of what it stands on
"""


def add_replay(commands: Any, shipped: str, exit_codes: str) -> None:
    """Add the subcommand to an argparse parser's subcommands."""
    command = commands.add_parser(
        "replay",
        help="replay a motion in a physics engine: does the machine tip over?",
        description=(
            "The machine stands free on its slope in MuJoCo, under contact and friction, and follows the motion: of\n"
            "a scenario the planned one and, beside it, the one that knows no ZMP; or the one of a CSV file. The base\n"
            "has to stand: plans whose base drives cannot be replayed."
        ),
        epilog=(
            "examples:\n"
            "  zmp-sqp replay paper_1 --out out/replay     table, picture strip\n"
            "  zmp-sqp replay out/paper_1/trajectory.csv   a file that `plan paper_1 --out out/paper_1` wrote\n"
            "  zmp-sqp replay my.csv --scenario my_machine.toml --video --out out/mine\n\n"
            f"{shipped}{REPLAY_KEYS}\n{exit_codes}"
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=run_replay)
    command.add_argument(
        "source",
        metavar="SCENARIO_OR_CSV",
        help="a scenario as `plan` takes it, or a trajectory's CSV",
    )
    command.add_argument("--scenario", metavar="SCENARIO", help="machine and ground of a CSV file")
    command.add_argument(
        "--margin", type=float, metavar="M", help="[m] from ZMP to edges (default: the scenario's)"
    )
    command.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help=f"write {', '.join(REPLAY_FILES)}, in place of old ones",
    )
    command.add_argument(
        "--json",
        metavar="FILE",
        help="write the results; - is standard output, with nothing else there",
    )
    command.add_argument(
        "--video", action="store_true", help=f"write {REPLAY_FILES[-1]} too; it takes a while"
    )
    command.add_argument(
        "--no-pictures", dest="pictures", action="store_false", help="draw nothing"
    )
    command.add_argument(
        "--time-step",
        type=float,
        default=1e-3,
        metavar="S",
        help="[s] of the physics (default: 0.001)",
    )


def run_replay(arguments: argparse.Namespace) -> int:
    """Replay, print, write; 0 if the motion was found and stands, 1 if not."""
    from rich.console import Console

    load_mujoco()  # says what is missing before the work, not after it
    name, title, problem, motions, message = _motions(
        arguments.source, arguments.scenario, arguments.margin
    )
    out, json_file = arguments.out, arguments.json
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        for file in REPLAY_FILES:
            (out / file).unlink(missing_ok=True)
    replays = {
        label: replay(problem.machine, motion, problem.ground, time_step=arguments.time_step)
        for label, motion in motions.items()
    }
    result: dict[str, Any] = {
        "scenario": name,
        "title": title,
        "message": message,
        "motions": {label: replay_result(found) for label, found in replays.items()},
        "versions": versions("mujoco"),
    }
    # [m] is a unit, no markup
    console = Console(stderr=json_file == "-", highlight=False, markup=False)
    console.print(f"{name}: {title}", style="bold", soft_wrap=True)
    console.print(_table(result["motions"]))
    if message is not None:
        console.print(message, style="bold red", soft_wrap=True)
    text = json.dumps(result, indent=2, allow_nan=False) + "\n"
    if out is not None:
        (out / "replay.json").write_text(text, encoding="utf-8")
        console.print(f"wrote {out / 'replay.json'}", soft_wrap=True)
        for line in _draw(replays, out, video=arguments.video) if arguments.pictures else ():
            console.print(line, soft_wrap=True)
    if json_file == "-":
        print(text, end="")
    elif json_file is not None:
        Path(json_file).write_text(text, encoding="utf-8")
        console.print(f"wrote {json_file}", soft_wrap=True)
    return 0 if message is None and not next(iter(replays.values())).tipped else 1


def replay_result(found: Replay) -> dict[str, Any]:
    """Numbers of one replay; `REPLAY_KEYS` explains them."""
    support = found.support
    margin = certify(found.machine, found.trajectory, found.ground).margin
    return {
        "duration": found.trajectory.duration,
        "margin": margin if np.isfinite(margin) else None,
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


def _motions(
    source: str, scenario: str | None, margin: float | None
) -> tuple[str, str, Problem, dict[str, Trajectory], str | None]:
    """Name, title, problem and motions by label, the one to be judged first, and why it is not there."""
    path = Path(source)
    from_file = path.suffix.lower() == ".csv"
    if from_file and margin is not None:
        raise TrajectoryError(f"{path} is a motion already: --margin is for planning")
    if not from_file and scenario is not None:
        raise ScenarioError(
            f"--scenario says where the motion of a CSV file belongs, but {source} is none"
        )
    loaded = load_scenario((scenario or _scenario_beside(path)) if from_file else source)
    problem = loaded.problem if margin is None else replace(loaded.problem, margin=margin)
    if problem.base is not None:
        raise ScenarioError(f"{loaded.path}: its base drives; a replay needs one that stands")
    message, motions = None, {}
    if from_file:
        motions[FROM_FILE] = Trajectory.from_csv(path, problem.machine)
    else:
        found = plan(problem, qp_solver=loaded.qp_solver)
        if found.success:
            motions[PLANNED] = found.trajectory
        else:
            message = found.message
        if not (np.any(problem.start_velocity) or np.any(problem.goal_velocity)):
            motions[BASELINE] = phase_plane(problem.machine, problem.start, problem.goal)
    if not motions:
        raise ScenarioError(f"{loaded.path}: no motion to replay: {message}")
    return loaded.name, loaded.title, problem, motions, message


def _scenario_beside(path: Path) -> str:
    """The shipped scenario of which `zmp-sqp plan --out` wrote the file."""
    try:
        name = json.loads(path.with_name("plan.json").read_text(encoding="utf-8"))["scenario"]
    except (OSError, ValueError, LookupError, TypeError):
        name = None
    if name not in shipped_scenarios():
        raise ScenarioError(
            f"{path} says nothing of machine and ground: give the scenario that it is for, --scenario"
        )
    return str(name)


def _draw(replays: Mapping[str, Replay], folder: Path, *, video: bool) -> Iterator[str]:
    """Pictures of all motions; yields a line about each."""
    try:
        draw_strip(replays, folder / "replay.png")
        yield f"wrote {folder / 'replay.png'}"
        if video:
            draw_video(replays, folder / "replay.gif")
            yield f"wrote {folder / 'replay.gif'}"
    except MissingExtra as missing:
        yield f"no pictures: {missing}"


def _table(motions: Mapping[str, Mapping[str, Any]]) -> Table:
    """One column per motion."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("")
    for label in motions:
        table.add_column(label, justify="right", overflow="fold")

    def row(label: str, show: Any) -> None:
        table.add_row(label, *(show(motion) for motion in motions.values()))

    row("duration [s]", lambda motion: f"{motion['duration']:.3f}")
    row(
        "certified stability margin [m]",
        lambda m: "lifts off" if m["margin"] is None else f"{m['margin'] + 0.0:.4f}",
    )
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
    """What to say, and in which style."""
    if not motion["tipped"]:
        return "stands", ""
    return f"tips over {motion['pivot']} at {motion['lifted_at']:.2f} s", "bold red"
