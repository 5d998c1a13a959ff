"""`zmp-sqp check`: certify an existing motion."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from zmp_sqp.arrays import Array, length_text
from zmp_sqp.commands.console import (
    add_command,
    add_json_option,
    make_console,
    to_json,
    write_json,
)
from zmp_sqp.commands.constraint_options import add_constraint_option, constraints_of
from zmp_sqp.commands.exit_codes import DONE, UNSAFE
from zmp_sqp.commands.machine_options import (
    add_ground_options,
    add_machine_options,
    add_payload_options,
    add_uncertainty_options,
    ground_of,
    machine_of,
    uncertainties_of,
)
from zmp_sqp.errors import ContactLost, ProblemError
from zmp_sqp.mechanics import Heightmap, Machine, Slope, shipped_machines
from zmp_sqp.mechanics.stability_measures import stability_measures
from zmp_sqp.mechanics.uncertainty import corners
from zmp_sqp.planning import Certificate, Trajectory, UnicycleBase
from zmp_sqp.planning.problem.unicycle_base import LIMITS
from zmp_sqp.planning.proof.certificate import certify_at
from zmp_sqp.planning.proof.words import broken_own, fault_of, limit_fault
from zmp_sqp.scenario.path_constraints import kinds_in_words
from zmp_sqp.show.guarantees import GUARANTEE_KEYS, guarantee_fields, guarantee_table
from zmp_sqp.show.tables import key_table
from zmp_sqp.versions import installed_versions

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["add_check", "run_check"]

SHARES = np.linspace(0.0, 1.0, 11)  # of each interval, at which `MEASURES` are sampled
# Stability measures beside the margin, each with the function that finds its worst value.
MEASURES = {"load_transfer_ratio": max, "force_angle": min, "tip_over_energy": min}
DESCRIPTION = """\
Prove, for all t and not only at samples, how far the ZMP of a motion stays inside the support
polygon, and whether the motion keeps the joint limits and the constraints of --constraint. The
motion is a CSV file as `zmp-sqp plan --out` writes it: time, then JOINT.position, JOINT.velocity,
JOINT.acceleration (and JOINT.jerk) of every joint.
"""
EXAMPLES = r"""examples:
  zmp-sqp check feller_buncher out/paper_1/trajectory.csv --roll -20 \
      --payload 4000 --payload-frame head --payload-com 0 0 3.323 --point-masses
  zmp-sqp check feller_buncher drive.csv --base-limits 10 2 0.5 1 --slope-uncertainty 1
  zmp-sqp check my_crane.urdf motion.csv --roll 5 --pitch -3 --margin 0.2 \
      --limits joint_limits.yaml --constraint torque_limits:share=0.9
"""
CHECK_KEYS = f"""\
--json writes one object; SI units, null where there is no value:
  safe                 whether margin, limits and constraints are guaranteed
  margin               [m] guaranteed distance from the ZMP to the nearest edge; null if the
                       ground would have to pull, or if nothing is proven (see fault)
  required             [m] distance asked for by --margin
  corner               payload and slope for which the margin is least; empty without
                       uncertainties
  margin_at, edge      [s] time and name of the edge at which the sampled margin is least
  sampled              [m] least sampled margin
  limits_ok            whether joints and base keep their limits
  limit_excess         largest excess over a limit, in the limit's unit
  fault                what is wrong, in words; empty if the motion is safe
  duration             [s]
  gap                  relative excess of the duration over its lower bound from the limits of
                       joints and base; null if the base drives without --base-limits
  load_transfer_ratio  largest sampled value; 1 where one side carries nothing
  force_angle          [rad] least sampled value, Papadopoulos & Rey 1996
  tip_over_energy      [J] least sampled value, Messuri & Klein 1985 with inertial forces
{GUARANTEE_KEYS}\
  versions             of zmp-sqp, Python and the packages that the result depends on
load_transfer_ratio, force_angle and tip_over_energy ignore the uncertainties.
"""


def add_check(commands: Any) -> None:
    """Add the command `check`.

    Args:
        commands: Subcommands of an argparse parser.
    """
    command = add_command(
        commands,
        "check",
        run_check,
        summary="certify an existing motion",
        description=DESCRIPTION,
        notes=(
            EXAMPLES,
            f"shipped machines: {', '.join(shipped_machines())}\n",
            kinds_in_words(),
            CHECK_KEYS,
        ),
    )
    command.add_argument(
        "urdf", metavar="URDF", help="the machine: a URDF file, or the name of a shipped one"
    )
    command.add_argument("trajectory", type=Path, metavar="TRAJECTORY.csv", help="the motion")
    add_ground_options(command)
    command.add_argument(
        "--margin",
        type=float,
        default=0.0,
        metavar="M",
        help="[m] required distance from the ZMP to every edge (default: 0)",
    )
    add_machine_options(command)
    add_payload_options(command)
    add_uncertainty_options(command)
    command.add_argument(
        "--base-limits",
        type=float,
        nargs=4,
        metavar=("V", "A", "YAW_V", "YAW_A"),
        help=(
            "[m/s, m/s^2, rad/s, rad/s^2] limits of a driving base: speed and acceleration along "
            "its heading, yaw rate and yaw acceleration"
        ),
    )
    add_constraint_option(command)
    add_json_option(command)


def run_check(arguments: argparse.Namespace) -> int:
    """Certify, print and write; returns the exit code."""
    machine, ground = machine_of(arguments), ground_of(arguments)
    trajectory = Trajectory.from_csv(arguments.trajectory, machine, ground)
    extremes = corners(machine, ground, **uncertainties_of(arguments), every=True)
    base = _base(arguments.base_limits, trajectory)
    constraints = constraints_of(arguments)
    found = certify_at(extremes, trajectory, arguments.margin, base=base, constraints=constraints)
    bounded = trajectory.base is None or base is not None
    result = _result(machine, trajectory, ground, found, bounded=bounded)

    console = make_console(arguments.json)
    console.print(f"{arguments.trajectory}: {machine.name}", style="bold", soft_wrap=True)
    console.print(_table(result))
    console.print(guarantee_table(result["guarantees"]))
    console.print(_verdict(result), style=None if found.safe else "bold red", soft_wrap=True)
    write_json(to_json(result), arguments.json, console)
    return DONE if found.safe else UNSAFE


def _base(limits: list[float] | None, trajectory: Trajectory) -> UnicycleBase | None:
    """Base with the limits of `--base-limits` and the motion's own start and goal.

    Start and goal velocities are clipped to the limits, because a base that starts too fast cannot
    be made; the certificate finds the excess.
    """
    if limits is None:
        return None
    motion = trajectory.base
    if motion is None:
        raise ProblemError("--base-limits are for a base that drives, but this motion has none")
    ends = {
        f"{end}_velocity": np.clip(motion.velocities[k], *np.outer([-1.0, 1.0], limits[::2]))
        for end, k in (("start", 0), ("goal", -1))
    }
    named = dict(zip(LIMITS, limits, strict=True))
    return UnicycleBase(start=motion.poses[0], goal=motion.poses[-1], **named, **ends)


def _result(
    machine: Machine,
    trajectory: Trajectory,
    ground: Slope | Heightmap,
    found: Certificate,
    *,
    bounded: bool,
) -> dict[str, Any]:
    """Object that `--json` writes; `CHECK_KEYS` explains its keys.

    Args:
        machine: The machine without uncertainties.
        trajectory: The motion.
        ground: The ground without uncertainties.
        found: Certificate of the worst corner.
        bounded: Whether the duration has a lower bound that counts the limits of the base.
    """
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
        "guarantees": guarantee_fields(found.guarantees),
        "versions": installed_versions(),
    }


def _measures(
    machine: Machine, trajectory: Trajectory, ground: Slope | Heightmap
) -> dict[str, float | None]:
    """Worst sampled values of `MEASURES`; None if the base drives, on lift-off or overflow."""
    if trajectory.base is not None:
        return dict.fromkeys(MEASURES)
    _, q, v, a = trajectory.within(SHARES)
    try:
        measures = stability_measures(machine, q, v, a, ground)
    except ContactLost:
        return dict.fromkeys(MEASURES)
    values: dict[str, Array] = {name: getattr(measures, name) for name in MEASURES}
    return {name: _finite(worst(values[name])) for name, worst in MEASURES.items()}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _table(result: Mapping[str, Any]) -> Table:
    """Numbers of the result, one per row."""

    def scaled(key: str, factor: float) -> float | None:
        return None if result[key] is None else factor * result[key]

    return key_table(
        {
            "guaranteed margin [m]": result["margin"],
            "asked for [m]": result["required"],
            f"least sampled margin [m], at the {result['edge']} edge": result["sampled"],
            "at [s]": result["margin_at"],
            "duration [s]": result["duration"],
            "above the bound of joints and base [%]": scaled("gap", 100.0),
            "largest load transfer ratio": result["load_transfer_ratio"],
            "least force angle [rad]": result["force_angle"],
            "least tip-over energy [kJ]": scaled("tip_over_energy", 1e-3),
        }
    )


def _verdict(result: Mapping[str, Any]) -> str:
    """One sentence: safe, or what is not."""
    if not result["safe"]:
        return f"Not safe: {result['fault']}."
    worst = f"; the margin is least with {result['corner']}" if result["corner"] else ""
    sampled = [found["name"] for found in result["guarantees"] if not found["proven"]]
    but = f"; not proven, but safe at 2000 samples a second: {', '.join(sampled)}"
    return f"Safe at all times{worst}{but if sampled else ''}."


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
        short = length_text(required - found.margin)
        reasons.append(
            f"at {found.margin_at:.2f} s the ZMP {leaves} the {edge} edge{kept} by {short}{extreme}"
        )
    faults = [fault_of(broken) for broken in broken_own(found.guarantees)]
    faults += filter(None, [limit_fault(found.guarantees)])
    return reasons + [f"the motion {fault}" for fault in faults]
