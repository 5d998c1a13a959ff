"""`zmp-sqp check`: certify an existing motion."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.commands.check_motion import (
    elsewhere_hints,
    finite,
    gap_hint,
    hints_on,
    jump_hint,
    limit_allowance,
    motion_fields,
    motion_lines,
    noise_hint,
)
from zmp_sqp.commands.check_plan import add_opinion, plan_hint
from zmp_sqp.commands.check_question import Question, question_of
from zmp_sqp.commands.check_verdict import (
    boundary_faults,
    certificate_faults,
    check_table,
    checked_share,
    limit_fields,
    verdict,
)
from zmp_sqp.commands.console import (
    add_command,
    add_json_option,
    make_console,
    print_lines,
    to_json,
    write_json,
)
from zmp_sqp.commands.constraint_options import add_constraint_option
from zmp_sqp.commands.exit_codes import DONE, INTERRUPTED, UNSAFE
from zmp_sqp.commands.live import LiveLine, Steps, live_line
from zmp_sqp.commands.machine_options import (
    add_ground_options,
    add_machine_options,
    add_payload_options,
    add_uncertainty_options,
)
from zmp_sqp.commands.rigorous_option import (
    add_rigorous_option,
    check_rigorous_option,
    margin_to_confirm,
)
from zmp_sqp.errors import ContactLost, UnboundedAcceleration
from zmp_sqp.mechanics import Machine, shipped_machines
from zmp_sqp.mechanics.ground import Ground
from zmp_sqp.mechanics.stability_measures import stability_measures
from zmp_sqp.motion.interpolation import RULES
from zmp_sqp.motion.reading import SUFFIXES, RecordedMotion, read_motion
from zmp_sqp.planning import Certificate, Trajectory, UnicycleBase
from zmp_sqp.planning.constraints.tip_over import supported
from zmp_sqp.planning.proof.certificate import certify_at
from zmp_sqp.planning.proof.limits_in_time import limit_peaks
from zmp_sqp.rigorous import RigorousCheck, check_rigorously
from zmp_sqp.scenario.path_constraints import kinds_in_words
from zmp_sqp.show.basis import BASIS_KEYS, basis_fields, basis_table
from zmp_sqp.show.guarantees import GUARANTEE_KEYS, guarantee_fields, guarantee_table
from zmp_sqp.show.rigorous import (
    RIGOROUS_KEYS,
    rigorous_fields,
    rigorous_line,
    rigorous_table,
)
from zmp_sqp.versions import installed_versions

__all__ = ["add_check", "run_check"]

SHARES = np.linspace(0.0, 1.0, 11)  # of each interval, at which `MEASURES` are sampled
# Stability measures beside the margin, each with the function that finds its worst value.
MEASURES = {"load_transfer_ratio": max, "force_angle": min, "tip_over_energy": min}
DESCRIPTION = """\
Prove, for all t and not only at samples, how far the ZMP of a motion stays inside the support
polygon, and whether the motion keeps the joint limits and the constraints of --constraint, and
begins and ends at rest. The motion is any table of samples: CSV or NPZ with a column `time` and
JOINT.position of every joint, and JOINT.velocity and JOINT.acceleration if there are any; or a ROS
JointTrajectory as YAML, JSON or in a MCAP bag. Files of `zmp-sqp plan` are read exactly. Samples
become the motion that --interpolation names, by default what a ROS joint_trajectory_controller
plays: "cubic" through positions and velocities, "quintic" with accelerations; positions alone,
which it joins by straight lines with infinite accelerations, become a "spline" with continuous
ones. The certificate is of exactly that motion; how far it departs from the samples is printed.
A plan.json holds motion and scenario and is checked alone; with --rigorous the second opinion is
added to it, for `zmp-sqp report` to show.
"""
EXAMPLES = r"""examples:
  zmp-sqp check feller_buncher out/paper_1/trajectory.csv --roll -20 \
      --payload 4000 --payload-frame head --payload-com 0 0 3.323 --point-masses
  zmp-sqp check out/paper_1/plan.json --rigorous
  zmp-sqp check logged.csv --scenario paper_1 --interpolation cubic
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
  limits               list: joint, limit, unit, allowed, value (largest at any time), time [s],
                       excess, allowance (excess that counts as rounding), kept
  motion               file, interpolation, samples, given (quantities), ignored (columns or
                       joints), departure: by joint, largest difference from the given position,
                       velocity and acceleration, and bound on the distance from straight lines
                       (between); null if the file was read exactly
  hints                units that look wrong, gaps, another start or goal: sentences
  duration             [s]
  gap                  relative excess of the duration over its lower bound from the limits of
                       joints and base; null if the base drives without --base-limits
  load_transfer_ratio  largest sampled value; 1 where one side carries nothing
  force_angle          [rad] least sampled value, Papadopoulos & Rey 1996
  tip_over_energy      [J] least sampled value, Messuri & Klein 1985 with inertial forces
{GUARANTEE_KEYS}{RIGOROUS_KEYS}{BASIS_KEYS}\
  versions             of zmp-sqp, Python and the packages that the result depends on
load_transfer_ratio, force_angle and tip_over_energy ignore the uncertainties.
"""


Opinion = Callable[[LiveLine], RigorousCheck | None]  # asks for a second opinion


def add_check(commands: Any) -> None:
    """Add the command `check`.

    Args:
        commands: Subcommands of an argparse parser.
    """
    command = add_command(
        commands,
        "check",
        run_check,
        summary="prove how safe an existing motion is",
        description=DESCRIPTION,
        notes=(
            EXAMPLES,
            f"shipped machines: {', '.join(shipped_machines())}\n",
            kinds_in_words(),
            CHECK_KEYS,
        ),
    )
    command.add_argument(
        "urdf",
        metavar="URDF",
        help="the machine: a URDF file, or the name of a shipped one; left out with --scenario and "
        "for a plan.json",
    )
    command.add_argument(
        "trajectory",
        metavar="TRAJECTORY",
        nargs="?",
        help=f"the motion: a file that ends in {', '.join(SUFFIXES)}, or a plan.json of `zmp-sqp "
        "plan`",
    )
    _add_motion_options(command)
    add_ground_options(command)
    command.add_argument(
        "--margin",
        type=float,
        metavar="M",
        help="[m] required distance from the ZMP to every edge (default: the scenario's, or 0)",
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
    add_rigorous_option(command)
    add_json_option(command)


def _add_motion_options(command: argparse.ArgumentParser) -> None:
    """Add options on how the file is read, and on what it may leave open."""
    command.add_argument(
        "--scenario",
        metavar="SCENARIO",
        help="scenario (file or shipped name) that gives machine, payload, ground, margin, "
        "uncertainties and constraints at once, in place of URDF and their options",
    )
    command.add_argument(
        "--interpolation",
        choices=RULES,
        help="motion between samples (default: see above; files of zmp-sqp are read exactly)",
    )
    command.add_argument(
        "--noise",
        type=float,
        metavar="X",
        help="[rad, or m for joints that slide] standard deviation of the noise of measured "
        "positions: smoothing splines that pass them at that distance are the motion",
    )
    command.add_argument("--degrees", action="store_true", help="angles in the file are in degrees")
    command.add_argument(
        "--limit-tolerance",
        type=float,
        metavar="SHARE",
        help="excess over velocity and acceleration limits that counts as kept, as a share of the "
        "limit (default: what the digits of the file explain, at most 0.01)",
    )
    for end in ("starts", "ends"):
        command.add_argument(
            f"--{end}-in-motion",
            action="store_true",
            help=f"the motion {end[:-1]}s with joints or base in motion, which is unsafe otherwise",
        )


def run_check(arguments: argparse.Namespace) -> int:
    """Certify, print and write; returns the exit code."""
    check_rigorous_option(arguments)
    if arguments.trajectory is None:  # --scenario or a plan.json in place of URDF
        arguments.urdf, arguments.trajectory = None, arguments.urdf
    steps = Steps()
    with live_line("reading the motion") as line:
        question, path = question_of(arguments), Path(arguments.trajectory)
        try:
            read = read_motion(
                path,
                question.machine,
                question.ground,
                interpolation=arguments.interpolation,
                degrees=arguments.degrees,
                noise=arguments.noise,
            )
        except UnboundedAcceleration as fault:
            result, ask = _unbounded(question, str(fault), path), None
        else:
            line.say(f"proving: {read.trajectory.intervals} intervals")
            result, ask = _checked(question, read, arguments)
            result["hints"] += plan_hint(question.plan, result["margin"], arguments)
    opinion = None
    if ask is not None:
        opinion = steps.run("second opinion", ask, lambda: None)
        result["rigorous"] = None if opinion is None else rigorous_fields(opinion)
    console = make_console(arguments.json)
    console.print(f"{path}: {question.machine.name}", style="bold", soft_wrap=True)
    if result["duration"] is not None:
        console.print(check_table(result))
    console.print(guarantee_table(result["guarantees"]))
    console.print(basis_table(result.pop("basis")))
    for hint in result["hints"]:
        console.print(f"Hint: {hint}", style="yellow", soft_wrap=True)
    safe = result["safe"]
    console.print(verdict(result), style=None if safe else "bold red", soft_wrap=True)
    if opinion is not None:
        safe = safe and opinion.confirmed
        console.print(rigorous_table(opinion))
        console.print(rigorous_line(opinion), soft_wrap=True)
        print_lines(console, add_opinion(question.plan, result["rigorous"], arguments))
    write_json(to_json(result), arguments.json, console)
    print_lines(console, steps.lines())
    if steps.interrupted:
        return INTERRUPTED
    return DONE if safe else UNSAFE


def _checked(
    question: Question, read: RecordedMotion, arguments: argparse.Namespace
) -> tuple[dict[str, Any], Opinion | None]:
    """Object that `--json` writes, with its basis under "basis"; and what asks a second opinion."""
    machine, trajectory = question.machine, read.trajectory
    base = question.with_base_of(trajectory, arguments.base_limits)
    allowance = limit_allowance(read, machine, checked_share(arguments.limit_tolerance))
    found = certify_at(
        question.corners,
        trajectory,
        question.margin,
        base=base,
        constraints=question.constraints,
        coordinates=question.coordinates,
        limit_allowance=allowance,
    )

    def opinion(line: LiveLine) -> RigorousCheck | None:
        return _opinion(question, trajectory, found, base, allowance, line)

    ends, faults = boundary_faults(question, read, arguments)
    peaks = limit_peaks(machine, trajectory, allowance)
    basis = question.basis(
        base=base is not None, motion=motion_lines(read, machine, allowance) + ends
    )
    bounded = trajectory.base is None or base is not None
    edge = "" if machine.support is None else machine.support.edge_name(found.edge)
    faults = certificate_faults(found, supported(machine), peaks) + faults
    result = {
        "safe": not faults,
        "margin": finite(found.margin),
        "required": found.required,
        "margin_at": found.margin_at,
        "edge": edge,
        "sampled": finite(found.sampled),
        "limits_ok": found.limits_ok,
        "limit_excess": finite(found.limit_excess),
        "corner": found.corner,
        "fault": "; ".join(faults),
        "duration": trajectory.duration,
        "gap": found.gap if bounded else None,
        **_measures(machine, trajectory, question.ground),
        "guarantees": guarantee_fields(found.guarantees),
        "rigorous": None,
        "limits": limit_fields(peaks),
        "motion": motion_fields(read),
        "hints": hints_on(read.samples, trajectory, machine, degrees=arguments.degrees)
        + (noise_hint(read, machine) or jump_hint(read, peaks))
        + gap_hint(read)
        + elsewhere_hints(question.problem, trajectory),
        "rests_on": basis_fields(basis),
        "versions": installed_versions(),
        "basis": basis,
    }
    return result, opinion if arguments.rigorous else None


def _opinion(
    question: Question,
    trajectory: Trajectory,
    found: Certificate,
    base: UnicycleBase | None,
    allowance: Array | None,
    line: LiveLine,
) -> RigorousCheck:
    """Second opinion on what a certificate guarantees."""
    return check_rigorously(
        question.machine,
        trajectory,
        question.ground,
        margin_to_confirm(found.margin, found.required),
        base=base,
        constraints=question.constraints,
        corners=question.corners,
        limit_allowance=allowance,
        progress=lambda count: line.say(f"second opinion: stretch {count}"),
    )


def _unbounded(question: Question, fault: str, path: Path) -> dict[str, Any]:
    """`_checked` for a motion whose accelerations have no bound."""
    nothing = Certificate.of_nothing(question.margin)
    basis = question.basis(base=False, motion=[f"straight lines through the samples of {path}"])
    result: dict[str, Any] = dict.fromkeys(
        ("margin", "margin_at", "sampled", "limit_excess", "duration", "gap", *MEASURES)
    )
    return result | {
        "safe": False,
        "required": question.margin,
        "edge": "",
        "limits_ok": False,
        "corner": "",
        "fault": fault,
        "guarantees": guarantee_fields(nothing.guarantees),
        "rigorous": None,
        "limits": [],
        "motion": {"file": str(path), "interpolation": "linear"},
        "hints": [],
        "rests_on": basis_fields(basis),
        "versions": installed_versions(),
        "basis": basis,
    }


def _measures(machine: Machine, trajectory: Trajectory, ground: Ground) -> dict[str, float | None]:
    """Worst sampled values of `MEASURES`; None if the base drives, on lift-off or overflow."""
    if trajectory.base is not None:
        return dict.fromkeys(MEASURES)
    _, q, v, a = trajectory.within(SHARES)
    try:
        measures = stability_measures(machine, q, v, a, ground)
    except ContactLost:
        return dict.fromkeys(MEASURES)
    values: dict[str, Array] = {name: getattr(measures, name) for name in MEASURES}
    return {name: finite(worst(values[name])) for name, worst in MEASURES.items()}
