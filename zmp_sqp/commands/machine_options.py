"""Options of a command that describe machine, ground and uncertainties.

The options are turned into the tables of a scenario file, from which `zmp_sqp.scenario.scene`
builds machine and ground. Options and scenario files thus obey one set of rules.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics import Heightmap, Machine, Slope, shipped_machines
from zmp_sqp.scenario.scene import (
    build_ground,
    build_machine,
    build_slope,
    build_uncertainties,
)
from zmp_sqp.scenario.schema import HEIGHTMAP, PAYLOAD, did_you_mean

__all__ = [
    "add_ground_options",
    "add_machine_options",
    "add_payload_options",
    "add_slope_options",
    "add_uncertainty_options",
    "ground_of",
    "machine_of",
    "machine_table",
    "slope_of",
    "uncertainties_of",
]

HERE = Path()  # paths on the command line are relative to the working folder
# attribute of the parsed arguments for each key of [machine]; one that is not given is left out
MACHINE_ARGUMENTS = {
    "joint_limits": "limits",
    "srdf": "srdf",
    "joints": "joints",
    "group": "group",
    "hold": "hold",
    "package_dirs": "package_dirs",
    "strict": "strict",
    "contact_links": "contact_links",
    "point_masses": "point_masses",
}
# attribute of the parsed arguments for each key of [machine.payload]
PAYLOAD_ARGUMENTS = {
    "mass": "payload",
    "frame": "payload_frame",
    "com": "payload_com",
    "inertia": "payload_inertia",
}


def add_machine_options(command: argparse.ArgumentParser) -> None:
    """Add options for joint limits, planned and held joints, support and point masses."""
    command.add_argument(
        "--limits",
        metavar="FILE",
        help="joint limits as MoveIt's joint_limits.yaml (default: the file beside the URDF)",
    )
    command.add_argument(
        "--srdf",
        metavar="FILE",
        help="SRDF of the machine: its groups for --group, its states as poses and for held joints",
    )
    chosen = command.add_mutually_exclusive_group()
    chosen.add_argument(
        "--joints", nargs="+", metavar="JOINT", help="joints to plan (default: all that move)"
    )
    chosen.add_argument("--group", metavar="NAME", help="group of the SRDF whose joints to plan")
    command.add_argument(
        "--hold",
        nargs="+",
        type=_held,
        metavar="JOINT=VALUE",
        help="[rad or m] joints that are not planned but held at a value (default for joints that "
        "are not planned: the SRDF's state, else 0, within the limits)",
    )
    command.add_argument(
        "--package-dirs",
        nargs="+",
        metavar="DIR",
        help="folders of the packages that package:// in the URDF names; no mesh outside is opened",
    )
    command.add_argument(
        "--strict", action="store_true", help="refuse what only causes a warning otherwise"
    )
    command.add_argument(
        "--contact-links",
        nargs="+",
        metavar="LINK",
        help="links that stand on the ground (default: all that is fixed to the root link)",
    )
    command.add_argument(
        "--point-masses",
        action="store_true",
        help="drop rotational inertias, as eq. (5) of Song & Sharf 2020 does",
    )


def add_payload_options(command: argparse.ArgumentParser) -> None:
    """Add options for the payload."""
    command.add_argument("--payload", type=float, metavar="KG", help="[kg] mass of the payload")
    command.add_argument(
        "--payload-frame", metavar="LINK", help="name of the link that carries the payload"
    )
    command.add_argument(
        "--payload-com",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="[m] payload's centre of mass in the frame of that link",
    )
    command.add_argument(
        "--payload-inertia",
        type=float,
        nargs=3,
        metavar=("XX", "YY", "ZZ"),
        help=(
            "[kg m^2] payload's rotational inertia about its centre of mass, along the axes of "
            "that link (default: a point mass)"
        ),
    )


def add_slope_options(command: argparse.ArgumentParser) -> None:
    """Add options for roll and pitch of a plane."""
    command.add_argument(
        "--roll",
        type=float,
        default=0.0,
        metavar="DEG",
        help="[deg] roll of the ground; negative leans the machine to its left (default: 0)",
    )
    command.add_argument(
        "--pitch",
        type=float,
        default=0.0,
        metavar="DEG",
        help="[deg] pitch of the ground; positive is nose down (default: 0)",
    )


def add_ground_options(command: argparse.ArgumentParser) -> None:
    """Add options for the ground: roll and pitch of a plane, or a heightmap."""
    add_slope_options(command)
    command.add_argument(
        "--heightmap",
        metavar="FILE",
        help="heights (CSV or NPY) over which the base drives, in place of --roll and --pitch",
    )
    command.add_argument(
        "--resolution",
        type=float,
        metavar="M",
        help="[m] distance between neighbouring samples of the heightmap",
    )
    command.add_argument(
        "--origin",
        type=float,
        nargs=2,
        default=(0.0, 0.0),
        metavar=("X", "Y"),
        help="[m] position of the heightmap's first sample (default: 0 0)",
    )


def add_uncertainty_options(command: argparse.ArgumentParser) -> None:
    """Add options for uncertainties of payload and slope."""
    command.add_argument(
        "--tipping-fraction",
        type=float,
        default=1.0,
        metavar="SHARE",
        help="require safety with the payload divided by this share too "
        "(ISO 10567: 0.75; default: 1)",
    )
    command.add_argument(
        "--payload-uncertainty",
        type=float,
        default=0.0,
        metavar="SHARE",
        help="largest relative error of the payload's mass and inertia: 0.1 is 10 %% (default: 0)",
    )
    command.add_argument(
        "--payload-com-uncertainty",
        type=float,
        nargs="+",
        default=[0.0],
        metavar="M",
        help="[m] largest error of the payload's centre of mass along each axis: one number, or "
        "one per axis (default: 0)",
    )
    command.add_argument(
        "--slope-uncertainty",
        type=float,
        default=0.0,
        metavar="DEG",
        help="[deg] largest error of the direction of gravity; not with --heightmap (default: 0)",
    )


def machine_of(arguments: argparse.Namespace) -> Machine:
    """Machine that the options describe.

    Raises:
        MachineError: Options for the payload are missing, or URDF, limits, support or payload
            cannot be used.
    """
    return build_machine(machine_table(arguments), HERE)


def machine_table(arguments: argparse.Namespace) -> dict[str, Any]:
    """Table [machine] of the options, with paths relative to the working folder.

    Raises:
        MachineError: There is no such machine, or options for the payload are missing.
    """
    source = "name" if arguments.urdf in shipped_machines() else "urdf"
    path = Path(arguments.urdf)
    if source == "urdf" and path.name == arguments.urdf and not path.suffix and not path.exists():
        shipped = shipped_machines()
        raise MachineError(
            f"there is no machine {arguments.urdf!r}{did_you_mean(arguments.urdf, shipped)}; "
            f"machines are {', '.join(shipped)}, or give the path of a URDF"
        )
    table: dict[str, Any] = {source: arguments.urdf}
    for key, name in MACHINE_ARGUMENTS.items():
        value = getattr(arguments, name)
        if value is not None and value is not False:
            table[key] = dict(value) if key == "hold" else value
    payload = _payload_table(arguments)
    if payload:
        table["payload"] = payload
    return table


def _held(text: str) -> tuple[str, float]:
    """Name and coordinate of a joint from JOINT=VALUE."""
    name, equals, value = text.rpartition("=")
    try:
        if not (name and equals):
            raise ValueError
        return name, float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not JOINT=VALUE, such as lift=0.5") from None


def _payload_table(arguments: argparse.Namespace) -> dict[str, Any]:
    """Table [machine.payload] of the options; empty without a payload."""
    given = {key: getattr(arguments, name) for key, name in PAYLOAD_ARGUMENTS.items()}
    table = {key: value for key, value in given.items() if value is not None}
    if not table or table.keys() >= set(PAYLOAD.required):
        if "inertia" in table:
            table["inertia"] = np.diag(table["inertia"])
        return table
    mass, *others = (_option(PAYLOAD_ARGUMENTS[key]) for key in ("mass", "frame", "com"))
    if table.keys() == {"inertia"}:
        raise MachineError(
            f"{_option(PAYLOAD_ARGUMENTS['inertia'])} belongs to a payload: give {mass}, "
            f"{' and '.join(others)}"
        )
    raise MachineError(f"{mass}, {' and '.join(others)} belong together: give all three")


def slope_of(arguments: argparse.Namespace) -> Slope:
    """Slope that the options describe.

    Raises:
        MachineError: An angle is out of range.
    """
    return build_slope({"roll_deg": arguments.roll, "pitch_deg": arguments.pitch})


def ground_of(arguments: argparse.Namespace) -> Slope | Heightmap:
    """Ground that the options describe.

    Raises:
        MachineError: Options exclude each other or are missing, an angle is out of range, or the
            heightmap cannot be used.
    """
    if arguments.heightmap is None:
        return slope_of(arguments)
    table = {"file": arguments.heightmap, "origin": tuple(arguments.origin)}
    if arguments.resolution is not None:
        table["resolution"] = arguments.resolution
    if arguments.roll or arguments.pitch or not table.keys() >= set(HEIGHTMAP.required):
        raise MachineError(
            "--heightmap needs --resolution, and has slopes of its own: "
            "leave out --roll and --pitch"
        )
    return build_ground({"heightmap": table}, HERE)


def uncertainties_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Uncertainties that the options describe, as keyword arguments of `Problem`, in SI units.

    Raises:
        ProblemError: A value is out of range.
    """
    com = arguments.payload_com_uncertainty
    table = {
        "tipping_fraction": arguments.tipping_fraction,
        "payload_uncertainty": arguments.payload_uncertainty,
        "payload_com_uncertainty": com[0] if len(com) == 1 else com,
        "slope_uncertainty_deg": arguments.slope_uncertainty,
    }
    return build_uncertainties(table, spell=lambda key: _option(key.removesuffix("_deg")))


def _option(argument: str) -> str:
    """Option of a command line that sets this attribute of the parsed arguments."""
    return f"--{argument.replace('_', '-')}"
