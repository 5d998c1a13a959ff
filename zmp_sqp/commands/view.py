"""`zmp-sqp view`: a page on loopback that plans anew while settings are dragged."""

from __future__ import annotations

import argparse
import webbrowser
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.commands.console import add_command, make_console
from zmp_sqp.commands.exit_codes import DONE, Meanings
from zmp_sqp.commands.machine_options import (
    add_machine_options,
    add_payload_options,
    add_slope_options,
    machine_table,
)
from zmp_sqp.errors import ScenarioError
from zmp_sqp.mechanics import shipped_machines
from zmp_sqp.scenario import shipped_scenarios

if TYPE_CHECKING:
    from zmp_sqp.view import Subject, ViewServer

__all__ = ["add_view", "run_view"]

DESCRIPTION = """\
Show a machine in 3-D in a browser, and plan again while its goal, slope, payload, margin and limits
are dragged. A motion is shown as safe only once it is certified: while a new one is searched for,
the old one is marked as stale, and a refused one is red, with the reason. The page is served on
127.0.0.1 alone, to whoever has the address with its token. Ctrl-C ends it.

A URDF opens with what zmp-sqp inspect understands of it, and joint sliders that move it at rest. If
no limit is missing, it plans from there as well.
"""
EXAMPLES = """\
examples:
  zmp-sqp view paper_1                              a shipped scenario
  zmp-sqp view my_machine.toml --save tried.toml    `Save` on the page writes tried.toml
  zmp-sqp view out/paper_1/plan.json                the scenario of a plan
  zmp-sqp view my_crane.urdf --roll 5               look at a machine, then plan with it
  zmp-sqp view paper_1 --port 8000 --no-browser     print the address only
"""
BUDGETS = (0.01, 60.0)  # [s]
MACHINE_OPTIONS = (  # attributes that say something about a machine, and nothing about a scenario
    "limits",
    "srdf",
    "joints",
    "group",
    "hold",
    "package_dirs",
    "strict",
    "contact_links",
    "point_masses",
    "payload",
    "payload_frame",
    "payload_com",
    "payload_inertia",
    "roll",
    "pitch",
)


def add_view(commands: Any, shipped: str) -> None:
    """Add the command `view`.

    Args:
        commands: Subcommands of an argparse parser.
        shipped: Help text that lists the shipped scenarios.
    """
    machines = f"shipped machines: {', '.join(shipped_machines())}\n"
    command = add_command(
        commands,
        "view",
        run_view,
        summary="drag goal, slope and payload in a browser, and see the plan follow",
        description=DESCRIPTION,
        codes=Meanings(),
        notes=(EXAMPLES, shipped, machines),
    )
    command.add_argument(
        "source",
        metavar="PLAN|SCENARIO|URDF",
        help="a plan.json, a scenario (file or shipped name), or a machine (URDF or shipped name)",
    )
    command.add_argument(
        "--port",
        type=int,
        default=0,
        metavar="N",
        help="port on 127.0.0.1 (default: a free one)",
    )
    command.add_argument(
        "--no-browser",
        dest="browser",
        action="store_false",
        help="only print the address; do not open a browser",
    )
    command.add_argument(
        "--budget",
        type=float,
        metavar="S",
        help="[s] time of a plan while something is dragged (default: 0.25; up to four times that "
        "where nothing is found); at rest, the search takes all the time that `zmp-sqp plan` would",
    )
    command.add_argument(
        "--save",
        type=Path,
        metavar="FILE",
        help="scenario file that `Save` on the page writes; without it, the browser downloads",
    )
    add_slope_options(command)
    add_machine_options(command)
    add_payload_options(command)


def run_view(arguments: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C; returns the exit code."""
    from zmp_sqp.view import Session, ViewServer
    from zmp_sqp.view.session import BUDGET

    budget = BUDGET if arguments.budget is None else arguments.budget
    if not BUDGETS[0] <= budget <= BUDGETS[1]:
        raise ScenarioError(
            f"--budget must lie within {BUDGETS[0]} to {BUDGETS[1]} s, not {budget}"
        )
    if not 0 <= arguments.port <= 65535:
        raise ScenarioError(f"--port must lie within 0 to 65535, not {arguments.port}")
    if arguments.save is not None and not arguments.save.resolve().parent.is_dir():
        raise ScenarioError(f"--save {arguments.save}: there is no such folder")
    session = Session(_subject(arguments), budget)
    console = make_console(None)
    with _listening(ViewServer, session, arguments) as server:
        console.print(f"{session.subject.title}: {server.url}", soft_wrap=True)
        if arguments.save is not None and arguments.save.exists():
            console.print(f"{arguments.save} is there already: Save replaces it", soft_wrap=True)
        console.print("Ctrl-C ends it.")
        _serve(server, browser=arguments.browser)
        console.print("ended")
    return DONE


def _serve(server: ViewServer, *, browser: bool) -> None:
    """Serve until Ctrl-C; a browser is opened while the page is served, as it may wait for it."""
    serving = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
    serving.start()
    try:
        if browser and not webbrowser.open(server.url):
            make_console(None).print("no browser was found: open the address in one")
        serving.join()
    except KeyboardInterrupt:
        server.shutdown()


def _listening(kind: Any, session: Any, arguments: argparse.Namespace) -> Any:
    """Server on the port that is asked for."""
    try:
        return kind(session, port=arguments.port, save_to=arguments.save)
    except OSError as cause:
        raise ScenarioError(f"--port {arguments.port}: {cause.strerror}") from None


def _subject(arguments: argparse.Namespace) -> Subject:
    """What the view is about; the name of the source tells what it is.

    Raises:
        ScenarioError: It is nothing that can be viewed, or options do not belong to it.
        MachineError: The machine cannot be used.
    """
    from zmp_sqp.view import subject_of_machine, subject_of_plan, subject_of_scenario

    source, path = arguments.source, Path(arguments.source)
    scenario = source in shipped_scenarios() or path.suffix == ".toml"
    if scenario or path.suffix == ".json":
        _refuse_machine_options(arguments)
        return subject_of_scenario(source) if scenario else subject_of_plan(path)
    arguments.urdf = source
    roll, pitch = arguments.roll, arguments.pitch
    tables = {"machine": machine_table(arguments), "ground": {"roll_deg": roll, "pitch_deg": pitch}}
    return subject_of_machine(tables, Path(f"{path.stem}.toml"))


def _refuse_machine_options(arguments: argparse.Namespace) -> None:
    """Refuse options for a machine: a scenario has it all in its file."""
    for name in MACHINE_OPTIONS:
        if np.any(getattr(arguments, name)):
            raise ScenarioError(
                f"--{name.replace('_', '-')} belongs to a URDF; {arguments.source} has it all in it"
            )
