"""`zmp-sqp check`: the certificate of an existing motion, from anywhere."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ContactLost, MachineError, ProblemError
from zmp_sqp.mechanics import Heightmap, Machine, Payload, Slope, load_machine, shipped_machines
from zmp_sqp.mechanics.stability_measures import stability_measures
from zmp_sqp.mechanics.uncertainty import com_box, corners
from zmp_sqp.planning import Certificate, Trajectory, UnicycleBase
from zmp_sqp.planning.problem.checks import UNCERTAINTIES
from zmp_sqp.planning.problem.unicycle_base import LIMITS
from zmp_sqp.planning.proof.certificate import certify_at
from zmp_sqp.planning.proof.words import spelled
from zmp_sqp.show.report import key_table, versions

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["add_check", "run_check"]

SHARES = np.linspace(0.0, 1.0, 11)  # of each interval, at which the other measures are sampled
CHECK_KEYS = """\
--json writes one object; SI units, null where there is no value:
  safe                 whether margin and limits are guaranteed for all t
  margin, required     [m] guaranteed distance from the ZMP to the nearest edge, and what was asked
  for;
                       null margin: the ground would have to pull, or nothing is proven; see fault
  corner               payload and slope for which it is least; empty if nothing is uncertain
  margin_at, edge      [s] and the name of the edge: where the sampled margin is least
  sampled              [m] that least margin
  limits_ok, limit_excess
  fault                what is wrong, in words; empty if the motion is safe
  duration, gap        [s]; how much longer than the fastest motion within the limits of joints and
  base,
                       as a share; null if the base drives and its limits are not given
  load_transfer_ratio  largest, sampled; 1 where one side carries nothing; from here on, nothing is
  uncertain force_angle          least, sampled, Papadopoulos & Rey 1996, [rad] tip_over_energy
  least, sampled, Messuri & Klein 1985 with inertial forces, [J] versions             of Python, of
  this package and of what it stands on
"""


def add_check(commands: Any, exit_codes: str) -> None:
    """Add the subcommand to an argparse parser's subcommands."""
    command = commands.add_parser(
        "check",
        help="the certificate of an existing motion",
        description=(
            "Prove, for all t and not only at samples, how far the ZMP of a motion stays inside the support polygon,\n"
            "and whether it keeps the joint limits. The motion is a CSV file as `zmp-sqp plan --out` writes it:\n"
            "time, then JOINT.position, JOINT.velocity, JOINT.acceleration (and JOINT.jerk) of every joint."
        ),
        epilog=(
            "examples:\n"
            "  zmp-sqp check feller_buncher out/paper_1/trajectory.csv --roll -20 \\\n"
            "      --payload 4000 --payload-frame head --payload-com 0 0 3.323 --point-masses\n"
            "  zmp-sqp check feller_buncher drive.csv --base-limits 10 2 0.5 1 --slope-uncertainty 1\n"
            "  zmp-sqp check my_crane.urdf motion.csv --roll 5 --pitch -3 --margin 0.2 --limits joint_limits.yaml\n\n"
            f"shipped machines: {', '.join(shipped_machines())}\n\n{CHECK_KEYS}\n{exit_codes}"
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=run_check)
    command.add_argument(
        "urdf", metavar="URDF", help="the machine: a URDF file, or the name of a shipped one"
    )
    command.add_argument("trajectory", type=Path, metavar="TRAJECTORY.csv", help="the motion")
    command.add_argument(
        "--roll", type=float, default=0.0, metavar="DEG", help="of the slope; negative leans left"
    )
    command.add_argument(
        "--pitch",
        type=float,
        default=0.0,
        metavar="DEG",
        help="of the slope; positive is nose down",
    )
    command.add_argument(
        "--heightmap",
        metavar="FILE",
        help="heights (CSV or NPY) over which the base drives instead",
    )
    command.add_argument(
        "--resolution", type=float, metavar="M", help="[m] between the heightmap's samples"
    )
    command.add_argument(
        "--origin",
        type=float,
        nargs=2,
        default=(0.0, 0.0),
        metavar=("X", "Y"),
        help="[m] of its first sample",
    )
    command.add_argument(
        "--margin", type=float, default=0.0, metavar="M", help="[m] to keep from every edge"
    )
    command.add_argument(
        "--limits", metavar="FILE", help="joint_limits.yaml (default: the one beside the URDF)"
    )
    command.add_argument(
        "--contact-links", nargs="+", metavar="LINK", help="links that stand on the ground"
    )
    command.add_argument("--payload", type=float, metavar="KG", help="mass of what it carries")
    command.add_argument("--payload-frame", metavar="LINK", help="the link that carries it")
    command.add_argument(
        "--payload-com",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="[m] in that link's frame",
    )
    command.add_argument(
        "--payload-inertia",
        type=float,
        nargs=3,
        metavar=("XX", "YY", "ZZ"),
        help="[kg m^2] about its centre of mass, along that link's axes (default: a point mass)",
    )
    command.add_argument(
        "--tipping-fraction",
        type=float,
        default=1.0,
        metavar="SHARE",
        help="safe with the payload divided by this share, too (ISO 10567: 0.75; default: 1)",
    )
    command.add_argument(
        "--payload-uncertainty",
        type=float,
        default=0.0,
        metavar="SHARE",
        help="by which the payload's mass and inertia may be off, either way: 0.1 is ten percent (default: 0)",
    )
    command.add_argument(
        "--payload-com-uncertainty",
        type=float,
        nargs="+",
        default=[0.0],
        metavar="M",
        help="[m] by which its centre of mass may be off, either way: one number, or one per axis (default: 0)",
    )
    command.add_argument(
        "--slope-uncertainty",
        type=float,
        default=0.0,
        metavar="DEG",
        help="[deg] by which gravity may be off, in any direction; not over a heightmap (default: 0)",
    )
    command.add_argument(
        "--base-limits",
        type=float,
        nargs=4,
        metavar=("V", "A", "YAW_V", "YAW_A"),
        help="[m/s, m/s^2, rad/s, rad/s^2] what a base that drives may do along its heading and in yaw",
    )
    command.add_argument(
        "--point-masses", action="store_true", help="no rotational inertia: the paper's eq. (5)"
    )
    command.add_argument(
        "--json",
        metavar="FILE",
        help="write the results; - is standard output, with nothing else there",
    )


def run_check(arguments: argparse.Namespace) -> int:
    """Check, print, write; 0 if the motion is proven safe, 1 if not."""
    from rich.console import Console

    machine = _machine(arguments)
    ground = _ground(arguments)
    trajectory = Trajectory.from_csv(arguments.trajectory, machine, ground)
    found = _certificate(arguments, machine, trajectory, ground)
    bounded = trajectory.base is None or arguments.base_limits is not None
    result = _result(machine, trajectory, ground, found, bounded=bounded)

    console = Console(stderr=arguments.json == "-", highlight=False, markup=False)
    console.print(f"{arguments.trajectory}: {machine.name}", style="bold", soft_wrap=True)
    console.print(_table(result))
    console.print(_verdict(result), style=None if found.safe else "bold red", soft_wrap=True)
    text = json.dumps(result, indent=2, allow_nan=False) + "\n"
    if arguments.json == "-":
        print(text, end="")
    elif arguments.json is not None:
        Path(arguments.json).write_text(text, encoding="utf-8")
        console.print(f"wrote {arguments.json}", soft_wrap=True)
    return 0 if found.safe else 1


def _ground(arguments: argparse.Namespace) -> Slope | Heightmap:
    if arguments.heightmap is None:
        return Slope(roll=np.deg2rad(arguments.roll), pitch=np.deg2rad(arguments.pitch))
    if arguments.roll or arguments.pitch or arguments.resolution is None:
        raise MachineError(
            "--heightmap needs --resolution, and has slopes of its own: leave out --roll and --pitch"
        )
    return Heightmap.from_file(arguments.heightmap, arguments.resolution, tuple(arguments.origin))


def _machine(arguments: argparse.Namespace) -> Machine:
    machine = load_machine(arguments.urdf, support=arguments.contact_links, limits=arguments.limits)
    given = [
        getattr(arguments, key) is not None for key in ("payload", "payload_frame", "payload_com")
    ]
    if any(given) and not all(given):
        raise MachineError(
            "--payload, --payload-frame and --payload-com belong together: give all three"
        )
    if arguments.payload_inertia is not None and not all(given):
        raise MachineError(
            "--payload-inertia belongs to a payload: give --payload, --payload-frame and --payload-com"
        )
    if all(given):
        inertia = None if arguments.payload_inertia is None else np.diag(arguments.payload_inertia)
        payload = Payload(
            arguments.payload, arguments.payload_com, arguments.payload_frame, inertia
        )
        machine = machine.with_payload(payload)
    return machine.with_point_masses() if arguments.point_masses else machine


def _certificate(
    arguments: argparse.Namespace,
    machine: Machine,
    trajectory: Trajectory,
    ground: Slope | Heightmap,
) -> Certificate:
    """The least guarantee at all corners of what is uncertain."""
    given = {
        "tipping_fraction": arguments.tipping_fraction,
        "payload_uncertainty": arguments.payload_uncertainty,
        "slope_uncertainty": arguments.slope_uncertainty,
    }
    for name, lower, upper in UNCERTAINTIES:
        value, unit = given.get(name, lower), " degrees" * (name == "slope_uncertainty")
        lower, upper = (float(np.rad2deg(side)) if unit else side for side in (lower, upper))
        if not lower <= value <= upper:
            option = f"--{name.replace('_', '-')}"
            raise ProblemError(
                f"{option} must lie within [{lower:.4g}, {upper:.4g}]{unit}, not {value:g}"
            )
    given["slope_uncertainty"] = float(np.deg2rad(given["slope_uncertainty"]))
    sides = arguments.payload_com_uncertainty
    box = com_box(sides[0] if len(sides) == 1 else sides, name="--payload-com-uncertainty")
    extremes = corners(machine, ground, **given, payload_com_uncertainty=box, every=True)
    return certify_at(extremes, trajectory, arguments.margin, base=_base(arguments, trajectory))


def _base(arguments: argparse.Namespace, trajectory: Trajectory) -> UnicycleBase | None:
    """The base with its limits, from where to where the motion leads it."""
    if arguments.base_limits is None:
        return None
    motion = trajectory.base
    if motion is None:
        raise ProblemError("--base-limits are for a base that drives, but this motion has none")
    limits = dict(zip(LIMITS, arguments.base_limits, strict=True))
    asked = {
        f"{side}_velocity": np.clip(
            motion.velocities[k], *np.outer([-1.0, 1.0], arguments.base_limits[::2])
        )
        for side, k in (("start", 0), ("goal", -1))
    }
    return UnicycleBase(start=motion.poses[0], goal=motion.poses[-1], **limits, **asked)


def _result(
    machine: Machine,
    trajectory: Trajectory,
    ground: Slope | Heightmap,
    found: Certificate,
    *,
    bounded: bool,
) -> dict[str, Any]:
    edge = "" if machine.support is None else machine.support.edge_name(found.edge)
    return {
        "safe": found.safe,
        "margin": _finite(found.margin),
        "required": found.required,
        "margin_at": found.margin_at,
        "edge": edge,
        "sampled": _finite(found.sampled),
        "limits_ok": found.limits_ok,
        "limit_excess": _finite(found.limit_excess),
        "corner": found.corner,
        "fault": "" if found.safe else "; ".join(_faults(found, edge)),
        "duration": trajectory.duration,
        "gap": found.gap if bounded else None,
        **_measures(machine, trajectory, ground),
        "versions": versions(),
    }


def _measures(
    machine: Machine, trajectory: Trajectory, ground: Slope | Heightmap
) -> dict[str, float | None]:
    """The worst of the other measures; null where the machine lifts off, they overflow, or while its base drives."""
    names = {"load_transfer_ratio": max, "force_angle": min, "tip_over_energy": min}
    if trajectory.base is not None:
        return dict.fromkeys(names)
    _, q, v, a = trajectory.within(SHARES)
    try:
        measures = stability_measures(machine, q, v, a, ground)
    except ContactLost:
        return dict.fromkeys(names)
    values: dict[str, Array] = {name: getattr(measures, name) for name in names}
    return {name: _finite(worst(values[name])) for name, worst in names.items()}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _table(result: Mapping[str, Any]) -> Table:
    return key_table(
        {
            "guaranteed margin [m]": result["margin"],
            "asked for [m]": result["required"],
            f"least sampled margin [m], at the {result['edge']} edge": result["sampled"],
            "at [s]": result["margin_at"],
            "duration [s]": result["duration"],
            "above the bound of joints and base [%]": None
            if result["gap"] is None
            else 100.0 * result["gap"],
            "largest load transfer ratio": result["load_transfer_ratio"],
            "least force angle [rad]": result["force_angle"],
            "least tip-over energy [kJ]": None
            if result["tip_over_energy"] is None
            else 1e-3 * result["tip_over_energy"],
        }
    )


def _verdict(result: Mapping[str, Any]) -> str:
    worst = f"; the margin is least with {result['corner']}" if result["corner"] else ""
    return f"Safe at all times{worst}." if result["safe"] else f"Not safe: {result['fault']}."


def _faults(found: Certificate, edge: str) -> list[str]:
    """What is not guaranteed, one clause each."""
    reasons, required = [], max(found.required, 0.0)
    extreme = f" with {found.corner}" if found.corner else ""
    if not np.isfinite(found.sampled):
        reasons.append(
            f"at {found.margin_at:.2f} s the ground would have to hold the machine down{extreme}"
        )
    elif not np.isfinite(found.margin):
        reasons.append(f"no margin is proven{extreme}: {found.doubt}")
    elif found.margin < required:
        kept = " less the margin" if found.required else ""
        leaves = "leaves" if found.sampled < required else "may leave"
        short = spelled(required - found.margin)
        reasons.append(
            f"at {found.margin_at:.2f} s the ZMP {leaves} the {edge} edge{kept} by {short}{extreme}"
        )
    if not found.limits_ok:
        reasons.append(f"the motion {found.fault}")
    return reasons
