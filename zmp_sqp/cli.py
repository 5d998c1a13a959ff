"""Command line: `zmp-sqp plan`, `zmp-sqp paper`, `zmp-sqp check`, `zmp-sqp replay`."""

from __future__ import annotations

import argparse
import io
import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp import __version__
from zmp_sqp.commands.check import add_check
from zmp_sqp.commands.paper import PAPER_FILES, PAPER_KEYS, run_paper
from zmp_sqp.commands.replay import add_replay
from zmp_sqp.errors import ZmpSqpError
from zmp_sqp.planning import Plan, Problem, Trajectory, diagnose, phase_plane, plan
from zmp_sqp.scenario import load_scenario, shipped_scenarios
from zmp_sqp.show.plots import joint_unit, plot_joints, plot_zmp
from zmp_sqp.show.report import RESULT_KEYS, history_table, joint_table, make_result, summary_table

__all__ = ["main"]

DONE, UNSAFE, BAD_INPUT, INTERRUPTED, BROKEN_PIPE = 0, 1, 2, 130, 141
PLANNERS = {"full": "full model"}  # what figures call a motion by its model
# what `--out` writes
FILES = ("plan.json", "trajectory.csv", "trajectory.json", "zmp.png", "joints.png")

EXIT_CODES = """\
exit codes:
  0  done, and the motion is safe
  1  no motion was found, or it is unsafe; the diagnosis is printed
  2  bad input, or start or goal tips over at rest; one sentence on standard error says what
"""
SCENARIO_KEYS = """\
keys of scenario files (TOML); SI units, angles in radians or, where a key ends in _deg, degrees;
paths are relative to the file:
  title               one line
  [machine]           name (shipped) or urdf (file); point_masses (true drops rotational inertias);
                      joint_limits (file), limits (table: position_lower, position_upper, velocity,
                      acceleration, effort); support (table: vertices, height) or contact_links
  [machine.payload]   mass [kg], com [m] in its frame, frame (a link),
                      inertia [kg m^2] about com, 3 x 3 (default: a point mass)
  [ground]            roll_deg (negative leans left), pitch_deg (positive is nose down)
  [ground.heightmap]  instead: file (CSV or NPY), resolution [m], origin [m]
  [motion]            start, goal, start_velocity, goal_velocity: a number per joint; or with _deg
  [base]              start, goal: x, y, yaw [m, m, rad]; max_speed, max_acceleration, max_yaw_rate,
                      max_yaw_acceleration; start_velocity, goal_velocity: speed, yaw rate;
                      x_bounds, y_bounds [m]
  [plan]              model (full or simplified), intervals, margin [m], qp_solver; uncertain:
                      tipping_fraction (safe with the payload divided by it, too; ISO 10567: 0.75),
                      payload_uncertainty (share of its mass and inertia: 0.1 is ten percent),
                      payload_com_uncertainty [m] (one number, or one per axis of its frame),
                      slope_uncertainty_deg (by which gravity may be off, in any direction)
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: Arguments without the program's name; None takes those of the process.

    Returns:
        The exit code: 0 done and safe, 1 unsafe or not solved, 2 bad input.
    """
    arguments = _parser().parse_args(argv)
    if isinstance(sys.stdout, io.TextIOWrapper):
        # a title need not be in the terminal's alphabet
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        code: int = arguments.run(arguments)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return INTERRUPTED
    except (BrokenPipeError, SystemExit):  # `| head` has read enough; rich makes a SystemExit of it
        # the interpreter flushes once more at its exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except ZmpSqpError as error:
        complaint = str(error)
    except OSError as error:
        complaint = f"{error.filename}: {error.strerror}" if error.filename else str(error)
    print(f"zmp-sqp: error: {complaint}", file=sys.stderr)
    return BAD_INPUT


def _parser() -> argparse.ArgumentParser:
    shipped = "shipped scenarios:\n" + "".join(f"  {name}\n" for name in shipped_scenarios())
    parser = argparse.ArgumentParser(
        prog="zmp-sqp",
        description="Minimum-time motions of heavy mobile manipulators that do not tip over.",
        epilog=(
            "examples:\n  zmp-sqp plan paper_1 --out out/paper_1\n  zmp-sqp plan --help\n"
            f"  zmp-sqp paper --out out/paper\n  zmp-sqp check --help\n\n{shipped}\n{EXIT_CODES}"
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"zmp-sqp {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    command = commands.add_parser(
        "plan",
        help="plan the motion of a scenario",
        description="Plan the motion of a scenario, print what came out, and write trajectory and figures.",
        epilog=(
            "examples:\n"
            "  zmp-sqp plan paper_1 --out out/paper_1      table, trajectory, figures\n"
            "  zmp-sqp plan my_machine.toml --json -       results for another program\n"
            "  zmp-sqp plan paper_1 --margin 0.3 --verbose\n\n"
            f"{shipped}\n{SCENARIO_KEYS}\n{RESULT_KEYS}\n{EXIT_CODES}"
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_plan)
    command.add_argument(
        "scenario", metavar="SCENARIO", help="a scenario file (TOML), or the name of a shipped one"
    )
    command.add_argument(
        "--out", type=Path, metavar="DIR", help=f"write {', '.join(FILES)}, in place of old ones"
    )
    command.add_argument(
        "--json",
        metavar="FILE",
        help="write the results; - is standard output, with nothing else there",
    )
    command.add_argument(
        "--qp-solver",
        metavar="NAME",
        help="proxqp, piqp or qpsolvers:NAME (default: the scenario's)",
    )
    command.add_argument(
        "--intervals", type=int, metavar="N", help="of the time grid (default: the scenario's)"
    )
    command.add_argument(
        "--margin", type=float, metavar="M", help="[m] from ZMP to edges (default: the scenario's)"
    )
    command.add_argument(
        "--no-figures", dest="figures", action="store_false", help="write no figures"
    )
    command.add_argument(
        "--no-diagnosis",
        dest="diagnosis",
        action="store_false",
        help="where no motion is found, do not look for a payload or a slope that would do",
    )
    command.add_argument("--verbose", action="store_true", help="print every iteration of the SQP")
    _add_paper(commands)
    add_check(commands, EXIT_CODES)
    add_replay(commands, f"{shipped}\n", EXIT_CODES)
    return parser


def _add_paper(commands: Any) -> None:
    command = commands.add_parser(
        "paper",
        help="every table and figure of Song & Sharf 2020 beside its numbers",
        description=(
            "Plan both tests of Song & Sharf 2020 with every planner, the variants that its misprints suggest, the\n"
            "base's motion under eq. (21), the analytic slew, and a ladder of payloads and reaches; print tables,\n"
            "write figures."
        ),
        epilog=(
            "examples:\n"
            "  zmp-sqp paper --out out/paper               tables and figures 3, 4, 5, 6; a minute or two\n"
            "  zmp-sqp paper --no-ladder --json -          results for another program\n\n"
            f"{PAPER_KEYS}\n{EXIT_CODES}"
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_paper)
    command.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help=f"write {', '.join(PAPER_FILES)}, in place of old ones",
    )
    command.add_argument(
        "--json",
        metavar="FILE",
        help="write the results; - is standard output, with nothing else there",
    )
    command.add_argument(
        "--qp-solver", default="proxqp", metavar="NAME", help="of the tests (default: proxqp)"
    )
    command.add_argument(
        "--repeats",
        type=_count,
        default=5,
        metavar="K",
        help="plans per time (default: 5, the median)",
    )
    command.add_argument(
        "--no-ladder", dest="ladder", action="store_false", help="leave the ladder out"
    )
    command.add_argument(
        "--no-figures", dest="figures", action="store_false", help="write no figures"
    )


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, not {text!r}")
    return int(text)


def _paper(arguments: argparse.Namespace) -> int:
    safe = run_paper(
        out=arguments.out,
        json_file=arguments.json,
        with_ladder=arguments.ladder,
        figures=arguments.figures,
        qp_solver=arguments.qp_solver,
        repeats=arguments.repeats,
    )
    return DONE if safe else UNSAFE


# --- zmp-sqp plan
# -----------------------------------------------------------------------------------------------------


def _plan(arguments: argparse.Namespace) -> int:
    from rich.console import Console

    scenario = load_scenario(arguments.scenario)
    overrides = {
        key: value
        for key in ("intervals", "margin")
        if (value := getattr(arguments, key)) is not None
    }
    problem = replace(scenario.problem, **overrides)
    qp_solver = arguments.qp_solver or scenario.qp_solver
    if arguments.out is not None:
        arguments.out.mkdir(parents=True, exist_ok=True)  # fails before the work, not after it
        # nobody shall take the motion of an earlier run for that of a failed one
        for name in FILES:
            (arguments.out / name).unlink(missing_ok=True)

    found = plan(problem, qp_solver=qp_solver)
    baseline = _baseline(problem)
    result = make_result(scenario, found, baseline, qp_solver)

    # [m] is a unit, no markup
    console = Console(stderr=arguments.json == "-", highlight=False, markup=False)
    console.print(f"{scenario.name}: {scenario.title}", style="bold", soft_wrap=True)
    if arguments.verbose:
        console.print(history_table(found))
    console.print(summary_table(result))
    if found.success:
        console.print(joint_table(result, joint_unit(problem.machine)))
    if not found.success and arguments.diagnosis:
        with console.status("looking for what would be possible ...") as status:
            said = diagnose(found, progress=lambda words: status.update(f"trying {words} ..."))
        result["diagnosis"] = {
            "largest_payload": said.largest_payload,
            "steepest_slope": said.steepest_slope,
        }
        result["message"] = said.message
    console.print(result["message"], style=None if found.success else "bold red", soft_wrap=True)
    if arguments.out is not None:
        for line in _write(arguments.out, found, baseline, result, figures=arguments.figures):
            console.print(line, soft_wrap=True)
    if arguments.json == "-":
        print(_dump(result), end="")
    elif arguments.json is not None:
        Path(arguments.json).write_text(_dump(result), encoding="utf-8")
        console.print(f"wrote {arguments.json}", soft_wrap=True)
    return DONE if found.success else UNSAFE


def _baseline(problem: Problem) -> Trajectory | None:
    """The motion that knows no ZMP; it goes from rest to rest only, on a base that stands."""
    if problem.base is not None or np.any(problem.start_velocity) or np.any(problem.goal_velocity):
        return None
    return phase_plane(problem.machine, problem.start, problem.goal)


def _write(
    folder: Path,
    found: Plan,
    baseline: Trajectory | None,
    result: Mapping[str, Any],
    *,
    figures: bool,
) -> Iterator[str]:
    """Write the files of `--out` one by one; yields a line about each."""
    (folder / "plan.json").write_text(_dump(result), encoding="utf-8")
    yield f"wrote {folder / 'plan.json'}"
    if not found.success:
        return
    found.trajectory.to_csv(folder / "trajectory.csv")
    yield f"wrote {folder / 'trajectory.csv'}"
    found.trajectory.to_json(folder / "trajectory.json")
    yield f"wrote {folder / 'trajectory.json'}"
    if not figures:
        return
    try:
        loci = {} if baseline is None else {"phase plane": baseline}
        planner = PLANNERS.get(found.problem.model, found.problem.model)
        plot_zmp(found.problem, loci | {planner: found.trajectory}, folder / "zmp.png")
        yield f"wrote {folder / 'zmp.png'}"
        given = found.problem
        plot_joints(
            given.machine,
            found.trajectory,
            folder / "joints.png",
            base=given.base,
            ground=given.ground,
        )
        yield f"wrote {folder / 'joints.png'}"
    except ModuleNotFoundError as missing:
        if missing.name is None or missing.name.partition(".")[0] != "matplotlib":
            raise
        yield "no figures: they need matplotlib, which `pip install zmp-sqp[plots]` brings"


def _dump(result: Mapping[str, Any]) -> str:
    return json.dumps(result, indent=2, allow_nan=False) + "\n"


if __name__ == "__main__":
    sys.exit(main())
