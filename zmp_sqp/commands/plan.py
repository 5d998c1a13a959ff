"""`zmp-sqp plan`: plan the motion of a scenario."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

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
from zmp_sqp.commands.exit_codes import DONE, INTERRUPTED, UNSAFE
from zmp_sqp.commands.export_option import add_export_option, check_exports, write_exports
from zmp_sqp.commands.live import Steps, live_line
from zmp_sqp.commands.plan_steps import (
    diagnosis_of_plan,
    opinion_of_plan,
    phase_plane_of,
    record_of_plan,
)
from zmp_sqp.commands.report import add_html_option, check_html, write_report
from zmp_sqp.commands.rigorous_option import (
    add_rigorous_option,
    check_rigorous_option,
)
from zmp_sqp.planning import Plan, Status, Trajectory, plan
from zmp_sqp.planning.problem.checks import AUTO
from zmp_sqp.plots import locus, profiles, save
from zmp_sqp.report.record import RECORD_KEYS
from zmp_sqp.scenario import load_scenario
from zmp_sqp.scenario.path_constraints import kinds_in_words
from zmp_sqp.show.basis import Basis, basis_table
from zmp_sqp.show.guarantees import guarantee_table
from zmp_sqp.show.results import RESULT_KEYS, make_result
from zmp_sqp.show.rigorous import rigorous_fields, rigorous_line, rigorous_table
from zmp_sqp.show.tables import (
    history_table,
    joint_table,
    joint_unit,
    runs_table,
    summary_table,
)

__all__ = ["PLAN_FILES", "add_plan", "run_plan"]

# files of `--out`
PLAN_FILES = ("plan.json", "trajectory.csv", "trajectory.json", "zmp.png", "joints.png")
DIAGNOSIS = "a payload or slope with which there is a motion"
DESCRIPTION = """\
Plan the fastest motion of a scenario that is proven not to tip the machine over, and print its
duration, margins, and what the verdict rests on. With --out write trajectory and figures.
"""
EXAMPLES = """\
examples:
  zmp-sqp plan paper_1 --out out/paper_1      table, trajectory, figures
  zmp-sqp plan my_machine.toml --json -       results for another program
  zmp-sqp plan paper_1 --margin 0.3 --verbose
  zmp-sqp plan paper_1 --html report.html     the motion in 3-D, in any browser
  zmp-sqp plan paper_1 --export swing.yaml    for a ROS 2 joint_trajectory_controller
"""
SCENARIO_KEYS = """\
keys of scenario files (TOML); SI units; angles are in degrees where the key ends in _deg, otherwise
in radians; paths are relative to the scenario file:
  title               one line
  [machine]           name (of a shipped machine) or urdf (file); point_masses (true drops
                      rotational inertias); joint_limits (file), limits (table: position_lower,
                      position_upper, velocity, acceleration, effort); support (table: vertices,
                      height) or contact_links; srdf (file), joints or group (which are planned),
                      hold (table: where the others are held), package_dirs, strict (refuse what
                      only causes a warning otherwise)
  [machine.payload]   mass [kg], frame (name of a link), com [m] in that frame,
                      inertia [kg m^2] about com, 3 x 3 (default: a point mass)
  [ground]            roll_deg (negative leans the machine to its left), pitch_deg (positive is
                      nose down); level ground if left out
  [ground.heightmap]  in place of roll and pitch: file (CSV or NPY), resolution [m], origin [m]
  [motion]            start, goal, start_velocity, goal_velocity: one number per joint, or a
                      table { joint = number }; start and goal may be the name of a pose of the
                      SRDF; or start_deg, goal_deg, ... in degrees
  [base]              a base that drives; start, goal: x, y, yaw [m, m, rad]; max_speed,
                      max_acceleration, max_yaw_rate, max_yaw_acceleration; start_velocity,
                      goal_velocity: speed, yaw rate; x_bounds, y_bounds [m]
  [plan]              model (full or simplified), intervals, qp_solver,
                      margin [m] (distance that the ZMP keeps from every edge);
                      uncertainties, under all of which the motion is proven safe:
                      tipping_fraction (payload divided by this share; ISO 10567: 0.75),
                      payload_uncertainty (share of the payload's mass and inertia: 0.1 is 10 %),
                      payload_com_uncertainty [m] (one number, or one per axis of its frame),
                      slope_uncertainty_deg (error of the direction of gravity)
  [[constraints]]     what the motion keeps beside the margin and the joint limits, one table for
                      each constraint: type (one of the known constraints below), and its keys
"""


def add_plan(commands: Any, shipped: str) -> None:
    """Add the command `plan`.

    Args:
        commands: Subcommands of an argparse parser.
        shipped: Help text that lists the shipped scenarios.
    """
    command = add_command(
        commands,
        "plan",
        run_plan,
        summary="plan the fastest safe motion of a scenario",
        description=DESCRIPTION,
        notes=(EXAMPLES, shipped, SCENARIO_KEYS, kinds_in_words(), RESULT_KEYS + RECORD_KEYS),
    )
    command.add_argument(
        "scenario", metavar="SCENARIO", help="a scenario file (TOML), or the name of a shipped one"
    )
    _add_planning_options(command)
    _add_output_options(command)


def _add_planning_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--qp-solver",
        metavar="NAME",
        help="auto, piqp, proxqp or qpsolvers:NAME (default: the scenario's)",
    )
    command.add_argument(
        "--intervals",
        type=_intervals,
        metavar="N",
        help="number of intervals of the time grid, or auto (default: the scenario's)",
    )
    command.add_argument(
        "--margin",
        type=float,
        metavar="M",
        help="[m] distance that the ZMP keeps from every edge (default: the scenario's)",
    )
    command.add_argument(
        "--time-budget",
        type=float,
        metavar="S",
        help="[s] time after which the search ends with what it has (default: none)",
    )
    command.add_argument(
        "--no-diagnosis",
        dest="diagnosis",
        action="store_false",
        help="if there is no motion, do not look for a lighter payload or a gentler slope with "
        "which there is one (nor is that done where a time budget ended the search)",
    )


def _add_output_options(command: argparse.ArgumentParser) -> None:
    add_rigorous_option(command)
    note = ". trajectory.json is not for ROS controllers: they play what --export writes"
    add_out_option(command, PLAN_FILES, note)
    add_html_option(command)
    add_export_option(command)
    add_json_option(command)
    command.add_argument(
        "--no-figures", dest="figures", action="store_false", help="write no figures"
    )
    command.add_argument(
        "--verbose",
        action="store_true",
        help="print every run of the search and every SQP iteration",
    )


def _intervals(text: str) -> int | str:
    return text if text == AUTO else int(text)


def run_plan(arguments: argparse.Namespace) -> int:
    """Plan, print and write; returns the exit code."""
    check_rigorous_option(arguments)
    scenario = load_scenario(arguments.scenario)
    given = {key: getattr(arguments, key) for key in ("intervals", "margin")}
    overrides = {key: value for key, value in given.items() if value is not None}
    problem = replace(scenario.problem, **overrides)
    prepare_folder(arguments.out, PLAN_FILES)
    check_html(arguments.html)
    check_exports(arguments.exports, drives=problem.base is not None)
    with live_line() as line:
        found = plan(
            problem,
            qp_solver=arguments.qp_solver or scenario.qp_solver,
            time_budget=arguments.time_budget,
            progress=line.count,
            announce=line.say,
        )
    steps, baseline = Steps(), phase_plane_of(problem)
    fields = partial(make_result, scenario, found)
    result = steps.run("baseline", lambda _: fields(baseline), lambda: fields(None))
    result |= record_of_plan(steps, scenario, found, baseline, arguments)
    console = make_console(arguments.json)
    console.print(f"{scenario.name}: {scenario.title}", style="bold", soft_wrap=True)
    if arguments.verbose:
        console.print(runs_table(found))
        console.print(history_table(found))
    console.print(summary_table(result))
    console.print(guarantee_table(result["guarantees"]))
    if found.success:
        console.print(joint_table(result, joint_unit(problem.machine)))
    in_time = found.status is not Status.TIME_BUDGET  # else a lighter payload proves nothing
    if arguments.diagnosis and not found.success and in_time:
        result |= steps.run(DIAGNOSIS, lambda line: diagnosis_of_plan(found, line), dict)
    opinion = None
    if arguments.rigorous and found.success:
        opinion = steps.run(
            "second opinion", lambda line: opinion_of_plan(found, line), lambda: None
        )
    if opinion is not None:
        result["rigorous"] = rigorous_fields(opinion)
        console.print(rigorous_table(opinion))
        console.print(rigorous_line(opinion), soft_wrap=True)
    console.print(basis_table(Basis.of_problem(problem)))
    console.print(result["message"], style=None if found.success else "bold red", soft_wrap=True)
    if arguments.out is not None:
        print_lines(console, _write(arguments.out, found, result))
        if arguments.figures and found.success:
            print_lines(console, _drawn(steps, arguments.out, found, baseline))
    if arguments.html is not None:
        print_lines(console, [write_report(arguments.html, [result])])
    if found.success:
        print_lines(console, write_exports(arguments.exports, found.trajectory))
    write_json(to_json(result), arguments.json, console)
    print_lines(console, steps.lines())
    if steps.interrupted:
        return INTERRUPTED
    confirmed = opinion is None or opinion.confirmed
    return DONE if found.success and confirmed else UNSAFE


def _write(folder: Path, found: Plan, result: Mapping[str, Any]) -> Iterator[str]:
    """Write the numbers of `--out` one by one; yields a line about each."""
    (folder / "plan.json").write_text(to_json(result), encoding="utf-8")
    yield f"wrote {folder / 'plan.json'}"
    if not found.success:
        return
    found.trajectory.to_csv(folder / "trajectory.csv")
    yield f"wrote {folder / 'trajectory.csv'}"
    found.trajectory.to_json(folder / "trajectory.json")
    yield f"wrote {folder / 'trajectory.json'}"


def _drawn(steps: Steps, folder: Path, found: Plan, baseline: Trajectory | None) -> Sequence[str]:
    """Lines about the figures of `--out`, as far as they were drawn before a Ctrl-C."""
    lines: list[str] = []
    drawing = without_matplotlib(_draw(folder, found, baseline))
    steps.run("figures", lambda _: lines.extend(drawing), lambda: None)
    return lines


def _draw(folder: Path, found: Plan, baseline: Trajectory | None) -> Iterator[str]:
    """Draw the figures of `--out`; yields a line about each."""
    beside = {} if baseline is None else {"phase plane": baseline}
    save(locus(found, beside=beside), folder / "zmp.png")
    yield f"wrote {folder / 'zmp.png'}"
    save(profiles(found), folder / "joints.png")
    yield f"wrote {folder / 'joints.png'}"
