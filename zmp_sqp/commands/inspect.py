"""`zmp-sqp inspect`: what was understood of a machine."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
from zmp_sqp.commands.exit_codes import DONE, Meanings
from zmp_sqp.commands.live import live_line
from zmp_sqp.commands.machine_options import (
    add_machine_options,
    add_payload_options,
    add_slope_options,
    machine_of,
    slope_of,
)
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics import shipped_machines
from zmp_sqp.mechanics.inspection import Inspection, inspect
from zmp_sqp.mechanics.summary import MISSING, joint_lines, mass_text, support_text
from zmp_sqp.plots import machine, save
from zmp_sqp.show.inspection_tables import (
    INSPECTION_KEYS,
    edge_table,
    inspection_fields,
    missing_lines,
    pose_table,
    tree_lines,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

__all__ = ["INSPECT_FILES", "add_inspect", "run_inspect"]

INSPECT_FILES = ("inspect.json", "inspect.png")  # files of `--out`
MOST_DRAWN = 3  # poses in the picture, unless --pose names them
DESCRIPTION = """\
Say what was understood of a machine, before anything is planned with it: links, masses, joints and
their limits, support polygon, and how firmly it stands in each pose. A wrong unit, axis or mass
shows here. With --out a picture of it from the side and from above.

The tipping load is the largest mass that the machine at rest can carry at the load point before
its zero moment point (ZMP) reaches an edge of the support polygon; 'any' means that no load there
tips it over. It is no rated load, and no substitute for the maker's chart.
"""
EXAMPLES = """\
examples:
  zmp-sqp inspect feller_buncher --out out/inspect
  zmp-sqp inspect my_crane.urdf --roll 5 --tip hook
  zmp-sqp inspect my_crane.urdf --json - | jq .missing
"""


def add_inspect(commands: Any) -> None:
    """Add the command `inspect`.

    Args:
        commands: Subcommands of an argparse parser.
    """
    command = add_command(
        commands,
        "inspect",
        run_inspect,
        summary="say what was understood of a machine: tables and a picture",
        description=DESCRIPTION,
        codes=Meanings(),
        notes=(EXAMPLES, f"shipped machines: {', '.join(shipped_machines())}\n", INSPECTION_KEYS),
    )
    command.add_argument(
        "urdf", metavar="URDF", help="the machine: a URDF file, or the name of a shipped one"
    )
    add_slope_options(command)
    command.add_argument(
        "--tip",
        metavar="LINK",
        help="link at whose origin the tipping load hangs (default: the payload's place, or the "
        "outermost link)",
    )
    command.add_argument(
        "--pose",
        nargs="+",
        metavar="NAME",
        help=f"poses to draw (default: the first {MOST_DRAWN} of the table)",
    )
    add_machine_options(command)
    add_payload_options(command)
    add_out_option(command, INSPECT_FILES)
    add_json_option(command)


def run_inspect(arguments: argparse.Namespace) -> int:
    """Load, describe, print and write; returns the exit code."""
    with live_line("reading the machine"), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        loaded = machine_of(arguments)
    ground = slope_of(arguments)
    tip, offset = arguments.tip, None
    if tip is None and arguments.payload is not None:
        tip, offset = arguments.payload_frame, arguments.payload_com
    with live_line("poses"):
        found = inspect(loaded, ground, tip=tip, tip_offset=offset)
    drawn = _drawn(found, arguments.pose)
    prepare_folder(arguments.out, INSPECT_FILES)
    path = _path(arguments.urdf)
    fields = inspection_fields(found)
    if fields["support"] is not None:
        fields["support"]["source"] = _source(arguments.contact_links)
    result = {
        "machine": fields.pop("machine"),
        "file": str(path),
        **fields,
        "warnings": [str(warning.message) for warning in caught],
    }

    console = make_console(arguments.json)
    _print(console, found, result)
    text = to_json(result)
    if arguments.out is not None:
        picture = partial(
            machine, found, path, package_dirs=arguments.package_dirs or (), poses=drawn
        )
        print_lines(console, _write(arguments.out, text, picture))
    else:
        console.print("a picture of it: --out DIR", soft_wrap=True)
    write_json(text, arguments.json, console)
    return DONE


def _drawn(found: Inspection, names: list[str] | None) -> list[str]:
    """Names of the poses to draw; without a choice, the first ones that differ."""
    known = [pose.name for pose in found.poses]
    for name in names or ():
        if name not in known:
            raise MachineError(f"there is no pose {name!r}; poses are {', '.join(known)}")
    if names is not None:
        return names
    different = {tuple(pose.q): pose.name for pose in reversed(found.poses)}
    return [name for name in known if name in different.values()][:MOST_DRAWN]


def _source(contact_links: list[str] | None) -> str:
    """Where the support polygon comes from, in words."""
    if contact_links is not None:
        return f"the lowest points of {', '.join(contact_links)}, as --contact-links asks"
    return "the lowest points of wheels and of what no planned joint moves"


def _path(urdf: str) -> Path:
    return shipped_machines().get(urdf, Path(urdf).expanduser())


def _print(console: Console, found: Inspection, result: Mapping[str, Any]) -> None:
    """Print all tables, then warnings and what is missing."""
    from rich.text import Text

    machine = found.machine
    title = f"{machine.name} ({result['file']}): {mass_text(machine.mass)}"
    console.print(title, style="bold", soft_wrap=True)
    print_lines(console, ["", *tree_lines(found), ""])
    for line in joint_lines(machine.joint_names, machine.joint_units, machine.limits):
        text = Text(line)
        text.highlight_words([MISSING], "bold red")
        console.print(text, soft_wrap=True)
    print_lines(console, ["", support_text(machine.support)])
    if result["support"] is not None:
        print_lines(console, [f"It is spanned by {result['support']['source']}.", ""])
    if machine.support is None and machine.support_hint:
        console.print(machine.support_hint, soft_wrap=True)
    edges = edge_table(found)
    if edges is not None:
        console.print(edges)
    console.print(pose_table(found))
    for warning in result["warnings"]:
        console.print(f"warning: {warning}", style="yellow", soft_wrap=True)
    for line in missing_lines(found):
        console.print(line, style="bold red", soft_wrap=True)
    if found.missing:
        console.print(
            f"`zmp-sqp init {result['file']}`, with the same options, writes a joint_limits.yaml "
            "to fill in",
            soft_wrap=True,
        )


def _write(folder: Path, text: str, picture: Callable[[], Figure]) -> Iterator[str]:
    """Write the files of `--out` one by one; yields a line about each."""
    results, path = (folder / name for name in INSPECT_FILES)
    results.write_text(text, encoding="utf-8")
    yield f"wrote {results}"
    yield from without_matplotlib(_draw(path, picture))


def _draw(path: Path, picture: Callable[[], Figure]) -> Iterator[str]:
    save(picture(), path)
    yield f"wrote {path}"
