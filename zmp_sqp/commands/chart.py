"""`zmp-sqp chart`: the load chart of a machine."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp import plots
from zmp_sqp.arrays import Array
from zmp_sqp.charts import LoadChart, Swing, SwingChart, SwingLoad, load_chart
from zmp_sqp.charts.arm import Arm
from zmp_sqp.charts.lift_point import unit_payload
from zmp_sqp.commands.console import (
    add_command,
    add_json_option,
    add_out_option,
    make_console,
    prepare_folder,
    print_lines,
    to_json,
    without_matplotlib,
    write_json,
)
from zmp_sqp.commands.constraint_options import add_constraint_option, constraints_of
from zmp_sqp.commands.exit_codes import DONE, INTERRUPTED, Meanings
from zmp_sqp.commands.live import live_line
from zmp_sqp.commands.machine_options import (
    PAYLOAD_ARGUMENTS,
    add_ground_options,
    add_machine_options,
    ground_of,
    machine_of,
)
from zmp_sqp.errors import ScenarioError
from zmp_sqp.mechanics import Ground, Machine, Slope, shipped_machines
from zmp_sqp.scenario import load_scenario, shipped_scenarios
from zmp_sqp.show.chart_tables import (
    CHART_KEYS,
    chart_notes,
    chart_result,
    chart_table,
    letters_in_words,
    load_unit,
    swing_notes,
    swing_table,
    swing_title,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["CHART_FILES", "add_chart", "run_chart"]

CHART_FILES = ("chart.json", "chart.csv", "chart.png", "swing.csv", "swing.png")  # of `--out`
HOLDING = 3  # joints beside the slew joint that set radius, height and attitude
PIPE_WIDTH = 120  # [characters] of tables that go to a file or a pipe
SLOPE = ("roll", "pitch")
# options of [machine] and [ground] that a scenario gives itself
OF_A_URDF = ("limits", "contact_links", "point_masses", "heightmap", "resolution")
# arguments of `Problem` that the swings of a scenario keep
KEPT = (
    "margin",
    "intervals",
    "constraints",
    "tipping_fraction",
    "payload_uncertainty",
    "payload_com_uncertainty",
    "slope_uncertainty",
)
DESCRIPTION = """\
Print the load chart of a machine: the load that it may lift at each height and radius, over front,
over side and all round, with a letter for what limits it. The rated load is that of ISO 10567, the
lesser of 75 % of the load that tips the machine over and 87 % of the load that its joints can hold,
less the attachment. With --swing, also what no maker's chart has: the largest load for which a
swing is certified. Not a substitute for the maker's load chart.
"""
EXAMPLES = """\
examples:
  zmp-sqp chart feller_buncher --payload-frame head
  zmp-sqp chart my_crane.urdf --payload-frame hook --roll 5 --out out/chart
  zmp-sqp chart paper_1 --heights 0 2 4 6 --radii 3 4 5 6
  zmp-sqp chart feller_buncher --payload-frame head --swing 180 --duration 6 --out out/swing
"""


def add_chart(commands: Any, shipped: str) -> None:
    """Add the command `chart`.

    Args:
        commands: Subcommands of an argparse parser.
        shipped: Help text that lists the shipped scenarios.
    """
    machines = f"shipped machines: {', '.join(shipped_machines())}\n"
    command = add_command(
        commands,
        "chart",
        run_chart,
        summary="make the load chart of a machine",
        description=DESCRIPTION,
        codes=Meanings(),
        notes=(EXAMPLES, machines, shipped, CHART_KEYS),
    )
    command.add_argument(
        "source",
        metavar="SCENARIO|URDF",
        help="a scenario (TOML file, or name of a shipped one), which gives machine, ground, "
        "payload and attitude; or a URDF file, or the name of a shipped machine",
    )
    _add_chart_options(command)
    add_ground_options(command)
    command.set_defaults(roll=None, pitch=None)  # None leaves a scenario's ground as it is
    add_machine_options(command)
    _add_swing_options(command)
    add_out_option(command, CHART_FILES)
    add_json_option(command)
    command.add_argument(
        "--no-figures", dest="figures", action="store_false", help="write no figures"
    )


def _add_chart_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--payload-frame",
        metavar="LINK",
        help="link that carries the load (default: the scenario's payload frame)",
    )
    command.add_argument(
        "--payload-com",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="[m] lift point in the frame of that link, the load's centre of mass (default: the "
        "scenario's, or the link's origin)",
    )
    command.add_argument(
        "--attitude",
        choices=("free", "held"),
        help="free: any attitude of the link; held: that of the scenario's start to the vertical "
        "(default: held for a scenario whose load has its centre of mass off the link's origin and "
        "whose arm has a joint left to hold it)",
    )
    for name, what in (("radii", "distances from the slew axis"), ("heights", "heights")):
        command.add_argument(
            f"--{name}", type=float, nargs="+", metavar="M", help=f"[m] {what} (default: all)"
        )
    command.add_argument(
        "--attachment",
        nargs="*",
        metavar="LINK",
        help="links that count as part of the load; none without a name (default: the payload's "
        "link and all that it carries)",
    )
    for name, value, what in (
        ("tipping", 0.75, "load that tips the machine over"),
        ("torque", 0.87, "load that the joints can hold"),
    ):
        command.add_argument(
            f"--{name}-fraction",
            type=float,
            default=value,
            metavar="SHARE",
            help=f"share of the {what} that may be lifted (default: {value})",
        )


def _add_swing_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--swing",
        type=float,
        metavar="DEG",
        help="[deg] also chart the largest load with which a swing by this angle is certified; "
        "positive is to the left",
    )
    command.add_argument(
        "--duration", type=float, metavar="S", help="[s] longest duration of the swing"
    )
    command.add_argument(
        "--pace",
        type=float,
        metavar="FACTOR",
        help="longest duration as a multiple of the least that the joint limits allow "
        "(default: 1.001)",
    )
    command.add_argument(
        "--only-slew",
        action="store_true",
        help="only the slew joint moves: the load keeps its radius; else it may be drawn in",
    )
    command.add_argument(
        "--from",
        dest="start",
        type=float,
        default=0.0,
        metavar="DEG",
        help="[deg] azimuth at which the swing begins: 0 is ahead, 90 to the left (default: 0)",
    )
    command.add_argument(
        "--margin",
        type=float,
        metavar="M",
        help="[m] least distance from the ZMP to every edge during the swing (default: the "
        "scenario's, or 0)",
    )
    add_constraint_option(command)


def run_chart(arguments: argparse.Namespace) -> int:
    """Chart, print and write; returns the exit code."""
    question = _question(arguments)
    prepare_folder(arguments.out, CHART_FILES)
    console = make_console(arguments.json, pipe_width=PIPE_WIDTH)
    with live_line("load chart") as line:
        chart = _load_chart(arguments, question, lambda part: line.say(f"load chart: {part}"))
    swing = None if arguments.swing is None else _swing_of(arguments, question, chart)

    console.print(f"load chart of {chart.machine.name}", style="bold", soft_wrap=True)
    for sector, name in enumerate(chart.sectors):
        console.print(f"{name}: rated load [{load_unit(chart)}]")
        console.print(chart_table(chart, sector))
    console.print(letters_in_words(chart), soft_wrap=True)
    print_lines(console, chart_notes(chart))
    lines = _write_chart(arguments.out, chart, figures=arguments.figures)
    print_lines(console, lines)
    found, interrupted = None, False
    if swing is not None:
        loads, interrupted = _swing_loads(swing)
        found = swing.arranged(loads)
        console.print(swing_title(found), soft_wrap=True)
        console.print(swing_table(found))
        print_lines(console, swing_notes(found))
        print_lines(console, _write_swing(arguments.out, found, figures=arguments.figures))
    text = to_json(chart_result(chart, found))
    if arguments.out is not None:
        (arguments.out / CHART_FILES[0]).write_text(text, encoding="utf-8")
        print_lines(console, [f"wrote {arguments.out / CHART_FILES[0]}"])
    write_json(text, arguments.json, console)
    return INTERRUPTED if interrupted else DONE


@dataclass(frozen=True, slots=True)
class _Question:
    """Machine and ground of a chart, and what a scenario says beside them.

    Attributes:
        machine: The machine, with the payload of a scenario.
        ground: The ground.
        start: Joint coordinates at the start of a scenario, shape (n,); None for a URDF.
        settings: Arguments of `Problem` for swings.
        qp_solver: Name of the QP solver for swings.
    """

    machine: Machine
    ground: Ground
    start: Array | None
    settings: dict[str, Any]
    qp_solver: str


def _question(arguments: argparse.Namespace) -> _Question:
    """Machine and ground of the arguments.

    Raises:
        MachineError, ScenarioError: The machine or the scenario cannot be used, options for a URDF
            are given with a scenario, or options of a swing without one.
    """
    if arguments.swing is None:
        for name in ("duration", "pace", "margin"):
            if getattr(arguments, name) is not None:
                raise ScenarioError(f"--{name} is for a swing: give --swing DEG, too")
    overrides: dict[str, Any] = {}
    if arguments.margin is not None:
        overrides["margin"] = arguments.margin
    if arguments.constraints:
        overrides["constraints"] = constraints_of(arguments)
    if arguments.source in shipped_scenarios() or Path(arguments.source).suffix == ".toml":
        return _of_scenario(arguments, overrides)
    if arguments.attitude == "held":
        raise ScenarioError("--attitude held keeps that of a scenario's start: give a scenario")
    sloped = {name: getattr(arguments, name) or 0.0 for name in SLOPE}
    given = argparse.Namespace(
        **vars(arguments)
        | sloped
        | {"urdf": arguments.source}
        | dict.fromkeys(PAYLOAD_ARGUMENTS.values())
    )
    return _Question(machine_of(given), ground_of(given), None, overrides, "auto")


def _of_scenario(arguments: argparse.Namespace, overrides: dict[str, Any]) -> _Question:
    """Machine and ground of a scenario; `--roll` and `--pitch` replace its ground."""
    for name in OF_A_URDF:
        if getattr(arguments, name, None):
            raise ScenarioError(
                f"--{name.replace('_', '-')} is for a URDF, but {arguments.source} is a scenario"
            )
    scenario = load_scenario(arguments.source)
    problem = scenario.problem
    if problem.base is not None:
        raise ScenarioError(f"{scenario.path}: its base drives; a load chart needs one that stands")
    ground: Ground = problem.ground
    if any(getattr(arguments, name) is not None for name in SLOPE):
        angles = (getattr(arguments, name) or 0.0 for name in SLOPE)
        ground = Slope(*map(np.radians, angles))
    settings = {name: getattr(problem, name) for name in KEPT} | overrides
    return _Question(problem.machine, ground, problem.start, settings, scenario.qp_solver)


def _load_chart(
    arguments: argparse.Namespace, question: _Question, progress: Callable[[str], None]
) -> LoadChart:
    machine, held = question.machine, question.start
    frame, com = arguments.payload_frame, arguments.payload_com
    if com is not None and frame is None and machine.payload_count == 1:
        frame = machine.payloads[0].frame
    attitude = arguments.attitude
    if attitude is None and held is not None:
        lifted = unit_payload(machine, frame, com)
        arm = Arm.of(machine, lifted.frame, lifted.com)
        attitude = "held" if lifted.com.any() and len(arm.joints) >= HOLDING else "free"
    return load_chart(
        machine,
        question.ground,
        frame=frame,
        com=com,
        radii=arguments.radii,
        heights=arguments.heights,
        held=held if attitude == "held" else None,
        attachment=arguments.attachment,
        tipping_fraction=arguments.tipping_fraction,
        torque_fraction=arguments.torque_fraction,
        progress=progress,
    )


def _swing_of(arguments: argparse.Namespace, question: _Question, chart: LoadChart) -> Swing:
    return Swing.of(
        chart,
        np.radians(arguments.swing),
        duration=arguments.duration,
        pace=arguments.pace,
        start=np.radians(arguments.start),
        only_slew=arguments.only_slew,
        qp_solver=question.qp_solver,
        **question.settings,
    )


def _swing_loads(swing: Swing) -> tuple[list[SwingLoad], bool]:
    """Loads of a swing, with a progress bar on standard error; Ctrl-C ends with what is done.

    Returns:
        The loads, and whether there was a Ctrl-C.
    """
    found: list[SwingLoad] = []
    total = len(swing.ends)
    with live_line("swings", total=total) as line:
        try:
            for load in swing.loads():
                found.append(load)
                line.say("swings")
        except KeyboardInterrupt:
            return found, True
    return found, False


def _write_chart(folder: Path | None, chart: LoadChart, *, figures: bool) -> Iterator[str]:
    """Write table and figure of the load chart one by one; yields a line about each."""
    if folder is None:
        return
    chart.to_csv(folder / "chart.csv")
    yield f"wrote {folder / 'chart.csv'}"
    if figures:
        yield from without_matplotlib(_draw(plots.load_chart, chart, folder / "chart.png"))


def _write_swing(folder: Path | None, swing: SwingChart, *, figures: bool) -> Iterator[str]:
    """Write table and figure of the swings one by one; yields a line about each."""
    if folder is None:
        return
    swing.to_csv(folder / "swing.csv")
    yield f"wrote {folder / 'swing.csv'}"
    if figures:
        yield from without_matplotlib(_draw(plots.swing_chart, swing, folder / "swing.png"))


def _draw(draw: Callable[[Any], Figure], chart: Any, path: Path) -> Iterator[str]:
    plots.save(draw(chart), path)
    yield f"wrote {path}"
